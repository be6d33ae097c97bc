"""The contracts of rules and condensations: likelihoods in, contacts out, and why."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.model import Model
from contactfusion.reason import Reason
from contactfusion.surface import Surface

if TYPE_CHECKING:
    from contactfusion.integrator.entries import Entries, Field, Source


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """A place in the hypothesis space with the voxels around it.

    Attributes:
        position: shape (3,) [m].
        reach: how far it reaches [m].
        inside: shape (m,), which voxels of the field lie in it.
        best: the row of the likeliest voxel in it with more than null, or `NONE`.
        contacts: those that are reported, the most likely first.
    """

    position: FloatArray
    reach: float
    inside: NDArray[np.bool_]
    best: int
    contacts: Sequence[Contact] = ()


class Rule(ABC):
    """A pure function over all live entries; built once.

    Args:
        config: the options, an instance of `Config`.
    """

    Config: ClassVar[type[Model]] = Model
    """The type of the options."""
    needs_places: ClassVar[bool] = False
    """Whether `Entries.positions` is to hold the places of hypotheses, and not only voxels."""
    finds_members: ClassVar[bool] = False
    """Whether its `Field` holds the contacts of a set, which some condensations need."""

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

    def explain(self, field: "Field", row: int) -> str:
        """How the likelihood of a voxel comes of those of the sources, in the rule's own terms.

        Args:
            field: what the rule fused.
            row: of the voxel, in which at least one source takes part.

        Returns:
            A line without a full stop; empty where nothing needs to be said. By default what each
            source gave, and its share.
        """
        return by_sources(field, row, _shares)


class Condensation(ABC):
    """A pure function from a field to contacts; built once.

    Args:
        config: the options, an instance of `Config`.
        tolerance: voxels at most this far apart belong to one contact [m].
    """

    Config: ClassVar[type[Model]] = Model
    """The type of the options."""
    looks_at_voxels: ClassVar[bool] = True
    """Whether contacts come of voxels over the threshold."""
    needs_members: ClassVar[bool] = False
    """Whether it needs a rule whose `Field` holds the contacts of a set."""

    def __init__(self, config: Model, tolerance: float) -> None:
        self.config = config
        self.tolerance = tolerance

    @abstractmethod
    def condense(self, field: "Field", verdicts: NDArray[np.uint8]) -> Iterable[Contact]:
        """The contacts, the most likely first: `Contacts` where they are made of voxels.

        Of plain contacts it is not known which voxels they are made of: those within three standard
        deviations count as theirs.

        Args:
            field: the fused likelihoods.
            verdicts: shape (m,), the code of each voxel's verdict; empty where it looks at none.
        """

    def explain(self, field: "Field", around: Neighbourhood, contact: Contact | None) -> str:
        """How the likelihood of a contact comes about, in the condensation's own terms.

        Args:
            field: what was condensed.
            around: the voxels of the contact, or a place without one.
            contact: None: there is none.

        Returns:
            A line without a full stop. By default empty: the likelihood is that of the likeliest
            voxel, which the rule explains.
        """
        return ""

    def objections(
        self, field: "Field", verdicts: NDArray[np.uint8], around: Neighbourhood
    ) -> Sequence[Reason]:
        """Why there is no contact at a place, the main reason first.

        Args:
            field: what was condensed.
            verdicts: shape (m,), the code of each voxel's verdict.
            around: the place; no contact reaches into it.

        Returns:
            By default nothing: then the verdict on the likeliest voxel is the reason.
        """
        return ()


Formula = Callable[[Sequence[float], float], str]
"""Words on what the sources gave, and what it fused to."""


def by_sources(field: "Field", row: int, formula: Formula) -> str:
    """The names of the sources that take part in a voxel, and a formula of what they gave.

    Args:
        field: what a rule fused.
        row: of the voxel.
        formula: what the sources gave, in the order of their names, and the fused likelihood.

    Returns:
        Empty where one source alone gave the fused likelihood.
    """
    given, fused = field.given(row), float(field.likelihoods[row])
    likelihoods = [*given.values()]
    if len(given) == 1 and abs(likelihoods[0] - fused) < 1e-6:
        return ""
    return f"{' and '.join(given)}: {formula(likelihoods, fused)}"


def _shares(given: Sequence[float], fused: float) -> str:
    total = sum(given) or 1.0
    parts = ", ".join(f"{p:.2f} (share {p / total:.0%})" for p in given)
    return f"{parts} fuse to {fused:.2f}"
