"""The state of the robot at the stamp of one reading."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.frames import FrameTree, Pose
from contactfusion.grid import Grid
from contactfusion.hypotheses import Resultant
from contactfusion.readings import JointState, Wrench
from contactfusion.surface import Surface

if TYPE_CHECKING:
    from contactfusion.robots.posed import PosedRobot


class LastStep(Protocol):
    """Access to the last step of the integrator, also from a process of its own."""

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts, the most likely first."""
        ...

    def evidence(self, without: str) -> FloatArray:
        """The positions with evidence of other generators than `without`, shape (n, 3) [m]."""
        ...


@dataclass(frozen=True, eq=False)
class State:
    """The state of the robot for generators and controllers, at `now`.

    Attributes:
        now: the stamp of the reading, or of the step [s].
        grid: the frame and voxel size of the hypothesis space.
        frames: the poses of all frames.
        joints: the joints, interpolated, or None; with an older stamp where they are silent since.
        base_pose: the base in the odometry's frame, or None.
        surface: the robot's surface in the grid's frame, or None.
        robot: the robot of the URDF in its pose, in the grid's frame, or None.
        objects: the believed poses of objects in the grid's frame, by name.
        wrenches: readings of all wrists since the last step, for controllers alone.
        resultants: the sum of all contacts on a part of the robot as generators measure it, by the
            name of the generator, in the grid's frame; none older than 0.1 s.
        resultant_ages: how long before `now` each of these was measured [s]; 0 where it is missing.
        fusion: the last step of the integrator, or None before the first; a `Fusion`, unless the
            generator is isolated.
        unplaced: why the pose of the configured robot or surface in the grid's frame is unknown;
            empty when it is known, or when none is configured.
    """

    now: float
    grid: Grid
    frames: FrameTree = field(default_factory=lambda: FrameTree({}))
    joints: JointState | None = None
    base_pose: Pose | None = None
    surface: Surface | None = None
    robot: "PosedRobot | None" = None
    objects: Mapping[str, Pose] = field(default_factory=dict)
    wrenches: tuple[Wrench, ...] = ()
    resultants: Mapping[str, Resultant] = field(default_factory=dict)
    resultant_ages: Mapping[str, float] = field(default_factory=dict)
    fusion: LastStep | None = None
    unplaced: str = ""

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts of the last step, the most likely first."""
        return self.fusion.contacts if self.fusion else ()

    def posed_robot(self, asked_by: str) -> "PosedRobot":
        """The robot.

        Args:
            asked_by: the generator that requires it.

        Raises:
            ConfigurationError: none is configured, or its joints or its pose are not known yet.
        """
        if self.robot is None:
            raise ConfigurationError(
                f"'{asked_by}' needs the robot: {self.unplaced or 'configure `robot`'}"
            )
        return self.robot

    def placed_surface(self, asked_by: str) -> Surface:
        """The robot's surface in the grid's frame.

        Args:
            asked_by: the generator that requires it.

        Raises:
            ConfigurationError: none is configured, or its joints or its pose are not known yet.
        """
        if self.surface is None:
            raise ConfigurationError(
                f"'{asked_by}' needs the surface of the robot: "
                f"{self.unplaced or 'configure `surface` or `robot`'}"
            )
        return self.surface

    def carried_by(self, frame: str) -> tuple[str, ...]:
        """The links on which a wrench that is measured in a frame is felt; none: on all.

        Raises:
            RobotError: no chain of frames leads from the frame to a link.
        """
        links = self.links_of(frame)
        return tuple(self.robot.model.beyond(links[0])) if self.robot else links

    def links_of(self, frame: str) -> tuple[str, ...]:
        """The link that a sensor in a frame is on; none where the body is not divided into links.

        Raises:
            RobotError: no chain of frames leads from the frame to a link.
        """
        is_divided = self.robot or (self.surface and len(self.surface.link_names) > 1)
        return (self.link_of(frame),) if is_divided else ()

    def link_of(self, frame: str) -> str:
        """The link that a sensor's frame is, or is fixed to through other frames.

        Raises:
            RobotError: no chain of frames leads to a link of the robot, or of the surface.
        """
        links: Collection[str] = self.surface.link_names if self.surface else ()
        if self.robot:
            links = self.robot.model.urdf.links
        for name in self.frames.ancestors(frame):
            if name in links:
                return name
        whose, where = ("robot", "robot.frames") if self.robot else ("surface", "frames")
        raise RobotError(
            f"no transform joins '{frame}' to a link of the {whose}; give its pose on a link in "
            f"`{where}` (the links are: {', '.join(links)})"
        )

    def evidence(self, without: str) -> FloatArray:
        """The positions where the last step had evidence of other generators.

        Args:
            without: the generator to leave out.

        Returns:
            Shape (n, 3) [m], in the grid's frame; nulled voxels are included.
        """
        return self.fusion.evidence(without) if self.fusion else np.empty((0, 3))
