"""Configurations: what they refuse, and in which words."""

import math
from pathlib import Path
from typing import Any

import pytest
from pydantic import Field

from contactfusion import IntegratorConfig, PipelineConfig
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model, rooted


class Leg(Model):
    length: float = Field(gt=0)
    """How long [m]."""
    shoe: Path = Path("shoe.yaml")
    """The file of its shoe."""


class Robot(Model):
    name: str
    """Its name."""
    left: Leg = Leg(length=1.0)
    """One leg."""
    others: tuple[Leg, ...] = ()
    """Further legs."""
    named: dict[str, Leg] = {}
    """Legs with names."""
    Weight: float = 1.0
    """[kg]."""


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({}, "name: this field is required"),
        ({"name": "r", "lft": 1}, "lft: unknown field; did you mean 'left'? The fields are: "),
        ({"name": "r", "left": {"lenght": 1}}, "left.lenght: unknown field; did you mean 'length'"),
        ({"name": "r", "zzz": 1}, "zzz: unknown field; the fields are: "),
        ({"name": "r", "left": {"length": -1}}, "left.length: input should be greater than 0"),
        ({"name": "r", "others": [{"length": 1}, {}]}, "others.1.length: this field is required"),
        ({"name": "r", "left": {"length": math.nan}}, "left.length: input should be a finite"),
        ({"name": "r", "left": {"length": math.inf}}, "left.length: input should be a finite"),
        ({"name": "r", "left": {"length": "long"}}, "left.length: input should be a valid number"),
        ({"name": 3, "left": 3}, "name: input should be a valid string, not 3 (and 1 more)"),
    ],
)
def test_an_error_is_one_sentence_that_starts_with_the_path(
    fields: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        Robot(**fields)
    text = str(caught.value)
    assert text.startswith(sentence) and "\n" not in text
    assert caught.value.path == sentence.split(":")[0]


def test_of_several_errors_the_unknown_field_is_told_for_it_explains_the_others() -> None:
    fields: dict[str, Any] = {"nmae": "r"}
    with pytest.raises(ConfigurationError, match=r"nmae: unknown field; .* \(and 1 more\)"):
        Robot(**fields)


def test_an_error_from_within_is_told_as_seen_from_outside() -> None:
    error = ConfigurationError("too long", "length").under("robots.left")
    assert str(error) == "robots.left.length: too long"
    assert str(ConfigurationError("too long").under("left")) == "left: too long"


def test_a_configuration_cannot_be_changed() -> None:
    robot = Robot(name="r")
    with pytest.raises(ValueError, match="frozen"):
        robot.name = "s"


def test_every_field_of_the_integrator_says_what_it_is() -> None:
    assert all(field.description for field in IntegratorConfig.model_fields.values())


@pytest.mark.parametrize(
    "fields",
    [
        {"voxel_size": 0.0},
        {"voxel_size": -0.005},
        {"voxel_size": math.nan},
        {"voxel_size": math.inf},
        {"timeout": 0.0},
        {"timeout": 1e12},
        {"threshold": 0.0},
        {"threshold": 1.1},
        {"tolerance": 0.0},
        {"tolerance": -1.0},
        {"expiry": "never"},
        {"stale_after": 0.0},
        {"max_ahead": -0.1},
        {"frame": ""},
        {"voxelsize": 0.005},
    ],
    ids=str,
)
def test_the_integrator_refuses_what_it_cannot_work_with(fields: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match=next(iter(fields))):
        IntegratorConfig(**fields)


def test_the_threshold_may_be_one() -> None:
    assert IntegratorConfig(threshold=1.0).threshold == 1.0


def test_relative_files_start_at_the_folder_of_the_configuration_also_within() -> None:
    leg = Leg(length=1.0)
    robot = rooted(Robot(name="r", left=leg, named={"third": leg}), Path("/robots"))
    assert robot.left.shoe == robot.named["third"].shoe == Path("/robots/shoe.yaml")
    absolute = Leg(length=1.0, shoe=Path("/shoes/a.yaml"))
    assert rooted(absolute, Path("/robots")).shoe == Path("/shoes/a.yaml")


# The nearest name


@pytest.mark.parametrize(
    ("name", "known", "sentence"),
    [
        ("skni", ["wrist", "skin"], "did you mean 'skin'? The sources are: skin, wrist"),
        ("moon", ["wrist", "skin"], "the sources are: skin, wrist"),
        ("skin", [], "there are no sources"),
        (
            "leftpalm",
            ["leftPalm", "UR5"],
            "did you mean 'leftPalm'? The sources are: UR5, leftPalm",
        ),
    ],
)
def test_a_name_that_is_not_known_gets_those_that_are(
    name: str, known: list[str], sentence: str
) -> None:
    assert name_hint(name, known, "sources") == sentence


def test_further_faults_are_counted_once_however_deep_they_lie() -> None:
    fields: dict[str, Any] = {
        "integrator": {"voxel_size": -1, "threshold": 2},
        "cycle": {"every": -1},
    }
    with pytest.raises(ConfigurationError) as caught:
        PipelineConfig(**fields)
    assert str(caught.value).count("more)") == 1


class Wardrobe(Model):
    shoe: Path = Path("shoe.yaml")
    shoes: tuple[Path, ...] = ()
    named: dict[str, Path] = {}
    folder: Path = Path()
    files_within: Path | None = None


def test_all_names_of_a_bounded_configuration_lie_in_its_folder(tmp_path: Path) -> None:
    home = tmp_path / "home"
    inside = rooted(Wardrobe(), home / "a", within=home)
    assert (inside.shoe, inside.folder) == (home / "a" / "shoe.yaml", home / "a")
    assert inside.files_within == home
    assert rooted(Wardrobe(shoe=Path("../shoe.yaml")), home / "a", within=home)
    for field, value in (
        ("shoe", "../../shoe.yaml"),
        ("shoe", str(home / "shoe.yaml")),
        ("shoes.1", ["b.yaml", "../../shoe.yaml"]),
        ("named.left", {"left": "../../shoe.yaml"}),
        ("folder", "../.."),
    ):
        config = Wardrobe.model_validate({field.split(".")[0]: value})
        with pytest.raises(ConfigurationError) as caught:
            rooted(config, home / "a", within=home)
        assert caught.value.path == field
        rooted(config, home / "a")


def test_a_configuration_does_not_bound_itself_more_widely(tmp_path: Path) -> None:
    config = Wardrobe(files_within=Path("/"))
    assert rooted(config, tmp_path, within=tmp_path).files_within == tmp_path


class Arrival(Model):
    within: float = 0.5


def test_an_option_called_within_is_no_bound(tmp_path: Path) -> None:
    assert rooted(Arrival(), tmp_path, within=tmp_path) == Arrival()
