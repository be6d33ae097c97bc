"""What a grasping hand knows at one step: where it is, how far closed, and where it is touched."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.controllers.grasp_contact import HandContact, on_hand
from contactfusion.controllers.grasp_parameters import ReactiveGraspConfig
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.frames import Pose
from contactfusion.readings import JointState
from contactfusion.state import State


@dataclass(frozen=True, eq=False)
class Sense:
    """What the hand knows.

    Attributes:
        now: [s].
        tool: the pose of the tool in the frame of the hypothesis space.
        closed: shape (k,), how far each joint of the gripper is closed, from 0 to 1.
        speeds: shape (k,), of these [rad/s, m/s].
        touch: the contact on the hand, or None.
    """

    now: float
    tool: Pose
    closed: FloatArray
    speeds: FloatArray
    touch: HandContact | None

    @property
    def ahead(self) -> FloatArray:
        """Where the tool looks, shape (3,)."""
        return self.tool[:3, 2]

    @property
    def place(self) -> FloatArray:
        """Where the tool is, shape (3,) [m]."""
        return self.tool[:3, 3]


def sensed(
    contacts: Sequence[Contact], joints: JointState, state: State, options: ReactiveGraspConfig
) -> Sense:
    """Bring contacts and joints into the form in which the hand is controlled.

    Args:
        contacts: of one step, in the frame of the hypothesis space.
        joints: of the gripper, and perhaps others.
        state: the robot at the step.
        options: tool and gripper.

    Raises:
        FrameError: the frame of the tool is not known.
        ConfigurationError: a joint of the gripper is not told, or no velocities are.
    """
    for name in options.gripper:
        if name not in joints.names:
            hint = name_hint(name, joints.names, "joints")
            raise ConfigurationError(f"unknown joint '{name}': {hint}", f"gripper.{name}")
    if joints.velocities is None:
        raise ConfigurationError(
            "the joints tell no velocities, by which one knows that the fingers rest", "gripper"
        )
    rows = [joints.names.index(name) for name in options.gripper]
    opened, closed = np.array(list(options.gripper.values())).T
    tool = state.frames.pose(state.grid.frame, of=options.tool)
    return Sense(
        now=state.now,
        tool=tool,
        closed=(joints.positions[rows] - opened) / (closed - opened),
        speeds=joints.velocities[rows],
        touch=on_hand(contacts, tool, state.surface, options.hand),
    )
