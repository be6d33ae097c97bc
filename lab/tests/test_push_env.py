"""Pushing as a Gymnasium environment."""

from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.readings import Odometry, TactileImage
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.env import FASTEST, Observation, PushEnv
from lab.tests.test_push_world import base

AHEAD = np.array([0.2, 0.0, 0.0])


def env(**fields: Any) -> PushEnv:
    return PushEnv(PushConfig(**{"target": (0.4, 0.0), **fields}), base())


def same(first: Observation, second: Observation) -> bool:
    return all(np.array_equal(first[name], second[name]) for name in (*first, *second))


def after(pushing: PushEnv, cycles: int, *action: float) -> Observation:
    """The last observation."""
    return [pushing.step(np.array(action))[0] for _ in range(cycles)][-1]


def test_it_is_what_gymnasium_calls_an_environment() -> None:
    """Warnings of the checker would be errors here."""
    check_env(env(), skip_render_check=True)


def test_the_same_seed_and_twists_give_the_same_observations() -> None:
    pushing, other = env(), env(object="cylinder")
    first, _ = pushing.reset(seed=7)
    second, _ = other.reset(seed=7, options={"object": "box"})
    assert same(first, second)
    rng = np.random.default_rng(0)
    for _ in range(15):
        action = rng.uniform(-0.3, 0.5, 3)
        observed, *rest = pushing.step(action)
        again, *others = other.step(action)
        assert same(observed, again) and rest == others
    assert not same(pushing.reset(seed=8)[0], first)
    assert same(pushing.reset(seed=7)[0], first)


def test_without_a_seed_chance_goes_on() -> None:
    first, second = env(), env()
    seen = []
    for each in (first, second):
        each.reset(seed=7)
        seen.append(each.reset()[0])
    assert same(*seen)
    assert not same(seen[0], env().reset(seed=7)[0])


def test_an_observation_is_what_sensors_read_and_the_target() -> None:
    pushing = env(target=(1.0, 0.5))
    pushing.reset(seed=0)
    observed = after(pushing, 15, 0.2, 0.0, 0.25)
    odometry, twist, image = pushing.readings
    assert isinstance(odometry, Odometry)
    assert isinstance(image, TactileImage)
    assert observed["target"].tolist() == [1.0, 0.5]
    assert np.array_equal(observed["skin"], image.values) and observed["skin"].max() > 1.0
    assert observed["pose"] == pytest.approx(np.array(pushing.truth.base))
    assert observed["pose"][2] == pytest.approx(0.375, abs=1e-4)
    assert observed["twist"] == pytest.approx(np.array([0.2, 0.0, 0.25]), abs=5e-3)


def test_exteroceptive_sensors_add_to_the_readings_and_change_no_observation() -> None:
    seeing, blind = env(sees=("lidar",)), env()
    assert same(seeing.reset(seed=3)[0], blind.reset(seed=3)[0])
    assert same(after(seeing, 3, *AHEAD), after(blind, 3, *AHEAD))
    assert [reading.sensor for reading in seeing.readings] == [
        "odometry",
        "wheels",
        "skin",
        "lidar",
    ]


def test_yaw_is_reported_within_half_a_turn_and_twists_are_limited() -> None:
    pushing = env(gap=1.0)
    pushing.reset(seed=0)
    observed = after(pushing, 40, 0.0, 0.0, 5.0)
    assert pushing.truth.base[2] == pytest.approx(40 * 0.1 * FASTEST[2])
    assert observed["pose"][2] == pytest.approx(4.0 - 2.0 * np.pi)
    assert pushing.observation_space.contains(observed)


def test_rewards_add_up_to_the_distance_that_is_gained() -> None:
    pushing, rewards, distances, over = env(), [0.0], [], False
    pushing.reset(seed=0)
    while not over:
        _, reward, over, truncated, info = pushing.step(AHEAD)
        assert not truncated
        rewards.append(reward)
        if info["touch"] != "none":
            distances.append(pushing.truth.distance)
    assert sum(rewards) == pytest.approx(distances[0] - distances[-1])
    assert distances[0] > 0.35 and distances[-1] <= 0.05 < distances[-2]


def test_what_is_gained_while_contact_is_lost_counts_at_the_next() -> None:
    """The robot backs off, moves aside, and touches elsewhere, nearer to the target."""
    pushing = env(target=(1.0, 0.5))
    pushing.reset(seed=0)
    rewards, distances = [0.0], []
    for action in [(0.2, 0.0)] * 5 + [(-0.2, 0.0)] * 3 + [(0.0, 0.2)] * 8 + [(0.2, 0.0)] * 6:
        _, reward, _, _, info = pushing.step(np.array([*action, 0.0]))
        rewards.append(reward)
        distances += [pushing.truth.distance] * (info["touch"] != "none")
    assert rewards[10:15] == [0.0] * 5
    assert sum(rewards) == pytest.approx(distances[0] - distances[-1])


def test_going_away_costs_what_it_loses() -> None:
    pushing = env(target=(-1.0, 0.0))
    pushing.reset(seed=0)
    rewards = [pushing.step(AHEAD)[1] for _ in range(10)]
    assert sum(rewards[5:]) == pytest.approx(-5 * 0.02, abs=5e-3)


def test_without_contact_there_is_no_reward_and_no_arrival() -> None:
    """The robot stands with its face at the target."""
    pushing = env(gap=1.0, target=(0.02, 0.0))
    pushing.reset(seed=0)
    for _ in range(3):
        _, reward, terminated, _, info = pushing.step(AHEAD / 4.0)
        assert (reward, terminated, info) == (0.0, False, {"touch": "none"})


@pytest.mark.parametrize(
    ("fields", "cycles"), [({"longest": 0.5}, 5), ({"furthest": 1.7, "gap": 0.0}, 75)]
)
def test_a_push_is_truncated_by_time_and_by_distance(fields: dict[str, Any], cycles: int) -> None:
    pushing = env(target=(-0.5, 0.4), **fields)
    pushing.reset(seed=0)
    over = [pushing.step(AHEAD)[2:4] for _ in range(cycles + 2)]
    assert over[: cycles - 2] == [(False, False)] * (cycles - 2)
    assert over[-1] == (False, True)


def test_options_change_one_push_only() -> None:
    pushing = env()
    changed, _ = pushing.reset(seed=0, options={"target": (1.0, -1.0), "object": "cylinder"})
    assert changed["target"].tolist() == [1.0, -1.0]
    assert pushing.truth.object[0] == pytest.approx(0.251, abs=1e-3)
    plain, _ = pushing.reset(seed=0)
    assert plain["target"].tolist() == [0.4, 0.0]
    assert pushing.truth.object[0] == pytest.approx(0.201, abs=1e-3)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"tarpet": (1, 1)}, "^tarpet: unknown field; did you mean 'target'"),
        ({"target": (float("nan"), 1)}, r"^target\.0: .* finite"),
        ({"object": "bax"}, "^object: unknown object 'bax'; did you mean 'box'"),
        ({"offset": 2.0}, "^offset: the object starts out of sight"),
    ],
)
def test_an_option_that_is_wrong_is_reported(options: dict[str, Any], problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        env().reset(seed=0, options=options)


def test_a_twist_that_is_not_finite_is_refused() -> None:
    pushing = env()
    pushing.reset(seed=0)
    with pytest.raises(InvalidReadingError, match="an action is a finite twist"):
        pushing.step(np.array([0.1, np.nan, 0.0]))
