"""The one interface of all scenes: what a simulated robot does while a pipeline listens."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from contactfusion.contacts import Contact
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import ObjectPose, Reading

Hear = Callable[[Reading], None]
"""Who hears every reading before the pipeline does."""


@dataclass(frozen=True)
class Verdict:
    """What really happened in a scene, beside what was found.

    Attributes:
        truth: for a summary; JSON.
        sentences: for people.
    """

    truth: dict[str, Any]
    sentences: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Facts:
    """What is true in a scene at one instant, and no sensor tells.

    Attributes:
        stamp: [s].
        frame: of the contacts.
        contacts: where the robot is touched; each of likelihood 1.
        objects: where the objects stand, by name.
    """

    stamp: float
    frame: str
    contacts: tuple[Contact, ...]
    objects: tuple[ObjectPose, ...]


class Scene(ABC):
    """A scene can be run once."""

    @abstractmethod
    def run(self, pipeline: Pipeline, hear: Hear) -> Iterator[Step]:
        """Let a pipeline listen, and act where it has a controller; give its steps.

        Raises:
            ContactFusionError: the scene cannot be played, or the pipeline does not fit it.
        """

    @abstractmethod
    def facts(self) -> Facts:
        """Tell what is true now; while the scene runs, and when it is over."""

    @abstractmethod
    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """Tell the truth, when all is over.

        Args:
            pipeline: which listened.
            last: its last step.
        """


def heard(readings: Iterable[Reading], hear: Hear) -> Iterator[Reading]:
    """Give readings on, after somebody has heard them."""
    for reading in readings:
        hear(reading)
        yield reading
