"""Which pushes make up the experiment, and what they are felt and steered with."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.controllers.face import FaceConfig
from contactfusion.errors import ConfigurationError
from contactfusion.experiments.push.steering import controller_options, controller_settings
from contactfusion.experiments.push.targets import Place, Targets
from contactfusion.experiments.push.things import (
    object_settings,
    objects_of,
    require_known,
    require_once,
)
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.robots.description import RobotConfig
from contactfusion.simulation.push_config import PushConfig, SkinConfig
from contactfusion.simulation.push_objects import FRICTIONS, ObjectConfig, outlines
from contactfusion.simulation.push_skin import with_taxels
from contactfusion.yaml_files import read_yaml

SENSINGS = {"skin": Path(__file__).with_name("skin.yaml")}
"""What the object is felt with: the pipeline of each."""
STARTS = ("nominal", "random")
OFFSET, YAW = 0.2, 45.0
"""Random starts are drawn within these, either way [m, degrees]."""
FIELD, NEAREST = 3.0, 0.5
"""Random targets are drawn within this of the origin along x and y, further than this from the
first contact [m]."""
CHASSIS = (0.72, 0.60)
"""The robot's length and width; at the start its front stands at x = 0 [m]."""
CLEARANCE = 0.03
"""Nor are they drawn under the robot, or so near behind or beside it [m]."""
FLAT = 1e-6
"""Corners so far behind the foremost are as far ahead [m]."""
BLUR = 2.5
"""One point may seem as wide as so many taxels."""
REST: Any = {"folder": True, "faults": True, "robot": {"folder"}, "controller": True, "seed": True}
"""Of a pipeline, what does not change a trial, or is told apart."""
TRIALS = 2
"""Counts up when trials change, so that old ones are not taken for new."""


@dataclass(frozen=True)
class Push:
    """One push of the experiment; every controller makes it.

    Attributes:
        object: the name of the object.
        friction: the name of the friction.
        targets: the name of the set of targets.
        number: within the set, from 0.
        target: x and y in `odom` [m].
        offset: of the object to the left [m].
        yaw: of the object [degrees].
        seed: of all that is left to chance.
    """

    object: str
    friction: str
    targets: str
    number: int
    target: Place
    offset: float
    yaw: float
    seed: int

    @property
    def name(self) -> str:
        """What to call it, and its file."""
        return f"{self.object}-{self.friction}-{self.targets}-{self.number:03d}"


