"""A grasp as its sensors measure it, the truth apart from it, and the closed loop of both."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.controllers.grasp_parameters import GraspMode, ReactiveGraspConfig
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.frames import inverse, pose_of
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import (
    DepthImage,
    JointCommand,
    JointState,
    Reading,
    TactileImage,
    Twist,
    Wrench,
)
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion.run.execute import run_file
from contactfusion.scene import open_scene
from contactfusion_lab.experiments.grasp.plan import DEFAULT, NONE, Column, read_plan
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.scenes.arm import STEP
from contactfusion_lab.scenes.grasp.config import GraspConfig
from contactfusion_lab.scenes.grasp.driver import FASTEST, GraspDriver
from contactfusion_lab.scenes.grasp.scene import (
    OBJECT,
    GraspCycle,
    GraspMoment,
    GraspScene,
    GraspTruth,
    grasped,
    result_of,
)
from contactfusion_lab.scenes.noise import PARTS
from tests.test_docs import unnamed

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "examples" / "scenes"
PAPERS = Column("force_torque+motion", Method("de_morgan", "cluster_centroid"))
OPEN_LOOP = Column(NONE, PAPERS.method)
FINGER = "finger_1_proximal_joint"
PLAN = read_plan(DEFAULT, ["bottle", "mug", "carton"], (), None, 0)


def robot() -> RobotModel:
    assert PLAN.pipeline.robot is not None
    return shared_robot(PLAN.pipeline.robot)


def config(name: str = "bottle", **fields: Any) -> GraspConfig:
    """A scene without cameras, in which nothing is left to chance but the noise."""
    defaults = PLAN.scenes[name].model_dump()
    fixed = {"azimuth": 180.0, "offset": 0.0, "yaw": 0.0, "camera_rate": 0.0}
    return GraspConfig(**{**defaults, **fixed, **fields})


def scene(seed: int = 1, name: str = "bottle", **fields: Any) -> GraspScene:
    return GraspScene(config(name, **fields), robot(), seed)


def moved(
    grasp: GraspScene, seconds: float, *velocity: float, gripper: float | None = None
) -> None:
    """Move the tool by a velocity in its own frame."""
    for _ in range(round(seconds / grasp.config.period)):
        linear = np.array(velocity or (0.0, 0.0, 0.0))
        twist = Twist(stamp=grasp.stamp, frame="palm", linear=linear, angular=np.zeros(3))
        grasp.obey(Command(twist=twist, gripper=gripper))


def played(grasp: GraspScene, column: Column, **pipeline: Any) -> list[GraspCycle]:
    chosen = PLAN.pipeline_of(column).model_copy(update=pipeline)
    return list(grasped(grasp, Pipeline(chosen)))


@cache
def still() -> Step:
    """A step in which nothing is felt."""
    return Pipeline(PipelineConfig(integrator=IntegratorConfig(frame="base"))).step(0.0)


def moment(stamp: float, mode: str, height: float = 0.0) -> GraspMoment:
    """A cycle of which only mode and truth are set: a bottle, so much higher than it stood."""
    truth = GraspTruth(
        stamp=stamp,
        object=pose_of((0.8, 0.0, 0.25 + height), np.eye(3)),
        tool=np.eye(4),
        joints=np.zeros(1),
        touched=True,
        supported=height == 0.0,
        force=0.0,
    )
    return GraspMoment(truth, mode, "")


def lift_up() -> list[GraspMoment]:
    """A bottle is approached, from 3 s on lifted, and from 4 to 7 s held."""
    modes = ["open"] * 2 + ["approach"] * 2 + ["close"] * 2 + ["lift"] * 2 + ["hold"] * 7
    return [
        moment(0.5 * row, mode, 0.13 * float(np.clip(0.5 * row - 3.0, 0.0, 1.0)))
        for row, mode in enumerate(modes)
    ]


def otherwise(cycles: list[GraspMoment], row: int, **truth: Any) -> list[GraspMoment]:
    """The same, but for what is true in one cycle."""
    others = list(cycles)
    others[row] = replace(cycles[row], truth=replace(cycles[row].truth, **truth))
    return others


def success(grasp: GraspScene, cycles: list[GraspCycle]) -> bool:
    return result_of(cycles, grasp.config.lifted, grasp.config.held).success


@cache
def lifted_bottle() -> tuple[GraspScene, list[GraspCycle]]:
    grasp = scene(offset=0.045)
    return grasp, played(grasp, PAPERS)


# The world


def test_at_the_start_the_object_stands_on_the_table_where_the_scene_says() -> None:
    truth = scene(offset=0.03, yaw=20.0).truth()
    assert truth.object[:3, 3] == pytest.approx([0.8, 0.03, 0.25], abs=0.003)
    assert np.arctan2(truth.object[1, 0], truth.object[0, 0]) == pytest.approx(
        np.radians(20.0), abs=1e-3
    )
    assert not truth.touched and truth.force == 0.0


def test_the_hand_begins_level_and_so_far_before_where_the_object_should_be() -> None:
    truth = scene(azimuth=160.0).truth()
    forward = truth.object[:3, 3] - truth.tool[:3, 3]
    assert truth.tool[:3, 1] == pytest.approx([0.0, 0.0, 1.0], abs=0.01)
    assert float(forward @ truth.tool[:3, 2]) == pytest.approx(0.28, abs=0.003)
    assert np.degrees(np.arctan2(-truth.tool[1, 2], -truth.tool[0, 2])) == pytest.approx(160, abs=1)


def test_offsets_are_to_the_left_as_the_hand_goes() -> None:
    truth = scene(azimuth=200.0, offset=0.05).truth()
    there = np.linalg.inv(truth.tool) @ truth.object
    assert there[0, 3] == pytest.approx(0.05, abs=0.003)


def test_the_object_has_the_mass_of_its_urdf_or_what_the_scene_says() -> None:
    bottle, carton = scene(), scene(name="carton")
    for grasp, mass in ((bottle, 0.45), (carton, 0.5)):
        world = grasp._world
        assert world._bullet.getDynamicsInfo(world._body, -1, **world._client)[0] == mass


@pytest.mark.parametrize(
    ("name", "mass"),
    [("duck", 0.3), ("cup", 0.35), ("blob", 0.7), ("cross", 0.1), ("dumbbell", 1.5)],
)
def test_an_object_for_testing_stands_on_the_table_with_its_mass(name: str, mass: float) -> None:
    there = read_plan(DEFAULT, [name], (), None, 0).scenes[name]
    assert there.mass == mass
    fixed = {"azimuth": (180.0, 180.0), "offset": (0.0, 0.0), "yaw": (0.0, 0.0)}
    standing = GraspScene(there.model_copy(update={**fixed, "camera_rate": 0.0}), robot(), 1)
    moved(standing, 0.5, 0.0, 0.0, 0.0)
    truth = standing.truth()
    assert truth.supported and not truth.touched
    assert np.abs(truth.object - there.object.pose.pose()).max() < 0.02


def test_what_is_off_the_table_falls_to_the_floor() -> None:
    grasp = scene(offset=0.6)
    moved(grasp, 1.5)
    assert -0.1 < grasp.truth().object[2, 3] < 0.2


def test_the_tool_follows_its_twist_and_does_not_rotate() -> None:
    grasp = scene()
    before = grasp.truth().tool
    moved(grasp, 2.0, 0.02, 0.01, 0.0)
    moved(grasp, 0.5)
    after = grasp.truth().tool
    assert before[:3, :3].T @ (after - before)[:3, 3] == pytest.approx([0.04, 0.02, 0], abs=0.004)
    assert after[:3, :3] == pytest.approx(before[:3, :3], abs=0.01)


def test_a_twist_may_be_given_along_the_axes_of_the_root_link() -> None:
    grasp = scene()
    before = grasp.truth().tool[2, 3]
    for _ in range(20):
        up = Twist(stamp=0.0, frame="base", linear=np.array([0, 0, 0.05]), angular=np.zeros(3))
        grasp.obey(Command(twist=up))
    assert grasp.truth().tool[2, 3] - before == pytest.approx(0.045, abs=0.008)


def test_joints_go_at_the_commanded_speed() -> None:
    grasp = scene()
    row = robot().joint_names.index("arm_1")
    before = grasp.truth().joints[row]
    for _ in range(10):
        grasp.obey(Command(joint_velocities={"arm_1": 0.2}))
    assert grasp.truth().joints[row] - before == pytest.approx(0.1, abs=0.02)


def twist(frame: str) -> Command:
    return Command(twist=Twist(stamp=0, frame=frame, linear=np.zeros(3), angular=np.zeros(3)))


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (twist("wrist_sensor"), "a twist is given in 'palm' or 'base', not in 'wrist_sensor'"),
        (Command(joint_velocities={"arm_9": 0.1}), "unknown joint 'arm_9': did you mean 'arm_"),
        (Command(joint_velocities={"finger_1_distal_joint": 0.1}), "the gripper leads joint"),
    ],
)
def test_a_command_that_does_not_fit_is_reported_in_a_sentence(
    command: Command, sentence: str
) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        one_scene().obey(command)


@cache
def one_scene() -> GraspScene:
    return scene()


def test_the_gripper_closes_and_opens() -> None:
    grasp = scene()
    row = robot().joint_names.index("finger_1_proximal_joint")
    ends = []
    for gripper in (0.0, 1.0):
        moved(grasp, 2.5, 0.0, 0.0, 0.0, gripper=gripper)
        ends.append(float(grasp.truth().joints[row]))
    assert ends == pytest.approx([-0.15, 1.3], abs=0.03)


def led(command: Command, seconds: float, **start: float) -> FloatArray:
    """Greatest speeds of an arm that follows a command exactly, by joint [rad/s]."""
    names, grasp = robot().joint_names, config()
    wanted = one_scene().truth().joints.copy()
    for name, position in start.items():
        wanted[names.index(name)] = position
    stiffness = np.full(len(names), 400.0)
    driver = GraspDriver(robot(), "palm", grasp.gripper, grasp.grip, grasp.press, stiffness, wanted)
    driver.obey(command)
    paths = [wanted, *(driver.advance(driver.commanded) for _ in range(round(seconds / STEP)))]
    arm = [row for row, name in enumerate(names) if name.startswith("arm_")]
    fastest: FloatArray = np.abs(np.diff(paths, axis=0)).max(axis=0)[arm] / STEP
    return fastest


@pytest.mark.parametrize("speed", [30.0, -30.0])
def test_no_joint_is_faster_than_it_may_be_however_fast_the_command(speed: float) -> None:
    fastest = led(Command(joint_velocities={"arm_1": speed, "arm_2": 0.5}), 0.1)
    assert fastest == pytest.approx([FASTEST, 0.5, *[0.0] * (len(fastest) - 2)], abs=1e-6)


def test_no_joint_is_faster_to_follow_a_tool_when_the_arm_is_almost_stretched_out() -> None:
    forward = Twist(stamp=0, frame="palm", linear=np.array([0, 0, 0.15]), angular=np.zeros(3))
    assert led(Command(twist=forward), 0.15, arm_4=-0.1).max() == pytest.approx(FASTEST)
    assert led(Command(twist=forward), 0.15).max() < 0.2
    both = Command(twist=forward, joint_velocities={f"arm_{row}": 1.0 for row in range(1, 8)})
    assert led(both, 0.15, arm_4=-0.1).max() == pytest.approx(FASTEST)


def test_at_the_limits_of_its_joints_the_hand_stays_on_its_path() -> None:
    """Going back, the elbow soon bends no further: the hand waits there, and does not go round."""
    grasp = scene(azimuth=180.0)
    start = grasp.truth().tool
    moved(grasp, 1.5, 0.0, 0.0, -0.05)
    away = (inverse(start) @ grasp.truth().tool)[:3, 3]
    assert -0.02 < away[2] < -0.005
    assert np.abs(away[:2]).max() < 0.01


@pytest.mark.parametrize(("press", "least", "most"), [(1000.0, 100.0, 250.0), (30.0, 20.0, 75.0)])
def test_the_hand_presses_with_limited_force_against_what_does_not_yield(
    press: float, least: float, most: float
) -> None:
    pressed = scene(name="carton", mass=60.0, table_friction=0.59, press=press)
    moved(pressed, 1.0, 0.0, 0.0, 0.0, gripper=0.0)
    moved(pressed, 5.0, 0.0, 0.0, 0.06)
    assert least < pressed.truth().force < most


def test_a_hand_that_has_yielded_stays_on_its_way_and_goes_back_from_what_it_touches() -> None:
    pressed = scene(name="carton", mass=60.0, table_friction=0.59)
    moved(pressed, 1.0, 0.0, 0.0, 0.0, gripper=0.0)
    start = pressed.truth().tool
    moved(pressed, 5.0, 0.0, 0.0, 0.06)
    there = (inverse(start) @ pressed.truth().tool)[:3, 3]
    moved(pressed, 2.0, 0.0, 0.0, -0.06)
    back = (inverse(start) @ pressed.truth().tool)[:3, 3]
    assert np.abs([*there[:2], *back[:2]]).max() < 0.01
    assert there[2] - back[2] > 0.09
    assert not pressed.truth().touched


def test_a_push_between_two_questions_is_reported_once() -> None:
    """The hand runs into the bottle and goes back before anybody asks."""
    grasp = scene(distance=0.24, offset=0.035)
    assert grasp.truth().force == 0.0
    moved(grasp, 0.4, 0.0, 0.0, 0.1)
    moved(grasp, 0.7, 0.0, 0.0, -0.1)
    after, later = grasp.truth(), grasp.truth()
    assert not after.touched and after.force > 1.0
    assert later.force == 0.0


# What is read


def test_sensors_measure_joints_skins_and_wrists_and_where_the_gripper_moves() -> None:
    grasp = scene()
    moved(grasp, 0.1, 0.0, 0.0, 0.0, gripper=0.0)
    readings = grasp.readings()
    kinds = {type(reading) for reading in readings}
    assert kinds == {JointState, TactileImage, Wrench, JointCommand}
    assert [reading.stamp for reading in readings] == sorted(reading.stamp for reading in readings)
    assert sum(isinstance(reading, Wrench) for reading in readings) == 10


def test_a_gripper_that_gets_the_same_command_again_commands_nothing_new() -> None:
    grasp = scene()
    moved(grasp, 0.1, 0.0, 0.0, 0.0, gripper=0.0)
    assert sum(isinstance(reading, JointCommand) for reading in grasp.readings()) == 1


def test_cameras_see_when_they_are_on() -> None:
    grasp = scene(camera_rate=10.0)
    grasp.readings()
    moved(grasp, 0.1)
    assert {reading.sensor for reading in grasp.readings()} >= {"forehead"}


def test_a_wrist_measures_no_more_than_its_range() -> None:
    grasp = scene(wrench_range=(2.0, 0.1))
    moved(grasp, 0.1)
    wrenches = [reading for reading in grasp.readings() if isinstance(reading, Wrench)]
    assert max(np.abs(wrench.force).max() for wrench in wrenches) == 2.0
    assert max(np.abs(wrench.torque).max() for wrench in wrenches) == 0.1


def test_who_looks_changes_nothing_of_what_wrists_joints_and_skins_read() -> None:
    received = []
    for rate in (0.0, 20.0):
        grasp = scene(3, offset=(-0.05, 0.05), camera_rate=rate)
        felt, seen = list[list[float]](), 0
        for _ in range(3):
            for reading in grasp.readings():
                match reading:
                    case Wrench():
                        felt.append([*reading.force, *reading.torque])
                    case TactileImage():
                        felt.append(reading.values.tolist())
                    case JointState():
                        felt.append(reading.positions.tolist())
                    case _:
                        seen += 1
            moved(grasp, 0.05)
        received.append((felt, seen > 0))
    (blind, none), (looking, some) = received
    assert blind == looking
    assert (none, some) == (False, True)


def test_the_same_seed_gives_the_same_grasp_and_another_another() -> None:
    paths = []
    for seed in (3, 3, 4):
        grasp = scene(seed, offset=(-0.05, 0.05))
        moved(grasp, 0.5, 0.0, 0.0, 0.05)
        joints = [reading for reading in grasp.readings() if isinstance(reading, JointState)]
        paths.append((grasp.truth().object.tolist(), joints[-1].positions.tolist()))
    assert paths[0] == paths[1] != paths[2]


# Parts of a hard noise


def cycles_of(one: GraspScene, count: int = 12) -> list[list[Reading]]:
    """The readings of cycles in which the hand goes on a little."""
    found = [one.readings()]
    for _ in range(count):
        moved(one, 0.05, 0.0, 0.0, 0.05)
        found.append(one.readings())
    return found


def test_readings_come_in_later_cycles_when_they_are_late() -> None:
    delays = {"skins": 0.12, "wrenches": 0.035, "sights": 0.22}
    late, exact = (
        cycles_of(scene(camera_rate=10.0, noise={"delays": given})) for given in (delays, {})
    )
    for kind, delay in (
        (TactileImage, 0.12),
        (Wrench, 0.035),
        (DepthImage, 0.22),
        (JointState, 0.0),
    ):
        for cycle, readings in enumerate(late):
            now = 0.05 * cycle
            stamps = [reading.stamp for reading in readings if isinstance(reading, kind)]
            all_due = [
                reading.stamp
                for readings in exact
                for reading in readings
                if isinstance(reading, kind)
                and now - 0.05 + 1e-9 < reading.stamp + delay <= now + 1e-9
            ]
            assert stamps == pytest.approx(all_due), (kind, cycle)


def test_what_stands_around_is_seen_and_changes_nothing_that_is_felt() -> None:
    bare, one = (scene(camera_rate=10.0, noise={"clutter": given}) for given in (False, True))
    images = []
    for each in (bare, one):
        (depth,) = (reading for reading in each.readings() if isinstance(reading, DepthImage))
        images.append(depth.depth)
    nearer = (images[1] > 0.0) & ((images[1] < images[0] - 0.01) | (images[0] == 0.0))
    assert nearer.sum() > 1000
    behind = images[0] > 0.0
    assert (images[1][behind] <= images[0][behind] + 1e-6).all()
    assert [each.name for each in one.facts().objects] == [OBJECT]
    assert not one.truth().touched and one.truth().force == 0.0
    here, there = (
        [
            [*reading.force, *reading.torque]
            for readings in cycles_of(each)
            for reading in readings
            if isinstance(reading, Wrench)
        ]
        for each in (bare, one)
    )
    assert here == there


@pytest.mark.parametrize("there", [True, False])
def test_what_stands_around_holds_up_what_lies_on_it(there: bool) -> None:
    one = scene(mass=0.3)
    if there:
        shape = {"shape": "box", "size": (0.2, 0.2, 0.02)}
        pose = {"parent": "base", "xyz": (0.8, 0.0, 0.54)}
        block = ObjectConfig.model_validate({"shapes": [shape], "pose": pose})
        one._world.stand([ObjectModel(block)])
    raised = one.truth().object
    raised[2, 3] += 0.301
    one._world.put(raised)
    moved(one, 0.2)
    assert one.truth().supported is there


def test_a_grasping_hand_has_its_true_surface_which_cameras_see() -> None:
    bare, one = (scene(camera_rate=10.0, noise={"surface": given}) for given in (0.0, 0.004))
    images = []
    for each in (bare, one):
        (depth,) = (reading for reading in each.readings() if isinstance(reading, DepthImage))
        images.append(depth.depth)
    off = np.abs(images[1] - images[0])
    assert 0.01 < np.mean(off > 1e-4) < 0.3
    assert one.robot is bare.robot


@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_a_hard_noise_works_in_a_grasp(part: str) -> None:
    cycles = cycles_of(scene(camera_rate=10.0, noise=f"prototype+{part}"), 4)
    assert sum(map(len, cycles)) > 20


def test_a_hard_grasp_is_the_same_for_the_same_seed() -> None:
    first, again = (
        [
            [*reading.force, *reading.torque]
            for readings in cycles_of(scene(camera_rate=10.0, noise="hard"))
            for reading in readings
            if isinstance(reading, Wrench)
        ]
        for _ in range(2)
    )
    assert first == again and len(first) > 30


# The closed loop


@pytest.mark.slow
def test_open_loop_a_bottle_straight_in_front_is_lifted_and_held() -> None:
    grasp = scene()
    cycles = played(grasp, OPEN_LOOP)
    assert cycles[-1].ending == "lifted"
    assert success(grasp, cycles)


@pytest.mark.slow
def test_open_loop_a_bottle_far_beside_is_not() -> None:
    grasp = scene(offset=0.07)  # at 0.05 it depends on the CPU whether fingers catch it
    assert not success(grasp, played(grasp, OPEN_LOOP))


@pytest.mark.slow
def test_wrist_and_motion_find_the_bottle_beside_correct_the_hand_and_lift_it() -> None:
    grasp, cycles = lifted_bottle()
    result = result_of(cycles, grasp.config.lifted, grasp.config.held)
    assert cycles[-1].ending == "lifted"
    assert result.success and not result.fallen
    assert result.corrections >= 1
    assert result.height > 0.1
    (back, *_) = [
        cycle for cycle in cycles if cycle.step.command and cycle.step.command.mode == "back"
    ]
    assert back.step.command is not None and "wrist" in back.step.command.reason


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mug", "carton"])
def test_other_objects_are_lifted_too(name: str) -> None:
    grasp = scene(name=name, offset=0.02, yaw=10.0)
    assert success(grasp, played(grasp, PAPERS))


def test_the_truth_states_where_the_object_stands_and_what_touches_the_hand() -> None:
    grasp, _ = lifted_bottle()
    facts = grasp.facts()
    assert [pose.name for pose in facts.objects] == [OBJECT]
    assert facts.objects[0].position[2] > 0.35
    assert len(facts.contacts) >= 2


def test_what_was_held_at_the_end_only_for_a_moment_is_no_success() -> None:
    grasp, cycles = lifted_bottle()
    assert result_of(cycles, 0.1, 2.0).success
    assert not result_of(cycles, 0.1, 5.0).success
    assert not result_of(cycles, 0.2, 2.0).success


@pytest.mark.slow
@pytest.mark.parametrize("period", [0.02, 0.1])
def test_a_hand_that_is_led_more_or_less_often_corrects_itself_and_lifts(period: float) -> None:
    grasp = scene(offset=0.045, period=period)
    cycles = played(grasp, PAPERS)
    assert cycles[-1].ending == "lifted"
    result = result_of(cycles, grasp.config.lifted, grasp.config.held)
    assert result.success and result.corrections >= 1
    assert cycles[1].truth.stamp == pytest.approx(period)


def test_without_a_controller_nothing_is_grasped() -> None:
    with pytest.raises(ConfigurationError, match="a grasp needs a controller"):
        played(scene(), PAPERS, controller=None)


# What came of it


def test_what_only_the_hand_holds_up_for_two_seconds_is_a_success() -> None:
    result = result_of(lift_up(), 0.1, 2.0)
    assert result.success and not result.fallen
    assert (result.time, result.height) == pytest.approx((7.0, 0.13))


def test_what_lies_on_something_else_in_the_last_seconds_is_no_success() -> None:
    cycles = lift_up()
    assert not result_of(otherwise(cycles, 12, supported=True), 0.1, 2.0).success
    assert not result_of(otherwise(cycles, -1, supported=True), 0.1, 2.0).success
    assert result_of(otherwise(cycles, 9, supported=True), 0.1, 2.0).success


def test_what_the_hand_does_not_touch_in_the_end_is_no_success_however_high() -> None:
    cycles = lift_up()
    assert not result_of(otherwise(cycles, -1, touched=False), 0.1, 2.0).success


@pytest.mark.parametrize(
    ("lean", "supported", "fallen"),
    [(60.0, False, False), (60.0, True, True), (90.0, True, True), (30.0, True, False)],
)
def test_fallen_is_what_lies_and_not_what_leans_in_the_hand(
    lean: float, supported: bool, fallen: bool
) -> None:
    rotation = Rotation.from_euler("zx", [120.0, lean], degrees=True).as_matrix()
    leaning = pose_of((0.8, 0.0, 0.3), rotation)
    cycles = otherwise(lift_up(), -1, object=leaning, supported=supported)
    assert result_of(cycles, 0.1, 2.0).fallen == fallen


@pytest.mark.parametrize(
    ("mode", "force"),
    [
        *((mode, 7.0) for mode in ("approach", "back", "aside", "enter")),
        *((mode, 3.0) for mode in ("open", "close", "lift", "hold", "retreat")),
    ],
)
def test_a_push_counts_when_it_was_felt_on_the_path_to_the_object(mode: str, force: float) -> None:
    """What a cycle reports was felt in the mode that was commanded before."""
    modes = ["approach", mode, "lifted"]
    cycles = [moment(0.0, "open"), *(moment(0.1, each) for each in modes)]
    pushed = otherwise(otherwise(cycles, 2, force=3.0), 3, force=7.0)
    assert result_of(pushed, 0.1, 2.0).force == force


# By configuration


@pytest.mark.slow
def test_a_scene_file_is_run_and_its_truth_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_file(SCENES / "grasp_bottle.yaml", overrides=["scene.offset=0.04"], out=tmp_path, seed=2)
    truth = json.loads((tmp_path / "summary.json").read_text())["truth"]
    assert truth["ending"] == "lifted" and truth["success"]
    assert "lifted after" in capsys.readouterr().out
    commands = (tmp_path / "commands.csv").read_text()
    assert all(f",{mode}," in commands for mode in ("open", "approach", "close", "lift", "hold"))


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"tool": "plam"}, "unknown link 'plam'.*did you mean 'palm'"),
        ({"posture": {"arm_22": 0.0}}, "posture.arm_22.*did you mean 'arm_2'"),
        ({"gripper": {"finger_9": (0.0, 1.0)}}, "gripper.finger_9.*unknown joint"),
        ({"stuck": {"finger_9": 0.0}}, "stuck.finger_9.*only joints of the gripper"),
        ({"wrench_range": (0.0, 1.0)}, "wrench_range.*greater than 0"),
        ({"offset": (0.05, -0.05)}, "offset.*the least, then the greatest"),
        ({"offsett": 0.0}, "offsett.*did you mean 'offset'"),
        (
            {"gripper": {"arm_7": (0.0, 1.0)}},
            "gripper.arm_7: it leads the tool 'palm', so it is no joint of fingers",
        ),
        ({"gripper": {FINGER: (-0.15, 2.5)}}, f"gripper.{FINGER}: 2.5 is beyond .*-0.3 and 2.4"),
        ({"gripper": {FINGER: (-0.35, 1.3)}}, f"gripper.{FINGER}: -0.35 is beyond .*-0.3 and 2.4"),
        ({"posture": {"arm_2": -2.3}}, "posture.arm_2: -2.3 is beyond .*limits.*-2.2 and 2.2"),
        ({"stuck": {FINGER: 3.0}}, f"stuck.{FINGER}: 3 is beyond .*limits.*-0.3 and 2.4"),
        (
            {"surroundings": {"object": PLAN.scenes["bottle"].surroundings["table"]}},
            "surroundings.object: that is what the grasped object is called",
        ),
    ],
)
def test_a_wrong_field_is_reported_in_a_sentence(fields: dict[str, Any], sentence: str) -> None:
    with pytest.raises((ConfigurationError, RobotError), match=sentence):
        scene(**fields)


def test_a_hand_ends_beyond_where_it_begins() -> None:
    fields: dict[str, Any] = {"tool": "palm", "gripper": {"a": (0.0, 1.0)}}
    ReactiveGraspConfig(**{**fields, "hand": {"box": ((-0.1, -0.1, 0.0), (0.1, 0.1, 0.2))}})
    for axis, box in {
        "x": ((0.1, -0.1, 0.0), (-0.1, 0.1, 0.2)),
        "z": ((-0.1, -0.1, 0.2), (0.1, 0.1, 0.2)),
    }.items():
        with pytest.raises(ConfigurationError, match=f"hand.box: give the least.* of {axis} these"):
            ReactiveGraspConfig(**{**fields, "hand": {"box": box}})


def test_a_urdf_without_a_mass_needs_one() -> None:
    fields = {
        "urdf": str(ROOT / "examples/objects/mug.urdf"),
        "pose": {"parent": "base", "xyz": [0.8, 0.0, 0.301]},
    }
    with pytest.raises(RobotError, match="has no mass.*give the scene's `mass`"):
        scene(object=fields)


def test_shapes_without_a_mass_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="mass.*needs its mass"):
        config("carton", mass=None)


def test_an_object_out_of_reach_is_reported_in_a_sentence() -> None:
    far = {"urdf": "contactfusion_lab.experiments.grasp:bottle.urdf"}
    far_away: dict[str, Any] = {**far, "pose": {"parent": "base", "xyz": [1.6, 0.0, 0.25]}}
    with pytest.raises(RobotError, match="does not reach where the grasp begins.*out of its reach"):
        scene(object=far_away)


def test_a_hand_that_would_begin_in_the_table_is_reported_in_a_sentence() -> None:
    with pytest.raises(RobotError, match="would touch something where the grasp begins"):
        scene(height=0.0)


def test_the_type_of_a_scene_is_known() -> None:
    assert PLAN.pipeline.robot is not None
    with pytest.raises(ConfigurationError, match="scene.object: this field is required"):
        open_scene({"type": "grasp", "tool": "palm", "gripper": {}}, PLAN.pipeline.robot)


@pytest.mark.slow
def test_a_mug_by_its_urdf_is_grasped_by_all_that_is_felt(tmp_path: Path) -> None:
    run_file(SCENES / "grasp_mug.yaml", overrides=["scene.offset=0.02"], out=tmp_path, seed=1)
    truth = json.loads((tmp_path / "summary.json").read_text())["truth"]
    assert truth["ending"] == "lifted" and truth["success"]


def test_the_page_on_grasps_names_every_field_option_and_state() -> None:
    page = (ROOT / "docs" / "grasp.md").read_text()
    code = set(re.findall(r"\w+", " ".join(re.findall(r"`[^`\n]+`", page))))
    assert not set(GraspConfig.model_fields) - code
    assert not unnamed(ReactiveGraspConfig, page)
    assert not {str(mode) for mode in GraspMode} - code
