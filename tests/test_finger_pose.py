"""Fingers that yield: where the contact can be that bent them, and when nothing can be said."""

from typing import Any

import numpy as np
import pytest

from contactfusion import Grid, Pipeline, PipelineConfig, State
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.frames import inverse, points_in, pose_at
from contactfusion.generators.finger_pose import FingerPoseConfig, FingerPoseGenerator
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Note
from contactfusion.readings import JointCommand, JointState
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot

GRID = Grid("base", 0.005)
LIMIT = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
# A palm on a slide along x. On it a finger of two boxes that stands up along z and bends about y,
# to +x; beside it, at y = 0.1, a thumb of one.
URDF = f"""
<robot name="pinch">
  <link name="base"/>
  <link name="palm">
    <collision><origin xyz="0 0 -0.02"/><geometry><box size="0.1 0.1 0.02"/></geometry></collision>
  </link>
  <joint name="arm" type="prismatic">
    <parent link="base"/><child link="palm"/><axis xyz="1 0 0"/>{LIMIT}
  </joint>
  <link name="lower">
    <collision><origin xyz="0 0 0.05"/><geometry><box size="0.02 0.02 0.08"/></geometry></collision>
  </link>
  <joint name="knuckle" type="revolute">
    <parent link="palm"/><child link="lower"/><axis xyz="0 1 0"/>{LIMIT}
  </joint>
  <link name="upper">
    <collision><origin xyz="0 0 0.05"/><geometry><box size="0.02 0.02 0.08"/></geometry></collision>
  </link>
  <joint name="middle" type="revolute">
    <parent link="lower"/><child link="upper"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>{LIMIT}
  </joint>
  <link name="thumb">
    <collision><origin xyz="0 0 0.05"/><geometry><box size="0.02 0.02 0.08"/></geometry></collision>
  </link>
  <joint name="thumb_joint" type="revolute">
    <parent link="palm"/><child link="thumb"/><origin xyz="0 0.1 0"/><axis xyz="0 1 0"/>{LIMIT}
  </joint>
</robot>
"""
NAMES = ("arm", "knuckle", "middle", "thumb_joint")
FINGER = {"joints": ["knuckle", "middle"], "links": ["lower", "upper"]}
THUMB = {"joints": ["thumb_joint"], "links": ["thumb"]}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    path = tmp_path_factory.mktemp("pinch") / "pinch.urdf"
    path.write_text(URDF)
    return RobotModel(RobotConfig(urdf=str(path)))


def generator(**options: Any) -> FingerPoseGenerator:
    config = FingerPoseConfig.model_validate({"fingers": {"finger": FINGER}, **options})
    return FingerPoseGenerator("hand", config)


def at(**joints: float) -> FloatArray:
    """The positions of all joints; those that are not named are at 0."""
    return np.array([joints.get(name, 0.0) for name in NAMES])


def felt(
    hand: FingerPoseGenerator,
    model: RobotModel,
    stamp: float = 0.0,
    base: FloatArray | None = None,
    **joints: float,
) -> dict[str, HypothesisCloud]:
    """What the hand says of joints, by source."""
    positions = at(**joints)
    robot = PosedRobot(model, positions, "base", np.eye(4) if base is None else base)
    reading = JointState(stamp=stamp, frame="base", names=NAMES, positions=positions)
    state = State(now=stamp, grid=GRID, surface=robot.surface, robot=robot)
    return {cloud.source: cloud for cloud in hand.generate(reading, state)}


def bent(model: RobotModel, base: FloatArray | None = None, **joints: float) -> HypothesisCloud:
    """What is said of a finger that stood upright before."""
    hand = generator()
    felt(hand, model, base=base)
    return felt(hand, model, 0.1, base=base, **joints)["hand/finger"]


def command(hand: FingerPoseGenerator, model: RobotModel, stamp: float, **joints: float) -> None:
    order = JointCommand(
        stamp=stamp,
        frame="base",
        names=tuple(joints),
        positions=np.array(list(joints.values())),
    )
    state = State(now=stamp, grid=GRID)
    assert hand.generate(order, state) == ()


def on_link(model: RobotModel, link: str, places: FloatArray, **joints: float) -> FloatArray:
    """The places in a link's own frame."""
    pose = PosedRobot(model, at(**joints), "base", np.eye(4)).poses[link]
    return points_in(inverse(pose), places)


