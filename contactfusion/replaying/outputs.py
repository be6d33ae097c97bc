"""Where the contacts of a replay go: MCAP with all that was recorded, CSV, or Parquet."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import final

from contactfusion.errors import RecordingError
from contactfusion.loop import Observer
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.ros import RawMessage
from contactfusion.recordings.step_messages import OURS
from contactfusion.replaying.configuration import TOPIC
from contactfusion.results import COLUMNS, contact_rows, parquet_file, table_file


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


def open_output(path: Path, about: About) -> AbstractContextManager[Observer]:
    """Begin the file that takes a replay; it appears whole at the end of the `with`.

    Args:
        path: the file; its suffix says what kind: .mcap, .csv or .parquet.
        about: what it tells of the replay.

    Raises:
        RecordingError: the suffix is another.
        WritingError: the file can't be written; nothing of it is kept.
        DependencyError: a package is not installed.
    """
    match path.suffix:
        case ".mcap":
            return _mcap(path, about)
        case ".csv":
            return table_file(path, COLUMNS, contact_rows)
        case ".parquet":
            return parquet_file(path, about.epoch_ns)
        case suffix:
            raise RecordingError(
                f"{path}: contacts are written to .mcap, .csv, .parquet, not to '{suffix}'"
            )


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
