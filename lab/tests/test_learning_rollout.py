"""Pushes to learn from: as many as the paper has, none of a test, each as if made by hand."""

import math
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.controllers.face import FaceConfig
from contactfusion.errors import ConfigurationError
from contactfusion.frames import points_in
from contactfusion.generators.lidar_cpm import LidarCpmGenerator
from contactfusion.generators.networks import KINDS
from contactfusion.generators.perceived import ROBOT
from contactfusion.generators.proximity import without
from contactfusion.readings import PointCloud, Reading
from contactfusion.state import State
from contactfusion_lab.experiments.push.plan import GRID, NEW, REAL_NEAR, VALIDATION
from contactfusion_lab.experiments.push.suites import controller_options
from contactfusion_lab.learning import rollout
from contactfusion_lab.learning.dataset import content_of
from contactfusion_lab.learning.rollout import (
    FIELD,
    MOUNTINGS,
    NEAREST,
    OFFSET,
    ONCE_MORE,
    PROXIMITY,
    SKIN,
    VARIED_DRIVERS,
    WITHOUT,
    YAW,
    Detour,
    Lesson,
    Motion,
    as_printed,
    driven_lessons,
    first_lessons,
    live,
)
from contactfusion_lab.scenes.push.config import FRICTIONS, PAPER, PushConfig
from contactfusion_lab.scenes.push.scene import PushScene, PushTruth
from lab.tests.test_push_world import base
from tests.test_networks import some_weights, write

VARIED = 60
NEAR = (0.15, 0.0)
"""A target at which a push soon arrives [m]."""


def lessons(seed: int = 0) -> list[Lesson]:
    return first_lessons(VARIED, seed)


def named(part: str, among: list[Lesson]) -> list[Lesson]:
    return [lesson for lesson in among if part in lesson.name]


# How many


def test_the_paper_has_156_pushes_to_train_on_and_36_to_validate() -> None:
    found = first_lessons(0, 0)
    assert Counter(lesson.split for lesson in found) == {"training": 156, "validation": 36}
    without = named("without", found)
    assert len(without) == WITHOUT == 12
    assert all(lesson.split == "training" for lesson in without)


def test_every_object_is_pushed_with_every_friction_to_every_place() -> None:
    found = [lesson for lesson in first_lessons(0, 0) if "without" not in lesson.name]
    for split, places in (("training", GRID), ("validation", VALIDATION)):
        here = [lesson for lesson in found if lesson.split == split]
        pushes = {(lesson.object, lesson.friction, lesson.target) for lesson in here}
        assert pushes == set(product(PAPER, FRICTIONS, places))
        assert len(here) == 3 * 2 * len(places)
    assert all((lesson.offset, lesson.yaw, lesson.detours) == (0.0, 0.0, ()) for lesson in found)


def test_varied_pushes_come_on_top() -> None:
    found = lessons()
    assert len(found) == 156 + 36 + VARIED
    varied = named("varied", found)
    assert Counter(lesson.split for lesson in varied) == {"training": 52, "validation": 8}


def test_names_are_unique_over_all_rounds() -> None:
    found = lessons()
    for iteration in (1, 2, 3):
        found += driven_lessons(30, iteration, MOUNTINGS, 0)
    names = [lesson.name for lesson in found]
    assert len(set(names)) == len(names)
    assert all(lesson.name.startswith(lesson.split) for lesson in found)


def test_as_printed_all_are_seen_from_one_place_until_they_arrive() -> None:
    found = as_printed(first_lessons(0, 0))
    assert [lesson.name for lesson in found] == [lesson.name for lesson in first_lessons(0, 0)]
    ((controller, course),) = {(lesson.controller, lesson.course) for lesson in found}
    assert (controller, course.mountings, course.longest) == ("paper", ("lidar",), 300.0)


# No lesson is one of a test


def test_places_to_train_on_validate_and_test_are_apart() -> None:
    for first, second in ((GRID, VALIDATION), (GRID, NEW), (VALIDATION, NEW)):
        assert not set(first) & set(second)
    assert (len(set(GRID)), len(set(VALIDATION)), len(set(NEW))) == (24, 6, 12)


