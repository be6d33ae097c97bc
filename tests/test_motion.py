"""Where the robot is about to be: joints and bases that move on for a moment."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Grid, IntegratorConfig, Pipeline, PipelineConfig, State
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, FrameError, RobotError
from contactfusion.frames import FrameTree, pose_at
from contactfusion.generators.motion import MotionConfig, MotionGenerator
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import JointState, Twist
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.shapes import BodyConfig
from contactfusion.surface import Surface
from tests.clouds import cloud as cloud_of
from tests.clouds import voxels_of

GRID = Grid("base", 0.005)
AHEAD = 0.1
ARM, TIP = 0.02, 0.01
"""The radii of two balls: one that turns about the base, one that slides out from it [m]."""
LIMIT = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
URDF = f"""
<robot name="pointer">
  <link name="base">
    <collision><geometry><box size="0.04 0.04 0.04"/></geometry></collision>
  </link>
  <link name="arm">
    <collision><origin xyz="0.1 0 0"/><geometry><sphere radius="{ARM}"/></geometry></collision>
  </link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>{LIMIT}
  </joint>
  <link name="tip">
    <collision><origin xyz="0.2 0 0"/><geometry><sphere radius="{TIP}"/></geometry></collision>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="arm"/><child link="tip"/><axis xyz="1 0 0"/>{LIMIT}
  </joint>
  <link name="thread"/>
  <joint name="knot" type="fixed"><parent link="tip"/><child link="thread"/></joint>
