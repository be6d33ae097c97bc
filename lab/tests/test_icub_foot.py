"""The foot of an iCub that is tipped: what is learned on other runs, and where it is pressed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion_lab.experiments import icub_foot
from contactfusion_lab.experiments.icub_foot import ALL, EVEN, ODD, Run, Trial
from contactfusion_lab.experiments.methods import DEFAULT_METHOD
from tests.real_data import real_data

PLACES = np.array([(x, y, 0.0075) for x in np.arange(-9, 19) for y in np.arange(-6, 7)])
TAXELS = PLACES * (EDGE := icub_foot.EDGE, EDGE, 1.0)
WEIGHT = 140.0


def tipping(name: str, side: str, seed: int) -> Run:
    """A sole of taxels whose load wanders from heel to toe; the wrench goes twice as far."""
    rng, stamps = np.random.default_rng(seed), np.arange(0.0, 3.0, 0.02)
    along = 0.025 + 0.02 * np.sin(2.0 * stamps + seed)
    sign = 1.0 if side == "left" else -1.0
    offsets = np.linalg.norm(TAXELS[None, :, :2] - _places(along, sign), axis=2)
    skin = np.round(240.0 - 120.0 * np.exp(-0.5 * (offsets / 0.03) ** 2))
    wrench = np.stack([2.0 * along - 0.05, np.full(len(along), -0.004 * sign)], axis=1)
    force = np.tile([5.0, 0.0, -WEIGHT], (len(stamps), 1))
    torque = np.column_stack([wrench[:, 1] * -WEIGHT, wrench[:, 0] * WEIGHT, 0.0 * along])
    wrenches = np.hstack([force, torque]) + 0.01 * rng.standard_normal((len(stamps), 6))
    return Run(name, side, TAXELS, stamps, skin, stamps, wrenches)


def _places(along: FloatArray, sign: float) -> FloatArray:
    return np.stack([along, np.full(len(along), -0.005 * sign)], axis=1)[:, None]


RUNS = [tipping("first", "left", 1), tipping("second", "left", 2)]
MIRRORED = [tipping("third", "right", 3), tipping("fourth", "right", 4)]


def test_the_map_from_wrench_to_skin_is_learned_on_other_runs() -> None:
    known = icub_foot.learned(RUNS[0], RUNS)
    centres = icub_foot.centre(icub_foot.fallen(RUNS[0].skin, known.baseline), TAXELS)
    mapped = known.mapped(RUNS[0].wrench_centres)
    assert np.linalg.norm(mapped - centres, axis=1).max() < 0.002
    assert known.gain * icub_foot.fallen(RUNS[0].skin, known.baseline)[0].sum() == pytest.approx(
        WEIGHT, rel=0.05
    )


def test_the_other_foot_teaches_mirrored() -> None:
    known = icub_foot.learned(RUNS[0], [RUNS[0], *MIRRORED, RUNS[1]])
    alone = icub_foot.learned(RUNS[0], RUNS)
    np.testing.assert_allclose(known.map, alone.map, atol=0.01)
    silent = [Run(r.name, r.side, r.taxels, r.skin_stamps, r.skin, r.skin_stamps[:0],
                  r.wrenches[:0]) for r in RUNS[1:]]  # fmt: skip
    by_mirror = icub_foot.learned(RUNS[0], [RUNS[0], *silent, *MIRRORED])
    centres = RUNS[0].wrench_centres
    assert np.abs(by_mirror.mapped(centres) - alone.mapped(centres)).max() < 0.006


def test_nothing_is_learned_on_the_run_itself() -> None:
    with pytest.raises(RecordingError, match="no other runs to learn from what 'first' needs"):
        icub_foot.learned(RUNS[0], RUNS[:1])


@pytest.mark.slow
def test_the_foot_is_found_by_each_sensor_and_goes_on_when_one_dies() -> None:
    trial = Trial(RUNS[0], RUNS, DEFAULT_METHOD)
    tracks = dict(trial.tracks())
    for name in ("wrench", "skin", "wrench dead from half-time", "skin dead from half-time"):
        errors = tracks[name].errors
        assert np.isfinite(errors).mean() > 0.95, name
        assert np.nanmedian(errors) < 0.003, name
    assert tracks["skin dead from half-time"].stamps.min() > 1.4
    assert np.nanmedian(tracks["constant place"].errors) > 0.008
    assert len(tracks["every second taxel, both"].errors) == 2 * len(tracks["skin"].errors)


@pytest.mark.slow
def test_a_steady_error_of_a_wrench_is_gone_once_the_sensors_are_aligned() -> None:
    zero = (0.0, 0.0, 0.0, 0.0, 0.02 * WEIGHT, 0.0)
    run = replace(RUNS[0], wrenches=RUNS[0].wrenches + zero)
    tracks = dict(Trial(run, [run, RUNS[1]], DEFAULT_METHOD).tracks())
    for name in ("wrench", "skin"):
        aligned = tracks[f"{name}, aligned in the first half"]
        assert np.nanmedian(tracks[name].errors) > 0.008, name
        assert np.nanmedian(aligned.errors) < 0.003, name
        assert aligned.stamps.min() > 1.4


def test_the_centre_of_taxels_is_that_of_their_pressure() -> None:
    pressures = np.zeros((1, len(TAXELS)))
    pressures[0, [0, 5]] = 1.0, 3.0
    expected = (TAXELS[0] + 3.0 * TAXELS[5])[:2] / 4.0
    np.testing.assert_allclose(icub_foot.centre(pressures, TAXELS)[0], expected)
    assert np.isnan(icub_foot.centre(0.0 * pressures, TAXELS)).all()


def test_halves_of_the_taxels_share_none() -> None:
    rows = np.arange(len(TAXELS))
    assert {*rows[EVEN]} | {*rows[ODD]} == {*rows[ALL]} and not {*rows[EVEN]} & {*rows[ODD]}


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no '.*left_foot_taxels.txt' with the positions"):
        list(icub_foot.read(tmp_path))
    for side in ("left", "right"):
        (tmp_path / f"{side}_foot_taxels.txt").write_text("[calibration]\n1 2 3 0 0 1\n")
    with pytest.raises(RecordingError, match="1 positions of taxels instead of 384"):
        list(icub_foot.read(tmp_path))
    for side in ("left", "right"):
        whole = "[calibration]\n" + "0.1 0.2 0.3 0 0 1\n" * icub_foot.TAXELS
        (tmp_path / f"{side}_foot_taxels.txt").write_text(whole)
    with pytest.raises(RecordingError, match="no run under .* has skin and wrench of the same"):
        list(icub_foot.read(tmp_path))


def test_the_real_runs_are_read() -> None:
    runs = list(icub_foot.read(real_data("icub_tipping")))
    whole = [(run.side, run.name) for run in runs if len(run.wrenches)]
    assert ("left", "dumperTippingSetup04") in whole and ("right", "dumperTippingSetup07") in whole
    assert all(run.taxels.shape == (250, 3) for run in runs)
