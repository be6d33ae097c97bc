"""A table of numbers without a description: its columns, and a first description of them."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.inspect.first_lines import text_of
from contactfusion.inspect.joint_columns import JointColumns, joint_columns, range_of
from contactfusion.readings.columns import Column
from contactfusion.readings.joints import NO_FRAME
from contactfusion.recordings.log import FASTEST, NANOSECONDS, SLOW, stated_unit
from contactfusion.recordings.tables import Columns, column_names, read_columns
from contactfusion.terminal import printable
from contactfusion.time import NANOSECONDS_PER_SECOND
from contactfusion.vendors import convention_of

BLANK = "FILL_IN"
"""Placeholder for what the user has to fill in."""
SHOWN = 3
"""Number of first values of a column that are shown."""
USUAL = 0.5
"""The usual upper limit of the step between rows [s]: a step of 1 is then a millisecond."""
AXES = "xyz"
STAMPS = ("t", "time", "stamp", "timestamp", "timestamps")
WRENCH = re.compile(
    r"(?P<before>(?:.*[^a-z])?)(?P<kind>force|torque|moment|tau|f|t|m)[^a-z0-9]?(?P<axis>[xyz])"
    r"(?:[^a-z0-9]+n?(?:[^a-z0-9]?m?m)?[^a-z0-9]*)?"
)
"""A column of a wrench, in lower case: `fx`, `left_Fz`, `wrench.torque.y`, `Mx [Nm]`."""
NUMBERED = re.compile(r"(?P<before>.*?)[^A-Za-z0-9]?(?P<number>\d)\]?")
"""A column of an array: `actual_TCP_force_0`."""


@final
@dataclass(frozen=True)
class ColumnInspection:
    """A column of a table.

    Attributes:
        name: as the header has it, or its number from 1.
        first: its first values; None where there is none.
        least: the least value; None where it holds no number.
        greatest: the greatest value, likewise.
        missing: number of rows without a value.
        use: its probable meaning; empty where its name gives none.
    """

    name: Column
    first: tuple[float | None, ...]
    least: float | None
    greatest: float | None
    missing: int
    use: str = ""


@final
@dataclass(frozen=True)
class Stamps:
    """The column of stamps.

    Attributes:
        column: its name.
        unit: s, ms, us or ns.
        rate: rows a second, by the median of their steps [Hz].
    """

    column: Column
    unit: str
    rate: float


@final
@dataclass(frozen=True)
class TableInspection:
    """A table without a description.

    Attributes:
        path: the file.
        rows: their number.
        columns: in their order.
        stamps: the column of stamps; None where no rising column has such a name.
        wrenches: by the name of a sensor, the columns of its force and torque.
        joints: the columns of an arm's joints; None where there are none.
    """

    path: Path
    rows: int
    columns: tuple[ColumnInspection, ...]
    stamps: Stamps | None
    wrenches: Mapping[str, tuple[Column, ...]]
    joints: JointColumns | None

    @property
    def known(self) -> bool:
        """Whether a description of it has no blank."""
        named = self.joints is None or bool(self.joints.names)
        return self.stamps is not None and bool(self.wrenches or self.joints) and named


def inspect_table(path: Path, robot: Sequence[str] = ()) -> TableInspection:
    """The columns of a table, and the meaning of their names.

    Args:
        path: a file as `type: log` takes it.
        robot: the joints of the robot that it moves, where it is known.

    Raises:
        RecordingError: it holds no table.
    """
    columns = _numbers(path)
    stamps = next(filter(None, (_stamps(name, values) for name, values in columns.items())), None)
    numbers = [name for name, values in columns.items() if values is not None]
    wrenches, joints = _wrenches(path, numbers), joint_columns(numbers, robot)
    uses = dict(joints.uses()) if joints else {}
    if stamps:
        uses[stamps.column] = f"stamps in {stamps.unit}: {stamps.rate:.4g} Hz"
    for sensor, six in wrenches.items():
        for number, name in enumerate(six):
            what, unit = ("force", "N") if number < len(AXES) else ("torque", "N·m")
            uses[name] = f"{what} {AXES[number % len(AXES)]} of '{sensor}' [{unit}]"
    rows = max(len(values) for values in columns.values() if values is not None)
    held = tuple(_inspected(name, values, uses.get(name, "")) for name, values in columns.items())
    return TableInspection(path, rows, held, stamps, wrenches, joints)


def as_json(table: TableInspection) -> str:
    """An inspection as JSON, the names those of its attributes."""
    return json.dumps(asdict(table), indent=1, ensure_ascii=False, allow_nan=False, default=str)


def as_text(table: TableInspection) -> str:
    """An inspection as a table of columns, and a description to copy."""
    path = table.path
    lines = [
        f"{path}: {table.rows} rows of {len(table.columns)} columns",
        *shown(table),
        "",
        f"A description to copy into a YAML file (`contactfusion init {path} --out "
        f"{path.stem}.yaml` writes a whole configuration):",
        "",
        *described(table, path.name),
    ]
    return "\n".join(map(printable, lines))


def shown(table: TableInspection) -> Iterator[str]:
    """The columns as the lines of a table."""
    rows = [
        ("column", "first values", "least", "greatest", "looks like"),
        *map(_row, table.columns),
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        yield "  ".join(cells).rstrip()


def described(table: TableInspection, file: str) -> Iterator[str]:
    """A description of the table as lines of YAML; what its columns leave open is a blank.

    Args:
        table: the table.
        file: its path in the description.
    """
    yield "type: log"
    yield f"file: {text_of(file)}"
    if table.stamps:
        stamps = table.stamps
        column = _column(stamps.column)
        yield f"time: {{column: {column}, unit: {stamps.unit}}}  # {stamps.rate:.4g} Hz"
    else:
        yield f"time: {{rate: {BLANK}}}  # rows a second [Hz]; or {{column: NAME, unit: s}}"
    yield "readings:"
    blank = {} if table.joints else {sensor_of(table.path): (BLANK,)}
    for sensor, columns in (table.wrenches or blank).items():
        yield f"  {text_of(sensor)}:"
        others = (
            "" if table.wrenches else "  # or tactile_image, joint_state, …: docs/recordings.md"
        )
        yield f"    type: wrench{others}"
        yield f"    frame: {text_of(sensor)}  # the axes in which it measures"
        yield f"    columns: [{', '.join(map(_column, columns))}]"
        yield "    # force x, y, z [N], torque x, y, z [N·m]; `scale` brings other units to them"
    if table.joints:
        yield from _described_joints(table.joints)


def _described_joints(joints: JointColumns) -> Iterator[str]:
    """The reading of an arm's joints as lines of YAML."""
    yield f"  {text_of(joints.sensor)}:"
    yield "    type: joint_state"
    yield f"    frame: {NO_FRAME}"
    names = ", ".join(map(text_of, joints.names)) or BLANK
    yield f"    names: [{names}]  # as the URDF calls them, in the order of the columns"
    parts = [
        range_of(columns) or ", ".join(map(_column, columns)) for columns in joints.by_kind.values()
    ]
    yield f"    columns: [{', '.join(parts)}]"
    yield f"    holds: [{', '.join(joints.by_kind)}]"
    yield "    # in rad, rad/s, and N·m or A; `scale: deg` turns degrees into radians"