</robot>
"""


@pytest.fixture
def model(tmp_path: Path) -> RobotModel:
    (tmp_path / "pointer.urdf").write_text(URDF)
    return RobotModel(RobotConfig(urdf=str(tmp_path / "pointer.urdf")))


def posed(model: RobotModel, turn: float = 0.0, slide: float = 0.0) -> State:
    robot = PosedRobot(model, np.array([turn, slide]), "base", np.eye(4))
    return State(now=0.0, grid=GRID, surface=robot.surface, robot=robot)


def generator(**options: Any) -> MotionGenerator:
    return MotionGenerator("ahead", MotionConfig(**{"ahead": AHEAD, **options}))


def joints(stamp: float = 0.0, speeds: dict[str, float] | None = None, **at: float) -> JointState:
    velocities = None if speeds is None else np.array([speeds[name] for name in at])
    return JointState(
        stamp=stamp,
        frame="base",
        names=tuple(at),
        positions=np.array(list(at.values())),
        velocities=velocities,
    )


def ahead(
    model: RobotModel, speeds: tuple[float, float], turn: float = 0.0, **options: Any
) -> HypothesisCloud:
    """The cloud of one reading with a speed of `turn` and of `slide`."""
    told = {"turn": speeds[0], "slide": speeds[1]}
    reading = joints(speeds=told, turn=turn, slide=0.0)
    (cloud,) = generator(**options).generate(reading, posed(model, turn))
    return cloud


def off_ball(places: FloatArray, radius: float, *centre: float) -> float:
    """How far the place that fits worst lies off a ball [m]."""
    assert len(places)
    return float(np.abs(np.linalg.norm(places - centre, axis=1) - radius).max())


# Joints


def test_a_link_lies_where_its_joint_will_have_turned_it(model: RobotModel) -> None:
    cloud = ahead(model, (2.0, 0.0), turn=0.3, links=("arm",))
    assert off_ball(cloud.positions, ARM, 0.1 * np.cos(0.5), 0.1 * np.sin(0.5), 0.0) < 1e-9


def test_a_link_lies_where_its_joint_will_have_slid_it(model: RobotModel) -> None:
    cloud = ahead(model, (0.0, 0.3), links=("tip",))
    assert off_ball(cloud.positions, TIP, 0.23, 0.0, 0.0) < 1e-9


def test_it_is_support_for_many_contacts_all_as_likely(model: RobotModel) -> None:
    cloud = ahead(model, (1.0, 0.0), likelihood=0.4)
    assert cloud.kind == HypothesisKind.SUPPORT and not cloud.single and cloud.frame == "base"
    assert set(cloud.likelihoods) == {0.4}
    assert set(ahead(model, (1.0, 0.0)).likelihoods) == {0.3}


def test_a_spread_holds_the_noise_and_a_uniform_way(model: RobotModel) -> None:
    slid = ahead(model, (0.0, 0.3), links=("tip",), noise=0.004).spreads
    assert slid == pytest.approx(np.hypot(0.004, 0.03 / np.sqrt(12.0)))
    cloud = ahead(model, (2.0, 0.0), links=("arm",), noise=0.004)
    way = 2.0 * np.hypot(*cloud.positions.T[:2]) * np.sin(0.1)  # the chord of 0.2 rad
    assert cloud.spreads == pytest.approx(np.hypot(0.004, way / np.sqrt(12.0)))


def test_a_robot_at_rest_stays_where_it_is(model: RobotModel) -> None:
    cloud = ahead(model, (0.0, 0.0), links=("arm",))
    assert off_ball(cloud.positions, ARM, 0.1, 0.0, 0.0) < 1e-9
    assert cloud.spreads == pytest.approx(0.003)


def test_one_hypothesis_falls_in_a_voxel(model: RobotModel) -> None:
    cloud = ahead(model, (2.0, 0.3))
    voxels = GRID.voxels(cloud.positions)
    everywhere = posed(model, 0.2, 0.03).posed_robot("test").surface.points
    assert len(np.unique(voxels, axis=0)) == len(cloud)
    assert len(cloud) == len(np.unique(GRID.voxels(everywhere), axis=0)) < len(everywhere)


def test_only_the_links_that_are_named_are_predicted(model: RobotModel) -> None:
    both = ahead(model, (0.0, 0.0), links=("arm", "tip")).positions
    assert both[:, 0].min() == pytest.approx(0.08, abs=0.002)
    assert both[:, 0].max() == pytest.approx(0.21, abs=0.002)
    assert ahead(model, (0.0, 0.0)).positions[:, 0].min() == pytest.approx(-0.02, abs=0.002)


def test_a_link_without_shape_is_predicted_nowhere(model: RobotModel) -> None:
    assert not len(ahead(model, (1.0, 0.0), links=("thread",)))


def test_without_velocities_two_readings_tell_the_speed(model: RobotModel) -> None:
    motion = generator(links=("arm",))
    assert motion.generate(joints(1.0, turn=0.1, slide=0.0), posed(model, 0.1)) == ()
    (cloud,) = motion.generate(joints(1.2, turn=0.3, slide=0.0), posed(model, 0.3))
    assert off_ball(cloud.positions, ARM, 0.1 * np.cos(0.4), 0.1 * np.sin(0.4), 0.0) < 1e-9


def test_live_the_newest_reading_before_a_step_is_predicted_by_the_speed_of_all(
    model: RobotModel,
) -> None:
    clouds = list[HypothesisCloud]()
    pipe = Pipeline(
        PipelineConfig(
            robot=model.config,
            generators={"ahead": {"type": "motion", "ahead": AHEAD, "links": ["arm"]}},
            integrator=IntegratorConfig(frame="base"),
        ),
        tell=clouds.append,
    )
    pipe.conflates = True
    for stamp, turn in (0.0, 0.0), (0.02, 0.04), (0.04, 0.08):
        pipe.receive(joints(stamp, turn=turn, slide=0.0))
    pipe.step(0.05)
    (cloud,) = clouds
    assert cloud.stamp == 0.04
    assert off_ball(cloud.positions, ARM, 0.1 * np.cos(0.28), 0.1 * np.sin(0.28), 0.0) < 1e-9


def test_a_reset_forgets_the_last_reading_and_the_speed(model: RobotModel) -> None:
    motion = generator()
    motion.generate(joints(1.0, turn=0.1, slide=0.0), posed(model))
    motion.generate(joints(1.2, turn=0.3, slide=0.0), posed(model))
    motion.reset()
    assert motion.generate(joints(1.4, turn=0.3, slide=0.0), posed(model)) == ()


def test_a_second_reading_of_one_stamp_changes_no_speed(model: RobotModel) -> None:
    motion = generator(links=("arm",))
    motion.generate(joints(1.0, turn=0.0, slide=0.0), posed(model))
    motion.generate(joints(1.1, turn=0.1, slide=0.0), posed(model, 0.1))
    for stamp, turn in ((1.1, 0.1001), (1.05, 0.2)):  # the same stamp, and an earlier one
        (cloud,) = motion.generate(joints(stamp, turn=turn, slide=0.0), posed(model, 0.1))
        assert off_ball(cloud.positions, ARM, 0.1 * np.cos(0.2), 0.1 * np.sin(0.2), 0.0) < 1e-9


def test_a_joint_without_limits_that_passes_half_a_turn_does_not_leap(tmp_path: Path) -> None:
    text = URDF.replace('name="turn" type="revolute"', 'name="turn" type="continuous"')
    (tmp_path / "pointer.urdf").write_text(text)
    turning = RobotModel(RobotConfig(urdf=str(tmp_path / "pointer.urdf")))
    motion = generator(links=("arm",))
    motion.generate(joints(1.0, turn=3.1, slide=0.0), posed(turning, 3.1))
    (cloud,) = motion.generate(joints(1.2, turn=-3.1, slide=0.0), posed(turning, -3.1))
    ahead_by = -3.1 + 0.5 * (2.0 * np.pi - 6.2)
    assert off_ball(cloud.positions, ARM, 0.1 * np.cos(ahead_by), 0.1 * np.sin(ahead_by), 0) < 1e-9


def test_a_joint_whose_speed_is_not_measured_moves_by_its_positions(model: RobotModel) -> None:
    motion, speeds = generator(links=("arm",)), {"turn": np.nan, "slide": 0.0}
    motion.generate(joints(1.0, speeds, turn=0.1, slide=0.0), posed(model, 0.1))
    (cloud,) = motion.generate(joints(1.2, speeds, turn=0.3, slide=0.0), posed(model, 0.3))
    assert off_ball(cloud.positions, ARM, 0.1 * np.cos(0.4), 0.1 * np.sin(0.4), 0.0) < 1e-9


def test_joints_in_readings_of_their_own_move_together(model: RobotModel) -> None:
    motion = generator(links=("tip",))
    assert motion.generate(joints(1.0, turn=0.0), posed(model)) == ()
    assert motion.generate(joints(1.0, slide=0.0), posed(model)) == ()
    state = posed(model, 0.1, 0.01)
    motion.generate(joints(1.1, turn=0.1), state)
    (cloud,) = motion.generate(joints(1.1, slide=0.01), state)
    reach = 0.2 + 0.02
    assert off_ball(cloud.positions, TIP, reach * np.cos(0.2), reach * np.sin(0.2), 0.0) < 1e-9
    (cloud,) = motion.generate(joints(1.1, {"turn": 0.0}, turn=0.1), state)  # the slide slides on
    assert off_ball(cloud.positions, TIP, reach * np.cos(0.1), reach * np.sin(0.1), 0.0) < 1e-9


def test_the_joints_of_another_robot_say_nothing(model: RobotModel) -> None:
    motion = generator()
    wheel = joints(0.0, {"wheel": 1.0}, wheel=0.0)
    assert motion.generate(wheel, posed(model)) == ()
    assert motion.generate(joints(0.0, {"turn": 1.0}, turn=0.0), posed(model))
    assert motion.generate(wheel, posed(model)) == ()


# A twist


def box_at(*centre: float) -> Surface:
    shape = {"shape": "box", "size": (0.02, 0.04, 0.06), "xyz": centre}
    fields = {"frame": "base", "spacing": 0.004, "shapes": [shape]}
    return BodyConfig.model_validate(fields).sampled(Path())


def twist(linear: tuple[float, ...], angular: tuple[float, ...], frame: str = "base") -> Twist:
    return Twist(stamp=0.0, frame=frame, linear=np.array(linear), angular=np.array(angular))


def test_a_twist_moves_a_rigid_surface() -> None:
    state = State(now=0.0, grid=GRID, surface=box_at(0.0, 0.0, 0.0))
    (cloud,) = generator().generate(twist((0.2, 0.0, -0.1), (0.0, 0.0, 0.0)), state)
    ends = np.stack([cloud.positions.min(axis=0), cloud.positions.max(axis=0)])
    assert ends == pytest.approx(np.array([[0.01, -0.02, -0.04], [0.03, 0.02, 0.02]]), abs=1e-9)
    assert cloud.spreads == pytest.approx(np.hypot(0.003, np.hypot(0.02, 0.01) / np.sqrt(12.0)))


def test_a_twist_turns_about_the_origin_of_its_own_frame_and_along_its_axes(
    model: RobotModel,
) -> None:
    # The wheels' frame stands at x = 0.3 and looks along y; its x is the base's y.
    frames = FrameTree({"wheels": ("base", pose_at((0.3, 0.0, 0.0), (0.0, 0.0, np.pi / 2.0)))})
    robot = PosedRobot(model, np.zeros(2), "base", np.eye(4))
    state = State(now=0.0, grid=GRID, robot=robot, frames=frames)
    reading = twist((0.5, 0.0, 0.0), (0.0, 0.0, 2.0), frame="wheels")
    (cloud,) = generator(links=("arm",)).generate(reading, state)
    centre = (0.3 - 0.2 * np.cos(0.2), 0.05 - 0.2 * np.sin(0.2), 0.0)
    assert off_ball(cloud.positions, ARM, *centre) < 1e-9


# What it cannot do


def test_an_unknown_link_is_one_sentence(model: RobotModel) -> None:
    with pytest.raises(RobotError, match="unknown link 'wrist': the links are: arm, base, "):
        ahead(model, (0.0, 0.0), links=("wrist",))


def test_without_a_robot_there_is_one_sentence() -> None:
    state, drive = State(now=0.0, grid=GRID), twist((0.1, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(ConfigurationError, match="'ahead' needs the robot: configure `robot`"):
        generator().generate(joints(turn=0.0), state)
    with pytest.raises(ConfigurationError, match="'ahead' needs the surface of the robot: conf"):
        generator().generate(drive, state)
    with pytest.raises(ConfigurationError, match="'ahead' needs the robot: configure `robot`"):
        generator(links=("arm",)).generate(
            drive, State(now=0.0, grid=GRID, surface=box_at(0.0, 0.0, 0.0))
        )


def test_a_twist_in_a_frame_that_nothing_joins_is_one_sentence() -> None:
    state = State(now=0.0, grid=GRID, surface=box_at(0.0, 0.0, 0.0))
    with pytest.raises(FrameError, match="unknown frame 'wheels'"):
        generator().generate(twist((0.1, 0.0, 0.0), (0.0, 0.0, 0.0), frame="wheels"), state)


# In a pipeline


def test_it_makes_a_contact_on_the_way_more_likely_but_is_none_by_itself(
    model: RobotModel,
) -> None:
    motion = {"type": "motion", "links": ["arm"], "ahead": AHEAD}
    robot = {"urdf": model.config.urdf}
    law = {"rule": "de_morgan"}
    fields: dict[str, Any] = {"generators": {"ahead": motion}, "robot": robot, "integrator": law}
    pipe = Pipeline(PipelineConfig(**fields))
    pipe.integrator.plug("camera", HypothesisKind.REGULAR)
    pipe.receive(joints(1.0, turn=0.0, slide=0.0))
    pipe.receive(joints(1.1, turn=0.1, slide=0.0))
    alone = pipe.step(1.1).fusion
    assert not alone.contacts and set(alone.space.verdicts) == {"support_only"}
    assert off_ball(alone.space.positions, ARM, 0.1 * np.cos(0.2), 0.1 * np.sin(0.2), 0.0) < 0.005
    pipe.integrator.receive(cloud_of("camera", 1.1, {voxels_of(alone)[0]: 0.8}))
    (contact,) = pipe.step(1.1).fusion.contacts
    assert contact.likelihood == pytest.approx(1.0 - 0.7 * 0.2)
