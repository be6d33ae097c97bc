"""MCAP: readings, contacts and commands in one file that ROS 2 tools read (extra `record`)."""

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self, final

from contactfusion.errors import RecordingError
from contactfusion.files import make_folder
from contactfusion.pipeline import Step
from contactfusion.readings import Reading
from contactfusion.recordings.messages import Message, recorded_stamp, typestore
from contactfusion.recordings.reading_messages import reading_messages, ros_name, topic_of
from contactfusion.recordings.step_messages import STEP_TOPICS, step_messages

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Writer

VERSION: Final = 8
"""Of the metadata of rosbag2: the newest that ROS 2 Iron reads, too."""
BAG = "recording"
"""What the file is called within itself: two of equal content are equal, whatever their names."""


@final
class McapWriter:
    """Writes a recording as one MCAP file: profile ros2, CDR, message definitions inside.

    Use as a context manager: the file appears whole at its end, or not at all after an exception.
    The same input gives the same bytes, with one version of rosbags and of zstd. A message is
    logged at the stamp of what it tells; stamps need not rise.

    Args:
        path: the file; one that exists is replaced.
        epoch_ns: the moment from which stamps count, since 1970 [ns].

    Raises:
        DependencyError: rosbags is not installed.
        RecordingError: the path is a folder.
    """

    def __init__(self, path: Path, epoch_ns: int = 0) -> None:
        if path.is_dir():
            raise RecordingError(f"{path} is a folder; a recording needs the name of a file")
        self._store = typestore()
        self._path, self._epoch_ns = path, epoch_ns
        self._channels: dict[str, Connection] = {}
        self._file: AbstractContextManager[Writer] | None = None
        self._bag: Writer | None = None

    def __enter__(self) -> Self:
        """Begin the file, under a name of its own."""
        self._channels.clear()
        self._file = _bag_that_becomes(self._path)
        self._bag = self._file.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the file its name, or remove what there is of it."""
        assert self._file
        self._bag = None
        self._file.__exit__(kind, error, trace)

    def reading(self, reading: Reading, prefix: str = "") -> None:
        """Write a reading, on the topic of its sensor; odometry goes to /tf, too.

        Args:
            reading: any kind of reading.
            prefix: what the topic begins with, e.g. "truth"; what has one does not go to /tf.

        Raises:
            RecordingError: there is no message for it, its topic is taken by something else, or
                its stamp lies where ROS has none.
        """
        topic = topic_of(reading, prefix)
        if topic in STEP_TOPICS:
            raise RecordingError(
                f"{reading.label} can't be recorded on {topic}, which steps write; "
                f"call the sensor otherwise"
            )
        stamp = recorded_stamp(reading.stamp, self._epoch_ns)
        for place, message in reading_messages(reading, topic, stamp):
            if place != "/tf" or not prefix:
                self._write(place, message, stamp)

    def step(self, step: Step) -> None:
        """Write the contacts and the command of a step.

        Contacts go to /contacts, and to /contacts/markers as spheres with their likelihoods, for
        viewers; a command goes to /command, and its twist to /cmd_vel.

        Raises:
            RecordingError: a stamp lies where ROS has none.
        """
        stamp = recorded_stamp(step.stamp, self._epoch_ns)
        for topic, message in step_messages(step, self._epoch_ns):
            self._write(topic, message, stamp)

    def _write(self, topic: str, message: Message, stamp: int) -> None:
        if self._bag is None:
            raise RecordingError("a McapWriter writes within its with statement only")
        kind = message.__msgtype__
        channel = self._channels.get(topic)
        if channel is None:
            name = ros_name(topic)
            if any(other.topic == name for other in self._channels.values()):
                raise RecordingError(f"'{topic}' and another topic would both be {name} in ROS")
            channel = self._bag.add_connection(name, kind, typestore=self._store)
            self._channels[topic] = channel
        if channel.msgtype != kind:
            raise RecordingError(
                f"the topic {topic} holds {channel.msgtype}, and can't hold {kind}; "
                f"call one of the two sensors otherwise"
            )
        self._bag.write(channel, stamp, self._store.serialize_cdr(message, kind))


@contextmanager
def _bag_that_becomes(path: Path) -> Iterator["Writer"]:
    """Give a bag of rosbags, which is a folder, and take the one MCAP file out of it at the end."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    make_folder(path.parent)
    with TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
        bag = Writer(Path(folder) / BAG, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with bag:
            yield bag
        os.replace(bag.path / f"{BAG}.mcap", path)
