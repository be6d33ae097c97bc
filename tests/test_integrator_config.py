"""Rules and condensations with options, and the fields of 0.1.0 that became such options."""

import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from contactfusion import Integrator, IntegratorConfig, Pipeline, PipelineConfig
from contactfusion.errors import REMOVED_RULES, ConfigurationError, PluginError
from contactfusion.integrator.condensations import ClusterMassConfig, contactfusion_condensations
from contactfusion.integrator.config import MOVED
from contactfusion.integrator.posterior import TrustConfig
from contactfusion.integrator.rules import contactfusion_rules
from contactfusion.pipeline_config import overridden
from contactfusion.run.configuration import setting_of_recording
from contactfusion.run.session import Session

MOVED_OPTIONS = Path(__file__).parent / "data" / "moved_options.mcap"
"""tests/data/kept.mcap, replayed at commit 539ebf7 with `integrator: {frame: base, rule: posterior,
floor: 0.02, friction: 0.4, condensation: modes, existence: 0.3, mode_share: 0.4, prior: 0.1,
voxel_size: 0.0125}`, of which `prior` had no effect."""


def config(**fields: Any) -> IntegratorConfig:
    return IntegratorConfig(**fields)


def test_a_mapping_names_a_rule_and_its_options() -> None:
    law = config(rule={"type": "posterior", "floor": 0.02})
    assert (law.rule, law.rule_options) == ("posterior", {"floor": 0.02})
    assert Integrator(law).rule.config == TrustConfig(floor=0.02)
    assert config(rule="posterior").rule_options == {}


def test_a_mapping_without_a_type_holds_options_of_the_default() -> None:
    law = config(condensation={"rate": 2.0})
    assert (law.condensation, law.condensation_options) == ("members", {"rate": 2.0})


def test_what_is_dumped_is_read_again() -> None:
    law = config(rule={"type": "posterior", "floor": 0.02}, condensation="cluster_mass")
    dumped = law.model_dump(mode="json")
    assert (dumped["rule"], dumped["condensation"]) == (
        {"type": "posterior", "floor": 0.02},
        "cluster_mass",
    )
    assert config(**dumped) == law


@pytest.mark.parametrize(
    ("part", "options"),
    [
        ("condensation", {"type": "cluster_centroid", "min_voxels": 0}),
        ("condensation", {"type": "cluster_mass", "mass_threshold": 0.0}),
        ("rule", {"type": "posterior", "floor": 0.0}),
        ("rule", {"type": "posterior", "flour": 0.02}),
        ("rule", {"prior": 0.1}),
    ],
    ids=str,
)
def test_a_wrong_option_is_named_with_its_place(part: str, options: dict[str, Any]) -> None:
    law, option = config(**{part: options}), list(options)[-1]
    with pytest.raises(ConfigurationError, match=f"^{part}.{option}: "):
        Integrator(law)
    with pytest.raises(ConfigurationError, match=f"^integrator.{part}.{option}: "):
        Pipeline(PipelineConfig(integrator=law))


def test_an_unknown_rule_of_a_pipeline_gets_the_nearest_name() -> None:
    with pytest.raises(PluginError, match="there is no rule 'de_morgn'; did you mean 'de_morgan'"):
        Pipeline(PipelineConfig(integrator=config(rule="de_morgn")))


def test_options_of_a_plug_in_that_stand_apart_are_refused_with_their_new_place() -> None:
    with pytest.raises(ConfigurationError, match="^options: .* as in `rule: {type: NAME, "):
        config(options={"x": 1})
    assert config(options={}) == config()


# Changes by --set


@pytest.mark.parametrize("rule", ["posterior", {"type": "posterior", "friction": 0.4}])
def test_an_option_is_changed_by_its_path(rule: Any) -> None:
    fields = overridden({"integrator": {"rule": rule}}, ["integrator.rule.floor=0.05"])
    options = config(**fields["integrator"]).rule_options
    assert options.pop("floor") == 0.05
    assert options == ({"friction": 0.4} if isinstance(rule, dict) else {})


def test_a_new_name_leaves_no_options_of_the_old_one() -> None:
    held = {"integrator": {"condensation": {"type": "cluster_mass", "mass_threshold": 0.7}}}
    changed = overridden(held, ["integrator.condensation=modes"])
    assert config(**changed["integrator"]).condensation_options == {}


