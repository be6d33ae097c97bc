"""Lessons as they are lived, against the same push made again by hand."""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import points_in
from contactfusion.generators.lidar_cpm import LidarCpmGenerator
from contactfusion.generators.network_card import KINDS
from contactfusion.generators.perceived import ROBOT
from contactfusion.generators.proximity import without
from contactfusion.readings import PointCloud, Reading
from contactfusion.state import State
from contactfusion_lab.learning import rollout
from contactfusion_lab.learning.dataset import save
from contactfusion_lab.learning.rollout import (
    MOUNTINGS,
    ONCE_MORE,
    PROXIMITY,
    Detour,
    Lesson,
    Motion,
    live,
)
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import PushScene, PushTruth
from lab.tests.test_push_world import base
from tests.test_networks import some_weights, write

NEAR = (0.15, 0.0)
"""A target at which a push soon arrives [m]."""


class Driven(NamedTuple):
    """One cycle of a lesson."""

    stamp: float
    motion: Motion


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[Driven]:
    """Give how the base moves, cycle by cycle."""
    noted: list[Driven] = []
    whole = PushScene.drive

    def drive(self: PushScene, ahead: float, aside: float, turn: float) -> None:
        noted.append(Driven(self.stamp, (ahead, aside, turn)))
        whole(self, ahead, aside, turn)

    monkeypatch.setattr(PushScene, "drive", drive)
    return noted


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let lessons end after 1.5 s."""
    monkeypatch.setattr(rollout, "LONGEST", 1.5)


def lesson(**fields: Any) -> Lesson:
    return replace(Lesson("one", "validation", 0, "box", "mu1", (2.0, 0.0), seed=4), **fields)


def made_again(one: Lesson, driven: list[Driven]) -> tuple[list[PushTruth], FloatArray]:
    """Make the same motions once more; give what is true, and the lengths, shape (n, k, S) [m]."""
    names = ("object", "friction", "target", "offset", "yaw")
    fields: dict[str, Any] = {name: getattr(one, name) for name in names}
    scene = PushScene(PushConfig(**fields, sees=MOUNTINGS), seed=one.seed)
    truths, rows = [], []
    for cycle in range(len(driven) + 1):
        clouds = {read.sensor: read for read in scene.readings() if isinstance(read, PointCloud)}
        rows.append([_lengths(clouds[name]) for name in MOUNTINGS])
        truths.append(scene.truth())
        if cycle < len(driven):
            scene.drive(*driven[cycle].motion)
    return truths, np.array(rows)


def _lengths(cloud: PointCloud) -> FloatArray:
    points = points_in(base().frames[cloud.frame].pose(), cloud.points)
    return PROXIMITY.lengths_of_cloud(without(points, ROBOT))


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize(
    "one",
    [
        lesson(),
        lesson(object="cylinder", friction="mu2", offset=0.1, yaw=20.0, controller="paper"),
        lesson(object={"shape": "box", "size": (0.3, 0.5, 0.6), "mass": 8.0}, yaw=-30.0),
    ],
    ids=["box", "cylinder", "another"],
)
def test_what_is_kept_is_what_is_seen_and_true(one: Lesson, driven: list[Driven]) -> None:
    trial = live(one, None)
    truths, lengths = made_again(one, driven[:15])
    assert trial.stamp == pytest.approx(np.arange(16) * 0.1)
    assert [KINDS[kind] for kind in trial.kind] == [truth.kind for truth in truths]
    laterals = [truth.contact[1] for truth in truths]
    assert trial.lateral == pytest.approx(np.array(laterals), abs=0.0, nan_ok=True)
    assert trial.descriptors.transpose(1, 0, 2).tobytes() == lengths.tobytes()
    assert np.isfinite(trial.lateral).any()


@pytest.mark.usefixtures("short")
def test_a_trial_tells_where_it_comes_from() -> None:
    trial = live(lesson(), None)
    assert (trial.name, trial.split, trial.round) == ("one", "validation", 0)
    assert trial.mountings == MOUNTINGS
    assert trial.descriptors.shape == (3, 16, 12)
    assert trial.kind.dtype == np.uint8
    assert trial.stamp.shape == trial.lateral.shape == trial.kind.shape == (16,)


@pytest.mark.usefixtures("short")
def test_a_flat_face_touches_along_a_line_and_a_round_one_at_a_point() -> None:
    flat, round_ = live(lesson(), None), live(lesson(object="cylinder"), None)
    assert set(flat.kind[2:]) == {KINDS.index("line")}
    assert set(round_.kind[2:]) == {KINDS.index("point")}
    # each mounting sees strips that are as near as they can be
    for trial in (flat, round_):
        assert np.all(trial.descriptors[:, 2:].min(axis=2) < PROXIMITY.cell[0] / 2.0)


@pytest.mark.usefixtures("short")
def test_the_same_lesson_gives_the_same_bytes(tmp_path: Path) -> None:
    paths = [tmp_path / "one.npz", tmp_path / "other.npz"]
    for path in paths:
        save(live(lesson(offset=0.1), None), path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    save(live(lesson(offset=0.1, seed=5), None), paths[1])
    assert paths[0].read_bytes() != paths[1].read_bytes()


@pytest.mark.usefixtures("short")
def test_in_a_detour_the_base_moves_as_told(driven: list[Driven]) -> None:
    away, back = (-0.2, 0.05, 0.1), (0.3, -0.05, 0.0)
    trial = live(lesson(detours=(Detour(0.4, 0.8, away), Detour(1.0, 1.2, back))), None)
    straight = list(driven)
    driven.clear()
    live(lesson(), None)
    told = {round(cycle.stamp, 3): cycle.motion for cycle in straight}
    free = {round(cycle.stamp, 3): cycle.motion for cycle in driven}
    assert [told[stamp] for stamp in (0.4, 0.5, 0.6, 0.7)] == [away] * 4
    assert [told[stamp] for stamp in (1.0, 1.1)] == [back] * 2
    # before it, and between, it is the controller's turn
    assert [told[stamp] for stamp in (0.0, 0.1, 0.2, 0.3)] == [
        free[stamp] for stamp in (0.0, 0.1, 0.2, 0.3)
    ]
    assert told[0.8] not in (away, back) and told[1.2] not in (away, back)
    # contact is lost by it; it was there before
    assert trial.kind[4] != 0 and trial.kind[8] == 0


@pytest.mark.parametrize("seed", [4, 9])
def test_after_arrival_it_backs_off_and_comes_again(driven: list[Driven], seed: int) -> None:
    trial = live(lesson(target=NEAR, seed=seed), None)
    end = trial.stamp[-1]
    assert end < rollout.LONGEST
    arrived = end - 2.0 * ONCE_MORE
    after = [cycle for cycle in driven if cycle.stamp > arrived - 0.05]
    away = [cycle.motion for cycle in after if cycle.stamp < arrived + ONCE_MORE - 0.05]
    again = [cycle.motion for cycle in after if cycle.stamp > arrived + ONCE_MORE - 0.05]
    assert len(away) == len(again) == round(ONCE_MORE / 0.1)
    ((ahead, aside, turn),) = set(again)
    assert set(away) == {(-ahead, aside, turn)}
    assert 0.05 <= ahead <= 0.3 and abs(aside) <= 0.1 and abs(turn) <= 0.3
    # it arrived in contact, and leaves it
    before, later = trial.stamp < arrived, trial.stamp > arrived + 0.5 * ONCE_MORE
    assert np.count_nonzero(trial.kind[before]) >= 8
    assert np.any(trial.kind[later] == 0)


def test_how_it_backs_off_is_drawn_from_the_seed(driven: list[Driven]) -> None:
    motions = []
    for seed in (4, 4, 9):
        driven.clear()
        live(lesson(target=NEAR, seed=seed), None)
        motions.append(driven[-1].motion)
    assert motions[0] == motions[1] != motions[2]


def test_an_object_that_is_pushed_away_ends_the_lesson() -> None:
    flung = lesson(detours=(Detour(0.0, 60.0, (2.0, 0.0, 0.0)),))
    trial = live(flung, None)
    assert 2.5 < trial.stamp[-1] < 4.0


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("driver", MOUNTINGS)
def test_networks_drive_from_the_mounting_that_is_named(
    driver: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = set()
    whole = LidarCpmGenerator.generate

    def generate(self: LidarCpmGenerator, reading: Reading, state: State) -> Any:
        heard.add(reading.sensor)
        return whole(self, reading, state)

    monkeypatch.setattr(LidarCpmGenerator, "generate", generate)
    trial = live(lesson(driver=driver), write(tmp_path, some_weights()))
    assert heard == {driver}
    assert trial.descriptors.shape == (3, 16, 12)  # all mountings look on


@pytest.mark.usefixtures("short")
def test_a_driver_that_is_no_mounting_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="the robot has no 'lidar_tiled'; did you mean"):
        live(lesson(driver="lidar_tiled"), write(tmp_path, some_weights()))
