"""The physics of a push: bodies move as they must, and identically every time."""

import hashlib
import math
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.controllers.face import FaceConfig
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.robots.description import RobotConfig, read_robot
from contactfusion_lab.scenes.push.bodies import GRAVITY
from contactfusion_lab.scenes.push.config import OTHERS, PAPER, PushConfig, read_object
from contactfusion_lab.scenes.push.objects import outlines
from contactfusion_lab.scenes.push.scene import BASE, mobile_base
from contactfusion_lab.scenes.push.world import PushWorld
from tests.urdfs import link, written

ROOT = Path(__file__).parents[2]
KNOWN = [name for name in (*PAPER, *OTHERS) if name != "ball_box"]
"""Objects that nothing but the robot moves."""
FRONT, HALF_WIDTH = 0.3, 0.3
PERIOD = 0.1
FAR: dict[str, Any] = {"gap": 1.9, "object": "box"}
"""Nothing is touched on the first metre."""


@cache
def base() -> RobotConfig:
    return read_robot(BASE)


PAD = {"stiffness": 10_000.0, "damping": 400.0}


def world(seed: int = 0, **fields: Any) -> PushWorld:
    """A world whose faces are hard, so that what happens can be computed."""
    hard = {"target": (1.0, 0.0), "skin": {"pad": None}}
    return PushWorld(PushConfig(**{**hard, **fields}), base(), seed)


def pushed(push: PushWorld, cycles: int, *velocity: float) -> PushWorld:
    for _ in range(cycles):
        push.drive(*velocity)
    return push


def moved(push: PushWorld, cycles: int, *velocity: float) -> FloatArray:
    """The change of the object's pose."""
    before = push.object_pose
    return np.subtract(pushed(push, cycles, *velocity).object_pose, before)


def seen(push: PushWorld) -> FloatArray:
    """Corners of the object as it stands, shape (n, 2) [m]."""
    x, y, yaw = push.object_pose
    rotation = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    return np.concatenate([piece @ rotation + (x, y) for piece in outlines(push.config.object)])


def tilt(push: PushWorld) -> float:
    """The tilt of the object [degrees]."""
    place, rotation = push._bullet.getBasePositionAndOrientation(push._object, **push._client)
    assert place[2] > 0.0
    return math.degrees(2.0 * math.asin(min(1.0, math.hypot(rotation[0], rotation[1]))))


def force(push: PushWorld) -> float:
    """The mean force of a steady push [N]."""
    pushed(push, 15, 0.2, 0.0, 0.0)
    felt = []
    for _ in range(40):
        push.drive(0.2, 0.0, 0.0)
        felt.append(push.touches.forces.sum() / push.steps)
    return float(np.mean(felt))


# The base


@pytest.mark.parametrize("velocity", [(0.2, 0.0, 0.0), (0.0, -0.3, 0.0), (0.2, -0.1, 0.4)])
def test_the_base_follows_its_twist(velocity: tuple[float, float, float]) -> None:
    """From its second cycle on; in the first the motors have 150 kg to speed up, half a mm."""
    push = pushed(world(**FAR), 1, *velocity)
    forward, lateral, yaw_rate = velocity
    for _ in range(10):
        x, y, yaw = push.base_pose
        push.drive(*velocity)
        middle = yaw + yaw_rate * PERIOD / 2.0
        cos, sin = math.cos(middle), math.sin(middle)
        shift = PERIOD * (cos * forward - sin * lateral), PERIOD * (sin * forward + cos * lateral)
        assert push.base_pose == pytest.approx(
            (x + shift[0], y + shift[1], yaw + PERIOD * yaw_rate)
        )


def test_the_base_starts_with_its_front_at_0_and_hardly_lags() -> None:
    push = world(**FAR)
    assert push.base_pose == pytest.approx((-FRONT, 0.0, 0.0))
    pushed(push, 10, 0.3, 0.0, 0.0)
    assert push.base_pose == pytest.approx((-FRONT + 0.3, 0.0, 0.0), abs=1e-3)


def test_the_twist_is_given_along_the_robot() -> None:
    push = pushed(world(**FAR), 8, 0.0, 0.0, 1.0)
    assert push.base_twist == pytest.approx((0.0, 0.0, 1.0), abs=1e-9)
    pushed(push, 3, 0.2, -0.1, 0.0)
    assert push.base_pose[2] == pytest.approx(0.8)
    assert push.base_twist == pytest.approx((0.2, -0.1, 0.0), abs=1e-9)
    pushed(push, 1, 0.0, 0.0, 0.0)
    assert push.base_twist == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_an_object_does_not_hold_the_base_up() -> None:
    free, loaded = world(**FAR), world(object="cylinder", gap=0.0)
    for push in (free, loaded):
        pushed(push, 10, 0.2, 0.0, 0.0)
    assert loaded.base_pose == pytest.approx(free.base_pose, abs=2e-4)
    assert loaded.touches.forces.sum() / loaded.steps > 70.0


