"""A gripper on an arm, and recordings of ROS in which its right finger is pushed, for tests.

Its right finger mimics the left. Sensors stand in frames that no link of the URDF is, joined to
links by /tf_static; an optional /tf places the robot in a map.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from contactfusion.arrays import FloatArray
from contactfusion.readings.messages import message
from tests.ros_bags import SECOND, Said, joints, top, transforms
from tests.urdfs import joint, link

MIMIC = '<limit lower="0" upper="0.05" effort="1" velocity="1"/>{}'
ROBOT = "".join(
    (
        '<robot name="gripper">',
        link("footprint"),
        link("base"),
        link("arm", '<box size="0.4 0.05 0.05"/>', at="0.2 0 0"),
        link("tool", '<box size="0.04 0.2 0.04"/>'),
        link("left", '<box size="0.1 0.02 0.04"/>', at="0.07 0 0"),
        link("right", '<box size="0.1 0.02 0.04"/>', at="0.07 0 0"),
        joint("stand", "footprint", "base", "fixed", "", xyz="0 0 0.3"),
        joint("shoulder", "base", "arm"),
        joint("flange", "arm", "tool", "fixed", "", xyz="0.42 0 0"),
        joint("finger", "tool", "left", "prismatic", MIMIC.format(""), axis="0 1 0"),
        joint(
            "thumb",
            "tool",
            "right",
            "prismatic",
            MIMIC.format('<mimic joint="finger" multiplier="0.5" offset="0.01"/>'),
            axis="0 -1 0",
        ),
        "</robot>",
    )
)
LENGTH = 1.0
"""Of the recording [s]."""
FINGER = 0.03
"""Where the driven finger is [m]."""
PUSHED = np.array([0.5, -(0.5 * FINGER + 0.01) - 0.01, 0.3])
"""Where the right finger is pushed, with the shoulder at 0, in the footprint [m]."""
FORCE = np.array([0.0, 5.0, 0.0])
"""Of the push, on the robot [N]."""
SENSOR = np.array([0.42 + 0.03, 0.0, 0.3])
"""Where the force-torque sensor is, in the footprint [m]; its axes are the footprint's."""
PIPELINE: Mapping[str, Any] = {
    "robot": {"urdf": "gripper.urdf"},
    "integrator": {"frame": "base"},
    "cycle": {"on": "wrench"},
    "generators": {
        "wrist": {"type": "force_torque", "sign": "on_robot"},
        "camera": {"type": "range", "evidence": "proximity", "links": ["right"]},
    },
}


def messages_of(tf: bool, mimic: bool = False) -> list[Said]:
    """The messages of a push; with `tf`, the robot drives in a map whose /tf begins late."""
    said = list(_messages(tf, mimic))
    return sorted(said, key=lambda one: one[1])


def configured(folder: Path, recording: Path | None = None, **changes: Any) -> Path:
    """Write the robot, and the configuration for `run` of a recording, or for `replay` without."""
    (folder / "gripper.urdf").write_text(ROBOT)
    fields = {**PIPELINE, **changes}
    if recording is not None:
        fields["recording"] = {"type": "ros", "file": str(recording)}
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump({name: dict(one) if isinstance(one, Mapping) else one
                                    for name, one in fields.items()}))  # fmt: skip
    return path


def _messages(tf: bool, mimic: bool) -> Iterator[Said]:
    yield "/tf_static", 0, transforms((0, "tool", "ft_sensor"), x=0.03)
    yield "/tf_static", 0, transforms((0, "base", "lens"), x=0.1)
    names, positions = ["shoulder", "finger"], [0.0, FINGER]
    if mimic:
        names, positions = [*names, "thumb"], [*positions, 0.5 * FINGER + 0.01]
    for number in range(100):
        now = number * SECOND // 100
        if number % 2 == 0:
            told = joints(now, name=names, position=np.array(positions))
            yield "/joint_states", now, told
        yield "/wrench", now + 1_000_000, push(now + 1_000_000)
        if number % 10 == 0:
            yield "/points", now + 2_000_000, cloud(now + 2_000_000, sight())
        if tf and 10 < number < 90 and number % 5 == 0:
            yield "/tf", now, transforms((now, "map", "footprint"), x=0.1 * number)


def push(stamp: int) -> Any:
    """geometry_msgs/WrenchStamped of the push."""
    torque = np.cross(PUSHED - SENSOR, FORCE)
    force, turn = (
        message("geometry_msgs/Vector3", x=v[0], y=v[1], z=v[2]) for v in (FORCE, torque)
    )
    both = message("geometry_msgs/Wrench", force=force, torque=turn)
    return message("geometry_msgs/WrenchStamped", header=top(stamp, "ft_sensor"), wrench=both)


def sight() -> FloatArray:
    """What the camera sees of the object that pushes, in its frame, shape (n, 3) [m]."""
    side = np.linspace(-0.01, 0.01, 9)
    face = np.stack(np.meshgrid(side, [-0.02], side), axis=-1).reshape(-1, 3)
    return np.asarray(PUSHED - (0.1, 0.0, 0.3) + face)


def cloud(stamp: int, points: FloatArray) -> Any:
    """sensor_msgs/PointCloud2 of points in the lens's frame."""
    fields = [
        message("sensor_msgs/PointField", name=name, offset=4 * row, datatype=7, count=1)
        for row, name in enumerate("xyz")
    ]
    return message(
        "sensor_msgs/PointCloud2",
        header=top(stamp, "lens"),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points),
        data=np.frombuffer(points.astype("<f4").tobytes(), np.uint8),
        is_dense=True,
    )
