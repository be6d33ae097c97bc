"""A robot by URDF in the pipeline: frames of links, its surface, sensors by name."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import inverse, points_in, vectors_in
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState, TactileImage, Transform, Wrench
from contactfusion.robots.posed import PosedRobot
from tests.hands import SLIDE, joints

ARM = {"urdf": "contactfusion.robots:arm_hand.urdf"}
HAND = ("palm", *(f"finger_{n}_{part}" for n in (1, 2, 3) for part in ("proximal", "distal")))
BENT = np.array([0.2, 0.6, 0.1, 1.4, -0.3, 1.0, 0.2, 0.1, 0.6, 0.2, -0.1, 0.6, 0.2, 0.6, 0.2])
GRAVITY = np.array([0.0, 0.0, -9.81])


def pipeline(**fields: Any) -> Pipeline:
    config = {"integrator": {"frame": "base"}, "cycle": {"every": 0.1}, **fields}
    return Pipeline(PipelineConfig(**config))


def slide(folder: Path, **fields: Any) -> dict[str, Any]:
    (folder / "slide.urdf").write_text(SLIDE)
    return {"urdf": "slide.urdf", **fields}


def bent(stamp: float, pipe: Pipeline) -> PosedRobot:
    """Bend the arm; give it in its pose."""
    model = pipe._robot.model
    assert model is not None
    reading = JointState(stamp=stamp, frame="base", names=model.joint_names, positions=BENT)
    pipe.receive(reading)
    robot = pipe.state(stamp).robot
    assert robot is not None
    return robot


def static(x: float, frame: str = "base", turn: tuple[float, ...] = (0, 0, 0, 1)) -> Transform:
    """The hand stands still at x [m], as /tf_static says."""
    place, turned = np.array([x, 0.0, 0.0]), np.array(turn, float) / np.linalg.norm(turn)
    return Transform(
        stamp=0.0,
        frame=frame,
        child_frame="hand",
        position=place,
        orientation=turned,
        static=True,
    )


DIFFERENTLY = "hand: the URDF and /tf_static place it differently"


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        (static(0.3), ""),
        (static(1.3), f"{DIFFERENTLY}, 1 m and 0 rad apart; the URDF counts"),
        (static(0.3, turn=(0, 0, 1, 1)), f"{DIFFERENTLY}, 0 m and 1.57 rad apart; the URDF counts"),
        (static(1.3, frame="map"), ""),
    ],
)
def test_a_link_that_tf_static_places_elsewhere_than_the_urdf_is_told(
    told: Transform, sentence: str, tmp_path: Path
) -> None:
    pipe = pipeline(folder=tmp_path, robot=slide(tmp_path))
    for reading in (told, joints(0.3)):
        pipe.receive(reading)
    assert (pipe.step(0.0).fusion.contacts, pipe.misplaced) == ((), sentence)


def test_a_joint_in_degrees_is_told() -> None:
    pipe = pipeline(robot=ARM)
    model = pipe._robot.model
    assert model is not None
    for stamp, scale in ((0.0, 1.0), (0.1, np.degrees(1.0)), (0.2, 1.0)):
        names, positions = ("other", *model.joint_names), np.array([900.0, *(scale * BENT)])
        pipe.receive(JointState(stamp=stamp, frame="base", names=names, positions=positions))
        told = pipe.misplaced
        assert ("is it in degrees, or another joint?" in told) == (stamp > 0.0)
    row = int((np.degrees(BENT) > model.limits[:, 1] + 2.0 * np.pi).argmax())
    assert f"{model.joint_names[row]} is at {np.degrees(BENT[row]):.4g} rad" in told


def test_a_patch_on_a_link_moves_with_it(tmp_path: Path) -> None:
    patch = {"grid": {"rows": 1, "columns": 1, "pitch": (0.004, 0.004)}}
    pipe = pipeline(
        folder=tmp_path,
        robot=slide(tmp_path, frames={"tip": {"parent": "hand", "xyz": (0.05, 0.0, 0.0)}}),
        generators={"skin": {"type": "tactile", "patch": patch}},
    )
    for x in (0.0, 0.302):
        pipe.receive(joints(x, stamp=x))
        pipe.receive(TactileImage(stamp=x, frame="tip", values=np.array([100.0])))
        (contact,) = pipe.step(x).fusion.contacts
        assert contact.position[0] == pytest.approx(x + 0.05, abs=0.0025)


def test_sensors_are_found_by_name_in_the_description(tmp_path: Path) -> None:
    grid = {"rows": 1, "columns": 1, "pitch": (0.004, 0.004)}
    robot = slide(
        tmp_path,
        patches={"palm": {"frame": "hand", "grid": grid}},
        wrists={"wrist": {"frame": "hand", "sign": "by_robot"}},
        fingers={"thumb": {"joints": ["slide"], "links": ["hand"]}},
    )
    pipe = pipeline(
        folder=tmp_path,
        robot=robot,
        generators={
            "skin": {"type": "tactile", "patch": "palm"},
            "force": {"type": "force_torque", "wrist": "wrist"},
            "fingers": {"type": "finger_pose", "fingers": ["thumb"]},
        },
    )
    assert set(pipe.integrator.step(0.0).report.sources) == {"skin", "force", "fingers/thumb"}


@pytest.mark.parametrize(
    ("generator", "sentence"),
    [
        ({"type": "tactile", "patch": "pam"}, r"one\.patch: unknown name 'pam': did you mean 'pa"),
        ({"type": "force_torque", "wrist": "x"}, r"one\.wrist: unknown name 'x': there are no w"),
        ({"type": "finger_pose", "fingers": ["x"]}, r"one\.fingers: unknown name 'x': there are"),
    ],
)
def test_a_sensor_that_the_description_lacks_is_told(
    generator: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    grid = {"rows": 1, "columns": 1, "pitch": (0.004, 0.004)}
    robot = slide(tmp_path, patches={"palm": {"frame": "hand", "grid": grid}})
    with pytest.raises(ConfigurationError, match=sentence):
        pipeline(folder=tmp_path, robot=robot, generators={"one": generator})


def test_the_surface_of_a_robot_is_sampled_before_its_first_reading(tmp_path: Path) -> None:
    model = pipeline(folder=tmp_path, robot=slide(tmp_path))._robot.model
    assert model is not None and "parts" in vars(model)


def test_until_its_joints_come_a_robot_has_no_surface_and_says_so(tmp_path: Path) -> None:
    pipe = pipeline(folder=tmp_path, robot=slide(tmp_path))
    assert "no position of joint 'slide' came" in pipe.step(0.0).events[0].message
    pipe.receive(joints(0.0, stamp=0.1))
    assert pipe.step(0.1).events == () and pipe.state(0.1).surface is not None


def test_joints_of_another_robot_are_told_and_the_cycle_goes_on(tmp_path: Path) -> None:
    pipe = pipeline(folder=tmp_path, robot=slide(tmp_path))
    pipe.receive(JointState(stamp=0.0, frame="base", names=("slid",), positions=np.zeros(1)))
    (event,) = pipe.step(0.0).events
    assert "no position of joint 'slide' came: did you mean 'slid'?" in event.message


def test_a_robot_that_no_frame_joins_to_the_space_says_so(tmp_path: Path) -> None:
    pipe = pipeline(folder=tmp_path, robot=slide(tmp_path), integrator={"frame": "world"})
    pipe.receive(joints(0.0))
    assert "joins the robot's frame 'base' to the space" in pipe.step(0.0).events[0].message


def test_a_robot_stands_where_its_frames_say(tmp_path: Path) -> None:
    frames = {"base": {"parent": "world", "xyz": (1.0, 0.0, 0.0)}}
    pipe = pipeline(
        folder=tmp_path, robot=slide(tmp_path), integrator={"frame": "world"}, frames=frames
    )
    pipe.receive(joints(0.2))
    surface = pipe.state(0.0).surface
    assert surface is not None and surface.frame == "world"
    assert surface.points[:, 0].max() == pytest.approx(1.25)


def test_a_surface_and_a_robot_are_one_too_many(tmp_path: Path) -> None:
    surface = {"frame": "base", "shapes": [{"shape": "sphere", "radius": 1.0}]}
    with pytest.raises(ConfigurationError, match="give a surface or a robot, not both"):
        pipeline(folder=tmp_path, robot=slide(tmp_path), surface=surface)


def test_a_robot_may_stand_in_a_file_of_its_own(tmp_path: Path) -> None:
    slide(tmp_path)
    (tmp_path / "robot.yaml").write_text("urdf: slide.urdf\n")
    pipe = pipeline(folder=tmp_path, robot="robot.yaml")
    pipe.receive(joints(0.0))
    assert pipe.state(0.0).robot is not None
    with pytest.raises(ConfigurationError, match="robot: .*no file 'robt.yaml'"):
        pipeline(folder=tmp_path, robot="robt.yaml")


def felt(robot: PosedRobot, place: FloatArray, force: FloatArray, stamp: float) -> Wrench:
    """Make the wrench of a contact, on top of what hangs on the wrist."""
    sensor = robot.poses["wrist_sensor"]
    mass, centre = robot.load_on("wrist_sensor")
    total = force + mass * GRAVITY
    origin = sensor[:3, 3]
    torque = np.cross(place - origin, force) + np.cross(centre - origin, mass * GRAVITY)
    turn = inverse(sensor)
    total, torque = vectors_in(turn, np.stack([total, torque]))
    return Wrench(stamp=stamp, frame="wrist_sensor", force=total, torque=torque)


def wrist(**options: Any) -> Pipeline:
    generator = {"type": "force_torque", "sign": "on_robot", "load": "robot", **options}
    return pipeline(robot=ARM, generators={"wrist": generator})


def test_the_wrist_locates_contacts_on_the_hand() -> None:
    pipe, rng, away = wrist(), np.random.default_rng(0), []
    robot = bent(0.0, pipe)
    hand = robot.surface_of(HAND)
    for number, row in enumerate(rng.choice(len(hand.points), 40, replace=False)):
        place, force = hand.points[row], -6.0 * hand.normals[row]
        stamp = 0.01 * number
        pipe.receive(felt(robot, place, force, stamp))
        space = pipe.step(stamp).fusion.space
        away.append(np.linalg.norm(space.positions - place, axis=1).min())
    assert np.median(away) < 0.004  # half a voxel's diagonal
    assert max(away) < 0.02  # where links meet, the line may leave the surface a little off


def test_the_weight_of_the_hand_is_no_contact() -> None:
    pipe = wrist()
    robot = bent(0.0, pipe)
    pipe.receive(felt(robot, np.zeros(3), np.zeros(3), 0.0))
    step = pipe.step(0.0)
    assert step.fusion.report.sources["wrist"].accepted == 1
    assert not len(step.fusion.space.positions)


def test_what_does_not_hang_on_the_wrist_is_never_its_contact() -> None:
    pipe = wrist(load="configured")
    robot = bent(0.0, pipe)
    arm = robot.surface_of(("link_3",))
    sensor = inverse(robot.poses["wrist_sensor"])
    force = -9.0 * vectors_in(sensor, arm.normals[:1])[0]
    place = points_in(sensor, arm.points[:1])[0]
    pipe.receive(
        Wrench(stamp=0.0, frame="wrist_sensor", force=force, torque=np.cross(place, force))
    )
    positions = pipe.step(0.0).fusion.space.positions
    assert not len(positions) or np.linalg.norm(positions - arm.points[0], axis=1).min() > 0.05


def test_a_load_of_the_robot_and_a_mass_are_one_too_many() -> None:
    with pytest.raises(ConfigurationError, match="give the mass in compensation, or take the load"):
        wrist(compensation={"mass": 1.0})


def test_the_load_of_a_robot_that_is_not_there_is_told() -> None:
    surface = {"frame": "base", "shapes": [{"shape": "sphere", "radius": 0.1}]}
    generator = {"type": "force_torque", "sign": "on_robot", "load": "robot"}
    pipe = pipeline(surface=surface, generators={"wrist": generator})
    pipe.receive(Wrench(stamp=0.0, frame="base", force=np.ones(3), torque=np.zeros(3)))
    assert any("'wrist' needs the robot" in event.message for event in pipe.step(0.0).events)