def sensor_of(path: Path) -> str:
    """The name of a sensor, from that of its file."""
    return _name(path.stem) or "sensor"


def _numbers(path: Path) -> dict[Column, FloatArray | None]:
    """The values of each column, shape (n,) or (n, k); None where they are no numbers.

    Raises:
        RecordingError: there are none.
    """
    names = column_names(path)
    found: Columns = {}
    try:
        found = read_columns(path, names)
    except RecordingError as error:  # of a single column, which is then found by reading each
        for name in names:
            with suppress(RecordingError):
                found |= read_columns(path, [name])
        if not found:
            raise RecordingError(f"no column of numbers can be read: {error}") from None
    flat = {name: v[:, 0] if v.shape[1] == 1 else v for name, v in found.items()}
    return {name: flat.get(name) for name in names}


def _inspected(name: Column, values: FloatArray | None, use: str) -> ColumnInspection:
    if values is None:
        return ColumnInspection(name, (), None, None, 0, "no numbers")
    finite = values[np.isfinite(values)]
    first = tuple(each if math.isfinite(each) else None for each in values.ravel()[:SHOWN].tolist())
    missing = int((~np.isfinite(values)).reshape(len(values), -1).any(axis=1).sum())
    if not finite.size:
        return ColumnInspection(name, first, None, None, missing, "no value")
    if not use and values.ndim > 1:
        use = f"{values.shape[1]} columns"
    return ColumnInspection(name, first, float(finite.min()), float(finite.max()), missing, use)


def _row(column: ColumnInspection) -> tuple[str, ...]:
    ends = ("-" if end is None else f"{end:.6g}" for end in (column.least, column.greatest))
    gaps = f"{column.missing} rows without a value" if column.missing else ""
    values = ("nothing" if value is None else f"{value:.6g}" for value in column.first)
    first = ", ".join(values) or "-"
    return (str(column.name), first, *ends, "; ".join(filter(None, (column.use, gaps))) or "-")


def _stamps(name: Column, values: FloatArray | None) -> Stamps | None:
    """The stamps that a column holds; None where its name is no stamp's, or it does not rise."""
    words = re.findall(r"[a-z]+", str(name).lower())
    stated = stated_unit(name)
    is_called_so = any(word in STAMPS or word.endswith(("time", "stamp")) for word in words)
    if values is None or values.ndim > 1 or len(values) < 2 or not (is_called_so or stated):
        return None
    step = float(np.median(np.diff(values)))
    seconds = {unit: step * size / NANOSECONDS_PER_SECOND for unit, size in NANOSECONDS.items()}
    fit = [
        unit
        for longest in (USUAL, SLOW)
        for unit, apart in seconds.items()
        if 1.0 / FASTEST <= apart <= longest and stated in (None, unit)
    ]
    return Stamps(name, fit[0], 1.0 / seconds[fit[0]]) if fit else None


def _wrenches(path: Path, names: Sequence[Column]) -> dict[str, tuple[Column, ...]]:
    """The columns of each wrench by the name of its sensor: the text before force and axis."""
    found: dict[str, dict[str, Column]] = {}
    for name in names:
        if match := WRENCH.fullmatch(str(name).lower()):
            what = "force" if match["kind"].startswith("f") else "torque"
            found.setdefault(match["before"], {}).setdefault(what + match["axis"], name)
        elif (match := NUMBERED.fullmatch(str(name))) and convention_of("force_torque", str(name)):
            found.setdefault(match["before"], {})[match["number"]] = name
    components = [what + axis for what in ("force", "torque") for axis in AXES]
    return {
        _name(before) or sensor_of(path): tuple(
            six[component] for component in (components if components[0] in six else sorted(six))
        )
        for before, six in found.items()
        if len(six) == len(components)
    }


def _name(text: str) -> str:
    """A sensor's name from a text."""
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")


def _column(name: Column) -> str:
    return str(name) if isinstance(name, int) else text_of(name)
