"""What a camera sees of a push, against geometry by hand."""

import itertools
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.frames import PlanarPose, Pose, inverse, points_in
from contactfusion.generators.proximity import ProximityConfig
from contactfusion.readings import DepthImage, PointCloud
from contactfusion.robots.description import CameraConfig
from contactfusion.robots.model import shared_robot
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.noise import CameraNoise, MisplacedConfig
from contactfusion_lab.scenes.push.objects import triangles_of
from contactfusion_lab.scenes.push.scene import PushScene
from contactfusion_lab.scenes.push.sensors import (
    Picture,
    PushCamera,
    beside_steps,
    misplacement,
    rng_of,
)
from contactfusion_lab.scenes.push.view import PushView
from contactfusion_lab.scenes.sensor_errors import RangeErrors, RangeNoise
from lab.tests.test_push_world import base

HERE: PlanarPose = (-0.3, 0.0, 0.0)
"""The base whose front stands at x = 0."""
NO_ERRORS = RangeErrors(RangeNoise(), np.random.default_rng(0))
TOP, CHASSIS, FLOOR = 1.1 - 0.35, 1.1 + 0.05, 1.1 + 0.45
"""How far below the camera lie the top of a box 0.8 m high, the base, and the floor [m]."""
QUIET = CameraNoise(disparity=0.0, holes=0.0, edges=0.0, colour=0.0)


def seat() -> Pose:
    model = shared_robot(base())
    links = model.poses_at(np.zeros(len(model.joint_names)))
    pose: Pose = links[model.link_of("camera")] @ model.pose_on_link("camera")
    return pose


def camera(noise: CameraNoise = QUIET, name: str = "camera", **fields: Any) -> PushCamera:
    pushed = PushConfig(target=(1.0, 0.0)).object
    config = CameraConfig(**{**base().cameras[name].model_dump(), **fields})
    corners = np.concatenate([vertices for vertices, _ in triangles_of(pushed)])
    paint = np.array([200.0, 100.0, 50.0])
    return PushCamera(config, seat(), PushView(pushed, base()), corners, noise, NO_ERRORS, paint)


def taken(mounted: PushCamera, pose: PlanarPose = (0.2, 0.0, 0.0), seed: int = 0) -> Picture:
    return mounted.picture(HERE, pose, np.random.default_rng(seed))


def images(seed: int = 0, cycles: int = 1, **fields: Any) -> list[list[DepthImage | PointCloud]]:
    scene = PushScene(PushConfig(**{"target": (1.0, 0.0), **fields}), base(), seed)
    seen = []
    for _ in range(cycles):
        readings = scene.readings()
        seen.append(
            [reading for reading in readings if isinstance(reading, DepthImage | PointCloud)]
        )
        scene.drive(0.1, 0.0, 0.0)
    return seen


def image(seed: int = 0, **fields: Any) -> DepthImage:
    ((found,),) = images(seed, **{"sees": ("camera",), **fields})
    assert isinstance(found, DepthImage)
    return found


@pytest.mark.parametrize("name", ["camera", "camera_large"])
def test_the_whole_region_before_the_face_is_in_view(name: str) -> None:
    region = ProximityConfig().region
    corners = np.array(list(itertools.product(region.x, region.y, region.z)))
    seen = camera(name=name)
    rays = points_in(inverse(seat()), corners) @ seen.intrinsics.T
    u, v = (rays[:, :2] / rays[:, 2:]).T
    config = base().cameras[name]
    assert 0.0 <= u.min() and u.max() <= config.width - 1
    assert 0.0 <= v.min() and v.max() <= config.height - 1


