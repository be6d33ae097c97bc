"""What an object touches first when it slides to the hand."""

import pickle
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactfusion import HypothesisCloud, HypothesisKind
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.generators.first_touch import (
    NODES,
    DistanceGrid,
    FirstTouchConfig,
    FirstTouchGenerator,
    Tufts,
    first_touches,
    shared_grid,
)
from contactfusion.readings import ObjectPose
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from tests.hands import joints, slide, state

SPHERE = {"shape": "sphere", "radius": 0.05}
SPREAD = 0.005
"""Of noise 3 mm and points 4 mm apart."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return slide(tmp_path_factory.mktemp("slide"))


def thing(x: float, y: float = 0.0, **fields: Any) -> dict[str, Any]:
    """A ball whose believed place is certain, unless told."""
    pose = {"parent": "base", "xyz": (x, y, 0.0)}
    return {"shapes": [SPHERE], "pose": pose, "sigma": 0.0, "sigma_yaw": 0.0, **fields}


def generator(*things: dict[str, Any], **options: Any) -> FirstTouchGenerator:
    objects = {f"thing_{number}": one for number, one in enumerate(things or (thing(0.1),))}
    return FirstTouchGenerator("first", FirstTouchConfig(**{"objects": objects, **options}))


def touched(one: FirstTouchGenerator, robot: RobotModel, x: float = 0.0) -> HypothesisCloud:
    (cloud,) = one.generate(joints(x), state(robot, x))
    return cloud


def told(x: float, name: str = "thing_0") -> ObjectPose:
    return ObjectPose(
        stamp=0.0,
        frame="base",
        name=name,
        position=np.array([x, 0.0, 0.0]),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
    )


class TestTheCloud:
    def test_a_certain_ball_touches_the_face_where_it_is_nearest(self, robot: RobotModel) -> None:
        cloud = touched(generator(), robot)
        np.testing.assert_allclose(cloud.positions, [[0.05, 0.0, 0.0]], atol=1e-9)
        np.testing.assert_allclose(cloud.likelihoods, [1.0])
        assert cloud.kind == HypothesisKind.SUPPORT and cloud.single and cloud.frame == "base"

    def test_a_ball_that_may_be_elsewhere_touches_elsewhere(self, robot: RobotModel) -> None:
        vague = generator(thing(0.1, sigma=0.01), particles=2000)
        cloud = touched(vague, robot)
        across = cloud.positions[:, 1:]
        np.testing.assert_allclose(cloud.positions[:, 0], 0.05)
        mean = cloud.likelihoods @ across
        deviations = np.sqrt(cloud.likelihoods @ (across - mean) ** 2)
        np.testing.assert_allclose(mean, 0.0, atol=1e-3)
        np.testing.assert_allclose(deviations, 0.01, rtol=0.07)

    def test_a_bar_that_may_be_turned_touches_an_edge(self, robot: RobotModel) -> None:
        bar = thing(0.1, shapes=[{"shape": "box", "size": (0.1, 0.4, 0.1)}], sigma_yaw=0.1)
        cloud = touched(generator(bar, particles=400), robot)
        # of two bodies that meet along an edge, the outermost sample is 2 mm inside
        np.testing.assert_allclose(abs(cloud.positions[:, 1]), 0.05, atol=2.1e-3)
        left = cloud.likelihoods[cloud.positions[:, 1] > 0].sum()
        assert 0.4 < left < 0.6

    def test_the_ball_comes_from_where_it_is(self, robot: RobotModel) -> None:
        behind = touched(generator(thing(-0.1)), robot)
        np.testing.assert_allclose(behind.positions, [[-0.05, 0.0, 0.0]], atol=1e-9)
        beside = touched(generator(thing(0.0, 0.11)), robot)
        np.testing.assert_allclose(beside.positions, [[0.0, 0.05, 0.0]], atol=1e-9)

    def test_a_ball_inside_the_hand_is_moved_out_until_it_touches(self, robot: RobotModel) -> None:
        cloud = touched(generator(thing(0.06)), robot)
        np.testing.assert_allclose(cloud.positions, [[0.05, 0.0, 0.0]], atol=1e-9)

    def test_without_room_beside_the_hand_nothing_is_touched(self, robot: RobotModel) -> None:
        room = thing(0.2, shapes=[{"shape": "box", "size": (1.0, 1.0, 1.0)}])
        cloud = touched(generator(room), robot)
        assert not len(cloud) and cloud.single

    def test_beyond_four_standard_deviations_nothing_is_touched(self, robot: RobotModel) -> None:
        reach = 4.0 * np.hypot(0.02, SPREAD)
        assert len(touched(generator(thing(0.1 + reach - 0.001, sigma=0.02)), robot))
        assert not len(touched(generator(thing(0.1 + reach + 0.001, sigma=0.02)), robot))
        assert not len(touched(generator(thing(5.0, sigma=0.02)), robot))

    def test_of_two_the_likelier_place_weighs_more(self, robot: RobotModel) -> None:
        # the ball on the left is 1 cm off the hand, the one on the right touches as believed
        cloud = touched(generator(thing(0.1, sigma=0.02), thing(-0.11, sigma=0.02)), robot)
        right = cloud.likelihoods[cloud.positions[:, 0] > 0].sum()
        left = cloud.likelihoods[cloud.positions[:, 0] < 0].sum()
        expected = np.exp(-0.5 * 0.01**2 / (0.02**2 + SPREAD**2))
        np.testing.assert_allclose(left / right, expected, rtol=0.02)

    def test_of_two_at_their_places_the_more_certain_weighs_more(self, robot: RobotModel) -> None:
        cloud = touched(generator(thing(0.1, sigma=0.01), thing(-0.1, sigma=0.02)), robot)
        right = cloud.likelihoods[cloud.positions[:, 0] > 0].sum()
        odds = np.hypot(0.02, SPREAD) / np.hypot(0.01, SPREAD)
        np.testing.assert_allclose(right / (1.0 - right), odds, rtol=0.02)

    def test_draws_that_touch_one_point_are_one_hypothesis(self, robot: RobotModel) -> None:
        cloud = touched(generator(thing(0.1, sigma=0.005), likelihood=0.6), robot)
        assert 1 < len(cloud) < 60
        assert len(np.unique(cloud.positions, axis=0)) == len(cloud)
        np.testing.assert_allclose(cloud.likelihoods.sum(), 0.6)

    def test_spreads_hold_the_noise_and_the_distance_of_samples(self, robot: RobotModel) -> None:
        for noise, spread in ((0.003, SPREAD), (0.0, 0.004)):
            cloud = touched(generator(noise=noise), robot)
            assert cloud.spreads is not None
            np.testing.assert_allclose(cloud.spreads, spread)

    def test_the_hand_moves_to_the_ball(self, robot: RobotModel) -> None:
        one = generator(thing(0.4, sigma=0.02))
        assert not len(touched(one, robot, 0.2))
        np.testing.assert_allclose(touched(one, robot, 0.25).positions[:, 0], 0.3)

    def test_a_shape_off_the_origin_of_a_turned_object(self, robot: RobotModel) -> None:
        shapes = [{**SPHERE, "xyz": (0.05, 0.02, 0.0)}]
        pose = {"parent": "base", "xyz": (0.15, 0.02, 0.0), "rpy": (0.0, 0.0, np.pi)}
        cloud = touched(generator(thing(0.0, shapes=shapes, pose=pose)), robot)
        np.testing.assert_allclose(cloud.positions, [[0.05, 0.0, 0.0]], atol=1e-9)

    def test_an_object_in_the_midst_of_the_hand_comes_from_nowhere(self, robot: RobotModel) -> None:
        pose = {"parent": "hand", "xyz": (0.0, 0.0, 0.0)}
        middle = robot.parts["hand"].points.mean(axis=0)
        cloud = touched(generator(thing(0.0, pose={**pose, "xyz": tuple(middle)})), robot)
        assert not len(cloud)


class TestWhatIsBelieved:
    def test_an_object_that_is_told_to_be_elsewhere_is_believed_there(
        self, robot: RobotModel
    ) -> None:
        one = generator()
        assert one.generate(told(-0.1), state(robot)) == ()
        np.testing.assert_allclose(touched(one, robot).positions[:, 0], -0.05)
        one.reset()
        np.testing.assert_allclose(touched(one, robot).positions[:, 0], 0.05)

    def test_an_unknown_object_is_told(self, robot: RobotModel) -> None:
        with pytest.raises(RobotError, match="unknown object 'thing_': did you mean 'thing_0'"):
            generator().generate(told(0.0, "thing_"), state(robot))

    def test_only_the_links_that_are_named_touch(self, robot: RobotModel) -> None:
        assert len(touched(generator(links=("hand",)), robot))
        assert not len(touched(generator(links=("base",)), robot))  # which has no surface
        with pytest.raises(RobotError, match="unknown link 'hnd': did you mean 'hand'"):
            touched(generator(links=("hnd",)), robot)

    def test_without_a_robot_it_says_so(self) -> None:
        with pytest.raises(ConfigurationError, match="'first' needs the robot"):
            generator().generate(joints(0.0), state(None))

    @pytest.mark.parametrize(
        ("options", "sentence"),
        [
            ({"objects": {}}, "objects"),
            ({"objects": {"a": {"pose": {"parent": "base"}}}}, "give shapes, a mesh or a urdf"),
            ({"particles": 0}, "particles"),
            ({"likelihood": 1.1}, "likelihood"),
            ({"seed": -1}, "seed"),
            ({"sigma": 0.02}, "sigma"),
        ],
    )
    def test_options_that_cannot_be_are_refused(self, options: Any, sentence: str) -> None:
        with pytest.raises(ConfigurationError, match=sentence):
            generator(**options)

    def test_a_missing_mesh_is_told(self) -> None:
        with pytest.raises(RobotError, match=r"there is no file 'no\.ply'"):
            generator(objects={"thing": {"mesh": "no.ply", "pose": {"parent": "base"}}})


class TestChance:
    def test_equal_input_gives_equal_output(self, robot: RobotModel) -> None:
        one, other = (generator(thing(0.1, sigma=0.02)) for _ in range(2))
        first, again, another = touched(one, robot), touched(one, robot), touched(other, robot)
        for cloud in (again, another):
            assert first.positions.tobytes() == cloud.positions.tobytes()
            assert first.likelihoods.tobytes() == cloud.likelihoods.tobytes()

    def test_another_seed_draws_other_places(self, robot: RobotModel) -> None:
        one, other = (generator(thing(0.1, sigma=0.02), seed=seed) for seed in (0, 1))
        assert touched(one, robot).positions.tobytes() != touched(other, robot).positions.tobytes()

    def test_it_travels(self, robot: RobotModel) -> None:
        one = generator(thing(0.1, sigma=0.02))
        before = touched(one, robot)
        after = touched(pickle.loads(pickle.dumps(one)), robot)
        np.testing.assert_array_equal(before.positions, after.positions)


def grid(*shapes: dict[str, Any]) -> DistanceGrid:
    config = {"shapes": shapes, "pose": {"parent": "base"}}
    return DistanceGrid.of(ObjectModel(ObjectConfig.model_validate(config)))


class TestTheDistances:
    BOX = {"shape": "box", "size": (0.08, 0.14, 0.2)}

    def test_of_a_box(self) -> None:
        places = np.array(
            [
                [0.05, 0.0, 0.0],  # beside a face
                [0.03, 0.0, 0.0],  # inside, near that face
                [0.043, 0.074, 0.1],  # beside an edge
                [0.043, 0.074, 0.112],  # beside a corner
            ]
        )
        expected = [0.01, -0.01, 0.005, 0.013]
        np.testing.assert_allclose(grid(self.BOX).distances(places), expected, atol=1e-3)

    def test_of_shapes_that_overlap(self) -> None:
        balls = grid(SPHERE, {**SPHERE, "xyz": (0.06, 0.0, 0.0)})
        places = np.array([[0.01, 0.0, 0.0], [0.12, 0.0, 0.0], [-0.06, 0.0, 0.0]])
        np.testing.assert_allclose(balls.distances(places), [-0.04, 0.01, 0.01], atol=1e-3)

    def test_beyond_the_grid_the_nearest_place_of_the_box_counts(self) -> None:
        places = np.array([[0.5, 0.0, 0.0], [0.34, 0.47, 0.0]])
        np.testing.assert_allclose(grid(SPHERE).distances(places), [0.45, np.hypot(0.29, 0.42)])

    def test_equal_objects_share_their_grid(self) -> None:
        one, other = (ObjectConfig.model_validate(thing(0.1)) for _ in range(2))
        assert shared_grid(one) is shared_grid(other)
        small = thing(0.1, shapes=[{**SPHERE, "radius": 0.03}])
        assert shared_grid(ObjectConfig.model_validate(small)).radius < shared_grid(one).radius

    def test_a_large_object_has_a_coarser_grid(self) -> None:
        wall = grid({"shape": "box", "size": (3.0, 3.0, 0.2)})
        assert wall.cell > 0.01 and wall.nodes.size < 1.2 * NODES
        near = wall.distances(np.array([[0.3, 0.4, 0.12], [0.3, 0.4, 0.9]]))
        np.testing.assert_allclose(near, [0.02, 0.8], atol=1e-3)


class TestSliding:
    def test_the_point_that_stops_a_ball_is_that_of_the_equation(self) -> None:
        rng = np.random.default_rng(1)
        points = rng.uniform(-0.05, 0.05, (3000, 3))
        places = np.array([0.0, 0.0, 0.05]) + 0.02 * rng.standard_normal((50, 3))
        way = np.array([0.48, 0.6, 0.64])
        turns = Rotation.random(50, rng=rng).as_matrix()  # which make no difference to a ball
        hits, shifts = first_touches(grid(SPHERE), Tufts.of(points), places, turns, way, 0.3, -0.3)
        offsets = points[None] - places[:, None]
        along = offsets @ way
        inside = 0.05**2 - np.square(offsets).sum(axis=2) + along**2
        leaves = np.where(inside > 0.0, along + np.sqrt(np.maximum(inside, 0.0)), -np.inf)
        assert (hits >= 0).all()
        np.testing.assert_allclose(shifts, leaves.max(axis=1), atol=1e-3)

    @pytest.mark.parametrize("along", [0.2, 0.0, -0.2])
    def test_all_that_lies_on_the_way_is_touched(self, along: float) -> None:
        tufts = Tufts.of(np.array([[along, 0.03, 0.0]]))
        way, turns = np.array([1.0, 0.0, 0.0]), np.eye(3)[None]
        hits, shifts = first_touches(grid(SPHERE), tufts, np.zeros((1, 3)), turns, way, 0.3, -0.3)
        assert hits.tolist() == [0]
        np.testing.assert_allclose(shifts, along + 0.04, atol=1e-3)

    def test_what_lies_beside_the_way_is_not_touched(self) -> None:
        tufts = Tufts.of(np.array([[0.0, 0.051, 0.0], [0.0, -0.3, 0.0]]))
        way = np.array([1.0, 0.0, 0.0])
        turns = np.eye(3)[None]
        hits, shifts = first_touches(grid(SPHERE), tufts, np.zeros((1, 3)), turns, way, 0.3, -0.3)
        assert hits.tolist() == [-1] and np.isnan(shifts).all()

    def test_tufts_hold_all_points_within_their_balls(self) -> None:
        points = np.random.default_rng(0).uniform(-0.1, 0.1, (500, 3))
        tufts = Tufts.of(points)
        assert set(map(tuple, tufts.points)) == set(map(tuple, points))
        for row, (begin, end) in enumerate(zip(tufts.ends[:-1], tufts.ends[1:], strict=True)):
            away = np.linalg.norm(tufts.points[begin:end] - tufts.centres[row], axis=1)
            assert 0 < len(away) and away.max() <= tufts.radii[row] + 1e-12
