"""The state of the robot at the stamp of one reading."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contactfusion.contacts import Contact
from contactfusion.grid import Grid
from contactfusion.readings import JointState
from contactfusion.surface import Surface

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from contactfusion.frames import FrameTree


def _no_frames() -> "FrameTree":
    from contactfusion.frames import FrameTree  # scipy.spatial takes most of a second to import

    return FrameTree({})


@dataclass(frozen=True, eq=False)
class State:
    """What a generator or controller may know, all at `now`.

    Attributes:
        now: the stamp of the reading, or of the step [s].
        grid: the frame and voxel size of the hypothesis space.
        frames: the poses of all frames.
        joints: the joints, interpolated, or None.
        base_pose: the base in the odometry's frame, or None.
        surface: the robot's surface in the grid's frame, or None.
        objects: the believed poses of objects in the grid's frame, by name.
        contacts: the contacts of the last step.
    """

    now: float
    grid: Grid
    frames: "FrameTree" = field(default_factory=_no_frames)
    joints: JointState | None = None
    base_pose: "RigidTransform | None" = None
    surface: Surface | None = None
    objects: Mapping[str, "RigidTransform"] = field(default_factory=dict)
    contacts: tuple[Contact, ...] = ()
