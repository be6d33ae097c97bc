"""A camera sees what stands before it, as far as it reaches."""

from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import Pose, inverse, points_in, pose_at
from contactfusion.robots.description import CameraConfig
from contactfusion.robots.solids import Solid
from contactfusion.shapes import ShapeConfig
from contactfusion_lab.scenes.camera import RangeCamera
from tests.urdfs import outside_of

HERE = np.eye(4)
AWAY = pose_at((0.3, -0.2, 0.7), (0.4, -0.5, 2.0))
WALL = ShapeConfig(shape="box", size=(20.0, 20.0, 0.2))
BOX = ShapeConfig(shape="box", size=(0.2, 0.1, 0.3))


def camera(**fields: Any) -> RangeCamera:
    given: dict[str, Any] = {"frame": "eye", "width": 41, "height": 31, "fov": 60.0, **fields}
    return RangeCamera(CameraConfig(**given))


def in_front(distance: float, *beside: float) -> Pose:
    x, y = beside or (0.0, 0.0)
    return pose_at((x, y, distance), (0.0, 0.0, 0.0))


def seen(*bodies: tuple[ShapeConfig, Pose], viewpoint: Pose = HERE, **fields: Any) -> FloatArray:
    return camera(**fields).depth(
        viewpoint, [(Solid([shape]), viewpoint @ pose) for shape, pose in bodies]
    )


@pytest.mark.parametrize("viewpoint", [HERE, AWAY])
def test_depth_is_that_along_the_axis_wherever_a_pixel_looks(viewpoint: Pose) -> None:
    depth = seen((WALL, in_front(2.1)), viewpoint=viewpoint)
    assert depth.shape == (31, 41) and np.allclose(depth, 2.0, atol=1e-5)


@pytest.mark.parametrize("viewpoint", [HERE, AWAY])
def test_a_box_fills_the_pixels_that_look_at_it_and_the_others_see_nothing(viewpoint: Pose) -> None:
    depth_camera = camera()
    depth = seen((BOX, in_front(1.15, 0.03, -0.02)), viewpoint=viewpoint)
    focal = 20.5 / np.tan(np.radians(30.0))
    u, v = np.meshgrid(np.arange(41), np.arange(31))
    x, y = (u - 20) / focal, (v - 15) / focal  # where it looks, 1 m ahead
    on = (np.abs(x - 0.03) < 0.1) & (np.abs(y + 0.02) < 0.05)
    assert 20 < on.sum() < 100
    assert np.array_equal(depth > 0.0, on) and np.allclose(depth[on], 1.0, atol=1e-5)
    points = depth_camera.points(depth)
    assert np.allclose(points, np.stack([x[on], y[on], np.ones(on.sum())], axis=1), atol=1e-5)


def test_intrinsics_lead_from_points_to_pixels() -> None:
    depth_camera = camera()
    depth = seen((BOX, in_front(1.0, -0.1, 0.1)))
    rows, columns = np.nonzero(depth)
    pixels = depth_camera.points(depth) @ depth_camera.intrinsics.T
    assert len(rows) and np.allclose(pixels[:, 0] / pixels[:, 2], columns, atol=1e-9)
    assert np.allclose(pixels[:, 1] / pixels[:, 2], rows, atol=1e-9)


def test_the_field_of_view_is_the_width_of_the_picture() -> None:
    depth_camera = camera(width=64, fov=90.0)
    focal = depth_camera.intrinsics[0, 0]
    assert 2.0 * np.arctan(32 / focal) == pytest.approx(np.pi / 2)
    assert depth_camera.intrinsics[1, 1] == focal and depth_camera.intrinsics[0, 2] == 31.5


def test_points_lie_on_what_is_seen() -> None:
    ball = ShapeConfig(shape="sphere", radius=0.3)
    pose = in_front(1.0, 0.1, 0.1)
    depth_camera = camera(width=160, height=120)
    depth = depth_camera.depth(AWAY, [(Solid([ball]), AWAY @ pose)])
    points = depth_camera.points(depth)
    middle = points_in(inverse(pose), points)
    assert len(points) > 500 and np.abs(outside_of(ball, middle)).max() < 1.5e-3
    assert (middle[:, 2] < 0.1).all()  # the near side


def test_what_is_near_hides_what_is_far() -> None:
    depth = seen((WALL, in_front(3.1)), (BOX, in_front(1.15)))
    assert depth[15, 20] == pytest.approx(1.0, abs=1e-5)
    assert depth[0, 0] == pytest.approx(3.0, abs=1e-5)


def test_a_body_of_several_shapes_is_seen_whole() -> None:
    left, right = (ShapeConfig(shape="box", size=(0.2, 0.2, 0.2), xyz=(x, 0, 0)) for x in (-1, 1))
    depth = camera(fov=120.0).depth(HERE, [(Solid([left, right]), in_front(1.1))])
    assert (depth[15, :20] > 0).any() and (depth[15, 21:] > 0).any() and depth[15, 20] == 0.0


@pytest.mark.parametrize(
    ("distance", "found"), [(0.49, 0.0), (0.51, 0.51), (1.99, 1.99), (2.01, 0.0)]
)
def test_what_is_too_near_or_too_far_is_not_seen(distance: float, found: float) -> None:
    depth = seen((WALL, in_front(distance + 0.1)), reach=(0.5, 2.0))
    assert np.allclose(depth, found, atol=1e-5)


def test_where_nothing_stands_nothing_is_seen() -> None:
    for bodies in ([], [(BOX, in_front(-1.0))]):
        depth = seen(*bodies)
        assert not depth.any() and camera().points(depth).shape == (0, 3)


@pytest.mark.parametrize("reach", [(2.0, 1.0), (1.0, 1.0), (-1.0, 1.0)])
def test_a_reach_upside_down_is_refused(reach: tuple[float, float]) -> None:
    with pytest.raises(ConfigurationError, match="reach: give the least distance, then"):
        camera(reach=reach)
