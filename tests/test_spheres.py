"""Spheres in place of links cover what can be touched; the cache holds those that are fitted."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.frames import points_in
from contactfusion.robots import spheres
from contactfusion.robots.model import RobotModel
from contactfusion.robots.solids import Solid
from contactfusion.robots.spheres import SphereModel, fit_spheres, fitted_spheres, sphere_folder
from contactfusion.robots.urdf import Mesh, Shapes
from contactfusion.shapes import ShapeConfig, unit_vectors
from tests.urdfs import ARM_HAND, KUKA, PANDA, REAL, outside_of_all, real

PROMISED = 0.005
"""No sphere reaches further out of its link [m]."""
PROBES = unit_vectors(1000)
BALL: Shapes = (ShapeConfig(shape="sphere", radius=0.05),)
BOX: Shapes = (ShapeConfig(shape="box", size=(0.06, 0.05, 0.04)),)
ROBOT = {"ball": BALL, "box": BOX}
NAMES = ("ball", "bare", "box")
CORNERS = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 {}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def on_spheres(spheres: SphereModel, link: str) -> FloatArray:
    """Points on the spheres of a link, shape (n, 3) [m]."""
    own = spheres.links == spheres.link_names.index(link)
    places = spheres.centres[own, None] + spheres.radii[own, None, None] * PROBES
    return np.asarray(places.reshape(-1, 3))


def bare(spheres: SphereModel, link: str, points: FloatArray) -> float:
    """How far a point lies outside all spheres of its link, at most [m]."""
    own = spheres.links == spheres.link_names.index(link)
    away = [
        np.linalg.norm(points - centre, axis=1) - radius
        for centre, radius in zip(spheres.centres[own], spheres.radii[own], strict=True)
    ]
    return float(np.min(away, axis=0).max())


def primitives(model: RobotModel) -> Iterator[tuple[str, list[ShapeConfig]]]:
    for name, link in model.urdf.links.items():
        yield name, [shape for shape in link.collision if isinstance(shape, ShapeConfig)]


def fitted(*shapes: ShapeConfig) -> SphereModel:
    return fit_spheres({"a": Solid(shapes)}, ["a"], 0.008)


# The shipped arm, whose links are primitives: their distances are known exactly


def test_spheres_of_the_shipped_arm_reach_out_no_further_than_they_say() -> None:
    model = real(ARM_HAND)
    reach = [
        outside_of_all(shapes, on_spheres(model.spheres, name)).max()
        for name, shapes in primitives(model)
    ]
    assert max(reach) <= PROMISED
    assert max(reach) == pytest.approx(model.spheres.protrusion, abs=2e-4)


def test_spheres_of_the_shipped_arm_leave_no_more_bare_than_they_say() -> None:
    model = real(ARM_HAND)
    gaps = []
    for name, shapes in primitives(model):
        points = np.concatenate([shape.sampled("link", 0.002).points for shape in shapes])
        points = points[outside_of_all(shapes, points) > -1e-9]
        gaps.append(bare(model.spheres, name, points))
    assert max(gaps) == pytest.approx(model.spheres.gap, abs=3e-4)
    assert max(gaps) < 0.006


# Real arms, whose links are meshes


@pytest.mark.parametrize("name", REAL)
def test_a_real_robot_is_covered_by_spheres(name: str) -> None:
    spheres = real(name).spheres
    assert 0.0 < spheres.protrusion <= PROMISED
    assert 0.0 < spheres.gap < 0.007
    assert len(spheres.radii) < 1500


@pytest.mark.parametrize("name", REAL)
def test_every_link_that_can_be_touched_has_spheres(name: str) -> None:
    model = real(name)
    touched = {link for link, one in model.urdf.links.items() if one.collision}
    assert {model.link_names[row] for row in model.spheres.links} == touched
    assert model.spheres.link_names == model.link_names


@pytest.mark.parametrize("name", [PANDA, KUKA])
def test_no_sphere_reaches_further_out_of_the_hull_of_its_mesh(name: str) -> None:
    import open3d

    model = real(name)
    for number, link in enumerate(model.link_names):
        meshes = [shape for shape in model.urdf.links[link].collision if isinstance(shape, Mesh)]
        if not meshes:
            continue
        vertices = [
            points_in(
                mesh.pose(),
                np.asarray(open3d.io.read_triangle_mesh(mesh.file).vertices) * mesh.scale,
            )
            for mesh in meshes
        ]
        *normals, offsets = ConvexHull(np.concatenate(vertices)).equations.T
        own = model.spheres.links == number
        over = model.spheres.centres[own] @ np.array(normals) + offsets
        assert (over.max(axis=1) + model.spheres.radii[own]).max() <= PROMISED


@pytest.mark.parametrize("name", [PANDA, KUKA])
def test_spheres_of_meshes_leave_no_more_bare_than_they_say(name: str) -> None:
    model = real(name)
    for link, part in model.parts.items():
        assert bare(model.spheres, link, part.points) < model.spheres.gap + 5e-4


# Shapes that are hard to fill


@pytest.mark.parametrize(
    "size",
    [
        (0.1, 0.1, 0.001),
        (0.3, 0.001, 0.001),
        (0.002, 0.002, 0.002),
        (0.1, 0.1, 0.01),
        (0.12, 0.12, 0.12),
    ],
)
def test_what_is_thin_or_small_is_covered_too(size: tuple[float, float, float]) -> None:
    box = ShapeConfig(shape="box", size=size)
    spheres = fitted(box)
    assert outside_of_all([box], on_spheres(spheres, "a")).max() <= PROMISED
    assert bare(spheres, "a", box.sampled("a", 0.002).points) < 0.006


def test_a_large_body_is_covered_by_fewer_points(monkeypatch: pytest.MonkeyPatch) -> None:
    box = ShapeConfig(shape="box", size=(0.3, 0.3, 0.3))
    monkeypatch.setattr("contactfusion.robots.spheres.MOST_POINTS", 1000)
    spheres = fitted(box)
    assert outside_of_all([box], on_spheres(spheres, "a")).max() <= PROMISED
    assert bare(spheres, "a", box.sampled("a", 0.004).points) <= spheres.gap + 0.002 < 0.02


def test_two_bodies_of_one_link_are_both_covered() -> None:
    shapes = [ShapeConfig(shape="sphere", radius=0.03, xyz=(x, 0.0, 0.0)) for x in (-0.1, 0.1)]
    spheres = fitted(*shapes)
    assert set(np.sign(spheres.centres[:, 0])) == {-1.0, 1.0}
    assert outside_of_all(shapes, on_spheres(spheres, "a")).max() <= PROMISED


def test_a_ball_is_few_spheres() -> None:
    assert len(fitted(ShapeConfig(shape="sphere", radius=0.05)).radii) <= 6


def test_a_robot_without_shapes_has_no_spheres() -> None:
    spheres = fit_spheres({}, ["a"], 0.008)
    assert len(spheres.radii) == 0 and spheres.protrusion == spheres.gap == 0.0


def test_equal_links_have_equal_spheres() -> None:
    spheres = real(ARM_HAND).spheres
    one, other = (
        spheres.centres[spheres.links == spheres.link_names.index(f"finger_{n}_distal")]
        for n in (1, 2)
    )
    assert np.array_equal(one, other)


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of its own for each test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "contactfusion" / "spheres"


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The spacings with which spheres were fitted, and not read."""
    spacings: list[float] = []

    def fit(*args: Any) -> SphereModel:
        spacings.append(args[2])
        return fit_spheres(*args)

    monkeypatch.setattr(spheres, "fit_spheres", fit)
    return spacings


