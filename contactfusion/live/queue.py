"""What arrives on a robot, in its order, until the loop takes it: bounded, counted."""

import threading
from collections import Counter, deque
from typing import NamedTuple, final

from contactfusion.live.transport import DEPTH

MOST_BYTES = 2**28
"""The messages of a topic that wait take no more memory [bytes], unless it is a single one."""


class Packet(NamedTuple):
    """A message as it arrived.

    Attributes:
        topic: its topic.
        cdr: its bytes.
        arrived: [ns since 1970].
    """

    topic: str
    cdr: bytes
    arrived: int


@final
class Queue:
    """Passes packets, and anything else, from threads that receive to the loop.

    Of a topic that comes faster than the loop takes it, the oldest packets are dropped.
    """

    def __init__(self) -> None:
        self._order = deque[object]()
        """Names of topics, in whose order packets are taken, and what is no packet."""
        self._packets: dict[str, deque[Packet]] = {}
        self._bytes = Counter[str]()
        self._filled = threading.Condition()
        self.dropped: Counter[str] = Counter()
        """Number of packets that were dropped, by topic."""

    def __len__(self) -> int:
        return len(self._order)

    def packet(self, topic: str, cdr: bytes, arrived: int) -> None:
        """Add a message of a topic, and when it arrived [ns since 1970]."""
        with self._filled:
            packets = self._packets.setdefault(topic, deque())
            kept = len(packets)
            while packets and (len(packets) >= DEPTH or self._bytes[topic] + len(cdr) > MOST_BYTES):
                self._bytes[topic] -= len(packets.popleft().cdr)
            if lost := kept - len(packets):  # it takes the turn of the oldest
                self.dropped[topic] += lost
            else:
                self._order.append(topic)
            packets.append(Packet(topic, cdr, arrived))
            self._bytes[topic] += len(cdr)
            self._filled.notify()

    def put(self, what: object) -> None:
        """Add what is no packet: a change, or what the loop shall call."""
        with self._filled:
            self._order.append(what)
            self._filled.notify()

    def take(self, timeout: float) -> object | None:
        """The next packet, or what else was added; None where nothing comes in time [s]."""
        with self._filled:
            if not self._order and not self._filled.wait_for(lambda: self._order, timeout):
                return None
            while self._order:
                first = self._order.popleft()
                if not isinstance(first, str):
                    return first
                if self._packets[first]:  # several small messages may have made room for a large
                    packet = self._packets[first].popleft()
                    self._bytes[first] -= len(packet.cdr)
                    return packet
            return None
