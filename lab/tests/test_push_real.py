"""What the real robots pushed: soft, with a ball inside, and shoved by others."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion_lab.scenes.push.bodies import GRAVITY
from contactfusion_lab.scenes.push.config import named_object, read_object
from contactfusion_lab.scenes.push.objects import DisturbedConfig, HollowConfig, drawn
from contactfusion_lab.scenes.push.scene import touching
from contactfusion_lab.scenes.push.view import PushView
from contactfusion_lab.scenes.push.world import PushWorld
from lab.tests.test_push_world import FRONT, base, moved, pushed, tilt, world

ROOT = Path(__file__).parents[2]
STIFFNESS = 1500.0
"""Of the foam [N/m]."""
RADIUS = 0.5
"""Of the soft cylinder [m]."""
STILL: dict[str, Any] = {"gap": 1.0}
"""The robot is far from the object."""


def hollow_box(**fields: Any) -> dict[str, Any]:
    """The box with a ball, without shoves."""
    box = named_object("ball_box").model_dump(exclude={"disturbed"})
    return {**box, **fields}


def place(push: PushWorld, body: int) -> FloatArray:
    found: FloatArray = np.array(
        push._bullet.getBasePositionAndOrientation(body, **push._client)[0]
    )
    return found


def dent(push: PushWorld) -> float:
    """Penetration of the front into the soft cylinder, which is straight in front [m]."""
    return push.base_pose[0] + FRONT - (push.object_pose[0] - RADIUS)


def in_the_box(push: PushWorld) -> FloatArray:
    """Position of the ball, shape (3,) [m], in the frame of its box."""
    assert push._pushed.ball is not None
    x, y, yaw = push.object_pose
    forward, lateral, height = place(push, push._pushed.ball) - (x, y, 0.0)
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([cos * forward + sin * lateral, cos * lateral - sin * forward, height])


# Soft


@pytest.mark.parametrize("friction", ["mu1", "mu2"])
def test_the_soft_cylinder_yields_by_the_force_over_its_stiffness(friction: str) -> None:
    """It slides at µ m g, 1.6 and 2.4 N; its rim at times has a third point of contact."""
    push, dents, kinds = world(object="soft_cylinder", friction=friction), [], []
    pushed(push, 15, 0.2, 0.0, 0.0)
    for _ in range(30):
        pushed(push, 1, 0.2, 0.0, 0.0)
        dents.append(dent(push))
        kinds.append(touching(push.touches, push.steps)[0])
    force = push.config.friction.ground * 0.8 * GRAVITY
    assert np.mean(dents) == pytest.approx(force / STIFFNESS, rel=0.25)
    assert kinds.count("point") == len(kinds)


def test_what_is_rigid_does_not_yield() -> None:
    push = pushed(world(object="light_cylinder"), 30, 0.2, 0.0, 0.0)
    assert abs(dent(push)) < 1e-4


def test_the_floor_finds_the_soft_cylinder_rigid() -> None:
    push = world(object="soft_cylinder")
    for _ in range(30):
        pushed(push, 1, 0.2, 0.0, 0.0)
        assert place(push, push._object)[2] == pytest.approx(0.65 / 2.0, abs=5e-4)
        assert tilt(push) < 0.5


def test_what_is_too_soft_for_its_weight_is_reported() -> None:
    box = {"shape": "box", "size": (0.4, 0.4, 0.8), "mass": 20.0}
    soft = {"stiffness": 1000.0, "damping": 10.0}
    with pytest.raises(
        ConfigurationError, match=r"^object\.soft: 1000 N/m are too soft: .* 58.9 N"
    ):
        world(object={**box, "soft": soft})
    assert world(object={**box, "soft": {**soft, "stiffness": 1200.0}}).mass() == 20.0


# With a ball inside


def test_the_ball_starts_in_the_middle_of_the_floor_of_its_box() -> None:
    push = world(object=hollow_box(), yaw=30.0, offset=0.1)
    assert in_the_box(push) == pytest.approx([0.0, 0.0, 0.015 + 0.11], abs=1e-9)
    assert push.mass() == pytest.approx(6.9)
    assert moved(push, 20, 0.0, 0.0, 0.0) == pytest.approx(np.zeros(3), abs=1e-3)


def test_the_ball_rolls_and_stays_inside() -> None:
    """From wall to wall there are 0.37 - 2 · 0.11 = 0.15 m for its middle."""
    push, places = world(object=hollow_box()), []
    for cycle in range(120):
        speed = 0.25 if cycle % 40 < 30 else 0.0
        push.drive(speed, 0.15 * math.sin(cycle / 5.0), 0.3 * math.cos(cycle / 9.0))
        places.append(in_the_box(push))
    lateral = np.abs(np.array(places)[:, :2])
    assert lateral.max() < 0.075 + 0.002
    assert np.ptp(np.array(places)[:, :2], axis=0).min() > 0.1
    assert np.array(places)[:, 2] == pytest.approx(0.125, abs=0.002)


def test_a_ball_keeps_rolling_when_its_box_has_stopped() -> None:
    push = pushed(world(object=hollow_box()), 20, 0.25, 0.0, 0.0)
    pushed(push, 5, 0.0, 0.0, 0.0)
    before, stood = in_the_box(push), push.object_pose
    pushed(push, 3, 0.0, 0.0, 0.0)
    assert abs(in_the_box(push) - before)[0] > 0.02 > 10.0 * abs(push.object_pose[0] - stood[0])


def test_a_box_without_a_ball_is_hollow_and_lighter() -> None:
    push = world(object=hollow_box(ball=None))
    assert push._pushed.ball is None and push.mass() == pytest.approx(6.0)
    assert moved(push, 10, 0.2, 0.0, 0.0) == pytest.approx([0.2, 0.0, 0.0], abs=4e-3)


# Shoved


def distance(force: float, mass: float, duration: float, friction: float) -> float:
    """Distance by which a shove moves what rests: sped up, then slowed by friction [m]."""
    speed_up = force / mass - friction * GRAVITY
    speed = speed_up * duration
    return speed * duration / 2.0 + speed**2 / (2.0 * friction * GRAVITY)


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5])
@pytest.mark.parametrize(("force", "duration"), [(100.0, 0.3), (80.0, 0.5)])
def test_a_shove_moves_the_box_as_far_as_impulse_and_friction_say(
    angle: float, force: float, duration: float
) -> None:
    towards = math.cos(angle), math.sin(angle)
    shove = {"start": 0.5, "duration": duration, "force": tuple(force * np.array(towards))}
    push = world(**STILL, disturbances=(shove,))
    assert moved(push, 5, 0.0, 0.0, 0.0) == pytest.approx(np.zeros(3), abs=1e-3)
    x, y, yaw = moved(push, 25, 0.0, 0.0, 0.0)
    far = distance(force, 20.0, duration, 0.3)
    assert (x, y) == pytest.approx((far * towards[0], far * towards[1]), abs=0.03 * far)
    assert abs(yaw) < 0.02


def test_a_shove_weaker_than_friction_moves_nothing() -> None:
    """Which holds 59 N."""
    push = world(**STILL, disturbances=({"start": 0.2, "duration": 1.0, "force": (40.0, 30.0)},))
    assert moved(push, 20, 0.0, 0.0, 0.0) == pytest.approx(np.zeros(3), abs=2e-3)


def test_shoves_by_chance_are_those_of_their_seed() -> None:
    config = DisturbedConfig(count=50, force=30.0, before=8.0)
    push = drawn(config, 3)
    assert push == drawn(config, 3) != drawn(config, 4)
    starts = [shove.start for shove in push]
    assert starts == sorted(starts) and 0.0 <= starts[0] < 2.0 and 6.0 < starts[-1] < 8.0
    forces = np.array([shove.force for shove in push])
    assert np.hypot(*forces.T) == pytest.approx(np.full(50, 30.0))
    assert (forces.min(axis=0) < -20.0).all() and (forces.max(axis=0) > 20.0).all()


def test_what_is_disturbed_is_moved_elsewhere_by_another_seed() -> None:
    box = hollow_box(disturbed={"count": 1, "force": 60.0, "before": 0.5})
    moves = [moved(world(seed, object=box, **STILL), 20, 0.0, 0.0, 0.0) for seed in (1, 2)]
    assert all(math.hypot(x, y) > 0.1 for x, y, _ in moves)
    assert math.dist(moves[0][:2], moves[1][:2]) > 0.1


# All of them


@pytest.mark.parametrize("name", ["soft_cylinder", "ball_box"])
def test_the_same_push_is_the_same_bit_by_bit(name: str) -> None:
    def journey() -> bytes:
        push = world(5, object=name, yaw=20.0)
        rows: list[float] = []
        for cycle in range(60):
            push.drive(0.25, 0.1 * math.sin(cycle / 3.0), 0.3 * math.cos(cycle / 5.0))
            rows += [*push.object_pose, *push.touches.points.ravel(), *push.touches.forces]
        return np.array(rows).tobytes()

    assert journey() == journey()


@pytest.mark.slow
def test_the_chair_of_the_examples_is_pushed_and_seen() -> None:
    chair = read_object(ROOT / "examples" / "objects" / "chair.yaml")
    assert moved(world(object=chair), 10, 0.2, 0.0, 0.0)[0] == pytest.approx(0.2, abs=5e-3)
    view = PushView(chair, base())
    above = np.array([0.7, 0.0, 1.05])  # 1.5 m above the floor, over the middle of the seat
    rays = view.rays(above, np.array([[0.0, 0.0, -1.0], [0.2, 0.0, -1.0], [0.0, 0.5, -1.0]]))
    distances, on_it = view.distances(rays, (0.0, 0.0, 0.0), (0.7, 0.0, 0.0))
    assert on_it.tolist() == [True, True, False]
    assert distances[0] == pytest.approx(1.5 - 0.46, abs=1e-5)  # the seat
    assert distances[1] * 0.2 == pytest.approx(0.18, abs=1e-5)  # the back


def test_a_ball_is_not_seen_through_the_walls_of_its_box() -> None:
    """Rays meet the lid 0.45 m above the floor, from wherever they come."""
    box = HollowConfig(**hollow_box())
    view = PushView(box, base())
    rays = view.rays(np.array([0.8, 0.0, 1.05]), np.array([[0.0, 0.0, -1.0]]))
    distances, on_it = view.distances(rays, (0.0, 0.0, 0.0), (0.8, 0.0, 0.0))
    assert on_it.all() and distances[0] == pytest.approx(1.5 - 0.45, abs=1e-5)
