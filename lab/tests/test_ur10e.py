"""A UR10e that presses a tool on a sensor: alarms, evidence and links by motor currents."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RecordingError
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import shared_robot
from contactfusion_lab.experiments.ur10e import experiment
from contactfusion_lab.experiments.ur10e.alarm import Alarm, plain_first
from contactfusion_lab.experiments.ur10e.evidence import Evidence, Judged, discriminant, judged
from contactfusion_lab.experiments.ur10e.links import ARM, Motors, levers, located
from contactfusion_lab.experiments.ur10e.runs import (
    CURRENTS,
    FORCE,
    SET_VALUES,
    Run,
    read,
    read_run,
)
from contactfusion_lab.trials.measures import auc
from tests.real_data import real_data

CONSTANTS = np.array([11.0, 11.0, 8.0, 4.0, 4.0, 4.0])
NOISE = np.array([0.06, 0.15, 0.12, 0.08, 0.02, 0.02])
LAG = 0.006
"""From the force to the current [s]."""


def name(profile: str, controller: str, newtons: float, speed: float = 0.1) -> str:
    return f"m_6.86_{profile}_{controller}_control_F_{newtons:g}N_x_0_v_{speed:.2f}_1"


def series(newtons: float, seed: int) -> dict[str, FloatArray]:
    """The arm starts with a jump of set values, touches at 0 s, and lets go at 2 s."""
    rng = np.random.default_rng(seed)
    stamps, force_stamps = np.arange(-1.0, 3.0, 0.002), np.arange(-1.0, 3.0, 0.0008)
    pressed = (force_stamps >= 0.0) & (force_stamps < 2.0)
    forces = newtons * pressed + 0.1 * rng.standard_normal(len(force_stamps))
    late = np.clip((stamps - LAG) / 0.01, 0.0, 1.0) * (stamps < 2.0 + LAG)
    set_values = np.zeros((len(stamps), 6))
    set_values[stamps > -0.7, 1:3] = 3.0
    starts = -2.0 * np.exp(-np.clip(stamps + 0.7, 0.0, None) / 0.02) * (stamps > -0.7)
    residual = np.outer(late, -newtons * (levers() @ [0.0, 0.0, 1.0]) / CONSTANTS)
    residual[:, 1:3] += starts[:, None]
    residual += NOISE * rng.standard_normal(residual.shape)
    found = {FORCE: np.stack([force_stamps, forces], axis=1)}
    for joint in range(6):
        current = residual[:, joint] + set_values[:, joint]
        found[CURRENTS[joint]] = np.stack([stamps, current], axis=1)
        found[SET_VALUES[joint]] = np.stack([stamps, set_values[:, joint]], axis=1)
    return found


def write(folder: Path, stem: str, columns: dict[str, FloatArray]) -> Path:
    path = folder / f"{stem}.npz"
    arrays: dict[str, NDArray[np.float32]] = {k: v.astype(np.float32) for k, v in columns.items()}
    np.savez(path, allow_pickle=False, **arrays)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs of each profile under each controller."""
    found = tmp_path_factory.mktemp("ur10e")
    seed = 0
    for profile, newtons in (("direct_sensor_contact", 100.0), ("ramp_profile", 30.0)):
        for controller in ("UR", "ACF"):
            for speed in (0.1, 0.25):
                seed += 1
                write(found, name(profile, controller, newtons, speed), series(newtons, seed))
    return found


@pytest.fixture(scope="module")
def runs(folder: Path) -> list[Run]:
    return list(read(folder))


def of(runs: list[Run], profile: str) -> list[Run]:
    return [run for run in runs if run.profile == profile]


def test_names_say_what_a_run_is(runs: list[Run]) -> None:
    run = of(runs, "ramp")[0]
    assert (run.profile, run.controller, run.force, run.speed) == ("ramp", "ACF", 30.0, 0.1)
    assert run.onset == pytest.approx(0.0, abs=0.001)
    assert run.onset - 0.002 < run.leaves_noise <= run.onset


@cache
def pressed(newtons: float) -> dict[str, FloatArray]:
    return series(newtons, 1)


def test_a_run_without_contact_has_no_onset(tmp_path: Path) -> None:
    run = read_run(write(tmp_path, name("direct", "UR", 0.0), pressed(0.0)))
    assert run.onset == run.leaves_noise == np.inf and run.free.all()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"I3": np.zeros(5)}, "I3 has shape"),
        ({"I3": pressed(9.0)["I3"][::-1]}, "I3 is not finite, or its stamps do not ascend"),
        ({"I3": pressed(9.0)["I3"][:-1]}, "I3 has other stamps than I1"),
        ({FORCE: np.full_like(pressed(9.0)[FORCE], np.nan)}, "F0_blue is not finite"),
        ({FORCE: pressed(9.0)[FORCE] + [0.0, 9.0]}, "it begins less than 0.2 s before"),
    ],
)
def test_series_that_cannot_be_are_refused(
    change: dict[str, FloatArray], complaint: str, tmp_path: Path
) -> None:
    path = write(tmp_path, name("direct", "UR", 9.0), pressed(9.0) | change)
    with pytest.raises(RecordingError, match=complaint):
        read_run(path)


def test_files_that_are_no_runs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="there is no run"):
        list(read(tmp_path))
    with pytest.raises(RecordingError, match=r"other\.npz: the name is not as in direct_contact"):
        read_run(write(tmp_path, "other", pressed(9.0)))
    path = tmp_path / f"{name('direct', 'UR', 9.0)}.npz"
    path.write_bytes(b"no arrays")
    with pytest.raises(ConfigurationError, match="is no npz file"):
        read_run(path)
    fewer = {key: values for key, values in pressed(9.0).items() if key != "Id4"}
    with pytest.raises(ConfigurationError, match="lacks Id4"):
        read_run(write(tmp_path, name("direct", "UR", 9.0), fewer))


