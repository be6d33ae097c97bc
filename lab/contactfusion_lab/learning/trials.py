"""Labelled trials: what a sensor saw before the face, and how the object truly touched."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray, frozen_array
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.files import read_arrays, write_npz
from contactfusion.generators.networks import KINDS

Split = Literal["training", "validation", "test"]
"""What a trial is for; it is never for two of them."""
NONE = KINDS.index("none")


@dataclass(frozen=True, eq=False)
class LabelledTrial:
    """One trial, seen by one sensor from k mountings; n cycles at the networks' rate.

    Attributes:
        name: of the trial.
        split: what the trial is for.
        round: of the collection, from 0.
        mountings: the names of the sensor's k places.
        stamp: shape (n,) [s].
        descriptors: shape (k, n, S) [m], the proximity lengths.
        kind: shape (n,), the true kind of contact as a row of `KINDS`.
        lateral: shape (n,), where it is, to the left [m]; NaN without contact.

    Raises:
        ConfigurationError: arrays do not fit each other, or hold what no trial can have.
    """

    name: str
    split: Split
    round: int
    mountings: tuple[str, ...]
    stamp: FloatArray
    descriptors: FloatArray
    kind: NDArray[np.uint8]
    lateral: FloatArray

    def __post_init__(self) -> None:
        if self.split not in get_args(Split):
            hint = name_hint(self.split, get_args(Split), "splits")
            raise ConfigurationError(f"unknown split '{self.split}'; {hint}")
        cycles = len(self.stamp)
        self._freeze("stamp", (cycles,))
        self._freeze("descriptors", (len(self.mountings), cycles, None))
        self._freeze("kind", (cycles,), dtype=np.uint8)
        self._freeze("lateral", (cycles,), finite=False)
        if not cycles or not self.mountings:
            raise ConfigurationError("there is no cycle, or no mounting")
        if self.kind.max() >= len(KINDS):
            raise ConfigurationError(f"kind holds {self.kind.max()}, which is no row of {KINDS}")
        if not np.array_equal(np.isfinite(self.lateral), self.kind != NONE):
            raise ConfigurationError("lateral is to be a number in contact, and NaN without")

    def _freeze(self, name: str, shape: tuple[int | None, ...], **how: Any) -> None:
        array = frozen_array(getattr(self, name), shape, name, ConfigurationError, **how)
        object.__setattr__(self, name, array)


TOLD = ("name", "split", "round", "mountings")
ARRAYS = tuple(field.name for field in fields(LabelledTrial) if field.name not in TOLD)


def save(trial: LabelledTrial, path: Path) -> None:
    """Write a trial to an npz file."""
    told = {name: getattr(trial, name) for name in TOLD}
    write_npz(path, told=json.dumps(told), **{name: getattr(trial, name) for name in ARRAYS})


def load(path: Path) -> LabelledTrial:
    """Read a trial.

    Raises:
        ConfigurationError: the file is missing, or is no labelled trial.
    """
    held = read_arrays(path, "told", *ARRAYS)
    try:
        return _told(held)
    except ConfigurationError as error:
        raise ConfigurationError(error.problem, str(path)) from None
    except (KeyError, TypeError, ValueError):
        raise ConfigurationError(f"{path} is no labelled trial") from None


def _told(held: Mapping[str, Any]) -> LabelledTrial:
    told: dict[str, Any] = json.loads(str(held["told"]))
    mountings = tuple(told.pop("mountings"))
    return LabelledTrial(mountings=mountings, **told, **{name: held[name] for name in ARRAYS})
