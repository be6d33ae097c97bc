"""Pushes to learn from: as many as the paper has, none of them one of a test."""

import math
from collections import Counter
from dataclasses import replace
from itertools import product
from typing import Any

import pytest

from contactfusion.controllers.face import FaceConfig
from contactfusion_lab.experiments.push.plan import GRID, NEW, REAL_NEAR, VALIDATION
from contactfusion_lab.experiments.push.suites import controller_options
from contactfusion_lab.learning.rollout import (
    FIELD,
    MOUNTINGS,
    NEAREST,
    OFFSET,
    SKIN,
    VARIED_DRIVERS,
    WITHOUT,
    YAW,
    Detour,
    Lesson,
    driven_lessons,
    first_lessons,
)
from contactfusion_lab.scenes.push.config import FRICTIONS, PAPER, PushConfig

VARIED = 60


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
    for turn in (1, 2, 3):
        found += driven_lessons(30, turn, MOUNTINGS, 0)
    names = [lesson.name for lesson in found]
    assert len(set(names)) == len(names)
    assert all(lesson.name.startswith(lesson.split) for lesson in found)


# No lesson is one of a test


def test_places_to_train_on_validate_and_test_are_apart() -> None:
    for one, other in ((GRID, VALIDATION), (GRID, NEW), (VALIDATION, NEW)):
        assert not set(one) & set(other)
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
    one, other = lessons(3), lessons(4)
    apart = [
        before.name
        for before, after in zip(one, other, strict=True)
        if replace(before, seed=0) != replace(after, seed=0)
    ]
    assert len(apart) == WITHOUT + VARIED
    assert all("varied" in name or "without" in name for name in apart)
    assert all(before.seed != after.seed for before, after in zip(one, other, strict=True))


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
    rounds += [driven_lessons(12, turn, MOUNTINGS, 0) for turn in (1, 2)]
    targets = [lesson.target for one in rounds for lesson in one]
    assert len(set(targets)) == 36
    assert [{lesson.round for lesson in one} for one in rounds] == [{0}, {1}, {2}]


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
    drawn = [thing for thing in varied if isinstance(thing, dict)]
    assert 20 < len(drawn) < 55
    assert {thing["shape"] for thing in drawn} == {"box", "cylinder"}
    assert len({thing["mass"] for thing in drawn}) == len(drawn)
    heights = [thing["height"] if "height" in thing else thing["size"][2] for thing in drawn]
    assert max(heights) - min(heights) > 0.2
