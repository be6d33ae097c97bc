"""Data association: which contacts of a step are those of the step before."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact

NEAR = 3.0
"""A contact is the same as an earlier one within so many standard deviations of both."""
STALE = 0.5
"""The least cost of what is no news, in parts of the largest."""
LIKELY = 0.5
"""What is less probable is associated after all else."""


def paired(
    before: Sequence[Contact],
    now: Sequence[Contact],
    slid: Sequence[float] | None = None,
    quiet: Sequence[bool] | None = None,
    news: Sequence[bool] | None = None,
) -> dict[int, int]:
    """Which contacts, as rows, are the same (method §3).

    First what is reported, of which nothing new is said, is paired with what is no news where it
    was found, within a standard deviation. Then what is reported with what probably exists, before
    all else. Among equals those are paired that lie the nearest together, see `assigned`; what is
    no news lies further away by half of the largest distance squared.

    Args:
        before: contacts.
        now: those of a step.
        slid: how far each may have slid meanwhile [m]; without, not at all.
        quiet: of which of those before nothing new is said; without, of none.
        news: which of those of the step are; without, all.
    """
    if not before or not now:
        return {}
    costs = _costs(before, now, np.zeros(len(before)) if slid is None else np.array(slid))
    reported = np.array([contact.track > 0 for contact in before])
    likely = np.array([contact.likelihood >= LIKELY for contact in now])
    new = np.ones(len(now), np.bool_) if news is None else np.array(news)
    costs[:, ~new] = STALE + (1.0 - STALE) * costs[:, ~new]
    groups = [] if quiet is None else [(reported & np.array(quiet), ~new)]
    groups += [
        (reported == is_reported, likely == is_likely)
        for is_likely, is_reported in itertools.product((True, False), repeat=2)
    ]
    pairs: dict[int, int] = {}
    for number, (earlier, later) in enumerate(groups):
        rows, columns = np.flatnonzero(earlier).tolist(), np.flatnonzero(later).tolist()
        among = costs[np.ix_(rows, columns)]
        if quiet is not None and number == 0:
            same = _at_rest([before[row] for row in rows], [now[row] for row in columns])
            among[~same] = np.inf
        if np.isfinite(among).any():
            found = {rows[a]: columns[b] for a, b in assigned(among).items()}
            costs[[*found]], costs[:, [*found.values()]] = np.inf, np.inf
            pairs |= found
    return pairs


def _costs(before: Sequence[Contact], now: Sequence[Contact], slid: FloatArray) -> FloatArray:
    """The squared distances of contacts in parts of the largest, shape (r, c); ∞ of what is more.

    Args:
        before: r contacts.
        now: c contacts.
        slid: shape (r,) [m].
    """
    (where, wide), (there, wider) = (
        (
            np.array([contact.position for contact in contacts]),
            np.array([contact.covariance + contact.scatter for contact in contacts]),
        )
        for contacts in (before, now)
    )
    squared = ((where[:, None] - there) ** 2).sum(axis=2)
    traces = np.trace(wide, axis1=1, axis2=2)[:, None] + np.trace(wider, axis1=1, axis2=2)
    most = (NEAR * np.sqrt(traces) + slid[:, None]) ** 2
    rows, columns = np.nonzero(squared <= most)  # no width is larger than the trace
    widths = np.linalg.eigvalsh(wide[rows] + wider[columns])[:, -1]
    costs = np.full(squared.shape, np.inf)
    costs[rows, columns] = squared[rows, columns] / (NEAR * np.sqrt(widths) + slid[rows]) ** 2
    costs[costs > 1.0] = np.inf
    return costs


def _at_rest(before: Sequence[Contact], now: Sequence[Contact]) -> NDArray[np.bool_]:
    """Which of r contacts lie within a standard deviation of which of c, shape (r, c)."""
    (where, unsure), (there, also) = (
        (
            np.array([contact.position for contact in contacts]).reshape(-1, 3),
            np.array([contact.covariance.trace() for contact in contacts]),
        )
        for contacts in (before, now)
    )
    squared = ((where[:, None] - there) ** 2).sum(axis=2)
    at_rest: NDArray[np.bool_] = squared <= unsure[:, None] + also
    return at_rest


def assigned(costs: FloatArray) -> dict[int, int]:
    """The columns of rows, of the least sum where a row without a column costs 1.

    By shortest augmenting paths (Kuhn 1955); `scipy.optimize` takes half a second to import.

    Args:
        costs: shape (r, c), at most 1; ∞ of no pair.
    """
    count, own = costs.shape
    costs = np.hstack([np.where(np.isfinite(costs), costs, 2.0), np.ones((count, count))])
    by_row, by_column = np.zeros(count), np.zeros(own + count)
    rows = np.full(own + count, NONE)
    for row in range(count):
        least = np.full(own + count, np.inf)
        before, done = np.full(own + count, NONE), np.zeros(own + count, np.bool_)
        at, column = row, NONE
        while at != NONE:
            reduced = costs[at] - by_row[at] - by_column
            nearer = ~done & (reduced < least)
            least[nearer], before[nearer] = reduced[nearer], column
            column = int(np.where(done, np.inf, least).argmin())
            step = least[column]
            by_row[row] += step
            by_row[rows[done]] += step
            by_column[done] -= step
            least[~done] -= step
            done[column] = True
            at = int(rows[column])
        while column != NONE:
            previous = int(before[column])
            rows[column] = row if previous == NONE else rows[previous]
            column = previous
    return {int(rows[column]): column for column in range(own) if rows[column] != NONE}
