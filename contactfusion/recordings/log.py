"""Logs of your own, in CSV or NumPy files, described in ten lines of YAML.

    type: log
    file: wrist.csv
    time: {column: t, unit: ms}
    readings:
      wrist:
        type: wrench
        frame: wrist
        columns: [fx, fy, fz, tx, ty, tz]
        scale: [1, 1, 1, 0.001, 0.001, 0.001]     # moments in N·mm

A log without stamps has ``time: {rate: 240}``; columns without a header are named by number from 1:
``columns: 19..24``. Several files make one recording:

    type: log
    files:
      - {file: a.csv, time: …, readings: …}
      - {file: b.npz, time: …, readings: …}
"""

import logging
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self, final

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, Guard, RecordingError, name_hint
from contactfusion.hooks import hookimpl
from contactfusion.model import Model
from contactfusion.readings import Reading
from contactfusion.readings.codec import Codec, Role
from contactfusion.readings.columns import Column, ColumnsConfig, written_out
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.recording import RecordingFormat
from contactfusion.recordings.series import (
    LEAST_RATE,
    Series,
    StampArray,
    even_stamps,
    first_stamp,
    merged,
)
from contactfusion.recordings.tables import AS_FOUND, Columns, TextFormat, read_columns
from contactfusion.time import LONGEST_SECONDS, NANOSECONDS_PER_SECOND

NANOSECONDS = {"s": NANOSECONDS_PER_SECOND, "ms": 1_000_000, "us": 1_000, "ns": 1}
UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanoseconds"), "ns"),
}
"""Units of time, by words in the names of columns."""
LONGEST_FALL = NANOSECONDS_PER_SECOND
"""The greatest disorder of rows [ns]; beyond, the clock was set back."""

TELLING = 10
"""The least number of rows whose rate shows the unit of their stamps."""
FASTEST = 9000.0
"""The greatest rate of rows [Hz]: the fastest force-torque sensors have 8 kHz, and a sensor of 10
Hz whose seconds are taken for milliseconds seems to have 10 kHz."""
SLOW = 5.0
"""The greatest distance of rows [s]; slower ones follow no contact, and milliseconds of a sensor of
100 Hz that are taken for seconds are 10 s apart."""
MOST_COLUMNS = 100_000
"""The greatest number of columns of all readings of a log, as often as several have them."""

log = logging.getLogger(__name__)


def stated_unit(column: Column) -> str | None:
    """The unit of time at the end of a column's name, as in `t_ms`; None: it has none."""
    words = re.findall(r"[a-z]+", str(column).lower())
    return next((UNITS[word] for word in reversed(words) if word in UNITS), None)


class TimeConfig(Model):
    """The stamps of a log: a column, or a constant rate."""

    column: Column | None = None
    """The column of stamps, by name or by number from 1."""
    unit: Literal["s", "ms", "us", "ns"] = "s"
    """The unit of that column."""
    file: Path | None = None
    """The file with that column, when it is another; its rows pair with this file's rows."""
    rate: float | None = Field(default=None, ge=LEAST_RATE)
    """Rows a second [Hz], for a log without stamps."""
    start: float = Field(default=0.0, ge=-LONGEST_SECONDS, le=LONGEST_SECONDS)
    """The stamp of the first row of a log without stamps [s]."""

    @model_validator(mode="after")
    def _one_clock(self) -> Self:
        given = self.model_fields_set
        if (self.column is None) == (self.rate is None):
            raise ValueError("give either column or rate")
        if unfit := given & ({"start"} if self.rate is None else {"unit", "file"}):
            has = "column" if self.rate is None else "rate"
            raise ValueError(f"{', '.join(sorted(unfit))} does not go with {has}")
        return self

    @model_validator(mode="after")
    def _as_named(self) -> Self:
        """Refuse a unit that the column's name contradicts; the rate of rows seldom shows it."""
        stated = None if self.column is None else stated_unit(self.column)
        if stated not in (None, self.unit):
            raise ConfigurationError(
                f"the column '{self.column}' states {stated} by its name, `unit` is {self.unit}: "
                f"set unit: {stated}, or, where the name is wrong, name the column by its number",
                "unit",
            )
        return self


def _chosen(value: Any) -> Any:
    """The columns of the kind of reading that is named.

    Raises:
        ConfigurationError: there is no such kind, or a log can't hold it.
        PluginError: the plug-in that has it cannot be used.
    """
    if isinstance(value, ColumnsConfig):
        return value
    if not isinstance(value, Mapping):
        raise ConfigurationError(f"{value!r} is none; write it as {{type: wrench, frame: …}}")
    name = str(value.get("type") or "")
    codec = installed_kinds().find(name)
    if codec is None or codec.Columns is None:
        wrong = f"unknown type '{name}'" if name else "this field is required"
        if codec is not None:
            wrong, name = f"a log can't hold readings of '{name}'", ""
        known = [other.name for other in installed_kinds().all() if other.Columns]
        raise ConfigurationError(f"{wrong}; {name_hint(name, known, 'types')}", "type")
    with installed_kinds().guard(codec):
        return codec.Columns(**value)