def test_nothing_is_trained_to_a_place_of_validation_or_test() -> None:
    found = lessons() + driven_lessons(60, 1, MOUNTINGS, 0)
    trained = {lesson.target for lesson in found if lesson.split == "training"}
    assert not trained & {*VALIDATION, *NEW, *REAL_NEAR}
    validated = {lesson.target for lesson in found if lesson.split == "validation"}
    assert not validated & {*GRID, *NEW}
    assert not trained & validated


def test_varied_pushes_are_to_places_of_their_own() -> None:
    varied = named("varied", lessons())
    for lesson in varied:
        x, y = lesson.target
        assert max(abs(x), abs(y)) <= FIELD
        assert math.hypot(x, y) >= NEAREST
        assert not (-0.8 <= x <= 0.0 and abs(y) <= 0.35)  # where the robot stands
        assert abs(lesson.offset) <= OFFSET and abs(lesson.yaw) <= YAW
    assert len({lesson.target for lesson in varied}) == len(varied)


# By chance


def test_the_same_seed_gives_the_same_lessons() -> None:
    assert lessons(3) == lessons(3)
    assert driven_lessons(12, 2, MOUNTINGS, 3) == driven_lessons(12, 2, MOUNTINGS, 3)


def test_another_seed_varies_pushes_otherwise_and_of_the_papers_only_the_noise() -> None:
    first, second = lessons(3), lessons(4)
    apart = [
        before.name
        for before, after in zip(first, second, strict=True)
        if replace(before, seed=0) != replace(after, seed=0)
    ]
    assert len(apart) == WITHOUT + VARIED
    assert all("varied" in name or "without" in name for name in apart)
    assert all(before.seed != after.seed for before, after in zip(first, second, strict=True))


def test_every_lesson_has_chance_of_its_own() -> None:
    found = lessons() + driven_lessons(60, 1, MOUNTINGS, 0)
    seeds = [lesson.seed for lesson in found]
    assert len(set(seeds)) == len(seeds)


def test_validation_holds_every_friction_and_every_driver() -> None:
    for found in (named("varied", lessons()), driven_lessons(84, 1, MOUNTINGS, 0)):
        held = [lesson for lesson in found if lesson.split == "validation"]
        assert {lesson.friction for lesson in held} == set(FRICTIONS)
        assert {lesson.driver for lesson in held} == {lesson.driver for lesson in found}


def test_every_round_draws_pushes_of_its_own() -> None:
    rounds = [named("varied", lessons())[:12]]
    rounds += [driven_lessons(12, iteration, MOUNTINGS, 0) for iteration in (1, 2)]
    targets = [lesson.target for iteration in rounds for lesson in iteration]
    assert len(set(targets)) == 36
    assert [{lesson.round for lesson in iteration} for iteration in rounds] == [{0}, {1}, {2}]


def test_more_varied_pushes_change_nothing_of_the_first() -> None:
    assert first_lessons(20, 0) == first_lessons(60, 0)[: 192 + 20]


# Who drives


def test_in_the_first_round_the_skin_drives_by_several_sets() -> None:
    found = lessons()
    assert {lesson.driver for lesson in found} == {SKIN}
    assert {lesson.controller for lesson in named("varied", found)} == set(VARIED_DRIVERS)
    assert {lesson.controller for lesson in found[:192]} == {"tuned"}


@pytest.mark.parametrize("name", sorted({*VARIED_DRIVERS, "tuned"}))
def test_who_steers_is_a_known_set_of_parameters(name: str) -> None:
    assert controller_options(name, (1.0, 0.0), FaceConfig())


def test_later_each_mounting_drives_as_often() -> None:
    found = driven_lessons(24, 1, MOUNTINGS, 0)
    assert Counter(lesson.driver for lesson in found) == dict.fromkeys(MOUNTINGS, 8)
    assert {lesson.controller for lesson in found} == {"tuned"}
    assert {(lesson.driver, lesson.split) for lesson in found} >= {
        (name, "training") for name in MOUNTINGS
    }


