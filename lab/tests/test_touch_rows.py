"""Rows of the experiment on touches: what is fused in each."""

from contactfusion_lab.experiments.touch.plan import DEFAULT, read_plan
from contactfusion_lab.experiments.touch.rows import ROWS, everything


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
