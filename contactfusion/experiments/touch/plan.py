"""Which touches make up the experiment, and what they are felt with."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from contactfusion.errors import ConfigurationError, RecordingError, name_hint
from contactfusion.fault_config import Fault
from contactfusion.files import require_file
from contactfusion.frame_config import FrameConfig
from contactfusion.model import rooted
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion.simulation.touch_config import TouchConfig
from contactfusion.yaml_files import read_yaml

DEFAULT = Path(__file__).with_name("touch.yaml")
AZIMUTHS = 100.0, 260.0
"""The hand comes from between these [degrees]: behind the object the arm cannot reach."""
ELEVATIONS = 20.0, 45.0, 70.0
"""And from so high [degrees]."""
AROUND = 8.0
"""Either may differ by so much, by chance [degrees]."""
SHORT = 0.02
"""An approach in free air stops so much before the first touch [m]."""


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
        """What to call it, and its file."""
        return f"{self.target}-{self.direction:02d}-{self.repeat}{'-short' if self.short else ''}"


@dataclass(frozen=True)
class Plan:
    """An experiment.

    Attributes:
        pipeline: what feels, without objects in the simulator generators.
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

    def scene_of(self, touch: Touch) -> TouchConfig:
        """Give the scene of one touch."""
        columns = -(-self.directions // len(ELEVATIONS))
        column, row = divmod(touch.direction, len(ELEVATIONS))
        azimuth = float(np.linspace(*AZIMUTHS, columns)[column]) if columns > 1 else 180.0
        around = {
            "azimuth": (azimuth - AROUND, azimuth + AROUND),
            "elevation": (ELEVATIONS[row] - AROUND, ELEVATIONS[row] + AROUND),
        }
        return self.scene.model_copy(
            update={"target": touch.target, "short": SHORT * touch.short, **around}
        )

    def pipeline_of(self, target: str) -> PipelineConfig:
        """Give the pipeline whose simulators believe in one object."""
        generators = {
            name: {**options, "objects": {target: self.scene.objects[target]}}
            if options["type"] == "simulator"
            else options
            for name, options in self.pipeline.generators.items()
        }
        return self.pipeline.model_copy(update={"generators": generators})

    def settings(self) -> dict[str, Any]:
        """Tell what makes two trials of one name equal, for a folder that is gone on with."""
        told = {
            "directions": self.directions,
            "seed": self.seed,
            "faults": [fault.model_dump(mode="json") for fault in self.pipeline.faults],
            "noise": self.scene.noise.model_dump(mode="json"),
            "generators": self.pipeline.generators,
            "scene": self.scene.model_dump(mode="json", exclude={"objects", "noise"}),
        }
        settings: dict[str, Any] = json.loads(json.dumps(told, default=str))
        return settings

    def _seed(self, target: str, direction: int, repeat: int) -> int:
        entropy = [self.seed, crc32(target.encode()), direction, repeat]
        return int(np.random.SeedSequence(entropy).generate_state(1)[0])


def read_plan(
    path: Path,
    objects: Sequence[str],
    directions: int,
    noise: str,
    faults: Sequence[Fault],
    seed: int,
) -> tuple[Plan, tuple[str, ...]]:
    """Put an experiment together.

    Args:
        path: a YAML file as for `run`, with a `scene` of type `touch`.
        objects: names of objects of the scene, or files of others.
        directions: how many directions to come from.
        noise: of the sensors, by name.
        faults: how sensors fail.
        seed: of all chance.

    Returns:
        The plan, and the names of the objects.

    Raises:
        ConfigurationError: the file, an object or the noise is not what it should be.
        RecordingError: the file of an object is not there.
    """
    path = path.resolve()
    fields = read_yaml(path)
    described = fields.pop("scene", {})
    try:
        scene = rooted(TouchConfig(**{**described, "noise": noise}), path.parent)
    except ConfigurationError as error:
        raise error.under("scene") from None
    targets = []
    known: dict[str, ObjectConfig] = dict(scene.objects)
    for name in objects:
        if name not in known and Path(name).suffix:
            known[Path(name).stem] = _from_file(Path(name), scene)
        elif name not in known:
            hint = name_hint(name, known, "objects")
            raise ConfigurationError(f"unknown object '{name}'; {hint}, or the name of a file")
        targets.append(Path(name).stem if name not in scene.objects else name)
    pipeline = PipelineConfig(**{"folder": path.parent, **fields, "faults": tuple(faults)})
    scene = scene.model_copy(update={"objects": known})
    return Plan(pipeline, scene, directions, seed), tuple(targets or scene.objects)


def _from_file(path: Path, scene: TouchConfig) -> ObjectConfig:
    """Stand an object of a mesh or a URDF where the first object of the scene stands."""
    require_file(path, RecordingError)
    pose = next(iter(scene.objects.values())).pose
    how: Mapping[str, Any] = (
        {"urdf": str(path.resolve())} if path.suffix == ".urdf" else {"mesh": path.resolve()}
    )
    config = ObjectConfig(**how, pose=FrameConfig(parent=pose.parent))
    low = min(float(vertices[:, 2].min()) for vertices, _ in ObjectModel(config).solid.meshes)
    top = _top_of(scene)
    standing = FrameConfig(parent=pose.parent, xyz=(pose.xyz[0], pose.xyz[1], top - low))
    return config.model_copy(update={"pose": standing})


def _top_of(scene: TouchConfig) -> float:
    """Give how high the first object of the scene stands [m]."""
    first = next(iter(scene.objects.values()))
    low = min(float(vertices[:, 2].min()) for vertices, _ in ObjectModel(first).solid.meshes)
    return first.pose.xyz[2] + low
