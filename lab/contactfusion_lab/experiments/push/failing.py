"""Failure modes of sensors in a push: faults at random times, and misplaced sensors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from pydantic import Field

from contactfusion.errors import ConfigurationError
from contactfusion.faults import Fault, FaultFile
from contactfusion.model import Model
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.scenes.push.noise import MisplacedConfig

TIMES = ("start", "end")
"""Fields of a fault that may be a range."""


@dataclass(frozen=True)
class RandomFault:
    """A fault whose times may be drawn for each push.

    Attributes:
        fields: of the fault; `start` and `end` are stamps, or pairs of the first and the last that
            may be drawn [s].
    """

    fields: Mapping[str, Any]

    def at(self, rng: np.random.Generator) -> Fault:
        """Draw its times."""
        times = {name: float(rng.uniform(*self.fields[name])) for name in self.ranges}
        (fault,) = _faults({**self.fields, **times})
        return fault

    @property
    def ranges(self) -> list[str]:
        """Which times are drawn."""
        return [name for name in TIMES if isinstance(self.fields.get(name), list)]


def drawn(faults: Sequence[RandomFault], seed: int) -> tuple[Fault, ...]:
    """Draw the faults of one push; each has chance of its own.

    Args:
        faults: of all pushes.
        seed: of the push.
    """
    return tuple(
        fault.at(np.random.default_rng([seed, crc32(b"faults"), number]))
        for number, fault in enumerate(faults)
    )


class _FailingFile(Model):
    faults: tuple[Any, ...] = ()
    """Faults in the order in which they act."""
    misplaced: dict[str, MisplacedConfig] = Field(default_factory=dict)
    """Error of the extrinsic pose, by the name of a sensor."""


def read_failing(path: Path) -> tuple[tuple[RandomFault, ...], dict[str, MisplacedConfig]]:
    """Read faults, and which sensors are misplaced.

    Raises:
        ConfigurationError: the file is missing, or holds something else; one sentence.
    """
    fields = read_yaml(path)
    try:
        held = _FailingFile(**fields)
        if not held.faults and not held.misplaced:
            raise ConfigurationError("it holds neither faults nor anything misplaced")
        for number, described in enumerate(held.faults):
            _require_ranges(described, f"faults.{number}")
        # a fault makes sense at all times if it does where it lasts shortest
        _faults(*map(_shortest, held.faults))
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    return tuple(map(RandomFault, held.faults)), held.misplaced


def _faults(*described: Any) -> tuple[Fault, ...]:
    fields: dict[str, Any] = {"faults": described}
    return FaultFile(**fields).faults


def _require_ranges(described: Any, path: str) -> None:
    for name in TIMES:
        value = described.get(name) if isinstance(described, Mapping) else None
        if isinstance(value, list) and not _is_range(value):
            raise ConfigurationError(
                f"write a stamp, or a range [from, to] of stamps, not {value}", f"{path}.{name}"
            )


def _is_range(value: Sequence[Any]) -> bool:
    numbers = [
        number for number in value if isinstance(number, int | float) and math.isfinite(number)
    ]
    return len(value) == len(numbers) == 2 and numbers[0] <= numbers[1]


def _shortest(described: Any) -> Any:
    if not isinstance(described, Mapping):
        return described
    ends = {"start": -1, "end": 0}
    return {
        name: value[ends[name]] if name in ends and isinstance(value, list) else value
        for name, value in described.items()
    }
