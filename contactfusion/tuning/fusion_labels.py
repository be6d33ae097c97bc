"""When and where there truly is a contact, as somebody wrote it down."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from contactfusion.errors import ConfigurationError
from contactfusion.files import require_file

COLUMNS = ("start", "end", "x", "y", "z")


@dataclass(frozen=True, slots=True)
class Label:
    """A time with a contact.

    Attributes:
        start: from then on, counted as the recording counts [s].
        end: until then, itself excluded [s].
        place: where, in the frame of the space [m]; None: somewhere.
    """

    start: float
    end: float
    place: tuple[float, float, float] | None


def read_labels(path: Path) -> list[Label]:
    """Read labels from a CSV file with the columns start, end, x, y, z.

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
    for one, after, (line, _) in zip(labels, labels[1:], rows[1:], strict=False):
        if after.start < one.end:
            raise ConfigurationError(
                f"{path}, line {line}: a label that begins at {after.start:g} s follows one that "
                f"ends at {one.end:g} s; write them in order, without overlap"
            )
    if len(labels) < 2:
        raise ConfigurationError(
            f"{path} holds {len(labels)} of at least two contacts: settings are chosen on the "
            "first half of them and reported on the second"
        )
    return labels


def require_within(labels: Sequence[Label], first: float, last: float, path: Path) -> None:
    """Make sure that all labels lie in the time of the recording, from first to last step [s].

    Raises:
        ConfigurationError: one does not.
    """
    for one in labels:
        if one.start > last or one.end < first:
            raise ConfigurationError(
                f"{path}: the contact from {one.start:g} s to {one.end:g} s lies outside the "
                f"recording, whose steps reach from {first:g} s to {last:g} s"
            )


def halving(labels: Sequence[Label]) -> float:
    """Give the time that parts the labels into two halves [s]: the middle of the gap between."""
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
