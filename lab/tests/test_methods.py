"""Methods of experiments: their names, and spreads that are multiplied."""

from dataclasses import replace

import pytest

from contactfusion.errors import ConfigurationError, PluginError
from contactfusion.integrator.config import IntegratorConfig
from contactfusion_lab.experiments.methods import (
    DE_MORGAN,
    DE_MORGAN_TUNED,
    DEFAULT_METHOD,
    POSTERIOR,
    Method,
    with_spreads,
)


def test_a_method_is_named_by_its_rule_and_its_condensation() -> None:
    assert Method.named("posterior/modes") == POSTERIOR
    assert str(Method.named("de_morgan/cluster_mass")) == "de_morgan/cluster_mass"


def test_a_rule_alone_brings_its_condensation() -> None:
    assert Method.named("sets") == Method("sets", "members")
    assert Method.named("de_morgan") == DE_MORGAN
    assert Method.named("posterior") == Method("posterior", "cluster_centroid")


def test_the_default_method_is_what_fuses_with_nothing_set() -> None:
    for nothing_set in (IntegratorConfig(frame="lab"), IntegratorConfig(threshold=0.7)):
        assert DEFAULT_METHOD.applied(nothing_set) == nothing_set
    assert DEFAULT_METHOD == Method.named("sets/members")


def test_what_is_not_there_and_what_does_not_fit_is_reported() -> None:
    with pytest.raises(PluginError, match="did you mean 'de_morgan'"):
        Method.named("de_morgen")
    with pytest.raises(PluginError, match="the rule 'max' was removed: take 'sets'"):
        Method.named("max/modes")
    with pytest.raises(ConfigurationError, match="'modes' needs the rule 'posterior'"):
        Method.named("de_morgan/modes")


def test_a_method_changes_rule_and_condensation_alone() -> None:
    config = IntegratorConfig(frame="lab", voxel_size=0.002)
    applied = POSTERIOR.applied(config)
    assert (applied.rule, applied.condensation) == ("posterior", "modes")
    changed = {"rule": "posterior", "condensation": "modes", "threshold": 0.1}
    assert applied == config.model_copy(update=changed)


def test_a_factor_of_spreads_is_reported_in_names() -> None:
    half = Method("posterior", "modes", 0.5)
    assert str(half) == "posterior/modes, σ × 0.5"
    assert len({half.stem, POSTERIOR.stem, DE_MORGAN.stem}) == 3 and "/" not in half.stem


def test_only_methods_that_look_at_spreads_fuse_once_more() -> None:
    methods = [DEFAULT_METHOD, DE_MORGAN, POSTERIOR]
    assert with_spreads(methods, []) == methods
    assert with_spreads(methods, [0.5, 2.0, 1.0]) == [
        *methods,
        Method("sets", "members", 0.5),
        Method("posterior", "modes", 0.5),
        Method("sets", "members", 2.0),
        Method("posterior", "modes", 2.0),
    ]


def test_a_method_that_is_tuned_is_named_by_a_name_of_its_own() -> None:
    assert Method.named("de_morgan_tuned") == DE_MORGAN_TUNED
    assert str(DE_MORGAN_TUNED) == DE_MORGAN_TUNED.stem == "de_morgan_tuned"
    assert hash(DE_MORGAN_TUNED) != hash(DE_MORGAN)
    with pytest.raises(PluginError, match="did you mean 'de_morgan'"):
        Method.named("de_morgan_tune")


def test_a_method_sets_fields_of_the_integrator() -> None:
    method = replace(
        DE_MORGAN,
        condensation="cluster_mass",
        options=(("voxel_size", 0.02), ("condensation_options", (("mass_threshold", 0.7),))),
    )
    applied = method.applied(IntegratorConfig(frame="lab"))
    assert (applied.voxel_size, applied.frame) == (0.02, "lab")
    assert applied.condensation_options == {"mass_threshold": 0.7}
    integrator = method.integrator(IntegratorConfig(frame="lab"))
    assert integrator.condensation.config.model_dump() == {"mass_threshold": 0.7}


@pytest.mark.parametrize("factor", [0.0, -1.0, float("inf"), float("nan")])
def test_a_factor_that_is_none_is_refused(factor: float) -> None:
    with pytest.raises(ConfigurationError, match="multiplied by more than 0, not by"):
        with_spreads([POSTERIOR], [factor])


def test_a_factor_that_would_change_nothing_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="none of these rules looks at spreads"):
        with_spreads([DE_MORGAN, DE_MORGAN_TUNED], [2.0])
