"""Readings from MCAP files that ROS 2 tools, or this project, wrote (extra `record`)."""

import heapq
from collections.abc import Callable, Iterator
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from pydantic import Field

from contactfusion.errors import ContactFusionError, RecordingError, name_hint
from contactfusion.files import require_file
from contactfusion.model import Model
from contactfusion.readings import PointCloud, Reading
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.messages import Message, typestore
from contactfusion.recordings.point_clouds import points_of
from contactfusion.recordings.recording import Recording
from contactfusion.time import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Reader


def _point_cloud(message: Message, at: dict[str, Any]) -> Reading:
    return PointCloud(points=points_of(message), **at)


MAKERS: dict[str, Callable[[Message, dict[str, Any]], Reading]] = {
    "sensor_msgs/msg/PointCloud2": _point_cloud,
}
"""What makes a reading of a message of each type, given its stamp, frame and sensor."""


class McapConfig(Model):
    """An MCAP file."""

    file: Path
    """The file."""
    sensors: dict[str, str] = Field(default_factory=dict)
    """Topics by the names of their sensors, and no others are read; when empty, all that can be
    read are, and a sensor is called like its topic without the first slash."""


@final
class McapRecording(Recording):
    """The readings of an MCAP file in the profile of ROS 2; of messages, `PointCloud2` is read.

    The stamp and the frame of a reading are those of its header. Headers that are up to a second
    out of order are sorted; a message is only held for so long, so long files need no more memory.

    Args:
        config: the file and the topics.
        folder: where a relative file name starts.

    Raises:
        DependencyError: rosbags is not installed.
        RecordingError: the file is missing or cut off, or a topic is not there or can't be read.
    """

    def __init__(self, config: McapConfig, folder: Path = Path()) -> None:
        self._path, self._wanted = folder / config.file, config.sensors
        self._store = typestore()
        require_file(self._path, RecordingError)
        stamps = (stamp for stamp, _, _ in self._messages())
        first = next(stamps, 0)
        # what comes later than this can't have an earlier stamp than what came
        near = takewhile(lambda stamp: stamp <= first + LONGEST_FALL, stamps)
        self.epoch_ns = min((first, *near))

    def readings(self) -> Iterator[Reading]:
        """Give the readings in order of their stamps; of one stamp, as they lie in the file."""
        held: list[tuple[int, int, Reading]] = []
        latest = self.epoch_ns
        for number, (stamp, connection, message) in enumerate(self._messages()):
            latest = max(latest, stamp)
            if stamp < latest - LONGEST_FALL:
                raise RecordingError(
                    f"{self._path}, {connection.topic}: time falls by "
                    f"{(latest - stamp) / NANOSECONDS_PER_SECOND:g} s"
                )
            heapq.heappush(held, (stamp, number, self._reading(stamp, connection, message)))
            while held[0][0] < latest - LONGEST_FALL:
                yield heapq.heappop(held)[2]
        while held:
            yield heapq.heappop(held)[2]

    def _reading(self, stamp: int, connection: "Connection", message: Message) -> Reading:
        topic = connection.topic
        names = [name for name, of in self._wanted.items() if of == topic]
        at = {
            "stamp": (stamp - self.epoch_ns) / NANOSECONDS_PER_SECOND,
            "frame": message.header.frame_id,
            "sensor": names[0] if names else topic.removeprefix("/"),
        }
        try:
            return MAKERS[connection.msgtype](message, at)
        except ContactFusionError as error:
            raise RecordingError(f"{self._path}, {topic} at {stamp} ns: {error}") from None

    def _messages(self) -> Iterator[tuple[int, "Connection", Message]]:
        """Give stamp [ns], connection and message, as they lie in the file."""
        from rosbags.rosbag2 import Reader

        try:
            with Reader(self._path) as bag:
                for connection, _, raw in bag.messages(self._connections(bag)):
                    message: Any = self._store.deserialize_cdr(raw, connection.msgtype)
                    time = message.header.stamp
                    yield time.sec * NANOSECONDS_PER_SECOND + time.nanosec, connection, message
        except ContactFusionError:
            raise
        except Exception as error:  # rosbags meets damage with errors of many kinds
            raise RecordingError(f"{self._path} can't be read: {error}") from None

    def _connections(self, bag: "Reader") -> list["Connection"]:
        kinds = {connection.topic: connection.msgtype for connection in bag.connections}
        for topic in self._wanted.values():
            if topic not in kinds:
                hint = name_hint(topic, kinds, "topics")
                raise RecordingError(f"{self._path} has no topic '{topic}'; {hint}")
            if kinds[topic] not in MAKERS:
                raise RecordingError(
                    f"{self._path}: {topic} holds {kinds[topic]}; "
                    f"what can be read: {', '.join(MAKERS)}"
                )
        topics = self._wanted.values() or kinds
        found = [one for one in bag.connections if one.topic in topics and one.msgtype in MAKERS]
        if not found:
            held = ", ".join(f"{topic} ({kind})" for topic, kind in kinds.items()) or "nothing"
            raise RecordingError(
                f"{self._path} holds nothing that can be read, which is {', '.join(MAKERS)}; "
                f"it holds: {held}"
            )
        return found
