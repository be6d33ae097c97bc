"""Score of a run against labels: missed and false contacts, and position errors."""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from contactfusion.errors import ConfigurationError
from contactfusion.explain.ablation import Quantiles
from contactfusion.files import require_file
from contactfusion.pipeline import Step

COLUMNS = ("start", "end", "x", "y", "z")
ALIKE = 0.5
"""Steps within this time are correlated, and count as one sample of an interval [s]."""
Z = 1.959964
"""Quantile of a 95 % interval."""
ERROR_STEP, ERROR_MOST = 5e-4, 2.0


@dataclass(frozen=True, slots=True)
class Label:
    """An interval with a contact.

    Attributes:
        start: of the contact, on the recording's clock [s].
        end: of the contact, excluded [s].
        place: of the contact, in the frame of the space [m]; None: unknown.
    """

    start: float
    end: float
    place: tuple[float, float, float] | None


FURTHEST = 1000.0
"""The greatest coordinate of a place [m]."""


def read_labels(path: Path) -> list[Label]:
    """The labels in a CSV file with the columns start, end, x, y, z.

    Raises:
        ConfigurationError: the file is missing, a value is no finite number, a label ends before it
            starts, begins before the one above has ended, or has half a place; or there are fewer
            than two. The sentence names the line.
    """
    require_file(path, ConfigurationError)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = csv.DictReader(file, skipinitialspace=True)
            if table.fieldnames is None or set(table.fieldnames) != set(COLUMNS):
                raise ConfigurationError(f"{path}: the first line must be {','.join(COLUMNS)}")
            rows = [(table.line_num, row) for row in table]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"{path} is no CSV text: {error}") from None
    labels = [_label(row, f"{path}, line {line}") for line, row in rows]
    for label, after, (line, _) in zip(labels, labels[1:], rows[1:], strict=False):
        if after.start < label.end:
            raise ConfigurationError(
                f"{path}, line {line}: a label that begins at {after.start:g} s follows one that "
                f"ends at {label.end:g} s; write them in order, without overlap"
            )
    if len(labels) < 2:
        raise ConfigurationError(
            f"{path} holds {len(labels)} of at least two contacts: settings are chosen on the "
            "first half of them and reported on the second"
        )
    return labels


def require_within(labels: Sequence[Label], first: float, last: float, path: Path) -> None:
    """Refuse labels outside the recording, from first to last step [s].

    Raises:
        ConfigurationError: a label lies outside.
    """
    for label in labels:
        if label.start > last or label.end < first:
            raise ConfigurationError(
                f"{path}: the contact from {label.start:g} s to {label.end:g} s lies outside the "
                f"recording, whose steps reach from {first:g} s to {last:g} s"
            )


def halving(labels: Sequence[Label]) -> float:
    """The time that splits the labels into two halves [s]: the middle of the gap between."""
    half = len(labels) // 2
    return (labels[half - 1].end + labels[half].start) / 2.0


def _label(row: Mapping[str | None, str | None], where: str) -> Label:
    numbers = {name: _number(row[name], name, where) for name in COLUMNS}
    if None in row:
        raise ConfigurationError(f"{where}: there are more values than columns")
    start, end = numbers["start"], numbers["end"]
    if start is None or end is None:
        raise ConfigurationError(f"{where}: a label needs its start and its end")
    if not start < end:
        raise ConfigurationError(f"{where}: the label ends at {end:g} s, but starts at {start:g} s")
    x, y, z = numbers["x"], numbers["y"], numbers["z"]
    if x is None and y is None and z is None:
        return Label(start, end, None)
    if x is None or y is None or z is None:
        raise ConfigurationError(f"{where}: give x, y and z, or none of them")
    if max(abs(x), abs(y), abs(z)) > FURTHEST:
        raise ConfigurationError(f"{where}: the place is beyond {FURTHEST:g} m")
    return Label(start, end, (x, y, z))


def _number(text: str | None, name: str, where: str) -> float | None:
    if text is None or not text.strip():
        return None
    try:
        value = float(text)
    except ValueError:
        raise ConfigurationError(f"{where}: {name} is '{text}', not a number") from None
    if not math.isfinite(value):
        raise ConfigurationError(f"{where}: {name} is {text.strip()}, not a finite number")
    return value


