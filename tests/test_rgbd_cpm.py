"""Contacts that a depth camera sees, by networks whose weights the tests write; edges by hand."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline
from contactfusion.arrays import FloatArray
from contactfusion.errors import (
    ConfigurationError,
    DependencyError,
    InvalidReadingError,
    PluginError,
)
from contactfusion.frames import points_in
from contactfusion.generators.perceived import NOTHING_NEAR
from contactfusion.generators.proximity import BoxConfig, ProximityConfig
from contactfusion.generators.rgbd_cpm import (
    RgbdCpmConfig,
    RgbdCpmGenerator,
    edge_pixels,
    edge_points,
    nearest_depth,
)
from contactfusion.hypotheses import HypothesisCloud, Note
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import DepthImage
from contactfusion.vision import back_projected, returns
from tests.pictures import POSE, picture, state
from tests.test_networks import some_weights, write
from tests.test_own_body import BASE, depth, moved

SIDE = 0.005


def sure_of_a_point(folder: Path) -> Path:
    """Networks that always tell of a point in the middle of what they know."""
    weights = {name: np.zeros_like(tensor) for name, tensor in some_weights().items()}
    weights["type.readout.bias"] = np.array([0.0, 3.0, 1.0], np.float32)
    weights["location.readout.bias"] = np.array([0.5], np.float32)
    return write(folder, weights)


def generator(folder: Path, **options: Any) -> RgbdCpmGenerator:
    fields = {"segmenter": "truth", **options}
    return RgbdCpmGenerator("eye", RgbdCpmConfig(weights=sure_of_a_point(folder), **fields))


@pytest.fixture
def lengths(monkeypatch: pytest.MonkeyPatch) -> list[FloatArray]:
    """Give what comes to the networks, image by image."""
    seen: list[FloatArray] = []
    whole = RgbdCpmGenerator.perceived

    def perceived(self: Any, reading: Any, robot: Any, found: FloatArray) -> Any:
        seen.append(found)
        return whole(self, reading, robot, found)

    monkeypatch.setattr(RgbdCpmGenerator, "perceived", perceived)
    return seen


def said(one: RgbdCpmGenerator, image: DepthImage) -> Sequence[HypothesisCloud]:
    return one.generate(image, state())


def test_a_point_is_a_column_on_the_face(tmp_path: Path) -> None:
    (cloud,) = said(generator(tmp_path), picture())
    # the middle of -0.25 and 0.35 m, which the card of the networks names
    assert cloud.frame == "base" and cloud.positions[:, 1] == pytest.approx(0.05)
    assert cloud.positions[:, 0] == pytest.approx(0.30)
    assert cloud.positions[:, 2].min() == pytest.approx(-0.40 + SIDE / 2.0)
    assert cloud.positions[:, 2].max() == pytest.approx(-0.05 - SIDE / 2.0)
    certain = (np.exp(3.0) + np.e) / (1.0 + np.exp(3.0) + np.e)
    assert cloud.likelihoods == pytest.approx(min(certain, 0.95))
    assert cloud.spreads is not None and cloud.spreads == pytest.approx(0.02)


@pytest.mark.parametrize("segmenter", ["truth", "clusters"])
@pytest.mark.parametrize("ends", ["edge", "surface"])
def test_lengths_are_those_of_the_edges(
    segmenter: str, ends: str, lengths: list[FloatArray], tmp_path: Path
) -> None:
    one = generator(tmp_path, segmenter=segmenter, ends=ends)
    said(one, picture(0.3505, (-0.2, 0.2), width=640))
    pixel = 0.75 / (320.0 / np.tan(np.radians(27.5)))
    edge = 0.3505 - 0.31 + pixel / 2.0
    expected = edge if ends == "edge" else (edge + 0.05) / 2.0
    assert lengths[0][2:10] == pytest.approx(np.full(8, expected), abs=pixel / 2.0 + 1e-9)
    assert lengths[0][[0, 1, 10, 11]] == pytest.approx(np.full(4, 0.31))


@pytest.mark.parametrize(
    ("near", "margin", "length"),
    [
        (0.290, 0.015, 0.01),
        (0.290, 0.005, 0.54 - 0.31),  # only its other end is left, 0.25 m behind
        (0.280, 0.015, 0.53 - 0.31),
        (0.302, 0.015, 0.008),
    ],
)
def test_what_is_a_little_behind_the_face_is_on_it(
    near: float, margin: float, length: float, lengths: list[FloatArray], tmp_path: Path
) -> None:
    one = generator(tmp_path, margin=margin, ends="edge")
    said(one, picture(near, (-0.2, 0.2), width=640))
    assert lengths[0][3:9] == pytest.approx(np.full(6, length), abs=0.003)


def test_the_robot_itself_is_no_edge(lengths: list[FloatArray], tmp_path: Path) -> None:
    said(generator(tmp_path, margin=0.0), picture(0.302, (-0.2, 0.2), top=-0.06, width=640))
    assert lengths[0][4] > 0.15  # of its front edge nothing is left


def test_a_camera_that_stands_elsewhere_is_mended_by_the_body_beneath_it(
    lengths: list[FloatArray], tmp_path: Path
) -> None:
    # it truly stands 2 cm further back: the box touches, but seems to be 2 cm ahead
    true = moved((0.0, 0.02, 0.0), (0.0, 0.0, 0.0))
    box = BoxConfig(x=(0.301, 0.50), y=(-0.1, 0.1), z=(-0.45, 0.05))
    seen = depth(true, BASE, box, width=640)
    mask = seen < depth(true, BASE, width=640)
    image = replace(picture(width=640), depth=seen, colour=None, mask=mask)
    for body in (None, BASE):
        one = generator(tmp_path, body=body)
        for index in range(10):
            said(one, replace(image, stamp=0.1 * index))
    trusted, mended = lengths[9], lengths[19]
    assert trusted[5:7] == pytest.approx([0.0225, 0.0225], abs=0.005)
    assert mended[5:7] == pytest.approx([0.0, 0.0], abs=0.005)


def test_a_reset_forgets_where_the_body_was(lengths: list[FloatArray], tmp_path: Path) -> None:
    box = BoxConfig(x=(0.35, 0.55), y=(-0.1, 0.1), z=(-0.45, -0.30))
    askew = depth(moved((0.0, 0.02, 0.0), (0.0, 0.0, 0.0)), BASE, box)
    one = generator(tmp_path, segmenter="clusters", body=BASE)
    for seen in (askew, depth(POSE, BASE, box)):
        said(one, replace(picture(), depth=seen, colour=None))
        one.reset()
    assert lengths[1][5:7] == pytest.approx(lengths[0][5:7], abs=0.006)


def test_a_lost_object_gives_no_cloud_and_an_empty_mask_a_scene(
    lengths: list[FloatArray], tmp_path: Path
) -> None:
    gone = picture(near=5.0)
    assert said(generator(tmp_path, segmenter="clusters"), gone) == ()
    assert not lengths
    (cloud,) = said(generator(tmp_path), gone)
    assert lengths[0] == pytest.approx(np.full(12, 0.31))
    # these networks are sure of a contact whatever they see, but there is nothing to touch
    assert not len(cloud) and cloud.notes == (NOTHING_NEAR,)


@pytest.mark.parametrize("nothing", [0.0, np.nan])
def test_an_image_without_depth_is_told_as_unhealthy(nothing: float, tmp_path: Path) -> None:
    image = picture()
    blind = replace(image, depth=np.full(image.depth.shape, nothing))
    (cloud,) = said(generator(tmp_path), blind)
    assert len(cloud) == 0 and cloud.notes == (Note.UNHEALTHY,)


def test_a_reset_forgets_the_object(tmp_path: Path) -> None:
    one = generator(tmp_path, segmenter="clusters")
    assert said(one, picture(sides=(-0.3, -0.1)))
    jumped = picture(sides=(0.1, 0.3), stamp=0.1)
    assert said(one, jumped) == ()
    one.reset()
    assert said(one, picture(sides=(-0.3, -0.1)))
    one.reset()
    assert said(one, jumped)


def test_an_image_without_a_mask_is_refused_with_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InvalidReadingError, match="DepthImage of 'camera' has no mask"):
        said(generator(tmp_path), replace(picture(), mask=None))


def test_wrong_options_are_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="segmenter.gab: unknown field; did you mean"):
        generator(tmp_path, segmenter={"type": "clusters", "gab": 0.1})
    with pytest.raises(PluginError, match="there is no segmenter 'sam3'; did you mean 'sam2'"):
        generator(tmp_path, segmenter="sam3")


def test_without_opencv_it_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(DependencyError, match="opencv is not installed"):
        generator(tmp_path)


def test_in_a_pipeline_it_is_a_source(tmp_path: Path) -> None:
    options: dict[str, Any] = {
        "type": "rgbd_cpm",
        "weights": str(sure_of_a_point(tmp_path)),
        "sensor": "camera",
    }
    frames: dict[str, Any] = {
        "camera": {"parent": "base", "xyz": [0.4, 0.0, 1.1], "rpy": [np.pi, 0.0, -np.pi / 2]}
    }
    pipeline = Pipeline(PipelineConfig(generators={"eye": options}, frames=frames))
    for index in range(5):
        pipeline.receive(picture(stamp=0.1 * index))
    fusion = pipeline.step(0.4).fusion
    assert fusion.report.sources["eye"].accepted == 5
    assert fusion.contacts[0].position[:2] == pytest.approx([0.3, 0.05], abs=SIDE)


# Where the edges lie

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
