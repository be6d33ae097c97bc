"""A hand goes ahead until it touches: what is read, and the truth apart from it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.frames import Pose, inverse, points_in, vectors_in
from contactfusion.readings import (
    DepthImage,
    JointState,
    ObjectPose,
    PointCloud,
    Reading,
    TactileImage,
    Wrench,
)
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.description import read_robot
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.objects import ObjectModel
from contactfusion_lab.experiments.touch.plan import DEFAULT
from contactfusion_lab.scenes.touch.config import TouchConfig
from contactfusion_lab.scenes.touch.scene import TouchScene, Truth
from lab.tests.test_touch_world import WALL
from tests.poker import RADIUS, poker
from tests.urdfs import ARM_HAND, outside_of_all, real

SCENE: dict[str, Any] = {
    **yaml.safe_load(DEFAULT.read_text())["scene"],
    "azimuth": 180.0,
    "elevation": 45.0,
}
GRAVITY = np.array([0.0, 0.0, -9.81])
SHORT = 0.02
BOX_0, BOX_1, CYLINDER_2, SPRAYER_2 = ("box", 0), ("box", 1), ("cylinder", 2), ("sprayer", 2)
TOUCHES = [BOX_0, BOX_1, CYLINDER_2, SPRAYER_2]


@cache
def arm_and_hand() -> RobotModel:
    return shared_robot(read_robot(real(ARM_HAND).urdf.path.with_suffix(".yaml")))


def config(**fields: Any) -> TouchConfig:
    return TouchConfig(**{**SCENE, **fields})


@dataclass(frozen=True)
class Done:
    """A touch that is over."""

    config: TouchConfig
    robot: RobotModel
    readings: tuple[Reading, ...]
    truth: Truth

    @property
    def poses(self) -> dict[str, Pose]:
        return self.robot.poses_at(self.truth.joints)

    @property
    def target(self) -> ObjectModel:
        return ObjectModel(self.config.objects[self.config.touched])

    def of(self, kind: Any, sensor: str = "") -> list[Any]:
        """The readings of a kind."""
        found = [reading for reading in self.readings if isinstance(reading, kind)]
        return [each for each in found if each.sensor == sensor or not sensor]


def done(scene: TouchConfig, robot: RobotModel, seed: int = 0) -> Done:
    played = TouchScene(scene, robot, seed)
    readings = tuple(played.readings())
    return Done(scene, robot, readings, played.truth)


@cache
def touch(target: str, seed: int, noise: str = "none", short: float = 0.0) -> Done:
    """Touch with the shipped hand, once in all tests."""
    scene = config(target=target, noise=noise, short=short)
    return done(scene, arm_and_hand(), seed)


# The truth


@pytest.mark.parametrize("which", TOUCHES)
def test_contacts_lie_on_the_object_and_on_the_link_that_is_reported(
    which: tuple[str, int],
) -> None:
    trial = touch(*which)
    contacts = trial.truth.contacts
    assert len(contacts.places) >= 1
    pose = trial.target.config.pose.pose()
    on_object = outside_of_all(trial.target.shapes, points_in(inverse(pose), contacts.places))
    assert np.abs(on_object).max() < 0.002
    for place, link in zip(contacts.places, contacts.links, strict=True):
        shapes = trial.robot.urdf.links[link].collision
        local = points_in(inverse(trial.poses[link]), place[None])
        assert abs(outside_of_all(shapes, local)[0]) < 0.003
        assert link in trial.robot.beyond("palm")


@pytest.mark.parametrize("which", TOUCHES)
def test_an_object_pushes_the_hand_away_as_strongly_as_the_hand_pressed(
    which: tuple[str, int],
) -> None:
    trial = touch(*which)
    contacts, step = trial.truth.contacts, 0.01
    strengths = np.linalg.norm(contacts.forces, axis=1)
    assert (np.diff(strengths) <= 0.0).all()
    assert 0.8 * trial.config.press < np.linalg.norm(contacts.forces.sum(axis=0)) < 12.0
    out = contacts.places[0] + step * contacts.forces[0] / strengths[0]
    pose = trial.target.config.pose.pose()
    away = outside_of_all(trial.target.shapes, points_in(inverse(pose), out[None]))
    assert away[0] > step * np.cos(np.arctan(trial.config.friction)) - 0.003


@pytest.mark.parametrize("which", TOUCHES)
def test_the_wrist_feels_the_weight_of_the_hand_and_the_contacts(which: tuple[str, int]) -> None:
    trial = touch(*which)
    assert trial.truth.steady
    pose = trial.poses["wrist_sensor"]
    last = trial.of(Wrench)[-6:]  # as long as the truth looks back
    felt = np.mean([np.stack([each.force, each.torque]) for each in last], axis=0)
    force, torque = vectors_in(pose, felt)
    mass, centre = trial.robot.load_on("wrist_sensor", trial.poses)
    contacts = trial.truth.contacts
    push = contacts.forces.sum(axis=0)
    lever = np.cross(contacts.places - pose[:3, 3], contacts.forces).sum(axis=0)
    torque = torque - np.cross(centre - pose[:3, 3], mass * GRAVITY)
    assert np.linalg.norm(force - mass * GRAVITY - push) < 0.01 * np.linalg.norm(push)
    assert np.linalg.norm(torque - lever) < 0.02 * np.linalg.norm(lever)


def test_the_truth_is_known_in_the_end_only() -> None:
    scene = TouchScene(config(), arm_and_hand())
    with pytest.raises(RuntimeError, match="known when all readings are taken"):
        _ = scene.truth
    readings = scene.readings()
    next(readings)
    with pytest.raises(RuntimeError, match="known when all readings are taken"):
        _ = scene.truth


# Readings


def test_without_noise_readings_measure_what_is() -> None:
    trial = touch(*BOX_0)
    (believed,) = trial.of(ObjectPose)
    assert believed.name == "box" and np.allclose(believed.position, [0.7, 0.0, 0.35])
    joints = trial.of(JointState)[-1]
    assert joints.names == trial.robot.joint_names
    assert np.array_equal(joints.positions, trial.truth.joints)
    assert np.abs(joints.velocities).max() < 0.01


def test_with_noise_the_truth_is_the_truth_still() -> None:
    exact, noisy = touch(*BOX_0), touch(*BOX_0, noise="prototype")
    # the same path, and errors only in what is read
    assert np.allclose(exact.truth.joints, noisy.truth.joints, atol=1e-12)
    assert np.array_equal(exact.truth.contacts.forces, noisy.truth.contacts.forces)
    off = noisy.of(JointState)[-1].positions - noisy.truth.joints
    assert 1e-4 < np.abs(off).max() < 0.1
    for kind in (Wrench, TactileImage, DepthImage, ObjectPose):
        assert _bytes(exact.of(kind)[-1]) != _bytes(noisy.of(kind)[-1])


def test_only_the_patches_of_links_that_are_touched_feel() -> None:
    ball = {
        "shapes": [{"shape": "sphere", "radius": 0.01}],
        "pose": {"parent": "base", "xyz": (0.65, 0.0, 0.5)},
    }
    wide: dict[str, Any] = {f"finger_{each}_proximal_joint": -0.3 for each in (1, 2, 3)}
    wide |= {name: SCENE["posture"][name] for name in ("arm_2", "arm_4", "arm_6")}
    wide |= {"finger_1_spread": 1.4, "finger_2_spread": -1.4}
    scene = config(
        objects={"ball": ball}, noise="none", posture=wide, tilt=0.0, wander=0.0, roll=(-60, 60)
    )
    trial = done(scene, arm_and_hand())
    contacts = trial.truth.contacts
    assert set(contacts.links) == {"palm"}
    last = {patch: trial.of(TactileImage, patch)[-1].values for patch in trial.robot.config.patches}
    strongest = last["palm"].argmax()
    assert 1.0 < last["palm"][strongest] < 1.5 * np.linalg.norm(contacts.forces[0])
    skin = trial.poses["palm"] @ trial.robot.pose_on_link("palm_skin")
    taxel = points_in(skin, trial.robot.config.patches["palm"].centres())[strongest]
    assert np.linalg.norm(taxel - contacts.places[0]) < 0.0055
    assert not any(values.any() for patch, values in last.items() if patch != "palm")


def test_the_camera_sees_the_robot_the_object_and_the_table() -> None:
    trial = touch(*BOX_0)
    (cloud, *_) = reversed(trial.of(PointCloud))
    viewpoint = trial.poses["base"] @ trial.robot.pose_on_link("forehead")
    points = points_in(viewpoint, cloud.points[::17])
    table = ObjectModel(trial.config.surroundings["table"])
    bodies = [(link.collision, trial.poses[name]) for name, link in trial.robot.urdf.links.items()]
    bodies += [(each.shapes, each.config.pose.pose()) for each in (trial.target, table)]
    away = np.array(
        [outside_of_all(shapes, points_in(inverse(pose), points)) for shapes, pose in bodies]
    )
    # round shapes are seen with 64 corners
    assert np.abs(away).min(axis=0).max() < 5e-4 and away.min() > -5e-4
    nearest = np.bincount(np.abs(away).argmin(axis=0), minlength=len(bodies))
    assert nearest[-1] > 50 and nearest[-2] > 10 and nearest[:-2].sum() > 50


def test_readings_come_in_time_at_their_rates_and_all_in_the_end() -> None:
    trial = touch(*BOX_0)
    stamps = [reading.stamp for reading in trial.readings]
    end = stamps[-1]
    assert stamps == sorted(stamps) and stamps[0] == 0.0 and 0.5 < end < 2.0
    kinds = {
        JointState: ("", 0.05),
        TactileImage: ("tip_1", 0.05),
        Wrench: ("wrist", 0.01),
        DepthImage: ("forehead", 0.25),
        PointCloud: ("forehead", 0.25),
    }
    for kind, (sensor, period) in kinds.items():
        times = [reading.stamp for reading in trial.of(kind, sensor)]
        assert times[-1] == end, kind
        assert np.allclose(np.diff(times[:-1]), period), kind
    assert {each.sensor for each in trial.of(TactileImage)} == {"tip_1", "tip_2", "tip_3", "palm"}


# Chance


def _bytes(reading: Reading) -> bytes:
    fields = {name: value for name, value in vars(reading).items()}
    parts = [type(reading).__name__.encode()]
    for name, value in sorted(fields.items()):
        held = value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
        parts.append(name.encode() + held)
    return b"|".join(parts)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    first = touch(*BOX_0, noise="prototype")
    again = done(first.config, arm_and_hand(), BOX_0[1])
    assert [*map(_bytes, first.readings)] == [*map(_bytes, again.readings)]
    assert first.truth.joints.tobytes() == again.truth.joints.tobytes()
    assert first.truth.contacts.places.tobytes() == again.truth.contacts.places.tobytes()
    other = touch(*BOX_1)
    assert not np.allclose(other.truth.joints, first.truth.joints, atol=0.01)


# Parts of a hard noise


def latest(readings: Sequence[Reading], kind: type[Reading]) -> float:
    return max([reading.stamp for reading in readings if isinstance(reading, kind)])


def test_the_press_force_is_drawn_from_a_range() -> None:
    forces = []
    for seed in (0, 1, 2):
        scene = TouchScene(config(noise={"press": (1.0, 3.0)}), arm_and_hand(), seed)
        assert 1.0 <= scene.press <= 3.0
        *_, _ = scene.readings()
        force = float(np.linalg.norm(scene.truth.contacts.forces.sum(axis=0)))
        assert 0.7 * scene.press < force < 5.5
        forces.append(scene.press)
    assert len(set(forces)) == 3
    assert TouchScene(config(press=4.0, noise="prototype"), arm_and_hand()).press == 4.0


def test_a_hand_that_slides_ends_its_touch_while_it_moves_sideways() -> None:
    slide = {"slide": 0.2}
    rests, slides = touch(*BOX_0), done(config(target="box", noise=slide), arm_and_hand())
    assert not slides.truth.steady and slides.truth.contacts.links
    speeds = np.abs(slides.of(JointState)[-1].velocities).max()
    assert speeds > 0.01 > np.abs(rests.of(JointState)[-1].velocities).max()
    robot = arm_and_hand()
    ends = [robot.poses_at(each.truth.joints)["palm"] for each in (rests, slides)]
    moved = ends[0][:3, :3].T @ (ends[1][:3, 3] - ends[0][:3, 3])
    assert 0.004 < np.hypot(moved[0], moved[1]) < 0.011  # 5 cm/s, held back by friction
    force = float(np.linalg.norm(slides.truth.contacts.forces.sum(axis=0)))
    assert 3.0 < force < 9.0  # the hand is stopped at 6 N
    short = done(config(target="box", noise=slide, short=SHORT), arm_and_hand())
    assert not short.truth.contacts.links and not short.truth.steady


def test_readings_arrive_late_each_kind_by_its_delay_and_not_after_the_end() -> None:
    delays = {"wrenches": 0.03, "sights": 0.1, "skins": (0.0, 0.04)}
    exact = touch(*BOX_0)
    scene = TouchScene(
        config(target="box", noise={"belief": False, "delays": delays}), arm_and_hand()
    )
    came = [
        (arrival.stamp or 0.0, reading)
        for arrival in scene.arrivals()
        for reading in arrival.readings
    ]
    stamps = [stamp for stamp, _ in came]
    assert stamps == sorted(stamps) and stamps[-1] == latest(exact.readings, JointState)
    for kind, late in ((Wrench, 0.03), (PointCloud, 0.1), (JointState, 0.0), (ObjectPose, 0.0)):
        delay = [at - reading.stamp for at, reading in came if isinstance(reading, kind)]
        assert delay == pytest.approx([late] * len(delay), abs=0.0011)
        count = sum(reading.stamp <= stamps[-1] - late - 1e-9 for reading in exact.of(kind))
        assert len(delay) in (count, count + 1)
    images = [at - reading.stamp for at, reading in came if isinstance(reading, TactileImage)]
    assert min(images) < 0.01 and 0.03 < max(images) < 0.042


def test_what_stands_around_is_seen_and_felt_but_in_nobodys_way_and_not_told() -> None:
    bare, scene = (
        touch(*BOX_0),
        TouchScene(config(target="box", noise={"belief": False, "clutter": True}), arm_and_hand()),
    )
    readings = list(scene.readings())
    (believed,) = (one for one in readings if isinstance(one, ObjectPose))
    assert believed.name == "box"
    assert {each.name for each in scene.facts().objects} == {"box", "table"}
    assert scene.truth.joints.tobytes() == bare.truth.joints.tobytes()
    assert scene.truth.contacts.forces.tobytes() == bare.truth.contacts.forces.tobytes()
    eye = bare.poses["base"] @ bare.robot.pose_on_link("forehead")
    known = [(link.collision, bare.poses[name]) for name, link in bare.robot.urdf.links.items()]
    for each in (bare.target, ObjectModel(bare.config.surroundings["table"])):
        known.append((each.shapes, each.config.pose.pose()))
    unknown = []
    for given in (readings, bare.readings):
        (cloud, *_) = reversed([one for one in given if isinstance(one, PointCloud)])
        points = points_in(eye, cloud.points[::17])
        away = [outside_of_all(shapes, points_in(inverse(pose), points)) for shapes, pose in known]
        unknown.append(int((np.min(np.abs(away), axis=0) > 0.01).sum()))
    assert unknown[0] > 200 and unknown[1] == 0


def test_a_robot_touches_with_its_true_surface_and_is_believed_to_be_as_described() -> None:
    contacts = []
    for seed in (0, 1):
        scene = TouchScene(config(target="box", noise={"surface": 0.004}), arm_and_hand(), seed)
        readings = tuple(scene.readings())
        one = Done(scene.config, arm_and_hand(), readings, scene.truth)
        for place, link in zip(one.truth.contacts.places, one.truth.contacts.links, strict=True):
            local = points_in(inverse(one.poses[link]), place[None])
            assert outside_of_all(one.robot.urdf.links[link].collision, local)[0] < 0.03
            contacts.append(abs(outside_of_all(one.robot.urdf.links[link].collision, local)[0]))
        joints = one.of(JointState)[-1]
        assert np.array_equal(joints.positions, one.truth.joints)
        assert scene.robot is arm_and_hand()
    assert max(contacts) > 0.0035


def test_all_parts_together_are_a_touch_still_and_the_same_for_the_same_seed() -> None:
    first, again = (done(config(target="box", noise="hard"), arm_and_hand(), 1) for _ in range(2))
    assert first.truth.contacts.links
    assert [*map(_bytes, first.readings)] == [*map(_bytes, again.readings)]


# A touch that stops before it touches


@pytest.mark.parametrize("which", [BOX_0, CYLINDER_2])
def test_a_twin_that_stops_short_follows_the_same_path_and_touches_nothing(
    which: tuple[str, int],
) -> None:
    full, short = touch(*which), touch(*which, short=SHORT)
    truth = short.truth
    assert truth.steady and not truth.contacts.links and truth.contacts.places.shape == (0, 3)
    first, there = (
        full.robot.poses_at(each.of(JointState)[0].positions)["palm"] for each in (full, short)
    )
    forward = first[:3, 2]
    assert np.allclose(first[:3, :3], there[:3, :3], atol=2e-3)
    assert np.allclose(first[:3, 3], there[:3, 3] + SHORT * forward, atol=4e-4)
    assert not any(each.values.any() for each in short.of(TactileImage))
    # from there it is `short` to the first touch, along the path
    world = BulletWorld(short.robot)
    world.bend(truth.joints)
    body = world.add(short.target.shapes[0])
    pose = short.target.config.pose.pose()
    for nearer, touches in ((SHORT - 0.003, False), (SHORT + 0.003, True)):
        moved = pose.copy()
        moved[:3, 3] -= nearer * forward
        world.place(body, moved)
        assert bool(world.near(body, 0.0)) is touches


def test_the_wrist_of_a_hand_in_free_air_feels_its_weight() -> None:
    trial = touch(*BOX_0, short=SHORT)
    wrench = trial.of(Wrench)[-1]
    force = trial.poses["wrist_sensor"][:3, :3] @ wrench.force
    mass, _ = trial.robot.load_on("wrist_sensor", trial.poses)
    assert np.allclose(force, mass * GRAVITY, atol=0.015 * mass * 9.81)


# A ball that pokes a wall


@pytest.fixture(scope="module")
def pokes(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return poker(tmp_path_factory.mktemp("poker"), foot="prismatic")


def poke(**fields: Any) -> TouchConfig:
    wall = {
        "shapes": [{"shape": "box", "size": (0.1, 1.0, 1.0)}],
        "pose": {"parent": "base", "xyz": (WALL + 0.05, 0.0, 0.5)},
    }
    given: dict[str, Any] = {
        "objects": {"wall": wall},
        "tool": "carriage",
        "elevation": 0.0,
        "roll": 0.0,
        "tilt": 0.0,
        "wander": 0.0,
        "noise": "none",
        "arm_stiffness": 2000.0,
    }
    return TouchConfig(**{**given, **fields})


def front(robot: RobotModel, joints: FloatArray) -> float:
    """The greatest x of the ball [m]."""
    ball = points_in(robot.poses_at(joints)["palm"], np.array([[0.05, 0.03, 0.08]]))[0]
    return float(ball[0] + RADIUS)


def test_a_poker_stops_where_it_is_pushed(pokes: RobotModel) -> None:
    trial = done(poke(press=10.0), pokes)
    contacts = trial.truth.contacts
    assert contacts.links == ("palm",) and trial.truth.steady
    assert front(pokes, trial.truth.joints) == pytest.approx(WALL, abs=1e-3)
    assert contacts.places[0, 0] == pytest.approx(WALL, abs=1e-3)
    assert contacts.forces[0] == pytest.approx([-10.0, 0.0, 0.0], abs=1.5)


@pytest.mark.parametrize("short", [0.005, 0.05])
def test_a_poker_that_stops_short_is_so_far_from_the_wall(pokes: RobotModel, short: float) -> None:
    trial = done(poke(short=short), pokes)
    assert not trial.truth.contacts.links
    assert front(pokes, trial.truth.joints) == pytest.approx(WALL - short, abs=5e-4)


@pytest.mark.parametrize("speed", [0.01, 0.02])
def test_a_poker_moves_at_the_given_speed(pokes: RobotModel, speed: float) -> None:
    joints = done(poke(speed=speed), pokes).of(JointState)
    positions = np.array([front(pokes, joint_state.positions) for joint_state in joints])
    stamps = np.array([joint_state.stamp for joint_state in joints])
    assert positions[0] == pytest.approx(WALL - 0.012, abs=5e-4)
    free = (positions < WALL - 0.001) & (stamps > 0.25)
    assert free.sum() > 4
    assert np.polyfit(stamps[free], positions[free], 1)[0] == pytest.approx(speed, rel=0.02)


def test_a_hand_that_may_not_touch_finds_no_path(pokes: RobotModel) -> None:
    with pytest.raises(RobotError, match="reaches 'wall' on none of 60 paths"):
        done(poke(hand=("flange",)), pokes)


@pytest.mark.parametrize(("y", "free"), [(0.1, False), (0.3, True)])
def test_a_hand_does_not_go_through_what_stands_in_its_path(
    pokes: RobotModel, y: float, free: bool
) -> None:
    post = {
        "shapes": [{"shape": "box", "size": (0.1, 0.1, 0.4)}],
        "pose": {"parent": "base", "xyz": (0.4, y, 0.5)},
    }
    scene = poke(surroundings={"post": post})
    if free:
        assert done(scene, pokes).truth.contacts.links == ("palm",)
    else:
        with pytest.raises(RobotError, match="reaches 'wall' on none of 60 paths"):
            done(scene, pokes)


# Objects of all kinds


def test_a_mesh_is_touched_as_the_box_that_it_is(tmp_path: Path) -> None:
    import open3d

    library: Any = open3d
    size = (0.08, 0.14, 0.2)
    mesh: Any = library.geometry.TriangleMesh.create_box(*size)
    mesh.translate([-edge / 2.0 for edge in size])
    library.io.write_triangle_mesh(str(tmp_path / "box.obj"), mesh)
    box = {**SCENE["objects"]["box"], "shapes": (), "mesh": tmp_path / "box.obj"}
    trial = done(config(objects={"box": box}, noise="none"), arm_and_hand(), BOX_1[1])
    same = touch(*BOX_1).truth.contacts
    assert trial.truth.contacts.links[0] == same.links[0]
    assert np.allclose(trial.truth.contacts.places[0], same.places[0], atol=0.003)


def test_an_object_by_urdf_is_touched() -> None:
    import pybullet_data

    urdf = str(Path(pybullet_data.__file__).with_name("cube_small.urdf"))
    cube = {"urdf": urdf, "pose": {"parent": "base", "xyz": (0.7, 0.0, 0.4)}}
    trial = done(config(objects={"cube": cube}, noise="none", wander=0.1), arm_and_hand(), 3)
    contacts = trial.truth.contacts
    assert len(contacts.links) >= 1
    away = np.abs(contacts.places - [0.7, 0.0, 0.4]).max(axis=1)
    assert np.abs(away - 0.025).max() < 0.003


# What cannot be


@pytest.mark.slow
def test_an_object_out_of_the_workspace_is_reported_by_name() -> None:
    box = {**SCENE["objects"]["box"], "pose": {"parent": "base", "xyz": (5.0, 0.0, 0.3)}}
    scene = TouchScene(config(objects={"crate": box}), arm_and_hand())
    with pytest.raises(RobotError, match="reaches 'crate' on none of .* outside the workspace"):
        next(scene.readings())


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"target": "sprayr"}, "target: unknown object 'sprayr'; did you mean 'sprayer'"),
        ({"noise": "ful"}, "noise: unknown noise 'ful'; did you mean 'full'"),
        ({"azimuth": (10.0, -10.0)}, "azimuth: give the least, then the greatest"),
        ({"elevation": (80.0, 10.0)}, "elevation: give the least, then the greatest"),
        ({"roll": (1.0, 0.0)}, "roll: give the least, then the greatest"),
        ({"surroundings": {"box": SCENE["objects"]["box"]}}, r"surroundings\.box: .* already"),
        ({"objects": {}}, "objects: "),
        ({"pres": 1.0}, "pres: unknown field; did you mean 'press'"),
        ({"press": 0.0}, "press: "),
        ({"tilt": 90.0}, "tilt: "),
        ({"wander": 0.6}, "wander: "),
        ({"short": -0.01}, "short: "),
    ],
)
def test_a_touch_that_cannot_be_is_refused(fields: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        config(**fields)


def test_ranges_may_be_numbers_and_the_first_object_is_the_target() -> None:
    scene = config(azimuth=90, elevation=(10.0, 10.0))
    assert scene.azimuth == (90.0, 90.0) and scene.elevation == (10.0, 10.0)
    assert scene.posture["arm_2"] == (0.6, 0.6) and scene.touched == "box"
    assert config(target="cylinder").touched == "cylinder"


@pytest.mark.parametrize(
    ("fields", "kind", "sentence"),
    [
        ({"tool": "plam"}, RobotError, "unknown link 'plam': did you mean 'palm'"),
        ({"hand": ("palm", "tip")}, RobotError, "unknown link 'tip'"),
        (
            {"posture": {"arm_22": 0.0}},
            ConfigurationError,
            r"posture\.arm_22: unknown joint 'arm_22': did you mean 'arm_2'",
        ),
        (
            {"objects": {"box": {**SCENE["objects"]["box"], "pose": {"parent": "world"}}}},
            ConfigurationError,
            r"objects\.box\.pose\.parent: .* root link 'base', not in 'world'",
        ),
        (
            {"surroundings": {"table": {**SCENE["objects"]["box"], "pose": {"parent": "palm"}}}},
            ConfigurationError,
            r"surroundings\.table\.pose\.parent: .* not in 'palm'",
        ),
    ],
)
def test_what_does_not_fit_the_robot_is_refused(
    fields: dict[str, Any], kind: type[Exception], sentence: str
) -> None:
    with pytest.raises(kind, match=sentence):
        TouchScene(config(**fields), arm_and_hand())
