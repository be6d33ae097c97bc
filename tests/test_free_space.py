"""Where a range camera sees through: before what it sees, and nowhere else."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from contactfusion import Grid, Integrator, IntegratorConfig, State
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, FrameError, RobotError
from contactfusion.frames import FrameTree, Pose, inverse, points_in, pose_at
from contactfusion.generators.free_space import FreeSpaceConfig, FreeSpaceGenerator
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import DepthImage
from tests import hands
from tests.clouds import centres, cloud, verdicts

GRID = Grid("base", 0.005)
HEIGHT, WIDTH, FOCAL = 48, 64, 100.0
WALL, MARGIN = 0.5, 0.03
CAMERA = np.array([[FOCAL, 0.0, 31.0], [0.0, FOCAL, 23.0], [0.0, 0.0, 1.0]])
BOX = ((-0.03, -0.03, 0.3), (0.03, 0.03, 0.6))
"""Before the camera, and well inside its image."""


def wall(depth: float = WALL) -> FloatArray:
    return np.full((HEIGHT, WIDTH), depth)


def seen(depth: FloatArray, camera: Pose | None = None, **options: Any) -> HypothesisCloud:
    """What is free by an image; without a pose the camera stands in the base and looks along z."""
    frames = FrameTree({"camera": ("base", np.eye(4) if camera is None else camera)})
    reading = DepthImage(stamp=0.0, frame="camera", depth=depth, intrinsics=CAMERA)
    config = FreeSpaceConfig(**{"box": BOX, "margin": MARGIN, **options})
    state = State(now=0.0, grid=GRID, frames=frames)
    (given,) = FreeSpaceGenerator("eye", config).generate(reading, state)
    return given


def everywhere(low: FloatArray, high: FloatArray) -> FloatArray:
    """The centres of all voxels of a box, whose corners must not lie on their faces."""
    x, y, z = (
        np.arange(np.floor(a / 0.005), np.floor(b / 0.005) + 1)
        for a, b in zip(low, high, strict=True)
    )
    voxels = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return 0.005 * (voxels + 0.5)


def pixels(places: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The rows and columns that places in the camera's frame fall on."""
    x, y, z = places.T
    return (
        np.rint(FOCAL * y / z + CAMERA[1, 2]).astype(np.intp),
        np.rint(FOCAL * x / z + CAMERA[0, 2]).astype(np.intp),
    )


def same(places: FloatArray, expected: FloatArray) -> bool:
    return set(map(tuple, GRID.voxels(places))) == set(map(tuple, GRID.voxels(expected)))


# Before a wall


def test_before_a_wall_by_the_margin_all_is_free_and_behind_it_nothing() -> None:
    low, high = np.array([-0.0301, -0.0301, 0.3001]), np.array([0.0301, 0.0301, 0.6001])
    inside = everywhere(low, high)
    for margin in (0.0, 0.03, 0.1):
        expected = inside[inside[:, 2] + margin < WALL]
        given = seen(wall(), box=(tuple(low), tuple(high)), margin=margin)
        assert len(given) == len(expected) and same(given.positions, expected)


def test_what_is_free_is_null_for_certain() -> None:
    given = seen(wall())
    assert given.kind == HypothesisKind.NULL and not given.single and given.frame == "base"
    assert set(given.likelihoods) == {1.0}
    voxels = GRID.voxels(given.positions)
    np.testing.assert_allclose(given.positions, 0.005 * (voxels + 0.5))
    assert len(np.unique(voxels, axis=0)) == len(given)


def test_a_wall_at_the_lens_leaves_nothing_free() -> None:
    assert len(seen(wall(0.2))) == 0


@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf])
def test_a_pixel_without_return_makes_nothing_free_nor_do_its_neighbours(nothing: float) -> None:
    depth = wall()
    depth[20, 30] = nothing
    given = seen(depth, margin=MARGIN)
    row, column = pixels(given.positions)
    away = np.maximum(abs(row - 20), abs(column - 30))
    assert away.min() > 1
    lost = len(seen(wall())) - len(given)
    everything = pixels(seen(wall()).positions)
    near = (abs(everything[0] - 20) <= 2) & (abs(everything[1] - 30) <= 2)
    assert 0 < lost <= near.sum()
    assert not len(seen(np.full_like(depth, nothing)))


def test_behind_the_camera_nothing_is_free() -> None:
    assert not len(seen(wall(), box=((-0.03, -0.03, -0.6), (0.03, 0.03, -0.1))))
    around = seen(wall(), box=((-0.03, -0.03, -0.6), (0.03, 0.03, 0.4)))
    assert len(around) and around.positions[:, 2].min() > 0.0


