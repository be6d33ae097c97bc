"""Data association: which contacts are the same."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linear_sum_assignment

from contactfusion.arrays import FloatArray
from contactfusion.integrator.association import assigned

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
