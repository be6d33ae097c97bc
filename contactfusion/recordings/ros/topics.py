"""How each topic of a recording of ROS is heard: decided once, before the first message."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, final

from contactfusion.readings import DepthImage, ObjectPose, Reading, Transform
from contactfusion.recordings.messages import Message
from contactfusion.recordings.ros.images import COLOUR, INFO, MASK, Beside
from contactfusion.recordings.ros.readings import (
    CAMERA_INFO,
    IMAGE,
    MAKERS,
    POSE,
    Maker,
    object_pose,
    stamp_of,
    transform,
)

STATIC = "tf_static"
"""The last part of topics whose transforms hold at all times."""


class Part(NamedTuple):
    """What one reading is made of.

    Attributes:
        stamp: that of its header [ns].
        clock: parts of one topic and clock should come in the order of their stamps.
        message: the message, or a transform in it.
    """

    stamp: int
    clock: str
    message: Message


class Listener(ABC):
    """What makes readings of the messages of one topic.

    Attributes:
        kind: what readings it makes, or None when it only helps another listener.
        is_static: whether its readings hold at all times.
    """

    kind: type[Reading] | None = None
    is_static: bool = False

    @abstractmethod
    def hear(self, message: Message) -> Iterable[Part]:
        """The parts of a message of which readings are to be made."""

    @abstractmethod
    def reading(self, part: Part, stamp: float) -> Reading:
        """Make the reading of a part.

        Args:
            part: what `hear` gave.
            stamp: that of the reading [s].

        Raises:
            RecordingError: the message holds no reading.
            InvalidReadingError: it holds values that no sensor can have given.
        """


@final
class Stamped(Listener):
    """Makes one reading of each message that has a header."""

    def __init__(self, sensor: str, kind: type[Reading], make: Maker) -> None:
        self.kind, self._sensor, self._make = kind, sensor, make

    def hear(self, message: Message) -> Iterable[Part]:
        """The whole message."""
        return (Part(stamp_of(message), "", message),)

    def reading(self, part: Part, stamp: float) -> Reading:
        """Make the reading of a message."""
        frame = part.message.header.frame_id.removeprefix("/")
        return self._make(part.message, {"stamp": stamp, "frame": frame, "sensor": self._sensor})


@final
class Transforms(Listener):
    """Makes a reading of each transform of tf2_msgs/TFMessage."""

    kind = Transform

    def __init__(self, sensor: str, is_static: bool) -> None:
        self._sensor, self.is_static = sensor, is_static

    def hear(self, message: Message) -> Iterable[Part]:
        """Its transforms; those of one child frame have one clock."""
        return [Part(stamp_of(one), one.child_frame_id, one) for one in message.transforms]

    def reading(self, part: Part, stamp: float) -> Reading:
        """Make the reading of a transform."""
        at = {
            "stamp": stamp,
            "frame": part.message.header.frame_id.removeprefix("/"),
            "sensor": self._sensor,
            "static": self.is_static,
        }
        return transform(part.message, at)


@final
class Camera(Listener):
    """Makes readings of depth images; what is beside them is heard by `Side`."""

    kind = DepthImage

    def __init__(self, sensor: str) -> None:
        self._sensor, self.beside = sensor, Beside()

    def hear(self, message: Message) -> Iterable[Part]:
        """The whole image."""
        return (Part(stamp_of(message), "", message),)

    def reading(self, part: Part, stamp: float) -> Reading:
        """Make the reading of an image, with all that was heard beside it by now."""
        frame = part.message.header.frame_id.removeprefix("/")
        at = {"stamp": stamp, "frame": frame, "sensor": self._sensor}
        return self.beside.image(part.message, part.stamp, at)


@final
class Side(Listener):
    """Hears what is beside the depth images of cameras, and makes no readings."""

    def __init__(self, name: str, cameras: Collection[Camera]) -> None:
        self._name, self._cameras = name, cameras

    def hear(self, message: Message) -> Iterable[Part]:
        """Pass it on to the cameras."""
        for camera in self._cameras:
            camera.beside.hear(self._name, stamp_of(message), message)
        return ()

    def reading(self, part: Part, stamp: float) -> Reading:
        """Make nothing: there are no parts."""
        raise AssertionError("there are no parts to make readings of")


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes:
        name: the topic.
        msgtype: the type of its messages as ROS 2 calls it; several, joined by "and", if it has.
        count: how many messages there are.
        kind: what readings are made of them, or None.
        publishers: how many nodes sent them, as far as the file tells.
    """

    name: str
    msgtype: str
    count: int
    kind: type[Reading] | None
    publishers: int


def listeners(
    sensors: Mapping[str, Collection[str]], contents: Mapping[str, Topic]
) -> dict[str, Listener]:
    """What hears the topics of sensors, and those beside cameras, by topic.

    Args:
        sensors: readable topics by the names of sensors.
        contents: all topics of the recording.
    """
    found: dict[str, Listener] = {}
    cameras: dict[str, list[Camera]] = {}
    for sensor, topic in ((sensor, topic) for sensor, group in sensors.items() for topic in group):
        listener = found[topic] = _listener(sensor, contents[topic])
        if isinstance(listener, Camera):
            cameras.setdefault(parent(topic), []).append(listener)
    for folder, heard in cameras.items():
        for name, msgtype in ((INFO, CAMERA_INFO), (COLOUR, IMAGE), (MASK, IMAGE)):
            beside = contents.get(f"{folder}/{name}")
            if beside and beside.msgtype == msgtype and beside.name not in found:
                found[beside.name] = Side(name, heard)
    return found


def _listener(sensor: str, topic: Topic) -> Listener:
    if topic.kind is Transform:
        return Transforms(sensor, is_static=last(topic.name) == STATIC)
    if topic.kind is DepthImage:
        return Camera(sensor)
    if topic.msgtype == POSE:
        return Stamped(sensor, ObjectPose, object_pose(last(topic.name)))
    return Stamped(sensor, *MAKERS[topic.msgtype])


def parent(topic: str) -> str:
    """A topic without its last part, e.g. "/camera" of "/camera/depth"."""
    return topic.rpartition("/")[0]


def last(topic: str) -> str:
    """The last part of a topic."""
    return topic.rpartition("/")[2]