def test_a_voxel_in_the_plane_of_the_lens_is_not_free() -> None:
    lens = pose_at((0.0, 0.0, 0.0025), (0.0, 0.0, 0.0))
    given = seen(wall(), lens, box=((-0.1, -0.1, -0.01), (0.1, 0.1, 0.1)))
    assert len(given) and given.positions[:, 2].min() > 0.0025


def test_outside_the_image_nothing_is_free() -> None:
    wide = ((-0.4, -0.4, 0.3), (0.4, 0.4, 0.6))
    given = seen(wall(), box=wide)
    row, column = pixels(given.positions)
    assert (row.min(), column.min()) == (2, 2)  # at 0.3 m a voxel covers two pixels to each side
    assert (row.max(), column.max()) == (HEIGHT - 3, WIDTH - 3)


def test_a_voxel_is_seen_through_in_all_its_parts() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        depth = rng.uniform(0.05, 0.6, (HEIGHT, WIDTH)) * (rng.random((HEIGHT, WIDTH)) > 0.01)
        depth[:, 10:] = np.maximum(depth[:, 10:], 0.35)
        given = seen(depth, box=((-0.15, -0.15, -0.05), (0.15, 0.15, 0.5)), margin=0.02)
        assert len(given)
        parts = np.concatenate(
            [given.positions + 0.0025 * rng.uniform(-1.0, 1.0, (len(given), 3)) for _ in range(20)]
            + [given.positions + 0.0025 * (2.0 * np.array(c) - 1.0) for c in np.ndindex(2, 2, 2)]
        )
        row, column = pixels(parts)
        assert (depth[row, column] > parts[:, 2] + 0.02 - 0.0025).all()


def test_a_thin_thing_beside_the_centre_of_a_near_voxel_keeps_it_from_being_free() -> None:
    # At 0.05 m a voxel of 5 mm covers ten pixels: its centre is on column 31 + 5, the thread on 33.
    near = ((0.0001, -0.0024, 0.0501), (0.0049, 0.0024, 0.0549))
    assert len(seen(wall(), box=near))
    depth = wall()
    depth[:, 33] = 0.05
    assert not len(seen(depth, box=near))


def test_a_voxel_at_the_lens_covers_too_much_to_be_free() -> None:
    tiny = ((-0.001, -0.001, 0.001), (0.001, 0.001, 0.04))
    assert seen(wall(), box=tiny).positions[:, 2].min() > 0.01


# From where


def test_a_camera_that_is_turned_sees_the_same_in_its_own_frame() -> None:
    rng = np.random.default_rng(1)
    depth = rng.uniform(0.35, 0.7, (HEIGHT, WIDTH))
    for angles in rng.uniform(-3.0, 3.0, (5, 3)):
        camera = pose_at((0.3, -0.2, 0.5), angles)
        centre = points_in(camera, np.array([[0.0, 0.0, 0.4]]))[0]
        low, high = centre - 0.0801, centre + 0.0801
        given = seen(depth, camera, box=(tuple(low), tuple(high)))
        free = points_in(inverse(camera), given.positions)
        assert (minimum_filter(depth, 3)[pixels(free)] > free[:, 2] + MARGIN).all()
        inside = everywhere(low, high)
        there = points_in(inverse(camera), inside)
        wide = minimum_filter(depth, 9, mode="constant")
        row, column = pixels(there)
        held = (row >= 0) & (row < HEIGHT) & (column >= 0) & (column < WIDTH)
        surely = inside[held][wide[row[held], column[held]] > there[held, 2] + MARGIN]
        assert 100 < len(surely) < len(given) < len(inside)
        assert set(map(tuple, GRID.voxels(surely))) <= set(map(tuple, GRID.voxels(given.positions)))


def test_a_camera_that_looks_down_sees_free_what_is_above_the_table() -> None:
    above = pose_at((0.4, 0.0, 0.5), (np.pi, 0.0, 0.0))
    given = seen(wall(), above, box=((0.37, -0.03, -0.1), (0.43, 0.03, 0.2)))
    assert given.positions[:, 2].min() == pytest.approx(0.0325)
    assert given.positions[:, 2].max() == pytest.approx(0.2025, abs=0.0051)


