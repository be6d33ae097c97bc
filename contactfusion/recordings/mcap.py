"""MCAP: readings, contacts and commands in one file that ROS 2 tools read (extra `record`)."""

import os
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self, final

from contactfusion.contacts import Contact
from contactfusion.errors import RecordingError
from contactfusion.files import kept_when_cut, make_folder, telling
from contactfusion.pipeline import Step
from contactfusion.readings import Reading, Transform
from contactfusion.readings.messages import Message, header, message
from contactfusion.readings.poses import MOVING, STATIC, transforms_message
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
"""Topics that end with these words are told once, and hold from then on."""
VERSION: Final = 8
"""Of the metadata of rosbag2: the newest that ROS 2 Iron reads, too."""
BAG = "recording"
"""What the file is called within itself: two of equal content are equal, whatever their names."""
KEPT = 100
"""So many messages of a topic are kept for those who come late."""
NEVER = 9223372036, 854775807
"""What ROS 2 calls an endless time [s, ns]."""


@final
class McapWriter:
    """Writes a recording as one MCAP file: profile ros2, CDR, message definitions inside.

    Use as a context manager: the file appears whole at its end, or not at all after an exception;
    then one that was there before stays.
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
        """Begin the file, under a name of its own.

        Raises:
            WritingError: the disk does not take it.
        """
        self._channels.clear()
        self._drawn = True  # a viewer may show what another recording drew
        self._file = _bag_that_becomes(self._path)
        with telling(self._path):
            self._bag = self._file.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file under its name, or remove what there is of it.

        Raises:
            WritingError: the disk does not take it.
        """
        assert self._file
        self._bag = None
        with telling(self._path):
            self._file.__exit__(kind, error, trace)

    def reading(self, reading: Reading, prefix: str = "") -> None:
        """Write a reading, on the topic of its sensor; odometry goes to /tf, too.

        Args:
            reading: any kind of reading.
            prefix: what the topic begins with, e.g. "truth"; what has one does not go to /tf.

        Raises:
            RecordingError: there is no message for it, its topic is taken by something else, or its
                stamp lies where ROS has none.
            PluginError: the plug-in of its kind makes no message.
            WritingError: the disk does not take it.
        """
        topic = topic_of(reading, prefix)
        if topic.startswith(OURS):
            raise RecordingError(
                f"{reading.label} can't be recorded on {topic}, as what begins with {OURS} is "
                f"written by steps; call the sensor otherwise"
            )
        stamp = recorded_stamp(reading.stamp, self._epoch_ns)
        for place, told in reading_messages(reading, topic, stamp):
            if place != f"/{MOVING}" or not prefix:
                self._write(place, told, stamp)

    def step(self, step: Step) -> None:
        """Write the contacts and the command of a step.

        Below /contactfusion, contacts go to /contacts, and for viewers to /contacts/markers as
        spheres with their likelihoods and to /contacts/voxels as a cloud of those with evidence; of
        steps with nothing to draw only the first is drawn. A command goes to /command, and its
        twist to /cmd_vel.

        Raises:
            RecordingError: a stamp lies where ROS has none.
        """
        stamp = recorded_stamp(step.stamp, self._epoch_ns)
        fusion, drawn = step.fusion, self._drawn
        self._drawn = bool(fusion.contacts) or bool(is_drawn(fusion).any())
        for topic, told in step_messages(step, self._epoch_ns, drawn or self._drawn):
            self._write(topic, told, stamp)

    def static(self, frames: Sequence[Transform], stamp: float = 0.0) -> None:
        """Write where frames stand for good, as one message on /tf_static.

        Args:
            frames: the poses of frames in their parents.
            stamp: from when on they are known [s].

        Raises:
            RecordingError: the stamp lies where ROS has none.
            WritingError: the disk does not take it.
        """
        if frames:
            when = recorded_stamp(stamp, self._epoch_ns)
            self._write(f"/{STATIC}", transforms_message(frames, when), when)

    def robot_description(self, urdf: str, stamp: float = 0.0) -> None:
        """Write a robot's URDF, the text itself, on /robot_description.

        Raises:
            RecordingError: the stamp [s] lies where ROS has none.
            WritingError: the disk does not take it.
        """
        when = recorded_stamp(stamp, self._epoch_ns)
        self._write(f"/{DESCRIPTION}", message("std_msgs/String", data=urdf), when)

    def text(self, topic: str, text: str, stamp: float = 0.0) -> None:
        """Write a text, as std_msgs/String; who comes late to the topic hears it, too.

        Raises:
            RecordingError: the stamp [s] lies where ROS has none.
            WritingError: the disk does not take it.
        """
        when = recorded_stamp(stamp, self._epoch_ns)
        self._write(topic, message("std_msgs/String", data=text), when)

    def copy(self, raw: "RawMessage") -> None:
        """Write a message of another recording as it is.

        Raises:
            RecordingError: its file does not define its type, or its topic is taken by something
                else.
            WritingError: the disk does not take it.
        """
        channel = self._channels.get(raw.topic)
        if channel is None:
            definition = raw.definition or defined(raw.msgtype)
            channel = self._opened(
                raw.topic,
                raw.msgtype,
                msgdef=definition,
                rihs01=type_hash(raw.msgtype, definition),
            )
        self._put(channel, raw.msgtype, raw.log_stamp_ns, raw.cdr)

    def contacts(
        self, contacts: tuple[Contact, ...], frame: str, stamp: float, prefix: str
    ) -> None:
        """Write contacts that no step gave, such as the true ones; topics are as for a step.

        Args:
            contacts: all of one instant.
            frame: theirs.
            stamp: that instant [s].
            prefix: what the topics begin with, e.g. "truth".

        Raises:
            RecordingError: a stamp lies where ROS has none.
            WritingError: the disk does not take it.
        """
        when = recorded_stamp(stamp, self._epoch_ns)
        below = f"/{prefix.strip('/')}/"
        top = header(when, frame)
        self._write(*contact_message(contacts, top, self._epoch_ns, below), when)
        self._write(*marker_message(contacts, top, below), when)

    def _write(self, topic: str, told: Message, stamp: int) -> None:
        kind = told.__msgtype__
        channel = self._channels.get(topic) or self._opened(topic, kind, typestore=self._store)
        self._put(channel, kind, stamp, self._store.serialize_cdr(told, kind))

    def _opened(self, topic: str, kind: str, **definition: Any) -> "Connection":
        """Begin a topic; the definition of its type is a typestore, or text and hash."""
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
        with telling(self._path):
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
        WritingError: the disk takes no more; what it took is kept beside the file.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    make_folder(path.parent)
    with TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
        bag = Writer(Path(folder) / BAG, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        written = bag.path / f"{BAG}.mcap"
        with kept_when_cut(written, path), ExitStack() as stack:
            yield stack.enter_context(bag)
            with telling(path):
                stack.close()
        os.replace(written, path)


def _latched() -> "Qos":
    """The quality of service of what is told once: `ros2 bag play` tells it late comers, too.

    It is that of /tf_static and /robot_description in ROS 2: reliable and transient_local.
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