# What is pushed


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_not_touched_stays_where_it_is(name: str) -> None:
    push = world(object=name, gap=0.5, yaw=20.0)
    assert moved(push, 20, 0.0, 0.0, 0.0) == pytest.approx(np.zeros(3), abs=1e-3)
    assert not len(push.touches.forces) and push.touches.points.shape == (0, 3)


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_pushed_squarely_goes_straight_and_stays_upright(name: str) -> None:
    push, tilts = world(object=name), []
    for _ in range(5):
        shift = moved(push, 5, 0.2, 0.0, 0.0)
        tilts.append(tilt(push))
        assert shift == pytest.approx([0.1, 0.0, 0.0], abs=4e-3)
    assert max(tilts) < 2.0


@pytest.mark.parametrize("ground", [0.3, 0.15])
@pytest.mark.parametrize("name", PAPER)
def test_a_steady_push_is_as_strong_as_friction(name: str, ground: float) -> None:
    """F = µ m g; half the friction, half the force."""
    push = world(object=name, friction={"ground": ground, "robot": 0.0})
    assert force(push) == pytest.approx(ground * push.mass() * GRAVITY, rel=0.01)


LOW = ("cross", "stool")
"""Objects that stand too firmly to tip against the face."""


@pytest.mark.parametrize("friction", ["mu1", "mu2"])
@pytest.mark.parametrize("name", KNOWN)
def test_what_rubs_at_the_face_is_pressed_down_a_bit(name: str, friction: str) -> None:
    """The face holds what would tip ahead by µ' F at most, so that F ≤ µ (m g + µ' F); by more
    than half of that in fact."""
    push = world(object=name, friction=friction)
    rub = push.config.friction
    least = rub.ground * push.mass() * GRAVITY
    most = least / (1.0 - rub.ground * rub.robot)
    at_least = 0.98 * least if name in LOW else (least + most) / 2.0
    assert at_least < force(push) < 1.01 * most


@pytest.mark.parametrize(
    ("name", "offset", "turns"),
    [
        ("box", 0.28, 0),  # the front ends 2 cm beyond its middle
        ("box", 0.32, 1),  # and here 2 cm before
        ("box", -0.32, -1),
        ("nonuniform", 0.19, 0),  # its weight is 8.3 cm further to the left
        ("nonuniform", 0.24, 1),
        ("nonuniform", -0.36, 0),
        ("nonuniform", -0.41, -1),
    ],
)
def test_what_is_pushed_beside_its_weight_turns_around_it(
    name: str, offset: float, turns: int
) -> None:
    yaw = moved(world(object=name, offset=offset), 15, 0.2, 0.0, 0.0)[2]
    if turns:
        assert yaw * turns > 0.05
    else:
        assert abs(yaw) < 1e-3


# The pad


def flat_steps(pad: Any) -> float:
    """Share of the steps in which both ends of a flat face touch while it is pushed."""
    push = world(object="nonuniform", skin={"pad": pad})
    flat = 0
    for _ in range(40):
        touches = pushed(push, 1, 0.28, -0.08, 0.04).touches
        for step in range(push.steps):
            y = touches.points[touches.steps == step, 1]
            flat += len(y) > 1 and np.ptp(y) > 0.4
    return flat / (40.0 * push.steps)


def test_a_flat_face_rattles_less_on_a_pad_than_on_a_hard_front() -> None:
    assert flat_steps(PAD) > flat_steps(None) + 0.1


def test_a_pad_yields_as_its_stiffness_says() -> None:
    """74 N of a cylinder's friction press 10 kN/m in by 7 mm."""
    forward = []
    for pad in (None, PAD):
        push = pushed(world(object="cylinder", skin={"pad": pad}), 30, 0.1, 0.0, 0.0)
        forward.append(push.base_pose[0] - push.object_pose[0])
    padded = world(object="cylinder", skin={"pad": PAD})
    assert forward[1] - forward[0] == pytest.approx(force(padded) / 10_000.0, rel=0.3)


# Where it first touches


