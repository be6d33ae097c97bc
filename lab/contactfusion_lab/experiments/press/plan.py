"""Which arms are pressed, where chance takes its seeds, and by what they feel it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from contactfusion.errors import ConfigurationError
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.scenes.press.config import PressConfig

ARMS = ("panda", "ur10e", "kuka")
"""Each is a YAML file as for `run`, beside this one."""
ALONE = "joint_torque"
"""The row of the torques alone: they know of no wrist."""
BESIDE: Mapping[str, tuple[str, ...]] = {
    "joint_torque + force_torque": ("torques", "wrist"),
    "joint_torque + force_torque + range": ("torques", "wrist", "left", "right"),
    "every generator": ("torques", "wrist", "left", "right", "ahead"),
}
"""The other rows, by the generators of the files whose clouds are fused."""
TRIALS = 2
"""Counts up when trials change, so that old ones are not taken for new."""
SECONDS = 20.0
"""Length of a free motion [s]."""
SPECIMENS = 5
"""Number of arms of each kind that are pressed in turn; each is identified by itself."""


@dataclass(frozen=True)
class Press:
    """One trial.

    Attributes:
        arm: its name.
        force: of each probe [N]; 0: a free motion.
        number: counted from 0.
        places: number of places that are pressed.
        specimen: number of the arm among those of its kind.
        seed: of all other chance.
    """

    arm: str
    force: float
    number: int
    places: int
    specimen: int
    seed: int

    @property
    def name(self) -> str:
        """Name of the trial and of its file."""
        kind = f"{self.force:g}N" if self.places else "free"
        return f"{self.arm}-{kind}-{self.number:03d}"


@dataclass(frozen=True)
class Plan:
    """An experiment.

    Attributes:
        arms: their names.
        forces: of probes [N].
        touches: number of trials of each arm and force.
        places: number of places that are pressed in each.
        minutes: of free motion of each arm.
        seed: of all chance.
    """

    arms: Sequence[str]
    forces: Sequence[float]
    touches: int
    places: int
    minutes: float
    seed: int

    def presses(self) -> list[Press]:
        """All trials, free motions last; more touches leave the others unchanged."""
        motions = int(np.ceil(round(60.0 * self.minutes / SECONDS, 6)))
        kinds = [(force, self.places, self.touches) for force in self.forces]
        return [
            self._press(arm, force, number, places)
            for force, places, count in (*kinds, (0.0, 0, motions))
            for number in range(count)
            for arm in self.arms
        ]

    def _press(self, arm: str, force: float, number: int, places: int) -> Press:
        entropy = [self.seed, crc32(f"{arm}, {force:g} N, {places}".encode()), number]
        seed = int(np.random.SeedSequence(entropy).generate_state(1)[0])
        specimen = self.seed * SPECIMENS + number % SPECIMENS
        return Press(arm, force, number, places, specimen, seed)

    def settings(self) -> dict[str, Any]:
        """The settings of which trials are a function."""
        return {
            "trials": TRIALS,
            "seed": self.seed,
            "places": self.places,
            "arms": {name: arm(name).settings for name in self.arms},
        }


@dataclass(frozen=True)
class Arm:
    """An arm as its file describes it.

    Attributes:
        pipeline: all generators.
        scene: without force, places and specimen.
    """

    pipeline: PipelineConfig
    scene: PressConfig

    @cached_property
    def settings(self) -> dict[str, Any]:
        """What trials of it are a function of."""
        pipeline = self.pipeline.model_dump(
            mode="json", exclude={"folder": True, "robot": {"folder"}}
        )
        return {"pipeline": pipeline, "scene": self.scene.model_dump(mode="json")}

    def felt(self, generators: Sequence[str]) -> PipelineConfig:
        """The pipeline of some of the generators."""
        known = self.pipeline.generators
        return self.pipeline.model_copy(
            update={"generators": {name: known[name] for name in generators}}
        )


@lru_cache
def arm(name: str) -> Arm:
    """The arm of a name.

    Raises:
        ConfigurationError: its file is not what it should be.
    """
    path = arm_file(name)
    fields = read_yaml(path)
    try:
        scene = PressConfig(**fields.pop("scene"))
        pipeline = PipelineConfig(**{"folder": path.parent, **fields})
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    return Arm(pipeline, scene)


def arm_file(name: str) -> Path:
    """The file of an arm."""
    return Path(__file__).with_name(f"{name}.yaml")
