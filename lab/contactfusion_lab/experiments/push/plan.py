"""Which pushes make up the experiment: objects, targets, starts, and what they are felt with."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.controllers.face import FaceConfig
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.robots.description import RobotConfig
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.experiments.push.failing import RandomFault, drawn
from contactfusion_lab.experiments.push.suites import (
    Change,
    Sensing,
    controller_options,
    controller_settings,
    read_sensing,
)
from contactfusion_lab.scenes.push.config import (
    FRICTIONS,
    OTHERS,
    PAPER,
    Distance,
    PushConfig,
    SkinConfig,
    named_object,
    read_object,
)
from contactfusion_lab.scenes.push.noise import MisplacedConfig, named_noise
from contactfusion_lab.scenes.push.objects import ObjectConfig, UrdfObjectConfig, outlines
from contactfusion_lab.scenes.push.scene import mobile_base
from contactfusion_lab.trials.choices import require_known, require_once

STARTS = ("nominal", "random", "far")
OFFSET, YAW = 0.2, 45.0
"""Limits of random starts to either side [m, degrees]."""
FAR_OFFSET, FAR_YAW = 0.28, 90.0
"""Limits of far starts, which lie beyond those, to either side [m, degrees]."""
FIELD, NEAREST = 3.0, 0.5
"""Random targets are drawn within this of the origin along x and y, further than this from the
first contact [m]."""
CLEARANCE = 0.03
"""Nor are they drawn under the robot, or so near behind or beside it; at the start its front stands
at x = 0 [m]."""
FLAT = 1e-6
"""Distance behind the foremost corner within which corners count as foremost [m]."""
TRIALS = 3
"""Counts up when trials change, so that old ones are not taken for new."""
Place = tuple[float, float]
GRID: tuple[Place, ...] = tuple(
    (float(x), float(y)) for x in range(-2, 3) for y in range(-2, 3) if (x, y) != (0, 0)
)
"""24 places a metre apart (O Fig 3) [m]."""
VALIDATION: tuple[Place, ...] = tuple((x, y) for x in (-3.0, 0.0, 3.0) for y in (-3.0, 3.0))
"""The corners and two sides of a larger square; nothing else is at them [m]."""
NEW: tuple[Place, ...] = (
    (2.5, 0.5), (2.5, -1.5), (1.5, 2.5), (1.5, -0.5), (0.5, -2.5), (0.5, 1.5),
    (-0.5, 2.5), (-0.5, -1.5), (-1.5, 0.5), (-1.5, -2.5), (-2.5, 1.5), (-2.5, -0.5),
)  # fmt: skip
"""Twelve that are in neither of these [m]."""
REAL: tuple[Place, ...] = tuple((x, y) for x in (-2.0, 0.0, 2.0) for y in (-2.0, 2.0))
"""Targets of the real robots (O §V), also in the grid [m]."""
REAL_NEAR: tuple[Place, ...] = tuple((x, y) for x in (-1.5, 0.0, 1.5) for y in (-1.5, 1.5))
"""Targets for the L-shape there [m]."""
FAR: tuple[Place, ...] = (
    (3.19, 0.85), (3.18, 3.18), (1.01, 3.77), (-1.01, 3.77), (-3.18, 3.18), (-3.48, 0.93),
    (-3.19, -0.85), (-3.18, -3.18), (-1.01, -3.77), (1.01, -3.77), (3.18, -3.18), (3.48, -0.93),
)  # fmt: skip
"""Twelve beyond all others, 3.3 to 4.5 m away, outside of the square of random targets [m]."""
NAMED = {
    "grid": GRID,
    "validation": VALIDATION,
    "new": NEW,
    "far": FAR,
    "real": REAL,
    "real_near": REAL_NEAR,
}
RANDOM = "random"
PROTOTYPE = "prototype"
"""The noise of a push, unless another is chosen."""


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
        """Name of the push and of its file."""
        return f"{self.object}-{self.friction}-{self.targets}-{self.number:03d}"


@dataclass(frozen=True)
class Targets:
    """A set of targets.

    Attributes:
        name: of the set.
        places: each x and y in `odom` [m]; None: drawn anew for every trial.
        trials: how many trials there are in all, when they are drawn.
    """

    name: str
    places: tuple[Place, ...] | None
    trials: int = 0


@dataclass(frozen=True)
class Plan:
    """All pushes of an experiment by one sensor suite.

    Attributes:
        sensing: the sensor suite.
        objects: those to push, by name.
        frictions: their names.
        targets: where the objects are pushed.
        starts: "nominal", "random" or "far".
        skin: sensitivity of the skin.
        noise: of the sensors, by name.
        faults: failures of sensors.
        misplaced: errors of extrinsic poses of sensors, by name.
        seed: of all random draws.
    """

    sensing: Sensing
    objects: Mapping[str, ObjectConfig]
    frictions: Sequence[str]
    targets: Targets
    starts: str
    skin: SkinConfig
    noise: str
    faults: Sequence[RandomFault]
    misplaced: Mapping[str, MisplacedConfig]
    seed: int

    def pushes(self) -> list[Push]:
        """All pushes; those to random targets are distributed evenly."""
        pairs = [(name, friction) for name in self.objects for friction in self.frictions]
        places, trials = self.targets.places, self.targets.trials
        return [
            self.push(*pair, number)
            for row, pair in enumerate(pairs)
            for number in range(len(places) if places else -(-(trials - row) // len(pairs)))
        ]

    def scene_of(self, push: Push) -> PushConfig:
        """The scene of a push."""
        fields: dict[str, Any] = {
            "object": self.objects[push.object],
            "friction": push.friction,
            "target": push.target,
            "offset": push.offset,
            "yaw": push.yaw,
            "skin": self.skin,
            "noise": self.noise,
            "sees": self.sensing.sees,
            "misplaced": {
                name: how.model_dump()
                for name, how in self.misplaced.items()
                if name in self.sensing.sees
            },
        }
        return PushConfig(**fields)

    def pipeline_of(self, push: Push, controller: str) -> PipelineConfig:
        """The pipeline that steers a push."""
        update = {
            "controller": controller_options(controller, push.target, self.face),
            "faults": drawn(self.faults, push.seed),
            "seed": push.seed,
        }
        return self.pipeline.model_copy(update=update)

    @property
    def pipeline(self) -> PipelineConfig:
        """The pipeline of the sensor suite, without a controller."""
        return self.sensing.pipeline

    @property
    def face(self) -> FaceConfig:
        """The face that pushes."""
        return self.sensing.face

    @property
    def robot(self) -> RobotConfig:
        """The base."""
        return self.sensing.robot

    def settings(self, controllers: Sequence[str]) -> dict[str, Any]:
        """The settings of which trials are a function: with equal ones a folder is resumed."""
        places = self.targets.places
        noise = named_noise(self.noise).model_dump(mode="json")
        # folders of the default are older than noises are
        named = {} if self.noise == PROTOTYPE else {"noise": {self.noise: noise}}
        return {
            "trials": TRIALS,
            "seed": self.seed,
            "starts": self.starts,
            **named,
            "skin": self.skin.model_dump(mode="json"),
            "faults": [fault.fields for fault in self.faults],
            "misplaced": {name: how.model_dump() for name, how in self.misplaced.items()},
            "sensings": {self.sensing.label: self.sensing.settings()},
            "controllers": {name: controller_settings(name, self.face) for name in controllers},
            "objects": {name: _object_settings(config) for name, config in self.objects.items()},
            "targets": {self.targets.name: places or "by chance"},
        }

    def push(self, name: str, friction: str, number: int) -> Push:
        """One push, independent of all others.

        Args:
            name: of the object.
            friction: name of the friction set.
            number: within the set of targets.

        Raises:
            RobotError: the target is drawn, and the object is a URDF that cannot be seen.
        """
        entropy = [self.seed, crc32(name.encode()), crc32(friction.encode()), number]
        sequence = np.random.SeedSequence(entropy)
        rng = np.random.default_rng(sequence)
        offset, yaw = float(rng.uniform(-OFFSET, OFFSET)), float(rng.uniform(-YAW, YAW))
        if self.starts == "nominal":
            offset, yaw = 0.0, 0.0
        if self.starts == "far":
            offset, yaw = _beyond(offset, OFFSET, FAR_OFFSET), _beyond(yaw, YAW, FAR_YAW)
        places = self.targets.places
        target = places[number] if places else _drawn(rng, self.first_contact(name, offset, yaw))
        seed = int(sequence.generate_state(1)[0])
        return Push(name, friction, self.targets.name, number, target, offset, yaw, seed)

    def first_contact(self, name: str, offset: float, yaw: float) -> float:
        """Lateral position of the first contact with an object, to the left of the middle [m].

        Args:
            name: of the object.
            offset: of the object to the left [m].
            yaw: of the object [degrees].

        Raises:
            RobotError: it is a URDF that cannot be seen.
        """
        corners = self._corners[name]
        cos, sin = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
        x, y = cos * corners[:, 0] - sin * corners[:, 1], sin * corners[:, 0] + cos * corners[:, 1]
        foremost = float(y[x < x.min() + FLAT].mean()) + offset
        return float(np.clip(foremost, -self.face.half_width, self.face.half_width))

    @cached_property
    def _corners(self) -> dict[str, FloatArray]:
        """Corners of each object from above, shape (n, 2) [m]: slow to find for a URDF."""
        return {name: np.concatenate(outlines(config)) for name, config in self.objects.items()}


def read_plan(
    sensing: str,
    objects: Sequence[str],
    files: Sequence[Path],
    frictions: Sequence[str],
    targets: Targets,
    starts: str,
    taxels: int,
    skin: SkinConfig,
    faults: Sequence[RandomFault],
    seed: int,
    change: Change | None = None,
    misplaced: Mapping[str, MisplacedConfig] | None = None,
    noise: str = PROTOTYPE,
) -> Plan:
    """Put an experiment together.

    Args:
        sensing: the sensor suite, by name.
        objects: by name; none: those of the paper, unless there are files.
        files: of further objects.
        frictions: by name; none: both.
        targets: where the objects are pushed.
        starts: "nominal", "random" or "far".
        taxels: of the front.
        skin: sensitivity of the skin.
        faults: failures of sensors.
        seed: of all random draws.
        change: differences from the file of the suite.
        misplaced: errors of extrinsic poses of sensors, by name.
        noise: of the sensors, by name.

    Raises:
        ContactFusionError: a name is unknown or stands twice, a file holds no object, the seed is
            less than 0, or what feels is not installed.
    """
    if seed < 0:
        raise ConfigurationError(f"a seed is 0 or more, not {seed}", "seed")
    require_known([starts], STARTS, "starts", "starts")
    frictions = frictions or list(FRICTIONS)
    require_known(frictions, FRICTIONS, "friction", "frictions")
    require_once(frictions, "frictions")
    named_noise(noise)
    return Plan(
        sensing=read_sensing(sensing, taxels, change or Change()),
        objects=_objects_of(objects, files),
        frictions=frictions,
        targets=targets,
        starts=starts,
        skin=skin,
        noise=noise,
        faults=faults,
        misplaced=misplaced or {},
        seed=seed,
    )


def _beyond(drawn: float, within: float, most: float) -> float:
    """A draw from either way of `within`, stretched to lie beyond it, as far as `most`."""
    return math.copysign(within + (most - within) * abs(drawn) / within, drawn)


def _drawn(rng: np.random.Generator, first_contact: float) -> Place:
    """Draw a target that is neither near the first contact nor under the robot."""
    length, width, _ = mobile_base().size
    while True:
        x, y = rng.uniform(-FIELD, FIELD, 2).tolist()
        under = -length - CLEARANCE <= x <= 0.0 and abs(y) <= width / 2.0 + CLEARANCE
        if np.hypot(x, y - first_contact) >= NEAREST and not under:
            return x, y


def _objects_of(names: Sequence[str], files: Sequence[Path]) -> dict[str, ObjectConfig]:
    """Objects by name.

    Args:
        names: of known objects; none: those of the paper, unless there are files.
        files: of further ones.

    Raises:
        ConfigurationError: a name is unknown or stands twice, or a file holds no object.
    """
    known = {**PAPER, **OTHERS}
    names = names or ([] if files else list(PAPER))
    require_known(names, known, "object", "objects")
    require_once(names, "objects")
    objects = {name: named_object(name) for name in names}
    for path in files:
        if path.stem in {*known, *objects}:
            raise ConfigurationError(f"there is an object '{path.stem}' already: rename {path}")
        objects[path.stem] = read_object(path)
    return objects


def _object_settings(config: ObjectConfig) -> Any:
    """The fields of an object; for a file the digest of its content."""
    if not isinstance(config, UrdfObjectConfig):
        return config.model_dump(mode="json")
    content = RobotConfig(urdf=config.urdf, folder=config.folder).path().read_bytes()
    return {"urdf": Path(config.urdf).name, "sha256": hashlib.sha256(content).hexdigest()}


class _TargetFile(Model):
    targets: tuple[tuple[Distance, Distance], ...] = Field(min_length=1)
    """Each x and y [m]."""


def read_targets(text: str) -> Targets:
    """The targets of a named set, of `random:N`, or of a YAML file.

    Raises:
        ConfigurationError: it is none of these, or a target is no pair of finite numbers.
    """
    if text in NAMED:
        return Targets(text, NAMED[text])
    name, colon, count = text.partition(":")
    if name == RANDOM:
        if not colon or not count.isdecimal() or int(count) < 1:
            raise ConfigurationError(f"'{text}': write random:N, with N trials in all")
        return Targets(RANDOM, None, int(count))
    path = Path(text)
    if path.suffix not in (".yaml", ".yml"):
        hint = name_hint(text, [*NAMED, "random:N"], "targets")
        raise ConfigurationError(f"unknown targets '{text}'; {hint}, or a YAML file of `targets`")
    if path.stem in (*NAMED, RANDOM):
        raise ConfigurationError(f"there are targets '{path.stem}' already: rename {path}")
    try:
        return Targets(path.stem, _TargetFile(**read_yaml(path)).targets)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}" if error.path else str(error)) from None
