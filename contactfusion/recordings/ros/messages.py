"""The messages of a bag for those who hear their topics, and for a tap that hears them all."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from contactfusion.recordings.messages import Message, typestore
from contactfusion.recordings.ros.channels import Channel
from contactfusion.recordings.ros.files import Bag
from contactfusion.recordings.ros.order import Heard, TopicTally


class RawMessage(NamedTuple):
    """A message as it lies in a recording.

    Attributes:
        topic: its topic.
        msgtype: its type as ROS 2 calls it, e.g. "sensor_msgs/msg/Imu".
        definition: that of its type in .msg of ROS 2; empty when the file does not tell.
        log_stamp_ns: when it was logged [ns].
        cdr: its bytes in the encoding of ROS 2.
    """

    topic: str
    msgtype: str
    definition: str
    log_stamp_ns: int
    cdr: bytes


Tap = Callable[[RawMessage], None]
"""Hears every message, once, as they lie in the file."""


def messages(
    bag: Bag,
    topics: Mapping[str, Heard],
    start_ns: int | None = None,
    stop_ns: int | None = None,
    tally: Mapping[str, TopicTally] | None = None,
    tap: Tap | None = None,
    taps_all: bool = True,
) -> Iterator[tuple[Heard, int, Message]]:
    """Give the messages of topics that are heard, with the stamps of the log [ns].

    Args:
        bag: an open one.
        topics: those that are heard.
        start_ns: only what was logged then or later [ns].
        stop_ns: only what was logged earlier [ns].
        tally: where messages are counted, of all topics; None: of those that are heard.
        tap: hears every message.
        taps_all: of every topic, or of those that are heard.

    Raises:
        RecordingError: at the end, when a file is cut off or damaged.
    """
    counts = tally or {topic: one.tally for topic, one in topics.items()}
    channels = [one for one in bag.channels if (tap and taps_all) or one.topic in topics]
    routes = {one: (topics.get(one.topic), counts[one.topic], _decoder(one)) for one in channels}
    told = {one: (one.topic, one.msgtype, one.definition()) for one in channels if tap}
    for channel, logged, raw in bag.messages(channels, start_ns, stop_ns):
        heard, count, decode = routes[channel]
        count.messages += 1
        cdr = _tried(channel.cdr, raw, count)
        if cdr is None:
            continue
        message = _tried(decode, cdr, count) if heard else None
        if heard and message is not None:
            yield heard, logged, message
        if tap:  # not of what ended the reading, such as a clock that jumped
            tap(RawMessage(*told[channel], logged, bytes(cdr)))


def _decoder(channel: Channel) -> Callable[[Any], Message]:
    """Give what makes a message of the CDR of a channel whose type is standard."""
    decode, msgtype = typestore().deserialize_cdr, channel.msgtype
    # of a view: what is large is not copied
    return lambda cdr: decode(memoryview(cdr), msgtype)


def _tried(call: Callable[[Any], Any], raw: Any, tally: TopicTally) -> Any:
    """Give what is made of bytes, or count that nothing can be and give None."""
    try:
        return call(raw)
    except Exception as error:  # rosbags meets what is wrong with errors of many kinds
        tally.cannot_read(error)
        return None
