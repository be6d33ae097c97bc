"""Which pixels are the object's: by its mask, by clusters of depth; and who offers segmenters."""

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import (
    ConfigurationError,
    DependencyError,
    InvalidReadingError,
    PluginError,
)
from contactfusion.model import Model, rooted
from contactfusion.plugins import installed_plugins
from contactfusion.readings import DepthImage
from contactfusion.segmenter import AnySegmenter, Mask, built_segmenter
from contactfusion.segmenters.clusters import ClustersConfig, ClustersSegmenter, learned_paint
from contactfusion.segmenters.truth import TruthConfig, TruthSegmenter
from tests.pictures import GREY, PAINT, POSE, picture
from tests.test_docs import ROOT, unnamed

OFFERS = installed_plugins().offers("segmenters")
PAGE = ROOT / "docs" / "segmenters.md"


class Chosen(Model):
    """What holds a segmenter."""

    segmenter: AnySegmenter


def chosen(value: Any) -> Any:
    return Chosen(segmenter=value).segmenter


def clusters(**options: Any) -> ClustersSegmenter:
    return ClustersSegmenter(ClustersConfig(**options))


def overlap(found: Mask | None, truth: Mask | None) -> float:
    """Intersection over union."""
    assert found is not None and truth is not None
    return float(np.count_nonzero(found & truth) / np.count_nonzero(found | truth))


def truth_of(image: DepthImage) -> Mask:
    assert image.mask is not None
    return image.mask


def test_an_object_that_is_gone_is_lost_and_found_again() -> None:
    segmenter, here = clusters(), picture()
    gone = picture(near=5.0)
    assert overlap(segmenter.segment(here, POSE), here.mask) == 1.0
    assert segmenter.segment(gone, POSE) is None
    assert segmenter.segment(gone, POSE) is None
    there = picture(near=0.4, sides=(-0.1, 0.25))
    assert overlap(segmenter.segment(there, POSE), there.mask) == 1.0


def test_an_object_that_jumps_is_lost_for_an_image() -> None:
    segmenter = clusters()
    assert segmenter.segment(picture(sides=(-0.3, -0.1)), POSE) is not None
    jumped = picture(sides=(0.1, 0.3))
    assert segmenter.segment(jumped, POSE) is None
    assert overlap(segmenter.segment(jumped, POSE), jumped.mask) == 1.0


def together(one: DepthImage, other: DepthImage) -> DepthImage:
    mask = truth_of(other)
    assert one.colour is not None and other.colour is not None
    colour = np.where(mask[..., None], other.colour, one.colour)
    return replace(one, depth=np.where(mask, other.depth, one.depth), colour=colour)


def test_the_nearest_thing_is_followed_also_when_another_comes_nearer() -> None:
    segmenter = clusters()
    own, other = picture(0.31, (0.05, 0.3)), picture(0.36, (-0.3, -0.05))
    assert overlap(segmenter.segment(together(own, other), POSE), own.mask) == 1.0
    own, other = picture(0.33, (0.05, 0.3)), picture(0.305, (-0.3, -0.05))
    assert overlap(segmenter.segment(together(own, other), POSE), own.mask) == 1.0
    segmenter.reset()
    assert overlap(segmenter.segment(together(own, other), POSE), other.mask) == 1.0


def test_things_that_stand_close_are_one() -> None:
    own, other = picture(0.31, (0.02, 0.3)), picture(0.33, (-0.3, 0.0))
    both = truth_of(own) | truth_of(other)
    assert overlap(clusters().segment(together(own, other), POSE), both) == 1.0
    for gap in (0.01, 0.004):
        assert overlap(clusters(gap=gap).segment(together(own, other), POSE), own.mask) == 1.0


def test_specks_and_the_robot_are_no_object() -> None:
    speck = picture(0.4, (0.0, 0.04), width=640)
    assert clusters(least=0.02).segment(speck, POSE) is None
    assert clusters(least=0.001).segment(speck, POSE) is not None
    chassis = picture(near=0.055, top=-0.05)  # it ends at 0.305 m
    assert clusters().segment(chassis, POSE) is None


