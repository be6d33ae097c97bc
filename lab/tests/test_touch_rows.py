"""Rows of the experiment on touches: what is fused in each, and rows against each other."""

from dataclasses import replace

import pandas as pd

from contactfusion_lab.experiments.methods import DE_MORGAN_TUNED, Method
from contactfusion_lab.experiments.touch.plan import DEFAULT, read_plan
from contactfusion_lab.experiments.touch.rows import (
    PAPERS,
    ROWS,
    Outcome,
    best_single,
    compare_all,
    everything,
    modality_of,
)
from contactfusion_lab.trials.measures import CASE
from contactfusion_lab.trials.tables import frame_of

POSTERIOR = Method("posterior", "modes")


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
    alone = {
        name: generator
        for name, generator in both.generators.items()
        if generator["type"] != "first_touch"
    }
    fewer = both.model_copy(update={"generators": alone})
    for config, first, second in (
        (both, "first touch", "simulator"),
        (fewer, "simulator", "first touch"),
    ):
        modalities = everything(config).modalities
        assert first in modalities and second not in modalities


def test_under_the_preset_the_papers_rows_take_what_moves_as_range() -> None:
    plan, _ = read_plan(DEFAULT, [], 1, None, (), 0, "paper")
    config = plan.pipeline
    eyes = {name: one for name, one in config.generators.items() if one["type"] == "range"}
    assert {name: one["evidence"] for name, one in eyes.items()} == {"near": "motion"}
    assert modality_of(config, "near") == "range"
    assert modality_of(read_plan(DEFAULT, [], 1, None, (), 0)[0].pipeline, "moving") == "moving"
    assert config.generators["wrist"]["friction"] is None
    assert config.generators["tip_2"]["p_max"] == 1.0
    assert (config.integrator.rule, config.integrator.expiry) == ("de_morgan", "voxel")
    assert set(PAPERS[-1].modalities) <= {modality_of(config, name) for name in config.generators}


def outcomes(row: str, method: str, errors: list[float], short: bool = False) -> list[Outcome]:
    """Touches with these errors, detected up to 3 cm."""
    first = Outcome(
        "",
        "box",
        0,
        0,
        short,
        int(not short),
        row,
        method,
        1,
        False,
        0,
        0.0,
        sigma=0.01,
        gospa=0.01,
        gospa_distance=0.01,
        gospa_missed=0,
        gospa_false=0,
        recall=1.0,
        probability=0.9,
        level=0.5,
        radius=0.02,
        force=6.0,
        latency=0.1,
    )
    return [
        replace(first, touch=f"box-{number:02d}-0", direction=number, detected=error <= 0.03,
                error=error)
        for number, error in enumerate(errors)
    ]  # fmt: skip


def framed(*parts: list[Outcome]) -> pd.DataFrame:
    frame = frame_of([each for part in parts for each in part], Outcome)
    return frame.assign(**{CASE: frame["row"] + ", " + frame["method"]})


def test_the_best_modality_detects_the_most_touches_those_in_free_air_do_not_count() -> None:
    frame = framed(
        outcomes("tactile", "m", [0.04, 0.01]),
        outcomes("force", "m", [0.02, 0.02]),
        outcomes("range", "m", [0.02, 0.04]),
        outcomes("range", "m", [0.01] * 9, short=True),
    )
    assert best_single(frame) == "force"


def test_rows_are_compared_with_the_best_modality_and_with_the_first_method() -> None:
    plan, _ = read_plan(DEFAULT, [], 1, None, (), 0)
    methods = [Method("de_morgan", "threshold"), Method("de_morgan", "cluster_mass")]
    rows = [row.name for row in (*ROWS, everything(plan.pipeline))]
    frame = framed(
        *(
            outcomes(row, str(method), [0.01 if row == "force" else 0.05] * 4)
            for method in methods
            for row in rows
        ),
        outcomes("all", str(methods[0]), [0.01] * 4, short=True),
    )
    found = compare_all(frame, methods, plan.pipeline, 0)
    wide = [row.name for row in (*ROWS, everything(plan.pipeline)) if len(row.modalities) > 1]
    pairs = {(each.case, each.against) for each in found}
    assert {each.trials for each in found} == {4}
    assert len(found) == 3 * len(pairs) == 3 * (2 * (len(wide) + 1) + len(wide))
    assert ("all, de_morgan/threshold", "force, de_morgan/threshold") in pairs
    assert ("all, de_morgan/cluster_mass", "all, de_morgan/threshold") in pairs


def test_a_belief_is_compared_with_what_is_tuned() -> None:
    plan, _ = read_plan(DEFAULT, [], 1, None, (), 0)
    methods = [Method("de_morgan", "cluster_centroid"), POSTERIOR, DE_MORGAN_TUNED]
    rows = [row.name for row in (*ROWS, everything(plan.pipeline))]
    frame = framed(*(outcomes(row, str(method), [0.01] * 4) for method in methods for row in rows))
    pairs = {(each.case, each.against) for each in compare_all(frame, methods, plan.pipeline, 0)}
    assert ("all, posterior/modes", "all, de_morgan_tuned") in pairs
    assert ("all, de_morgan_tuned", "all, de_morgan/cluster_centroid") in pairs
    assert ("all, de_morgan/cluster_centroid", "all, de_morgan_tuned") not in pairs