@dataclass
class Rate:
    """Frequency of an error.

    Attributes:
        steps: in which it was possible.
        wrong: in which it occurred.
        stretches: how many stretches of `ALIKE` seconds these steps lie in.
    """

    steps: int = 0
    wrong: int = 0
    stretches: int = 0
    _stretch: int | None = field(default=None, repr=False)

    def add(self, stamp: float, wrong: bool) -> None:
        """Count a step at a stamp [s]; steps come in order."""
        self.steps += 1
        self.wrong += wrong
        stretch = math.floor(stamp / ALIKE)
        self.stretches += stretch != self._stretch
        self._stretch = stretch

    @property
    def share(self) -> float:
        """The share of the steps with the error; NaN without any step."""
        return self.wrong / self.steps if self.steps else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """The Wilson interval of the share, for as many samples as there are stretches."""
        return wilson(self.share, min(self.stretches, self.steps))


@dataclass
class Half:
    """The score of one half of a recording.

    Attributes:
        missed: steps with a labelled contact, without a detected one within reach.
        false: steps without a labelled contact, with a detected one.
        errors: distances from labelled positions to the nearest contact, however far [m].
    """

    missed: Rate = field(default_factory=Rate)
    false: Rate = field(default_factory=Rate)
    errors: Quantiles = field(default_factory=lambda: Quantiles(ERROR_STEP, ERROR_MOST))

    @property
    def cost(self) -> float:
        """The share missed plus the share false; a share without steps counts as 0."""
        return float(np.nansum([self.missed.share, self.false.share]))

    @property
    def error(self) -> float:
        """The median distance from a labelled position to the nearest contact [m]; NaN: none."""
        return self.errors.at(0.5)

    def add(self, step: Step, label: Label | None, within: float) -> None:
        """Count a step; a contact within `within` [m] of a labelled position is right."""
        contacts = step.fusion.contacts
        if label is None:
            self.false.add(step.stamp, bool(contacts))
        elif label.place is None:
            self.missed.add(step.stamp, not contacts)
        else:
            away = [math.dist(contact.position, label.place) for contact in contacts]
            self.missed.add(step.stamp, not away or min(away) > within)
            if away:
                self.errors.add(min(away))

    def as_dict(self) -> dict[str, Any]:
        """The counts, as JSON holds them."""
        rows = np.flatnonzero(self.errors.counts)
        rates = {"missed": self.missed, "false": self.false}
        return {
            **{name: [rate.steps, rate.wrong, rate.stretches] for name, rate in rates.items()},
            "errors": [[int(row), int(self.errors.counts[row])] for row in rows],
        }

    @classmethod
    def from_dict(cls, held: dict[str, Any]) -> Self:
        """The score of a half from JSON.

        Raises:
            ValueError, TypeError, KeyError, IndexError: it holds something else.
        """
        missed, false = (Rate(*map(int, held[name])) for name in ("missed", "false"))
        half = cls(missed, false)
        for row, count in held["errors"]:
            half.errors.counts[row] = count
        return half


@dataclass
class Score:
    """The score of a run.

    Attributes:
        first: the time of the first step [s].
        last: that of the last [s].
        halves: the one to choose on, and the one to report on.
    """

    first: float
    last: float
    halves: tuple[Half, Half]


def scored(steps: Iterable[Step], labels: Sequence[Label], split: float, within: float) -> Score:
    """The score of steps against labels.

    Args:
        steps: in order; each is used once.
        labels: in order, without overlap.
        split: the time that splits the halves [s].
        within: a contact is right within this distance of a labelled position [m].
    """
    halves, first, last, at = (Half(), Half()), math.nan, math.nan, 0
    for step in steps:
        first = step.stamp if math.isnan(first) else first
        last = step.stamp
        while at < len(labels) and labels[at].end <= step.stamp:
            at += 1
        label = labels[at] if at < len(labels) and labels[at].start <= step.stamp else None
        halves[step.stamp >= split].add(step, label, within)
    return Score(first, last, halves)


def wilson(share: float, samples: int) -> tuple[float, float]:
    """The 95 % Wilson interval of a share of samples; NaN without any."""
    if not samples or math.isnan(share):
        return math.nan, math.nan
    square = Z * Z / samples
    middle = (share + square / 2.0) / (1.0 + square)
    half = math.sqrt(share * (1.0 - share) * square + square * square / 4.0) / (1.0 + square)
    return max(middle - half, 0.0), min(middle + half, 1.0)