def test_the_depths_are_those_of_box_base_and_floor() -> None:
    seen = taken(camera())
    # the box reaches from x = 0 to 0.4 m, that is 0.3 to 0.7 m before the base's origin
    assert seen.depth[40, 80] == pytest.approx(TOP)
    assert seen.depth[100, 80] == pytest.approx(CHASSIS)
    assert seen.depth[40, 5] == pytest.approx(FLOOR)
    assert seen.mask[40, 80] and not seen.mask[100, 80] and not seen.mask[40, 5]
    middle, focal = (120 - 1) / 2.0, 80.0 / np.tan(np.radians(27.5))
    face = middle + focal * (0.40 - 0.30) / TOP
    assert np.flatnonzero(seen.mask[:, 80]).max() == int(face)
    half = 0.2 * focal / TOP
    assert np.count_nonzero(seen.mask[40]) == pytest.approx(2.0 * half, abs=1.0)


def test_box_base_and_floor_have_their_own_colours() -> None:
    colours = taken(camera()).colour
    box, chassis, floor = (tuple(colours[pixel]) for pixel in ((40, 80), (100, 80), (40, 5)))
    assert len({box, chassis, floor}) == 3
    assert box[0] > 2 * box[2]


def test_depth_is_off_by_the_square_of_the_distance() -> None:
    noise = CameraNoise(holes=0.0, edges=0.0)
    seen, truth = taken(camera(noise, "camera_large")), taken(camera(name="camera_large"))
    for depth in (TOP, CHASSIS, FLOOR):
        there = np.abs(truth.depth - depth) < 1e-9
        off = seen.depth[there] - depth
        # σ = z² 0.08 px / (615 px 0.05 m), and whole millimetres
        assert off.std() == pytest.approx(depth**2 * 0.08 / (615 * 0.05), rel=0.05)
        assert abs(off.mean()) < 5e-4
    assert seen.depth * 1000.0 == pytest.approx(np.rint(seen.depth * 1000.0))


def test_holes_are_everywhere_and_most_of_all_at_steps() -> None:
    seen, truth = taken(camera(CameraNoise(), "camera_large")), taken(camera(name="camera_large"))
    steps, holes = beside_steps(truth.depth), seen.depth == 0.0
    assert np.mean(holes[~steps]) == pytest.approx(0.01, abs=0.002)
    assert np.mean(holes[steps]) == pytest.approx(0.5, abs=0.05)
    assert 500 < np.count_nonzero(steps) < 10_000


def test_a_step_has_a_pixel_on_either_side() -> None:
    depth = np.ones((3, 4))
    depth[:, 2:] = 1.2
    assert beside_steps(depth).tolist() == [[False, True, True, False]] * 3
    depth[:, 2:] = np.inf
    assert beside_steps(depth).tolist() == [[False, True, True, False]] * 3


def test_beyond_its_reach_it_measures_nothing() -> None:
    seen = taken(camera(reach=(0.8, 1.2)))
    assert seen.depth[40, 80] == 0.0 and seen.depth[40, 5] == 0.0
    assert seen.depth[100, 80] == pytest.approx(CHASSIS)
    assert seen.mask[40, 80]


@pytest.mark.parametrize(
    "pose", [(0.2, 0.0, 0.3), (0.1, 0.45, 0.0), (0.7, 0.0, 0.5), (-2.0, 0.0, 0.0), (5.0, 3.0, 1.0)]
)
def test_casting_only_where_the_object_can_be_misses_nothing(
    pose: PlanarPose, monkeypatch: pytest.MonkeyPatch
) -> None:
    mounted = camera()
    seen = taken(mounted, pose)
    monkeypatch.setattr(PushCamera, "_window", lambda *_: (slice(None), slice(None)))
    whole = taken(mounted, pose)
    assert np.array_equal(seen.mask, whole.mask) and np.array_equal(seen.depth, whole.depth)


def bits(reading: DepthImage) -> bytes:
    assert reading.colour is not None and reading.mask is not None
    return reading.depth.tobytes() + reading.colour.tobytes() + reading.mask.tobytes()


def test_the_same_seed_gives_the_same_bytes() -> None:
    assert bits(image(seed=3)) == bits(image(seed=3))
    assert bits(image(seed=3)) != bits(image(seed=4))


