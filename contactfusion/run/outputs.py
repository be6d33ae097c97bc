"""Where contacts go: MCAP with all that was recorded, CSV, or Parquet; or a folder of tables."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import final

from contactfusion.errors import RecordingError
from contactfusion.files import make_folder, require_spared
from contactfusion.loop import Observer
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import ros_name, typestore
from contactfusion.recordings.recording import RawMessage, Recording
from contactfusion.recordings.ros.delivery import CHANGES, CYCLES
from contactfusion.recordings.step_messages import OURS
from contactfusion.results import (
    COLUMNS,
    COMMAND_COLUMNS,
    command_rows,
    contact_rows,
    parquet_file,
    table_file,
)
from contactfusion.run.configuration import TOPIC, Setting
from contactfusion.run.recorder import Recorder, write_robot
from contactfusion.run.session import Session
from contactfusion.terminal import note

SUFFIXES = (".mcap", ".csv", ".parquet")
"""Of the files that contacts are written to."""
CONTACTS, COMMANDS, SUMMARY = "contacts.csv", "commands.csv", "summary.json"
"""The files of a folder that takes the results."""


def folder_of(out: Path | None, read: Sequence[Path]) -> Path | None:
    """The folder that takes the results; None where a file does, or nothing is written.

    Args:
        out: a file that ends in one of `SUFFIXES`, or a folder.
        read: the files and folders that are read.

    Raises:
        ConfigurationError: what is read would be written over.
        RecordingError: the suffix is another.
    """
    if out is None:
        return None
    require_spared("--out", out, read)
    if out.suffix in SUFFIXES:
        return None
    if not (out.suffix[1:].isdecimal() or out.suffix == "" or out.is_dir()):
        raise RecordingError(
            f"{out}: contacts are written to {', '.join(SUFFIXES)}, not to '{out.suffix}'; or to a "
            "folder, by a name without a suffix"
        )
    for name in (CONTACTS, COMMANDS, SUMMARY):
        require_spared("--out", out / name, read)
    return out


def opened_outputs(
    session: Session, out: Path | None, folder: Path | None
) -> dict[Path, AbstractContextManager[Observer]]:
    """What takes the contacts, by its file, which appears whole at the end of the `with`.

    Args:
        session: what is played.
        out: a file or a folder; None: nothing takes them.
        folder: the folder, where it is one.

    Raises:
        WritingError: the folder can't be made.
        DependencyError: a package is not installed.
    """
    if out is None:
        return {}
    if folder is not None:
        make_folder(folder)
        tables = {CONTACTS: (COLUMNS, contact_rows)}
        if session.pipeline.config.controller is not None:
            tables[COMMANDS] = COMMAND_COLUMNS, command_rows
        return {folder / name: table_file(folder / name, *made) for name, made in tables.items()}
    match out.suffix:
        case ".mcap":
            return {out: mcap_file(out, session)}
        case ".csv":
            return {out: table_file(out, COLUMNS, contact_rows)}
        case _:
            return {out: parquet_file(out, session.stream.epoch_ns)}


@final
class Output(Observer):
    """Writes each step, and messages as they are, to an MCAP file.

    Args:
        writer: of the file.
    """

    def __init__(self, writer: McapWriter) -> None:
        super().__init__(step=writer.step)
        self._writer = writer
        self.passed_over: dict[str, str] = {}
        """The types by topic of messages that are not copied, as nothing defines them."""

    def copy(self, message: RawMessage) -> None:
        """Write a message, but not of an earlier run: this run reports anew."""
        ours = message.topic.startswith(OURS) and message.topic not in (CYCLES, CHANGES)
        if ours or self.failure is not None:
            return
        if message.definition or message.msgtype in typestore().types:
            try:
                self._writer.copy(message)
            except Exception as error:  # no output harms another, or the run
                self.failure = error
        else:  # nothing could read it
            self.passed_over[message.topic] = message.msgtype

    def flush(self) -> None:
        """Write what came so far to the disk."""
        if self.failure is None:
            try:
                self._writer.flush()
            except Exception as error:  # as in `copy`
                self.failure = error


@contextmanager
def mcap_file(path: Path, session: Session) -> Iterator[Observer]:
    """All that came, contacts and command below /contactfusion, and the configuration."""
    stream, config = session.stream, session.pipeline.config
    with McapWriter(path, stream.epoch_ns) as writer:
        writer.text(TOPIC, _setting(session).text(beside=path.parent))
        output = Output(writer)
        if not isinstance(stream, Recording):
            write_robot(writer, config)
            output.reading = Recorder(writer, stream).reading
        elif not stream.has_messages:
            output.reading = writer.reading
        yield output
    for topic, kind in output.passed_over.items():
        note(f"not copied: {topic}, as nothing defines {kind}")


def _setting(session: Session) -> Setting:
    """The setting that plays what is written, in which topics are called like their sensors."""
    setting, stream = session.setting, session.stream
    if isinstance(stream, Recording) and stream.has_messages:
        return setting
    sensors = session.inputs.sensors
    topics = {
        role: ros_name(f"/{sensors[topic.removeprefix('/')]}")
        for role, topic in setting.topics.items()
    }
    return replace(setting, topics=topics, ignored=())
