"""Where the edges of an object in an image lie, against geometry by hand."""

from dataclasses import replace

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.frames import points_in
from contactfusion.generators.edges import edge_pixels, edge_points, nearest_depth
from contactfusion.generators.proximity import ProximityConfig
from contactfusion.readings import DepthImage
from contactfusion.vision import back_projected, returns
from tests.pictures import POSE, picture

CANNY = (50.0, 150.0)
STRIPS = ProximityConfig()
EMPTY = 0.31


def seen(image: DepthImage) -> FloatArray:
    """Edges in the robot's frame, shape (n, 3)."""
    assert image.mask is not None
    return points_in(POSE, edge_points(returns(image.depth), image.mask, image, CANNY))


def test_pixels_are_projected_back_by_hand() -> None:
    camera = np.array([[100.0, 0.0, 50.0], [0.0, 200.0, 40.0], [0.0, 0.0, 1.0]])
    # O Eq 13: x = 2 (80 - 50)/100, y = 2 (20 - 40)/200
    assert back_projected([20], [80], [2.0], camera).tolist() == [[0.6, -0.2, 2.0]]


@pytest.mark.parametrize("width", [160, 640])
def test_the_edges_of_a_box_give_its_proximity(width: int) -> None:
    lengths = STRIPS.lengths_of_edges(seen(picture(0.35, (-0.2, 0.2), width=width)))
    pixel = 0.75 / (width / 2.0 / np.tan(np.radians(27.5)))
    # from y = -0.2 to 0.2: strips 2 to 9; the edge is the first row of pixels on the box
    assert lengths[[0, 1, 10, 11]].tolist() == pytest.approx([EMPTY] * 4)
    assert (lengths[2:10] >= 0.04 - 1e-9).all() and (lengths[2:10] <= 0.04 + pixel).all()


def test_edges_lie_on_the_silhouette_and_at_its_height() -> None:
    image = picture(0.35, (-0.2, 0.2))
    x, y, z = seen(image).T
    pixel = 0.75 / (80.0 / np.tan(np.radians(27.5)))
    assert z == pytest.approx(np.full(len(z), 0.35))
    from_rim = np.min([x - 0.35, 0.6 - x, y + 0.2, 0.2 - y], axis=0)
    assert (from_rim >= -1e-9).all() and (from_rim < 2.5 * pixel).all()
    for sides, extent in ((x, (0.35, 0.6)), (y, (-0.2, 0.2))):
        assert (sides.min(), sides.max()) == pytest.approx(extent, abs=pixel)


@pytest.mark.parametrize("paint", [(200, 120, 60), (10, 10, 12), (250, 250, 250), (120, 118, 112)])
def test_an_object_of_any_colour_has_edges_all_around(paint: tuple[int, int, int]) -> None:
    image = picture(0.35, (-0.2, 0.2), paint=paint)
    lengths = STRIPS.lengths_of_edges(seen(image))
    assert lengths[2:10] == pytest.approx(np.full(8, 0.0425), abs=0.003)
    without = seen(replace(image, colour=None))
    assert STRIPS.lengths_of_edges(without) == pytest.approx(lengths, abs=1e-9)


def test_the_rim_of_the_image_is_no_edge() -> None:
    mask = np.zeros((20, 30), np.bool_)
    mask[8:, :] = True
    edges = edge_pixels(mask, None, CANNY)
    assert edges[8:10].any(axis=0).all() and not edges[11:].any()


def test_an_edge_whose_own_depth_is_missing_or_the_floors_takes_the_nearest_inside() -> None:
    image = picture(0.35, (-0.2, 0.2))
    assert image.mask is not None
    rim = edge_pixels(image.mask, None, CANNY)
    whole = seen(image)
    for wrong in (0.0, np.nan, 1.55):
        depth = np.where(rim, wrong, image.depth)
        assert seen(replace(image, depth=depth)) == pytest.approx(whole)


def test_a_thin_object_has_its_own_depth_and_one_without_depth_no_edges() -> None:
    mask = np.zeros((9, 9), np.bool_)
    mask[4] = True
    depth = np.where(mask, 2.0, 5.0)
    assert nearest_depth(depth, mask).tolist() == np.full((9, 9), 2.0).tolist()
    assert not nearest_depth(np.where(mask, 0.0, 5.0), mask).any()
    image = picture()
    assert image.mask is not None
    assert len(seen(replace(image, depth=np.where(image.mask, 0.0, 1.55)))) == 0
    assert len(seen(picture(near=5.0))) == 0


def test_a_surface_edge_is_what_a_lidar_sees_of_the_surface() -> None:
    edges = np.array([[0.301, -0.27, 0.0], [0.319, -0.22, 0.0], [0.325, -0.17, 0.0]])
    lengths = STRIPS.lengths_of_surface_edges(edges)
    # (0.301 + 0.32)/2, (0.319 + 0.32)/2 and (0.325 + 0.34)/2, each from 0.31 on
    assert lengths[:4].tolist() == pytest.approx([0.0005, 0.0095, 0.0225, EMPTY])
    assert STRIPS.lengths_of_edges(edges)[:4].tolist() == pytest.approx(
        [0.009, 0.009, 0.015, EMPTY]
    )
    steps = np.linspace(0.301, 0.36, 400)
    surface = np.stack([steps, np.full(400, -0.27), np.zeros(400)], axis=1)
    assert STRIPS.lengths_of_cloud(surface)[0] == pytest.approx(lengths[0], abs=1e-4)


def test_in_the_last_cell_a_surface_ends_with_the_region() -> None:
    edges = np.array([[0.6199, 0.0, 0.0]])
    assert STRIPS.lengths_of_surface_edges(edges)[6] == pytest.approx(0.30995)
    nothing = np.empty((0, 3))
    assert STRIPS.lengths_of_surface_edges(nothing) == pytest.approx(np.full(12, EMPTY))
