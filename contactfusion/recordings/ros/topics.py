"""Listeners of the topics of a recording of ROS: chosen once, before the first message."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, final

from contactfusion.errors import RecordingError
from contactfusion.readings import DepthImage, Reading, Transform
from contactfusion.readings.codec import Codec
from contactfusion.readings.depth_image import (
    CAMERA_INFO,
    COLOUR,
    DEPTH,
    IMAGE,
    INFO,
    MASK,
    colour_of,
    require_depth,
)
from contactfusion.readings.messages import Message
from contactfusion.readings.poses import STATIC
from contactfusion.readings.reading import At
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.time import NANOSECONDS_PER_SECOND


class Part(NamedTuple):
    """The part of a message that makes one reading.

    Attributes:
        stamp: that of its header [ns].
        clock: parts of one topic and clock should come in the order of their stamps.
        message: the message, or a transform in it.
    """

    stamp: int
    clock: str
    message: Message


class Listener(ABC):
    """Makes readings of the messages of one topic.

    Attributes:
        kind: type of its readings, or None when it only serves another listener.
        is_static: whether its readings hold at all times.
    """

    kind: type[Reading] | None = None
    is_static: bool = False

    @abstractmethod
    def parts(self, message: Message) -> Iterable[Part]:
        """The parts of a message of which readings are to be made."""

    @abstractmethod
    def reading(self, part: Part, stamp: float) -> Reading:
        """Make the reading of a part.

        Args:
            part: of `parts`.
            stamp: that of the reading [s].

        Raises:
            RecordingError: the message holds no reading.
            InvalidReadingError: it holds values that no sensor can have given.
        """


@final
class Stamped(Listener):
    """Makes one reading of each message that has a header.

    Args:
        sensor: the name of the sensor.
        topic: the topic.
        codec: of the kind of the readings.
    """

    def __init__(self, sensor: str, topic: str, codec: Codec[Any]) -> None:
        self.kind, self._sensor, self._codec = codec.kind, sensor, codec
        self._guard = installed_kinds().guard(codec)
        self._named = {codec.topic_field: last(topic)} if codec.topic_field else {}

    def parts(self, message: Message) -> Iterable[Part]:
        """The whole message."""
        return (Part(stamp_of(message), "", message),)

    def reading(self, part: Part, stamp: float) -> Reading:
        """Make the reading of a message."""
        at = {**_at(part, stamp, self._sensor), **self._named}
        with self._guard:
            reading: Reading = self._codec.from_message(part.message, at)
        return reading


@final
class Transforms(Listener):
    """Makes a reading of each transform of tf2_msgs/TFMessage."""

    kind = Transform

    def __init__(self, sensor: str, codec: Codec[Any], is_static: bool) -> None:
        self._sensor, self._codec, self.is_static = sensor, codec, is_static

    def parts(self, message: Message) -> Iterable[Part]:
        """Its transforms; those of one child frame have one clock."""
        return [Part(stamp_of(pose), pose.child_frame_id, pose) for pose in message.transforms]

    def reading(self, part: Part, stamp: float) -> Reading:
        """Make the reading of a transform."""
        at = {**_at(part, stamp, self._sensor), "static": self.is_static}
        reading: Reading = self._codec.from_message(part.message, at)
        return reading


@final
class Camera(Listener):
    """Makes readings of depth images; `Side` receives their camera, colours and mask."""

    kind = DepthImage

    def __init__(self, sensor: str, codec: Codec[Any]) -> None:
        self._sensor, self._codec, self.beside = sensor, codec, Beside()

    def parts(self, message: Message) -> Iterable[Part]:
        """The whole image."""
        return (Part(stamp_of(message), "", message),)

    def reading(self, part: Part, stamp: float) -> Reading:
        """Make the reading of an image, with the camera, colours and mask received by now."""
        require_depth(part.message)
        beside = self.beside.fields(part.message, part.stamp)
        at = {**_at(part, stamp, self._sensor), **beside}
        reading: Reading = self._codec.from_message(part.message, at)
        return reading


class Beside:
    """Camera, colours and masks beside the depth images of a camera, of the last two seconds."""

    def __init__(self) -> None:
        self._parts: dict[str, dict[int, Message]] = {INFO: {}, COLOUR: {}, MASK: {}}

    def keep(self, name: str, stamp: int, message: Message) -> None:
        """Keep a message; the last one is kept however old it is.

        Args:
            name: `INFO`, `COLOUR` or `MASK`.
            stamp: that of its header [ns].
            message: sensor_msgs/CameraInfo for `INFO`, else sensor_msgs/Image.
        """
        part = self._parts[name]
        part[stamp] = message
        for old in [kept for kept in part if kept < stamp - 2 * LONGEST_FALL]:
            del part[old]

    def fields(self, image: Message, stamp: int) -> At:
        """The fields of a depth image beside its depths.

        The camera is that reported last; colours and mask are of the same stamp and size.

        Args:
            image: sensor_msgs/Image.
            stamp: that of its header [ns].

        Raises:
            RecordingError: no camera is known, or it is of another size.
        """
        infos, size = self._parts[INFO], (image.height, image.width)
        if not infos:
            raise RecordingError("no camera_info was there by then")
        info = infos[max((kept for kept in infos if kept <= stamp), default=min(infos))]
        if (info.height, info.width) not in ((0, 0), size):
            raise RecordingError(
                f"its camera_info is of {info.height} x {info.width} pixels, "
                f"and the image has {size[0]} x {size[1]}"
            )
        colour, mask = (self._of_size(name, stamp, size) for name in (COLOUR, MASK))
        return {
            "intrinsics": info.k.reshape(3, 3),
            "colour": None if colour is None else colour_of(colour),
            "mask": None if mask is None else colour_of(mask)[:, :, 0] > 0,
        }

    def _of_size(self, name: str, stamp: int, size: tuple[int, int]) -> Message | None:
        image = self._parts[name].get(stamp)
        return None if image is None or (image.height, image.width) != size else image


@final
class Side(Listener):
    """Receives camera, colours or mask beside the depth images of cameras; makes no readings."""

    def __init__(self, name: str, cameras: Collection[Camera]) -> None:
        self._name, self._cameras = name, cameras

    def parts(self, message: Message) -> Iterable[Part]:
        """Pass it on to the cameras."""
        for camera in self._cameras:
            camera.beside.keep(self._name, stamp_of(message), message)
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
        kind: type of the readings that are made of them, or None.
        publishers: number of nodes that sent them, as far as the file names them.
    """

    name: str
    msgtype: str
    count: int
    kind: type[Reading] | None
    publishers: int