# Fields of 0.1.0


def test_every_field_that_moved_is_an_option_of_the_parts_that_are_named() -> None:
    offered: dict[str, Any] = {**contactfusion_rules(), **contactfusion_condensations()}
    for key, (_, owners) in MOVED.items():
        assert owners == tuple(name for name in offered if key in offered[name].Config.model_fields)
        assert key not in IntegratorConfig.model_fields


def test_a_field_that_moved_is_read_with_a_sentence_that_names_its_new_place() -> None:
    with pytest.warns(FutureWarning) as caught:
        law = config(condensation="cluster_mass", mass_threshold=0.7)
    assert Integrator(law).condensation.config == ClusterMassConfig(mass_threshold=0.7)
    (warning,) = caught
    assert str(warning.message) == (
        "`mass_threshold` of the integrator is an option of the condensation now: write "
        "`condensation: {type: cluster_mass, mass_threshold: 0.7}`"
    )


def test_a_field_that_moved_and_has_no_effect_is_left_out_and_reported() -> None:
    with pytest.warns(FutureWarning, match="`mode_share` .* no effect with the condensation 'mem"):
        assert config(mode_share=0.3) == config()


# Rules and fields that were removed


@pytest.mark.parametrize("rule", REMOVED_RULES)
def test_a_rule_that_was_removed_is_one_sentence_that_names_its_replacement(rule: str) -> None:
    sentence = rf"^the rule '{rule}' was removed: take 'sets', and (only one|Null) [\w ]+$"
    with warnings.catch_warnings(action="error"):
        for given in (rule, {"type": rule, "prior": 0.1}):
            law = config(rule=given, prior=0.1)
            with pytest.raises(PluginError, match=sentence):
                Integrator(law)
            with pytest.raises(PluginError, match=sentence):
                Pipeline(PipelineConfig(integrator=law))


def test_a_field_that_was_removed_is_left_out_with_a_sentence_that_names_its_replacement() -> None:
    with pytest.warns(FutureWarning, match="`prior` .* was removed .* take 'sets', and Null "):
        assert config(prior=0.3) == config()


def test_a_command_says_once_that_a_field_has_moved(tmp_path: Path) -> None:
    skin = {"type": "tactile", "sensor": "skin", "patch": "skin", "baseline": {"noise": 0.05}}
    robot = "contactfusion.robots:mobile_base.yaml"
    integrator = {"condensation": "cluster_centroid", "min_voxels": 2}
    fields = {"robot": robot, "generators": {"skin": skin}, "integrator": integrator}
    file = tmp_path / "pipeline.yaml"
    file.write_text(yaml.safe_dump(fields))
    command = [sys.executable, "-m", "contactfusion", "check", str(file), str(MOVED_OPTIONS)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == (
        "contactfusion: `min_voxels` of the integrator is an option of the condensation now: write "
        "`condensation: {type: cluster_centroid, min_voxels: 2}`\n"
    )


def test_a_recording_of_an_earlier_version_is_replayed_with_its_options() -> None:
    with pytest.warns(FutureWarning) as caught:
        setting = setting_of_recording(MOVED_OPTIONS)
        contacts = [step.fusion.contacts for step in Session(setting, MOVED_OPTIONS).steps()]
    named = {str(warning.message).split("`")[1] for warning in caught}
    assert named == {"floor", "friction", "existence", "mode_share", "prior"}
    written = {
        "rule": {"type": "posterior", "floor": 0.02, "friction": 0.4},
        "condensation": {"type": "modes", "existence": 0.3, "mode_share": 0.4},
    }
    today = {"frame": "base", "voxel_size": 0.0125, **written}
    with warnings.catch_warnings(action="error"):
        fields = {**setting.fields, "integrator": today}
        again = replace(setting, fields=fields)
        expected = [step.fusion.contacts for step in Session(again, MOVED_OPTIONS).steps()]
    assert [len(found) for found in contacts] == [1, 1, 1]
    for found, wanted in zip(contacts, expected, strict=True):
        assert found[0].position.tolist() == wanted[0].position.tolist()
        assert found[0].likelihood == wanted[0].likelihood
