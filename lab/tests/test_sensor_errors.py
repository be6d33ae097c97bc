"""Errors of wrists, taxels and ranges are as wide as stated, and readings as late."""

import math
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.readings import (
    DepthImage,
    JointState,
    ObjectPose,
    Odometry,
    PointCloud,
    Reading,
    TactileImage,
    Wrench,
)
from contactfusion_lab.scenes.sensor_errors import (
    RECOVERY,
    Arrivals,
    Delays,
    RangeErrors,
    RangeNoise,
    TaxelErrors,
    TaxelNoise,
    WristErrors,
)

WRENCH = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3])
WEIGHT = np.array([0.0, 0.0, -10.0, 0.5, 0.0, 0.0])
GRID = np.stack([*np.meshgrid(np.arange(5), np.arange(4), 0.0)], axis=-1).reshape(-1, 3) * 0.004


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


# Wrists


def wrist(seed: int = 0, **given: float) -> WristErrors:
    drift = np.repeat([given.get("force", 0.0), given.get("torque", 0.0)], 3)
    return WristErrors(drift, given.get("crosstalk", 0.0), given.get("payload", 0.0), rng(seed))


def test_a_wrist_without_errors_reads_what_is() -> None:
    assert np.array_equal(wrist().read(50.0, WRENCH, WEIGHT), WRENCH)


def test_the_zero_of_a_wrist_drifts_at_a_constant_rate() -> None:
    drifting = wrist(force=0.2, torque=0.01)
    start, minute, hour = (drifting.read(t, WRENCH, WEIGHT) for t in (0.0, 60.0, 3600.0))
    assert np.array_equal(start, WRENCH) and np.abs(minute - start).min() > 0.0
    assert np.allclose(hour - start, 60.0 * (minute - start))
    rates = [
        wrist(s, force=0.2, torque=0.01).read(60.0, WRENCH, WEIGHT) - WRENCH for s in range(300)
    ]
    assert np.std(rates, axis=0) == pytest.approx(np.repeat([0.2, 0.01], 3), rel=0.15)


def test_cross_talk_mixes_components_of_force_and_components_of_torque_but_not_both() -> None:
    units = np.eye(6)
    found = np.array(
        [[wrist(s, crosstalk=0.02).read(0.0, unit, WEIGHT) for unit in units] for s in range(300)]
    )
    assert np.array_equal(found[:, range(6), range(6)], np.ones((300, 6)))
    assert not found[:, :3, 3:].any() and not found[:, 3:, :3].any()
    across = np.kron(np.eye(2), 1.0 - np.eye(3)) > 0
    assert np.std(found, axis=0)[across] == pytest.approx([0.02] * 12, rel=0.2)


def test_a_payload_weighs_more_or_less_by_a_constant_share() -> None:
    shares = []
    for seed in range(300):
        one = wrist(seed, payload=0.05)
        off = one.read(0.0, WRENCH, WEIGHT) - WRENCH
        assert np.allclose(one.read(9.0, WRENCH, 2.0 * WEIGHT) - WRENCH, 2.0 * off)
        share = off[2] / WEIGHT[2]
        assert np.allclose(off, share * WEIGHT)
        shares.append(share)
    assert np.std(shares) == pytest.approx(0.05, rel=0.15)
    assert abs(np.mean(shares)) < 0.01


# Taxels


def taxels(seed: int = 0, **noise: Any) -> TaxelErrors:
    return TaxelErrors(GRID, TaxelNoise(**noise), rng(seed))


def single(taxel: int, force: float = 1.0) -> FloatArray:
    forces = np.zeros(len(GRID))
    forces[taxel] = force
    return forces


def test_taxels_without_errors_read_what_is() -> None:
    assert np.array_equal(taxels().read(0.1, single(7)), single(7))


def test_the_gain_differs_from_taxel_to_taxel_and_stays() -> None:
    one = taxels(gain=0.2)
    first = one.read(0.0, np.ones(len(GRID)))
    assert np.array_equal(first, one.read(5.0, np.ones(len(GRID))))
    assert len(set(first)) == len(first)
    gains = [taxels(seed, gain=0.2).read(0.0, np.ones(len(GRID))) for seed in range(50)]
    assert np.std(np.log(gains)) == pytest.approx(0.2, rel=0.1)


def test_so_many_taxels_are_dead_others_on_another_day() -> None:
    dead = [tuple(np.flatnonzero(taxels(s, dead=2).read(0, np.ones(20)) == 0)) for s in range(20)]
    assert all(len(rows) == 2 for rows in dead) and len(set(dead)) > 10


def test_neighbours_of_a_taxel_read_a_share() -> None:
    values = taxels(crosstalk=0.05).read(0.0, single(7)).reshape(4, 5)
    expected = np.zeros((4, 5))
    expected[0:3, 1:4] = 0.05
    expected[1, 2] = 1.0
    assert np.allclose(values, expected)


def test_a_taxel_remembers_a_part_of_what_pressed_it_and_forgets() -> None:
    one = taxels(hysteresis=0.1)
    assert np.array_equal(one.read(1.0, single(7, 4.0)), single(7, 4.0))
    after = one.read(1.0 + RECOVERY, single(7, 0.0))[7]
    assert after == pytest.approx(0.4 / math.e)
    assert one.read(1.0 + 2.0 * RECOVERY, single(7, 0.0))[7] == pytest.approx(0.4 / math.e**2)
    assert one.read(20.0, single(7, 5.0))[7] == 5.0


