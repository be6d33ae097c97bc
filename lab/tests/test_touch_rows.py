"""Rows of the experiment on touches: what is fused in each, and rows against each other."""

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion_lab.experiments.touch.plan import DEFAULT, Touch, read_plan
from contactfusion_lab.experiments.touch.rows import (
    ROWS,
    Outcome,
    best_single,
    compare,
    comparisons_text,
    everything,
)

NAN = float("nan")


def test_first_touch_believes_in_the_target_alone() -> None:
    plan, _ = read_plan(DEFAULT, [], 1, None, (), 0)
    config = plan.pipeline_of("cylinder")
    objects = [
        list(options["objects"])
        for options in config.generators.values()
        if options["type"] == "first_touch"
    ]
    assert objects == [["cylinder"]]
    assert [row.name for row in ROWS if "first touch" in row.modalities] == ["all + first touch"]


def test_of_two_that_stand_on_one_belief_every_generator_means_the_first_touch() -> None:
    plan, _ = read_plan(DEFAULT, [], 1, None, (), 0)
    both = plan.pipeline
    alone = {name: one for name, one in both.generators.items() if one["type"] != "first_touch"}
    fewer = both.model_copy(update={"generators": alone})
    for config, one, other in (
        (both, "first touch", "simulator"),
        (fewer, "simulator", "first touch"),
    ):
        modalities = everything(config).modalities
        assert one in modalities and other not in modalities


def outcomes(errors: FloatArray, row: str = "all", method: str = "m") -> list[Outcome]:
    """Touches with these errors, detected up to 3 cm; NaN reports nothing."""
    return [
        Outcome(Touch("box", number, 0, False, 0), 1, row, method, int(not np.isnan(error)),
                error <= 0.03, int(error > 0.03), error, 0.01)
        for number, error in enumerate(errors.tolist())
    ]  # fmt: skip


@pytest.fixture
def errors() -> FloatArray:
    drawn: FloatArray = np.random.default_rng(1).uniform(0.0, 0.06, 60)
    return drawn


def test_a_row_is_compared_touch_by_touch(errors: FloatArray) -> None:
    told = compare(outcomes(errors / 2.0), outcomes(errors, "force"), 0)
    assert (told.row, told.against_row) == ("all", "force")
    assert told.detected_by_it_only == (errors > 0.03).sum()
    assert told.detected_by_the_other_only == 0
    assert told.p_of_detection < 1e-3 and told.p_of_error < 1e-6
    assert told.median_difference == pytest.approx(-np.median(errors / 2.0))
    reverse = compare(outcomes(errors, "force"), outcomes(errors / 2.0), 0)
    assert reverse.detected_by_the_other_only == told.detected_by_it_only


def test_what_is_equal_does_not_differ(errors: FloatArray) -> None:
    same = compare(outcomes(errors), outcomes(errors, "force"), 0)
    assert same.p_of_detection == same.p_of_error == 1.0
    assert same.difference_of_medians == same.low == same.high == 0.0


def test_the_interval_is_of_pairs(errors: FloatArray) -> None:
    shifted = compare(outcomes(errors - 0.001), outcomes(errors), 0)
    for told in (shifted.difference_of_medians, shifted.low, shifted.high):
        assert told == pytest.approx(-0.001)


def test_the_interval_holds_the_difference_and_shrinks_with_touches() -> None:
    rng = np.random.default_rng(3)
    widths = []
    for n in (30, 3000):
        one, other = rng.uniform(0.0, 0.02, n), rng.uniform(0.0, 0.03, n)
        told = compare(outcomes(one), outcomes(other), 0)
        assert told.low is not None and told.high is not None
        assert told.difference_of_medians == pytest.approx(np.median(one) - np.median(other))
        assert told.low < -0.005 < told.high
        widths.append(told.high - told.low)
    assert widths[1] < widths[0] / 4.0


def test_errors_are_compared_where_both_report() -> None:
    one = outcomes(np.array([0.01, 0.02, NAN, NAN]))
    told = compare(one, outcomes(np.array([0.02, NAN, 0.01, NAN])), 0)
    assert (told.touches, told.both_report) == (4, 1)
    assert told.median_difference == told.difference_of_medians == pytest.approx(-0.01)
    assert (told.detected_by_it_only, told.detected_by_the_other_only) == (1, 1)


def test_touches_in_free_air_have_no_say() -> None:
    def made(error: float) -> Outcome:
        return Outcome(Touch("box", 0, 0, True, 0), 0, "all", "m", 1, True, 0, error, 0.01)

    told = compare([made(0.01)], [made(0.02)], 0)
    assert told.touches == told.both_report == 0
    assert told.difference_of_medians is None and told.p_of_error == 1.0
    assert comparisons_text([told]).endswith("| 0 | - | 1 | - [-, -] |")


def test_the_text_names_what_differs(errors: FloatArray) -> None:
    found = outcomes(errors, "all", "new")
    against_row = compare(found, outcomes(errors, "force", "new"), 0)
    against_method = compare(found, outcomes(errors, "all", "old"), 0)
    lines = comparisons_text([against_row, against_method]).splitlines()[2:]
    assert lines[0].startswith("| all | force |") and lines[1].startswith("| all | old |")


def test_the_best_modality_detects_the_most() -> None:
    rows = {"tactile": outcomes(np.full(9, 0.04)), "force": outcomes(np.full(9, 0.02))}
    assert best_single(rows) == "force"