@pytest.mark.parametrize("profile", ["direct", "ramp"])
def test_an_alarm_by_the_other_profile_follows_contact_at_once(
    profile: str, runs: list[Run]
) -> None:
    alarm = Alarm.fitted([run for run in runs if run.profile != profile])
    for run in of(runs, profile):
        assert LAG < alarm.first(run) - run.onset < LAG + 0.008


def test_the_start_of_a_motion_is_no_alarm(runs: list[Run]) -> None:
    alarm = Alarm.fitted(of(runs, "direct"))
    run = of(runs, "ramp")[0]
    assert alarm.first(run) > 0.0
    sure = replace(alarm, unsure=0.0)
    assert sure.first(run) == pytest.approx(-0.7, abs=0.01)


def test_a_joint_that_slips_alone_counts_less_than_several(runs: list[Run]) -> None:
    run, alarm = of(runs, "ramp")[0], Alarm.fitted(of(runs, "direct"))
    moved = np.outer(run.stamps > -0.3, NOISE)
    row = int(np.searchsorted(run.stamps, -0.3)) + 2
    alone = replace(run, residual=run.residual + 15.0 * moved * np.eye(6)[4])
    several = replace(run, residual=run.residual + 15.0 / np.sqrt(6.0) * moved)
    assert alarm.statistic(several)[row] > 1.3 * alarm.statistic(alone)[row]
    assert alarm.first(several) == pytest.approx(-0.3, abs=0.01)


def test_a_plain_threshold_waits_longer(runs: list[Run]) -> None:
    run, others = of(runs, "ramp")[0], of(runs, "direct")
    assert plain_first(run, others) > Alarm.fitted(others).first(run)


def test_windows_in_which_contact_begins_are_left_out(runs: list[Run]) -> None:
    run = replace(runs[0], stamps=runs[0].stamps + 0.05, force_stamps=runs[0].force_stamps + 0.05)
    whole, shifted = judged([runs[0]], "windows"), judged([run], "windows")
    assert len(whole.contact) == len(shifted.contact) == 20
    late = replace(run, forces=np.roll(run.forces, 60))
    assert len(judged([late], "windows").contact) == 18
    assert len(judged([run], "samples").contact) == len(run.stamps)


def test_evidence_of_one_joint_is_bounded() -> None:
    rng = np.random.default_rng(0)
    contact = np.arange(4000) % 2 > 0
    residuals = rng.standard_normal((4000, 6)) + np.outer(contact, [0.0, 8.0, 8.0, 4.0, 0.0, 0.0])
    given = Judged(residuals, contact, np.zeros(4000, np.intp))
    evidence = Evidence.learned(given)
    alone, light = np.array([[0.0, 9.0, 0.0, 0.0, 0.0, 0.0], [0.0, 2.0, 2.0, 2.0, 0.0, 0.0]])
    assert evidence.of(light[None])[0] > evidence.of(alone[None])[0]
    assert light @ discriminant(given) < alone @ discriminant(given)
    values = residuals @ discriminant(given)
    assert auc(values[contact], values[~contact]) > 0.999


def test_the_arm_bears_the_force_as_the_real_one() -> None:
    np.testing.assert_allclose(
        100.0 * levers()[:, 2], [0.0, -71.7, -50.2, -3.9, -1.8, 0.0], atol=0.05
    )
    robot = shared_robot(ARM)
    Dynamics(robot).require_inertias()
    assert robot.joint_names[0] == "shoulder_pan_joint" and robot.joint_names[5] == "wrist_3_joint"
    np.testing.assert_array_equal(robot.efforts, [330.0, 330.0, 150.0, 56.0, 56.0, 56.0])


def test_constants_are_learned_on_other_runs(runs: list[Run]) -> None:
    motors = Motors.learned(of(runs, "direct")[1:])
    np.testing.assert_allclose(motors.constants, CONSTANTS, rtol=0.05)
    with pytest.raises(RecordingError, match="no other runs with a contact"):
        Motors.learned([])


@pytest.mark.slow
def test_the_tool_is_among_few_links(runs: list[Run]) -> None:
    direct = of(runs, "direct")
    found = located(direct[0], Motors.learned(direct[1:]))
    assert found.held.mean() > 0.95 and np.median(found.sizes) <= 2.0


@pytest.mark.slow
def test_all_is_measured_and_drawn(folder: Path, tmp_path: Path) -> None:
    measures = experiment.measure(folder, tmp_path)
    early = next(each for each in measures if each.metric == "early runs")
    assert early.value == 0.0 and early.n == 8
    areas = [each for each in measures if each.metric == "area under ROC, evidence"]
    assert len(areas) == 8 and all(each.value > 0.95 for each in areas)
    assert (tmp_path / "ur10e_currents.png").stat().st_size > 10_000


def test_one_profile_teaches_nothing(tmp_path: Path) -> None:
    write(tmp_path, name("direct", "UR", 9.0), pressed(9.0))
    with pytest.raises(RecordingError, match="all runs under UR control .* 'direct': there is no"):
        experiment.measure(tmp_path, tmp_path)


def test_the_real_runs_are_read() -> None:
    runs = list(read(real_data("ur10e_currents")))
    assert {run.profile for run in runs} == {"direct", "ramp"}
    assert {run.controller for run in runs} == {"UR", "ACF"}
    assert all(abs(run.onset) < 0.002 for run in runs)
