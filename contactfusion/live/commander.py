"""Commands on their way to a robot: zero when what they follow from is not fresh, or at the end."""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Final, final

import numpy as np

from contactfusion.controller import FAULT, Command
from contactfusion.live.clock import Clock
from contactfusion.live.config import LiveConfig
from contactfusion.live.transport import Send, Transport
from contactfusion.readings.messages import Message, header, message, twist
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.step_messages import OURS

HEARTBEAT: Final = f"{OURS}heartbeat"
"""The topic of a std_msgs/Header, sent as long as the loop comes round."""
PERIOD = 0.05
"""The time between two beats, and between two zero commands [s]."""
LAST = 3
"""Number of zero commands at the end."""
CALM = 1.0
"""So long commands go on before that is noted: what alternates is noted once [s]."""
STILL = np.zeros(3)


@final
class Commander:
    """Sends commands, and watches the loop from a thread of its own.

    Use as a context manager: however it ends, the last commands are zero.

    Args:
        transport: what takes them.
        config: their topics, and how long the loop may hang.
        moves: whether there is a controller whose commands are sent.
        clock: the time now [ns].
        note: takes a sentence when the commands become zero, and when they no longer are.
    """

    def __init__(
        self,
        transport: Transport,
        config: LiveConfig,
        moves: bool,
        clock: Clock,
        note: Callable[[str], object],
    ) -> None:
        self._transport, self._config, self._clock, self._note = transport, config, clock, note
        self._beat = transport.advertise(HEARTBEAT, "std_msgs/msg/Header")
        self._senders: dict[str, Send] = {}
        if moves:  # a receiver finds it before the first command
            kind = "TwistStamped" if config.stamped else "Twist"
            self._senders[config.twist] = transport.advertise(
                config.twist, f"geometry_msgs/msg/{kind}"
            )
        self._frame = ""
        self._joints: tuple[str, ...] = ()
        self._round = time.monotonic()
        self.stopped = ""
        """Why commands are zero, as a clause; empty where they are not."""
        self._noted = False
        """Whether it was noted last that commands are zero."""
        self._zero_at = self._round
        """When they were zero last."""
        self._lock = threading.RLock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def __enter__(self) -> "Commander":
        """Begin to watch."""
        self._thread.start()
        return self

    def __exit__(self, *raised: object) -> None:
        """Send the last commands, which are zero."""
        self._ended.set()
        self._thread.join()
        for _ in range(LAST):
            self._zero()

    def comes_round(self, stale: str) -> None:
        """Take note that the loop comes round, and of what is not fresh.

        Args:
            stale: why the pipeline's belief is not fresh, as a clause; empty where it is.
        """
        with self._lock:
            self._round = time.monotonic()
            self._stop(stale)

    def send(self, command: Command | None) -> None:
        """Send a command; zero in its place as long as something is not fresh, or it is a fault."""
        if command is None:
            return
        with self._lock:
            if command.mode == FAULT:
                self._zero()
                return
            moving = command.twist
            if moving is not None:
                self._frame = moving.frame
                still = twist(STILL, STILL)
                self._send_twist(still if self.stopped else twist(moving.linear, moving.angular))
            if command.joint_velocities is not None:
                self._joints = tuple(command.joint_velocities)
                self._send_joints(
                    dict.fromkeys(self._joints, 0.0) if self.stopped else command.joint_velocities
                )

    def _watch(self) -> None:
        """Beat while the loop comes round; zero while it does not, or something is not fresh."""
        while not self._ended.wait(PERIOD):
            with self._lock:
                hangs = time.monotonic() - self._round
                if hangs > self._config.hangs_after:
                    self._stop(f"the loop has not come round for {hangs:.2f} s")
                else:
                    self._beat(_cdr(header(self._clock(), "")))
                if self.stopped:
                    self._zero()

    def _stop(self, why: str) -> None:
        now = time.monotonic()
        if why:
            self._zero_at = now
            if not self._noted:
                self._noted = True
                self._note(f"commands are zero: {why}")
        elif self._noted and now - self._zero_at > CALM:
            self._noted = False
            self._note("commands go on")
        if why and not self.stopped:
            self.stopped = why
            self._zero()
        self.stopped = why

    def _zero(self) -> None:
        """Command zero to all that was ever commanded."""
        if self._config.twist in self._senders:
            self._send_twist(twist(STILL, STILL))
        if self._joints:
            self._send_joints(dict.fromkeys(self._joints, 0.0))

    def _send_twist(self, moving: Message) -> None:
        if self._config.stamped:
            top = header(self._clock(), self._frame)
            moving = message("geometry_msgs/TwistStamped", header=top, twist=moving)
        self._send(self._config.twist, moving)

    def _send_joints(self, velocities: Mapping[str, float]) -> None:
        self._send(
            self._config.joint_velocities,
            message(
                "sensor_msgs/JointState",
                header=header(self._clock(), ""),
                name=list(velocities),
                position=np.empty(0),
                velocity=np.fromiter(velocities.values(), np.float64),
                effort=np.empty(0),
            ),
        )

    def _send(self, topic: str, sent: Message) -> None:
        if topic not in self._senders:
            self._senders[topic] = self._transport.advertise(topic, sent.__msgtype__)
        self._senders[topic](_cdr(sent))


def _cdr(sent: Message) -> bytes:
    return bytes(typestore().serialize_cdr(sent, sent.__msgtype__))
