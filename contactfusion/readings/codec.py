"""The contract of a kind of reading: one class that holds all that has to be known of it."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from enum import StrEnum
from typing import Any, ClassVar, Generic

from contactfusion.readings.canvas import Canvas
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.messages import Message, Posting, define, message
from contactfusion.readings.reading import At, R, Reading
from contactfusion.readings.values import Values


class Role(StrEnum):
    """What readings of a kind are in a replay."""

    SENSED = "sensed"
    """Measured in the frame of a sensor, without whose pose they mean nothing."""
    CONTEXT = "context"
    """The state of robot or world."""
    FRAMES = "frames"
    """Poses of frames, which are always read."""


class Codec(ABC, Generic[R]):
    """All that has to be known of one kind of reading; a subclass for each kind.

    One instance serves all readings, so that it keeps nothing of any. What is not said otherwise is
    optional.

    Attributes:
        name: that of the kind in configurations; required.
        kind: the class of the readings; required.
        role: what they are in a replay.
        alone: whether one topic alone may report them. Of what is sensed a generator takes one
            topic, unless they are alone: then all that take them share it. Of context all topics
            are read, or the one that may.
        use: what they are for beside generators, in a few words.
        messages: the types of ROS messages that they are read from, e.g. "my_msgs/msg/Sound"; the
            first one is written. Empty: none.
        definition: that of the first type in .msg, where neither ROS 2 nor this project has it.
        topic_field: the field that the last part of a topic holds, as in /tracker/box; then the
            sensor is called like the part above. Empty: none.
        settings: the fields that describe the sensor, and that it does not measure.
        Columns: the columns of a log that make a reading; None: a log can't hold them.
        values: how faults change them.
    """

    name: ClassVar[str]
    kind: ClassVar[type[Reading]]
    role: ClassVar[Role] = Role.SENSED
    alone: ClassVar[bool] = False
    use: ClassVar[str] = ""
    messages: ClassVar[tuple[str, ...]] = ()
    definition: ClassVar[str] = ""
    topic_field: ClassVar[str] = ""
    settings: ClassVar[tuple[str, ...]] = ()
    Columns: ClassVar[type[ColumnsConfig] | None] = None
    values: ClassVar[Values[Any]] = Values()

    @abstractmethod
    def example(self, stamp: float, scale: float) -> R:
        """A plausible reading, as the conformance kit gives it to generators.

        Args:
            stamp: its stamp [s].
            scale: other scales make other values; 1 to 1.5.
        """

    def from_message(self, message: Message, at: At) -> R:
        """The reading of a message of one of the types in `messages`.

        Args:
            message: the message; `__msgtype__` is its type.
            at: the fields that the message does not hold: stamp, frame and sensor, the
                `topic_field`, and what stands beside the message.

        Raises:
            RecordingError: the message holds no reading.
            InvalidReadingError: it holds values that no sensor can have given.
        """
        raise NotImplementedError  # only asked where there are `messages`, which require it

    def to_message(self, reading: R, top: Message) -> Message:
        """The message of a reading, of the first type in `messages`.

        Args:
            reading: the reading.
            top: its header, a std_msgs/Header.
        """
        raise NotImplementedError  # only asked where there are `messages`, which require it

    def postings(self, reading: R, topic: str, top: Message) -> Iterator[Posting]:
        """The messages of a reading, each with its topic; usually one.

        Args:
            reading: the reading.
            topic: where it goes.
            top: its header.
        """
        yield topic, self.to_message(reading, top)

    def topic(self, reading: R, prefix: str) -> tuple[str, ...]:
        """The parts of the topic of a reading.

        Args:
            reading: the reading.
            prefix: comes first, e.g. "truth"; may be empty.
        """
        if not self.topic_field:
            return prefix, reading.sensor or self.name
        return prefix, reading.sensor or ("" if prefix else self.name), *self.whose(reading)

    def whose(self, reading: R) -> tuple[str, ...]:
        """The names that tell apart readings of one sensor: of joints, of a frame, of an object."""
        return (getattr(reading, self.topic_field),) if self.topic_field else ()

    def draw(self, canvas: Canvas, reading: R) -> None:
        """Draw a reading; a kind that does not say how is not drawn."""

    @property
    def is_drawn(self) -> bool:
        """Whether the kind says how its readings are drawn."""
        return type(self).draw is not Codec.draw

    def message(self, **fields: object) -> Message:
        """A message of the first type in `messages`, of all its fields."""
        if self.definition:
            define(self.messages[0], self.definition)
        return message(self.messages[0], **fields)
