"""Topics of a recording of ROS, and the sensors as which they are read."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

from contactfusion.errors import RecordingError, name_hint
from contactfusion.readings import DepthImage, Reading, Transform
from contactfusion.readings.depth_image import CAMERA_INFO, DEPTHS, IMAGE, INFO
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.ouster import CONVERT
from contactfusion.recordings.recording import SensorTopics
from contactfusion.recordings.ros.channels import Channel
from contactfusion.recordings.ros.files import Bag
from contactfusion.recordings.ros.topics import Topic, parent, usual_sensor
from contactfusion.recordings.step_messages import OURS

TRUTH = "/truth/"
"""The prefix of topics with ground truth, which no sensor measures."""
PACKETS = "/PacketMsg"
"""The suffix of the types of Ouster's raw packets."""
SEVERAL = " and "
"""The separator of the types of a topic that has several."""


def contents_of(bag: Bag) -> dict[str, Topic]:
    """All topics of an open bag, by name."""
    by_topic = sorted(bag.channels, key=lambda channel: channel.topic)
    by_name = groupby(by_topic, key=lambda channel: channel.topic)
    groups = {name: list(group) for name, group in by_name}
    types = {
        name: SEVERAL.join(sorted({channel.msgtype for channel in group}))
        for name, group in groups.items()
    }
    return {
        name: Topic(
            name,
            types[name],
            sum(channel.count for channel in group),
            None if name.startswith(OURS) else _kind(bag, name, group, types),
            len({channel.publisher for channel in group}),
        )
        for name, group in groups.items()
    }


def streams_of(
    sensors: Mapping[str, Sequence[str]], contents: Mapping[str, Topic]
) -> dict[str, SensorTopics]:
    """Topics of one sensor and kind, by the name of the sensor.

    Where topics of other kinds are of the same sensor, as the images of a camera that also gives
    clouds, they have entries under their own names.

    Args:
        sensors: topics by the names of sensors.
        contents: all topics.
    """
    found: dict[str, SensorTopics] = {}
    for sensor, topics in sensors.items():
        for topic in topics:
            kind = contents[topic].kind
            assert kind is not None
            group = found.setdefault(sensor, SensorTopics(kind, ()))
            name = sensor if group.kind is kind else topic.removeprefix("/")
            before = found[name].topics if name in found else ()
            found[name] = SensorTopics(kind, (*before, topic))
    return found


def topics_of(
    path: Path, contents: Mapping[str, Topic], wanted: Mapping[str, Sequence[str]]
) -> dict[str, tuple[str, ...]]:
    """The topics to read by the names of their sensors, transforms among them.

    Args:
        path: the recording, for sentences.
        contents: all its topics.
        wanted: topics, or default names of sensors, by sensor; when empty, all topics that can be
            read, but for ground truth.

    Raises:
        RecordingError: a topic does not exist, can't be read, or is wanted twice; or none can be
            read.
    """
    usual: dict[str, tuple[str, ...]] = {}
    for name, topic in contents.items():
        if topic.kind and not name.startswith(TRUTH):
            sensor = usual_sensor(topic)
            usual[sensor] = (*usual.get(sensor, ()), name)
    if not wanted:
        _require_something(path, contents)
        return usual
    found: dict[str, tuple[str, ...]] = {}
    taken: dict[str, str] = {}
    for sensor, group in wanted.items():
        found[sensor] = tuple(topic for name in group for topic in _meant(name, contents, usual))
        for full in found[sensor]:
            _require_readable(path, contents, full)
            if taken.setdefault(full, sensor) != sensor:
                raise RecordingError(
                    f"'{taken[full]}' and '{sensor}' are both {full}; name it once"
                )
    for sensor, names in usual.items():
        if contents[names[0]].kind is Transform and names[0] not in taken:
            found[names[0] if sensor in found else sensor] = names
    return found


def _meant(
    name: str, contents: Mapping[str, Topic], usual: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """The topics of a name: itself, or all of the sensor with this default name."""
    is_topic = name in contents or name.removeprefix("/") not in usual
    return (name,) if is_topic else usual[name.removeprefix("/")]


def _kind(
    bag: Bag, name: str, group: list[Channel], types: Mapping[str, str]
) -> type[Reading] | None:
    """The kind of the readings of a topic; None where it has none."""
    msgtype = types[name]
    codec = installed_kinds().by_message().get(msgtype)
    if codec is None or not all(channel.standard for channel in group):
        return None
    if codec.kind is DepthImage:
        beside = types.get(f"{parent(name)}/{INFO}")
        return DepthImage if beside == CAMERA_INFO and _holds_depth(bag, group) else None
    return codec.kind


def _holds_depth(bag: Bag, group: list[Channel]) -> bool:
    """Whether the first image is a depth image."""
    try:
        for channel, _, raw in bag.messages(group):
            image = typestore().deserialize_cdr(channel.cdr(raw), channel.msgtype)
            return getattr(image, "encoding", "") in DEPTHS
    except Exception:  # of many kinds; it is reported when the topic is read
        return False
    return False


def _require_readable(path: Path, contents: Mapping[str, Topic], name: str) -> None:
    if name not in contents:
        hint = name_hint(name, contents, "topics")
        raise RecordingError(f"{path} has no topic '{name}'; {hint}")
    topic = contents[name]
    if SEVERAL in topic.msgtype:
        raise RecordingError(f"{path}: {name} holds messages of two types, {topic.msgtype}")
    if topic.kind is None:
        raise RecordingError(
            f"{path}: {name} holds {topic.msgtype}{why_unread(topic)}; "
            f"what can be read: {', '.join(_readable())}"
        )


def why_unread(topic: Topic) -> str:
    """Why a topic of a readable type can't be read, as a clause; empty for other types."""
    if topic.msgtype == IMAGE:
        return f", and it is no image of depth, or has no {INFO} beside it"
    if topic.name.startswith(OURS) and topic.msgtype in installed_kinds().by_message():
        return ", which contactfusion wrote of what it did"
    return (
        ", but what the file calls so is something else"
        if topic.msgtype in installed_kinds().by_message()
        else ""
    )


def _readable() -> tuple[str, ...]:
    """All types of which readings are made."""
    types = installed_kinds().by_message()
    beside = {IMAGE: f"{IMAGE} (of depth, with {CAMERA_INFO} beside it)"}
    return tuple(beside.get(msgtype, msgtype) for msgtype in types)


def _require_something(path: Path, contents: Mapping[str, Topic]) -> None:
    for name, topic in contents.items():
        types = topic.msgtype.split(SEVERAL)
        if len(types) > 1 and any(msgtype in _readable() for msgtype in types):
            _require_readable(path, contents, name)
    if any(topic.kind for topic in contents.values()):
        return
    if any(topic.msgtype.endswith(PACKETS) for topic in contents.values()):
        raise RecordingError(f"{path} holds raw packets of Ouster's; convert it by: {CONVERT}")
    held = ", ".join(f"{name} ({topic.msgtype})" for name, topic in contents.items()) or "nothing"
    readable = ", ".join(_readable())
    raise RecordingError(
        f"{path} holds nothing that can be read, which is {readable}; it holds: {held}"
    )