class LogFile(Model):
    """One file of a log."""

    file: Path
    """A `.npy`, a `.npz`, or else a text table such as CSV."""
    delimiter: str | None = Field(default=None, min_length=1, max_length=1)
    """The delimiter of cells; None: tab, `;`, `,` or white space, as found."""
    header: bool | None = None
    """Whether the first line has the names of columns; None: if no cell of it is a number."""
    time: TimeConfig
    """The stamps of the rows."""
    readings: dict[str, Annotated[ColumnsConfig, BeforeValidator(_chosen)]] = Field(min_length=1)
    """By the name of the sensor: the reading of each row, and its columns."""


class LogConfig(Model):
    """A log of one file, with the fields of `LogFile`, or of several, with `files`."""

    files: tuple[LogFile, ...] = Field(min_length=1)
    """The files, each with stamps of one common clock."""

    @model_validator(mode="before")
    @classmethod
    def _single(cls, fields: Any) -> Any:
        """The fields of a single file as those of several, with columns in bounds."""
        count = 0
        for item in _column_items(fields["files"] if "files" in fields else [fields]):
            with suppress(ValueError):  # it is no range, which its reading refuses
                count += len(written_out(item))
            if count > MOST_COLUMNS:
                raise ConfigurationError(f"its readings have more than {MOST_COLUMNS} columns")
        return fields if "files" in fields else {"files": (LogFile(**fields),)}


def _column_items(files: Any) -> Iterator[Any]:
    """Columns and ranges of the fields of files, as far as they are such fields."""
    for file in files if isinstance(files, list | tuple) else ():
        readings = file.get("readings") if isinstance(file, Mapping) else None
        for reading in readings.values() if isinstance(readings, Mapping) else ():
            columns = reading.get("columns") if isinstance(reading, Mapping) else None
            yield from columns if isinstance(columns, list | tuple) else [columns]


@final
class LogRecording(RecordingFormat):
    """The readings of CSV and NumPy logs, merged by their stamps.

    A row in which a value of a reading is missing (an empty cell, NaN or infinite) gives no such
    reading; only markers may miss values. Rows that are up to a second out of order are sorted.
    Both are counted in `notes` and logged as warnings. Of readings of one stamp the state of robot
    and world comes first. Stamps in whole nanoseconds are exact where
    the platform's long double has 64 bits (Linux); elsewhere Unix times are rounded to 0.3 µs.

    Args:
        config: the files and their contents.
        folder: that of relative file names.

    Raises:
        RecordingError: a file is missing, cut off, or contradicts its description.
    """

    Config = LogConfig

    def __init__(self, config: LogConfig, folder: Path = Path()) -> None:
        files = config.files
        self.notes: list[str] = []
        """What was left out or sorted, in sentences."""
        found = [pair for file in files for pair in self._read(file, folder)]
        # what places a sensor must have come before it, however columns are listed
        found.sort(key=lambda pair: pair[0].role is Role.SENSED)
        self._series = [series for _, series in found]
        self.epoch_ns = first_stamp(self._series)
        self.topics = {
            sensor: _codec(columns).kind
            for file in files
            for sensor, columns in file.readings.items()
        }
        for note in self.notes:
            log.warning(note)

    @classmethod
    def opened(cls, config: LogConfig, folder: Path) -> "LogRecording":
        """The recording in the files."""
        return cls(config, folder)

    def readings(self) -> Iterator[Reading]:
        """The readings in order of their stamps."""
        return merged(self._series, self.epoch_ns)

    def _read(self, file: LogFile, folder: Path) -> Iterator[tuple[Codec[Any], Series]]:
        path = folder / file.file
        wanted = dict.fromkeys(name for row in file.readings.values() for name in row.columns)
        text = TextFormat(file.delimiter, file.header)
        table = read_columns(path, list(wanted), text=text)
        if path.suffix.lower() not in (".npy", ".npz") and not _last_line_ends(path):
            self.notes.append(
                f"{path}: the last line does not end; if the file is cut off, so is its last number"
            )
        stamps = self._stamps(file, path, folder, len(next(iter(table.values()))))
        for sensor, config in file.readings.items():
            values = _values(path, sensor, config, table)
            usable = np.full(len(values), True) if config.gaps else np.isfinite(values).all(axis=1)
            if left_out := int((~usable).sum()):
                self.notes.append(
                    f"{path}: {left_out} of {len(values)} rows give no reading of '{sensor}', "
                    "because a value is missing"
                )
            codec = _codec(config)
            yield (
                codec,
                Series(
                    origin=str(path),
                    stamps=stamps[usable],
                    values=values[usable],
                    rows=np.flatnonzero(usable) + 1,
                    make=partial(_reading, installed_kinds().guard(codec), config, sensor),
                ),
            )

    def _stamps(self, file: LogFile, path: Path, folder: Path, count: int) -> StampArray:
        time = file.time
        if time.rate is not None:
            stamps = even_stamps(count, time.rate, time.start)
            self._check_rate(stamps, time, path)
            return stamps
        source = folder / time.file if time.file else path
        text = AS_FOUND if time.file else TextFormat(file.delimiter, file.header)
        assert time.column is not None  # otherwise it has a rate
        column = read_columns(source, [time.column], np.longdouble, text)[time.column]
        if column.shape != (count, 1):
            raise RecordingError(
                f"{source} holds {column.size} stamps for the {count} rows of {path}"
            )
        stamps = _nanoseconds(column[:, 0], time, source)
        behind = np.maximum.accumulate(stamps) - stamps
        if behind.max() > LONGEST_FALL:
            row = int(np.argmax(behind > LONGEST_FALL))
            raise RecordingError(
                f"{source}: time falls by {behind[row] / NANOSECONDS_PER_SECOND:g} s at row "
                f"{row + 1}; split the file where its clock starts again"
            )
        if late := int((behind > 0).sum()):
            self.notes.append(f"{source}: {late} of {count} rows were out of order, and are sorted")
        self._check_rate(stamps, time, source)
        return stamps

    def _check_rate(self, stamps: StampArray, time: TimeConfig, source: Path) -> None:
        """Refuse rows that are faster or slower than any sensor's.

        Raises:
            RecordingError: their unit is a mistake.
        """
        if len(stamps) < TELLING:
            return
        span = float(np.ptp(stamps)) / NANOSECONDS_PER_SECOND
        step = float(np.median(np.diff(np.sort(stamps)))) / NANOSECONDS_PER_SECOND
        mean = span / (len(stamps) - 1)
        if 0.0 < mean < 1.0 / FASTEST:
            counted = f"{source}: {len(stamps)} rows in {span:.3g} s are {1.0 / mean:.3g} a second"
            raise RecordingError(f"{counted}, faster than any sensor; {_unit_meant(mean, time)}")
        if step > SLOW:
            raise RecordingError(
                f"{source}: rows are {step:.5g} s apart; {_unit_meant(step, time)}"
            )


