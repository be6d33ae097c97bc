"""To go around is to back off, to circle at one distance, and to go ahead to the target."""

import math
from collections.abc import Callable
from typing import NamedTuple

import pytest

from contactfusion.controllers.face import FaceConfig
from contactfusion.controllers.pushing_law import place_of, wrapped
from contactfusion.controllers.pushing_parameters import SETS, EscapeParameters
from contactfusion.controllers.reactive_pushing import BEHIND, CENTRED, GRACE, MORE, GoAround

TUNED = SETS["tuned"].escape
assert TUNED is not None
P: EscapeParameters = TUNED.model_copy(update={"clearance": 0.2, "reach": 0.25, "speed": 0.29})
FACE = FaceConfig()
RADIUS = FACE.ahead + P.clearance + P.reach
PERIOD = 0.1
STEP = P.speed * PERIOD + 1e-9
TARGETS = [(-2.0, 0.3), (-2.0, -0.3), (1.0, 2.0), (0.5, -2.0), (3.0, 0.5)]

Pose = tuple[float, float, float]


class Moment(NamedTuple):
    """One cycle: where the robot is, and where it sees the believed middle of the object."""

    pose: Pose
    doing: str
    velocity: tuple[float, float, float]
    distance: float
    bearing: float


def untouched(cycle: int, moment: str) -> bool:
    return False


def gone(
    target: tuple[float, float],
    start: Pose = (0.0, 0.0, 0.0),
    lateral: float = 0.1,
    touches: Callable[[int, str], bool] = untouched,
) -> list[Moment]:
    """Go around until it is done; `touches` is told cycle and phase, one cycle late."""
    way, pose = GoAround(P, FACE, target, start, lateral), start
    told: list[Moment] = []
    middle, doing = believed(start, lateral), ""
    for cycle in range(2000):
        velocity = way.velocity(pose, touches(cycle, doing))
        if velocity is None:
            return told
        ahead, aside, turn, doing = velocity
        bearing = math.atan2(middle[1] - pose[1], middle[0] - pose[0]) - pose[2]
        told.append(
            Moment(pose, doing, velocity[:3], math.dist(middle, pose[:2]), wrapped(bearing))
        )
        heading = pose[2] + turn * PERIOD / 2.0
        x, y = place_of((PERIOD * ahead, PERIOD * aside), (pose[0], pose[1], heading))
        pose = x, y, pose[2] + PERIOD * turn
    raise AssertionError("it never ends")


def believed(start: Pose, lateral: float) -> tuple[float, float]:
    return place_of((FACE.ahead + P.reach, lateral), start)


def phase(moments: list[Moment], doing: str) -> list[Moment]:
    return [moment for moment in moments if moment.doing == doing]


@pytest.mark.parametrize("target", TARGETS)
def test_first_it_backs_off_straight(target: tuple[float, float]) -> None:
    moments = gone(target)
    back = phase(moments, "back off")
    assert moments[: len(back)] == back
    assert {moment.velocity for moment in back} == {(-P.speed, 0.0, 0.0)}
    free = moments[len(back)]
    ahead = free.distance * math.cos(free.bearing)
    assert RADIUS - BEHIND <= ahead <= RADIUS - BEHIND + STEP


@pytest.mark.parametrize("target", TARGETS)
def test_then_it_circles_at_one_distance_with_the_object_ahead(
    target: tuple[float, float],
) -> None:
    """Never further aside than at first, which were 10 cm."""
    circle = phase(gone(target), "go around")
    assert len(circle) > 3
    for moment in circle:
        assert moment.distance == pytest.approx(RADIUS, abs=BEHIND + 0.02)
        assert abs(moment.bearing) <= abs(circle[0].bearing) + 1e-9
    for moment in circle[15:]:
        assert moment.distance == pytest.approx(RADIUS, abs=0.03)


@pytest.mark.parametrize("target", TARGETS)
def test_it_goes_the_shorter_way_around(target: tuple[float, float]) -> None:
    moments = gone(target)
    middle = believed((0.0, 0.0, 0.0), 0.1)
    error = math.atan2(target[1] - middle[1], target[0] - middle[0])
    turned = moments[-1].pose[2]
    assert turned == pytest.approx(error, abs=BEHIND)
    circle = phase(moments, "go around")
    assert all(moment.velocity[2] * error > -1e-3 for moment in circle)


@pytest.mark.parametrize("target", TARGETS)
def test_in_the_end_it_goes_ahead_to_the_target_through_the_object(
    target: tuple[float, float],
) -> None:
    ahead = phase(gone(target), "go ahead")
    assert {moment.velocity for moment in ahead} == {(P.speed, 0.0, 0.0)}
    first = ahead[0]
    to_target = math.atan2(target[1] - first.pose[1], target[0] - first.pose[0])
    assert abs(wrapped(to_target - first.pose[2])) < 2.0 * BEHIND
    assert first.distance * math.sin(abs(first.bearing)) < CENTRED


def test_it_gives_up_when_nothing_is_met_where_the_object_was_believed_to_be() -> None:
    """The face is then 30 cm beyond its believed middle."""
    last = gone((-2.0, 0.3))[-1]
    beyond = FACE.ahead - last.distance * math.cos(last.bearing)
    assert GRACE - STEP <= beyond < GRACE


def test_a_touch_ends_it_only_when_it_goes_ahead() -> None:
    """While it backs off the object may still cling to the face."""
    moments = gone((-2.0, 0.3), touches=lambda _, doing: doing in ("", "back off", "go ahead"))
    plain = gone((-2.0, 0.3))
    assert moments == plain[: len(moments)]
    assert [moment.doing for moment in moments].count("go ahead") == 1


def test_what_is_touched_on_the_way_is_passed_further_away() -> None:
    first = next(row for row, one in enumerate(gone((-2.0, 0.3))) if one.doing == "go around")
    moments = gone((-2.0, 0.3), touches=lambda cycle, _: cycle == first + 10)
    assert moments[first + 10].doing == "back off"
    later = [moment for moment in moments[first + 30 :] if moment.doing == "go around"]
    assert len(later) > 10
    for moment in later:
        assert moment.distance == pytest.approx(RADIUS + MORE, abs=0.04)
    assert moments[-1].doing == "go ahead"


def test_where_and_how_the_robot_stands_makes_no_difference() -> None:
    start = (1.0, -2.0, 2.0)
    plain = gone((-2.0, 0.3))
    moved = gone(place_of((-2.0, 0.3), start), start)
    assert [one.doing for one in plain] == [one.doing for one in moved]
    for one, other in zip(plain, moved, strict=True):
        assert place_of(one.pose[:2], start) == pytest.approx(other.pose[:2])


def test_mirrored_is_mirrored() -> None:
    one, other = gone((-2.0, 0.3), lateral=0.1), gone((-2.0, -0.3), lateral=-0.1)
    for left, right in zip(one, other, strict=True):
        assert left.pose == pytest.approx((right.pose[0], -right.pose[1], -right.pose[2]))
