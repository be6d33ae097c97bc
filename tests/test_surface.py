"""Surfaces, and the shapes that they are sampled from."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from contactfusion import Surface
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import Pose, pose_at, pose_of
from contactfusion.shapes import BodyConfig, PartConfig, ShapeConfig
from contactfusion.surface import RigidPart

SHAPES: dict[str, dict[str, Any]] = {
    "box": {"size": (0.2, 0.1, 0.3)},
    "cylinder": {"radius": 0.05, "length": 0.2},
    "sphere": {"radius": 0.1},
    "rectangle": {"size": (0.4, 0.2)},
}
AREAS = {
    "box": 2 * (0.2 * 0.1 + 0.1 * 0.3 + 0.3 * 0.2),
    "cylinder": 2 * math.pi * 0.05 * (0.05 + 0.2),
    "sphere": 4 * math.pi * 0.1**2,
    "rectangle": 0.4 * 0.2,
}
SPACING = 0.005


def shape(kind: str, **fields: Any) -> PartConfig:
    return PartConfig(**{"shape": kind, **SHAPES[kind], **fields})


def outside(kind: str, points: Any) -> Any:
    """Give the distance from the surface of a shape, positive outside [m]."""
    x, y, z = np.asarray(points).T
    match kind:
        case "box":
            return np.max(np.abs(points) - np.array(SHAPES["box"]["size"]) / 2, axis=1)
        case "cylinder":
            return np.maximum(np.hypot(x, y) - 0.05, np.abs(z) - 0.1)
        case "sphere":
            return np.linalg.norm(points, axis=1) - 0.1
    return np.maximum(np.maximum(np.abs(x) - 0.2, np.abs(y) - 0.1), np.abs(z))


@pytest.mark.parametrize("kind", SHAPES)
def test_every_point_lies_on_its_shape(kind: str) -> None:
    points = shape(kind).sampled("body", SPACING).points
    if kind == "rectangle":
        assert (points[:, 2] == 0).all() and (np.abs(points[:, :2]) < [0.2, 0.1]).all()
    else:
        assert np.abs(outside(kind, points)).max() < 1e-12


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere"])
def test_every_normal_points_out_of_the_body(kind: str) -> None:
    surface = shape(kind).sampled("body", SPACING)
    for step in (1e-6, -1e-6):
        distance = outside(kind, surface.points + step * surface.normals)
        assert distance == pytest.approx(step, abs=1e-9)


def test_a_rectangle_faces_its_z() -> None:
    assert (shape("rectangle").sampled("body", SPACING).normals == [0.0, 0.0, 1.0]).all()


@pytest.mark.parametrize("kind", SHAPES)
def test_neighbours_are_about_the_spacing_apart(kind: str) -> None:
    points = shape(kind).sampled("body", SPACING).points
    distances, _ = KDTree(points).query(points, k=2)
    nearest = np.asarray(distances)[:, 1]
    assert nearest.max() <= SPACING * (1 + 1e-9)
    assert np.median(nearest) > 0.6 * SPACING


@pytest.mark.parametrize("kind", SHAPES)
def test_no_place_of_the_surface_is_far_from_a_point(kind: str) -> None:
    fine = shape(kind).sampled("body", SPACING / 4).points
    coarse = shape(kind).sampled("body", SPACING)
    assert coarse.nearest(fine)[0].max() <= SPACING


@pytest.mark.parametrize("kind", SHAPES)
def test_each_point_stands_for_a_square_of_the_spacing(kind: str) -> None:
    points = shape(kind).sampled("body", SPACING).points
    assert len(points) * SPACING**2 == pytest.approx(AREAS[kind], rel=0.03)


@pytest.mark.parametrize("kind", SHAPES)
def test_a_shape_stands_where_it_was_put_turned_about_fixed_axes(kind: str) -> None:
    still = shape(kind).sampled("body", SPACING)
    moved = shape(kind, xyz=(1.0, 2.0, 3.0), rpy=(0.3, -0.2, 0.7)).sampled("body", SPACING)

    def turn(axis: int, angle: float) -> Any:
        return Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix()

    matrix = turn(2, 0.7) @ turn(1, -0.2) @ turn(0, 0.3)
    assert np.allclose(moved.points, still.points @ matrix.T + [1.0, 2.0, 3.0], atol=1e-12)
    assert np.allclose(moved.normals, still.normals @ matrix.T, atol=1e-12)


@settings(max_examples=30)
@given(st.floats(1e-3, 0.5), st.sampled_from(["box", "cylinder", "sphere", "rectangle"]))
def test_a_coarse_shape_still_has_points_on_it(spacing: float, kind: str) -> None:
    surface = shape(kind).sampled("body", spacing)
    assert len(surface.points) >= {"box": 6, "cylinder": 8, "sphere": 12}.get(kind, 1)
    if kind != "rectangle":
        assert np.abs(outside(kind, surface.points)).max() < 1e-12


def test_the_cells_of_a_rectangle_are_equal_and_lie_within_it() -> None:
    plate = Surface.rectangle(
        "plate", np.ones(3), np.array([0.2, 0, 0]), np.array([0, 0, 0.1]), 0.1
    )
    assert sorted(set(plate.points[:, 0].round(9) - 1)) == pytest.approx([-0.15, -0.05, 0.05, 0.15])
    assert sorted(set(plate.points[:, 2].round(9) - 1)) == pytest.approx([-0.05, 0.05])
    assert (plate.normals == [0.0, -1.0, 0.0]).all()


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"shape": "ball", "radius": 1.0}, "shape"),
        ({"shape": "box"}, "a box needs size"),
        ({"shape": "sphere", "radius": 1.0, "length": 1.0}, "a sphere needs radius"),
        ({"shape": "cylinder", "radius": 1.0}, "a cylinder needs length and radius"),
        ({"shape": "sphere", "radius": -1.0}, "radius"),
        ({"shape": "box", "size": (1.0, 1.0)}, "a box has 3 positive edges"),
        ({"shape": "box", "size": (1.0, 1.0, 0.0)}, "a box has 3 positive edges"),
        ({"shape": "rectangle", "size": (1.0, 1.0, 1.0)}, "a rectangle has 2 positive edges"),
        ({"shape": "sphere", "radius": 1.0, "xyz": (0.0, 0.0, math.nan)}, "xyz"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(fields: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        ShapeConfig(**fields)


# Bodies


def test_a_body_is_one_link_unless_its_shapes_name_others() -> None:
    shapes = shape("sphere"), shape("box", link="box"), shape("cylinder")
    counts = [len(each.sampled("tool", 0.05).points) for each in shapes]
    surface = BodyConfig(frame="tool", spacing=0.05, shapes=shapes[::2]).sampled(Path())
    assert surface.link_names == ("tool",) and not surface.links.any()
    surface = BodyConfig(frame="tool", spacing=0.05, shapes=shapes).sampled(Path())
    assert surface.link_names == ("tool", "box")
    assert np.bincount(surface.links).tolist() == [counts[0] + counts[2], counts[1]]
    box = surface.of_links(["box"])
    assert np.array_equal(box.points, shapes[1].sampled("tool", 0.05).points)
    assert np.array_equal(box.links, np.full(counts[1], 1))


def test_a_body_may_come_from_a_file(tmp_path: Path) -> None:
    ball = shape("sphere").sampled("tool", 0.05)
    np.savez(tmp_path / "ball.npz", points=ball.points, normals=ball.normals)
    surface = BodyConfig(frame="tool", file=Path("ball.npz")).sampled(tmp_path)
    assert np.array_equal(surface.points, ball.points) and surface.frame == "tool"


@pytest.mark.parametrize("spoil", ["missing", "empty", "cut off", "no archive", "an array", "keys"])
def test_a_file_that_holds_no_surface_is_refused_by_name(tmp_path: Path, spoil: str) -> None:
    path = tmp_path / "ball.npz"
    np.savez(path, points=np.zeros((0, 3)), normals=np.zeros((0, 3)))
    match spoil:
        case "missing":
            path.unlink()
        case "empty":
            path.write_bytes(b"")
        case "cut off":
            path.write_bytes(path.read_bytes()[:-100])
        case "no archive":
            path.write_text("points: 3")
        case "an array":
            with path.open("wb") as file:
                np.save(file, np.zeros((2, 3)))
        case "keys":
            np.savez(path, places=np.zeros((0, 3)))
    with pytest.raises(ConfigurationError, match="ball.npz"):
        BodyConfig(frame="tool", file=path).sampled(tmp_path)


@pytest.mark.parametrize("fields", [{}, {"file": "a.npz", "shapes": [SHAPES["sphere"]]}])
def test_a_body_is_made_of_shapes_or_of_a_file(fields: dict[str, Any]) -> None:
    if "shapes" in fields:
        fields = {**fields, "shapes": [{"shape": "sphere", **SHAPES["sphere"]}]}
    with pytest.raises(ConfigurationError, match="give shapes or a file"):
        BodyConfig(frame="tool", **fields)


# Surfaces


def test_a_surface_holds_read_only_arrays() -> None:
    surface = shape("sphere").sampled("body", 0.05)
    for array in (surface.points, surface.normals, surface.links):
        assert not array.flags.writeable


def test_a_surface_without_links_is_one_link_of_its_frame() -> None:
    surface = shape("sphere").sampled("ball", 0.05)
    assert surface.link_names == ("ball",) and not surface.links.any()


def test_an_empty_surface_is_a_surface() -> None:
    assert len(Surface("ball", np.empty((0, 3)), np.empty((0, 3))).points) == 0


def test_the_spacing_is_the_distance_of_neighbouring_points() -> None:
    x, y, _ = np.eye(3)
    fine, coarse = (
        Surface.rectangle("pad", np.zeros(3), 0.1 * x, 0.1 * y, s) for s in (0.004, 0.0125)
    )
    assert fine.spacing == pytest.approx(0.004) and coarse.spacing == pytest.approx(0.0125)
    point = Surface("pad", np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
    assert point.spacing == Surface("pad", np.empty((0, 3)), np.empty((0, 3))).spacing == 0.0


def test_the_spacing_of_several_parts_is_their_mean_by_points() -> None:
    parts = [part("box", 0), part("sphere", 1)]
    surface = Surface.of_parts("base", [(one, np.eye(4)) for one in parts], ["box", "sphere"])
    counts = [len(one.points) for one in parts]
    expected = np.average([one.spacing for one in parts], weights=counts)
    assert surface.spacing == surface.moved(pose_of((0.0, 0.0, 1.0)), "map").spacing == expected


def test_a_moved_surface_keeps_its_links() -> None:
    shapes = shape("sphere"), shape("box", link="box")
    surface = BodyConfig(frame="body", spacing=0.05, shapes=shapes).sampled(Path())
    there = surface.moved(pose_of((0.0, 0.0, 1.0)), "base")
    assert there.frame == "base" and there.link_names == surface.link_names
    assert np.array_equal(there.links, surface.links)
    assert np.allclose(there.points, surface.points + [0.0, 0.0, 1.0])
    assert np.array_equal(there.normals, surface.normals)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"points": np.full((1, 3), np.nan)}, "row 0 of the points of the surface in 'ball'"),
        ({"normals": np.ones((1, 3))}, "the normals of the surface in 'ball' are not unit vectors"),
        ({"normals": np.ones((2, 3))}, "normals of the surface in 'ball' have shape"),
        ({"links": np.array([1])}, "a link index of the surface in 'ball' has no name"),
        ({"links": np.array([-1])}, "a link index of the surface in 'ball' has no name"),
        ({"links": np.array([0, 0])}, "links of the surface in 'ball' have shape"),
    ],
)
def test_a_surface_that_cannot_be_is_refused(fields: dict[str, Any], sentence: str) -> None:
    good = {"points": np.zeros((1, 3)), "normals": np.array([[0.0, 0.0, 1.0]])}
    with pytest.raises(ConfigurationError, match=sentence):
        Surface("ball", **{**good, **fields})


# Surfaces made of rigid parts

triples = st.tuples(*[st.floats(-0.5, 0.5)] * 3)
poses = st.builds(pose_at, triples, triples)
parts_of = st.lists(st.tuples(st.sampled_from(["box", "cylinder", "sphere"]), poses), max_size=4)


def part(kind: str, link: int) -> RigidPart:
    sampled = shape(kind).sampled("body", 0.02)
    return RigidPart(sampled.points, sampled.normals, np.full(len(sampled.points), link, np.int32))


def assembled(bodies: list[tuple[str, Pose]]) -> Surface:
    """One link a body."""
    parts = [(part(kind, link), pose) for link, (kind, pose) in enumerate(bodies)]
    return Surface.of_parts("base", parts, [f"link {n}" for n in range(len(bodies))])


@settings(max_examples=30)
@given(parts_of)
def test_parts_stand_in_their_poses_one_after_the_other(bodies: list[tuple[str, Pose]]) -> None:
    surface = assembled(bodies)
    begin = 0
    for link, (kind, pose) in enumerate(bodies):
        own = part(kind, link)
        rows = slice(begin, begin + len(own.points))
        turn = pose[:3, :3]
        assert np.allclose(surface.points[rows], own.points @ turn.T + pose[:3, 3], atol=1e-12)
        assert np.allclose(surface.normals[rows], own.normals @ turn.T, atol=1e-12)
        assert (surface.links[rows] == link).all()
        begin = rows.stop
    assert len(surface.points) == len(surface.normals) == len(surface.links) == begin
    assert not any(a.flags.writeable for a in (surface.points, surface.normals, surface.links))


@settings(max_examples=30)
@given(parts_of, poses, poses)
def test_a_moved_surface_has_all_its_parts_moved(
    bodies: list[tuple[str, Pose]], first: Pose, then: Pose
) -> None:
    surface = assembled(bodies)
    there = surface.moved(first, "world").moved(then, "map")
    both = then @ first
    assert there.frame == "map" and there.link_names == surface.link_names
    assert np.array_equal(there.links, surface.links)
    assert np.allclose(there.points, surface.points @ both[:3, :3].T + both[:3, 3], atol=1e-12)
    assert np.allclose(there.normals, surface.normals @ both[:3, :3].T, atol=1e-12)


@settings(max_examples=50)
@given(parts_of, triples, poses, st.floats(0.0, 0.3))
def test_all_that_is_near_a_line_is_kept(
    bodies: list[tuple[str, Pose]], start: Any, turn: Pose, reach: float
) -> None:
    surface = assembled(bodies)
    direction = turn[:3, 0]
    near = surface.near_line(np.array(start), direction, reach)
    assert near.frame == "base" and near.link_names == surface.link_names
    across = np.linalg.norm(np.cross(surface.points - start, direction), axis=1)
    kept = np.isin(surface.links, near.links)
    assert np.array_equal(near.points, surface.points[kept])
    assert kept[across <= reach].all()


def test_parts_far_from_a_line_are_left_out() -> None:
    bodies = [("sphere", pose_of((0.0, y, 0.0))) for y in (0.0, 0.25, 1.0)]
    near = assembled(bodies).near_line(np.array([5.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), 0.1)
    assert set(near.links) == {0}
    near = assembled(bodies).near_line(np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.0)
    assert set(near.links) == {0, 1, 2}


def distances_to_all(surface: Surface, points: FloatArray) -> FloatArray:
    """Look at every point of the surface, shape (m, n) [m]."""
    return np.asarray(np.linalg.norm(surface.points - points[:, None], axis=2))


@settings(max_examples=40)
@given(parts_of, poses, st.integers(0, 99))
def test_the_nearest_is_hardly_further_than_the_nearest_of_all(
    bodies: list[tuple[str, Pose]], moved: Pose, seed: int
) -> None:
    surface = assembled(bodies).moved(moved, "world")
    points = np.random.default_rng(seed).uniform(-0.8, 0.8, (60, 3))
    distances, rows = surface.nearest(points)
    if not bodies:
        assert np.isinf(distances).all() and (rows == 0).all()
        return
    every = distances_to_all(surface, points)
    assert np.allclose(distances, every[np.arange(len(points)), rows], rtol=0.0, atol=1e-9)
    exact = every.min(axis=1)
    assert (distances - exact <= np.maximum(0.1 * exact, 0.02)).all()
    assert np.median(distances - exact) < 1e-9


@settings(max_examples=40)
@given(parts_of.filter(len), st.floats(0.01, 0.5), st.integers(0, 99))
def test_nothing_is_found_beyond_the_reach(
    bodies: list[tuple[str, Pose]], reach: float, seed: int
) -> None:
    surface = assembled(bodies)
    points = np.random.default_rng(seed).uniform(-0.8, 0.8, (60, 3))
    distances, rows = surface.nearest(points, reach)
    found = np.isfinite(distances)
    assert (distances[found] <= reach).all()
    assert (rows[found] < len(surface.points)).all()
    assert (rows[~found] == len(surface.points)).all()
    assert not found[distances_to_all(surface, points).min(axis=1) > reach].any()


@settings(max_examples=20)
@given(parts_of.filter(len), poses)
def test_a_point_of_the_surface_is_the_nearest_to_itself(
    bodies: list[tuple[str, Pose]], moved: Pose
) -> None:
    surface = assembled(bodies).moved(moved, "world")
    distances, _ = surface.nearest(surface.points)
    assert np.mean(distances < 1e-9) > 0.97 and distances.max() < 0.02


def test_each_point_of_a_joined_surface_is_found_in_its_link() -> None:
    apart = [("sphere", pose_of((x, 0.0, 0.0))) for x in (-1.0, 0.0, 1.0)]
    surface = assembled(apart)
    _, rows = surface.nearest(np.array([[-1.2, 0, 0], [0.1, 0.3, 0], [0.9, 0, 0]]))
    assert surface.links[rows].tolist() == [0, 1, 2]
