"""What of a link can be touched: its sampled surface, with normals that point out of it."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from contactfusion.arrays import FloatArray
from contactfusion.confined import confined
from contactfusion.errors import RobotError
from contactfusion.robots.solids import Solid, loaded_open3d, read_mesh
from contactfusion.robots.urdf import Mesh
from contactfusion.shapes import ShapeConfig
from tests.urdfs import ARM_HAND, REAL, built, link, outside_of, outside_of_all, real

SPACING = 0.005
ROUND = 5e-4
"""Rays start 0.2 mm off the surface and see round primitives with 64 corners: so deep may a sample
lie in another primitive [m]."""
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""The corners of each side of a cube, so that its normal points outwards."""
TOP = 5

lengths = st.floats(0.02, 0.08)
places = st.tuples(*[st.floats(-0.04, 0.04)] * 3)
turns = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
where = {"xyz": places, "rpy": turns}
primitives = st.one_of(
    st.builds(ShapeConfig, shape=st.just("sphere"), radius=lengths, **where),
    st.builds(ShapeConfig, shape=st.just("cylinder"), radius=lengths, length=lengths, **where),
    st.builds(
        ShapeConfig, shape=st.just("box"), size=st.tuples(lengths, lengths, lengths), **where
    ),
)


def cubes(path: Path, *edges: float, without: int = -1, flip: bool = False) -> Mesh:
    """Write cubes about the origin into one OBJ file, of which the last may lack a side.

    With `flip` every other triangle faces inwards.
    """
    lines, triangles = [], 0
    for number, edge in enumerate(edges):
        lines += [f"v {x} {y} {z}" for x, y, z in edge * CORNERS]
        last = number == len(edges) - 1
        for side, (a, b, c, d) in enumerate(FACES):
            for triangle in ((a, b, c), (a, c, d)):
                if last and side == without:
                    continue
                corners = [corner + 1 + 8 * number for corner in triangle]
                triangles += 1
                order = corners[::-1] if flip and triangles % 2 else corners
                lines.append("f " + " ".join(map(str, order)))
    path.write_text("\n".join(lines) + "\n")
    return Mesh(path, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def cube(edge: float) -> ShapeConfig:
    return ShapeConfig(shape="box", size=(edge, edge, edge))


def points_out(shapes: list[ShapeConfig], points: FloatArray, normals: FloatArray) -> None:
    """Along its normal each point leaves the shape that it lies on, and backwards enters it."""
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
    step = 1e-5
    on = np.abs([outside_of(one, points) for one in shapes]) < 1e-7
    ahead = np.stack([outside_of(one, points + step * normals) for one in shapes])
    back = np.stack([outside_of(one, points - step * normals) for one in shapes])
    out = np.isclose(ahead, step, rtol=0.0, atol=1e-2 * step) & (back < 0.0)
    assert out.any(axis=0, where=on).all()


# Primitives


@settings(max_examples=40)
@given(st.lists(primitives, min_size=1, max_size=3))
def test_a_sample_lies_on_one_primitive_and_in_no_other(shapes: list[ShapeConfig]) -> None:
    points, normals = Solid(shapes).samples(SPACING)
    distances = np.stack([outside_of(one, points) for one in shapes])
    assert np.abs(distances).min(axis=0).max() < 1e-9
    assert distances.min() > -ROUND
    points_out(shapes, points, normals)


@settings(max_examples=25)
@given(st.lists(primitives, min_size=1, max_size=3))
def test_what_can_be_touched_is_near_a_sample(shapes: list[ShapeConfig]) -> None:
    samples, _ = Solid(shapes).samples(SPACING)
    fine = np.concatenate([one.sampled("link", SPACING / 2).points for one in shapes])
    free = fine[outside_of_all(shapes, fine) > -1e-9]
    # where two primitives meet at a sharp angle the next sample may be hidden
    assert np.asarray(KDTree(samples).query(free)[0]).max() < 2.0 * SPACING


@settings(max_examples=25)
@given(st.lists(primitives, min_size=1, max_size=3), st.integers(0, 1000))
def test_distances_are_those_to_the_nearest_primitive(shapes: list[ShapeConfig], seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-0.3, 0.3, (200, 3))
    true = outside_of_all(shapes, points)
    found = Solid(shapes).distances(points)
    outside = true > 0.0
    assert np.abs(found[outside] - true[outside]).max(initial=0.0) < ROUND


@settings(max_examples=25)
@given(st.lists(primitives, min_size=1, max_size=3), st.integers(0, 1000))
def test_signed_distances_are_negative_inside_and_where_shapes_overlap(
    shapes: list[ShapeConfig], seed: int
) -> None:
    points = np.random.default_rng(seed).uniform(-0.12, 0.12, (300, 3))
    true = outside_of_all(shapes, points)
    found = Solid(shapes).signed_distances(points)
    assert np.abs(found - true).max() < 3.0 * ROUND  # round primitives have corners


def test_two_that_overlap_are_solid_in_the_overlap(tmp_path: Path) -> None:
    middle = np.zeros((1, 3))
    mesh = cubes(tmp_path / "cube.obj", 0.06)
    cases: list[tuple[list[ShapeConfig | Mesh], float]] = [
        ([cube(0.1), cube(0.06)], 0.05),
        ([cube(0.06), cube(0.1)], 0.05),
        ([cube(0.1)] * 2, 0.05),
        ([cube(0.04), mesh], 0.03),
        ([cube(0.04), cube(0.06), mesh, cube(0.1)], 0.05),
    ]
    for shapes, depth in cases:
        assert Solid(shapes).signed_distances(middle) == pytest.approx([-depth])


def test_each_shape_gives_its_triangles_where_it_is(tmp_path: Path) -> None:
    there: dict[str, Any] = {"xyz": (0.1, 0.2, 0.3), "rpy": (0.4, 0.5, 0.6)}
    box = ShapeConfig(shape="box", size=(0.1, 0.05, 0.02), **there)
    ball = ShapeConfig(shape="sphere", radius=0.03, xyz=(0.0, 0.0, 0.5))
    mesh = Mesh(cubes(tmp_path / "cube.obj", 1.0).file, (0.1, 0.05, -0.02), **there)
    meshes = Solid([box, ball, mesh]).meshes
    assert len(meshes) == 3
    for shape, (vertices, triangles), count in zip(
        [box, ball, box], meshes, (8, 0, 8), strict=True
    ):
        assert np.abs(outside_of(shape, vertices)).max() < 1e-9
        assert len(vertices) == count or not count
        assert set(triangles.ravel()) == set(range(len(vertices)))
        corners = vertices[triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=1).sum() / 2.0
        whole = (
            4.0 * np.pi * 0.03**2 if shape is ball else 0.1 * 0.05 * 2 + 0.1 * 0.04 + 0.05 * 0.04
        )
        assert area == pytest.approx(whole, rel=0.01)


def test_a_primitive_inside_another_is_not_sampled() -> None:
    points, _ = Solid([cube(0.1), cube(0.06)]).samples(SPACING)
    assert len(points) == len(Solid([cube(0.1)]).samples(SPACING)[0])


# Meshes


@pytest.mark.parametrize("flip", [False, True])
def test_normals_point_out_of_a_mesh_whichever_way_its_triangles_face(
    flip: bool, tmp_path: Path
) -> None:
    points, normals = Solid([cubes(tmp_path / "cube.obj", 0.1, flip=flip)]).samples(SPACING)
    points_out([cube(0.1)], points, normals)


def test_what_a_mesh_holds_inside_is_not_sampled(tmp_path: Path) -> None:
    points, _ = Solid([cubes(tmp_path / "cubes.obj", 0.1, 0.05)]).samples(SPACING)
    assert np.abs(outside_of(cube(0.1), points)).max() < 1e-7


def test_an_open_end_of_a_mesh_is_closed(tmp_path: Path) -> None:
    points, normals = Solid([cubes(tmp_path / "box.obj", 0.1, without=TOP)]).samples(SPACING)
    points_out([cube(0.1)], points, normals)
    lid = points[points[:, 2] > 0.05 - 1e-7]
    assert len(lid) * SPACING**2 == pytest.approx(0.01, rel=0.3)


@pytest.mark.parametrize("edge", [0.03, 0.1])
def test_samples_of_a_mesh_are_about_the_spacing_apart(edge: float, tmp_path: Path) -> None:
    points, _ = Solid([cubes(tmp_path / "cube.obj", edge)]).samples(SPACING)
    fine = cube(edge).sampled("link", SPACING / 4).points
    assert np.asarray(KDTree(points).query(fine)[0]).max() < 1.7 * SPACING
    assert len(points) * SPACING**2 == pytest.approx(6 * edge**2, rel=0.35)


def test_a_mesh_is_scaled_turned_and_moved(tmp_path: Path) -> None:
    plain = cubes(tmp_path / "cube.obj", 1.0)
    there: dict[str, Any] = {"xyz": (0.1, 0.2, 0.3), "rpy": (0.4, 0.5, 0.6)}
    mesh = Mesh(plain.file, (0.1, 0.05, -0.02), **there)
    points, normals = Solid([mesh]).samples(SPACING)
    points_out([ShapeConfig(shape="box", size=(0.1, 0.05, 0.02), **there)], points, normals)


def test_a_mesh_and_a_primitive_hide_what_is_inside_the_other(tmp_path: Path) -> None:
    ball = ShapeConfig(shape="sphere", radius=0.03, xyz=(0.0, 0.0, 0.05))
    points, normals = Solid([cubes(tmp_path / "cube.obj", 0.1), ball]).samples(SPACING)
    assert outside_of_all([cube(0.1), ball], points).min() > -ROUND
    points_out([cube(0.1), ball], points, normals)


def test_equal_shapes_give_equal_samples(tmp_path: Path) -> None:
    mesh = cubes(tmp_path / "cube.obj", 0.1)
    for one, other in zip(Solid([mesh]).samples(0.01), Solid([mesh]).samples(0.01), strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("suffix", [".dae", ".gltf", ".GLB", ".fbx", ".step", ""])
def test_a_mesh_of_another_format_is_refused_with_those_that_are_read(
    suffix: str, tmp_path: Path
) -> None:
    path = tmp_path / f"arm{suffix}"
    os.mkfifo(path)  # which is never opened
    with pytest.raises(RobotError, match=f"arm{suffix} is none of .*: .stl, .obj, .ply, .off$"):
        Solid([Mesh(path, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))])


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".off"])
@pytest.mark.parametrize("content", [b"", b"no mesh\n" * 9, b"\x00\xff" * 99])
def test_a_mesh_that_cannot_be_read_is_told_by_name(
    suffix: str, content: bytes, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"arm{suffix}"
    path.write_bytes(content)
    model = built(tmp_path, link("a", f'<mesh filename="{path.name}"/>'))
    capfd.readouterr()
    with pytest.raises(RobotError, match=f"arm{suffix} holds no triangles that can be read"):
        _ = model.parts
    assert capfd.readouterr() == ("", "")


# Materials

PARTS = ("bolt", "Bolt", "nut", "bolt")
"""The materials of the sides of a wedge."""


def wedge(path: Path, library: str) -> Mesh:
    """Write a mesh whose sides are of several materials, and which names their library."""
    sides = ("1 3 2", "1 2 4", "1 4 3", "2 3 4")
    faces = [f"usemtl {part}\nf {side}" for part, side in zip(PARTS, sides, strict=True)]
    corners = ["v 0 0 0", "v 0.1 0 0", "v 0 0.1 0", "v 0 0 0.1"]
    path.write_text("\n".join(["# by hand", library, *corners, *faces]) + "\n", newline="")
    return Mesh(path, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "library",
    [
        "mtllib wedge.mtl",
        "\t mtllib  wedge.mtl \r",
        "mtl\\\nlib wedge.mtl",
        "mtllib \\\nwedge.mtl",
        "# x\rmtllib wedge.mtl",
        "# x\fmtllib wedge.mtl",
        "\0mtllib wedge.mtl",
        "mtllib none.mtl\nmtllib wedge.mtl",
        "mtllib none.mtl\0mtllib wedge.mtl",
        "mtllib ../wedge.mtl",
    ],
)
def test_a_texture_that_a_mesh_names_is_not_opened(library: str, tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    mesh = wedge(tmp_path / "meshes" / "wedge.obj", library)
    for folder in (tmp_path, tmp_path / "meshes"):
        os.mkfifo(folder / "texture.png")
        materials = ("newmtl nut", "map_Kd texture.png", "newmtl bolt\0map_Kd texture.png")
        (folder / "wedge.mtl").write_text("\n".join(materials) + "\n")
    assert len(confined(read_mesh, str(mesh.file), seconds=5.0, memory=2**32)[1]) == 4


@pytest.mark.parametrize("listed", [PARTS, PARTS[::-1], ("nut", "Bolt"), ("other",)])
@pytest.mark.parametrize("library", ["mtllib wedge.mtl", "mtllib C:\\wedge.mtl\r", ""])
def test_without_textures_a_mesh_is_what_it_was_with_them(
    listed: tuple[str, ...], library: str, tmp_path: Path
) -> None:
    mesh = wedge(tmp_path / "wedge.obj", library)
    materials = [
        f"newmtl {part}\nKd 0.{number} 0 0\nmap_Kd x.png" for number, part in enumerate(listed)
    ]
    (tmp_path / "wedge.mtl").write_text("\n".join(materials) + "\n")
    whole = loaded_open3d().io.read_triangle_mesh(str(mesh.file))
    vertices, triangles = read_mesh(str(mesh.file))
    assert np.array_equal(vertices, np.asarray(whole.vertices))
    assert np.array_equal(triangles, np.asarray(whole.triangles))


def test_a_link_to_a_mesh_is_read_as_what_it_leads_to(tmp_path: Path) -> None:
    (tmp_path / "link.off").write_text("OFF\n4 4 0\n0 0 0\n.1 0 0\n0 0.1 0\n0 0 0l 0 0 1\nv")
    (tmp_path / "link.obj").symlink_to("link.off")
    with pytest.raises(RobotError, match="crashes|no triangles"):
        Solid([Mesh(tmp_path / "link.obj", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))])


def test_a_mesh_larger_than_any_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wedge.obj"
    with path.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(
        RobotError, match=r"wedge\.obj can't be read: wedge.obj has 1099511627776 bytes"
    ):
        Solid([Mesh(path, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))])