# Detours


def test_detours_come_one_after_the_other() -> None:
    found = lessons() + driven_lessons(60, 1, MOUNTINGS, 0)
    counts = Counter(len(lesson.detours) for lesson in named("varied", found))
    assert set(counts) == {0, 1, 2, 3}
    for lesson in found:
        ends = [0.0, *(detour.end for detour in lesson.detours)]
        for before, detour in zip(ends, lesson.detours, strict=False):
            assert before <= detour.start < detour.end


def test_a_detour_takes_its_time_and_no_more() -> None:
    away, back = (-0.1, 0.0, 0.2), (0.1, 0.1, 0.0)
    detours = (Detour(1.0, 2.0, away), Detour(3.0, 3.5, back))
    lesson = Lesson("one", "training", 0, "box", "mu1", (2.0, 0.0), detours=detours)
    stamps = (0.0, 0.99, 1.0, 1.99, 2.0, 2.99, 3.0, 3.49, 3.5)
    assert [lesson.detour_at(stamp) for stamp in stamps] == [
        None, None, away, away, None, None, back, back, None,
    ]  # fmt: skip


def test_pushes_without_contact_back_off_at_once() -> None:
    for lesson in named("without", lessons()):
        (away,) = lesson.detours
        assert (away.start, away.end) == (0.0, 15.0)
        assert -0.3 <= away.motion[0] <= -0.05


# All of them can be made


def test_every_lesson_is_a_push() -> None:
    known = set()
    for lesson in lessons() + driven_lessons(60, 1, MOUNTINGS, 0):
        names = ("object", "friction", "target", "offset", "yaw")
        fields: dict[str, Any] = {name: getattr(lesson, name) for name in names}
        assert PushConfig(**fields, sees=MOUNTINGS).target == lesson.target
        if isinstance(lesson.object, str):
            known.add(lesson.object)
    assert known == set(PAPER)


def test_objects_of_other_sizes_are_drawn() -> None:
    varied = [lesson.object for lesson in named("varied", lessons())]
    drawn = [fields for fields in varied if isinstance(fields, dict)]
    assert 20 < len(drawn) < 55
    assert {fields["shape"] for fields in drawn} == {"box", "cylinder"}
    assert len({fields["mass"] for fields in drawn}) == len(drawn)
    heights = [fields["height"] if "height" in fields else fields["size"][2] for fields in drawn]
    assert max(heights) - min(heights) > 0.2


class Driven(NamedTuple):
    """One cycle of a lesson."""

    stamp: float
    motion: Motion


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[Driven]:
    """The motion of the base, cycle by cycle."""
    noted: list[Driven] = []
    whole = PushScene.drive

    def drive(self: PushScene, forward: float, lateral: float, yaw_rate: float) -> None:
        noted.append(Driven(self.stamp, (forward, lateral, yaw_rate)))
        whole(self, forward, lateral, yaw_rate)

    monkeypatch.setattr(PushScene, "drive", drive)
    return noted


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """End pushes after 1.5 s."""
    monkeypatch.setitem(vars(Lesson.course), "longest", 1.5)


def lesson(**fields: Any) -> Lesson:
    return replace(Lesson("one", "validation", 0, "box", "mu1", (2.0, 0.0), seed=4), **fields)


