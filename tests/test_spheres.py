"""Spheres in place of links: they cover what can be touched, and reach out of it by little."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from contactfusion.arrays import FloatArray
from contactfusion.frames import points_in
from contactfusion.robots.model import RobotModel
from contactfusion.robots.solids import Solid
from contactfusion.robots.spheres import SphereModel, fit_spheres
from contactfusion.robots.urdf import Mesh
from contactfusion.shapes import ShapeConfig, unit_vectors
from tests.urdfs import ARM_HAND, KUKA, PANDA, REAL, outside_of_all, real

PROMISED = 0.005
"""No sphere reaches further out of its link [m]."""
PROBES = unit_vectors(1000)


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
