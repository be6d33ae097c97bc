"""A search backs off, stands before a place, and goes ahead; one place after the other."""

import math
from itertools import groupby

import pytest

from contactfusion.controllers.face import FaceConfig
from contactfusion.controllers.pushing_parameters import SETS, SearchParameters
from contactfusion.controllers.reactive_pushing import ALIGNED, MORE, Search

TUNED = SETS["tuned"].search
assert TUNED is not None
P: SearchParameters = TUNED.model_copy(
    update={"speed": 0.25, "clearance": 0.15, "beyond": 0.3, "shift": 0.2}
)
FACE = FaceConfig()
PHASES = ("back", "aside", "ahead")
PERIOD = 0.1
STEP = P.speed * PERIOD + 1e-9
"""The robot overshoots by one cycle at most [m]."""

Walk = list[tuple[str, float, float]]
"""For each cycle what it is for, and where the face's middle then is as seen from the place, along
the robot: ahead and to the left [m]."""


def walked(
    cycles: int,
    side: float = 1.0,
    place: tuple[float, float] = (0.3, 0.1),
    yaw: float = 0.0,
    beside: frozenset[int] = frozenset(),
    speed: float = P.speed,
) -> Walk:
    """Search from the origin; something touches the robot's side in the cycles `beside`."""
    parameters = P.model_copy(update={"speed": speed})
    search, x, y, told = Search(parameters, FACE, place, side), 0.0, 0.0, []
    cos, sin = math.cos(yaw), math.sin(yaw)
    for cycle in range(cycles):
        way = x - place[0], y - place[1]
        where = cos * way[0] + sin * way[1] + FACE.ahead, cos * way[1] - sin * way[0]
        ahead, aside, doing = search.velocity((x, y, yaw), float(cycle in beside))
        told.append((doing, *where))
        assert ahead == 0.0 or aside == 0.0
        assert abs(ahead) in (0.0, speed) and abs(aside) <= speed
        x += PERIOD * (cos * ahead - sin * aside)
        y += PERIOD * (sin * ahead + cos * aside)
    return told


def ends(walk: Walk) -> dict[str, tuple[float, float]]:
    """Give where each phase of a walk ended, but the last, which goes on."""
    phases = [(doing, list(rows)) for doing, rows in groupby(walk, key=lambda row: row[0])]
    return {doing: after[0][1:] for (doing, _), (_, after) in zip(phases, phases[1:], strict=False)}


def test_phases_follow_each_other_try_by_try() -> None:
    phases = [doing for doing, _ in groupby(walked(400), key=lambda row: row[0])]
    expected = [f"{one}, try {number}" for number in range(1, 5) for one in PHASES]
    assert phases[: len(expected)] == expected


@pytest.mark.parametrize("yaw", [0.0, 2.5])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_try_goes_to_another_side_and_each_round_further(side: float, yaw: float) -> None:
    """First where it was, then on the side where it was lost, then on the other."""
    found = ends(walked(700, side, yaw=yaw))
    for number, (times, far) in enumerate(((0, 1), (1, 1), (-1, 1), (0, 2), (1, 2), (-1, 2)), 1):
        ahead, aside = found[f"back, try {number}"]
        assert -P.clearance - STEP <= ahead <= -P.clearance
        ahead, aside = found[f"ahead, try {number}"]
        assert aside == pytest.approx(times * side * P.shift, abs=ALIGNED)
        assert far * P.beyond <= ahead <= far * P.beyond + STEP


def test_who_stands_far_enough_before_it_does_not_back_off() -> None:
    assert walked(1, place=(1.0, 0.3))[0][0] == "aside, try 1"
    assert walked(1, place=(1.0, 0.01))[0][0] == "ahead, try 1"


def test_it_backs_off_as_long_as_something_touches_a_side() -> None:
    untouched = ends(walked(60))
    start = [doing for doing, *_ in walked(60)].index("aside, try 1")
    walk = walked(120, beside=frozenset(range(start, start + 12)))
    assert {doing for doing, *_ in walk[start : start + 12]} == {"back, try 1"}
    assert walk[start + 12][1] < untouched["back, try 1"][0] - 10 * P.speed * PERIOD


@pytest.mark.parametrize(("phase", "more"), [("aside", MORE), ("ahead", 0.0)])
def test_what_touches_a_side_is_where_it_searches_next(phase: str, more: float) -> None:
    """The object is at that corner of the face; one that it met moving aside reaches back, too."""
    place = (0.3, 0.3)
    start = [doing for doing, *_ in walked(100, place=place)].index(f"{phase}, try 1") + 2
    walk = walked(100, place=place, beside=frozenset([start]))
    corner = walk[start][1], walk[start][2] + FACE.half_width
    found = ends(walk[start:])
    back = found["back, try 1"][0] - corner[0]
    assert -P.clearance - more - STEP <= back <= -P.clearance - more
    assert found["aside, try 1"][1] == pytest.approx(corner[1], abs=ALIGNED)


@pytest.mark.parametrize("y", [0.7, 0.725, 0.71])
def test_moving_aside_slows_down_before_the_place(y: float) -> None:
    """Cycles of 5 cm would carry it past the place again and again."""
    aside = [row for row in walked(60, place=(0.5, y), speed=0.5) if row[0] == "aside, try 1"]
    assert len(aside) < y / 0.05 + 5
    assert all(row[2] <= 0.0 for row in aside)
