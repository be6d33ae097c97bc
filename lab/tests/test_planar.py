"""Pushing in the plane: what must hold, and what PyBullet says."""

import math
from typing import Any

import numpy as np
import pytest

from contactfusion.controllers.face import FaceConfig, FaceContact, on_face
from contactfusion.controllers.pushing import (
    Decision,
    PushingConfig,
    PushingController,
)
from contactfusion.controllers.reactive_pushing import ReactivePushing, ReactivePushingConfig
from contactfusion.errors import ConfigurationError
from contactfusion.frames import PlanarPose
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import TactileImage
from contactfusion.robots.description import read_robot
from contactfusion_lab.scenes.push import planar_kernels
from contactfusion_lab.scenes.push.bodies import ORIGIN_HEIGHT
from contactfusion_lab.scenes.push.config import FRICTIONS, RATE, PushConfig, SkinConfig
from contactfusion_lab.scenes.push.planar import (
    CHASSIS,
    STRIPS,
    PlanarPush,
    planar_trial,
)
from contactfusion_lab.scenes.push.scene import BASE, Ending, mobile_base
from contactfusion_lab.scenes.push.sensors import PushSkin
from contactfusion_lab.scenes.push.world import PushWorld

OBJECTS = ["box", "cylinder", "nonuniform", "lshape", "prism", "light_cylinder"]
Twist = tuple[float, float, float]


def scene(**fields: Any) -> PushConfig:
    return PushConfig(**{"target": (2.0, 0.0), **fields})


def pushed(cycles: int, twist: Twist, **fields: Any) -> PlanarPush:
    push = PlanarPush(scene(**fields))
    for _ in range(cycles):
        push.drive(*twist)
    return push


class Constant(PushingController[PushingConfig]):
    """Drives on, whatever it feels."""

    speed = 0.0

    def reset(self) -> None:
        pass

    def decide(
        self, touch: FaceContact | None, pose: PlanarPose, now: float, side: float = 0.0
    ) -> Decision:
        return Decision(self.speed, 0.0, 0.0, "push", "")


def constant(speed: float) -> Constant:
    controller = Constant(PushingConfig(target=(2.0, 0.0)))
    controller.speed = speed
    return controller


@pytest.mark.slow
@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("name", ["box", "cylinder"])
def test_a_square_push_moves_straight_against_coulomb_friction(name: str, friction: str) -> None:
    push = pushed(20, (0.2, 0.0, 0.0), object=name, friction=friction)
    before = push.object_pose
    push.drive(0.2, 0.0, 0.0)
    assert np.subtract(push.object_pose, before) == pytest.approx([0.02, 0.0, 0.0], abs=1e-5)
    mass = {"box": 20.0, "cylinder": 25.0}[name]
    force = push.touches.forces.sum() / 24
    assert force == pytest.approx(FRICTIONS[friction][0] * mass * 9.81, rel=0.01)


def test_what_is_not_touched_stays_where_it_is() -> None:
    push = PlanarPush(scene(gap=1.0))
    before = push.object_pose
    for _ in range(9):
        push.drive(0.1, 0.0, 0.0)
    assert push.object_pose == before
    assert push.contacts() == []
    assert push.truth()[0] == "none"


def test_what_is_let_go_soon_stops() -> None:
    push = pushed(10, (0.3, 0.0, 0.1), object="cylinder")
    for _ in range(3):
        push.drive(-0.3, 0.0, 0.0)
    before = push.object_pose
    push.drive(-0.3, 0.0, 0.0)
    assert push.object_pose == before
    assert before[0] < 0.62  # 0.3 m/s are gone after 1.5 cm


def test_a_cylinder_pushed_off_centre_slips_off_to_that_side() -> None:
    push, lateral = PlanarPush(scene(object="cylinder", offset=0.05)), [0.05]
    for _ in range(40):
        push.drive(0.2, 0.0, 0.15)
        x, y, yaw = push.base_pose
        there_x, there_y, _ = push.object_pose
        lateral.append(math.cos(yaw) * (there_y - y) - math.sin(yaw) * (there_x - x))
    assert np.all(np.diff(lateral[2:]) < 0.0)  # turning left sheds it to the right
    assert lateral[-1] < -0.1