# Ranges


def step() -> FloatArray:
    """An object at 1 m before a wall at 2 m, and pixels that see nothing."""
    depth = np.full((40, 40), 2.0)
    depth[:, 20:] = 1.0
    depth[:3], depth[-3:] = 0.0, np.inf
    return depth


def test_all_ranges_of_a_sensor_are_too_long_or_too_short_by_one_share() -> None:
    scales = []
    for seed in range(200):
        one = RangeErrors(RangeNoise(bias=0.01), rng(seed))
        scale = one.read(step())[20, 0] / 2.0
        assert np.allclose(one.read(step())[3:-3], scale * step()[3:-3])
        scales.append(scale)
    assert np.std(scales) == pytest.approx(0.01, rel=0.15)
    assert np.mean(scales) == pytest.approx(1.0, abs=0.003)


def test_what_is_not_seen_is_not_seen_with_errors_either() -> None:
    found = RangeErrors(RangeNoise(bias=0.05, mixed=1.0), rng()).read(step())
    assert not found[:3].any() and np.isinf(found[-3:]).all()


def test_beside_a_step_in_depth_some_pixels_lie_between_both_surfaces() -> None:
    found = RangeErrors(RangeNoise(mixed=0.5), rng()).read(step())
    off = found != step()
    assert not off[:, :19].any() and not off[:, 21:].any()
    beside = found[3:-3, 19:21]
    assert np.mean(off[3:-3, 19:21]) == pytest.approx(0.5, abs=0.15)
    assert beside.min() >= 1.0 and beside.max() <= 2.0 and np.std(beside[off[3:-3, 19:21]]) > 0.2
    slanted = np.tile(np.linspace(1.0, 1.5, 40), (40, 1))
    all_mixed = RangeErrors(RangeNoise(mixed=1.0), rng()).read(slanted)
    assert np.array_equal(all_mixed, slanted)


# Arrival


def delays(**given: Any) -> Delays:
    return Delays(**given)


def wrench(stamp: float, sensor: str = "wrist") -> Wrench:
    return Wrench(stamp=stamp, frame="f", sensor=sensor, force=np.zeros(3), torque=np.zeros(3))


def tactile(stamp: float) -> TactileImage:
    return TactileImage(stamp=stamp, frame="f", sensor="skin", values=np.zeros(1))


def test_without_delays_readings_arrive_at_once_in_their_order() -> None:
    arrivals = Arrivals(Delays(), rng())
    given: list[Reading] = [tactile(0.1), wrench(0.1), tactile(0.1)]
    assert list(map(id, arrivals.until(0.1, given))) == list(map(id, given))
    assert arrivals.until(1.0, ()) == []


def test_a_reading_arrives_once_its_delay_is_over() -> None:
    arrivals = Arrivals(delays(wrenches=0.02), rng())
    assert arrivals.until(0.1, [wrench(0.1)]) == []
    assert arrivals.until(0.119, ()) == []
    (late,) = arrivals.until(0.121, ())
    assert late.stamp == 0.1
    assert arrivals.until(1.0, ()) == []


def test_delays_are_drawn_from_the_whole_range_and_keep_the_order_of_a_sensor() -> None:
    arrivals = Arrivals(delays(wrenches=(0.0, 0.03), skins=0.1), rng())
    came: list[tuple[float, Reading]] = []
    for count in range(2000):
        now = 0.001 * count
        fresh = [wrench(now), wrench(now, "other"), tactile(now)] if count % 10 == 0 else []
        came += [(now, reading) for reading in arrivals.until(now, fresh)]
    for sensor in ("wrist", "other", "skin"):
        stamps = [reading.stamp for _, reading in came if reading.sensor == sensor]
        assert stamps == sorted(stamps) and len(stamps) > 150
    late = np.array([now - reading.stamp for now, reading in came if reading.sensor == "wrist"])
    assert late.min() < 0.003 and 0.027 < late.max() < 0.032
    skins = [now - reading.stamp for now, reading in came if reading.sensor == "skin"]
    assert skins == pytest.approx([0.1] * len(skins), abs=0.002)


def test_each_kind_of_reading_has_its_own_delay() -> None:
    late = delays(joints=0.1, skins=0.2, wrenches=0.3, sights=0.4)
    frame: dict[str, Any] = {"stamp": 0.0, "frame": "f", "sensor": "s"}
    joints = JointState(**frame, names=("a",), positions=np.zeros(1))
    cloud = PointCloud(**frame, points=np.zeros((0, 3)))
    depth = DepthImage(**frame, depth=np.zeros((1, 1)), intrinsics=np.eye(3))
    believed = ObjectPose(
        stamp=0.0, frame="f", name="box", position=np.zeros(3), orientation=np.array([0, 0, 0, 1.0])
    )
    driven = Odometry(
        **frame, child_frame="base", position=np.zeros(3), orientation=np.array([0, 0, 0, 1.0])
    )
    found = {
        joints: 0.1,
        driven: 0.1,
        cloud: 0.4,
        depth: 0.4,
        believed: 0.0,
        tactile(0.0): 0.2,
        wrench(0): 0.3,
    }
    assert all(late.of(reading) == (delay, delay) for reading, delay in found.items())


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"skins": -0.01}, "skins: no reading arrives before it is measured"),
        ({"skins": (0.02, 0.01)}, "skins: give the least, then the greatest"),
    ],
)
def test_a_delay_that_cannot_be_is_refused(given: Any, sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        Delays(**given)
