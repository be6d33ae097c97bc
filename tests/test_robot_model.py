"""Where the links of a robot are, how they move, what hangs on a sensor, what is touched."""

import pickle
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.frames import pose_at, pose_of
from contactfusion.readings import JointState
from contactfusion.robots import model as model_module
from contactfusion.robots.description import LinkMassConfig, PayloadConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from tests.urdfs import ARM_HAND, KUKA, LIMIT, PANDA, REAL, built, joint, link, random_joints, real

BASE = pose_at((0.3, -0.2, 0.5), (0.1, 0.2, -2.0))
BOX = '<box size="0.1 0.1 0.1"/>'


def reading(**positions: float) -> JointState:
    values = np.array(list(positions.values()))
    return JointState(stamp=0.0, frame="base", names=tuple(positions), positions=values)


def posed(name: str, seed: int = 0, base: FloatArray = BASE) -> PosedRobot:
    model = real(name)
    return PosedRobot(model, random_joints(model, seed), "world", base)


@pytest.fixture(scope="module")
def two_links(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """Two links in a plane: 1 m and 0.5 m long, of 2 kg and 1 kg, with a weightless tip."""
    return built(
        tmp_path_factory.mktemp("two"),
        link("base"),
        link("upper", BOX, mass=2.0, at="0.5 0 0"),
        link("lower", BOX, mass=1.0, at="0.25 0 0"),
        link("tip"),
        joint("shoulder", "base", "upper", axis="0 0 1"),
        joint("elbow", "upper", "lower", xyz="1 0 0", axis="0 0 1"),
        joint("end", "lower", "tip", "fixed", xyz="0.5 0 0", inside=""),
        frames={"tool": {"parent": "tip", "xyz": (0, 0, 0.1)}, "eye": {"parent": "tool"}},
    )


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """A wheel without ends, a slide on it that may stay still, and a hinge."""
    return built(
        tmp_path_factory.mktemp("mixed"),
        *map(link, ("base", "wheel", "slide", "hinge")),
        joint("turn", "base", "wheel", "continuous", "", axis="0 0 1"),
        joint("push", "wheel", "slide", "prismatic", xyz="0 0 1", axis="2 0 0"),
        joint("bend", "slide", "hinge", axis="0 1 0"),
        still={"push": 0.25},
    )


class World:
    """The same robot in PyBullet."""

    def __init__(self, model: RobotModel) -> None:
        import pybullet

        self._library: Any = pybullet
        self._client = self._library.connect(self._library.DIRECT)
        where = {"physicsClientId": self._client}
        self._body = self._library.loadURDF(str(model.urdf.path), useFixedBase=True, **where)
        rows = range(self._library.getNumJoints(self._body, **where))
        told = [self._library.getJointInfo(self._body, row, **where) for row in rows]
        self._joints = {one[1].decode(): row for row, one in enumerate(told)}
        self.links = {one[12].decode(): row for row, one in enumerate(told)}

    def move(self, model: RobotModel, positions: FloatArray) -> None:
        for name, position in zip(model.joint_names, positions, strict=True):
            self._library.resetJointState(
                self._body, self._joints[name], position, physicsClientId=self._client
            )

    def state(self, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The link's pose, its centre of mass and its mass."""
        row, where = self.links[name], {"physicsClientId": self._client}
        told = self._library.getLinkState(self._body, row, computeForwardKinematics=True, **where)
        turn = np.array(self._library.getMatrixFromQuaternion(told[5])).reshape(3, 3)
        mass = self._library.getDynamicsInfo(self._body, row, **where)[0]
        return pose_of(told[4], turn), np.array(told[0]), mass

    def close(self) -> None:
        self._library.disconnect(self._client)


@pytest.fixture(scope="module", params=[PANDA, ARM_HAND, KUKA])
def world(request: pytest.FixtureRequest) -> Iterator[tuple[RobotModel, World]]:
    model = real(request.param)
    world = World(model)
    yield model, world
    world.close()


# Where links are


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_an_arm_of_two_links_reaches_where_geometry_says(
    two_links: RobotModel, shoulder: float, elbow: float
) -> None:
    poses = two_links.poses(reading(elbow=elbow, shoulder=shoulder))
    both = shoulder + elbow
    tip = [
        np.cos(shoulder) + 0.5 * np.cos(both),
        np.sin(shoulder) + 0.5 * np.sin(both),
        0.0,
    ]
    assert np.allclose(poses["tip"], pose_at(tip, (0.0, 0.0, both)), atol=1e-12)
    assert np.allclose(poses["lower"][:3, 3], [np.cos(shoulder), np.sin(shoulder), 0.0])
    assert np.array_equal(poses["base"], np.eye(4))


@given(st.floats(-9, 9), st.floats(-1, 2), st.floats(-1, 2))
def test_wheels_turn_without_end_and_slides_slide(
    mixed: RobotModel, turn: float, push: float, bend: float
) -> None:
    poses = mixed.poses(reading(push=push, turn=turn, bend=bend))
    wheel = pose_at((0.0, 0.0, 0.0), (0.0, 0.0, turn))
    slide = wheel @ pose_at((push, 0.0, 1.0), (0.0, 0.0, 0.0))
    assert np.allclose(poses["wheel"], wheel, atol=1e-12)
    assert np.allclose(poses["slide"], slide, atol=1e-12)
    assert np.allclose(poses["hinge"], slide @ pose_at((0, 0, 0), (0.0, bend, 0.0)), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_links_are_where_pybullet_has_them(world: tuple[RobotModel, World], seed: int) -> None:
    model, other = world
    positions = random_joints(model, seed)
    other.move(model, positions)
    poses = model.poses_at(positions)
    assert set(poses) == set(other.links) | {model.root}
    for name in other.links:
        assert np.allclose(poses[name], other.state(name)[0], rtol=0.0, atol=1e-6), name


def test_earlier_poses_stay_as_they_were(two_links: RobotModel) -> None:
    first = two_links.poses_at(np.array([0.5, 0.5]))
    kept = {name: pose.copy() for name, pose in first.items()}
    two_links.poses_at(np.array([-0.5, 1.0]))
    assert all(np.array_equal(first[name], kept[name]) for name in kept)


@pytest.mark.parametrize("name", REAL)
def test_a_jacobian_is_how_poses_change(name: str) -> None:
    model = real(name)
    positions, step = random_joints(model, 1), 1e-6
    for link_name in (model.link_names[-1], model.link_names[len(model.link_names) // 2]):
        jacobian = model.jacobian(link_name, positions)
        assert jacobian.shape == (6, len(model.joint_names))
        for row, unit in enumerate(np.eye(len(positions))):
            ahead = model.poses_at(positions + step * unit)[link_name]
            back = model.poses_at(positions - step * unit)[link_name]
            linear = (ahead[:3, 3] - back[:3, 3]) / (2 * step)
            turn = (ahead[:3, :3] - back[:3, :3]) @ model.poses_at(positions)[link_name][:3, :3].T
            angular = np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) / (2 * step)
            assert np.allclose(jacobian[:, row], [*linear, *angular], atol=1e-7)


def test_a_jacobian_knows_wheels_and_slides(mixed: RobotModel) -> None:
    turn, push = 0.7, 0.4
    jacobian = mixed.jacobian("hinge", np.array([turn, push, 0.3]))
    out = np.array([np.cos(turn), np.sin(turn), 0.0])
    assert np.allclose(jacobian[:, 0], [*np.cross([0, 0, 1], push * out), 0, 0, 1])
    assert np.allclose(jacobian[:, 1], [*out, 0, 0, 0])
    assert np.allclose(jacobian[:, 2], [0, 0, 0, -np.sin(turn), np.cos(turn), 0])


def test_the_jacobian_of_one_joint_is_a_table_too(tmp_path: Path) -> None:
    hinge = joint("hinge", "base", "arm", axis="0 0 1")
    model = built(tmp_path, link("base"), link("arm", BOX, mass=1.0), hinge)
    assert model.jacobian("arm", np.zeros(1)).tolist() == [[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]]


def test_a_joint_that_moves_no_mass_is_told(tmp_path: Path) -> None:
    hinge = joint("hinge", "base", "arm", axis="0 0 1")
    model = built(tmp_path, link("base"), link("arm", BOX), hinge)
    with pytest.raises(RobotError, match="joint 'hinge' moves no mass"):
        model.inertias(np.zeros(1))


def test_masses_and_payload_of_the_description_are_masses(tmp_path: Path) -> None:
    hinge = joint("hinge", "base", "arm", axis="0 0 1")
    bare = built(tmp_path, link("base"), link("arm", BOX), hinge)
    with pytest.raises(RobotError, match="joint 'hinge' moves no mass: give inertias of arm"):
        Dynamics(bare).require_inertias()
    for known in (
        {"masses": {"arm": LinkMassConfig(mass=1.0, centre_of_mass=(0.1, 0.0, 0.0))}},
        {"payload": PayloadConfig(frame="arm", mass=1.0)},
    ):
        Dynamics(RobotModel(bare.config.model_copy(update=known))).require_inertias()


def test_the_jacobian_of_an_unknown_link_is_refused(two_links: RobotModel) -> None:
    with pytest.raises(RobotError, match="unknown link 'uper': did you mean 'upper'"):
        two_links.jacobian("uper", np.zeros(2))


# Joints and their readings


def test_limits_are_those_of_the_file_and_wheels_have_none(mixed: RobotModel) -> None:
    assert mixed.joint_names == ("turn", "push", "bend")
    assert mixed.limits.tolist() == [[-np.inf, np.inf], [-1.0, 2.0], [-1.0, 2.0]]


def test_joints_are_found_by_name_among_those_of_others(mixed: RobotModel) -> None:
    found = mixed.positions(reading(bend=3.0, neck=9.0, turn=1.0, push=2.0))
    assert found.tolist() == [1.0, 2.0, 3.0]


def test_a_joint_that_is_still_may_be_left_out(mixed: RobotModel) -> None:
    assert mixed.positions(reading(bend=3.0, turn=1.0)).tolist() == [1.0, 0.25, 3.0]


def test_a_reading_tells_more_than_what_is_still(mixed: RobotModel) -> None:
    assert mixed.positions(reading(bend=3.0, turn=1.0, push=0.5)).tolist() == [1.0, 0.5, 3.0]


@pytest.fixture(scope="module")
def gripper(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """A palm with two fingers; the second follows the first, half as far and 0.1 further."""
    follow = f'{LIMIT}<mimic joint="first" multiplier="0.5" offset="0.1"/>'
    return built(
        tmp_path_factory.mktemp("gripper"),
        link("palm"),
        link("a", BOX),
        link("b", BOX),
        joint("second", "palm", "b", "prismatic", follow, axis="0 -1 0"),
        joint("first", "palm", "a", "prismatic", axis="0 1 0"),
    )


def test_a_joint_that_mimics_another_follows_it(gripper: RobotModel) -> None:
    assert dict(zip(gripper.joint_names, gripper.positions(reading(first=0.6)), strict=True)) == {
        "first": 0.6,
        "second": 0.4,
    }
    poses = gripper.poses(reading(first=0.6))
    assert poses["b"][1, 3] == pytest.approx(-0.4)


def test_a_joint_that_mimics_another_is_where_it_is_measured(gripper: RobotModel) -> None:
    positions = gripper.positions(reading(first=0.6, second=0.45))
    assert positions[gripper.joint_names.index("second")] == 0.45


def test_a_joint_that_mimics_one_that_is_still_follows_it(gripper: RobotModel) -> None:
    still = RobotModel(gripper.config.model_copy(update={"still": {"first": 0.2}}))
    assert {*still.positions(None)} == {0.2}
    stays = RobotModel(gripper.config.model_copy(update={"still": {"second": 0.3}}))
    assert {*stays.positions(reading(first=0.6))} == {0.6, 0.3}


def test_a_joint_that_was_measured_follows_no_reading_of_others(gripper: RobotModel) -> None:
    measured = gripper.positions(reading(first=0.6, second=0.45))
    posed, at = PosedRobot(gripper, measured, "palm", np.eye(4)), gripper.joint_names.index
    for joints, second in (
        (reading(first=0.6, second=0.45), 0.45),
        (reading(other=1.0), 0.45),
        (reading(first=0.8), 0.5),
    ):
        assert posed.with_joints(joints).positions[at("second")] == pytest.approx(second)


def test_the_joint_that_others_mimic_is_named_when_it_did_not_come(gripper: RobotModel) -> None:
    sentence = "no position of joint 'first' came, which 'second' mimics (and 1 more): "
    for joints in (None, reading(other=0.0)):
        with pytest.raises(RobotError, match=re.escape(sentence)):
            gripper.positions(joints)
    with pytest.raises(RobotError, match="no position of joint 'first' came: did you mean"):
        gripper.positions(reading(second=0.4, fist=0.0))


def test_a_joint_that_mimics_another_moves_as_fast_by_its_multiplier(gripper: RobotModel) -> None:
    index = gripper.joint_names.index
    speeds = gripper.speeds({"first": 0.6})
    assert (speeds[index("first")], speeds[index("second")]) == (0.6, 0.3)
    assert gripper.speeds({"first": 0.6, "second": 0.0})[index("second")] == 0.0


def test_links_beyond_unknown_joints_have_frames_of_their_own(two_links: RobotModel) -> None:
    positions, unknown = two_links.known_positions(reading(shoulder=0.5))
    assert unknown == ("elbow",)
    told = two_links.poses(reading(shoulder=0.5, elbow=-0.9))
    frames = two_links.frames_at(positions, unknown)
    below = two_links.urdf.hanging_on(two_links.urdf.children["elbow"])
    for name, (parent, pose) in frames.items():
        assert parent == (below[0] if name in below else two_links.root)
        np.testing.assert_allclose(told[parent] @ pose, told[name], atol=1e-12)
    assert {*frames} == {*two_links.link_names} - {two_links.root, two_links.urdf.children["elbow"]}


def test_a_robot_whose_joints_are_all_still_needs_no_reading(tmp_path: Path) -> None:
    model = built(tmp_path, link("a"), link("b"), joint("hinge", "a", "b"), still={"hinge": 0.5})
    for _ in range(2):
        positions = model.positions(None)
        assert positions.tolist() == [0.5]
        positions[:] = 9.0  # and what it gave may be changed


def test_a_robot_without_joints_needs_no_reading(tmp_path: Path) -> None:
    model = built(tmp_path, link("plate", BOX))
    assert model.joint_names == () and model.positions(None).shape == (0,)
    assert np.array_equal(model.poses(None)["plate"], np.eye(4))
    assert model.limits.shape == (0, 2)


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (
            {"shoulder": 0.0, "elbw": 0.0},
            "no position of joint 'elbow' came: did you mean 'elbw'? The joints of the reading "
            "are: elbw, shoulder",
        ),
        ({"q1": 0.0}, "no position of joint 'shoulder' came (and 1 more): the joints of the"),
        ({}, "no position of joint 'shoulder' came (and 1 more): there are no joints of the"),
    ],
)
def test_joints_that_did_not_come_are_told_with_the_nearest_that_did(
    joints: dict[str, float], words: str, two_links: RobotModel
) -> None:
    with pytest.raises(RobotError) as caught:
        two_links.poses(reading(**joints))
    assert words in str(caught.value)


# What hangs on a sensor


def test_a_load_is_the_sum_of_all_that_hangs_there(two_links: RobotModel) -> None:
    poses = two_links.poses(reading(shoulder=0.0, elbow=np.pi / 2))
    mass, centre = two_links.load_on("upper", poses)
    assert mass == 3.0
    assert np.allclose(centre, (2.0 * np.array([0.5, 0, 0]) + np.array([1, 0.25, 0])) / 3.0)
    mass, centre = two_links.load_on("lower", poses)
    assert mass == 1.0 and np.allclose(centre, [1.0, 0.25, 0.0])


def test_what_has_no_mass_weighs_nothing(two_links: RobotModel) -> None:
    mass, centre = two_links.load_on("tool", two_links.poses_at(np.zeros(2)))
    assert mass == 0.0 and np.allclose(centre, [1.5, 0.0, 0.0])


@pytest.mark.parametrize("seed", range(3))
def test_a_load_is_what_pybullet_weighs(world: tuple[RobotModel, World], seed: int) -> None:
    model, other = world
    positions = random_joints(model, seed)
    other.move(model, positions)
    poses = model.poses_at(positions)
    for name in other.links:
        states = [other.state(one) for one in model.beyond(name)]
        mass = sum(mass for *_, mass in states)
        found, centre = model.load_on(name, poses)
        assert found == pytest.approx(mass, abs=1e-9)
        if mass:
            expected = sum(mass * place for _, place, mass in states) / mass
            assert np.allclose(centre, expected, rtol=0.0, atol=1e-6)


def test_the_shipped_hand_weighs_what_its_parts_do() -> None:
    hand = 0.15 + 0.6 + 3 * (0.03 + 0.06 + 0.04)
    assert posed(ARM_HAND).load_on("wrist_sensor")[0] == pytest.approx(hand)


def test_a_load_is_given_in_the_frame_of_the_robot() -> None:
    robot, model = posed(PANDA), real(PANDA)
    mass, centre = robot.load_on("panda_hand")
    at_root, there = model.load_on("panda_hand", model.poses_at(robot.positions))
    assert mass == at_root
    assert np.allclose(centre, BASE[:3, :3] @ there + BASE[:3, 3])


def test_a_frame_leads_to_its_link_and_what_hangs_there(two_links: RobotModel) -> None:
    assert two_links.link_of("eye") == "tip" and two_links.link_of("upper") == "upper"
    assert two_links.beyond("eye") == ("tip",)
    assert two_links.beyond("upper") == ("upper", "lower", "tip")
    assert np.allclose(two_links.pose_on_link("eye"), pose_of((0.0, 0.0, 0.1)))
    assert np.array_equal(two_links.pose_on_link("upper"), np.eye(4))
    with pytest.raises(RobotError, match="unknown link 'tol'"):
        two_links.link_of("tol")


def test_a_frame_moves_with_its_link(two_links: RobotModel) -> None:
    robot = PosedRobot(two_links, np.array([0.0, np.pi / 2]), "world", BASE)
    assert np.allclose(robot.pose_of("eye"), BASE @ pose_at((1, 0.5, 0.1), (0, 0, np.pi / 2)))
    assert np.allclose(robot.pose_of("base"), BASE)


# What moves it


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """A lift of 1 kg, and on it a weight of 3 kg on an arm of 0.5 m that lies level at 0."""
    limits = [f'<limit lower="-3" upper="3" effort="{most}" velocity="1"/>' for most in (7, 9)]
    return built(
        tmp_path_factory.mktemp("pendulum"),
        link("base"),
        link("lift", BOX, mass=1.0),
        link("weight", BOX, mass=3.0, at="0.5 0 0"),
        joint("up", "base", "lift", "prismatic", limits[0], axis="0 0 1"),
        joint("swing", "lift", "weight", inside=limits[1], axis="0 1 0"),
    )


@given(st.floats(-1, 1), st.floats(-3, 3))
def test_a_weight_is_held_by_its_weight_and_its_lever(
    pendulum: RobotModel, up: float, swing: float
) -> None:
    held = pendulum.gravity_torques(np.array([up, swing]))
    assert np.allclose(held, 9.81 * np.array([4.0, -3.0 * 0.5 * np.cos(swing)]), atol=1e-9)


@pytest.mark.parametrize("name", REAL)
def test_gravity_torques_are_how_the_height_of_the_mass_changes(name: str) -> None:
    model = real(name)
    positions, step = random_joints(model, 3), 1e-5

    def energy(positions: FloatArray) -> float:
        mass, centre = model.load_on(model.root, model.poses_at(positions))
        return float(9.81 * mass * centre[2])

    slopes = [
        (energy(positions + step * unit) - energy(positions - step * unit)) / (2 * step)
        for unit in np.eye(len(positions))
    ]
    held = model.gravity_torques(positions)
    assert np.abs(held).max() > 1.0 and np.allclose(held, slopes, atol=1e-5)


def test_an_arm_in_a_level_plane_needs_no_torque(two_links: RobotModel) -> None:
    assert np.allclose(two_links.gravity_torques(np.array([0.3, 0.4])), 0.0, atol=1e-12)


@given(st.floats(-3, 3))
def test_an_inertia_is_what_a_joint_moves_when_the_others_yield(
    two_links: RobotModel, elbow: float
) -> None:
    # of links of 2 kg and 1 kg, each with 1 kg·m² about its centre at 0.5 m and 0.25 m
    second = 1.0 + 0.25**2
    both = 1.0 + 2.0 * 0.5**2 + 1.0 + (1.0 + 0.25**2 + 0.5 * np.cos(elbow))
    shared = second + 0.25 * np.cos(elbow)
    found = two_links.inertias(np.array([0.7, elbow]))
    assert np.allclose(found, [both - shared**2 / second, second - shared**2 / both])


def test_limits_of_effort_are_those_of_the_file(pendulum: RobotModel, mixed: RobotModel) -> None:
    assert pendulum.efforts.tolist() == [7.0, 9.0]
    assert mixed.efforts.tolist() == [np.inf, 1.0, 1.0]  # a wheel without limits has none


# What is touched


@pytest.mark.parametrize("name", REAL)
def test_the_surface_stands_where_the_links_do(name: str) -> None:
    robot = posed(name)
    surface, model = robot.surface, robot.model
    assert surface.frame == "world" and surface.link_names == model.link_names
    for number, link_name in enumerate(model.link_names):
        points = surface.points[surface.links == number]
        part = model.parts.get(link_name)
        if part is None:
            assert not len(points)
            continue
        pose = BASE @ model.poses_at(robot.positions)[link_name]
        assert np.allclose(points, part.points @ pose[:3, :3].T + pose[:3, 3], atol=1e-12)


@pytest.mark.parametrize("name", REAL)
def test_of_ten_thousand_points_the_nearest_surface_and_link_are_found(name: str) -> None:
    robot = posed(name, seed=2)
    surface = robot.surface
    rng = np.random.default_rng(0)
    middle, size = surface.points.mean(axis=0), np.ptp(surface.points, axis=0)
    points = middle + rng.uniform(-0.8, 0.8, (10_000, 3)) * size
    distances, rows = surface.nearest(points)
    away = np.linalg.norm(surface.points[rows] - points, axis=1)
    assert np.allclose(away, distances, rtol=0.0, atol=1e-9)
    exact, nearest = KDTree(surface.points).query(points)
    further = distances - exact
    assert further.min() > -1e-9
    assert (further <= np.maximum(0.2 * exact, 0.006)).all()  # it may be one beside the nearest
    assert (surface.links[rows] == surface.links[nearest]).mean() > 0.97


@pytest.mark.parametrize("name", REAL)
def test_near_the_robot_the_nearest_point_is_the_nearest_but_for_a_few(name: str) -> None:
    surface = posed(name, seed=2).surface
    rng = np.random.default_rng(0)
    points = surface.points[rng.integers(0, len(surface.points), 10_000)]
    points = points + rng.normal(0.0, 0.005, points.shape)
    distances, rows = surface.nearest(points)
    exact, nearest = KDTree(surface.points).query(points)
    assert (distances > exact + 1e-9).mean() < 0.02 and (distances - exact).max() < 0.006
    assert (surface.links[rows] == surface.links[nearest]).mean() > 0.995


def test_some_links_have_a_surface_of_their_own() -> None:
    robot = posed(ARM_HAND)
    hand = robot.surface_of(["palm", "finger_1_distal"])
    assert {hand.link_names[row] for row in hand.links} == {"palm", "finger_1_distal"}
    assert hand.link_names == robot.model.link_names
    with pytest.raises(RobotError, match="unknown link 'plam': did you mean 'palm'"):
        robot.surface_of(["plam"])


def test_spheres_stand_where_the_links_do() -> None:
    robot = posed(ARM_HAND)
    spheres = robot.model.spheres
    centres, radii = robot.spheres_of(["palm", "link_3"])
    assert len(centres) == len(radii)
    palm = spheres.centres[spheres.links == robot.model.link_names.index("palm")]
    pose = robot.poses["palm"]
    expected = palm @ pose[:3, :3].T + pose[:3, 3]
    assert np.abs(centres[:, None] - expected).max(axis=2).min(axis=0).max() < 1e-12
    assert len(robot.spheres_of(())[1]) == len(spheres.radii)


def test_a_robot_elsewhere_is_a_new_one() -> None:
    robot = posed(ARM_HAND)
    before = robot.poses["palm"].copy()
    there = robot.at(robot.positions + 0.1)
    assert not np.allclose(there.poses["palm"], before)
    assert np.array_equal(robot.poses["palm"], before) and there.model is robot.model


def test_only_the_links_that_are_chosen_make_up_the_surface(tmp_path: Path) -> None:
    elements = [link("a", BOX), link("b", BOX), link("c"), joint("1", "a", "b", "fixed", "")]
    elements.append(joint("2", "b", "c", "fixed", ""))
    assert tuple(built(tmp_path, *elements).parts) == ("a", "b")
    assert tuple(built(tmp_path, *elements, links=("b",)).parts) == ("b",)
    with pytest.raises(RobotError, match="no link has a <visual> shape"):
        _ = built(tmp_path, *elements, shapes="visual").parts
    with pytest.raises(RobotError, match="no link of `links` has a <collision> shape"):
        _ = built(tmp_path, *elements, links=("c",)).parts


def test_the_spacing_is_that_of_the_description(tmp_path: Path) -> None:
    for spacing, count in ((0.1, 6), (0.05, 24), (0.01, 600)):
        (part,) = built(tmp_path, link("a", BOX), spacing=spacing).parts.values()
        assert len(part.points) == count


# Travelling to another process


@pytest.mark.parametrize("name", REAL)
def test_a_robot_that_travels_arrives_as_it_was(name: str) -> None:
    robot = posed(name, seed=4)
    there = _travelled(robot)
    assert there.frame == "world" and np.array_equal(there.base, BASE)
    for link_name, pose in robot.poses.items():
        assert np.array_equal(there.poses[link_name], pose)
    assert there.model is not robot.model
    assert there.model.config == robot.model.config


def test_a_model_travels_with_its_whole_description(two_links: RobotModel) -> None:
    there = _travelled(two_links)
    assert there.config == two_links.config
    assert np.allclose(there.pose_on_link("eye"), two_links.pose_on_link("eye"))


def test_a_model_that_travels_twice_is_built_once(two_links: RobotModel) -> None:
    assert _travelled(two_links) is pickle.loads(pickle.dumps(two_links))


def test_a_model_travels_light() -> None:
    model = real(ARM_HAND)
    assert len(model.parts) and len(pickle.dumps(model)) < 2000


def _travelled(thing: Any) -> Any:
    model_module._built.cache_clear()
    return pickle.loads(pickle.dumps(thing))


@pytest.mark.parametrize("positions", [np.zeros(1), np.full(2, np.nan), np.zeros((1, 2))])
def test_positions_of_other_joints_and_nan_are_no_configuration(
    positions: Any, tmp_path: Path
) -> None:
    model = built(tmp_path, *map(link, "abc"), joint("j", "a", "b"), joint("k", "b", "c"))
    with pytest.raises(RobotError, match="the positions of 2 joints are as many finite numbers"):
        model.configuration(positions)
