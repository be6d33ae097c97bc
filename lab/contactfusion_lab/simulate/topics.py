"""What the nodes of a simulated robot send: readings as in recordings, and the truth of a push."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from threading import Condition
from typing import Final, NamedTuple, final

import numpy as np

from contactfusion.faults import Fault, Faults
from contactfusion.frames import PlanarPose, planar_pose
from contactfusion.live.transport import Quality, Send, Transport
from contactfusion.readings import Reading
from contactfusion.readings.messages import Message, Posting, header
from contactfusion.readings.point_cloud import cloud_message
from contactfusion.recordings.mcap import LATCHED
from contactfusion.recordings.messages import (
    reading_messages,
    recorded_stamp,
    ros_name,
    topic_of,
    typestore,
)
from contactfusion.run.recorder import TRUTH
from contactfusion.time import NANOSECONDS_PER_SECOND
from contactfusion_lab.scenes.facts import standing
from contactfusion_lab.scenes.push.bodies import ORIGIN_HEIGHT
from contactfusion_lab.scenes.push.scene import OBJECT
from contactfusion_lab.scenes.push.world import Touches, WorldState

BASE: Final = "base"
"""Name of the base in the truth."""
TOUCHES: Final = f"/{TRUTH}/touches"
"""The topic of the contact points of a cycle, in the frame of the base."""
STATE: Final = {
    f"/{TRUTH}/{BASE}": "geometry_msgs/msg/PoseStamped",
    f"/{TRUTH}/{OBJECT}": "geometry_msgs/msg/PoseStamped",
    TOUCHES: "sensor_msgs/msg/PointCloud2",
}
"""The topics of the truth that sensors depend on, with the types of their messages."""
COLUMNS = ("x", "y", "z", "normal_x", "normal_y", "normal_z", "force", "step")
"""The fields of a contact point: position [m], normal into the robot, force along it [N], and the
step of the physics in its cycle."""
INCOMPLETE = 10
"""Number of states of which parts may be awaited at a time."""


@final
class Publisher:
    """Sends messages; a topic is advertised with its first one.

    Args:
        transport: takes them.
        epoch_ns: the moment from which stamps of readings count [ns since 1970].
        faults: of the sensors.
        seed: of the faults.
    """

    def __init__(
        self, transport: Transport, epoch_ns: int, faults: Iterable[Fault] = (), seed: int = 0
    ) -> None:
        self._transport, self.epoch_ns = transport, epoch_ns
        self._faults = Faults(faults, seed)
        self._senders: dict[str, Send] = {}

    def seconds(self, stamp: int) -> float:
        """A stamp [ns since 1970] as readings have it [s]."""
        return (stamp - self.epoch_ns) / NANOSECONDS_PER_SECOND

    def readings(self, readings: Iterable[Reading]) -> None:
        """Send what the faults leave of readings, on the topics that a recording has them on."""
        for reading in itertools.chain.from_iterable(map(self._faults.apply, readings)):
            self._send(reading, "")

    def truth(self, reading: Reading) -> None:
        """Send what is true."""
        self._send(reading, TRUTH)

    def _send(self, reading: Reading, prefix: str) -> None:
        stamp = recorded_stamp(reading.stamp, self.epoch_ns)
        self.messages(reading_messages(reading, ros_name(topic_of(reading, prefix)), stamp))

    def messages(self, postings: Iterable[Posting]) -> None:
        """Send messages, each on its topic."""
        for topic, sent in postings:
            kind = sent.__msgtype__
            if topic not in self._senders:
                latched = topic.split("/")[-1] in LATCHED
                self._senders[topic] = self._transport.advertise(topic, kind, latched)
            self._senders[topic](typestore().serialize_cdr(sent, kind))


def state_messages(state: WorldState, stamp: int) -> Iterator[Posting]:
    """The truth that sensors depend on, as messages with their topics.

    Args:
        state: true poses, and the contact points of the last cycle.
        stamp: of the state [ns since 1970].
    """
    poses = {
        BASE: planar_pose(state.base, ORIGIN_HEIGHT),
        OBJECT: planar_pose(state.object, 0.0),
    }
    for pose in standing(0.0, "odom", poses):
        yield from reading_messages(pose, topic_of(pose, TRUTH), stamp)
    touches = state.touches
    rows = np.column_stack([touches.points, touches.normals, touches.forces, touches.steps])
    yield TOUCHES, cloud_message(header(stamp, BASE), COLUMNS, rows.astype("<f8"))


def state_of(parts: Mapping[str, Message]) -> WorldState:
    """The state whose messages have arrived, by topic."""
    base, pushed, touches = (parts[topic] for topic in STATE)
    rows = touches.data.view("<f8").reshape(-1, len(COLUMNS))
    felt = Touches(rows[:, 7], rows[:, :3], rows[:, 3:6], rows[:, 6])
    return WorldState(_planar(base.pose), _planar(pushed.pose), felt)


def _planar(pose: Message) -> PlanarPose:
    turn = pose.orientation
    yaw = math.remainder(2.0 * math.atan2(turn.z, turn.w), math.tau)
    return pose.position.x, pose.position.y, yaw


class Received(NamedTuple):
    """A state that has arrived.

    Attributes:
        stamp: of the state [ns since 1970].
        state: the truth.
        missed: number of states since the one that was taken before, which nothing takes.
    """

    stamp: int
    state: WorldState
    missed: int


@final
class StateListener:
    """Receives the truth, and keeps the newest state that is whole.

    Args:
        transport: of the messages.
    """

    def __init__(self, transport: Transport) -> None:
        self._parts: dict[int, dict[str, Message]] = {}
        self._newest: Received | None = None
        self._whole = Condition()
        for topic, msgtype in STATE.items():
            take = partial(self._take, topic, msgtype)
            transport.listen(topic, msgtype, Quality(reliable=True, latched=False), take)

    def take(self, timeout: float) -> Received | None:
        """The newest state; None where none arrives in time [s]."""
        with self._whole:
            self._whole.wait_for(lambda: self._newest, timeout)
            newest, self._newest = self._newest, None
            return newest

    def _take(self, topic: str, msgtype: str, cdr: bytes, arrived: int) -> None:
        sent: Message = typestore().deserialize_cdr(cdr, msgtype)
        stamp = sent.header.stamp.sec * NANOSECONDS_PER_SECOND + sent.header.stamp.nanosec
        parts = self._parts.setdefault(stamp, {})
        parts[topic] = sent
        if len(parts) == len(STATE):
            del self._parts[stamp]
            with self._whole:
                missed = 0 if self._newest is None else self._newest.missed + 1
                self._newest = Received(stamp, state_of(parts), missed)
                self._whole.notify()
        elif len(self._parts) > INCOMPLETE:
            del self._parts[min(self._parts)]
