"""Checks of a robot's network: who is there, which ends do not match, whose clock is another."""

import os
import socket
import struct
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import product
from typing import Final, final

import numpy as np

from contactfusion.doctor.installation import Finding
from contactfusion.errors import RecordingError
from contactfusion.live.discovery import contents_of, mismatch
from contactfusion.live.transport import End, Quality, Transport, matches
from contactfusion.readings.poses import STATIC
from contactfusion.recordings.messages import defined, typestore
from contactfusion.recordings.ros.delivery import AHEAD_NS, BEHIND_NS, of_another_clock
from contactfusion.recordings.ros.topics import last
from contactfusion.terminal import say

LISTENED: Final = 3.0
"""How long others are discovered, and then how long their topics are listened to [s]."""
VARIABLES: Final = (
    "ROS_DOMAIN_ID",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_STATIC_PEERS",
    "RMW_IMPLEMENTATION",
    "CYCLONEDDS_URI",
)
"""What decides whom ROS 2 finds."""
ADDRESS, FLAGS = 0x8915, 0x8913
"""What Linux is asked for the address of a network interface, and for its flags."""
UP, MULTICAST = 0x1, 0x1000
"""Flags of network interfaces."""
COMPARE: Final = (
    "compare ROS_DOMAIN_ID here and there; where multicast is blocked, name peers in CYCLONEDDS_URI"
)


def check_network(transport: Transport, listened: float = LISTENED) -> bool:
    """Print what is on the network; a line that names a fault ends with what mends it.

    Args:
        transport: of the messages.
        listened: how long others are discovered, and then how long they are listened to [s].

    Returns:
        Whether anybody is there, all ends match, and all clocks agree with that of this machine.
    """
    environment = [f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ]
    say(f"environment: {', '.join(environment) or 'nothing of ROS is set'}")
    say(f"interfaces: {', '.join(interfaces()) or 'none is up'}")
    time.sleep(listened)
    ends = [end for end in transport.ends() if not end.ours]
    heard = _listen(transport, ends)
    time.sleep(listened)
    sound = True
    for finding in network_findings(ends, heard):
        say(f"  {'fault: ' if finding.core else ''}{finding}")
        sound = sound and not finding.core
    return sound


@final
class Heard:
    """The messages of a topic: when they arrived, and how long after their stamps."""

    def __init__(self, stamped: bool) -> None:
        self._stamped = stamped
        self.arrivals: list[int] = []
        """[ns since 1970]"""
        self.delays: list[int] = []
        """From stamp to arrival, of those that have a stamp [ns]."""

    def take(self, cdr: bytes, arrived: int) -> None:
        """Take note of a message."""
        self.arrivals.append(arrived)
        if self._stamped and len(cdr) >= 12:
            seconds, rest = struct.unpack_from("<iI" if cdr[1] else ">iI", cdr, 4)
            if stamp := seconds * 1_000_000_000 + rest:
                self.delays.append(arrived - stamp)

    def __str__(self) -> str:
        """Rate and delay."""
        if not self.arrivals:
            return "nothing came"
        span = (self.arrivals[-1] - self.arrivals[0]) / 1e9
        text = f"{(len(self.arrivals) - 1) / span:.1f} Hz" if span else "1 message"
        if self.delays:
            least, median, most = np.quantile(self.delays, (0.0, 0.5, 1.0)) / 1e9
            text += f", {median:.4f} s after its stamps ({least:.4f} to {most:.4f})"
        return text


def _listen(transport: Transport, ends: Sequence[End]) -> Mapping[str, Heard]:
    """Listen to all topics whose only type is known, by name."""
    heard: dict[str, Heard] = {}
    for topic, known in contents_of(ends).items():
        with suppress(RecordingError):  # what nothing defines is listed without a rate
            defined(known.msgtype)
            first = next(iter(typestore().fielddefs[known.msgtype][1]), None)
            heard[topic] = Heard(first is not None and first[1][1] == "std_msgs/msg/Header")
            reliable = all(e.quality.reliable for e in ends if e.writes and e.topic == topic)
            quality = Quality(reliable, last(topic) == STATIC)
            transport.listen(topic, known.msgtype, quality, heard[topic].take)
    return heard


def network_findings(ends: Sequence[End], heard: Mapping[str, Heard]) -> Iterator[Finding]:
    """The peers, then topic by topic its writers and readers, and what is wrong with them.

    Args:
        ends: of other processes.
        heard: what came, by topic.
    """
    peers = sorted({end.peer for end in ends})
    if not peers:
        yield Finding("no peer answers", COMPARE, core=True)
        return
    yield Finding(f"peers: {', '.join(peers)}")
    contents = contents_of(ends)
    for topic in sorted({end.topic for end in ends}):
        writers = [end for end in ends if end.topic == topic and end.writes]
        readers = [end for end in ends if end.topic == topic and not end.writes]
        msgtypes = ", ".join(sorted({end.msgtype for end in writers or readers}))
        kind = contents[topic].kind if topic in contents else None
        parts = [f"written by {_named(writers)}" if writers else "no writer"]
        parts += [f"read by {_named(readers)}"] if readers else []
        parts += [f"makes {kind.__name__}"] if kind is not None else []
        parts += [str(heard[topic])] if topic in heard else []
        yield Finding(f"{topic} ({msgtypes}): {'; '.join(parts)}")
        if why := mismatch(writers):
            yield Finding(f"{topic}: {why}", "install one definition on all machines", core=True)
        for writer, reader in product(writers, readers):
            yield from _pair_findings(writer, reader)
        if topic in heard and heard[topic].delays:
            ahead = -min(heard[topic].delays, key=abs)
            if not -BEHIND_NS <= ahead <= AHEAD_NS:
                yield Finding(f"{topic}: {of_another_clock(ahead)}", core=True)


def _pair_findings(writer: End, reader: End) -> Iterator[Finding]:
    """Why a reader does not hear a writer of its topic."""
    both = f"{writer.topic}: {reader.peer} does not hear {writer.peer}"
    if reader.msgtype != writer.msgtype:
        text = f"{both}, which writes {writer.msgtype}; it reads {reader.msgtype}"
        yield Finding(text, "give one of both another topic", core=True)
    elif not matches(writer.quality, reader.quality):
        text = (
            f"{both}, which offers {_words(writer.quality)}; it asks for {_words(reader.quality)}"
        )
        yield Finding(text, "give both the same quality of service", core=True)


def _named(ends: Sequence[End]) -> str:
    return ", ".join(sorted({f"{end.peer} ({_words(end.quality)})" for end in ends}))


def _words(quality: Quality) -> str:
    parts = ["reliable" if quality.reliable else "best effort"]
    parts += ["latched"] if quality.latched else []
    parts += [f"deadline {quality.deadline:g} s"] if quality.deadline is not None else []
    return ", ".join(parts)


def interfaces() -> Iterator[str]:
    """The network interfaces that are up, with their IPv4 addresses; without Linux their names."""
    if sys.platform != "linux":
        yield from (name for _, name in socket.if_nameindex())
        return
    import fcntl

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        for _, name in socket.if_nameindex():
            request = struct.pack("256s", name.encode()[:15])
            with suppress(OSError):  # one without an address
                (flags,) = struct.unpack_from("<H", fcntl.ioctl(asking, FLAGS, request), 16)
                address = socket.inet_ntoa(fcntl.ioctl(asking, ADDRESS, request)[20:24])
                if flags & UP:
                    without = "" if flags & MULTICAST else ", no multicast"
                    yield f"{name} ({address}{without})"
