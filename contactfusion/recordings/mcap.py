"""MCAP: readings, contacts and commands in one file that ROS 2 tools read (extra `record`)."""

import os
import threading
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self, final

from contactfusion.contacts import Contact
from contactfusion.errors import RecordingError
from contactfusion.files import (
    as_writing_error,
    kept_when_cut,
    unfinished,
    uninterrupted,
)
from contactfusion.pipeline import Step
from contactfusion.readings import Reading, Transform
from contactfusion.readings.messages import Message, header, message
from contactfusion.readings.poses import MOVING, STATIC, transforms_message
from contactfusion.recordings.checksums import writer_with_checksums
from contactfusion.recordings.messages import (
    defined,
    reading_messages,
    recorded_stamp,
    ros_name,
    topic_of,
    type_hash,
    typestore,
)
from contactfusion.recordings.step_messages import (
    OURS,
    contact_message,
    is_drawn,
    marker_message,
    step_messages,
)

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos
    from rosbags.rosbag2 import Writer

    from contactfusion.recordings.recording import RawMessage

DESCRIPTION = "robot_description"
"""The topic of ROS for the URDF of a robot."""
LATCHED = (STATIC, DESCRIPTION, "configuration")
"""Topics that end with these words are sent once, and remain valid."""
VERSION: Final = 8
"""Version of the metadata of rosbag2: the newest that ROS 2 Iron reads, too."""
BAG = "recording"
"""The name of the file within itself: equal contents give equal bytes, whatever the file's name."""
KEPT = 100
"""Number of messages of a topic that are kept for late subscribers."""
NEVER = 9223372036, 854775807
"""An endless time in ROS 2 [s, ns]."""


