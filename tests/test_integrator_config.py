"""Rules and condensations with options, and the fields of 0.1.0 that became such options."""

import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import yaml

from contactfusion import Integrator, IntegratorConfig, Pipeline, PipelineConfig
from contactfusion.errors import REMOVED, ConfigurationError, PluginError
from contactfusion.hooks import GROUP
from contactfusion.integrator.condensations import (
    ClusterCentroidConfig,
    contactfusion_condensations,
)
from contactfusion.integrator.config import MOVED
from contactfusion.integrator.rules import contactfusion_rules
from contactfusion.integrator.sets import TrustConfig
from contactfusion.pipeline_config import overridden
from contactfusion.plugins import Plugins
from contactfusion.run.configuration import setting_of_recording
from contactfusion.run.session import Session

MOVED_OPTIONS = Path(__file__).parent / "data" / "moved_options.mcap"
"""tests/data/kept.mcap, replayed at commit 539ebf7 with `integrator: {frame: base, rule: posterior,
floor: 0.02, friction: 0.4, condensation: modes, existence: 0.3, mode_share: 0.4, prior: 0.1,
voxel_size: 0.0125}`, of which `prior` had no effect."""
REMOVED_PARTS = [(part, name) for part, names in REMOVED.items() for name in names]


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the laboratory."""
    ours = [point for point in entry_points(group=GROUP) if "_lab" not in point.module]
    plugins = Plugins(points=ours)
    monkeypatch.setattr("contactfusion.assembly.installed_plugins", lambda: plugins)


def config(**fields: Any) -> IntegratorConfig:
    return IntegratorConfig(**fields)


def test_a_mapping_names_a_rule_and_its_options() -> None:
    law = config(rule={"type": "sets", "floor": 0.02})
    assert (law.rule, law.rule_options) == ("sets", {"floor": 0.02})
    assert Integrator(law).rule.config == TrustConfig(floor=0.02)
    assert config(rule="sets").rule_options == {}


def test_a_mapping_without_a_type_holds_options_of_the_default() -> None:
    law = config(condensation={"rate": 2.0})
    assert (law.condensation, law.condensation_options) == ("members", {"rate": 2.0})


def test_what_is_dumped_is_read_again() -> None:
    law = config(rule={"type": "sets", "floor": 0.02}, condensation="cluster_centroid")
    dumped = law.model_dump(mode="json")
    assert (dumped["rule"], dumped["condensation"]) == (
        {"type": "sets", "floor": 0.02},
        "cluster_centroid",
    )
    assert config(**dumped) == law


@pytest.mark.parametrize(
    ("part", "options"),
    [
        ("condensation", {"type": "cluster_centroid", "min_voxels": 0}),
        ("rule", {"type": "sets", "floor": 0.0}),
        ("rule", {"type": "sets", "flour": 0.02}),
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


@pytest.mark.parametrize("rule", ["sets", {"type": "sets", "friction": 0.4}])
def test_an_option_is_changed_by_its_path(rule: Any) -> None:
    fields = overridden({"integrator": {"rule": rule}}, ["integrator.rule.floor=0.05"])
    options = config(**fields["integrator"]).rule_options
    assert options.pop("floor") == 0.05
    assert options == ({"friction": 0.4} if isinstance(rule, dict) else {})


def test_a_new_name_leaves_no_options_of_the_old_one() -> None:
    held = {"integrator": {"condensation": {"type": "cluster_centroid", "min_voxels": 2}}}
    changed = overridden(held, ["integrator.condensation=threshold"])
    assert config(**changed["integrator"]).condensation_options == {}


# Fields of 0.1.0


def test_every_field_that_moved_is_an_option_of_the_parts_that_are_named() -> None:
    offered: dict[str, Any] = {**contactfusion_rules(), **contactfusion_condensations()}
    for key, (part, owners) in MOVED.items():
        kept = [name for name in owners if name not in REMOVED[part]]
        assert kept == [name for name in offered if key in offered[name].Config.model_fields]
        assert key not in IntegratorConfig.model_fields


def test_a_field_that_moved_is_read_with_a_sentence_that_names_its_new_place() -> None:
    with pytest.warns(FutureWarning) as caught:
        law = config(condensation="cluster_centroid", min_voxels=2)
    assert Integrator(law).condensation.config == ClusterCentroidConfig(min_voxels=2)
    (warning,) = caught
    assert str(warning.message) == (
        "`min_voxels` of the integrator is an option of the condensation now: write "
        "`condensation: {type: cluster_centroid, min_voxels: 2}`"
    )


def test_a_field_that_moved_and_has_no_effect_is_left_out_and_reported() -> None:
    with pytest.warns(FutureWarning, match="`mode_share` .* no effect .* 'members': leave it out$"):
        assert config(mode_share=0.3) == config()
    with pytest.warns(FutureWarning, match="`floor` .* no effect .* an option of `rule: {type: se"):
        assert config(rule="de_morgan", floor=0.3) == config(rule="de_morgan")


# Rules and fields that were removed


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(("part", "name"), REMOVED_PARTS)
def test_what_was_removed_is_one_sentence_that_names_its_replacement(part: str, name: str) -> None:
    sentence = rf"^the {part} '{name}' was removed: (take 'sets', and|leave `rule` and `con)[^.;]+$"
    for given in (name, {"type": name, "x": 0.1}):
        law = config(**{part: given})
        with pytest.raises(PluginError, match=sentence):
            Integrator(law)
        with pytest.raises(PluginError, match=sentence):
            Pipeline(PipelineConfig(integrator=law))


@pytest.mark.parametrize(
    "fields",
    [
        *({"rule": rule, "prior": 0.1} for rule in REMOVED["rule"]),
        {"rule": "posterior", "floor": 0.02, "condensation": "modes", "mode_share": 0.4},
        {"condensation": "cluster_mass", "mass_threshold": 0.7},
    ],
    ids=str,
)
def test_of_what_was_removed_the_fields_of_0_1_0_need_no_sentence(fields: dict[str, Any]) -> None:
    with pytest.raises(PluginError, match="was removed"):
        Integrator(config(**fields))


@pytest.mark.usefixtures("alone")
def test_a_recording_of_an_earlier_version_by_what_was_removed_is_one_sentence() -> None:
    setting = setting_of_recording(MOVED_OPTIONS)
    with pytest.raises(ConfigurationError, match="the rule 'posterior' was removed: leave `rule` "):
        Session(setting, MOVED_OPTIONS)


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
