"""Windows of trials: what the networks see at each cycle, gathered when it is needed."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.generators.network_card import Scale
from contactfusion_lab.learning.trials import ARRAYS, NONE, TOLD, LabelledTrial

WINDOW = 20
"""Instants that the networks look at together (O §II-D)."""


@dataclass(frozen=True, eq=False)
class Windows:
    """One window for each cycle and mounting of many trials; it ends at the cycle.

    Window w holds the rows `starts[w]` to `starts[w] + WINDOW - 1`. At the begin of a trial the
    first row is repeated.

    Attributes:
        rows: shape (m, S) [m], the proximity lengths of all trials, one trial after the other.
        starts: shape (w,).
        kind: shape (w,), the true kind of contact at the end of the window, as a row of `KINDS`.
        lateral: shape (w,), where it is [m], NaN without.
    """

    rows: FloatArray
    starts: NDArray[np.int64]
    kind: NDArray[np.uint8]
    lateral: FloatArray

    @classmethod
    def of(cls, trials: Iterable[LabelledTrial]) -> Self:
        """Stack trials; there is at least one."""
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
        """Give these windows, shape (b, WINDOW, S) [m]."""
        windows: FloatArray = self.rows[self.starts[which, None] + np.arange(WINDOW)]
        return windows


@dataclass(frozen=True, eq=False)
class Dataset:
    """What networks are trained on.

    Attributes:
        training: the windows that the weights are fitted to.
        validation: those that choose among weights.
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
        """Stack the trials of each split; those of the test split are left out.

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
    """Stack the trials of a split, in which there must be contact."""
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
        digest.update(json.dumps([getattr(trial, name) for name in TOLD]).encode())
        for name in ARRAYS:
            array = getattr(trial, name)
            digest.update(repr(array.shape).encode() + array.tobytes())
    return digest.hexdigest()
