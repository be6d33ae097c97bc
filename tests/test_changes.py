"""Changes of a pipeline while it runs: what they do, and what is said of wrong ones."""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline, PipelineConfig
from contactfusion.changes import USES, Change, words
from contactfusion.errors import ConfigurationError, ContactFusionError
from contactfusion.generators.taxel_map import TaxelMap
from contactfusion.isolation import Isolated
from contactfusion.readings import Wrench
from contactfusion.recordings.ros.delivery import answers
from contactfusion.runner import OVERRUNS, Budgets
from tests.wire import PROBE


def pipeline(**wrist: Any) -> Pipeline:
    generators = {"wrist": {**PROBE["generators"]["wrist"], **wrist}}
    return Pipeline(PipelineConfig(**{**PROBE, "generators": generators}))


def push(stamp: float, force: float = -5.0) -> Wrench:
    return Wrench(
        stamp=stamp, frame="probe", sensor="wrist",
        force=np.array([0.0, 0.0, force]), torque=np.array([0.0, -0.02 * force, 0.0]),
    )  # fmt: skip


def change(pipe: Pipeline, text: str) -> str:
    made = Change(text)
    made.carry_out(pipe)
    return made.outcome.result(0.0)


def contacts(pipe: Pipeline, stamp: float) -> int:
    pipe.take(push(stamp))
    return len(pipe.step(stamp).fusion.contacts)


def test_a_threshold_above_the_probability_hides_a_contact_and_a_lower_one_shows_it() -> None:
    pipe = pipeline()
    assert contacts(pipe, 0.0) == 1
    assert change(pipe, "threshold 1") == "the threshold is 1, and was 0.5"
    assert contacts(pipe, 0.1) == 0
    change(pipe, "threshold 0.5")
    assert contacts(pipe, 0.2) == 1


def test_what_is_unplugged_contributes_nothing_until_it_is_plugged_again() -> None:
    pipe = pipeline()
    assert change(pipe, "unplug wrist") == "'wrist' is unplugged"
    assert contacts(pipe, 0.0) == 0
    assert change(pipe, "plug wrist") == "'wrist' is plugged"
    assert contacts(pipe, 0.1) == 1


def test_a_change_from_a_recording_leaves_the_files_that_the_configuration_names(
    tmp_path: Path,
) -> None:
    presses = np.random.default_rng(3).normal(size=(9, 2))
    for file in ("mine.npz", "other.npz"):
        TaxelMap(presses, np.c_[presses, np.zeros(9)], 4).save(tmp_path / file)
    pad = {"type": "taxel_map", "map": str(tmp_path / "mine.npz"), "min_signal": 1.0}
    pipe = Pipeline(PipelineConfig(**{**PROBE, "generators": {"pad": pad}}))

    def recorded(text: str) -> str:
        made = Change(text, within=tmp_path / "recordings")
        made.carry_out(pipe)
        return made.outcome.result(0.0)

    recorded("unplug pad")
    with pytest.raises(ConfigurationError, match="may name files in .*recordings only"):
        recorded(f"plug pad map={tmp_path / 'other.npz'}")
    recorded("plug pad min_signal=2")
    assert pipe.options["pad"] == {**pad, "min_signal": 2}


def test_options_of_a_plug_change_those_of_the_configuration() -> None:
    pipe = pipeline()
    change(pipe, "unplug wrist")
    change(pipe, "plug wrist min_force=9")
    assert contacts(pipe, 0.0) == 0


def test_a_tare_takes_what_is_measured_now_for_nothing() -> None:
    pipe = pipeline(tare=0.05)
    for row in range(8):
        pipe.take(push(0.01 * row, force=0.0))
    assert contacts(pipe, 0.1) == 1
    assert change(pipe, "tare wrist") == "'wrist' takes its tare of 0.05 s again"
    for row in range(20):  # the contact is forgotten, and the load of the tool is 5 N more
        pipe.take(push(1.0 + 0.01 * row))
        pipe.step(1.0 + 0.01 * row)
    assert contacts(pipe, 9.0) == 0


def test_an_isolated_generator_goes_on_in_a_process_of_its_own() -> None:
    pipe = pipeline()
    try:
        assert change(pipe, "isolate wrist").startswith("'wrist' runs in a process of its own")
        assert isinstance(pipe.generators["wrist"], Isolated)
        assert contacts(pipe, 0.0) == 1
    finally:
        pipe.close()