def test_a_camera_sees_the_same_whatever_else_is_switched_on() -> None:
    ((_, found),) = images(3, sees=("lidar", "camera"))
    assert isinstance(found, DepthImage)
    assert bits(found) == bits(image(seed=3))
    assert found.sensor == "camera" and found.frame == "camera"


@pytest.mark.parametrize(("rate", "count"), [(30.0, [1, 1, 1, 1]), (5.0, [1, 0, 1, 0])])
def test_there_is_at_most_one_image_a_cycle(rate: float, count: list[int]) -> None:
    slow = base().cameras["camera"].model_copy(update={"rate": rate})
    robot = base().model_copy(update={"cameras": {"camera": slow}})
    scene = PushScene(PushConfig(target=(1.0, 0.0), sees=("camera",)), robot)
    seen = []
    for _ in count:
        seen.append(sum(isinstance(reading, DepthImage) for reading in scene.readings()))
        scene.drive(0.0, 0.0, 0.0)
    assert seen == count


def test_a_misplaced_sensor_is_off_by_as_much_as_it_says() -> None:
    rng = np.random.default_rng(0)
    off = misplacement(MisplacedConfig(mm=30.0, degrees=2.0), rng)
    assert np.linalg.norm(off[:3, 3]) == pytest.approx(0.03)
    assert np.degrees(np.arccos((np.trace(off[:3, :3]) - 1.0) / 2.0)) == pytest.approx(2.0)
    assert misplacement(MisplacedConfig(), rng) == pytest.approx(np.eye(4))


def test_a_misplaced_camera_sees_the_same_scene_from_elsewhere() -> None:
    quiet: dict[str, Any] = {"camera_noise": QUIET.model_dump(), "gap": 0.0}
    straight, same = image(**quiet), image(**quiet, misplaced={"camera": {}})
    assert bits(straight) == bits(same)
    off = misplacement(MisplacedConfig(mm=20.0), rng_of(0, "camera misplaced"))
    moved = image(**quiet, misplaced={"camera": {"mm": 20.0}})
    floor = moved.depth[40, 5]
    # the camera looks down: what it is nearer to the floor, it measures less
    assert floor == pytest.approx(FLOOR - off[2, 3], abs=1e-3)
    assert moved.frame == straight.frame


def test_a_misplaced_lidar_sees_the_same_scene_from_elsewhere() -> None:
    calm = {"range": 0.0, "dropout": 0.0, "jumps": 0.0}
    fields: dict[str, Any] = {"sees": ("lidar",), "lidar_noise": calm}
    ((straight,),) = images(**fields)
    ((moved,),) = images(**fields, misplaced={"lidar": {"mm": 40.0}})
    assert isinstance(straight, PointCloud) and isinstance(moved, PointCloud)
    off = misplacement(MisplacedConfig(mm=40.0), rng_of(0, "lidar misplaced"))
    # the LiDAR's x points down: the farthest returns are those of the floor
    assert moved.points[:, 0].max() == pytest.approx(
        straight.points[:, 0].max() - off[0, 3], abs=1e-4
    )


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"sees": ("camara",)}, "sees: the robot has no 'camara'; did you mean 'camera'?"),
        (
            {"sees": ("camera",), "misplaced": {"lidar": {"mm": 3}}},
            "misplaced.lidar: 'lidar' is not switched on; the LiDARs and cameras",
        ),
    ],
)
def test_a_wrong_name_is_reported(fields: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        images(**fields)
    assert str(caught.value).startswith(sentence)


def test_one_name_for_a_lidar_and_a_camera_is_reported() -> None:
    robot = base().model_copy(update={"cameras": {"lidar": base().cameras["camera"]}})
    with pytest.raises(ConfigurationError, match="the robot has a LiDAR and a camera 'lidar'"):
        PushScene(PushConfig(target=(1.0, 0.0), sees=("lidar",)), robot)
