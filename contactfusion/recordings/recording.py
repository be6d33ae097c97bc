"""The one interface of everything that holds readings."""

from collections.abc import Iterator

from contactfusion.robot_state import transforms_ahead
from contactfusion.stream import Arrival, Stream, arrival_of


class Recording(Stream):
    """A finite series of readings; its transforms arrive ahead of what needs them."""

    def arrivals(self) -> Iterator[Arrival]:
        """The readings at their stamps, each transform a second before them."""
        return map(arrival_of, transforms_ahead(self.readings()))