@pytest.mark.parametrize("name", ["box", "cylinder", "prism"])
def test_a_mirrored_push_is_the_mirror_image(name: str) -> None:
    left = pushed(20, (0.2, 0.05, 0.2), object=name, offset=0.1, yaw=20.0)
    right = pushed(20, (0.2, -0.05, -0.2), object=name, offset=-0.1, yaw=-20.0)
    mirrored = np.multiply(right.object_pose, (1.0, -1.0, -1.0))
    assert left.object_pose == pytest.approx(mirrored, abs=2e-3)


@pytest.mark.slow
def test_the_same_push_gives_the_same_bytes() -> None:
    first, second = (pushed(50, (0.2, 0.03, 0.2), object="nonuniform", yaw=30.0) for _ in range(2))
    assert first.object_pose == second.object_pose
    assert first.touches.forces.tobytes() == second.touches.forces.tobytes()
    assert [str(contact) for contact in first.contacts()] == [str(c) for c in second.contacts()]


@pytest.mark.parametrize("name", OBJECTS)
def test_nothing_goes_through_the_robot_nor_flies_away(name: str) -> None:
    rng = np.random.default_rng(0)
    push = PlanarPush(scene(object=name, friction="mu2", yaw=20.0))
    for _ in range(60):
        before = push.object_pose
        push.drive(rng.uniform(0.1, 0.4), rng.uniform(-0.2, 0.2), rng.uniform(-0.6, 0.6))
        moved = math.hypot(*np.subtract(push.object_pose, before)[:2])
        assert moved < 0.1 * 0.9  # no more than what the corners of the robot move
        assert deepest(push) < 0.003


def deepest(push: PlanarPush) -> float:
    """Penetration of corners and rims into the robot [m]."""
    body, (x, y, yaw) = push._body, push._state[3:6]
    cos, sin = math.cos(yaw), math.sin(yaw)
    points = np.concatenate([body.outlines, body.circles[:, :2]])
    radii = np.concatenate([np.zeros(len(body.outlines)), body.circles[:, 2]])
    world = points @ np.array([[cos, sin], [-sin, cos]]) + [x, y]
    x, y, yaw = push.base_pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    local = (world - [x, y]) @ np.array([[cos, -sin], [sin, cos]])
    base = mobile_base()
    behind, before = base.rear - local[:, 0], local[:, 0] - base.front
    outside = np.maximum(np.maximum(behind, before), np.abs(local[:, 1]) - base.half_width)
    return float((radii - outside).max())


@pytest.mark.parametrize("name", OBJECTS)
@pytest.mark.parametrize(("offset", "yaw"), [(0.0, 0.0), (0.2, 40.0), (-0.15, -30.0)])
def test_an_object_stands_where_pybullet_has_it(name: str, offset: float, yaw: float) -> None:
    config = scene(object=name, offset=offset, yaw=yaw)
    world = PushWorld(config, read_robot(BASE))
    assert PlanarPush(config).object_pose == pytest.approx(world.object_pose, abs=2e-3)


@pytest.mark.parametrize("name", ["box", "cylinder", "nonuniform"])
@pytest.mark.parametrize("friction", FRICTIONS)
def test_a_push_moves_an_object_as_pybullet_does(name: str, friction: str) -> None:
    """Half a metre in a bend; PyBullet lets objects creep along the face though friction holds."""
    config = scene(object=name, friction=friction, offset=0.05, yaw=15.0)
    plane, world = PlanarPush(config), PushWorld(config, read_robot(BASE))
    for _ in range(25):
        for first in (plane, world):
            first.drive(0.2, 0.0, 0.15)
    error = np.subtract(plane.object_pose, world.object_pose)
    assert np.hypot(*error[:2]) < 0.06
    assert abs(error[2]) < 0.2


def test_the_base_is_that_of_the_description() -> None:
    robot = read_robot(BASE)
    assert PushWorld(scene(), robot).base.chassis == mobile_base()
    z, height = ORIGIN_HEIGHT + mobile_base().xyz[2], mobile_base().size[2]
    assert (z - height / 2.0, z + height / 2.0) == pytest.approx(CHASSIS)
    for strip, grid in zip(STRIPS, robot.patches["skin"].grids, strict=True):
        pose = grid.pose()
        assert pose[:2, 2] == pytest.approx(strip[:2], abs=1e-6)
        assert np.abs(pose[:2, 1]) == pytest.approx(strip[2:4], abs=1e-6)
        assert pose[:2, 3] @ strip[2:4] == pytest.approx(strip[4])
        assert (grid.pitch[1], grid.columns) == (strip[5], strip[6])