# Whether there is a contact


def test_a_joint_that_leaves_its_reference_by_the_threshold_is_a_contact(
    model: RobotModel,
) -> None:
    hand = generator(threshold=0.05)
    assert not len(felt(hand, model, knuckle=0.3)["hand/finger"])
    for angle in (0.26, 0.3, 0.34):
        assert not len(felt(hand, model, knuckle=angle)["hand/finger"])
    for angle in (0.24, 0.36):
        assert len(felt(hand, model, knuckle=angle)["hand/finger"])


def test_it_is_one_regular_contact_that_is_certain(model: RobotModel) -> None:
    cloud = bent(model, knuckle=0.1)
    assert cloud.kind == HypothesisKind.REGULAR and cloud.single and cloud.frame == "base"
    assert cloud.likelihoods.sum() == pytest.approx(1.0) and np.ptp(cloud.likelihoods) == 0.0
    assert cloud.spreads == pytest.approx(0.003)
    assert not cloud.notes


def test_one_hypothesis_falls_in_a_voxel(model: RobotModel) -> None:
    cloud = bent(model, knuckle=0.1)
    assert len(np.unique(GRID.voxels(cloud.positions), axis=0)) == len(cloud) > 100


def test_every_finger_has_an_output_of_its_own(model: RobotModel) -> None:
    hand = generator(fingers={"finger": FINGER, "thumb": THUMB})
    assert hand.sources == dict.fromkeys(("hand/finger", "hand/thumb"), HypothesisKind.REGULAR)
    felt(hand, model)
    clouds = felt(hand, model, thumb_joint=0.1)
    assert not len(clouds["hand/finger"])
    assert clouds["hand/thumb"].positions[:, 1].min() >= 0.09
    clouds = felt(hand, model, knuckle=0.1, thumb_joint=0.1)
    assert [cloud.likelihoods.sum() for cloud in clouds.values()] == pytest.approx([1.0, 1.0])


# Where it is


def test_the_contact_is_on_the_side_that_gave_way(model: RobotModel) -> None:
    for angle, side in ((0.1, -1.0), (-0.1, 1.0)):
        local = on_link(model, "lower", bent(model, knuckle=angle).positions, knuckle=angle)
        lower = local[(local[:, 2] > 0.0101) & (local[:, 2] < 0.0899)]  # without its ends
        assert len(lower) and lower[:, 0] == pytest.approx(0.01 * side)


def test_the_contact_is_beyond_the_last_joint_that_left(model: RobotModel) -> None:
    both = on_link(model, "lower", bent(model, knuckle=0.1).positions, knuckle=0.1)
    assert both[:, 2].min() < 0.02 and both[:, 2].max() > 0.18
    for knuckle in (0.0, 0.1):
        places = bent(model, knuckle=knuckle, middle=0.1).positions
        upper = on_link(model, "upper", places, knuckle=knuckle, middle=0.1)
        assert len(upper) and upper[:, 2].min() >= 0.01 - 1e-9


def test_the_sides_of_a_hinge_do_not_give_way_however_the_robot_stands(model: RobotModel) -> None:
    for angles in np.random.default_rng(0).uniform(-3.0, 3.0, (20, 3)):
        base = pose_at((0.1, -0.2, 0.3), angles)
        places = points_in(inverse(base), bent(model, base=base, knuckle=0.1).positions)
        assert (np.abs(places[:, 1]) < 0.0099).all()


def test_the_arm_may_move_meanwhile(model: RobotModel) -> None:
    hand = generator()
    felt(hand, model)
    assert not len(felt(hand, model, 0.1, arm=0.5)["hand/finger"])
    there, here = felt(hand, model, 0.2, arm=0.5, knuckle=0.1), felt(hand, model, knuckle=0.1)
    moved = there["hand/finger"].positions - [0.5, 0.0, 0.0]
    assert moved == pytest.approx(here["hand/finger"].positions)


HAND = RobotConfig(urdf="contactfusion.robots:arm_hand.urdf")
STIFFNESS = 2.0
"""Of the joints of fingers [N·m/rad]."""


def lever(robot: PosedRobot, link: str, place: FloatArray) -> FloatArray:
    """The Jacobian of a place on a link, shape (3, n)."""
    jacobian = robot.model.jacobian(link, robot.positions)
    arm = place - robot.poses[link][:3, 3]
    across: FloatArray = jacobian[:3] + np.cross(jacobian[3:].T, arm).T
    return across


