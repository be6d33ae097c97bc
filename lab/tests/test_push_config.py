"""The configuration of a push, and what it refuses in a sentence."""

import json
from typing import Any

import pytest

from contactfusion.errors import ConfigurationError
from contactfusion_lab.scenes.push.config import PAPER, PushConfig, named_object
from contactfusion_lab.scenes.push.objects import BoxConfig


def config(**fields: Any) -> PushConfig:
    return PushConfig(**{"target": (1.0, 0.0), **fields})


def test_the_paper_s_box_is_pushed_on_the_paper_s_first_floor() -> None:
    plain = config()
    assert plain.object == BoxConfig(**PAPER["box"])
    assert (plain.friction.ground, plain.friction.robot) == (0.3, 0.35)


def test_names_stand_for_objects_and_frictions() -> None:
    push = config(object="nonuniform", friction="mu2")
    assert push.object == named_object("nonuniform")
    assert (push.friction.ground, push.friction.robot) == (0.2, 0.5)


def test_fields_stand_for_themselves() -> None:
    fields = {"shape": "cylinder", "radius": 0.2, "height": 0.5, "mass": 3.0}
    push = config(object=fields, friction={"ground": 0.4, "robot": 0.0})
    assert push.object.model_dump() == fields
    assert (push.friction.ground, push.friction.robot) == (0.4, 0.0)


@pytest.mark.parametrize("name", ["lshape", "soft_cylinder", "ball_box"])
def test_a_push_is_read_from_what_it_dumps(name: str) -> None:
    shove = {"start": 1.0, "force": (9.0, 0.0)}
    push = config(object=name, friction="mu2", offset=0.1, yaw=-30.0, disturbances=(shove,))
    assert PushConfig(**push.model_dump()) == push
    assert PushConfig(**json.loads(push.model_dump_json())) == push


@pytest.mark.parametrize("steps", [12, 24, 25, 240])
def test_a_period_is_whole_steps(steps: int) -> None:
    assert config(period=steps / 240.0).period == steps / 240.0


def test_a_target_is_a_metre_within_the_field() -> None:
    assert config(target=(3.0, -4.0)).target == (3.0, -4.0)
    assert config(target=(6.0, 0.0), furthest=7.0).target == (6.0, 0.0)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"object": "cilinder"}, "^object: unknown object 'cilinder'; did you mean 'cylinder'"),
        ({"friction": "mu3"}, "^friction: unknown friction 'mu3'; did you mean 'mu2'"),
        ({"friction": {"ground": 0.0, "robot": 0.3}}, r"^friction\.ground: .* greater than 0"),
        ({"object": {**PAPER["box"], "mass": -1.0}}, "mass: .* greater than 0, not -1"),
        ({"object": {"shape": "box", "size": (1, 1, 0), "mass": 1}}, r"size\.2: .* greater than 0"),
        ({"target": (float("nan"), 0.0)}, r"^target\.0: .* finite number, not nan"),
        ({"target": (0.0, float("inf"))}, r"^target\.1: .* finite number, not inf"),
        ({"target": (1e9, 0.0)}, r"^target\.0: .* less than or equal to 100"),
        ({"target": (0.0, -5.1)}, r"^target: \(0\.0, -5\.1\) is out of reach: .*`furthest` 6 m"),
        ({"period": 0.09}, "^period: the physics takes 240 steps a second"),
        ({"period": 1.0 / 240.0}, "^period: .* greater than or equal to 0.05"),
        ({"gap": -0.1}, "^gap: .* greater than or equal to 0"),
        ({"skin": {"noise": -0.1}}, r"^skin\.noise: .* greater than or equal to 0"),
        ({"skin": {"activation": -1.0}}, r"^skin\.activation: "),
        (
            {"disturbances": ({"start": 2.0, "duration": -1.0, "force": (9.0, 0.0)},)},
            r"^disturbances\.0\.duration: .* greater than or equal to 0.01, not -1",
        ),
        (
            {"disturbances": ({"start": -2.0, "force": (9.0, 0.0)},)},
            r"^disturbances\.0\.start: .* greater than or equal to 0, not -2",
        ),
        (
            {"disturbances": ({"start": 2.0, "force": (9.0, float("nan"))},)},
            r"^disturbances\.0\.force\.1: .* finite number, not nan",
        ),
        ({"longst": 3.0}, "^longst: unknown field; did you mean 'longest'"),
    ],
)
def test_what_cannot_be_is_reported_with_its_field(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem) as error:
        config(**fields)
    assert "\n" not in str(error.value)


def test_a_push_needs_a_target() -> None:
    fields: dict[str, Any] = {"offset": 0.1}
    with pytest.raises(ConfigurationError, match="^target: this field is required$"):
        PushConfig(**fields)


def test_a_target_so_far_that_no_object_gets_there_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"target: \(4.9, 4.9\) is out of reach"):
        config(target=(4.9, 4.9))
    assert config(target=(3.0, -3.0)).target == (3.0, -3.0)
