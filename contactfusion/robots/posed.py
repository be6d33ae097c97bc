"""A robot in one pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in
from contactfusion.readings import JointState
from contactfusion.robots.model import RobotModel
from contactfusion.surface import Surface


@dataclass(frozen=True, eq=False)
class PosedRobot:
    """A robot with its joints at some positions; all poses and points are in one frame.

    Attributes:
        model: the robot.
        positions: shape (n,), of `model.joint_names` [rad, m].
        frame: the frame of all poses and points.
        base: the pose of the root link in that frame.
    """

    model: RobotModel
    positions: FloatArray
    frame: str
    base: Pose

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without cached results."""
        return PosedRobot, (self.model, self.positions, self.frame, self.base)

    def with_joints(self, reading: JointState) -> "PosedRobot":
        """The robot with the joints that a reading holds where it has them."""
        model = self.model
        rows = {name: row for row, name in enumerate(reading.names)}
        positions = self.positions.copy()
        for number, name in enumerate(model.joint_names):
            if name in rows and name not in model.config.still:
                positions[number] = reading.positions[rows[name]]
        positions = model.followed(positions, moved=rows)
        return (
            self
            if np.array_equal(positions, self.positions)
            else replace(self, positions=positions)
        )

    @cached_property
    def poses(self) -> dict[str, Pose]:
        """The pose of each link."""
        links = self.model.poses_at(self.positions)
        return {name: self.base @ pose for name, pose in links.items()}

    def pose_of(self, frame: str) -> Pose:
        """The pose of a link or of a frame of the description.

        Raises:
            RobotError: no link and no frame of the description has that name.
        """
        return self.poses[self.model.link_of(frame)] @ self.model.pose_on_link(frame)

    @cached_property
    def surface(self) -> Surface:
        """The surface of the whole robot."""
        return self.surface_of(())

    def surface_of(self, links: Sequence[str]) -> Surface:
        """The surface of some links; of all when none is named.

        Raises:
            RobotError: there is no link of a name.
        """
        wanted = self.model.known_links(links)
        parts = [
            (part, self.poses[name]) for name, part in self.model.parts.items() if name in wanted
        ]
        return Surface.of_parts(self.frame, parts, self.model.link_names)

    def load_on(self, frame: str) -> tuple[float, FloatArray]:
        """The load of a sensor: mass [kg] and centre of mass, shape (3,) [m]."""
        return self.model.load_on(frame, self.poses)

    def spheres_of(self, links: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Spheres in place of some links, or of all when none is named.

        Returns:
            Centres, shape (n, 3) [m], and radii, shape (n,) [m].

        Raises:
            RobotError: there is no link of a name.
        """
        wanted = self.model.known_links(links)
        spheres = self.model.spheres
        centres, radii = [np.empty((0, 3))], [np.empty(0)]
        for number, name in enumerate(spheres.link_names):
            if name in wanted:
                own = spheres.links == number
                centres.append(points_in(self.poses[name], spheres.centres[own]))
                radii.append(spheres.radii[own])
        return np.concatenate(centres), np.concatenate(radii)

    def at(self, positions: FloatArray) -> "PosedRobot":
        """The robot with its joints at other positions, shape (n,) [rad, m]."""
        return replace(self, positions=positions)
