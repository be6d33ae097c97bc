"""Where the contacts of a replay go: MCAP with all that was recorded, CSV, or Parquet."""

import csv
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from contactfusion.contact_rows import COLUMNS, contact_rows
from contactfusion.errors import RecordingError, missing_extra
from contactfusion.files import whole_file
from contactfusion.pipeline import Step
from contactfusion.play import Observer
from contactfusion.recordings.mcap import McapWriter, kept_when_cut, telling
from contactfusion.recordings.messages import recorded_stamp, typestore
from contactfusion.recordings.ros import RawMessage
from contactfusion.recordings.step_messages import OURS
from contactfusion.replaying.configuration import TOPIC

if TYPE_CHECKING:
    import pyarrow

ROWS_AT_ONCE = 10_000
"""So many contacts make a group of rows of a Parquet file."""


def _ignore(message: RawMessage) -> None:
    """Take a message, and do nothing."""


@final
@dataclass(frozen=True)
class Output(Observer):
    """An observer that may take the messages of a ROS recording as they are, too.

    Attributes:
        message: takes each message.
    """

    message: Callable[[RawMessage], None] = _ignore


@dataclass(frozen=True)
class About:
    """What a file tells of the replay that wrote it.

    Attributes:
        epoch_ns: the moment from which stamps count [ns].
        configuration: how it was made.
        copies: whether messages come as they are, so that readings are not written.
        passed_over: the types by topic of messages that are not copied, as nothing defines them.
    """

    epoch_ns: int
    configuration: str
    copies: bool
    passed_over: dict[str, str] = field(default_factory=dict)


def open_output(path: Path, about: About) -> AbstractContextManager[Output]:
    """Begin the file that takes a replay; it appears whole at the end of the `with`.

    Args:
        path: the file; its suffix says what kind: .mcap, .csv or .parquet.
        about: what it tells of the replay.

    Raises:
        RecordingError: the suffix is another.
        WritingError: the file can't be written; nothing of it is kept.
        DependencyError: a package is not installed.
    """
    kinds = {".mcap": _mcap, ".csv": _csv, ".parquet": _parquet}
    if path.suffix not in kinds:
        raise RecordingError(
            f"{path}: contacts are written to {', '.join(kinds)}, not to '{path.suffix}'"
        )
    return kinds[path.suffix](path, about)


@contextmanager
def _mcap(path: Path, about: About) -> Iterator[Output]:
    """All that was recorded, contacts and command below /contactfusion, and the configuration."""
    with McapWriter(path, about.epoch_ns) as writer:
        writer.text(TOPIC, about.configuration)
        if about.copies:
            yield Output(step=writer.step, message=partial(_copy, writer, about.passed_over))
        else:
            yield Output(step=writer.step, reading=writer.reading)


def _copy(writer: McapWriter, passed_over: dict[str, str], message: RawMessage) -> None:
    if message.topic.startswith(OURS):  # of an earlier replay; this one tells anew
        return
    if message.definition or message.msgtype in typestore().types:
        writer.copy(message)
    else:  # nobody could read it
        passed_over[message.topic] = message.msgtype


@contextmanager
def _csv(path: Path, about: About) -> Iterator[Output]:
    """One row a contact, as `contacts.csv` of a run."""
    with (
        telling(path),
        whole_file(path) as temporary,
        kept_when_cut(temporary, path),
        telling(path),
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        yield Output(step=lambda step: table.writerows(contact_rows(step)))


@contextmanager
def _parquet(path: Path, about: About) -> Iterator[Output]:
    """One row a contact: numbers as they are, and the share of each source by name."""
    try:
        from pyarrow import parquet
    except ImportError:
        raise missing_extra("pyarrow", "parquet") from None
    schema = _schema()
    rows: list[dict[str, Any]] = []

    with (
        telling(path),
        whole_file(path) as temporary,
        parquet.ParquetWriter(temporary, schema) as table,
    ):

        def write() -> None:
            table.write_table(_table(rows, schema))
            rows.clear()

        def step(one: Step) -> None:
            rows.extend(_parquet_rows(one, about.epoch_ns))
            if len(rows) >= ROWS_AT_ONCE:
                write()

        yield Output(step=step)
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
            "shares": list(contact.shares.items()),
        }
