"""How each topic of a recording of ROS is heard: decided once, before the first message."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from contactfusion.readings import DepthImage, ObjectPose, Reading, Transform
from contactfusion.recordings.ros.images import COLOUR, INFO, MASK
from contactfusion.recordings.ros.listeners import Camera, Listener, Side, Stamped, Transforms
from contactfusion.recordings.ros.readings import CAMERA_INFO, IMAGE, MAKERS, POSE, object_pose

STATIC = "tf_static"
"""The last part of topics whose transforms hold at all times."""


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


class Stream(NamedTuple):
    """Topics of one sensor that hold readings of one kind."""

    kind: type[Reading]
    topics: tuple[str, ...]


def listeners(
    sensors: Mapping[str, Collection[str]], contents: Mapping[str, Topic]
) -> dict[str, Listener]:
    """Give what hears the topics of sensors, and those beside cameras, by topic.

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
    """Give a topic without its last part, e.g. "/camera" of "/camera/depth"."""
    return topic.rpartition("/")[0]


def last(topic: str) -> str:
    """Give the last part of a topic."""
    return topic.rpartition("/")[2]
