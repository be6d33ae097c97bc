"""What drivers of known arms report of forces: sign, axes, unit and topic, each with its source.

A name fills options of a generator beneath what the user gives, as a preset does.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from contactfusion.errors import ConfigurationError, name_hint

Options = Mapping[str, Any]


@dataclass(frozen=True)
class Convention:
    """How a driver reports wrenches or efforts.

    Attributes:
        options: of the generator, in place of its defaults.
        frame: the frame of the readings: about whose origin torques are; in words.
        topic: pattern of the ends of topics that hold it; empty: no topic of a known message.
        columns: pattern of the columns of a log that hold it; empty: none are known.
        compensated: whether the driver takes gravity of its payload off.
        source: where this is stated, and how sure it is.
    """

    options: Options
    frame: str
    topic: str = ""
    columns: str = ""
    compensated: bool = True
    source: str = ""


FRANKA = "libfranka robot_state.h; its example force_control drives τ_J - g to Jᵀ f of its push"
COUNTERFORCE = f"{FRANKA}; libfranka issue 26: a pull along +z reads -z"
WRENCHES: Mapping[str, Convention] = {
    "franka_k_f_ext_hat_k": Convention(
        {"sign": "by_robot"},
        "the stiffness frame, such as fr3_hand_tcp",
        topic=r"external_wrench_in_stiffness_frame|franka_state_controller/F_ext",
        columns=r"K_F_ext_hat_K.*",
        source=COUNTERFORCE,
    ),
    "franka_o_f_ext_hat_k": Convention(
        {"sign": "by_robot"},
        "the base, such as fr3_link0; any link may bear it",
        topic=r"external_wrench_in_base_frame",
        columns=r"O_F_ext_hat_K.*",
        source=f"{COUNTERFORCE}; torque about the base: libfranka issue 112",
    ),
    "kinova_tool_external_wrench": Convention(
        {"sign": "on_robot"},
        "the tool; its documentation names no axes: try",
        columns=r"tool_external_wrench.*",
        source="kortex BaseFeedback.md; kortex issue 125: forces applied on the gripper. Only in "
        "high-level control (issue 52). The sign was not tried",
    ),
    "ur_actual_tcp_force": Convention(
        {"sign": "on_robot", "axes": "base"},
        "the flange, tool0, of an e-Series; the TCP of a CB3",
        columns=r"actual_TCP_force.*",
        source="RTDE guide: generalized forces in the TCP; Universal_Robots_ROS2_Driver pulls 1287 "
        "and 1615: at the flange, along the axes of the base. No document states the sign",
    ),
    "ur_wrench": Convention(
        {"sign": "on_robot"},
        "that of the header: tool0, or tool0_controller since pull 1652",
        topic=r"force_torque_sensor_broadcaster/wrench",
        source="Universal_Robots_ROS2_Driver issue 235 and pulls 237, 1652: actual_TCP_force, "
        "turned to the tool. No document states the sign",
    ),
}
"""Of `force_torque`."""
EFFORTS: Mapping[str, Convention] = {
    "franka_tau_ext_hat_filtered": Convention(
        {"effort": "external", "sign": "by_robot"},
        "panda_joint1 or fr3_joint1 to 7 [N·m]; the topic external_joint_torques holds no "
        "positions: put both into one JointState, or a log",
        columns=r"tau_ext_hat_filtered.*",
        source=FRANKA,
    ),
    "franka_tau_j": Convention(
        {"effort": "measured"},
        "panda_joint1 or fr3_joint1 to 7 [N·m], behind the gears",
        topic=r"franka_robot_state_broadcaster/measured_joint_states",
        columns=r"tau_J(?:_?\d)?",
        compensated=False,
        source=FRANKA,
    ),
    "kinova_torque": Convention(
        {"effort": "measured", "sign": "by_robot"},
        "joint_1 to 6 or 7 [N·m], behind the gears",
        compensated=False,
        source="kortex ActuatorFeedback.md; kortex issue 226: at rest it reads minus the torque of "
        "gravity; ros2_kortex hands it on unchanged as effort",
    ),
    "ur_actual_current": Convention(
        {"effort": "current"},
        "shoulder_pan_joint to wrist_3_joint [A]; give each its `constant`",
        columns=r"actual_current(?:_?\d)?",
        compensated=False,
        source="RTDE guide; 31 runs of a UR10e (JKU Linz, ur10e_force_control_comparison): the "
        "current rises against the torque of a contact",
    ),
}
"""Of `joint_torque`."""
VENDORS: Mapping[str, Mapping[str, Convention]] = {
    "force_torque": WRENCHES,
    "joint_torque": EFFORTS,
}


def beneath(kind: str, fields: Any) -> Any:
    """The options of a generator over those of the `vendor` that they name.

    Args:
        kind: the type of the generator.
        fields: its options as they are given.

    Raises:
        ConfigurationError: there is no such vendor.
    """
    if not isinstance(fields, dict) or (name := fields.get("vendor")) is None:
        return fields
    if str(name) not in VENDORS[kind]:
        hint = name_hint(str(name), VENDORS[kind], "vendors")
        raise ConfigurationError(f"unknown vendor '{name}': {hint}", "vendor")
    return {**VENDORS[kind][name].options, **fields}


def convention_of(kind: str, name: str) -> str:
    """The convention that a topic, or a column of a log, holds by its name; empty: none is known.

    Args:
        kind: the type of the generator that takes it.
        name: of the topic or the column.
    """
    for vendor, known in VENDORS[kind].items():
        topic = known.topic and re.search(f"(?:^|/)(?:{known.topic})$", name)
        if topic or (known.columns and re.fullmatch(known.columns, name)):
            return vendor
    return ""