@dataclass(frozen=True)
class Plan:
    """An experiment.

    Attributes:
        sensing: the name of what feels.
        pipeline: what feels, without a controller.
        objects: what is pushed, by name.
        frictions: their names.
        targets: where to.
        starts: "nominal" or "random".
        skin: how well the skin feels.
        face: what pushes.
        seed: of all chance.
    """

    sensing: str
    pipeline: PipelineConfig
    objects: Mapping[str, ObjectConfig]
    frictions: Sequence[str]
    targets: Targets
    starts: str
    skin: SkinConfig
    face: FaceConfig
    seed: int

    def pushes(self) -> list[Push]:
        """List all pushes; those to random targets are dealt evenly."""
        pairs = [(thing, friction) for thing in self.objects for friction in self.frictions]
        places, trials = self.targets.places, self.targets.trials
        return [
            self.push(*pair, number)
            for row, pair in enumerate(pairs)
            for number in range(len(places) if places else -(-(trials - row) // len(pairs)))
        ]

    def scene_of(self, push: Push) -> PushConfig:
        """Give the scene of a push."""
        fields: dict[str, Any] = {
            "object": self.objects[push.object],
            "friction": push.friction,
            "target": push.target,
            "offset": push.offset,
            "yaw": push.yaw,
            "skin": self.skin,
        }
        return PushConfig(**fields)

    def pipeline_of(self, push: Push, controller: str) -> PipelineConfig:
        """Give the pipeline that steers a push."""
        options = controller_options(controller, push.target, self.face)
        return self.pipeline.model_copy(update={"controller": options, "seed": push.seed})

    @property
    def robot(self) -> RobotConfig:
        """The base."""
        assert self.pipeline.robot is not None  # read_plan made sure of it
        return self.pipeline.robot

    def settings(self, controllers: Sequence[str]) -> dict[str, Any]:
        """Tell what makes two trials of one name equal, for a folder that is gone on with."""
        places = self.targets.places
        told = {
            "trials": TRIALS,
            "sensing": self.sensing,
            "seed": self.seed,
            "starts": self.starts,
            "skin": self.skin.model_dump(mode="json"),
            "face": self.face.model_dump(mode="json"),
            "pipeline": self.pipeline.model_dump(mode="json", exclude=REST),
            "faults": [fault.model_dump(mode="json") for fault in self.pipeline.faults],
            "controllers": {name: controller_settings(name, self.face) for name in controllers},
            "objects": {name: object_settings(one) for name, one in self.objects.items()},
            "targets": {self.targets.name: places or "by chance"},
        }
        settings: dict[str, Any] = json.loads(json.dumps(told, default=str))
        return settings

    def push(self, thing: str, friction: str, number: int) -> Push:
        """Give one push; of others nothing changes it.

        Args:
            thing: the name of the object.
            friction: its name.
            number: within the set of targets.

        Raises:
            RobotError: the target is drawn, and the object is a URDF that cannot be seen.
        """
        entropy = [self.seed, crc32(thing.encode()), crc32(friction.encode()), number]
        sequence = np.random.SeedSequence(entropy)
        rng = np.random.default_rng(sequence)
        offset, yaw = float(rng.uniform(-OFFSET, OFFSET)), float(rng.uniform(-YAW, YAW))
        if self.starts == "nominal":
            offset, yaw = 0.0, 0.0
        places = self.targets.places
        target = places[number] if places else _drawn(rng, self.first_contact(thing, offset, yaw))
        seed = int(sequence.generate_state(1)[0])
        return Push(thing, friction, self.targets.name, number, target, offset, yaw, seed)

    def first_contact(self, thing: str, offset: float, yaw: float) -> float:
        """Give how far to the left of the robot's middle an object is touched first [m].

        Args:
            thing: the name of the object.
            offset: of the object to the left [m].
            yaw: of the object [degrees].

        Raises:
            RobotError: it is a URDF that cannot be seen.
        """
        corners = self._corners[thing]
        cos, sin = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
        x, y = cos * corners[:, 0] - sin * corners[:, 1], sin * corners[:, 0] + cos * corners[:, 1]
        foremost = float(y[x < x.min() + FLAT].mean()) + offset
        return float(np.clip(foremost, -self.face.half_width, self.face.half_width))

    @cached_property
    def _corners(self) -> dict[str, FloatArray]:
        """Of each object seen from above, shape (n, 2) [m]: slow to find for a URDF."""
        return {name: np.concatenate(outlines(one)) for name, one in self.objects.items()}


def read_plan(
    sensing: str,
    objects: Sequence[str],
    files: Sequence[Path],
    frictions: Sequence[str],
    targets: Targets,
    starts: str,
    taxels: int,
    skin: SkinConfig,
    faults: Sequence[Any],
    seed: int,
) -> Plan:
    """Put an experiment together.

    Args:
        sensing: what feels, by name.
        objects: by name; none: those of the paper, unless there are files.
        files: of further objects.
        frictions: by name; none: both.
        targets: where to.
        starts: "nominal" or "random".
        taxels: of the front.
        skin: how well the skin feels.
        faults: how sensors fail.
        seed: of all chance.

    Raises:
        ConfigurationError: a name is unknown or stands twice, a file holds no object, or the seed
            is less than 0.
    """
    if seed < 0:
        raise ConfigurationError(f"a seed is 0 or more, not {seed}", "seed")
    require_known([sensing], SENSINGS, "sensing", "sensings")
    require_known([starts], STARTS, "starts", "starts")
    frictions = frictions or list(FRICTIONS)
    require_known(frictions, FRICTIONS, "friction", "frictions")
    require_once(frictions, "frictions")
    path = SENSINGS[sensing]
    pipeline = PipelineConfig(**{"folder": path.parent, **read_yaml(path)})
    assert pipeline.robot is not None
    patches = pipeline.robot.patches
    divided = with_taxels(patches["skin"], taxels)
    robot = pipeline.robot.model_copy(update={"patches": {**patches, "skin": divided}})
    return Plan(
        sensing=sensing,
        pipeline=pipeline.model_copy(update={"robot": robot, "faults": tuple(faults)}),
        objects=objects_of(objects, files),
        frictions=frictions,
        targets=targets,
        starts=starts,
        skin=skin,
        face=FaceConfig(blur=BLUR * divided.grids[0].pitch[1]),
        seed=seed,
    )


def _drawn(rng: np.random.Generator, first_contact: float) -> Place:
    """Draw a target that is neither near the first contact nor under the robot."""
    while True:
        x, y = rng.uniform(-FIELD, FIELD, 2).tolist()
        length, width = CHASSIS
        under = -length - CLEARANCE <= x <= 0.0 and abs(y) <= width / 2.0 + CLEARANCE
        if np.hypot(x, y - first_contact) >= NEAREST and not under:
            return x, y
