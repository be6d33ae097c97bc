"""Contacts without a source: counterfactuals of a fusion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.integrator.fusion import Fusion

Pair = tuple[int, int, float]


@dataclass(frozen=True, slots=True)
class Without:
    """The counterfactual of a step at a place without one source.

    The step is taken by itself: what is followed over time would remain for a while.

    Attributes:
        source: its name.
        contact: whether there would be a contact here.
        likelihood: of that contact; NaN: there would be none.
        moved: its distance from that of the step with the source, or else from here [m]; of the
            nearest elsewhere if none were here, and NaN if there were none at all.
        before: the likelihood of the contact here with the source; NaN: the step has none.
    """

    source: str
    contact: bool
    likelihood: float
    moved: float
    before: float


def reach_of(contact: Contact, voxel_size: float) -> float:
    """The greatest distance of the same contact [m]: 3 dispersions, at least 2 voxels."""
    return max(3.0 * contact.dispersion, 2.0 * voxel_size)


def nearest(place: FloatArray, contacts: Sequence[Contact]) -> tuple[Contact, float] | None:
    """The contact nearest to a place, shape (3,) [m], and its distance [m]."""
    if not contacts:
        return None
    away = np.linalg.norm([contact.position - place for contact in contacts], axis=1)
    return contacts[int(away.argmin())], float(away.min())


def without(fusion: Fusion, source: str, place: FloatArray, reach: float) -> Without:
    """The counterfactual at a place, fused again without one source.

    Args:
        fusion: of the step by itself, with it.
        source: its name.
        place: shape (3,) [m].
        reach: the greatest distance of a contact that counts as here [m].
    """
    before, found = np.nan, nearest(place, fusion.contacts)
    if found is not None and found[1] <= reach:
        before, place = found[0].likelihood, found[0].position
    found = nearest(place, fusion.without(source).contacts)
    if found is None:
        return Without(source, False, np.nan, np.nan, before)
    contact, away = found
    here = away <= reach
    return Without(source, here, contact.likelihood if here else np.nan, away, before)


def paired(before: Sequence[Contact], after: Sequence[Contact], voxel_size: float) -> list[Pair]:
    """Pair contacts that are the same, the nearest first, each at most once.

    Args:
        before: the contacts of one fusion.
        after: those of another; one within `reach_of` a contact of `before` may be the same.
        voxel_size: [m].

    Returns:
        Rows of `before`, rows of `after`, and their distances [m].
    """
    if not before or not after:
        return []
    away = cdist([contact.position for contact in before], [contact.position for contact in after])
    reach = np.array([reach_of(contact, voxel_size) for contact in before])
    rows, columns = np.nonzero(away <= reach[:, None])
    order = np.argsort(away[rows, columns], kind="stable")
    pairs: list[Pair] = []
    used_before: set[int] = set()
    used_after: set[int] = set()
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if row not in used_before and column not in used_after:
            used_before.add(row)
            used_after.add(column)
            pairs.append((row, column, float(away[row, column])))
    return pairs
