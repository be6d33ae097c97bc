"""The pages on scenes hold what the scenes take."""

import re

import yaml

from contactfusion.robots.objects import ObjectConfig
from contactfusion_lab.experiments.push.plan import NAMED, STARTS
from contactfusion_lab.experiments.push.suites import SENSINGS
from contactfusion_lab.scenes.noise import NOISES, TouchNoise
from contactfusion_lab.scenes.push.config import OTHERS
from contactfusion_lab.scenes.push.noise import PARTS, PushNoise
from contactfusion_lab.scenes.touch.config import TouchConfig
from tests.test_docs import SCENES, unnamed

PUSH = SCENES.with_name("push.md")


def test_the_page_on_scenes_names_every_field() -> None:
    assert not unnamed(TouchConfig, SCENES.read_text(), elsewhere=ObjectConfig)


def test_the_page_on_scenes_names_every_error_of_a_push() -> None:
    assert not unnamed(PushNoise, SCENES.read_text())


def test_the_page_on_pushes_names_every_part_object_and_sensing() -> None:
    page = PUSH.read_text()
    names = (*PARTS, *OTHERS, *NAMED, *STARTS, *SENSINGS)
    assert not [name for name in names if f"`{name}`" not in page]


def test_the_page_on_scenes_tells_the_noises_as_they_are() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.+) \| (.+) \| (.+) \| .+ \|$", SCENES.read_text(), re.M)
    told = {name: [yaml.safe_load(value) for value in values] for name, *values in rows}
    noises = [TouchNoise.model_validate(name) for name in ("none", "prototype", "full")]
    assert len(noises) == len(NOISES)
    assert told == {
        name: [getattr(noise, name) for noise in noises] for name in TouchNoise.model_fields
    }