def test_pixels_may_be_of_two_sizes_and_off_the_middle() -> None:
    camera = np.array([[100.0, 0.0, 5.0], [0.0, 200.0, 40.0], [0.0, 0.0, 1.0]])
    depth = wall()
    depth[:, 32:] = 0.0  # nothing right of x = (31.5 - 5)/100 · z
    frames = FrameTree({"camera": ("base", np.eye(4))})
    reading = DepthImage(stamp=0.0, frame="camera", depth=depth, intrinsics=camera)
    config = FreeSpaceConfig(box=((-0.2, -0.2, 0.4), (0.2, 0.2, 0.4)))
    state = State(now=0.0, grid=GRID, frames=frames)
    (given,) = FreeSpaceGenerator("eye", config).generate(reading, state)
    low, high = given.positions.min(axis=0), given.positions.max(axis=0)
    z = 0.4025
    edges = [
        (0.0 - 5.0) / 100.0 * z,
        (0.0 - 40.0) / 200.0 * z,
        0.265 * z,
        (47.0 - 40.0) / 200.0 * z,
    ]
    assert [*low[:2], *high[:2]] == pytest.approx(edges, abs=0.02)
    assert low[0] > edges[0] and low[1] > edges[1] and high[0] < edges[2] and high[1] < edges[3]


# Where to look


def test_it_looks_around_the_links(tmp_path: Path) -> None:
    robot = hands.slide(tmp_path)
    frames = FrameTree({"camera": ("base", pose_at((0.3, 0.0, -1.0), (0.0, 0.0, 0.0)))})
    state = replace(hands.state(robot, x=0.3), frames=frames)  # a cube of 0.1 m about x = 0.3
    reading = DepthImage(stamp=0.0, frame="camera", depth=wall(2.0), intrinsics=CAMERA)
    for reach in (0.02, 0.05):
        for links in ((), ("hand",)):
            eye = FreeSpaceGenerator("eye", FreeSpaceConfig(links=links, reach=reach))
            (given,) = eye.generate(reading, state)
            ends = np.stack([given.positions.min(axis=0), given.positions.max(axis=0)])
            low, high = np.array([0.25, -0.05, -0.05]) - reach, np.array([0.35, 0.05, 0.05]) + reach
            assert ends == pytest.approx(np.stack([low, high]), abs=0.005)


def test_two_corners_may_be_any_two() -> None:
    turned = ((0.03, -0.03, 0.6), (-0.03, 0.03, 0.3))
    np.testing.assert_array_equal(seen(wall(), box=turned).positions, seen(wall()).positions)


# What it cannot do


def test_too_many_voxels_are_one_sentence() -> None:
    far = ((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))
    with pytest.raises(ConfigurationError, match=r"'eye' would look at 6.\d+e\+07 voxels, more t"):
        seen(wall(), box=far)
    with pytest.raises(ConfigurationError, match=r"make its region smaller, or the voxels larger"):
        seen(wall(), box=((-900.0, -900.0, 0.0), (900.0, 900.0, 0.0)))


def test_without_a_box_and_a_robot_there_is_one_sentence() -> None:
    with pytest.raises(
        ConfigurationError, match="'eye' needs a `box` to look at, or the robot to look"
    ):
        seen(wall(), box=None)


def test_an_unknown_link_or_one_without_surface_is_one_sentence(tmp_path: Path) -> None:
    state = hands.state(hands.slide(tmp_path))
    reading = DepthImage(stamp=0.0, frame="base", depth=wall(), intrinsics=CAMERA)
    with pytest.raises(RobotError, match="unknown link 'hnad': did you mean 'hand'?"):
        FreeSpaceGenerator("eye", FreeSpaceConfig(links=("hnad",))).generate(reading, state)
    with pytest.raises(ConfigurationError, match="the links of 'eye' have no surface to look ar"):
        FreeSpaceGenerator("eye", FreeSpaceConfig(links=("base",))).generate(reading, state)


def test_a_camera_that_nothing_joins_to_the_space_is_one_sentence() -> None:
    reading = DepthImage(stamp=0.0, frame="eye", depth=wall(), intrinsics=CAMERA)
    state = State(now=0.0, grid=GRID, frames=FrameTree({"camera": ("base", np.eye(4))}))
    with pytest.raises(FrameError, match="unknown frame 'eye': the frames are: base, camera"):
        FreeSpaceGenerator("eye", FreeSpaceConfig(box=BOX)).generate(reading, state)


def test_an_image_without_pixels_makes_nothing_free() -> None:
    assert not len(seen(np.zeros((0, 0))))


# Fused


def test_a_free_voxel_nulls_the_contact_that_another_source_claims() -> None:
    before, behind = (0, 0, 80), (0, 0, 100)  # the wall is at voxel 100
    integrator = Integrator(IntegratorConfig())
    integrator.receive(cloud("wrist", 0.0, {before: 0.9, behind: 0.9}))
    integrator.receive(seen(wall()))
    fusion = integrator.step(0.0)
    told = verdicts(fusion)
    assert (told[before], told[behind]) == ("nulled", "contact")
    (contact,) = fusion.contacts
    assert contact.position == pytest.approx(centres([behind])[0])