def made_again(first: Lesson, driven: list[Driven]) -> tuple[list[PushTruth], FloatArray]:
    """Make the same motions once more; give what is true, and the lengths, shape (n, k, S) [m]."""
    names = ("object", "friction", "target", "offset", "yaw")
    fields: dict[str, Any] = {name: getattr(first, name) for name in names}
    scene = PushScene(PushConfig(**fields, sees=MOUNTINGS), seed=first.seed)
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
    "first",
    [
        lesson(),
        lesson(object="cylinder", friction="mu2", offset=0.1, yaw=20.0, controller="paper"),
        lesson(object={"shape": "box", "size": (0.3, 0.5, 0.6), "mass": 8.0}, yaw=-30.0),
    ],
    ids=["box", "cylinder", "another"],
)
def test_what_is_kept_is_what_is_seen_and_true(first: Lesson, driven: list[Driven]) -> None:
    trial = live(first, None)
    truths, lengths = made_again(first, driven[:15])
    assert trial.stamp == pytest.approx(np.arange(16) * 0.1)
    assert [KINDS[kind] for kind in trial.kind] == [truth.kind for truth in truths]
    laterals = [truth.contact[1] for truth in truths]
    assert trial.lateral == pytest.approx(np.array(laterals), abs=0.0, nan_ok=True)
    assert trial.descriptors.transpose(1, 0, 2).tobytes() == lengths.tobytes()
    assert np.isfinite(trial.lateral).any()


@pytest.mark.usefixtures("short")
def test_a_trial_records_where_it_comes_from() -> None:
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
        path.write_bytes(content_of(live(lesson(offset=0.1), None)))
    assert paths[0].read_bytes() == paths[1].read_bytes()
    paths[1].write_bytes(content_of(live(lesson(offset=0.1, seed=5), None)))
    assert paths[0].read_bytes() != paths[1].read_bytes()


@pytest.mark.usefixtures("short")
def test_in_a_detour_the_base_moves_as_described(driven: list[Driven]) -> None:
    away, back = (-0.2, 0.05, 0.1), (0.3, -0.05, 0.0)
    trial = live(lesson(detours=(Detour(0.4, 0.8, away), Detour(1.0, 1.2, back))), None)
    straight = list(driven)
    driven.clear()
    live(lesson(), None)
    motions = {round(cycle.stamp, 3): cycle.motion for cycle in straight}
    free = {round(cycle.stamp, 3): cycle.motion for cycle in driven}
    assert [motions[stamp] for stamp in (0.4, 0.5, 0.6, 0.7)] == [away] * 4
    assert [motions[stamp] for stamp in (1.0, 1.1)] == [back] * 2
    # before it, and between, it is the controller's turn
    assert [motions[stamp] for stamp in (0.0, 0.1, 0.2, 0.3)] == [
        free[stamp] for stamp in (0.0, 0.1, 0.2, 0.3)
    ]
    assert motions[0.8] not in (away, back) and motions[1.2] not in (away, back)
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
    ((forward, lateral, yaw_rate),) = set(again)
    assert set(away) == {(-forward, lateral, yaw_rate)}
    assert 0.05 <= forward <= 0.3 and abs(lateral) <= 0.1 and abs(yaw_rate) <= 0.3
    # it arrived in contact, and leaves it
    before, later = trial.stamp < arrived, trial.stamp > arrived + 0.5 * ONCE_MORE
    assert np.count_nonzero(trial.kind[before]) >= 8
    assert np.any(trial.kind[later] == 0)


def test_as_printed_a_push_ends_where_it_arrives(driven: list[Driven]) -> None:
    (one,) = as_printed([lesson(target=NEAR)])
    trial = live(one, None)
    assert trial.stamp[-1] < one.course.longest - 1.0
    # a cell of a single point counts, as O Eq 9 has it
    assert trial.mountings == ("lidar",) and one.course.proximity.occupied == 1
    assert len(driven) == len(trial.stamp) - 1
    assert trial.kind[-1] != 0


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
    received = set()
    whole = LidarCpmGenerator.generate

    def generate(self: LidarCpmGenerator, reading: Reading, state: State) -> Any:
        received.add(reading.sensor)
        return whole(self, reading, state)

    monkeypatch.setattr(LidarCpmGenerator, "generate", generate)
    trial = live(lesson(driver=driver), write(tmp_path, some_weights()))
    assert received == {driver}
    assert trial.descriptors.shape == (3, 16, 12)  # all mountings look on


@pytest.mark.usefixtures("short")
def test_a_driver_that_is_no_mounting_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="the robot has no 'lidar_tiled'; did you mean"):
        live(lesson(driver="lidar_tiled"), write(tmp_path, some_weights()))
