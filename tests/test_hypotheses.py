"""Clouds of hypotheses: what they hold, and what they refuse."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from contactfusion import ContactHypothesis, HypothesisCloud, HypothesisKind, Note
from contactfusion.errors import ContactFusionError, InvalidCloudError
from contactfusion.hypotheses import kind_of
from tests.clouds import HERE, NULL, REGULAR, SUPPORT, THERE, cloud, fused


def made(**fields: Any) -> HypothesisCloud:
    good: dict[str, Any] = {
        "source": "skin",
        "kind": REGULAR,
        "stamp": 0.5,
        "frame": "base",
        "positions": np.zeros((2, 3)),
        "likelihoods": np.array([0.25, 0.5]),
    }
    return HypothesisCloud(**{**good, **fields})


def test_a_cloud_holds_read_only_arrays_of_floats() -> None:
    one = made(forces=np.ones((2, 3), np.float32), spreads=[0.1, 0.2], likelihoods=[0, 1])
    for array in (one.positions, one.likelihoods, one.forces, one.spreads):
        assert array is not None and array.dtype == np.float64 and not array.flags.writeable


def test_a_cloud_cannot_be_changed() -> None:
    one: Any = made()
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.stamp = 1.0


def test_the_arrays_of_the_caller_stay_his_own() -> None:
    mine = np.zeros((2, 3))
    kept = made(positions=mine)
    mine[:] = 7.0
    assert not kept.positions.any()


def test_the_length_of_a_cloud_is_the_number_of_its_hypotheses() -> None:
    assert [len(made()), len(made(positions=np.empty((0, 3)), likelihoods=[]))] == [2, 0]


def test_an_empty_cloud_needs_no_shapes() -> None:
    empty = made(positions=[], likelihoods=[])
    assert (empty.positions.shape, empty.likelihoods.shape) == ((0, 3), (0,))


@pytest.mark.parametrize("text", ["regular", "support", "null"])
def test_a_kind_may_be_told_by_its_name(text: str) -> None:
    assert made(kind=text).kind is HypothesisKind(text)


def test_an_unknown_kind_gets_the_nearest_name() -> None:
    with pytest.raises(InvalidCloudError, match="unknown kind 'suport': did you mean 'support'"):
        kind_of("suport")


def test_notes_are_kept_as_text() -> None:
    assert made(notes=[Note.SATURATED, "cold"]).notes == ("saturated", "cold")


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"source": ""}, "needs the name of its source"),
        ({"source": 3}, "needs the name of its source"),
        ({"frame": ""}, "a cloud of 'skin' needs the name of its frame"),
        ({"frame": None}, "a cloud of 'skin' needs the name of its frame"),
        ({"kind": "rumour"}, "unknown kind 'rumour'"),
        ({"stamp": np.nan}, "the stamp of 'skin' is not finite"),
        ({"stamp": "soon"}, "the stamp of 'skin' is not a number"),
        ({"stamp": 1e18}, "the stamp of 'skin' is out of range"),
        ({"positions": np.zeros(3)}, r"positions of 'skin' have shape \(3,\), not \(n, 3\)"),
        ({"positions": np.zeros((2, 2))}, r"positions of 'skin' have shape \(2, 2\)"),
        ({"positions": [[0, 0, 0], [0, np.nan, 0]]}, "row 1 of the positions of 'skin'"),
        ({"positions": [[np.inf, 0, 0], [0, 0, 0]]}, "row 0 of the positions of 'skin'"),
        ({"likelihoods": [0.1]}, r"likelihoods of 'skin' have shape \(1,\), not \(2,\)"),
        ({"likelihoods": [0.1, np.nan]}, "row 1 of the likelihoods of 'skin' is nan, outside"),
        ({"likelihoods": [0.1, 1.0001]}, r"row 1 of the likelihoods of 'skin' is 1.0001, outside"),
        ({"likelihoods": [-1e-9, 1.0]}, "row 0 of the likelihoods of 'skin' is -1e-09, outside"),
        ({"forces": np.zeros((1, 3))}, r"forces of 'skin' have shape \(1, 3\), not \(2, 3\)"),
        ({"forces": [[0, 0, 0], [0, 0, np.nan]]}, "row 1 of the forces of 'skin'"),
        ({"spreads": [0.1, -0.1]}, "row 1 of the spreads of 'skin' is -0.1, outside"),
        ({"spreads": [0.1, 1e300]}, r"row 1 of the spreads of 'skin' is 1e\+300, outside \[0, 1e"),
        ({"spreads": [0.1]}, r"spreads of 'skin' have shape \(1,\)"),
        ({"single": True, "likelihoods": [0.6, 0.5]}, "single contact but sum to 1.1"),
    ],
)
def test_what_no_hypothesis_can_be_is_refused_with_its_row(
    fields: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InvalidCloudError, match=sentence):
        made(**fields)


def test_a_single_contact_may_sum_to_one_in_spite_of_rounding() -> None:
    n = 12
    assert len(made(positions=np.zeros((n, 3)), likelihoods=np.full(n, 1 / n), single=True)) == n


@pytest.mark.parametrize("p", [0.0, 1.0, 5e-324])
def test_the_ends_of_the_range_are_likelihoods(p: float) -> None:
    assert made(likelihoods=[p, p]).likelihoods.tolist() == [p, p]


def test_refusals_are_value_errors_and_errors_of_the_framework() -> None:
    assert issubclass(InvalidCloudError, ValueError)
    assert issubclass(InvalidCloudError, ContactFusionError)


# The papers' record of one hypothesis


def test_a_voxel_is_told_as_the_papers_record() -> None:
    space = fused(
        cloud("skin", 0.0, {HERE: 0.5}, forces=[[0.0, 3.0, 4.0]]),
        cloud("range", 0.0, {HERE: 0.25}),
    ).space
    record = space.hypothesis(0)
    assert record.location == pytest.approx((0.0025, 0.0025, 0.0025))
    assert record.likelihood == pytest.approx(1 - 0.5 * 0.75)
    assert record.likelihoods == {"range": 0.25, "skin": 0.5}
    assert record.sources == ("range", "skin")
    assert (record.kind, record.stamp, record.frame) == (REGULAR, 0.0, "base")
    assert record.force_magnitude == pytest.approx(5.0)
    assert record.force_direction == pytest.approx((0.0, 0.6, 0.8))


@pytest.mark.parametrize("kind", [REGULAR, SUPPORT, NULL])
def test_the_record_names_what_it_stands_on(kind: HypothesisKind) -> None:
    record = fused(cloud("a", 0.0, {HERE: 0.5}, kind)).space.hypothesis(0)
    assert record.kind == kind and record.force_magnitude is None


def test_a_force_of_zero_has_no_direction() -> None:
    record = fused(cloud("a", 0.0, {HERE: 0.5}, forces=np.zeros((1, 3)))).space.hypothesis(0)
    assert (record.force_magnitude, record.force_direction) == (0.0, None)


def test_the_record_survives_json() -> None:
    record = fused(cloud("a", 0.0, {THERE: 0.5}, forces=np.ones((1, 3)))).space.hypothesis(0)
    assert ContactHypothesis.model_validate_json(record.model_dump_json()) == record


@pytest.mark.parametrize("change", [{"likelihood": 1.5}, {"likelihood": np.nan}, {"colour": 1}])
def test_the_record_refuses_nonsense(change: dict[str, Any]) -> None:
    fields = fused(cloud("a", 0.0, {HERE: 0.5})).space.hypothesis(0).model_dump()
    with pytest.raises(ValidationError):
        ContactHypothesis.model_validate({**fields, **change})