def _codec(columns: ColumnsConfig) -> Codec[Any]:
    """The codec whose columns they are."""
    codec = installed_kinds().find(columns.type)
    assert codec is not None  # or its columns would not have been taken
    return codec


def _reading(
    guard: Guard, columns: ColumnsConfig, sensor: str, stamp: float, row: FloatArray
) -> Reading:
    """The reading of one row of a log.

    Raises:
        InvalidReadingError: no sensor can have given its values.
        PluginError: the plug-in of its kind makes none.
    """
    with guard:
        return columns.reading({"stamp": stamp, "frame": columns.frame, "sensor": sensor}, row)


def _unit_meant(step: float, time: TimeConfig) -> str:
    """The clause on the unit or rate that gives such a step [s], and on the unit that fits."""
    if time.rate is not None:
        return f"`rate` is {time.rate:g}, in rows a second"
    seconds = {unit: step * size / NANOSECONDS[time.unit] for unit, size in NANOSECONDS.items()}
    fit = (unit for unit, apart in seconds.items() if 1.0 / FASTEST <= apart <= SLOW)
    meant = next(fit, None)
    return f"`unit` is {time.unit}" + (f": did you mean {meant}?" if meant else "")


def _last_line_ends(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read() in (b"\n", b"\r")


def _values(path: Path, sensor: str, config: ColumnsConfig, table: Columns) -> FloatArray:
    values = np.hstack([table[column] for column in config.columns])
    counts = config.counts()
    if counts and values.shape[1] not in counts:
        wanted = " or ".join(str(count) for count in counts)
        raise RecordingError(
            f"{path}: '{sensor}' needs {wanted} columns for its type, not {values.shape[1]}"
        )
    if len(config.scale) not in (1, values.shape[1]):
        raise RecordingError(
            f"{path}: '{sensor}' has {len(config.scale)} scales for {values.shape[1]} columns"
        )
    scaled: FloatArray = values * np.array(config.scale)
    return scaled


def _nanoseconds(column: NDArray[np.longdouble], time: TimeConfig, source: Path) -> StampArray:
    scaled = column * NANOSECONDS[time.unit]
    good = np.abs(scaled) <= LONGEST_SECONDS * NANOSECONDS_PER_SECOND
    if not good.all():
        row = int(np.argmin(good))
        steps = np.abs(np.diff(column[np.isfinite(column)]))
        apart = float(np.median(steps)) if len(steps) else 0.0
        step = apart * NANOSECONDS[time.unit] / NANOSECONDS_PER_SECOND
        hint = _unit_meant(step, time) if step > SLOW else "is the column right, and its unit?"
        raise RecordingError(
            f"{source}, row {row + 1}: {column[row]} {time.unit} is no stamp; {hint}"
        )
    return np.rint(scaled).astype(np.int64)


@hookimpl
def contactfusion_recordings() -> dict[str, type[RecordingFormat]]:
    """The recording."""
    return {"log": LogRecording}
