"""A robot's network within one process, for tests of what stands on a transport."""

from collections import defaultdict
from collections.abc import Sequence
from functools import partial
from typing import Any, final

import numpy as np

from contactfusion.live.transport import End, Quality, Send, Take, Transport
from contactfusion.readings.messages import Message, header, message, vector
from contactfusion.recordings.messages import defined, type_hash, typestore

RELIABLE = Quality(True, False)
MILLISECOND = 1_000_000
SECOND = 1_000_000_000
START = 1_700_000_000_000_000_000
"""When clocks of tests start [ns since 1970]."""


@final
class Wire(Transport):
    """Topics that tests write, and what is sent on others."""

    def __init__(self) -> None:
        super().__init__()
        self.writers: list[End] = []
        self.takes: dict[str, Take] = {}
        self.asked: dict[str, Quality] = {}
        self.sent: dict[str, list[Message]] = defaultdict(list)
        self.closed = False

    def writer(self, topic: str, msgtype: str, **other: Any) -> None:
        """Another node writes a topic from now on."""
        known = type_hash(msgtype, defined(msgtype))
        end = End(topic, msgtype, True, RELIABLE, known, "peer", ours=False)
        self.writers.append(end._replace(**other))

    def say(self, topic: str, sent: Message, arrived: int) -> None:
        """A message arrives [ns since 1970]."""
        self.takes[topic](bytes(typestore().serialize_cdr(sent, sent.__msgtype__)), arrived)

    def ends(self) -> Sequence[End]:
        return list(self.writers)

    def listen(self, topic: str, msgtype: str, quality: Quality, take: Take) -> None:
        assert topic not in self.takes, "a reader more is a message more"
        self.takes[topic], self.asked[topic] = take, quality

    def ignore(self, topic: str) -> None:
        del self.takes[topic]

    def advertise(self, topic: str, msgtype: str, latched: bool = False) -> Send:
        return partial(self._keep, topic, msgtype)

    def close(self) -> None:
        self.closed = True

    def _keep(self, topic: str, msgtype: str, cdr: bytes | memoryview) -> None:
        self.sent[topic].append(typestore().deserialize_cdr(cdr, msgtype))


@final
class Clock:
    """Time that passes only when somebody says so [ns since 1970]."""

    def __init__(self) -> None:
        self.now = START

    def __call__(self) -> int:
        return self.now


def wrench(stamp: int, fz: float = -5.0, frame: str = "probe") -> Message:
    """A push on the top of the probe, beside its middle: geometry_msgs/WrenchStamped."""
    force, torque = np.array([0.0, 0.0, fz]), np.array([0.0, -0.02 * fz, 0.0])
    screw = message("geometry_msgs/Wrench", force=vector(force), torque=vector(torque))
    return message("geometry_msgs/WrenchStamped", header=header(stamp, frame), wrench=screw)


def transforms(stamp: int, parent: str, child: str) -> Message:
    """The pose of a frame, without rotation: tf2_msgs/TFMessage."""
    still = message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    origin = message("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
    placed = message(
        "geometry_msgs/TransformStamped",
        header=header(stamp, parent),
        child_frame_id=child,
        transform=message("geometry_msgs/Transform", translation=origin, rotation=still),
    )
    return message("tf2_msgs/TFMessage", transforms=[placed])


PROBE: dict[str, Any] = {
    "surface": {
        "frame": "probe",
        "shapes": [{"shape": "sphere", "radius": 0.05}],
        "spacing": 0.004,
    },
    "generators": {"wrist": {"type": "force_torque", "sensor": "wrist", "sign": "on_robot"}},
    "integrator": {"frame": "probe"},
    "cycle": {"on": "wrist"},
}
"""A sphere on a wrist sensor."""
