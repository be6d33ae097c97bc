"""Objects to push: their masses, their outlines, and what a file says of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion_lab.scenes.push.config import OTHERS, PAPER, named_object, read_object
from contactfusion_lab.scenes.push.objects import (
    ROUND,
    BoxConfig,
    CompoundConfig,
    HollowConfig,
    LShapeConfig,
    ObjectConfig,
    PrismConfig,
    UrdfObjectConfig,
    outlines,
)

ROOT = Path(__file__).parents[2]
KNOWN = [*PAPER, *OTHERS]
MASSES = {
    "box": 20.0,
    "cylinder": 25.0,
    "nonuniform": 15.0,
    "lshape": 3.0,
    "prism": 12.0,
    "light_cylinder": 0.8,
    "real_box": 25.0,
    "soft_cylinder": 0.8,
    "ball_box": 6.0,
    "wedge": 9.0,
    "cross": 12.0,
    "stool": 7.0,
}
HEAVY_CORNER = 0.125 * 10.0 / 15.0
"""10 kg of 15 stand 12.5 cm ahead and to the left."""
PARTS_OF_A_CIRCLE = ROUND / 2.0 * np.sin(2.0 * np.pi / ROUND)
AREAS = {
    "box": [0.16],
    "cylinder": [0.25**2 * PARTS_OF_A_CIRCLE],
    "nonuniform": [0.45**2, 0.1**2 * PARTS_OF_A_CIRCLE],
    "lshape": [0.80 * 0.15, 0.40 * 0.27],
    "prism": [0.3**2 * 1.5 * np.sqrt(3.0)],
    "light_cylinder": [0.5**2 * PARTS_OF_A_CIRCLE],
    "real_box": [0.32 * 0.26],
    "soft_cylinder": [0.5**2 * PARTS_OF_A_CIRCLE],
    "ball_box": [0.4**2, 0.4**2, *2 * [0.4 * 0.015], *2 * [0.37 * 0.015]],
    "wedge": [0.32**2 * 0.75 * np.sqrt(3.0)],
    "cross": [0.60 * 0.16, *2 * [0.16 * 0.22]],
    "stool": [0.22**2 * PARTS_OF_A_CIRCLE, *4 * [0.03**2 * PARTS_OF_A_CIRCLE]],
}


def centre(config: ObjectConfig) -> FloatArray:
    """The centre of mass, from above."""
    assert not isinstance(config, UrdfObjectConfig)
    parts = config.parts()
    place: FloatArray = np.average(
        [part.middle for part in parts], axis=0, weights=[part.mass for part in parts]
    )
    return place


def area(outline: FloatArray) -> float:
    """The area, positive when its corners go counterclockwise."""
    x, y = outline.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


def compound(*pieces: dict[str, Any]) -> CompoundConfig:
    fields: dict[str, Any] = {"shape": "compound", "pieces": pieces}
    return CompoundConfig(**fields)


def written(folder: Path, text: str) -> Path:
    path = folder / "crate.yaml"
    path.write_text(text)
    return path


# Objects that have a name


@pytest.mark.parametrize("name", KNOWN)
def test_masses_and_areas_are_those_that_are_reported(name: str) -> None:
    config = named_object(name)
    assert not isinstance(config, UrdfObjectConfig)
    parts = config.parts()
    assert sum(part.mass for part in parts) == pytest.approx(MASSES[name])
    assert [area(part.outline) for part in parts] == pytest.approx(AREAS[name])
    assert [area(outline) for outline in outlines(config)] == pytest.approx(AREAS[name])


@pytest.mark.parametrize("name", [name for name in KNOWN if name != "nonuniform"])
def test_the_centre_of_mass_is_the_origin(name: str) -> None:
    assert centre(named_object(name)) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_the_nonuniform_box_has_its_weight_in_the_front_left_corner() -> None:
    assert centre(named_object("nonuniform")) == pytest.approx([HEAVY_CORNER, HEAVY_CORNER])


def test_an_unknown_name_is_reported_with_the_nearest() -> None:
    with pytest.raises(ConfigurationError, match="unknown object 'prisma'; did you mean 'prism'"):
        named_object("prisma")


# Shapes


def test_an_l_is_a_bar_and_a_leg_that_touch_and_do_not_overlap() -> None:
    bar, leg = outlines(
        LShapeConfig(shape="lshape", bar=(0.8, 0.15), leg=(0.4, 0.27), height=1, mass=1)
    )
    assert np.ptp(bar, axis=0) == pytest.approx([0.15, 0.80])
    assert np.ptp(leg, axis=0) == pytest.approx([0.40, 0.27])
    assert leg[:, 0].min() == pytest.approx(bar[:, 0].max())
    assert leg[:, 1].max() == pytest.approx(bar[:, 1].max())


@pytest.mark.parametrize("sides", [3, 6, 7])
def test_a_prism_has_a_face_in_front(sides: int) -> None:
    (corners,) = outlines(PrismConfig(shape="prism", sides=sides, radius=0.3, height=1, mass=1))
    assert len(corners) == sides
    assert np.hypot(*corners.T) == pytest.approx(np.full(sides, 0.3))
    forward = np.isclose(corners[:, 0], 0.3 * np.cos(np.pi / sides))
    assert forward.sum() == 2 and corners[~forward, 0].max() < corners[forward, 0].min()


def test_pieces_are_turned_then_moved_and_lifted() -> None:
    box = {"shape": "box", "size": (0.4, 0.2, 0.1), "mass": 2.0}
    post = {"piece": box, "at": (0.5, 0.1), "yaw": 90.0, "bottom": 0.3}
    floor, lifted = compound({"piece": box}, post).parts()
    assert (floor.bottom, lifted.bottom, lifted.height) == (0.0, 0.3, 0.1)
    assert lifted.middle == pytest.approx([0.5, 0.1])
    assert lifted.outline.min(axis=0) == pytest.approx([0.4, -0.1])
    assert lifted.outline.max(axis=0) == pytest.approx([0.6, 0.3])


def test_a_piece_turns_counterclockwise() -> None:
    box = {"shape": "box", "size": (0.4, 0.2, 0.1), "mass": 2.0}
    (part,) = compound({"piece": box, "yaw": 30.0}).parts()
    long_edge = part.outline[1] - part.outline[0]
    assert long_edge == pytest.approx([0.4 * np.cos(np.pi / 6.0), 0.2])


def hollow(**fields: Any) -> HollowConfig:
    defaults = {"shape": "hollow", "size": (0.5, 0.4, 0.3), "wall": 0.02, "mass": 5.0}
    return HollowConfig(**{**defaults, **fields})


def test_a_hollow_box_is_as_large_as_configured_and_has_the_room_that_its_walls_leave() -> None:
    parts = hollow().parts()
    corners = np.concatenate([part.outline for part in parts])
    assert np.ptp(corners, axis=0) == pytest.approx([0.5, 0.4])
    assert max(part.bottom + part.height for part in parts) == pytest.approx(0.3)
    volume = sum(area(part.outline) * part.height for part in parts)
    assert volume == pytest.approx(0.5 * 0.4 * 0.3 - 0.46 * 0.36 * 0.26)
    for part in parts:  # of one stuff, however thick
        assert part.mass / (area(part.outline) * part.height) == pytest.approx(5.0 / volume)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"wall": 0.15}, "^wall: walls of 0.15 m leave no room inside$"),
        (
            {"ball": {"mass": 1.0, "radius": 0.13}},
            "^ball: a ball 0.26 m across does not fit: there are 0.26 m of room$",
        ),
        ({"ball": {"mass": 0.0, "radius": 0.1}}, r"^ball\.mass: .* greater than 0, not 0"),
        ({"soft": {"stiffness": -5.0, "damping": 1.0}}, r"^soft\.stiffness: .* greater than 0"),
        ({"soft": {"stiffness": 5.0, "damping": -1.0}}, r"^soft\.damping: .* greater than or"),
        ({"soft": {"stiffness": 5.0}}, r"^soft\.damping: this field is required$"),
        ({"disturbed": {"count": 0, "force": 9.0}}, r"^disturbed\.count: .* greater than or equal"),
        ({"disturbed": {"count": 1, "force": -9.0}}, r"^disturbed\.force: .* greater than 0, not"),
    ],
)
def test_what_cannot_be_of_a_hollow_box_is_reported(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem) as error:
        hollow(**fields)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "options"),
    [("soft", {"stiffness": 900.0, "damping": 9.0}), ("disturbed", {"count": 2, "force": 9.0})],
)
def test_a_piece_is_neither_soft_nor_disturbed_by_itself(
    name: str, options: dict[str, Any]
) -> None:
    box = {"shape": "box", "size": (1, 1, 1), "mass": 1.0}
    with pytest.raises(ConfigurationError, match=f"piece.{name}: give `{name}` to the whole"):
        compound({"piece": {**box, name: options}})
    fields: dict[str, Any] = {"shape": "compound", "pieces": ({"piece": box},), name: options}
    assert getattr(CompoundConfig(**fields), name).model_dump().items() >= options.items()


def test_an_object_reports_softness_only_when_it_is_soft() -> None:
    """Folders of an experiment hold what objects were; those from before go on."""
    assert set(named_object("cylinder").model_dump()) == {"shape", "radius", "height", "mass"}
    soft = named_object("soft_cylinder").model_dump()
    assert soft["soft"] == {"stiffness": 1500.0, "damping": 30.0} and "disturbed" not in soft


def test_the_real_l_shape_is_that_of_the_paper() -> None:
    """80 x 15 and 40 x 27 cm, 45 cm high (O §V)."""
    config = LShapeConfig(**OTHERS["lshape"])
    assert (config.bar, config.leg, config.height, config.mass) == (
        (0.80, 0.15),
        (0.40, 0.27),
        0.45,
        3.0,
    )


def test_what_hangs_in_the_air_is_refused() -> None:
    box = {"shape": "box", "size": (1, 1, 1), "mass": 1.0}
    with pytest.raises(ConfigurationError, match="^pieces: no piece stands on the floor$"):
        compound({"piece": box, "bottom": 0.1}, {"piece": box, "bottom": 0.2})


# Files


def test_a_file_holds_the_fields_of_an_object(tmp_path: Path) -> None:
    config = read_object(written(tmp_path, "{shape: box, size: [0.3, 0.5, 0.4], mass: 9}"))
    assert config == BoxConfig(shape="box", size=(0.3, 0.5, 0.4), mass=9.0)


def test_a_urdf_is_an_object_and_so_is_a_file_that_names_one(tmp_path: Path) -> None:
    """A relative name starts where the file is, wherever the program was started."""
    urdf = ROOT / "examples" / "objects" / "mug.urdf"
    (tmp_path / "mug.urdf").write_text(urdf.read_text())
    named = read_object(written(tmp_path, "{shape: urdf, urdf: mug.urdf}"))
    for config in (read_object(urdf), named):
        pieces = outlines(config)
        assert len(pieces) == 4 and all(area(piece) > 0.0 for piece in pieces)
        corners = np.concatenate(pieces)
        assert corners[:, 0].min() == pytest.approx(-0.081, abs=1e-4)
        assert corners[:, 0].max() == pytest.approx(0.04, abs=1e-4)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{shape: box, size: [0.3, 0.5], mass: 9}", r"size\.2: this field is required$"),
        ("{shape: box, size: [1, 1, 1], mass: -1}", "mass: input should be greater than 0"),
        ("{shape: prism, sides: 6, radius: 1, height: 1, mass: 1, colour: red}", "colour: unknown"),
        ("{shape: boks}", "'boks' .* expected tags: 'box'"),
        (
            "{shape: compound, pieces: [{piece: {shape: cylinder, radius: 1, height: 1, mass: 1},"
            " bottom: 0.5}]}",
            "pieces: no piece stands on the floor$",
        ),
        ("[1, 2]", "holds a list, where a mapping"),
    ],
)
def test_what_is_wrong_in_a_file_is_reported_with_its_name(
    text: str, problem: str, tmp_path: Path
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigurationError, match=problem) as error:
        read_object(path)
    assert str(error.value).startswith(str(path)) and str(error.value).count(str(path)) == 1
    assert "object." not in str(error.value)


@pytest.mark.parametrize("name", ["crate.yaml", "crate.urdf"])
def test_a_missing_file_is_reported(name: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=f"^there is no file '{name}' in "):
        read_object(tmp_path / name)
