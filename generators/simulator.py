"""Where a simulation of what is believed says that the robot touches (F §V-G)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError, name_hint
from contactfusion.frames import Pose, pose_of
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.generators.believed_world import BelievedWorld
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import JointState, ObjectPose, Reading
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion.state import State


class SimulatorConfig(GeneratorConfig):
    """The options of `simulator`."""

    objects: dict[str, ObjectConfig] = Field(min_length=1)
    """What stands around, by name, where it is believed to be."""
    links: tuple[str, ...] = ()
    """The links that may touch, such as those of the hand; none: the whole robot."""
    tolerance: float = Field(default=0.005, gt=0)
    """The surface touches where it is this near an object, or inside [m]: as much as the object may
    be off, for it to be felt at all; what goes beyond goes into the spreads."""
    likelihood: float = Field(default=0.5, ge=0, le=1)
    """Of a predicted contact."""
    noise: float = Field(default=0.003, ge=0)
    """Standard deviation of where the robot believes its surface to be [m]."""


class SimulatorGenerator(Generator[SimulatorConfig]):
    """Support, multi contact: the surface of the robot that meets an object as believed.

    A physics world of its own holds the robot and the objects, and says which links are near which
    object; there, points of the surface are compared with the object's signed distance. An
    `ObjectPose` moves an object of the world.
    """

    Config = SimulatorConfig
    readings = (JointState, ObjectPose)
    outputs = {"": HypothesisKind.SUPPORT}

    def __init__(self, name: str, config: SimulatorConfig) -> None:
        super().__init__(name, config)
        self._models = {key: ObjectModel(one) for key, one in config.objects.items()}
        self._world: BelievedWorld | None = None
        self.reset()

    def __getstate__(self) -> dict[str, Any]:
        """Travel without the world; it is built anew."""
        return {**self.__dict__, "_world": None}

    def prepare(self, robot: RobotModel) -> None:
        """Build the world."""
        self._world = BelievedWorld(robot, self._models)

    def reset(self) -> None:
        """Believe again what is configured."""
        self._told: dict[str, tuple[str, Pose]] = {
            key: (one.pose.parent, one.pose.pose()) for key, one in self.config.objects.items()
        }

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give the surface that meets an object.

        Raises:
            ConfigurationError: there is no robot.
            RobotError: an object of that name is not configured, or no link of a name.
        """
        if isinstance(reading, ObjectPose):
            if reading.name not in self._told:
                hint = name_hint(reading.name, self._told, f"objects of '{self.name}'")
                raise RobotError(f"unknown object '{reading.name}': {hint}")
            turn = Rotation.from_quat(reading.orientation).as_matrix()
            self._told[reading.name] = reading.frame, pose_of(reading.position, turn)
            return ()
        robot = state.posed_robot(self.name)
        if self._world is None:
            self.prepare(robot.model)
        assert self._world is not None
        wanted = set(robot.model.known_links(self.config.links))
        places, spreads = [np.empty((0, 3))], [np.empty(0)]
        for name, (frame, pose) in self._told.items():
            there = state.frames.pose(state.grid.frame, of=frame) @ pose
            near = self._world.near(robot, name, there, self.config.tolerance) & wanted
            if not near:
                continue
            points = robot.surface_of(sorted(near)).points
            points = points[self._models[name].distances(there, points) <= self.config.tolerance]
            places.append(points)
            spreads.append(self._models[name].spreads(there, points))
        points, own = np.concatenate(places), np.concatenate(spreads)
        kept = state.grid.first_in_voxels(points)
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
    """Give what is left of standard deviations of shape (n,) when so much is covered, both [m]."""
    return np.asarray(np.sqrt(np.maximum(deviations**2 - covered**2, 0.0)))


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[SimulatorConfig]]]:
    """Offer the simulator generator."""
    return {"simulator": SimulatorGenerator}