# Real robots


@pytest.mark.parametrize("name", REAL)
def test_links_of_real_robots_are_sampled_evenly(name: str) -> None:
    model = real(name)
    for part in model.parts.values():
        assert np.allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-9)
        apart = np.asarray(part.tree.query(part.points, k=2)[0])[:, 1]
        assert np.median(apart) > 0.3 * model.config.spacing
        assert np.quantile(apart, 0.99) < 1.5 * model.config.spacing


def test_links_of_the_shipped_arm_are_sampled_on_their_primitives_only() -> None:
    model = real(ARM_HAND)
    for name, part in model.parts.items():
        shapes = [s for s in model.urdf.links[name].collision if isinstance(s, ShapeConfig)]
        distances = np.stack([outside_of(shape, part.points) for shape in shapes])
        assert np.abs(distances).min(axis=0).max() < 1e-9 and distances.min() > -ROUND
        points_out(shapes, part.points, part.normals)


@pytest.mark.parametrize(
    ("facets", "why"),
    [
        ("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "corners that are not finite"),
        ("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "no triangles that can be read"),
        ("v 0 0 0\nv 1 0 0\n", "no triangles that can be read"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99\n", "can't be read|does not hold|no triangles"),
        ("OFF\n4 4 0\n0 0 0\n.1 0 0\n0 0.1 0\n0 0 0l 0 0 1\nv", "crashes|no triangles"),
    ],
)
def test_a_mesh_of_nothing_or_of_no_numbers_is_refused(
    tmp_path: Path, facets: str, why: str
) -> None:
    path = tmp_path / f"link.{'off' if facets.startswith('OFF') else 'obj'}"
    path.write_text(facets)
    with pytest.raises(RobotError, match=why):
        Solid([Mesh(path, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))])
