"""Where a simulation of what is believed says that the robot touches (F §V-G)."""

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
from contactfusion.thinning import first_in_voxels
from contactfusion.units import Spread


class SimulatorConfig(GeneratorConfig):
    """The options of `simulator`."""

    objects: dict[str, ObjectConfig] = Field(min_length=1)
    """What stands around, by name, where it is believed to be."""
    links: tuple[str, ...] = ()
    """The links that may touch, such as those of the hand; none: the whole robot."""
    tolerance: Spread = Field(default=0.005, gt=0)
    """The surface touches where it is this near an object, or inside [m]: as much as the object may
    be off, for it to be felt at all; what goes beyond goes into the spreads."""
    likelihood: float = Field(default=0.5, ge=0, le=1)
    """Of a predicted contact."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation of where the robot believes its surface to be [m]."""


class SimulatorGenerator(Generator[SimulatorConfig]):
    """Support, multi contact: the surface of the robot that meets an object as believed.

    A physics world of its own holds the robot and the objects, and says which links are near which
    object; there, points of the surface are compared with the object's signed distance. An
    `ObjectPose` moves an object of the world.
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
        """Travel without the world; it is built anew."""
        return {**self.__dict__, "_world": None}

    def prepare(self, robot: RobotModel) -> None:
        """Build the world."""
        self._world = BelievedWorld(robot, self._objects.models)

    def reset(self) -> None:
        """Believe again what is configured."""
        self._objects.reset()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The surface that meets an object.

        Raises:
            ConfigurationError: there is no robot.
            RobotError: an object of that name is not configured, or no link of a name.
        """
        if isinstance(reading, ObjectPose):
            self._objects.update(reading, self.name)
            return ()
        robot = state.posed_robot(self.name)
        if self._world is None:
            self.prepare(robot.model)
        assert self._world is not None
        wanted = set(robot.model.known_links(self.config.links))
        places, spreads = [np.empty((0, 3))], [np.empty(0)]
        for name, there in self._objects.poses(state.frames, state.grid.frame).items():
            model = self._objects.models[name]
            near = self._world.near(robot, name, there, self.config.tolerance) & wanted
            if not near:
                continue
            points = robot.surface_of(sorted(near)).points
            points = points[model.distances(there, points) <= self.config.tolerance]
            places.append(points)
            spreads.append(model.spreads(there, points))
        points, own = np.concatenate(places), np.concatenate(spreads)
        kept = first_in_voxels(points, state.grid)
        return (
            self.cloud(
                reading,
                points[kept],
                self.config.likelihood,
                frame=state.grid.frame,
                # what the tolerance covers by further places is not stated twice
                spreads=np.hypot(self.config.noise, _rest(own[kept], self.config.tolerance)),
            ),
        )


def _rest(deviations: FloatArray, covered: float) -> FloatArray:
    """What is left of standard deviations of shape (n,) when so much is covered, both [m]."""
    return np.asarray(np.sqrt(np.maximum(deviations**2 - covered**2, 0.0)))


class BelievedWorld:
    """A robot and objects in PyBullet, put where they are believed to be; nothing falls in it.

    Args:
        robot: the robot.
        objects: by name.

    Raises:
        DependencyError: pybullet is not installed.
    """

    def __init__(self, robot: RobotModel, objects: Mapping[str, ObjectModel]) -> None:
        self._world = BulletWorld(robot)
        self._objects = {
            name: [(self._world.add(shape), shape.pose()) for shape in one.shapes]
            for name, one in objects.items()
        }

    def near(self, robot: PosedRobot, name: str, pose: Pose, reach: float) -> set[str]:
        """The links that may lie within `reach` [m] of an object.

        Args:
            robot: in its pose.
            name: the object.
            pose: where it is believed to be, in the frame of the robot's poses.
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
    """Offer the simulator generator."""
    return {"simulator": SimulatorGenerator}