def listeners(
    sensors: Mapping[str, Collection[str]], contents: Mapping[str, Topic]
) -> dict[str, Listener]:
    """The listeners of the topics of sensors, and of those beside cameras, by topic.

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
    for folder, siblings in cameras.items():
        for name, msgtype in ((INFO, CAMERA_INFO), (COLOUR, IMAGE), (MASK, IMAGE)):
            beside = contents.get(f"{folder}/{name}")
            if beside and beside.msgtype == msgtype and beside.name not in found:
                found[beside.name] = Side(name, siblings)
    return found


def _listener(sensor: str, topic: Topic) -> Listener:
    codec = installed_kinds().by_message()[topic.msgtype]
    if codec.kind is Transform:
        return Transforms(sensor, codec, is_static=last(topic.name) == STATIC)
    if codec.kind is DepthImage:
        return Camera(sensor, codec)
    return Stamped(sensor, topic.name, codec)


def usual_sensor(topic: Topic) -> str:
    """The name of the sensor of a topic that is read, unless a configuration gives another."""
    above = parent(topic.name).removeprefix("/")
    codec = installed_kinds().by_message()[topic.msgtype]
    is_depth = topic.kind is DepthImage and last(topic.name) == DEPTH
    return above if above and (codec.topic_field or is_depth) else topic.name.removeprefix("/")


def stamp_of(message: Message) -> int:
    """The stamp of the header of a message [ns]."""
    return header_stamp(message.header)


def header_stamp(header: Message) -> int:
    """The stamp of a std_msgs/Header [ns]."""
    stamp = header.stamp
    nanoseconds: int = stamp.sec * NANOSECONDS_PER_SECOND + stamp.nanosec
    return nanoseconds


def _at(part: Part, stamp: float, sensor: str) -> At:
    frame = part.message.header.frame_id.removeprefix("/")
    return {"stamp": stamp, "frame": frame, "sensor": sensor}


def parent(topic: str) -> str:
    """A topic without its last part, e.g. "/camera" of "/camera/depth"."""
    return topic.rpartition("/")[0]


def last(topic: str) -> str:
    """The last part of a topic."""
    return topic.rpartition("/")[2]
