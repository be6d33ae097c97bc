"""The baselines as plug-ins: found by name, read from old configurations, explained."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from contactfusion import HypothesisCloud, IntegratorConfig, Pipeline, PipelineConfig
from contactfusion.errors import ConfigurationError
from contactfusion.explain.explanation import Explanation, PlaceExplanation, explanation_of
from contactfusion.explain.moment import Settings, moment_at
from contactfusion.explain.text import as_text
from contactfusion.pipeline import Step
from contactfusion.reason import Why
from contactfusion.run.configuration import setting_of_recording
from contactfusion.run.session import Session
from lab.tests.baseline_steps import MODES, integrator
from tests.clouds import HERE, NULL, SUPPORT, THERE, centres, cloud, law

KEPT = Path(__file__).parents[2] / "tests" / "data" / "moved_options.mcap"
"""A recording of 0.1.0 by `posterior` and `modes`, with options beside these; see
tests/test_integrator_config.py."""
CLUSTERS = {"rule": "posterior", "condensation": "cluster_centroid"}


def test_a_configuration_names_them_as_any_plug_in() -> None:
    given: dict[str, Any] = {"rule": {"type": "posterior", "floor": 0.02}, "condensation": "modes"}
    pipeline = Pipeline(PipelineConfig(integrator=IntegratorConfig(**given)))
    assert type(pipeline.integrator.rule).__module__ == "contactfusion_lab.baselines.posterior"
    assert pipeline.step(0.0).fusion.contacts == ()


@pytest.mark.parametrize("rule", ["de_morgan", "sets"])
def test_modes_need_the_rule_posterior(rule: str) -> None:
    config = IntegratorConfig(rule=rule, condensation="modes")
    pipeline = Pipeline(PipelineConfig(integrator=config))
    with pytest.raises(ConfigurationError, match="'modes' needs the rule 'posterior'"):
        pipeline.step(0.0)


def test_a_recording_of_0_1_0_is_replayed_with_its_options() -> None:
    setting = setting_of_recording(KEPT)
    contacts = [step.fusion.contacts for step in Session(setting, KEPT).steps()]
    written = {
        "rule": {"type": "posterior", "floor": 0.02, "friction": 0.4},
        "condensation": {"type": "modes", "existence": 0.3, "mode_share": 0.4},
    }
    today = {"frame": "base", "voxel_size": 0.0125, **written}
    again = replace(setting, fields={**setting.fields, "integrator": today})
    expected = [step.fusion.contacts for step in Session(again, KEPT).steps()]
    assert [len(found) for found in contacts] == [1, 1, 1]
    for found, wanted in zip(contacts, expected, strict=True):
        assert found[0].position.tolist() == wanted[0].position.tolist()
        assert found[0].likelihood == wanted[0].likelihood


# Explanations


def explained(*clouds: HypothesisCloud, at: Any = None, **config: Any) -> Explanation:
    """The explanation of one step."""
    own = law(**{**MODES, **config})
    step = integrator(own)
    for each in clouds:
        step.receive(each)
    moment = moment_at([Step(0.0, step.step(0.0), None)], 0.0, 0.01)
    return explanation_of(moment, Settings(own, {}), at)


def place(one: Explanation) -> PlaceExplanation:
    (found,) = one.places
    return found


def test_a_mode_is_explained_by_existence_and_its_part_of_the_belief() -> None:
    one = explained(cloud("skin", 0.0, {HERE: 0.9}), cloud("lidar", 0.0, {(1, 0, 0): 0.5}))
    assert as_text(one).split("\n")[0] == "0.000 s: 1 contact in 'base' (posterior, modes)"
    (contact,) = one.contacts
    assert contact.combination.startswith("P(contact) 0.95 by all evidence, 100% of the belief")


def test_no_mode_is_explained_by_existence_by_its_share_or_by_support_alone() -> None:
    nulled = explained(cloud("skin", 0.0, {HERE: 0.5}), cloud("free", 0.0, {HERE: 1.0}, NULL))
    assert place(nulled).reasons[0].why == Why.IMPROBABLE
    second = explained(cloud("skin", 0.0, {HERE: 0.9, THERE: 0.3}), at=centres([THERE])[0])
    values = place(second).reasons[0].values
    assert values["share"] < values["mode_share"] == 0.42
    predicted = explained(cloud("motion", 0.0, {HERE: 0.3}, SUPPORT), at=(0.0, 0.0, 0.0))
    assert place(predicted).reasons[0].why == Why.SUPPORT_ONLY


def test_a_voxel_is_explained_in_relation_to_the_likeliest_place() -> None:
    first, second = explained(cloud("skin", 0.0, {HERE: 0.9, THERE: 0.6}), **CLUSTERS).contacts
    assert first.combination.endswith("100% as likely here as at the likeliest place: 0.90")
    assert second.combination.endswith(f": {second.likelihood:.2f}")


def test_a_cluster_of_too_little_mass_says_so() -> None:
    massive = {"rule": "de_morgan", "condensation": "cluster_mass"}
    thin = place(explained(cloud("skin", 0.0, {HERE: 0.3}), **massive))
    assert thin.reasons[0].values == pytest.approx({"mass": 0.3, "mass_threshold": 0.5})
