"""The pose of a camera, mended by what it sees of the base that carries it."""

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, inverse, pose_at, vectors_in
from contactfusion.generators.own_body import SETTLED, OwnBody
from contactfusion.generators.proximity import BoxConfig
from contactfusion.vision import back_projected
from tests.pictures import FLOOR, POSE, intrinsics

BASE = BoxConfig(x=(-0.42, 0.30), y=(-0.30, 0.30), z=(-0.40, -0.05))
TALL = BoxConfig(x=(0.301, 0.60), y=(-0.35, 0.35), z=(-0.45, 0.35))
"""It hides the whole front."""
BESIDE = BoxConfig(x=(0.301, 0.60), y=(0.10, 0.70), z=(-0.45, 0.35))
FOUND = 0.0075
"""So well the face is put where it is [m]: a pixel of 160 x 120 is as wide on the base."""


def depth(pose: Pose, *boxes: BoxConfig, width: int = 160) -> FloatArray:
    """See upper sides of boxes and the floor from a camera that truly stands at `pose`."""
    height = width * 3 // 4
    v, u = np.indices((height, width)).reshape(2, -1)
    ways = vectors_in(pose, back_projected(v, u, np.ones(v.size), intrinsics(width, height)))
    seen: FloatArray = (FLOOR - pose[2, 3]) / ways[:, 2]
    for box in boxes:
        far = (box.z[1] - pose[2, 3]) / ways[:, 2]
        x, y = (pose[:2, 3] + far[:, None] * ways[:, :2]).T
        on_top = (x >= box.x[0]) & (x <= box.x[1]) & (y >= box.y[0]) & (y <= box.y[1])
        seen = np.where(on_top & (far < seen), far, seen)
    image: FloatArray = seen.reshape(height, width)
    return image


def moved(xyz: tuple[float, float, float], degrees: tuple[float, float, float]) -> Pose:
    """Where a camera truly is that stands and looks so far from what is said."""
    true: Pose = POSE @ pose_at(xyz, tuple(np.radians(degrees)))
    return true


def off(pose: Pose, true: Pose) -> FloatArray:
    """By how much the camera misplaces the corners of the face, the largest along each axis."""
    corners = np.array([[0.3, y, z, 1.0] for y in (-0.3, 0.3) for z in (-0.4, -0.05)])
    seen: FloatArray = corners @ (pose @ inverse(true)).T - corners
    worst: FloatArray = np.abs(seen[:, :3]).max(axis=0)
    return worst


def mended(body: OwnBody, *images: FloatArray) -> Pose:
    """Give the pose after the last of these images."""
    return [body.mended(one, intrinsics(*one.shape[::-1]), POSE) for one in images][-1]


ASKEW = [
    ((0.02, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ((0.0, -0.02, 0.0), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.02), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (0.0, -2.0, 0.0)),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 2.0)),
    ((-0.012, 0.011, 0.011), (1.1, 1.2, -1.1)),
]


@pytest.mark.parametrize("width", [160, 640])
@pytest.mark.parametrize(("xyz", "degrees"), ASKEW)
def test_the_face_is_put_where_it_is(
    xyz: tuple[float, float, float], degrees: tuple[float, float, float], width: int
) -> None:
    body, true = OwnBody(BASE), moved(xyz, degrees)
    assert off(POSE, true).max() > 0.01
    pose = mended(body, *10 * [depth(true, BASE, width=width)])
    assert off(pose, true).max() < FOUND


def test_noise_and_missing_depth_do_no_harm() -> None:
    rng, true = np.random.default_rng(7), moved(*ASKEW[-1])
    body, clean = OwnBody(BASE), depth(true, BASE)
    noisy = clean + 0.004 * rng.standard_normal((20, *clean.shape))
    pose = mended(body, *np.where(rng.random(noisy.shape) < 0.1, 0.0, noisy))
    assert off(pose, true).max() < FOUND


def test_a_camera_in_its_place_stays_there() -> None:
    body = OwnBody(BASE)
    pose = mended(body, *20 * [depth(POSE, BASE, BESIDE)])
    assert off(pose, POSE).max() < 0.003


def test_what_hides_part_of_the_front_does_not_move_it() -> None:
    body, true = OwnBody(BASE), moved((0.0, 0.02, 0.0), (1.5, 0.0, 0.0))
    pose = mended(body, *10 * [depth(true, BASE, BESIDE)])
    assert off(pose, true).max() < FOUND


def test_behind_a_hidden_front_all_but_the_way_ahead_is_mended() -> None:
    # the camera's y points back, its x to the right
    body, true = OwnBody(BASE), moved((0.015, 0.015, 0.01), (1.0, 1.0, 0.0))
    pose = mended(body, *10 * [depth(true, BASE, TALL)])
    ahead, aside, up = off(pose, true)
    assert ahead == pytest.approx(0.015, abs=FOUND)
    assert aside < FOUND and up < FOUND
    assert body.sigma[0] == pytest.approx(0.02)
    # once it is free, the way ahead is found as well
    pose = mended(body, *10 * [depth(true, BASE)])
    assert off(pose, true).max() < FOUND


@pytest.mark.parametrize("boxes", [(), (TALL,)])
def test_without_a_body_in_view_the_pose_is_trusted(boxes: tuple[BoxConfig, ...]) -> None:
    body = OwnBody(BASE)
    assert np.array_equal(mended(body, depth(moved(*ASKEW[-1]), *boxes)), POSE)
    assert np.array_equal(mended(body, np.zeros((120, 160))), POSE)


def test_once_all_is_known_the_pose_is_kept_until_a_reset() -> None:
    body, true = OwnBody(BASE), moved(*ASKEW[-1])
    kept = mended(body, *60 * [depth(true, BASE)])
    assert np.all(body.sigma <= SETTLED)
    assert np.array_equal(mended(body, depth(POSE, BASE)), kept)
    body.reset()
    assert off(mended(body, depth(POSE, BASE)), POSE).max() < FOUND