def holed(image: DepthImage) -> DepthImage:
    """Take the depth of every second pixel at the rim of the object, on it and beside it."""
    mask, depth = truth_of(image), image.depth.copy()
    rim = np.zeros(mask.shape, np.bool_)
    for axis in (0, 1):
        for step in (1, -1):
            rim |= mask != np.roll(mask, step, axis)
    depth[rim & (np.indices(mask.shape).sum(axis=0) % 2 == 0)] = 0.0
    return replace(image, depth=depth)


def test_colour_tells_whose_a_pixel_without_depth_is() -> None:
    image = holed(picture())
    assert overlap(clusters().segment(image, POSE), image.mask) == 1.0
    without = replace(image, colour=None)
    assert 0.9 < overlap(clusters().segment(without, POSE), image.mask) < 1.0


def test_a_paint_covers_the_colours_of_the_object() -> None:
    image = picture()
    assert image.colour is not None
    paint = learned_paint(image.colour, truth_of(image))
    assert paint.covers(np.array([PAINT, GREY], np.uint8)).tolist() == [True, False]
    whole = learned_paint(image.colour, np.ones((120, 160), np.bool_))
    assert whole.covers(np.array([PAINT, GREY], np.uint8)).tolist() == [True, True]


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, 1e6])
def test_an_image_of_one_value_holds_no_object(value: float) -> None:
    image = picture()
    assert clusters().segment(replace(image, depth=np.full((120, 160), value)), POSE) is None


def test_another_size_of_images_is_another_start() -> None:
    segmenter, large = clusters(), picture(width=320)
    assert segmenter.segment(picture(), POSE) is not None
    assert segmenter.segment(large, POSE) is None
    assert overlap(segmenter.segment(large, POSE), large.mask) == 1.0


def test_truth_is_the_mask_of_the_image_also_an_empty_one() -> None:
    segmenter, image = TruthSegmenter(TruthConfig()), picture()
    assert segmenter.segment(image, POSE) is image.mask
    nothing = segmenter.segment(picture(near=5.0), POSE)
    assert not nothing.any()
    with pytest.raises(InvalidReadingError, match="DepthImage of 'camera' has no mask for the"):
        segmenter.segment(replace(image, mask=None), POSE)


def test_a_segmenter_is_chosen_by_name_or_by_its_options() -> None:
    assert chosen("clusters") == ClustersConfig()
    wide = chosen({"type": "clusters", "gap": 0.1})
    assert wide == ClustersConfig(gap=0.1)
    assert isinstance(built_segmenter(wide), ClustersSegmenter)
    assert chosen(wide) is wide
    assert Chosen(segmenter=wide).model_dump()["segmenter"]["gap"] == 0.1


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ({"type": "clusters", "gab": 1}, "segmenter.gab: unknown field; did you mean 'gap'?"),
        ({"type": "clusters", "gap": -1}, "segmenter.gap: "),
        ({"gap": 0.1}, "segmenter: say which segmenter by its `type`"),
        ({"type": "sam2"}, "segmenter.weights: this field is required"),
        (7, "segmenter: "),
    ],
)
def test_wrong_options_are_told(value: Any, sentence: str) -> None:
    with pytest.raises(ConfigurationError) as told:
        chosen(value)
    assert str(told.value).startswith(sentence)


def test_an_unknown_segmenter_is_told() -> None:
    with pytest.raises(PluginError, match="no segmenter 'cluster'; did you mean 'clusters'"):
        chosen("cluster")


def test_a_stranger_is_no_segmenter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(dict(OFFERS), "clusters", Chosen)
    monkeypatch.setattr(type(installed_plugins()), "find", lambda *_: Chosen)
    with pytest.raises(
        PluginError, match="'clusters' cannot be used: Chosen is no subclass of Segm"
    ):
        chosen("clusters")


def test_without_opencv_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(DependencyError, match=re.escape("pip install 'contactfusion[vision]'")):
        clusters()


def test_relative_names_in_a_segmenters_options_start_at_the_folder() -> None:
    config = rooted(chosen({"type": "sam2", "weights": "tiny"}), Path("/somewhere"))
    assert config.folder == Path("/somewhere")


def test_the_package_offers_these_segmenters() -> None:
    assert {"clusters", "sam2", "truth"} <= set(OFFERS)


@pytest.mark.parametrize("name", ["clusters", "sam2", "truth"])
def test_the_page_on_segmenters_names_every_option(name: str) -> None:
    assert not unnamed(OFFERS[name].Config, PAGE.read_text())
