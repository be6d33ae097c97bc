"""Where one might expect a contact and there is none."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from contactfusion.arrays import FloatArray
from contactfusion.explaining.view import NOBODY, View
from contactfusion.integrator import clusters, kernels
from contactfusion.integrator.condensations import reach_squared

MOST, MOST_DEAD = 3, 2
"""So many places are found at most, so many of them of contacts that died."""
APART = 2.0
"""What lies within so many tolerances of a contact, or of another place, is no place of its own."""


@dataclass(frozen=True, slots=True)
class Expected:
    """A place where one might expect a contact.

    Attributes:
        position: shape (3,) [m].
        last_contact: the time of the last step that told one there [s]; NaN: not lately.
    """

    position: FloatArray
    last_contact: float = np.nan


def expected_places(view: View) -> list[Expected]:
    """Find the places where contacts died lately, and where hypotheses came to nothing.

    Returns:
        A few contacts that died, the newest first; then a few places that are no such, evidence
        before prediction, the likeliest first.
    """
    dead = [Expected(one.contact.position, one.stamp) for one in view.past.dead(view.stamp)]
    places = _apart(view, dead)[:MOST_DEAD]
    places += _apart(view, [Expected(one) for one in _hopeless(view)], places)
    return places[:MOST]


def _hopeless(view: View) -> list[FloatArray]:
    """Give the likeliest voxel of each cluster of hypotheses without a contact, the best first.

    Null alone makes no place: nobody expects a contact there; nor does support alone that would
    stay under the threshold even with evidence.
    """
    entries, likelihoods = view.fusion.field.entries, view.fusion.field.likelihoods
    evidence = (entries.bits & kernels.REGULAR) > 0
    wanted = entries.counted_voxels & (evidence | (likelihoods >= view.fusion.threshold))
    rows = np.flatnonzero(wanted & (view.owners == NOBODY))
    if not len(rows):
        return []
    config = view.settings.integrator
    reach = reach_squared(config.linking_distance, config.voxel_size)
    labels, _ = clusters.label(entries.keys[rows], reach)
    order = np.lexsort((rows, -np.round(likelihoods[rows], 6), ~evidence[rows]))
    _, first = np.unique(labels[order], return_index=True)
    return list(view.centres[rows[order[np.sort(first)]]])


def _apart(
    view: View, candidates: list[Expected], others: list[Expected] | None = None
) -> list[Expected]:
    """Give the places that lie apart from every contact and from each other, in order."""
    owned = view.centres[view.owners != NOBODY]
    taken = [one.position for one in view.fusion.contacts]
    tree = cKDTree(np.concatenate([owned, np.reshape(taken, (-1, 3))]))
    apart, found = APART * view.settings.tolerance, list(others or [])
    kept: list[Expected] = []
    for one in candidates:
        if len(kept) == MOST:
            break
        near = [np.linalg.norm(one.position - place.position) for place in found + kept]
        if tree.query(one.position)[0] > apart and all(far > apart for far in near):
            kept.append(one)
    return kept
