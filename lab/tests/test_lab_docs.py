"""The pages on scenes hold what the scenes take."""

import re

import yaml

from contactfusion.robots.objects import ObjectConfig
from contactfusion_lab.scenes.noise import NOISES, TouchNoise
from contactfusion_lab.scenes.touch.config import TouchConfig
from tests.test_docs import SCENES, unnamed


def test_the_page_on_scenes_names_every_field() -> None:
    assert not unnamed(TouchConfig, SCENES.read_text(), elsewhere=ObjectConfig)


def test_the_page_on_scenes_states_the_noises_as_they_are() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.+) \| (.+) \| (.+) \| .+ \|$", SCENES.read_text(), re.M)
    documented = {name: [yaml.safe_load(value) for value in values] for name, *values in rows}
    noises = [TouchNoise.model_validate(name) for name in ("none", "prototype", "full")]
    assert len(noises) == len(NOISES)
    assert documented == {
        name: [getattr(noise, name) for noise in noises] for name in TouchNoise.model_fields
    }
