"""Spheres from the cache are those that are fitted, whatever became of the cache."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import RobotError
from contactfusion.robots import sphere_cache
from contactfusion.robots.solids import Solid
from contactfusion.robots.sphere_cache import fitted_spheres, sphere_folder
from contactfusion.robots.spheres import SphereModel, fit_spheres
from contactfusion.robots.urdf import Mesh, Shapes
from contactfusion.shapes import ShapeConfig

BALL: Shapes = (ShapeConfig(shape="sphere", radius=0.05),)
BOX: Shapes = (ShapeConfig(shape="box", size=(0.06, 0.05, 0.04)),)
ROBOT = {"ball": BALL, "box": BOX}
NAMES = ("ball", "bare", "box")
CORNERS = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 {}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


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

    monkeypatch.setattr(sphere_cache, "fit_spheres", fit)
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
    monkeypatch.setattr(sphere_cache, "version", lambda package: "0.0")
    fitted_spheres(ROBOT, NAMES, 0.008)
    monkeypatch.setattr(sphere_cache, "ALGORITHM", ("robots/model.py",))
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
    with pytest.raises(RobotError, match=r"gone.obj holds no triangles"):
        fitted_spheres({"ball": (gone,)}, NAMES, 0.008)
