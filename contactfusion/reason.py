"""Reasons: what speaks for or against a contact, or keeps a source from speaking, in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from contactfusion.arrays import FloatArray


class Why(StrEnum):
    """Why there is a contact, or none; why a source says nothing."""

    CONTACT = "contact"
    NULLED = "nulled"
    BELOW_THRESHOLD = "below_threshold"
    SUPPORT_ONLY = "support_only"
    TOO_FEW_VOXELS = "too_few_voxels"
    IMPROBABLE = "improbable"
    NOT_CONDENSED = "not_condensed"
    NOTHING = "nothing"
    EXPIRED = "expired"
    WITHDRAWN = "withdrawn"
    NEVER_CAME = "never_came"
    SILENT = "silent"
    FOUND_NOTHING = "found_nothing"
    ELSEWHERE = "elsewhere"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Reason:
    """What speaks for or against a contact.

    Attributes:
        why: its kind, for programs; a plug-in may have its own.
        sentence: for people, without a full stop.
        source: that causes it; "" when several do.
        values: its numbers by name: likelihoods, shares and masses have no unit, and names that end
            in `_s` or `_m` say theirs.
    """

    why: str
    sentence: str
    source: str = ""
    values: Mapping[str, float] = field(default_factory=dict)


def millimetres(metres: float) -> str:
    """A distance as it is read: mm under 10 cm, then cm, then m."""
    if metres < 0.1:
        return f"{metres * 1000.0:.1f} mm"
    return f"{metres * 100.0:.0f} cm" if metres < 1.0 else f"{metres:.1f} m"


def place_words(place: Sequence[float] | FloatArray) -> str:
    """A place [m] as text."""
    x, y, z = (float(value) for value in place)
    return f"({x:.3f}, {y:.3f}, {z:.3f}) m"


def counted(count: int, singular: str) -> str:
    """A number with what it counts."""
    return f"{count} {singular}" if count == 1 else f"{count} {singular}s"