def assert_same(one: SphereModel, other: SphereModel) -> None:
    for name in ("centres", "radii", "links"):
        ours, theirs = getattr(one, name), getattr(other, name)
        assert ours.dtype == theirs.dtype and ours.shape == theirs.shape
        assert ours.tobytes() == theirs.tobytes()
    assert (one.link_names, one.protrusion, one.gap) == (
        other.link_names,
        other.protrusion,
        other.gap,
    )


def test_spheres_are_fitted_once_and_are_the_same_bit_for_bit(fits: list[float]) -> None:
    fitted = fit_spheres({name: Solid(one) for name, one in ROBOT.items()}, NAMES, 0.008)
    for _ in range(3):
        assert_same(fitted_spheres(ROBOT, NAMES, 0.008), fitted)
    assert fits == [0.008]


def test_what_spheres_follow_from_is_fitted_anew_when_it_changes(
    fits: list[float], tmp_path: Path
) -> None:
    mesh = tmp_path / "mesh.obj"
    links: list[dict[str, Shapes]] = [{"ball": BALL}, {"ball": BOX}, {"box": BALL}]
    for height in (0.1, 0.11):
        mesh.write_text(CORNERS.format(height))
        there = Mesh(mesh, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        larger = Mesh(mesh, (1.2, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for shape in (there, larger):
            fitted_spheres({"ball": (shape,)}, NAMES, 0.008)
    for one in links:
        fitted_spheres(one, NAMES, 0.008)
    fitted_spheres({"ball": BALL}, NAMES, 0.009)
    fitted_spheres({"ball": BALL}, (*NAMES, "hand"), 0.008)
    assert len(fits) == 4 + 3 + 2


def test_a_mesh_elsewhere_is_the_same_mesh(fits: list[float], tmp_path: Path) -> None:
    for name in ("one.obj", "other.obj"):
        (tmp_path / name).write_text(CORNERS.format(0.1))
        shape = Mesh(tmp_path / name, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        fitted_spheres({"ball": (shape,)}, NAMES, 0.008)
    assert len(fits) == 1


def test_another_version_of_the_algorithm_is_fitted_anew(
    fits: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted_spheres(ROBOT, NAMES, 0.008)
    monkeypatch.setattr(spheres, "version", lambda package: "0.0")
    fitted_spheres(ROBOT, NAMES, 0.008)
    monkeypatch.setattr(spheres, "ALGORITHM", ("robots/model.py",))
    fitted_spheres(ROBOT, NAMES, 0.008)
    assert len(fits) == 3


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def strange(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, centres=np.zeros(3), radii=np.zeros(()), links=[0], reach=[0.0])


@pytest.mark.parametrize("damage", [cut, flip, empty, folder, strange])
def test_a_damaged_cache_is_fitted_anew(
    damage: Callable[[Path], None], fits: list[float], home: Path
) -> None:
    fitted = fitted_spheres(ROBOT, NAMES, 0.008)
    (path,) = home.glob("*.npz")
    damage(path)
    assert_same(fitted_spheres(ROBOT, NAMES, 0.008), fitted)
    assert len(fits) == 2
    assert [one.name for one in home.iterdir()] == [path.name]


def test_a_cache_that_cannot_be_made_is_none(
    fits: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").write_text("in the way")
    fitted_spheres(ROBOT, NAMES, 0.008)
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", _homeless)
    assert sphere_folder() is None
    fitted_spheres(ROBOT, NAMES, 0.008)
    assert len(fits) == 2


def _homeless() -> Path:
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.parametrize("given", ["", "somewhere"])
def test_without_an_absolute_xdg_cache_home_it_lies_in_the_users_home(
    given: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", given)
    assert sphere_folder() == Path.home() / ".cache" / "contactfusion" / "spheres"


def test_a_mesh_that_cannot_be_read_is_refused_as_without_a_cache(tmp_path: Path) -> None:
    gone = Mesh(tmp_path / "gone.obj", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(RobotError, match=r"gone.obj can't be read: No such file"):
        fitted_spheres({"ball": (gone,)}, NAMES, 0.008)
