"""Clusters of depth are the object's pixels while the base drives and pushes it."""

import pickle
from collections.abc import Iterator
from typing import Any

import pytest

from contactfusion.readings import DepthImage
from contactfusion.segmenter import Segmenter
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import PushScene
from lab.tests.test_push_world import base
from tests.pictures import POSE
from tests.test_segmenters import clusters, overlap, truth_of


def seen_on_a_drive(camera: str, name: str) -> Iterator[DepthImage]:
    """The object turns, slides along the face, and partly out of sight."""
    fields: dict[str, Any] = {"object": name, "yaw": 20.0, "sees": (camera,)}
    scene = PushScene(PushConfig(target=(1.0, 0.0), **fields), base(), seed=2)
    for _ in range(25):
        yield next(reading for reading in scene.readings() if isinstance(reading, DepthImage))
        scene.drive(0.15, 0.2, 0.1)


@pytest.mark.parametrize(
    ("camera", "name"),
    [
        ("camera", "box"),
        ("camera", "cylinder"),
        ("camera", "nonuniform"),
        ("camera", "lshape"),
        ("camera_large", "box"),
        ("camera_large", "nonuniform"),
    ],
)
def test_clusters_are_the_object_on_a_whole_drive(camera: str, name: str) -> None:
    segmenter, masks = clusters(), []
    for image in seen_on_a_drive(camera, name):
        truth = truth_of(image)
        assert overlap(segmenter.segment(image, POSE), truth) >= 0.9
        masks.append(truth)
    assert (masks[0] & ~masks[-1]).any()
    # at last it is partly out of sight, to the side
    assert masks[-1][:, 0].any() or masks[-1][:, -1].any()


def test_equal_images_give_equal_masks_also_after_a_reset_and_in_another_process() -> None:
    images = list(seen_on_a_drive("camera", "cylinder"))[::5]

    def masks(segmenter: Segmenter[Any]) -> list[bytes]:
        found = [segmenter.segment(image, POSE) for image in images]
        return [b"" if mask is None else mask.tobytes() for mask in found]

    first = clusters()
    expected = masks(first)
    assert masks(clusters()) == expected
    first.reset()
    assert masks(first) == expected
    first.reset()
    assert masks(pickle.loads(pickle.dumps(first))) == expected
