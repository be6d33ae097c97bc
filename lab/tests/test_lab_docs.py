"""The pages on scenes hold what the scenes take."""

import re

import yaml

from contactfusion.robots.objects import ObjectConfig
from contactfusion_lab.experiments.push.plan import NAMED, STARTS
from contactfusion_lab.experiments.push.suites import SENSINGS
from contactfusion_lab.scenes.noise import NOISES, PARTS, TouchNoise
from contactfusion_lab.scenes.push import noise as push_noise
from contactfusion_lab.scenes.push.config import OTHERS
from contactfusion_lab.scenes.touch.config import TouchConfig
from tests.test_docs import SCENES, unnamed

PUSH = SCENES.with_name("push.md")


def test_the_page_on_scenes_names_every_field() -> None:
    assert not unnamed(TouchConfig, SCENES.read_text(), elsewhere=ObjectConfig)


def test_the_page_on_scenes_names_every_error_of_a_push() -> None:
    assert not unnamed(push_noise.PushNoise, SCENES.read_text())


def test_the_page_on_pushes_names_every_part_object_and_sensing() -> None:
    page = PUSH.read_text()
    names = (*push_noise.PARTS, *OTHERS, *NAMED, *STARTS, *SENSINGS)
    assert not [name for name in names if f"`{name}`" not in page]


def test_the_page_on_scenes_states_the_noises_as_they_are() -> None:
    rows = re.findall(r"^\| `(\w+)` \| ([^`]+) \| (.+) \| (.+) \| .+ \|$", SCENES.read_text(), re.M)
    documented = {name: [yaml.safe_load(value) for value in values] for name, *values in rows}
    noises = [TouchNoise.model_validate(name) for name in ("none", "prototype", "full")]
    assert len(noises) == len(NOISES)
    assert documented == {name: [getattr(noise, name) for noise in noises] for name in documented}
    assert {*documented, *(name.partition(".")[0] for _, name, _, _ in hard())} == {
        *TouchNoise.model_fields
    }


def test_the_page_on_scenes_tells_each_part_of_the_hard_noise_and_its_source() -> None:
    noise = TouchNoise.model_validate("hard").model_dump(mode="json")
    told: dict[str, list[str]] = {}
    for part, name, value, source in hard():
        field, _, inner = name.partition(".")
        assert yaml.safe_load(value) == (noise[field][inner] if inner else noise[field]), name
        assert source
        told.setdefault(part, []).append(name)
    flat = {
        part: sorted(
            f"{name}.{inner}" if inner else name
            for name, value in fields.items()
            for inner in (value if isinstance(value, dict) else ("",))
        )
        for part, fields in PARTS.items()
    }
    assert {part: sorted(names) for part, names in told.items()} == flat


def hard() -> list[tuple[str, ...]]:
    """The rows on `hard`: part, field, value, source."""
    row = r"^\| `(\w+)` \| `([\w.]+)` \| (.+) \| .+ \| (.+) \|$"
    return re.findall(row, SCENES.read_text(), re.M)
