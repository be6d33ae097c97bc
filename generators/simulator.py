"""Contacts in a simulation of the believed world (F §V-G)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import JointState, ObjectPose, Reading
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import BelievedObjects, ObjectConfig, ObjectModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.state import State
from contactfusion.thinning import voxel_downsample
from contactfusion.units import Spread


class SimulatorConfig(GeneratorConfig):
    """The options of `simulator`."""

    objects: dict[str, ObjectConfig] = Field(min_length=1)
    """The objects, by name, with their believed poses."""
    links: tuple[str, ...] = ()
    """The links that may touch, such as those of the hand; empty: the whole robot."""
    tolerance: Spread = Field(default=0.005, gt=0)
    """The distance from an object up to which the surface touches [m]; no less than the usual error
    of the object's pose. A larger uncertainty adds to the spreads."""
    likelihood: float = Field(default=0.5, ge=0, le=1)
    """Of a predicted contact."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation of the position of the robot's surface [m]."""


class SimulatorGenerator(Generator[SimulatorConfig]):
    """Support, multi contact: the surface of the robot that touches an object as believed.

    A physics world of its own holds the robot and the objects, and finds the links near each
    object; the points of their surface are compared with the object's signed distance. An
    `ObjectPose` updates an object's pose.
    """

    Config = SimulatorConfig
    readings = (JointState, ObjectPose)
    needs_body = True
    outputs = {"": HypothesisKind.SUPPORT}

    def __init__(self, name: str, config: SimulatorConfig) -> None:
        super().__init__(name, config)
        self._objects = BelievedObjects(config.objects)
        self._world: BelievedWorld | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Pickle without the world; it is built anew."""
        return {**self.__dict__, "_world": None}

    def prepare(self, robot: RobotModel) -> None:
        """Build the world."""
        self._world = BelievedWorld(robot, self._objects.models)

    def reset(self) -> None:
        """Return to the configured poses."""
        self._objects.reset()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The surface that touches an object.

        Raises:
            ConfigurationError: there is no robot.
            RobotError: a reading names an object, or `links` a link, that does not exist.
        """
        if isinstance(reading, ObjectPose):
            self._objects.update(reading, self.name)
            return ()
        robot = state.posed_robot(self.name)
        if self._world is None:
            self.prepare(robot.model)
        assert self._world is not None
        wanted = set(robot.model.known_links(self.config.links))
        touched, spreads = [np.empty((0, 3))], [np.empty(0)]
        for name, pose in self._objects.poses(state.frames, state.grid.frame).items():
            model = self._objects.models[name]
            near = self._world.near(robot, name, pose, self.config.tolerance) & wanted
            if not near:
                continue
            points = robot.surface_of(sorted(near)).points
            points = points[model.distances(pose, points) <= self.config.tolerance]
            touched.append(points)
            spreads.append(model.spreads(pose, points))
        points, own = np.concatenate(touched), np.concatenate(spreads)
        kept = voxel_downsample(points, state.grid)
        return (
            self.cloud(
                reading,
                points[kept],
                self.config.likelihood,
                frame=state.grid.frame,
                # what the tolerance covers by further points is not counted twice
                spreads=np.hypot(self.config.noise, _rest(own[kept], self.config.tolerance)),
            ),
        )


def _rest(deviations: FloatArray, covered: float) -> FloatArray:
    """The rest of standard deviations, shape (n,), once `covered` is subtracted, both [m]."""
    return np.asarray(np.sqrt(np.maximum(deviations**2 - covered**2, 0.0)))


class BelievedWorld:
    """A robot and objects in PyBullet at their believed poses; there are no dynamics.

    Args:
        robot: the robot.
        objects: by name.

    Raises:
        DependencyError: pybullet is not installed.
    """

    def __init__(self, robot: RobotModel, objects: Mapping[str, ObjectModel]) -> None:
        self._world = BulletWorld(robot)
        self._objects = {
            name: [(self._world.add(shape), shape.pose()) for shape in model.shapes]
            for name, model in objects.items()
        }

    def near(self, robot: PosedRobot, name: str, pose: Pose, reach: float) -> set[str]:
        """The links that may lie within `reach` [m] of an object.

        Args:
            robot: in its pose.
            name: of the object.
            pose: of the object as believed, in the frame of the robot's poses.
            reach: [m].
        """
        self._world.place_robot(robot.base)
        self._world.bend(robot.positions)
        links: set[str] = set()
        for body, own in self._objects[name]:
            self._world.place(body, pose @ own)
            links |= self._world.near(body, reach)
        return links


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[SimulatorConfig]]]:
    """The simulator generator."""
    return {"simulator": SimulatorGenerator}