@pytest.mark.parametrize("gap", [0.0, 0.001, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_a_box_first_touches_with_its_foremost_corner(seed: int, gap: float) -> None:
    rng = np.random.default_rng(seed)
    push = world(yaw=rng.uniform(5.0, 85.0), offset=rng.uniform(-0.25, 0.25), gap=gap)
    corners = seen(push)
    foremost = corners[corners[:, 0].argmin()]
    assert abs(foremost[1]) < HALF_WIDTH
    assert push.first_contact == pytest.approx((0.0, foremost[1]), abs=2e-3)
    assert foremost[0] == pytest.approx(gap, abs=1e-3)
    pushed(push, math.ceil((gap + 0.005) / 0.02), 0.2, 0.0, 0.0)
    assert push.touches.points[0, 0] == pytest.approx(FRONT, abs=2e-3)
    assert push.touches.points[0, 1] == pytest.approx(foremost[1], abs=3e-3)
    assert push.touches.normals[0] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-3)


def test_what_another_world_of_the_process_sets_changes_nothing() -> None:
    """Bullet has one threshold for all worlds."""
    import pybullet

    poses = []
    for breaking in (0.02, 0.002):
        first, second = world(object="box", skin={"pad": PAD}), world()
        for _ in range(10):
            pybullet.setPhysicsEngineParameter(contactBreakingThreshold=breaking, **second._client)
            first.drive(0.2, 0.0, 0.1)
        poses.append(first.object_pose)
    assert poses[0] == poses[1]


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_cylinder_that_rolls_along_the_front_presses_straight_into_it(side: float) -> None:
    """No point of contact stays behind on the robot while its normal turns."""
    push = world(object="cylinder", gap=0.0, offset=side * 0.084, skin={"pad": PAD})
    for _ in range(45):
        push.drive(0.15, side * 0.26, -side * 0.33)
        on_face = np.abs(push.touches.points[:, 1]) < HALF_WIDTH - 0.02
        pressed = on_face & (push.touches.forces > 1.0)
        assert np.all(push.touches.normals[pressed, 0] < -0.95)


@pytest.mark.parametrize("offset", [-0.2, 0.0, 0.29])
def test_a_cylinder_first_touches_at_its_middle(offset: float) -> None:
    push = world(object="cylinder", offset=offset, gap=0.02)
    assert push.first_contact == pytest.approx((0.0, offset), abs=2e-3)
    assert push.object_pose == pytest.approx((0.25 + 0.02, offset, 0.0), abs=1e-3)


def test_what_stands_at_the_edge_first_touches_there() -> None:
    """The cylinder is met 10 cm beside its middle, which is 3 in 5 of √(25² - 10²) ahead."""
    push = world(object="cylinder", offset=0.4, gap=0.0)
    assert push.first_contact == pytest.approx((0.0, HALF_WIDTH), abs=2e-3)
    assert push.object_pose[0] == pytest.approx(math.sqrt(0.25**2 - 0.1**2), abs=1e-3)


def test_a_mirrored_start_is_mirrored() -> None:
    first, second = world(yaw=25.0, offset=0.1), world(yaw=-25.0, offset=-0.1)
    assert first.first_contact == pytest.approx((0.0, -second.first_contact[1]), abs=1e-6)
    assert first.object_pose[0] == pytest.approx(second.object_pose[0], abs=1e-6)


# The same every time


TWICE = """
from lab.tests.test_push_world import journey, printed
print(printed(journey()))
print(printed(journey()))
"""


def printed(rows: FloatArray) -> str:
    return hashlib.sha256(rows.tobytes()).hexdigest()


def journey() -> FloatArray:
    """All poses and contacts of an odd object pushed along a winding path."""
    push = world(object="nonuniform", yaw=33.0, offset=0.1, friction="mu2")
    rows: list[Sequence[float]] = []
    for cycle in range(40):
        push.drive(0.25, 0.1 * math.sin(cycle / 3.0), 0.3 * math.cos(cycle / 5.0))
        rows.append([*push.base_pose, *push.object_pose, *push.base_twist])
        rows += np.concatenate(
            [push.touches.points, push.touches.normals, push.touches.forces[:, None],
             push.touches.steps[:, None], np.zeros((len(push.touches.steps), 1))], axis=1
        ).tolist()  # fmt: skip
    return np.array(rows)


def test_the_same_push_is_the_same_bit_by_bit_also_elsewhere_and_says_nothing() -> None:
    """In this process, where another world lives, and in one that loads PyBullet first."""
    other = pushed(world(object="cylinder"), 3, 0.2, 0.1, 0.1)
    first = journey()
    pushed(other, 2, 0.2, 0.1, 0.1)
    assert first.tobytes() == journey().tobytes()
    done = subprocess.run(
        [sys.executable, "-c", TWICE], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout == f"{printed(first)}\n" * 2
    assert done.stderr == ""


# An object by URDF


def boxed(folder: Path, mass: float = 8.0, rpy: str = "0 0 0") -> dict[str, Any]:
    """Write a box that stands on the floor, its weight 5 cm ahead and 2 cm to the left."""
    inertia = '<inertia ixx="0.4" iyy="0.3" izz="0.2" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<origin xyz="0.05 0.02 0.2" rpy="{rpy}"/><mass value="{mass}"/>{inertia}'
    shape = '<origin xyz="0 0 0.3"/><geometry><box size="0.4 0.5 0.6"/></geometry>'
    body = f'<link name="b"><inertial>{inertial}</inertial><collision>{shape}</collision></link>'
    return {"shape": "urdf", "urdf": str(written(folder, body))}


@pytest.mark.parametrize("rpy", ["0 0 0", "0 0 0.5", "1.5707963267948966 0 0"])
def test_a_urdf_stands_on_the_floor_however_its_inertia_is_turned(rpy: str, tmp_path: Path) -> None:
    push = world(object=boxed(tmp_path, rpy=rpy), yaw=90.0, offset=0.05, gap=0.01)
    assert push.mass() == 8.0
    assert push.object_pose == pytest.approx((0.25 + 0.01, 0.05, math.pi / 2.0), abs=1e-3)
    assert moved(push, 15, 0.2, 0.0, 0.0) == pytest.approx([0.29, 0.0, 0.0], abs=3e-3)


def test_what_is_lower_than_the_base_is_never_met() -> None:
    """The mug of the examples has its origin at its middle; its upper half is 5 cm high."""
    mug = read_object(ROOT / "examples" / "objects" / "mug.urdf")
    with pytest.raises(ConfigurationError, match="^offset: the object starts out of sight"):
        world(object=mug)


# Bad input


@pytest.mark.parametrize("offset", [0.51, -0.6, 3.0])
def test_what_the_front_would_pass_is_out_of_sight(offset: float) -> None:
    problem = "^offset: the object starts out of sight: the robot's front, 0.6 m wide, would pass"
    with pytest.raises(ConfigurationError, match=problem):
        world(offset=offset)
    assert world(offset=math.copysign(0.49, offset)).first_contact[1] * offset > 0.0


def test_what_is_too_heavy_is_reported() -> None:
    fields = {"shape": "box", "size": (1, 1, 1), "mass": 250.5}
    with pytest.raises(ConfigurationError, match="^object: 250.5 kg are too heavy: .* 250 kg at"):
        world(object=fields)


def test_what_has_no_mass_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="^object: it has no mass"):
        world(object=boxed(tmp_path, mass=0.0))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (None, "there is no file 'robot.urdf' in"),
        ("<robot", "robot.urdf"),
        ('<robot name="r"></robot>', "robot.urdf"),
        (
            link("a", '<mesh filename="gone.obj"/>', 1.0),
            "robot.urdf: link 'a': the mesh 'gone.obj'",
        ),
    ],
)
def test_a_urdf_that_does_not_load_is_reported_in_a_sentence(
    text: str | None, problem: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.urdf"
    if text is not None:
        path.write_text(text if "robot" in text else f'<robot name="r">{text}</robot>')
    with pytest.raises(RobotError, match=problem) as error:
        world(object={"shape": "urdf", "urdf": str(path)})
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "shapes",
    [
        [link("base", '<sphere radius="0.3"/>')],
        [link("base")],
        [link("base", '<box size="1 1 1"/>'), link("arm", '<box size="1 1 1"/>')],
    ],
)
def test_a_base_is_one_box(shapes: list[str], tmp_path: Path) -> None:
    joint = '<joint name="j" type="fixed"><parent link="base"/><child link="arm"/></joint>'
    path = written(tmp_path, *shapes, joint if len(shapes) > 1 else "")
    with pytest.raises(RobotError, match="robot.urdf: a base that pushes has one collision shape"):
        PushWorld(PushConfig(target=(1.0, 0.0)), RobotConfig(urdf=str(path)))


def test_a_world_prints_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Nor does PyBullet, which would warn of what has no inertia."""
    path = written(tmp_path, link("light", '<box size="0.4 0.4 0.6"/>'))
    pushed(world(object={"shape": "urdf", "urdf": str(path)}), 2, 0.2, 0.0, 0.0)
    assert capfd.readouterr() == ("", "")


def test_a_window_needs_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(ConfigurationError, match="window: there is no screen"):
        world(window=True)


def test_an_object_without_a_shape_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "ghost.urdf"
    path.write_text('<robot name="ghost"><link name="body"/></robot>')
    with pytest.raises(RobotError, match="ghost.urdf: it has no collision shape"):
        world(object={"shape": "urdf", "urdf": str(path)})


def test_the_chassis_is_that_of_the_urdf_and_its_face_the_one_that_controllers_know() -> None:
    chassis, face = mobile_base(), FaceConfig()
    assert (chassis.front, chassis.rear, chassis.half_width) == (FRONT, -0.42, HALF_WIDTH)
    assert (face.ahead, face.half_width) == (chassis.front, chassis.half_width)
    assert chassis.corners.tolist() == [[-0.42, -0.3], [0.3, -0.3], [0.3, 0.3], [-0.42, 0.3]]
