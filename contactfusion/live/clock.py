"""The clock of a running robot: that of this machine, or simulated time."""

import threading
import time
from collections.abc import Callable
from typing import Final, final

from contactfusion.errors import ConfigurationError
from contactfusion.live.transport import Quality, Transport
from contactfusion.readings.messages import Message
from contactfusion.recordings.messages import typestore
from contactfusion.time import NANOSECONDS_PER_SECOND

Clock = Callable[[], int]
"""The time now [ns since 1970], or of a simulation since its start."""
CLOCK: Final = "rosgraph_msgs/msg/Clock"
TOPIC: Final = "/clock"
BEGAN = time.time_ns() - time.monotonic_ns()
"""When the monotonic clock of this machine began [ns since 1970], as it was at the start."""


def machine_time() -> int:
    """The time of this machine [ns since 1970]; it does not jump where its clock is set."""
    return BEGAN + time.monotonic_ns()


@final
class SimulatedTime:
    """The time that a simulation publishes on /clock; it stands still in between.

    Args:
        transport: of the messages.
        patience: the longest wait for the first message [s].

    Raises:
        ConfigurationError: none comes in time.
    """

    def __init__(self, transport: Transport, patience: float) -> None:
        self._now, self._came = 0, threading.Event()
        transport.listen(TOPIC, CLOCK, Quality(False, False), self._hear)
        if not self._came.wait(patience):
            raise ConfigurationError(
                f"--sim-time: nothing came on {TOPIC} within {patience:g} s; without it the time "
                "of this machine counts"
            )

    def __call__(self) -> int:
        """The newest time [ns]."""
        return self._now

    def _hear(self, cdr: bytes, arrived: int) -> None:
        try:
            sent: Message = typestore().deserialize_cdr(cdr, CLOCK)
        except Exception:  # damaged, in one of many ways: the next one counts
            return
        self._now = sent.clock.sec * NANOSECONDS_PER_SECOND + sent.clock.nanosec
        self._came.set()