def test_what_an_isolated_wrist_measures_is_there_for_the_others() -> None:
    wrist = {"type": "force_torque", "sign": "on_robot"}
    fields = {**PROBE, "generators": {"near": wrist, "far": {**wrist, "isolate": True}}}
    pipe = Pipeline(PipelineConfig(**fields))
    try:
        pipe.take(push(0.0))
        pipe.step(0.01)
        near, far = (pipe.state(0.05).resultants[name] for name in ("near", "far"))
        assert near.force == pytest.approx(far.force)
        assert not pipe.state(0.2).resultants
    finally:
        pipe.close()


def test_restore_undoes_changes() -> None:
    pipe = pipeline()
    for text in ("threshold 0.9", "unplug wrist", "plug other type=switch"):
        change(pipe, text)
    pipe.restore()
    assert list(pipe.generators) == ["wrist"]
    assert pipe.integrator.config.threshold == 0.5


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "unknown change ''"),
        ("treshold 0.4", "unknown change 'treshold'; did you mean"),
        ("threshold", "'threshold': write threshold VALUE"),
        ("threshold 0.1 0.2", "write threshold VALUE"),
        ("threshold high", "integrator.threshold: 'high' is no number"),
        ("threshold nan", "threshold: nan does not lie between 0 and 1"),
        ("unplug wrst", "unknown generator 'wrst'; did you mean 'wrist'"),
        ("tare wrist", "'wrist' takes no tare"),
        ("plug skin", "'skin' has no type: write plug skin type="),
        ("plug wrist", "the generator 'wrist' is plugged already"),
        ("answer wrist 3", "'wrist' does not run in a process of its own"),
        ("answer wrist x", "'x' is no number of a reading"),
        ('unplug "wrist', "No closing quotation"),
        ("tare 'a\nb'", "is no line of text"),
        ("threshold 0.4\x1b[2J", "is no line of text"),
        ("plug skin type=null", "'skin' has no type: write plug skin type="),
        ("plug skin type={}", "'skin' has no type: write plug skin type="),
        (f"answer wrist {'9' * 5000}", "is no number of a reading"),
        ("plug a/b type=force_torque", "^generators.a/b: a name may not hold '/'$"),
        ("plug a.b type=force_torque", "^generators.a.b: a name may not hold '.'$"),
        (f"plug wrist {'.'.join('a' * 3000)}=1", "more than 50 within each other$"),
        (f"plug skin type=tactile shapes.{'9' * 5000}=1 shapes=[]", "skin"),
    ],
)
def test_a_wrong_change_is_one_sentence_and_changes_nothing(text: str, sentence: str) -> None:
    pipe = pipeline()
    with pytest.raises(ContactFusionError, match=sentence):
        change(pipe, text)
    assert contacts(pipe, 0.0) == 1


def test_every_change_has_a_use() -> None:
    assert words("restart wrist") == ["restart", "wrist"]
    assert list(USES) == sorted(USES, key=list(USES).index)


def test_a_change_whose_asker_gave_up_is_not_made() -> None:
    pipe, late = pipeline(), Change("threshold 0.9")
    assert late.outcome.cancel()
    late.carry_out(pipe)
    assert pipe.integrator.config.threshold == 0.5


def test_a_name_with_a_blank_is_isolated_and_its_answers_are_named_so_that_they_are_read() -> None:
    budgets = Budgets(iter(np.arange(0.0, 100.0)).__next__)
    pipe = Pipeline(
        PipelineConfig(**{**PROBE, "generators": {"left arm": PROBE["generators"]["wrist"]}}),
        budgets.ask,
    )
    with closing(pipe):
        for row in range(OVERRUNS):
            pipe.receive(push(0.01 * row))
            pipe.step(0.01 * row)
        (isolate,) = budgets.changes()
        isolate.carry_out(pipe)
        assert isolate.outcome.result() == "'left arm' runs in a process of its own from now on"
        pipe.receive(push(1.0))
        pipe.step(1.0)
        (answer,) = answers(pipe)
        assert words(answer) == ["answer", "left arm", "1"]