@final
class McapWriter:
    """Writes a recording as one MCAP file: profile ros2, CDR, message definitions and checksums.

    Use as a context manager: the file appears whole at its end, or not at all after an exception;
    then an older one stays.
    The same input gives the same bytes, with one version of rosbags and of zstd. A message is
    logged at the stamp of its content; stamps need not rise.

    Args:
        path: the file; an existing one is replaced.
        epoch_ns: the origin of stamps, since 1970 [ns].

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
        self._syncing: threading.Thread | None = None
        self._unsynced: OSError | None = None
        """What the disk refused, until the next `flush`."""

    def __enter__(self) -> Self:
        """Open the file, under a name of its own.

        Raises:
            WritingError: the file can't be written.
        """
        self._channels.clear()
        self._drawn = True  # a viewer may show the drawing of another recording
        self._file = _bag_that_becomes(self._path)
        with as_writing_error(self._path):
            self._bag = self._file.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file under its name, or remove it after an exception.

        Raises:
            WritingError: the file can't be written.
        """
        assert self._file
        self._bag = None
        with uninterrupted(), as_writing_error(self._path):
            self._file.__exit__(kind, error, trace)

    def reading(self, reading: Reading, prefix: str = "") -> None:
        """Write a reading, on the topic of its sensor; odometry goes to /tf, too.

        Args:
            reading: of any kind.
            prefix: of the topic, e.g. "truth"; readings with one do not go to /tf.

        Raises:
            RecordingError: there is no message for it, its topic is in use by another type, or its
                stamp is out of the range of ROS.
            PluginError: the plug-in of its kind makes no message.
            WritingError: the file can't be written.
        """
        topic = topic_of(reading, prefix)
        if topic.startswith(OURS):
            raise RecordingError(
                f"{reading.label} can't be recorded on {topic}, as what begins with {OURS} is "
                f"written by steps; call the sensor otherwise"
            )
        stamp = recorded_stamp(reading.stamp, self._epoch_ns)
        for name, sent in reading_messages(reading, topic, stamp):
            if name != f"/{MOVING}" or not prefix:
                self._write(name, sent, stamp)

    def step(self, step: Step) -> None:
        """Write the contacts and the command of a step.

        Below /contactfusion, contacts go to /contacts, what happened to them, if anything, to
        /events, and for viewers to /contacts/markers as spheres with their likelihoods and to
        /contacts/voxels as a cloud of those with evidence; of successive steps with nothing to draw
        only the first is drawn. A command goes to /command, and its twist to /cmd_vel.

        Raises:
            RecordingError: a stamp is out of the range of ROS.
        """
        stamp = recorded_stamp(step.stamp, self._epoch_ns)
        fusion, drawn = step.fusion, self._drawn
        self._drawn = bool(fusion.contacts) or bool(is_drawn(fusion).any())
        for topic, sent in step_messages(step, self._epoch_ns, drawn or self._drawn):
            self._write(topic, sent, stamp)

    def static(self, frames: Sequence[Transform], stamp: float = 0.0) -> None:
        """Write static transforms, as one message on /tf_static.

        Args:
            frames: the poses of frames in their parents.
            stamp: of the message [s].

        Raises:
            RecordingError: the stamp is out of the range of ROS.
            WritingError: the file can't be written.
        """
        if frames:
            when = recorded_stamp(stamp, self._epoch_ns)
            self._write(f"/{STATIC}", transforms_message(frames, when), when)

    def robot_description(self, urdf: str, stamp: float = 0.0) -> None:
        """Write a robot's URDF, the text itself, on /robot_description.

        Raises:
            RecordingError: the stamp [s] is out of the range of ROS.
            WritingError: the file can't be written.
        """
        when = recorded_stamp(stamp, self._epoch_ns)
        self._write(f"/{DESCRIPTION}", message("std_msgs/String", data=urdf), when)

    def text(self, topic: str, text: str, stamp: float = 0.0) -> None:
        """Write a text, as std_msgs/String; late subscribers of the topic receive it, too.

        Raises:
            RecordingError: the stamp [s] is out of the range of ROS.
            WritingError: the file can't be written.
        """
        when = recorded_stamp(stamp, self._epoch_ns)
        self._write(topic, message("std_msgs/String", data=text), when)

    def copy(self, raw: "RawMessage") -> None:
        """Write a message of another recording as it is.

        Raises:
            RecordingError: its file does not define its type, or its topic is in use by another
                type.
            WritingError: the file can't be written.
        """
        channel = self._channels.get(raw.topic)
        if channel is None:
            definition = raw.definition or defined(raw.msgtype)
            try:
                known = type_hash(raw.msgtype, definition)
            except RecordingError as error:
                raise RecordingError(f"{raw.topic} can't be copied: {error}") from None
            channel = self._opened(raw.topic, raw.msgtype, msgdef=definition, rihs01=known)
        self._put(channel, raw.msgtype, raw.log_stamp_ns, raw.cdr)

    def contacts(
        self, contacts: tuple[Contact, ...], frame: str, stamp: float, prefix: str
    ) -> None:
        """Write contacts that are of no step, such as the true ones; topics are as for a step.

        Args:
            contacts: all of one instant.
            frame: of the contacts.
            stamp: that instant [s].
            prefix: of the topics, e.g. "truth".

        Raises:
            RecordingError: a stamp is out of the range of ROS.
            WritingError: the file can't be written.
        """
        when = recorded_stamp(stamp, self._epoch_ns)
        below = f"/{prefix.strip('/')}/"
        top = header(when, frame)
        self._write(*contact_message(contacts, top, self._epoch_ns, below), when)
        self._write(*marker_message(contacts, top, below), when)

    def flush(self) -> None:
        """Write all that came so far: it outlives this process, in a file without end.

        The disk takes it in a thread of its own, as a slow one must not stop a robot's loop.

        Raises:
            WritingError: the file can't be written.
        """
        storage: Any = self._open.storage
        with as_writing_error(self._path):
            if storage.chunk.bio.tell():
                storage.close_chunk()
            storage.bio.flush()
            if self._syncing is None or not self._syncing.is_alive():
                file = os.dup(storage.bio.fileno())
                self._syncing = threading.Thread(target=self._sync, args=(file,), daemon=True)
                self._syncing.start()
            if self._unsynced is not None:
                error, self._unsynced = self._unsynced, None
                raise error

    def _sync(self, file: int) -> None:
        try:
            _to_disk(file)
        except OSError as error:
            self._unsynced = error

    def _write(self, topic: str, sent: Message, stamp: int) -> None:
        kind = sent.__msgtype__
        channel = self._channels.get(topic) or self._opened(topic, kind, typestore=self._store)
        self._put(channel, kind, stamp, self._store.serialize_cdr(sent, kind))

    def _opened(self, topic: str, kind: str, **definition: Any) -> "Connection":
        """A new channel of a topic; the definition of its type is a typestore, or text and hash."""
        name = ros_name(topic)
        if any(other.topic == name for other in self._channels.values()):
            raise RecordingError(f"'{topic}' and another topic would both be {name} in ROS")
        quality = [_latched()] if name.split("/")[-1] in LATCHED else []
        channel = self._open.add_connection(name, kind, offered_qos_profiles=quality, **definition)
        self._channels[topic] = channel
        return channel

    def _put(self, channel: "Connection", kind: str, stamp: int, cdr: bytes | memoryview) -> None:
        if channel.msgtype != kind:
            raise RecordingError(
                f"the topic {channel.topic} holds {channel.msgtype}, and can't hold {kind}; "
                f"call one of the two sensors otherwise"
            )
        with as_writing_error(self._path):
            self._open.write(channel, stamp, cdr)

    @property
    def _open(self) -> "Writer":
        if self._bag is None:
            raise RecordingError("a McapWriter writes within its with statement only")
        return self._bag


@contextmanager
def _bag_that_becomes(path: Path) -> Iterator["Writer"]:
    """A bag of rosbags, which is a folder; at the end its one MCAP file becomes the file.

    Raises:
        WritingError: the file can't be written; what was written is kept beside it.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin

    final = path.absolute()
    with unfinished(path, is_folder=True) as folder:
        kind = writer_with_checksums()
        bag = kind(folder / BAG, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        written = bag.path / f"{BAG}.mcap"
        with kept_when_cut(written, path), ExitStack() as stack:
            yield stack.enter_context(bag)
            with as_writing_error(path):
                stack.close()
                _to_disk(os.open(written, os.O_RDONLY))
        with as_writing_error(path):
            os.replace(written, final)


def _to_disk(file: int) -> None:
    """Wait until the disk holds an open file, so that it outlives a loss of power; and close it."""
    try:
        os.fsync(file)
    finally:
        os.close(file)


def _latched() -> "Qos":
    """The quality of service of latched topics: late subscribers of `ros2 bag play` receive them.

    As of /tf_static and /robot_description in ROS 2: reliable and transient_local.
    """
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(*NEVER)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=KEPT,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )
