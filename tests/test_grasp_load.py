"""What the wrist weighs: an object that hangs, that is lost, and a sensor that tells nothing."""

from typing import Any

import numpy as np
import pytest

from contactfusion.controllers.grasp_load import CarriedLoad, LoadConfig
from contactfusion.readings import Wrench

HAND = np.array([0.3, -11.0, 0.1])
"""What an empty hand weighs, and the bias of its sensor [N]."""
HIGH = 0.05


def wrenches(
    start: float, weight: float, seconds: float = 0.4, noise: float = 0.1, **fields: Any
) -> list[Wrench]:
    """What the wrist reads at 100 Hz of a hand that carries a weight [N]."""
    rng = np.random.default_rng(0)
    force = HAND + [0.0, -weight, 0.0] + noise * rng.standard_normal((round(seconds / 0.01), 3))
    return [
        Wrench(
            **{"stamp": start + 0.01 * k, "frame": "wrist", "sensor": "wrist", **fields},
            force=force[k],
            torque=np.zeros(3),
        )
        for k in range(len(force))
    ]


def carrying(weight: float = 4.0, **fields: Any) -> CarriedLoad:
    """A hand that has been empty, and has lifted a weight since 1 s."""
    load = CarriedLoad(LoadConfig(**{"sensor": "wrist", **fields}))
    load.feel(wrenches(0.0, 0.0), 0.4)
    load.tare()
    load.begin()
    load.feel(wrenches(1.0, weight), 1.4)
    return load


def test_what_hangs_in_the_hand_has_not_slipped() -> None:
    load = carrying()
    assert load.slip(HIGH) == ""
    load.feel(wrenches(2.0, 2.4), 2.4)
    assert load.slip(HIGH) == ""


@pytest.mark.parametrize("left", [0.0, 1.0, 1.8])
def test_what_has_lost_a_share_of_its_weight_has_slipped(left: float) -> None:
    load = carrying()
    load.slip(HIGH)
    load.feel(wrenches(2.0, left), 2.4)
    said = load.slip(HIGH)
    assert said is not None and said.startswith("of 4.0 N it still lifts")


def test_a_jerk_is_no_slip() -> None:
    load = carrying()
    load.slip(HIGH)
    load.feel(wrenches(2.0, 4.0, 0.15), 2.15)
    load.feel(wrenches(2.15, 0.0, 0.05), 2.2)
    assert load.slip(HIGH) == ""
    load.feel(wrenches(2.2, 0.0, 0.1), 2.3)
    assert load.slip(HIGH)


def test_an_object_is_weighed_when_it_hangs_free() -> None:
    load = carrying(weight=0.1)
    assert load.slip(0.02) == ""
    assert load.slip(0.04) == "it lifts 0.1 N: nothing"


def test_another_object_may_weigh_less() -> None:
    load = carrying()
    load.slip(HIGH)
    load.begin()
    load.feel(wrenches(2.0, 1.0), 2.4)
    assert load.slip(HIGH) == ""


def test_a_sensor_that_is_silent_repeats_itself_or_is_another_weighs_nothing() -> None:
    silent = carrying()
    assert silent.slip(HIGH) == ""
    silent.feel([], 2.0)
    dead = carrying()
    dead.feel(wrenches(2.0, 0.0, noise=0.0), 2.4)
    other = CarriedLoad(LoadConfig(sensor="ankle"))
    other.feel(wrenches(0.0, 0.0), 0.4)
    other.tare()
    other.feel(wrenches(1.0, 4.0), 1.4)
    assert [load.slip(HIGH) for load in (silent, dead, other)] == [None, None, None]


def test_without_a_rest_before_it_nothing_is_weighed() -> None:
    load = CarriedLoad(LoadConfig(sensor="wrist"))
    load.tare()
    load.feel(wrenches(1.0, 4.0), 1.4)
    assert load.slip(HIGH) is None
