"""Contacts that a world of what is believed predicts."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import HypothesisCloud, HypothesisKind
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.generators.simulator import SimulatorConfig, SimulatorGenerator
from contactfusion.readings import ObjectPose
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from tests.hands import GRID, joints, slide, state

BOX = {"shape": "box", "size": (0.1, 0.1, 0.1)}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return slide(tmp_path_factory.mktemp("slide"))


def thing(x: float, **fields: Any) -> dict[str, Any]:
    return {"shapes": [BOX], "pose": {"parent": "base", "xyz": (x, 0.0, 0.0)}, **fields}


def generator(x: float = 0.1, **options: Any) -> SimulatorGenerator:
    given: dict[str, Any] = {"objects": {"box": thing(x)}, **options}
    return SimulatorGenerator("believed", SimulatorConfig(**given))


def predicted(one: SimulatorGenerator, robot: RobotModel, x: float = 0.0) -> HypothesisCloud:
    (cloud,) = one.generate(joints(x), state(robot, x))
    return cloud


def told(x: float, name: str = "box") -> ObjectPose:
    return ObjectPose(
        stamp=0.0,
        frame="base",
        name=name,
        position=np.array([x, 0.0, 0.0]),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
    )


def test_the_face_that_meets_the_object_is_predicted(robot: RobotModel) -> None:
    cloud = predicted(generator(0.1), robot)
    assert cloud.kind == HypothesisKind.SUPPORT and not cloud.single
    assert set(cloud.likelihoods) == {0.5}
    face = cloud.positions[:, 0] == 0.05
    assert face.sum() > 300  # 0.1 m square, a point in each voxel of 5 mm: 400 but for the edge
    assert cloud.positions[:, 0].min() >= 0.045 - 1e-9


def test_beyond_the_tolerance_nothing_is_predicted(robot: RobotModel) -> None:
    assert not len(predicted(generator(0.1061), robot))
    assert len(predicted(generator(0.1039), robot))
    assert len(predicted(generator(0.1061, tolerance=0.01), robot))


def test_the_hand_moves_into_the_object(robot: RobotModel) -> None:
    one = generator(0.3)
    assert not len(predicted(one, robot, 0.19))
    assert len(predicted(one, robot, 0.199))


def test_one_hypothesis_a_voxel(robot: RobotModel) -> None:
    voxels = GRID.voxels(predicted(generator(0.08), robot).positions)
    assert len(np.unique(voxels, axis=0)) == len(voxels) > 0


def test_spreads_hold_the_doubt_about_the_object(robot: RobotModel) -> None:
    sharp: dict[str, Any] = {
        "objects": {"box": thing(0.1, sigma=0.0, sigma_yaw=0.0)},
        "noise": 0.004,
    }
    cloud = predicted(generator(**sharp), robot)
    assert cloud.spreads is not None
    np.testing.assert_allclose(cloud.spreads, 0.004)
    vague: dict[str, Any] = {
        "objects": {"box": thing(0.1, sigma=0.03, sigma_yaw=0.0)},
        "noise": 0.004,
    }
    cloud = predicted(generator(**vague), robot)
    assert cloud.spreads is not None
    told = np.sqrt(0.004**2 + 0.03**2 - 0.005**2)  # of which the tolerance covers 5 mm
    np.testing.assert_allclose(cloud.spreads, told)
    covered = predicted(generator(**vague, tolerance=0.031), robot)
    assert covered.spreads is not None
    np.testing.assert_allclose(covered.spreads, 0.004)


def test_a_doubtful_turn_moves_what_is_far_from_the_axis() -> None:
    config = {**thing(0.0), "sigma": 0.0, "sigma_yaw": 0.1}
    model = ObjectModel(ObjectConfig.model_validate(config))
    points = np.array([[0.0, 0.0, 9.0], [0.3, 0.4, 0.0]])
    np.testing.assert_allclose(model.spreads(np.eye(4), points), [0.0, 0.05 / np.sqrt(3.0)])


def test_an_object_that_is_told_to_be_elsewhere_is_believed_there(robot: RobotModel) -> None:
    one = generator(0.1)
    assert one.generate(told(0.5), state(robot)) == ()
    assert not len(predicted(one, robot))
    one.generate(told(-0.1), state(robot))
    assert predicted(one, robot).positions[:, 0].max() <= -0.045 + 1e-9


def test_a_reset_believes_what_is_configured_again(robot: RobotModel) -> None:
    one = generator(0.1)
    one.generate(told(0.5), state(robot))
    one.reset()
    assert len(predicted(one, robot))


def test_a_believed_pose_a_metre_off_predicts_nothing(robot: RobotModel) -> None:
    assert not len(predicted(generator(1.1), robot))


def test_only_the_links_that_are_named_touch(robot: RobotModel) -> None:
    assert len(predicted(generator(links=("hand",)), robot))
    assert not len(predicted(generator(links=("base",)), robot))
    with pytest.raises(RobotError, match="unknown link 'hnd': did you mean 'hand'"):
        predicted(generator(links=("hnd",)), robot)


@pytest.mark.parametrize("shape", ["cylinder", "sphere"])
def test_round_objects_touch_where_they_are(shape: str, robot: RobotModel) -> None:
    size = {"radius": 0.05} | ({"length": 0.1} if shape == "cylinder" else {})
    objects = {"round": thing(0.1, shapes=[{"shape": shape, **size}])}
    places = predicted(generator(objects=objects), robot).positions
    assert len(places) and abs(places[:, 1]).max() < 0.03


def test_a_mesh_and_a_urdf_are_objects_too(robot: RobotModel, tmp_path: Any) -> None:
    import open3d

    mesh: Any = open3d.geometry.TriangleMesh.create_box(0.1, 0.1, 0.1)
    mesh.translate((-0.05,) * 3)
    library: Any = open3d
    library.io.write_triangle_mesh(str(tmp_path / "box.obj"), mesh)
    urdf = '<robot name="b"><link name="b"><collision><geometry><mesh filename="box.obj"/>'
    urdf += "</geometry></collision></link></robot>"
    (tmp_path / "box.urdf").write_text(urdf)
    expected = len(predicted(generator(), robot))
    for given in ({"mesh": tmp_path / "box.obj"}, {"urdf": str(tmp_path / "box.urdf")}):
        objects = {"box": {"pose": {"parent": "base", "xyz": (0.1, 0.0, 0.0)}, **given}}
        assert abs(len(predicted(generator(objects=objects), robot)) - expected) <= 4


def test_it_travels_without_its_world(robot: RobotModel) -> None:
    one = generator()
    before = predicted(one, robot)
    after = predicted(pickle.loads(pickle.dumps(one)), robot)
    np.testing.assert_array_equal(before.positions, after.positions)


@pytest.mark.parametrize(
    ("objects", "sentence"),
    [
        ({}, "objects"),
        ({"box": {"pose": {"parent": "base"}}}, "give shapes, a mesh or a urdf"),
        ({"box": thing(0.0, mesh="box.obj")}, "give shapes, a mesh or a urdf"),
        ({"box": thing(0.0, shapes=[{"shape": "rectangle", "size": (1, 1)}])}, "has no inside"),
        ({"box": thing(0.0, sigma=-1.0)}, "sigma"),
    ],
)
def test_an_object_that_cannot_be_is_refused(objects: Any, sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        generator(objects=objects)


def test_a_missing_mesh_is_told() -> None:
    objects = {"box": {"mesh": "no.ply", "pose": {"parent": "base"}}}
    with pytest.raises(RobotError, match=r"there is no file 'no\.ply'"):
        generator(objects=objects)


def test_an_unknown_object_is_told(robot: RobotModel) -> None:
    with pytest.raises(RobotError, match="unknown object 'bx': did you mean 'box'"):
        generator().generate(told(0.0, "bx"), state(robot))


def test_without_a_robot_it_says_so() -> None:
    with pytest.raises(ConfigurationError, match="'believed' needs the robot"):
        generator().generate(joints(0.0), state(None))


def test_an_object_whose_shape_is_not_of_its_root_is_refused(tmp_path: Path) -> None:
    box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    path = tmp_path / "box.urdf"
    path.write_text(
        f'<robot name="box"><link name="root"/><link name="box">{box}</link>'
        '<joint name="up" type="fixed"><parent link="root"/><child link="box"/>'
        '<origin xyz="0 0 0.5"/></joint></robot>'
    )
    config = ObjectConfig.model_validate({"urdf": str(path), "pose": {"parent": "base"}})
    with pytest.raises(RobotError, match="of its root link, and 'root' has none"):
        ObjectModel(config)
