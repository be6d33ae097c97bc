"""Data association: which contacts are the same."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linear_sum_assignment

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.integrator.association import assigned, paired

COSTS = st.tuples(st.integers(0, 6), st.integers(0, 6)).flatmap(
    lambda shape: arrays(np.float64, shape, elements=st.floats(0.0, 1.0) | st.just(np.inf))
)


@given(COSTS)
def test_the_sum_is_the_least_where_a_row_without_a_column_costs_one(costs: FloatArray) -> None:
    rows, columns = costs.shape
    with_none = np.hstack([np.where(np.isfinite(costs), costs, 2.0), np.ones((rows, rows))])
    least = with_none[linear_sum_assignment(with_none)].sum()
    found = assigned(costs)
    assert len({*found.values()}) == len(found)
    assert all(row < rows and column < columns for row, column in found.items())
    assert (
        sum(costs[row, found[row]] if row in found else 1.0 for row in range(rows)) <= least + 1e-9
    )


def line(y: float, track: int = 0) -> Contact:
    """A contact along y, of 0.1 m to each side of its middle, which is known to 1 cm."""
    middle, side = np.array([0.3, y, 0.0]), np.array([0.0, 0.1, 0.0])
    return Contact(
        position=middle,
        likelihood=0.95,
        scatter=np.diag(side**2),
        covariance=1e-4 * np.eye(3),
        extent=np.array([middle - side, middle + side]),
        force=np.full(3, np.nan),
        voxels=1,
        shares={},
        stamp=0.0,
        frame="base",
        track=track,
    )


def test_a_slower_source_that_moves_to_another_contact_swaps_no_numbers() -> None:
    before, now = (line(-0.1, track=1), line(0.25, track=2)), (line(0.25), line(-0.1))
    # a LiDAR was found with the first one, and now with the second, of which a skin told alone
    assert paired(before, now, quiet=(False, True), news=(True, False)) == {0: 1, 1: 0}


def test_of_what_nothing_new_is_said_stays_where_it_was() -> None:
    before, now = (line(0.0, track=1), line(0.05, track=2)), (line(0.02), line(0.001))
    assert paired(before, now, quiet=(True, False), news=(True, False)) == {0: 1, 1: 0}
