"""Noise has a name, or numbers."""

from typing import Any

import pytest

from contactfusion.errors import ConfigurationError
from contactfusion_lab.scenes.noise import NOISES, PARTS, TouchNoise
from contactfusion_lab.scenes.touch.config import TouchConfig

SCENE: dict[str, Any] = {
    "tool": "palm",
    "objects": {
        "box": {"shapes": [{"shape": "sphere", "radius": 0.1}], "pose": {"parent": "base"}}
    },
}


def noise(given: Any) -> TouchNoise:
    return TouchConfig(**SCENE, noise=given).noise


def test_without_noise_all_is_exact() -> None:
    differing = noise("none").model_dump(exclude_defaults=True)
    assert differing == {"belief": False}
    numbers = [value for value in noise("none").model_dump().values() if type(value) is float]
    assert sorted(set(numbers)) == [0.0, 10.0] and numbers.count(10.0) == 1  # finger_stiffness


def test_the_full_noise_is_at_least_that_of_the_prototype_and_its_fingers_softer() -> None:
    prototype, full = noise("prototype").model_dump(), noise("full").model_dump()
    softer = full.pop("finger_stiffness"), prototype.pop("finger_stiffness")
    assert softer[0] < softer[1]
    more = {name for name in prototype if full[name] != prototype[name]}
    assert all(full[name] > prototype[name] for name in more)
    assert more == {"force_zero", "torque_zero", "flying", "zeros"}


def test_a_touch_has_the_noise_of_the_prototype_unless_told() -> None:
    assert TouchConfig(**SCENE).noise == noise("prototype")
    assert noise("prototype").wrist_place == 0.0026


def test_noise_may_be_given_by_numbers() -> None:
    found = noise({"force": 0.3})
    assert found.force == 0.3 and found.torque == 0.0 and found.belief


def test_names_lead_to_noises_that_differ() -> None:
    found = [noise(name) for name in NOISES]
    assert len(found) == 3 and all(found.count(one) == 1 for one in found)


def test_hard_is_the_prototype_with_every_part_and_parts_go_alone() -> None:
    assert noise("hard") == noise("+".join(["prototype", *PARTS])) == noise("hard+wrist")
    alone = noise("prototype+wrist")
    assert alone.force_zero == 0.6 and alone.payload == 0.05
    assert alone.eye_place == noise("prototype").eye_place < noise("hard").eye_place


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            "protoype",
            r"noise: unknown noise 'protoype'.*did you mean 'prototype'\?.*full, hard, none",
        ),
        ("loud", "noise: unknown noise 'loud'.*the noises are: full, hard, none, prototype"),
        ("prototype+wirst", "unknown part of the noise hard 'wirst'.*did you mean 'wrist'"),
        ({"froce": 0.1}, r"noise\.froce: unknown field; did you mean 'force'"),
        ({"force": -0.1}, r"noise\.force: .*greater than or equal to 0"),
        ({"flying": 1.5}, r"noise\.flying: .*less than or equal to 1"),
        ({"finger_stiffness": 0.0}, r"noise\.finger_stiffness: .*greater than 0"),
    ],
)
def test_a_noise_that_cannot_be_is_refused(given: Any, sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        noise(given)