def pushed(
    before: PosedRobot, joints: list[str], link: str, row: int, force: float
) -> tuple[PosedRobot, FloatArray]:
    """Push a point of a link inwards; its joints are springs. Give the robot, and the torques."""
    surface = before.surface_of([link])
    push = -force * surface.normals[row]
    springs = np.array([name in joints for name in before.model.joint_names])
    torques: FloatArray = springs * (lever(before, link, surface.points[row]).T @ push)
    return before.at(before.positions + torques / STIFFNESS), torques


def test_a_push_anywhere_on_a_finger_is_found_and_never_on_the_opposite_side() -> None:
    model, rng = RobotModel(HAND), np.random.default_rng(1)
    names = model.joint_names
    fingers = {
        name: {
            "joints": [joint for joint in names if joint.startswith(name)],
            "links": [f"{name}_proximal", f"{name}_distal"],
        }
        for name in ("finger_1", "finger_2", "finger_3")
    }
    found, opposed = dict.fromkeys(fingers, 0), 0
    for _ in range(300):
        name = rng.choice(list(fingers))
        link = rng.choice(fingers[name]["links"])
        before = PosedRobot(model, rng.uniform(-0.2, 0.8, len(names)), "base", np.eye(4))
        then = before.surface_of([link])
        row = int(rng.integers(len(then.points)))
        after, torques = pushed(before, fingers[name]["joints"], link, row, rng.uniform(1.0, 15.0))
        hand, clouds = generator(fingers=fingers), {}
        for robot in (before, after):
            reading = JointState(stamp=0.0, frame="base", names=names, positions=robot.positions)
            state = State(now=0.0, grid=GRID, robot=robot)
            clouds = {cloud.source: cloud for cloud in hand.generate(reading, state)}
        places = clouds.pop(f"hand/{name}").positions
        assert not any(len(cloud) for cloud in clouds.values())
        if np.abs(torques).max() <= 0.02 * STIFFNESS:
            assert not len(places)
            continue
        now = after.surface_of([link])
        truth, inward, gave_way = (
            now.points[row],
            -now.normals[row],
            now.points[row] - then.points[row],
        )
        assert (GRID.voxels(places) == GRID.voxels(truth[None])).all(axis=1).any()
        found[name] += 1
        local = points_in(inverse(after.poses[link]), truth[None])
        on_side = 0.01 < local[0, 2] < 0.04  # fingers are round about their own z
        if on_side and inward @ gave_way > 0.5 * np.linalg.norm(gave_way):  # it did not glance off
            opposite = points_in(after.poses[link], local * [-1.0, -1.0, 1.0])
            assert np.linalg.norm(places - opposite, axis=1).min() > 0.002
            opposed += 1
    assert min(found.values()) > 50 and opposed > 50


# When nothing can be said


def test_after_a_command_nothing_is_said_until_the_finger_has_settled(model: RobotModel) -> None:
    hand = generator(settle=0.5)
    felt(hand, model, 0.0)
    command(hand, model, 1.0, knuckle=0.3)
    assert felt(hand, model, 1.2, knuckle=0.1) == {}
    assert felt(hand, model, 1.49, knuckle=0.3) == {}
    assert not len(felt(hand, model, 1.5, knuckle=0.3)["hand/finger"])  # the new reference
    assert not len(felt(hand, model, 1.6, knuckle=0.31)["hand/finger"])
    assert len(felt(hand, model, 1.7, knuckle=0.2)["hand/finger"])


def test_a_command_for_other_joints_does_not_matter(model: RobotModel) -> None:
    hand = generator(fingers={"finger": FINGER, "thumb": THUMB})
    felt(hand, model, 0.0)
    command(hand, model, 1.0, arm=0.5)
    assert len(felt(hand, model, 1.1, arm=0.2, knuckle=0.1)["hand/finger"])
    command(hand, model, 1.2, arm=0.5, thumb_joint=0.4)
    clouds = felt(hand, model, 1.3, knuckle=0.1, thumb_joint=0.2)
    assert set(clouds) == {"hand/finger"} and len(clouds["hand/finger"])