@pytest.mark.parametrize("name", OBJECTS)
def test_contacts_are_those_of_skin_generator_and_integrator(name: str) -> None:
    robot = read_robot(BASE)
    pipeline: dict[str, Any] = {
        "robot": {"urdf": str(robot.path()), "patches": {"skin": robot.patches["skin"]}},
        "integrator": {
            "frame": "base", "rule": "de_morgan", "voxel_size": 0.0125, "timeout": 0.25,
        },
        "generators": {
            "skin": {
                "type": "tactile", "sensor": "skin", "patch": "skin", "baseline": {"noise": 1e-6},
                "relative_to": "reading",
            }
        },
    }  # fmt: skip
    sense = Pipeline(PipelineConfig(**pipeline))
    skin = PushSkin(robot.patches["skin"], SkinConfig(noise=1e-12))
    push, rng, compared = PlanarPush(scene(object=name, yaw=25.0)), np.random.default_rng(0), 0
    for cycle in range(30):
        push.drive(0.2, 0.02, rng.uniform(-0.5, 0.5))
        values = skin.values(0.0, push.touches, round(0.1 * RATE), rng)
        sense.receive(TactileImage(stamp=0.1 * cycle, frame="base", sensor="skin", values=values))
        contacts = sense.step(0.1 * cycle).fusion.contacts
        expected, found = (on_face(c, FaceConfig()) for c in (contacts, push.contacts()))
        assert (expected is None) == (found is None)
        if expected and found:
            compared += 1
            assert found.kind == expected.kind
            assert found.lateral == pytest.approx(expected.lateral, abs=1e-4)
            assert found.left == pytest.approx(expected.left, abs=1e-4)
    assert compared > 10


def test_reactive_pushing_brings_an_object_to_its_target() -> None:
    controller = ReactivePushing(ReactivePushingConfig(target=(1.0, 1.0)))
    config = scene(object="cylinder", target=(1.0, 1.0))
    outcome = planar_trial(config, controller)
    assert outcome.ending == Ending.ARRIVED
    assert outcome.success_true
    assert outcome.distance < 0.05
    assert 5.0 < outcome.time < 60.0
    assert planar_trial(config, controller) == outcome  # nothing is kept from the push before


def test_a_push_ends_when_it_takes_too_long_or_loses_its_object() -> None:
    slow = planar_trial(scene(longest=2.0), constant(0.01))
    assert (slow.ending, slow.time, slow.success_true) == (Ending.TIMEOUT, 2.0, False)
    lost = planar_trial(scene(longest_lost=1.5), constant(-0.1))
    assert lost.ending == Ending.LOST
    assert lost.lost == pytest.approx(1.5, abs=0.11)
    assert math.isnan(lost.distance)
    away = planar_trial(scene(furthest=3.0), constant(0.4))
    assert away.ending == Ending.AWAY
    assert away.distance > 0.5


def test_what_cannot_be_pushed_in_the_plane_is_reported() -> None:
    with pytest.raises(ConfigurationError, match="knows no URDF"):
        PlanarPush(scene(object={"shape": "urdf", "urdf": "chair.urdf"}))
    high = {"shape": "box", "size": (0.4, 0.4, 0.2), "mass": 1.0}
    leg = {"shape": "box", "size": (0.4, 0.4, 0.04), "mass": 1.0}
    pieces = [{"piece": high, "bottom": 0.5}, {"piece": leg}]
    with pytest.raises(ConfigurationError, match="would not touch it"):
        PlanarPush(scene(object={"shape": "compound", "pieces": pieces}))
    with pytest.raises(ConfigurationError, match="out of sight"):
        PlanarPush(scene(offset=0.8))


def test_kernels_that_call_each_other_stand_in_one_module() -> None:
    for name, kernel in vars(planar_kernels).items():
        if hasattr(kernel, "py_func"):
            assert kernel.py_func.__module__ == planar_kernels.__name__, name
