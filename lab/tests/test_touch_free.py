"""Free motion: paths without a contact, and what is reported on them all the same."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.readings import JointCommand, JointState, ObjectPose, PointCloud, Reading
from contactfusion.robots.model import shared_robot
from contactfusion_lab.experiments.methods import DE_MORGAN
from contactfusion_lab.experiments.touch import free
from contactfusion_lab.experiments.touch.experiment import run_touch
from contactfusion_lab.experiments.touch.plan import DEFAULT, SECONDS, Free, read_plan
from contactfusion_lab.experiments.touch.record import Arrived, Record
from contactfusion_lab.experiments.touch.trial import (
    FreeTrial,
    content_of_free,
    load_free,
    run_free,
)
from contactfusion_lab.scenes.touch.free import SPEEDS, FreeMotion
from contactfusion_lab.trials.executor import Local
from contactfusion_lab.trials.measures import CASE
from lab.tests.test_touch_experiment import PLACE, SMALL, cloud

PLAN = read_plan(DEFAULT, [], 15, "none", (), 3)[0]


@cache
def motion(seconds: float, seed: int = 4, noise: str = "none") -> tuple[list[Reading], FreeMotion]:
    plan = read_plan(DEFAULT, [], 15, noise, (), 3)[0]
    assert plan.pipeline.robot is not None
    scene = FreeMotion(plan.scene, shared_robot(plan.pipeline.robot), seed, seconds)
    return list(scene.readings()), scene


def joints(
    readings: list[Reading], kind: type[JointState] | type[JointCommand] = JointState
) -> FloatArray:
    return np.array([each.positions for each in readings if isinstance(each, kind)])


def test_nothing_is_touched_and_every_sensor_measures() -> None:
    readings, scene = motion(4.0)
    assert not scene.truth.contacts.links and np.isnan(scene.truth.onset)
    assert readings[-1].stamp == scene.now == pytest.approx(4.0)
    assert {each.sensor for each in readings if type(each) is not ObjectPose} == {
        "joints", "tip_1", "tip_2", "tip_3", "palm", "wrist", "forehead"
    }  # fmt: skip
    clouds = [each for each in readings if type(each) is PointCloud]
    assert len(clouds) == 17 and all(len(each.points) for each in clouds)


def test_joints_move_as_fast_as_they_may_and_the_hand_on_every_other_path() -> None:
    readings, scene = motion(10.0)
    positions, commanded = joints(readings), joints(readings, JointCommand)
    speeds = np.abs(np.diff(positions, axis=0)) / 0.05
    assert 0.5 * SPEEDS[0] < speeds.max() <= 1.02 * SPEEDS[1]
    names = next(each.names for each in readings if type(each) is JointCommand)
    fingers = [row for row, name in enumerate(names) if name.startswith("finger")]
    arm = [row for row, name in enumerate(names) if name.startswith("arm")]
    moved = np.abs(np.diff(commanded, axis=0))
    still = moved[:, fingers].max(axis=1) == 0.0
    assert 0.1 < still.mean() < 0.9 and (moved[still][:, arm].max(axis=1) > 0.0).mean() > 0.9
    assert np.abs(positions[1:] - commanded).max() < 0.03


def test_another_seed_moves_elsewhere_and_the_same_alike() -> None:
    first, other = (joints(motion(1.0, seed)[0]) for seed in (4, 5))
    assert np.abs(first - other).max() > 0.1
    motion.cache_clear()
    np.testing.assert_array_equal(first, joints(motion(1.0, 4)[0]))


def test_a_hand_without_room_is_refused() -> None:
    assert PLAN.pipeline.robot is not None
    scene = FreeMotion(PLAN.scene, shared_robot(PLAN.pipeline.robot), 0, 1.0)
    # a world that is blocked as soon as a margin is asked for
    scene._world.blocked = lambda *rest: len(rest) > 3  # type: ignore[method-assign]
    with pytest.raises(RobotError, match="of 300 postures .* none is reached without a contact"):
        list(scene.readings())


def test_motions_last_as_long_as_was_asked_and_pass_every_object() -> None:
    motions = PLAN.motions(["box", "sprayer"], 0.5)
    assert [(each.name, each.target) for each in motions] == [
        ("free-box-000", "box"), ("free-sprayer-001", "sprayer"), ("free-box-002", "box")
    ]  # fmt: skip
    assert PLAN.motions(["box", "sprayer"], 1.0)[:3] == motions
    further = PLAN.motions(["box", "sprayer", "mug"], 0.5)  # a folder takes further objects
    assert {each.name for each in further} & {each.name for each in motions} == {
        each.name for each in further if each in motions
    }
    assert len({each.seed for each in motions}) == 3
    assert PLAN.motions(["box"], 0.0) == [] and len(PLAN.motions(["box"], 0.001)) == 1
    assert SECONDS * len(PLAN.motions(["box"], 2.0)) == 120.0


def free_trial(pattern: str, touched: bool = False) -> FreeTrial:
    """A motion at 20 Hz: at each "x" a skin reports a contact."""
    stamps = np.array([0.05 * number for number in range(len(pattern))])
    clouds = [cloud("tip_1", PLACE if each == "x" else [], 0.9) for each in pattern]
    history = {
        "tip_1": [
            Arrived(float(stamp), replace(each, stamp=float(stamp)))
            for stamp, each in zip(stamps, clouds, strict=True)
        ]
    }
    contacts = [PLACE[None] if touched else np.empty((0, 3)) for _ in pattern]
    record = Record(float(stamps[-1]), history, stamps, np.zeros((len(pattern), 15)), contacts, ())
    return FreeTrial(Free("box", 0, 1), record)


def alarms_of(trial: FreeTrial, folder: Path) -> pd.DataFrame:
    path = folder / "motion.npz"
    path.write_bytes(content_of_free(trial))
    return free.alarms_of([path], [DE_MORGAN], PLAN.pipeline, Local(1))


def test_an_alarm_begins_where_there_was_none(tmp_path: Path) -> None:
    alarms = alarms_of(free_trial("x.xx...x"), tmp_path)
    by_row = alarms.set_index("row")
    assert (by_row.loc["tactile", "alarms"], by_row.loc["tactile", "share"]) == (3, 0.5)
    assert by_row.loc["all", "alarms"] == 3 and by_row.loc["force", "alarms"] == 0


def test_a_motion_that_touched_something_does_not_count(tmp_path: Path) -> None:
    alarms = alarms_of(free_trial("x.", touched=True), tmp_path)
    assert len(alarms) == 0 and not list(free.measures_of(alarms, 0))


def test_rates_have_exact_intervals() -> None:
    assert free.poisson(0, 2.0) == pytest.approx((0.0, 3.688879 / 2.0), rel=1e-5)
    assert free.poisson(5, 1.0) == pytest.approx((1.623486, 11.668332), rel=1e-5)


def test_rates_are_by_the_minute() -> None:
    frame = pd.DataFrame(
        {"row": "all", "seconds": [10.0, 10.0], "alarms": [2, 1], "share": [0.5, 0.1]}
    ).assign(**{CASE: "all, m"})
    measures = list(free.measures_of(frame, 0))
    rate, share = measures
    assert rate.value == pytest.approx(9.0) and rate.unit == "1/min"
    assert (rate.low, rate.high) == pytest.approx(free.poisson(3, 1.0 / 3.0))
    assert share.value == pytest.approx(0.3)
    text = free.free_text(measures, ["all", "fingers"], "m")
    assert "| all | 9.00 [1.86, 26.30] | 30.0 [10.0, 50.0] |" in text
    assert free.free_text([], ["all"], "m") == ""


@pytest.mark.slow
def test_a_motion_is_a_trial_of_the_experiment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = read_plan(DEFAULT, [], 15, "prototype", (), 3)[0]
    monkeypatch.setattr("contactfusion_lab.experiments.touch.trial.SECONDS", 1.0)
    (task,) = plan.motions(["box"], 0.1)
    made = run_free(plan, task)
    (tmp_path / "one.npz").write_bytes(content_of_free(made))
    back = load_free(tmp_path / "one.npz")
    assert back.motion == task and not back.touched
    assert back.record.end == pytest.approx(1.0)
    assert content_of_free(run_free(plan, task)) == (tmp_path / "one.npz").read_bytes()
    run_touch(replace(SMALL, free=0.1), tmp_path / "out")
    assert (tmp_path / "out" / "trials" / "free-box-000.npz").is_file()
    rows = pd.read_csv(tmp_path / "out" / "free.csv")
    assert set(rows["motion"]) == {"free-box-000"} and set(rows["method"]) == {str(DE_MORGAN)}
    assert "free motion | alarms a minute" in (tmp_path / "out" / "table.md").read_text()


@pytest.mark.parametrize("minutes", [-1.0, float("inf"), float("nan")])
def test_minutes_that_are_none_are_refused(tmp_path: Path, minutes: float) -> None:
    with pytest.raises(ConfigurationError, match="free motion lasts 0 minutes or more, not"):
        run_touch(replace(SMALL, free=minutes), tmp_path)
