"""Rows come out by voxel, and in the order of arrival within one, however far they spread."""

import numpy as np
import pytest

from contactfusion.integrator.store import AXIS_BITS, IN_CACHE, SMALL, Columns, sort_rows

FAR = (1 << AXIS_BITS) - 1


@pytest.mark.parametrize("n", [0, 3 * SMALL, 5000, 3 * IN_CACHE])
@pytest.mark.parametrize("span", [1, 60, FAR])
def test_rows_are_sorted_stably_within_their_group(n: int, span: int) -> None:
    rng = np.random.default_rng(0)
    x, y, z = rng.integers(0, span, (3, n))
    keys = (x << 2 * AXIS_BITS) | (y << AXIS_BITS) | z
    none = np.zeros(n, np.float32)
    likelihoods = rng.random(n, dtype=np.float32)
    felt, offsets = np.empty((0, 4)), rng.random((n, 4), dtype=np.float32)
    rows = Columns(keys, likelihoods, np.arange(n), none, none > 0, felt, offsets)
    middle = n // 3
    ordered, order = sort_rows(rows, np.array([[0, middle, -1], [middle, n, -1]]))
    halves = (keys[:middle].argsort(kind="stable"), middle + keys[middle:].argsort(kind="stable"))
    wanted = np.concatenate(halves)
    assert np.array_equal(order, wanted)
    assert np.array_equal(ordered.keys, keys[wanted])
    assert np.array_equal(ordered.likelihoods, likelihoods[wanted])
    assert np.array_equal(ordered.stamps, wanted)
    assert np.array_equal(ordered.spreads, none)
    assert np.array_equal(ordered.offsets, offsets), "forces and offsets stay as they arrived"
