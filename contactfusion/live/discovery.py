"""What is on a robot's network: its topics, what can be read of them, and why others can't."""

from collections.abc import Sequence

from contactfusion.errors import RecordingError
from contactfusion.live.transport import End
from contactfusion.readings import DepthImage, Reading
from contactfusion.readings.depth_image import CAMERA_INFO, INFO
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.messages import defined, type_hash
from contactfusion.recordings.ros.contents import SEVERAL
from contactfusion.recordings.ros.topics import Topic, parent
from contactfusion.recordings.step_messages import OURS


def written_by_others(ends: Sequence[End]) -> dict[str, list[End]]:
    """The writers of each topic that this process does not write."""
    written: dict[str, list[End]] = {}
    for end in ends:
        if end.writes and not end.ours:
            written.setdefault(end.topic, []).append(end)
    return dict(sorted(written.items()))


def contents_of(ends: Sequence[End]) -> dict[str, Topic]:
    """The topics that others write, by name.

    An image is one of depth where its topic says so and a camera_info stands beside it.
    """
    written = written_by_others(ends)
    types = {
        name: SEVERAL.join(sorted({end.msgtype for end in group}))
        for name, group in written.items()
    }
    codecs = installed_kinds().by_message()

    def kind(name: str) -> type[Reading] | None:
        codec = codecs.get(types[name])
        if codec is None or name.startswith(OURS) or mismatch(written[name]):
            return None
        if codec.kind is DepthImage:
            beside = types.get(f"{parent(name)}/{INFO}") == CAMERA_INFO
            return DepthImage if beside and "depth" in name else None
        return codec.kind

    return {
        name: Topic(name, types[name], 0, kind(name), len(group)) for name, group in written.items()
    }


def mismatch(writers: Sequence[End]) -> str:
    """Why messages of the writers of a topic can't be read, as a clause; else empty."""
    readable = installed_kinds().by_message()
    types = sorted({end.msgtype for end in writers})
    if len(types) > 1 and any(msgtype in readable for msgtype in types):
        return f"it has writers of several types, {', '.join(types)}"
    for end in writers:
        try:
            known = type_hash(end.msgtype, defined(end.msgtype))
        except RecordingError:
            continue
        if end.type_hash and end.type_hash != known and end.msgtype in readable:
            return (
                f"its {end.msgtype} is another than that of ROS 2 Jazzy: its hash is "
                f"{end.type_hash}, not {known}"
            )
    return ""
