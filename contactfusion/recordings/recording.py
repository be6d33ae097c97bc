"""The one interface of everything that holds readings."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping

from contactfusion.readings import Reading


class Recording(ABC):
    """A finite series of readings.

    Attributes:
        epoch_ns: the stamp of the first reading in the recording's own clock [ns]; readings count
            their seconds from there, so that float stamps lose nothing.
        end: the last stamp [s]; None where that is not known before all is read.
        topics: what it holds: for the name of each sensor the kind of its readings.
    """

    epoch_ns: int = 0
    end: float | None = None
    topics: Mapping[str, type[Reading]] = {}

    @abstractmethod
    def readings(self) -> Iterator[Reading]:
        """Give the readings in order of their stamps.

        Raises:
            RecordingError: the recording is truncated, or not what it says it is.
        """
