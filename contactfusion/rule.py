"""The contracts of rules and condensations: likelihoods in, contacts out."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from contactfusion.contacts import Contact
from contactfusion.model import Model
from contactfusion.surface import Surface

if TYPE_CHECKING:
    from contactfusion.integrator.entries import Entries, Field, Source


class Rule(ABC):
    """A pure function over all live entries; built once.

    Args:
        config: the options, an instance of `Config`.
    """

    Config: ClassVar[type[Model]] = Model
    """The type of the options."""
    needs_places: ClassVar[bool] = False
    """Whether `Entries.positions` is to hold the places of hypotheses, and not only voxels."""
    gives_belief: ClassVar[bool] = False
    """Whether its `Field` holds a `Belief`, which some condensations need."""

    def __init__(self, config: Model) -> None:
        self.config = config

    @abstractmethod
    def fuse(
        self, entries: "Entries", sources: "Sequence[Source]", surface: Surface | None
    ) -> "Field":
        """The fused likelihood of every voxel of the entries; 0 where only null is alive.

        Args:
            entries: all live entries, lined up by voxel.
            sources: their sources, by ascending name.
            surface: the robot's surface now, in the grid's frame, for rules that use it.
        """


class Condensation(ABC):
    """A pure function from a field to contacts; built once.

    Args:
        config: the options, an instance of `Config`.
        tolerance: voxels at most this far apart belong to one contact [m].
    """

    Config: ClassVar[type[Model]] = Model
    """The type of the options."""
    needs_belief: ClassVar[bool] = False
    """Whether it looks at the places of a `Belief`, and not at voxels."""

    def __init__(self, config: Model, tolerance: float) -> None:
        self.config = config
        self.tolerance = tolerance

    @abstractmethod
    def condense(self, field: "Field", verdicts: NDArray[np.uint8]) -> Iterable[Contact]:
        """The contacts, the most likely first.

        Args:
            field: the fused likelihoods.
            verdicts: shape (m,), the code of each voxel's verdict; empty where `needs_belief`.
        """
