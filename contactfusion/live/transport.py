"""The contract of transports: topics of ROS 2 as serialised messages, in and out."""

import os
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

from contactfusion.errors import ConfigurationError

Take = Callable[[bytes, int], object]
"""Takes a message in CDR, and when it arrived [ns since 1970]; called in a thread of its own."""
Send = Callable[[bytes | memoryview], None]
"""Sends a message in CDR."""
DEPTH = 1000
"""Number of messages of a topic that a reader keeps until they are taken."""
RESULTS = 10
"""Number of messages of a topic that a writer keeps, for readers that lag behind or come late."""


class Quality(NamedTuple):
    """The quality of service of one end of a topic.

    Attributes:
        reliable: what is lost on the way is sent again; else it is lost.
        latched: late readers receive what was sent last (transient local).
        deadline: the longest time between two messages that is offered or asked for [s], or None.
    """

    reliable: bool
    latched: bool
    deadline: float | None = None


class End(NamedTuple):
    """A reader or a writer of a topic, as others see it.

    Attributes:
        topic: as ROS calls it, e.g. "/wrist/wrench".
        msgtype: the type of its messages as ROS 2 calls it, e.g. "sensor_msgs/msg/Imu"; of what is
            no type of ROS, as DDS calls it.
        writes: whether it is a writer.
        quality: of its service.
        type_hash: of its type, "RIHS01_…"; empty where it names none.
        peer: who has it: its process and machine where they are known, else its participant.
        ours: whether it is an end of this process.
    """

    topic: str
    msgtype: str
    writes: bool
    quality: Quality
    type_hash: str
    peer: str
    ours: bool


class Transport(ABC):
    """Topics of ROS 2 as serialised messages."""

    def __init__(self) -> None:
        self.unsent: Counter[str] = Counter()
        """Number of messages that could not be sent, by topic."""

    @abstractmethod
    def ends(self) -> Sequence[End]:
        """All readers and writers that are known now, also those of this process."""

    @abstractmethod
    def listen(self, topic: str, msgtype: str, quality: Quality, take: Take) -> None:
        """Receive the messages of a topic from now on.

        Args:
            topic: as ROS calls it.
            msgtype: as ROS 2 calls it.
            quality: asked for; a reader hears no writer that offers less.
            take: takes each message.

        Raises:
            RecordingError: nothing that is installed defines the type.
        """

    @abstractmethod
    def ignore(self, topic: str) -> None:
        """Receive no messages of a topic any longer."""

    @abstractmethod
    def advertise(self, topic: str, msgtype: str, latched: bool = False) -> Send:
        """What sends messages on a topic, reliably; those that can't be sent are counted.

        Args:
            topic: as ROS calls it.
            msgtype: as ROS 2 calls it.
            latched: whether late readers receive the last `RESULTS` messages.

        Raises:
            RecordingError: nothing that is installed defines the type.
        """

    @abstractmethod
    def close(self) -> None:
        """Leave the network."""


def domain_number(domain: int | None) -> int:
    """The number of a domain; None: that of `ROS_DOMAIN_ID`, or 0.

    Raises:
        ConfigurationError: there is no such domain.
    """
    text = (os.environ.get("ROS_DOMAIN_ID") or "0") if domain is None else str(domain)
    if not text.isdecimal() or int(text) > 232:
        raise ConfigurationError(f"the ROS domain '{text}' is no number from 0 to 232")
    return int(text)


def matches(offered: Quality, asked: Quality) -> bool:
    """Whether a reader hears a writer: it may not ask for more than is offered."""
    late = offered.deadline is None or (asked.deadline or 0.0) < offered.deadline
    return (
        offered.reliable >= asked.reliable
        and offered.latched >= asked.latched
        and not (asked.deadline is not None and late)
    )
