"""What makes readings of the messages of one topic."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable
from typing import NamedTuple, final

from contactfusion.readings import DepthImage, Reading, Transform
from contactfusion.recordings.messages import Message
from contactfusion.recordings.ros.images import Beside
from contactfusion.recordings.ros.readings import Maker, stamp_of, transform


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
        """Give the parts of a message of which readings are to be made."""

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
        """Give the whole message."""
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
        """Give its transforms; those of one child frame have one clock."""
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
        """Give the whole image."""
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
        """Tell the cameras."""
        for camera in self._cameras:
            camera.beside.hear(self._name, stamp_of(message), message)
        return ()

    def reading(self, part: Part, stamp: float) -> Reading:
        """Make nothing: there are no parts."""
        raise AssertionError("there are no parts to make readings of")
