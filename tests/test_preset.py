"""A preset takes the place of defaults, never of what is given."""

from typing import Any

import pytest

from contactfusion.assembly import built_controller, built_generator
from contactfusion.controllers.pushing_parameters import SETS
from contactfusion.errors import ConfigurationError
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.preset import PRESETS

FIELDS: dict[str, Any] = {
    "generators": {
        "camera": {"type": "rgbd_cpm", "margin": 0.02},
        "near": {"type": "range"},
        "other": {"type": "a_stranger", "p_max": 0.4},
    },
    "integrator": {"voxel_size": 0.01, "threshold": 0.3},
    "controller": {"type": "reactive_pushing", "target": [1.0, 0.0]},
}


def test_what_is_given_stays_and_the_preset_gives_the_rest() -> None:
    config = PipelineConfig(**FIELDS, preset="paper")
    camera = config.generators["camera"]
    assert (camera["margin"], camera["ends"], camera["body"], camera["p_max"]) == (
        0.02, "edge", None, 1.0,
    )  # fmt: skip
    assert config.generators["other"] == FIELDS["generators"]["other"]
    integrator = config.integrator
    assert (integrator.rule, integrator.expiry) == ("de_morgan", "voxel")
    assert (integrator.voxel_size, integrator.threshold) == (0.01, 0.3)
    controller = built_controller(config)
    assert controller is not None
    assert controller.config.model_dump()["parameters"] == SETS["paper"].model_dump()


def test_over_a_configuration_it_replaces_what_is_given() -> None:
    fields = PRESETS["paper"].over(FIELDS)
    assert fields["generators"]["camera"]["margin"] == 0.0
    assert fields["integrator"] == {"voxel_size": 0.01, **PRESETS["paper"].integrator}
    assert FIELDS["generators"]["camera"] == {"type": "rgbd_cpm", "margin": 0.02}


def test_a_configuration_without_integrator_gets_the_preset_too() -> None:
    assert PipelineConfig(preset="paper").integrator.expiry == "voxel"


@pytest.mark.parametrize("kind", PRESETS["paper"].generators)
def test_every_option_of_a_preset_is_one_of_its_plug_in(kind: str) -> None:
    needed: dict[str, Any] = {
        "tactile": {"patch": {"places": [[0.0, 0.0, 0.0]], "size": (0.004, 0.004)}},
        "force_torque": {"sign": "on_robot"},
    }
    options = {"type": kind, **PRESETS["paper"].generators[kind], **needed.get(kind, {})}
    built = built_generator("name", options)
    for name, value in PRESETS["paper"].generators[kind].items():
        assert getattr(built.config, name) == value


def test_a_misspelt_preset_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="preset: unknown preset 'papre'.*'paper'"):
        PipelineConfig(preset="papre")
