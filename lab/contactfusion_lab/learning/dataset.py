"""Labelled trials, the readings of a sensor with the true contacts, and windows of them."""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray, frozen_array
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.files import read_arrays
from contactfusion.generators.networks import KINDS, Scale
from contactfusion_lab.trials.folder import as_npz

Split = Literal["training", "validation", "test"]
"""Use of a trial; each has one."""
NONE = KINDS.index("none")
NAMED = ("name", "split", "round", "mountings")
WINDOW = 20
"""Instants in one input of the networks (O §II-D)."""


@dataclass(frozen=True, eq=False)
class LabelledTrial:
    """One trial, measured by one sensor from k mountings; n cycles at the networks' rate.

    Attributes:
        name: of the trial.
        split: use of the trial.
        round: DAgger iteration, from 0.
        mountings: the names of the sensor's k poses.
        stamp: shape (n,) [s].
        descriptors: shape (k, n, S) [m], the proximity lengths.
        kind: shape (n,), the true kind of contact as a row of `KINDS`.
        lateral: shape (n,), true lateral position of the contact, to the left [m]; NaN without.

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


ARRAYS = tuple(field.name for field in fields(LabelledTrial) if field.name not in NAMED)


def content_of(trial: LabelledTrial) -> bytes:
    """The npz file of a trial."""
    named = {name: getattr(trial, name) for name in NAMED}
    return as_npz(told=json.dumps(named), **{name: getattr(trial, name) for name in ARRAYS})


def load(path: Path) -> LabelledTrial:
    """A trial, from an npz file.

    Raises:
        ConfigurationError: the file is missing, or is no labelled trial.
    """
    held = read_arrays(path, "told", *ARRAYS)
    try:
        return _trial(held)
    except ConfigurationError as error:
        raise ConfigurationError(error.problem, str(path)) from None
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        raise ConfigurationError(f"{path} is no labelled trial") from None


def _trial(held: Mapping[str, Any]) -> LabelledTrial:
    header: dict[str, Any] = json.loads(str(held["told"]))
    mountings = tuple(header.pop("mountings"))
    return LabelledTrial(mountings=mountings, **header, **{name: held[name] for name in ARRAYS})


@dataclass(frozen=True, eq=False)
class Windows:
    """One window for each cycle and mounting of many trials; it ends at the cycle.

    Window w holds the rows `starts[w]` to `starts[w] + WINDOW - 1`. At the begin of a trial the
    first row is repeated.

    Attributes:
        rows: shape (m, S) [m], the proximity lengths of all trials, one trial after the other.
        starts: shape (w,).
        kind: shape (w,), the true kind of contact at the end of the window, as a row of `KINDS`.
        lateral: shape (w,), true lateral position of the contact [m], NaN without.
    """

    rows: FloatArray
    starts: NDArray[np.int64]
    kind: NDArray[np.uint8]
    lateral: FloatArray

    @classmethod
    def of(cls, trials: Iterable[LabelledTrial]) -> Self:
        """Windows of trials, of which there is at least one."""
        rows, starts, kinds, laterals, count = [], [], [], [], 0
        for trial in trials:
            for descriptors in trial.descriptors:
                rows += [np.repeat(descriptors[:1], WINDOW - 1, axis=0), descriptors]
                starts.append(count + np.arange(len(descriptors)))
                kinds.append(trial.kind)
                laterals.append(trial.lateral)
                count += WINDOW - 1 + len(descriptors)
        return cls(*(np.concatenate(parts) for parts in (rows, starts, kinds, laterals)))

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def touching(self) -> NDArray[np.int64]:
        """The windows that end in contact."""
        return np.flatnonzero(self.kind != NONE)

    def gather(self, which: NDArray[np.int64]) -> FloatArray:
        """Windows by number, shape (b, WINDOW, S) [m]."""
        windows: FloatArray = self.rows[self.starts[which, None] + np.arange(WINDOW)]
        return windows


@dataclass(frozen=True, eq=False)
class Dataset:
    """The dataset on which networks are trained.

    Attributes:
        training: the windows to which weights are fitted.
        validation: the windows by which weights are chosen.
        length: the range of the proximity lengths in training [m].
        lateral: the range of the location in training [m].
        sha256: of all trials.
    """

    training: Windows
    validation: Windows
    length: Scale
    lateral: Scale
    sha256: str

    @classmethod
    def of(cls, trials: Sequence[LabelledTrial]) -> Self:
        """The dataset of trials; those of the test split are left out.

        Raises:
            ConfigurationError: a split has no contact, or trials do not fit each other.
        """
        used = [trial for trial in trials if trial.split != "test"]
        for trial in used:
            columns, first = trial.descriptors.shape[2], used[0].descriptors.shape[2]
            if columns != first:
                raise ConfigurationError(
                    f"trial {trial.name} has {columns} proximity lengths, {used[0].name} {first}"
                )
        training, validation = _touching(used, "training"), _touching(used, "validation")
        return cls(
            training,
            validation,
            _scale(training.rows, "proximity length"),
            _scale(training.lateral[training.touching], "location"),
            _sha256(used),
        )


def _touching(trials: Sequence[LabelledTrial], split: str) -> Windows:
    """Windows of the trials of a split, in which there must be contact."""
    here = [trial for trial in trials if trial.split == split]
    if not any((trial.kind != NONE).any() for trial in here):
        raise ConfigurationError(f"none of the {len(here)} trials for {split} has contact")
    return Windows.of(here)


def _scale(values: FloatArray, what: str) -> Scale:
    least, most = float(values.min()), float(values.max())
    if least == most:
        raise ConfigurationError(f"every {what} of the training trials is {least:g} m")
    return Scale(minimum=least, maximum=most)


def _sha256(trials: Iterable[LabelledTrial]) -> str:
    digest = hashlib.sha256()
    for trial in trials:
        digest.update(json.dumps([getattr(trial, name) for name in NAMED]).encode())
        for name in ARRAYS:
            array = getattr(trial, name)
            digest.update(repr(array.shape).encode() + array.tobytes())
    return digest.hexdigest()
