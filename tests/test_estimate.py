"""What needs more memory than there is, refused before it is made."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline, PipelineConfig
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.estimate import counted, size, too_much
from contactfusion.grid import Grid
from contactfusion.patches import PatchConfig
from contactfusion.robots.solids import Solid
from contactfusion.robots.urdf import Mesh
from contactfusion.shapes import BodyConfig, PartConfig

TRIANGLE = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nf 1 2 3\n"


def pipeline(**generator: Any) -> Pipeline:
    return Pipeline(PipelineConfig(generators={"one": generator}))


def patch(**fields: Any) -> PatchConfig:
    return PatchConfig(**fields)


def body(*shapes: dict[str, Any], spacing: float) -> BodyConfig:
    return BodyConfig(frame="base", spacing=spacing, shapes=tuple(PartConfig(**s) for s in shapes))


@pytest.mark.parametrize(
    ("count", "text"), [(7, "7"), (44_448_889, "44.4 million"), (1e10, "10 billion")]
)
def test_a_number_of_many_is_short(count: float, text: str) -> None:
    assert counted(count) == text


@pytest.mark.parametrize(
    ("memory", "text"), [(500, "0.5 kB"), (8400, "8.4 kB"), (2.9e6, "2.9 MB"), (5.9e9, "5.9 GB")]
)
def test_memory_is_told_in_its_unit(memory: float, text: str) -> None:
    assert size(memory) == f"about {text}"


def test_what_fits_is_no_sentence() -> None:
    assert too_much("a hand", 1e5, 250) == ""


def test_a_surface_in_millimetres_is_refused_before_it_is_sampled() -> None:
    with pytest.raises(ConfigurationError) as caught:
        body({"shape": "rectangle", "size": (20.0, 20.0)}, spacing=0.003)
    assert str(caught.value) == (
        "20 x 20 m at 3 mm spacing is 44.4 million points, about 11 GB, more than 2.5 GB; "
        "sizes are in metres, and a larger spacing needs less"
    )


@pytest.mark.parametrize(
    "shape",
    [
        {"shape": "rectangle", "size": (0.2, 0.1)},
        {"shape": "box", "size": (0.2, 0.1, 0.05)},
        {"shape": "cylinder", "radius": 0.05, "length": 0.2},
        {"shape": "sphere", "radius": 0.08},
    ],
)
def test_the_estimate_is_near_the_number_of_points(shape: dict[str, Any]) -> None:
    given = body(shape, spacing=0.002)
    assert len(given.sampled(Path()).points) == pytest.approx(given.samples(), rel=0.05)


@pytest.mark.parametrize("side", [0.001, 0.0033, 0.01, 1.0])
def test_a_patch_covers_as_many_places_as_it_says(side: float) -> None:
    pads = [
        {"rows": 2, "columns": 3, "pitch": (0.01, 0.02)},
        {"rows": 1, "columns": 1, "pitch": (0.004, 0.005)},
    ]
    given = patch(grids=pads)
    assert given.count(side) == len(given.covered(side)[0])


def test_more_taxels_than_memory_holds_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"grid: the grid is 10 billion taxels, about"):
        patch(grid={"rows": 100_000, "columns": 100_000, "pitch": (0.01, 0.01)})


def test_a_generator_whose_clouds_would_be_too_large_is_refused_when_it_is_plugged() -> None:
    grid = {"rows": 8, "columns": 8, "pitch": (1, 1)}
    with pytest.raises(ConfigurationError) as caught:
        pipeline(type="tactile", patch={"grid": grid})
    assert str(caught.value) == (
        "generators.one: a cloud would hold 2.56 million hypotheses, about 900 MB, more than "
        "2 million, at a voxel_size of 0.005 m; lengths are in metres"
    )
    with pytest.raises(ConfigurationError, match=r"generators.one: a cloud would hold 64"):
        pipeline(type="free_space", box=((0, 0, 0), (2, 2, 2)))


def test_a_generator_without_an_estimate_may_be_plugged() -> None:
    generator = pipeline(type="free_space").generators["one"]
    assert generator.most_hypotheses(Grid("base", 0.005)) is None


def test_an_isolated_generator_has_the_estimate_of_the_one_within() -> None:
    pad = {"grid": {"rows": 1, "columns": 1, "pitch": (0.01, 0.01)}}
    pipe = pipeline(type="tactile", patch=pad, isolate=True)
    try:
        assert pipe.generators["one"].most_hypotheses(pipe.grid) == 4
    finally:
        pipe.close()


def test_a_mesh_in_millimetres_is_refused_with_the_scale_that_it_needs(tmp_path: Path) -> None:
    pytest.importorskip("open3d")
    file = tmp_path / "link.obj"
    file.write_text(TRIANGLE.format(200))
    raw = Mesh(file, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(RobotError) as caught:
        Solid([raw]).samples(0.004)
    assert str(caught.value) == (
        f"{file}: 200 x 200 x 0 m at 4 mm spacing is 2.5 billion points, about 2100 GB, more than "
        '2.5 GB; a mesh in millimetres needs scale="0.001 0.001 0.001"'
    )
    scaled = Mesh(file, (0.001, 0.001, 0.001), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert np.ptp(Solid([scaled]).samples(0.004)[0], axis=0).max() < 0.2


def test_a_shape_of_a_link_in_millimetres_is_refused() -> None:
    with pytest.raises(RobotError, match=r"^200 x 300 m at 4 mm spacing is .* sizes are in metres"):
        Solid([PartConfig(shape="cylinder", radius=100.0, length=300.0)]).samples(0.004)