def test_a_command_that_is_repeated_does_not_matter(model: RobotModel) -> None:
    hand = generator(settle=0.5)
    command(hand, model, 0.0, knuckle=0.3, middle=0.0)
    felt(hand, model, 0.6, knuckle=0.3)
    for step in range(10):
        command(hand, model, 0.7 + 0.1 * step, knuckle=0.3, middle=0.0)
    assert len(felt(hand, model, 1.7, knuckle=0.2)["hand/finger"])
    command(hand, model, 1.8, knuckle=0.3, middle=0.1)
    assert felt(hand, model, 1.9, knuckle=0.3, middle=0.05) == {}


def test_a_reset_takes_the_next_joints_as_the_reference(model: RobotModel) -> None:
    hand = generator()
    felt(hand, model, 0.0)
    assert len(felt(hand, model, 0.1, knuckle=0.1)["hand/finger"])
    hand.reset()
    assert not len(felt(hand, model, 0.2, knuckle=0.1)["hand/finger"])
    assert len(felt(hand, model, 0.3, knuckle=0.0)["hand/finger"])


def test_a_reset_forgets_the_commands(model: RobotModel) -> None:
    hand = generator()
    command(hand, model, 1.0, knuckle=0.1)
    hand.reset()
    assert not len(felt(hand, model, 1.1, knuckle=0.1)["hand/finger"])
    command(hand, model, 1.2, knuckle=0.1)  # the first that it hears of
    assert felt(hand, model, 1.3, knuckle=0.0) == {}


def test_a_reading_that_tells_nothing_of_a_finger_is_no_reference_for_it(
    model: RobotModel,
) -> None:
    # The arm's joints come often; the finger's are those of before the command.
    hand = generator(settle=0.5)
    felt(hand, model, 0.0)
    command(hand, model, 1.0, knuckle=0.3)
    robot = PosedRobot(model, at(), "base", np.eye(4))
    arm = JointState(stamp=1.55, frame="base", names=("arm",), positions=np.zeros(1))
    assert hand.generate(arm, State(now=1.55, grid=GRID, robot=robot)) == []
    assert not len(felt(hand, model, 1.6, knuckle=0.3)["hand/finger"])


def test_where_no_link_of_the_finger_hangs_on_the_joint_it_says_off_the_surface(
    model: RobotModel,
) -> None:
    hand = generator(fingers={"finger": {"joints": ["middle"], "links": ["lower"]}})
    felt(hand, model)
    cloud = felt(hand, model, 0.1, middle=0.1)["hand/finger"]
    assert not len(cloud) and cloud.notes == (Note.OFF_SURFACE,)


@pytest.mark.parametrize(
    ("finger", "sentence"),
    [
        ({"joints": ["knukle"]}, "finger 'finger' has an unknown joint 'knukle': did you mean 'kn"),
        ({"links": ["lower", "uper"]}, "'finger' has an unknown link 'uper': did you mean 'upper'"),
    ],
)
def test_an_unknown_joint_or_link_is_one_sentence(
    model: RobotModel, finger: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(RobotError, match=sentence):
        felt(generator(fingers={"finger": {**FINGER, **finger}}), model)


def test_without_a_robot_there_is_one_sentence() -> None:
    reading = JointState(stamp=0.0, frame="base", names=NAMES, positions=at())
    with pytest.raises(ConfigurationError, match="'hand' needs the robot: configure `robot`"):
        generator().generate(reading, State(now=0.0, grid=GRID))


# In a pipeline


def test_fingers_may_be_named_as_the_robot_describes_them(model: RobotModel) -> None:
    robot = {"urdf": model.config.urdf, "fingers": {"index": FINGER, "thumb": THUMB}}
    hand = {"type": "finger_pose", "fingers": ["index"]}
    fields: dict[str, Any] = {"robot": robot, "integrator": {"voxel_size": 0.01}}
    pipe = Pipeline(PipelineConfig(generators={"hand": hand}, **fields))
    for stamp, knuckle in ((0.0, 0.0), (0.1, 0.1)):
        reading = JointState(
            stamp=stamp, frame="base", names=NAMES, positions=at(knuckle=knuckle, thumb_joint=stamp)
        )
        pipe.receive(reading)
    (contact,) = pipe.step(0.1).fusion.contacts
    assert set(contact.shares) == {"hand/index"}
    assert -0.02 < contact.position[0] < 0.02 and 0.0 < contact.position[2] < 0.2
    assert np.sqrt(contact.covariance[2, 2]) > 0.05  # anywhere along the finger
