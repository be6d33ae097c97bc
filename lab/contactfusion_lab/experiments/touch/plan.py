"""Which touches make up the experiment, and what they are felt with."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RecordingError, name_hint
from contactfusion.faults import Delay, Dropout, Fault, Silent
from contactfusion.files import require_file
from contactfusion.frames import FrameConfig, points_in
from contactfusion.model import rooted
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.preset import preset_named
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.scenes.touch.config import TouchConfig

DEFAULT = Path(__file__).with_name("touch.yaml")
ELEVATIONS = 3
"""Directions come from so many heights."""
AROUND = 8.0
"""Azimuth and elevation may differ by so much, by chance [degrees]."""
REST: Any = dict.fromkeys(("folder", "faults", "integrator", "preset"), True) | {
    "robot": {"folder": True}
}
"""Fields of a pipeline that do not change a trial, or are settings of their own."""
TRIALS = 2
"""Counts up when trials change, so that old ones are not taken for new."""
BELIEVING = ("simulator", "first_touch")
"""The types of generator that believe in objects."""
SHORT = 0.02
"""An approach in free air stops so much before the first touch [m]."""
SECONDS = 10.0
"""Duration of a motion in free air [s]."""


@dataclass(frozen=True)
class Touch:
    """One touch of the experiment.

    Attributes:
        target: the name of the object.
        direction: counted from 0.
        repeat: counted from 0.
        short: whether it is the same approach, stopped before the touch.
        seed: of all that is left to chance; shared with its twin in free air.
    """

    target: str
    direction: int
    repeat: int
    short: bool
    seed: int

    @property
    def name(self) -> str:
        """Name of the touch and of its file."""
        return f"{self.target}-{self.direction:02d}-{self.repeat}{'-short' if self.short else ''}"


@dataclass(frozen=True)
class Free:
    """One motion of arm and hand in free air.

    Attributes:
        target: the name of the object that stands there.
        number: counted from 0.
        seed: of all that is left to chance.
    """

    target: str
    number: int
    seed: int

    @property
    def name(self) -> str:
        """Name of the motion and of its file."""
        return f"free-{self.target}-{self.number:03d}"


@dataclass(frozen=True)
class Plan:
    """An experiment.

    Attributes:
        pipeline: what feels; what believes in objects does so in each target alone, see
            `pipeline_of`.
        scene: what is touched, without target and direction.
        directions: how many directions there are.
        seed: of all chance.
    """

    pipeline: PipelineConfig
    scene: TouchConfig
    directions: int
    seed: int

    def touches(self, targets: Sequence[str], repeats: int) -> list[Touch]:
        """List all touches, each with its twin in free air."""
        return [
            Touch(target, direction, repeat, short, self._seed(target, direction, repeat))
            for repeat in range(repeats)
            for target in targets
            for direction in range(self.directions)
            for short in (False, True)
        ]

    def motions(self, targets: Sequence[str], minutes: float) -> list[Free]:
        """List motions in free air that last so many minutes together, or a little longer."""
        return [
            Free(target, number, self._seed("free air", number, 0))
            for number, target in zip(
                range(math.ceil(round(60.0 * minutes / SECONDS, 6))), itertools.cycle(targets)
            )
        ]

    def scene_of(self, touch: Touch) -> TouchConfig:
        """The scene of one touch."""
        columns = -(-self.directions // ELEVATIONS)
        column, row = divmod(touch.direction, ELEVATIONS)
        azimuth = float(_spread(self.scene.azimuth, columns)[column])
        elevation = float(_spread(self.scene.elevation, ELEVATIONS)[row])
        around = {
            "azimuth": (azimuth - AROUND, azimuth + AROUND),
            "elevation": (elevation - AROUND, elevation + AROUND),
        }
        return self.scene.model_copy(
            update={"target": touch.target, "short": SHORT * touch.short, **around}
        )

    def pipeline_of(self, target: str) -> PipelineConfig:
        """The pipeline in which one object is believed in."""
        generators = {
            name: {**options, "objects": {target: self.scene.objects[target]}}
            if options["type"] in BELIEVING
            else options
            for name, options in self.pipeline.generators.items()
        }
        return self.pipeline.model_copy(update={"generators": generators})

    def settings(self, targets: Sequence[str]) -> dict[str, Any]:
        """The settings of which trials are a function: with equal ones a folder is resumed."""
        return {
            "trials": TRIALS,
            "directions": self.directions,
            "seed": self.seed,
            "space": [self.pipeline.integrator.frame, self.pipeline.integrator.voxel_size],
            "pipeline": self.pipeline.model_dump(mode="json", exclude=REST),
            "faults": [fault.model_dump(mode="json") for fault in self.pipeline.faults],
            "noise": self.scene.noise.model_dump(mode="json"),
            "scene": self.scene.model_dump(mode="json", exclude={"objects", "noise", "target"}),
            "objects": {name: self.scene.objects[name].model_dump(mode="json") for name in targets},
        }

    def _seed(self, target: str, direction: int, repeat: int) -> int:
        entropy = [self.seed, crc32(target.encode()), direction, repeat]
        return int(np.random.SeedSequence(entropy).generate_state(1)[0])


def read_plan(
    path: Path,
    objects: Sequence[str],
    directions: int,
    noise: str | None,
    faults: Sequence[Fault],
    seed: int,
    preset: str = "",
    places: int | None = None,
) -> tuple[Plan, tuple[str, ...]]:
    """Put an experiment together.

    Args:
        path: a YAML file as for `run`, with a `scene` of type `touch`; directions are spread over
            the azimuths and elevations of the scene.
        objects: names of objects of the scene, or files of others; none: those of the scene.
        directions: how many directions to come from.
        noise: of the sensors, by name; None: the scene's.
        faults: how sensors fail, besides those of the file.
        seed: of all chance.
        preset: the preset that replaces options of the file; empty: none.
        places: number of places at which the hand is touched at once; None: as in the scene.

    Returns:
        The plan, and the names of the objects.

    Raises:
        ConfigurationError: the file, an object, a fault or the noise is not what it should be.
        RecordingError: the file of an object is not there.
    """
    path = path.resolve()
    fields = read_yaml(path)
    try:
        given = {name: value for name, value in (("noise", noise), ("places", places)) if value}
        scene = _scene(fields.pop("scene", None), path.parent, given)
        if preset:
            fields = _replaced(fields, preset)
        pipeline = PipelineConfig(**{"folder": path.parent, **fields})
        pipeline = pipeline.model_copy(update={"faults": (*pipeline.faults, *faults)})
        _check_pipeline(pipeline)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    known = dict(scene.objects)
    targets = [_named(name, known, scene) for name in objects] or list(scene.objects)
    twice = next((name for name in targets if targets.count(name) > 1), None)
    if twice is not None:
        raise ConfigurationError(f"'{twice}' stands twice among the objects")
    scene = scene.model_copy(update={"objects": known})
    return Plan(pipeline, scene, directions, seed), tuple(targets)


def _scene(described: Any, folder: Path, given: Mapping[str, Any]) -> TouchConfig:
    if not isinstance(described, dict):
        raise ConfigurationError("give a scene of type touch", "scene")
    try:
        return rooted(TouchConfig(**{**described, **given}), folder)
    except ConfigurationError as error:
        raise error.under("scene") from None


def _replaced(fields: Mapping[str, Any], preset: str) -> dict[str, Any]:
    """The fields of a pipeline under a preset; of generators that it makes equal, the first."""
    replaced = preset_named(preset).over({**fields, "preset": preset})
    kept: dict[str, Any] = {}
    for name, options in replaced["generators"].items():
        if options not in kept.values():
            kept[name] = options
    return {**replaced, "generators": kept}


def _check_pipeline(config: PipelineConfig) -> None:
    """Make sure that touches can be felt, and honestly.

    Raises:
        ConfigurationError: there is no robot, a generator runs apart, or a fault would let a
            simulator believe the truth.
    """
    if config.robot is None:
        raise ConfigurationError("a scene needs a robot by URDF", "robot")
    for name, options in config.generators.items():
        if options.get("isolate"):
            problem = "what runs in a process of its own may be late: results would differ"
            raise ConfigurationError(problem, f"generators.{name}.isolate")
    for number, fault in enumerate(config.faults):
        if fault.sensor in (None, "object_pose") and isinstance(fault, Silent | Dropout | Delay):
            problem = "without the believed poses of objects the simulator would know the true ones"
            raise ConfigurationError(problem, f"faults.{number}.sensor")


def _named(name: str, known: dict[str, ObjectConfig], scene: TouchConfig) -> str:
    """The name of an object; one from a file is added to those known."""
    if name in scene.objects:
        return name
    path = Path(name)
    if not path.suffix:
        hint = name_hint(name, known, "objects")
        raise ConfigurationError(f"unknown object '{name}'; {hint}, or the name of a file")
    if path.stem in known:
        raise ConfigurationError(f"there is an object '{path.stem}' already: rename {name}")
    known[path.stem] = _from_file(path, scene)
    return path.stem


def _from_file(path: Path, scene: TouchConfig) -> ObjectConfig:
    """Stand an object of a mesh or a URDF where the first object of the scene stands."""
    require_file(path, RecordingError)
    first = next(iter(scene.objects.values()))
    how: Mapping[str, Any] = (
        {"urdf": str(path.resolve())} if path.suffix == ".urdf" else {"mesh": path.resolve()}
    )
    config = ObjectConfig(**how, pose=FrameConfig(parent=first.pose.parent))
    x, y, _ = first.pose.xyz
    place = (x, y, _lowest(first) - _lowest(config))
    return config.model_copy(update={"pose": FrameConfig(parent=first.pose.parent, xyz=place)})


def _lowest(config: ObjectConfig) -> float:
    """Height of an object's lowest point [m]."""
    pose = config.pose.pose()
    meshes = ObjectModel(config).solid.meshes
    return min(float(points_in(pose, vertices)[:, 2].min()) for vertices, _ in meshes)


def _spread(ends: tuple[float, float], count: int) -> FloatArray:
    """Spread values over a range; a single one stands in its middle, shape (count,)."""
    return np.linspace(*ends, count) if count > 1 else np.array([sum(ends) / 2.0])
