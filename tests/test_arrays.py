"""Arrays as fields of frozen data."""

from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import finite_number, frozen, frozen_array


def test_an_array_of_the_caller_is_copied_and_cannot_change_what_was_kept() -> None:
    mine = np.ones(3)
    kept = frozen_array(mine, (3,), "values", ValueError)
    mine[0] = 9.0
    assert kept.tolist() == [1.0, 1.0, 1.0]


def test_what_was_kept_is_read_only() -> None:
    kept = frozen_array([1.0, 2.0], (2,), "values", ValueError)
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 9.0


@pytest.mark.parametrize("shape", [(2,), (2, 3), (0, 3)])
def test_what_was_kept_cannot_be_made_writeable_itself_or_through_its_base(shape: Any) -> None:
    mine = np.ones(shape)
    mine.flags.writeable = False
    kept = frozen_array(mine, shape, "values", ValueError)
    mine.flags.writeable = True
    mine[...] = 9.0
    with pytest.raises(ValueError, match="cannot set WRITEABLE flag to True"):
        kept.flags.writeable = True
    with pytest.raises(ValueError, match="cannot set WRITEABLE flag to True"):
        kept[:1].setflags(write=True)
    assert isinstance(kept.base, bytes) and (kept == np.ones(shape)).all()


def test_an_array_that_can_never_be_written_is_shared() -> None:
    kept = frozen_array(np.ones(3), (3,), "values", ValueError)
    assert frozen_array(kept, (3,), "values", ValueError) is kept


@pytest.mark.parametrize("turn", [lambda a: a.T, lambda a: a[:, ::2], lambda a: a[1:]])
def test_a_view_becomes_a_contiguous_copy(turn: Any) -> None:
    view = turn(frozen(np.arange(16.0).reshape(4, 4)))
    kept = frozen_array(view, (None, None), "values", ValueError)
    assert kept.flags.c_contiguous and kept.base is not view and kept.tolist() == view.tolist()


@pytest.mark.parametrize("dtype", [np.float32, np.int8, np.bool_, np.float16])
def test_numbers_of_any_type_become_the_wanted_one(dtype: type) -> None:
    kept = frozen_array(np.ones(2, dtype), (2,), "values", ValueError)
    assert kept.dtype == np.float64


def test_no_rows_need_no_columns() -> None:
    assert frozen_array([], (None, 3), "places", ValueError).shape == (0, 3)


@pytest.mark.parametrize(
    ("value", "shape", "sentence"),
    [
        ([1.0, 2.0], (3,), r"values have shape \(2,\), not \(3,\)"),
        ([1.0, 2.0], (None, 3), r"values have shape \(2,\), not \(n, 3\)"),
        (1.0, (None,), r"values have shape \(\), not \(n,\)"),
        ([[1.0, 2.0], [3.0, np.nan]], (2, 2), "row 1 of the values is not finite"),
        ([0.0, -np.inf], (2,), "row 1 of the values is not finite: -inf"),
        ([0.0, -1e31], (2,), r"row 1 of the values is too large: -1e\+31"),
        ([[1e31], [np.nan]], (2, 1), "row 0 of the values is too large"),
        ([0.0] * 9000 + [1e308], (9001,), "row 9000 of the values is too large"),
        ([[1.0], [1.0, 2.0]], (2, 1), "values are not numbers"),
        (["a", "b"], (2,), "values are not numbers"),
        ({"a": 1}, (1,), "values are not numbers"),
        pytest.param([10**400], (1,), "values", id="too large"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_sentence(
    value: Any, shape: tuple[int | None, ...], sentence: str
) -> None:
    with pytest.raises(KeyError, match=sentence):
        frozen_array(value, shape, "values", KeyError)


def test_gaps_are_kept_where_they_are_allowed() -> None:
    kept = frozen_array([np.nan, 1.0], (2,), "values", ValueError, finite=False)
    assert np.isnan(kept[0])


def test_a_number_comes_as_a_float() -> None:
    assert type(finite_number(np.float64(0.5), "it", ValueError)) is float


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (np.nan, "it is not finite: nan"),
        (np.inf, "it is not finite: inf"),
        (-1e31, r"it is too large: -1e\+31"),
        ("soon", "it is not a number: 'soon'"),
        (None, "it is not a number: None"),
        pytest.param(10**400, "it is not", id="too large"),
    ],
)
def test_what_is_no_finite_number_is_refused(value: Any, sentence: str) -> None:
    with pytest.raises(KeyError, match=sentence):
        finite_number(value, "it", KeyError)
