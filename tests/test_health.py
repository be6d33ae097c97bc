"""Signs of life of a patch, and how long they count."""

import numpy as np

from contactfusion.generators.health import PERSISTS, Health

YES, NO = np.array([True, True]), np.array([False, False])


def test_nothing_is_known_at_first() -> None:
    assert not Health(2, window=1.0).healthy(0.0)


def test_the_first_values_are_no_change() -> None:
    health = Health(2, window=1.0)
    health.watch(0.0, np.array([5.0, 6.0]))
    assert not health.healthy(0.0)


def test_a_change_of_half_the_taxels_counts_for_one_window() -> None:
    health = Health(4, window=1.0)
    health.watch(0.0, np.zeros(4))
    health.watch(0.5, np.array([1.0, 0.0, 0.0, 0.0]))
    assert not health.healthy(0.5)
    health.watch(1.0, np.array([1.0, 1.0, 0.0, 0.0]))
    assert health.healthy(1.5)
    assert not health.healthy(1.75)  # the first taxel changed more than a window ago
    health.watch(1.75, np.array([1.0, 1.0, 0.0, 0.0]))
    assert not health.healthy(1.75)


def test_a_confirmation_counts_for_one_window() -> None:
    health = Health(2, window=1.0)
    health.confirm(1.0)
    assert health.healthy(2.0)
    assert not health.healthy(2.01)


def test_a_dispute_is_one_that_lasts() -> None:
    health = Health(2, window=1.0)
    assert not health.disputed(1.0, YES).any()
    assert not health.disputed(1.0 + PERSISTS, np.array([True, False])).any()
    assert health.disputed(1.001 + PERSISTS, YES).tolist() == [True, False]
    assert not health.disputed(1.1 + PERSISTS, NO).any()
    assert not health.disputed(1.2 + PERSISTS, YES).any()
