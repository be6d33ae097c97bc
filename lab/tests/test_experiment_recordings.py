"""`experiment recordings`: which method fuses what."""

from pathlib import Path

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError, PluginError
from contactfusion.readings import TactileImage
from contactfusion_lab.experiments import eflesh, force_plates, icub, recordings
from contactfusion_lab.experiments.methods import DE_MORGAN, DEFAULT_METHOD, POSTERIOR, Method
from contactfusion_lab.trials.measures import Measure
from tests.real_data import real_data

UNKNOWN = Method("no_such_rule", "modes")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Method | None]:
    """Replace all experiments by one that fuses and one that does not; the methods they get."""
    methods: list[Method | None] = []

    def fuses(folder: Path, out: Path, method: Method) -> list[Measure]:
        methods.append(method)
        return [Measure("plates", "left", "found", 0.5, 0.4, 0.6, "", 9)]

    def fuses_nothing(folder: Path, out: Path) -> list[Measure]:
        methods.append(None)
        return [Measure("hub", "left", "found", 0.5, 0.4, 0.6, "", 9)]

    for name in ("plates", "force_plates"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(recordings, "FUSED", {"plates": fuses})
    monkeypatch.setattr(recordings, "UNFUSED", {"hub": fuses_nothing})
    return methods


def test_by_default_all_is_fused_as_by_the_integrator(
    asked: list[Method | None], tmp_path: Path
) -> None:
    recordings.run_recordings(tmp_path, None, tmp_path / "out")
    assert asked == [DEFAULT_METHOD, None]
    written = (tmp_path / "out" / "results.csv").read_text()
    assert "plates,left," in written and "hub,left," in written


def test_by_another_method_what_fuses_nothing_is_left_out(
    asked: list[Method | None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recordings.run_recordings(tmp_path, POSTERIOR, tmp_path / "out")
    assert asked == [POSTERIOR]
    assert "hub: nothing is fused there, left out" in capsys.readouterr().out
    written = (tmp_path / "out" / "results.csv").read_text()
    assert '"left, posterior/modes"' in written and "hub" not in written


def test_single_experiments_can_be_chosen(asked: list[Method | None], tmp_path: Path) -> None:
    recordings.run_recordings(tmp_path, None, tmp_path / "out", ["hub"])
    assert asked == [None]
    with pytest.raises(ConfigurationError, match="unknown experiment 'plate'; .*'plates'"):
        recordings.run_recordings(tmp_path, None, tmp_path / "out", ["plate"])
    assert asked == [None]


def test_the_method_reaches_the_hand() -> None:
    trial = icub.Trial("none", 1, (), np.empty((0, 60)))
    assert not icub.touched(trial, np.zeros(60), np.ones(60), POSTERIOR)
    with pytest.raises(PluginError, match="no_such_rule"):
        icub.touched(trial, np.zeros(60), np.ones(60), UNKNOWN)


def test_the_method_reaches_the_skin() -> None:
    rng = np.random.default_rng(0)
    signals = rng.uniform(200.0, 900.0, (60, 15))
    places = np.column_stack([rng.uniform(0.0, 0.02, (60, 2)), np.zeros(60)])
    images = [
        TactileImage(stamp=0.1 * row, frame="pad", sensor="pad", values=values)
        for row, values in enumerate(signals)
    ]
    fold = np.arange(60) % 2
    assert np.isfinite(eflesh.locate(images, places, fold, POSTERIOR)[0]).all()
    with pytest.raises(PluginError, match="no_such_rule"):
        eflesh.locate(images, places, fold, UNKNOWN)


def test_force_plates_find_the_foot_by_either_method() -> None:
    walk = force_plates.read(real_data("force_plates"))
    by_voxels, by_modes = (
        force_plates.locate(walk, "plate_1", 0.005, method).places
        for method in (DE_MORGAN, POSTERIOR)
    )
    apart = np.linalg.norm(by_voxels - by_modes, axis=1)
    assert np.nanmedian(apart) < force_plates.VOXEL_SIZE
    assert np.nanmax(apart) > 0.0  # they are two methods
