"""What is found, as tables: contacts in CSV or Parquet, commands in CSV."""

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contactfusion.errors import missing_extra
from contactfusion.files import as_writing_error, kept_when_cut, whole_file
from contactfusion.loop import Observer
from contactfusion.pipeline import Step
from contactfusion.recordings.messages import recorded_stamp

if TYPE_CHECKING:
    import pyarrow

ENTRIES = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
"""The entries of a covariance that differ."""
COLUMNS: tuple[str, ...] = (
    *("stamp", "x", "y", "z", "likelihood", "dispersion", "voxels", "fx", "fy", "fz", "shares"),
    *(f"cov_{name}" for name in ENTRIES),
    *("x_from", "y_from", "z_from", "x_to", "y_to", "z_to", "track", "since"),
)
"""Stamp [s], place [m], likelihood, dispersion [m], voxels, force [N], share of each source,
covariance [m²], the two ends of the extent [m], number and time of making of a contact that is
followed [s]."""
Row = tuple[str | int | float | None, ...]
COMMAND_COLUMNS: tuple[str, ...] = (
    "stamp",
    "vx",
    "vy",
    "vz",
    "wx",
    "wy",
    "wz",
    "gripper",
    "mode",
    "reason",
)
"""Stamp [s], twist [m/s, rad/s], gripper, mode, reason."""
ROWS_AT_ONCE = 10_000
"""So many contacts make a group of rows of a Parquet file."""


def contact_rows(step: Step) -> Iterator[Row]:
    """One row a contact, as text with six digits, in the order of `COLUMNS`."""
    for contact in step.fusion.contacts:
        shares = " ".join(f"{name}:{share:.4f}" for name, share in contact.shares.items())
        numbers = [
            *contact.position,
            contact.likelihood,
            contact.dispersion,
            contact.voxels,
            *contact.force,
        ]
        covariance = [contact.covariance[entry] for entry in ENTRIES.values()]
        ends = contact.extent.ravel()
        cells, entries = ([f"{n:.6g}" for n in row] for row in (numbers, [*covariance, *ends]))
        followed = (contact.track, f"{contact.since:.6f}") if contact.track else ("", "")
        yield (f"{step.stamp:.6f}", *cells, shares, *entries, *followed)


def command_rows(step: Step) -> Iterator[Row]:
    """The row of a step's command, in the order of `COMMAND_COLUMNS`; none without a command."""
    if (command := step.command) is None:
        return
    twist = command.twist
    numbers = [*twist.linear, *twist.angular] if twist else [""] * 6
    cells = [f"{n:.6g}" if isinstance(n, float) else n for n in (*numbers, command.gripper)]
    yield (f"{step.stamp:.6f}", *cells, command.mode, command.reason)


@contextmanager
def table_file(
    path: Path, columns: Sequence[str], rows: Callable[[Step], Iterator[Row]]
) -> Iterator[Observer]:
    """A CSV file of steps, which appears whole at the end of the `with`.

    Args:
        path: the file.
        columns: their names.
        rows: those of a step.

    Raises:
        WritingError: the file can't be written; what the disk took is kept under another name.
    """
    with (
        as_writing_error(path),
        whole_file(path) as temporary,
        kept_when_cut(temporary, path),
        as_writing_error(path),
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        table = csv.writer(file, lineterminator="\n")
        table.writerow(columns)
        yield Observer(step=lambda step: table.writerows(rows(step)))


@contextmanager
def parquet_file(path: Path, epoch_ns: int) -> Iterator[Observer]:
    """A Parquet file of contacts: numbers as they are, and the share of each source by name.

    Args:
        path: the file; it appears whole at the end of the `with`.
        epoch_ns: the moment from which stamps count [ns].

    Raises:
        WritingError: the file can't be written; nothing of it is kept.
        DependencyError: pyarrow is not installed.
    """
    try:
        from pyarrow import parquet
    except ImportError:
        raise missing_extra("pyarrow", "parquet") from None
    schema = _schema()
    rows: list[dict[str, Any]] = []

    with (
        as_writing_error(path),
        whole_file(path) as temporary,
        parquet.ParquetWriter(temporary, schema) as table,
    ):

        def write() -> None:
            table.write_table(_table(rows, schema))
            rows.clear()

        def take(step: Step) -> None:
            rows.extend(_parquet_rows(step, epoch_ns))
            if len(rows) >= ROWS_AT_ONCE:
                write()

        yield Observer(step=take)
        write()


def _schema() -> "pyarrow.Schema":
    import pyarrow as pa

    numbers = ("x", "y", "z", "likelihood", "dispersion", "fx", "fy", "fz")
    return pa.schema(
        [
            ("time_ns", pa.int64()),
            ("stamp", pa.float64()),
            *((name, pa.float64()) for name in numbers),
            ("voxels", pa.int64()),
            ("covariance", pa.list_(pa.float64(), 9)),
            ("extent", pa.list_(pa.float64(), 6)),
            ("track", pa.int64()),
            ("since", pa.float64()),
            ("shares", pa.map_(pa.string(), pa.float64())),
        ]
    )


def _table(rows: list[dict[str, Any]], schema: "pyarrow.Schema") -> "pyarrow.Table":
    import pyarrow as pa

    return pa.Table.from_pylist(rows, schema)


def _parquet_rows(step: Step, epoch_ns: int) -> Iterator[dict[str, Any]]:
    for contact in step.fusion.contacts:
        places = zip("xyz", contact.position.tolist(), strict=True)
        forces = zip(("fx", "fy", "fz"), contact.force.tolist(), strict=True)
        yield {
            "time_ns": recorded_stamp(step.stamp, epoch_ns),
            "stamp": step.stamp,
            **dict(places),
            "likelihood": float(contact.likelihood),
            "dispersion": float(contact.dispersion),
            **dict(forces),
            "voxels": int(contact.voxels),
            "covariance": contact.covariance.ravel().tolist(),
            "extent": contact.extent.ravel().tolist(),
            "track": contact.track or None,
            "since": contact.since if contact.track else None,
            "shares": list(contact.shares.items()),
        }
