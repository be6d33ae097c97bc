"""Objects to push and frictions by name, and objects from files."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.files import require_file
from contactfusion.model import Model, rooted
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.simulation.push_objects import ObjectConfig, UrdfObjectConfig

PAPER: dict[str, dict[str, Any]] = {
    "box": {"shape": "box", "size": (0.40, 0.40, 0.80), "mass": 20.0},
    "cylinder": {"shape": "cylinder", "radius": 0.25, "height": 0.70, "mass": 25.0},
    "nonuniform": {
        "shape": "compound",
        "pieces": (
            {"piece": {"shape": "box", "size": (0.45, 0.45, 0.60), "mass": 5.0}},
            {
                "piece": {"shape": "cylinder", "radius": 0.10, "height": 0.30, "mass": 10.0},
                "at": (0.125, 0.125),
                "bottom": 0.60,
            },
        ),
    },
}
"""The objects of O Fig 3: the third has its weight in the rear left corner, seen from the robot."""
OTHERS: dict[str, dict[str, Any]] = {
    "lshape": {
        "shape": "lshape",
        "bar": (0.80, 0.15),
        "leg": (0.40, 0.27),
        "height": 0.45,
        "mass": 3.0,
    },
    "prism": {"shape": "prism", "sides": 6, "radius": 0.30, "height": 0.60, "mass": 12.0},
    "light_cylinder": {"shape": "cylinder", "radius": 0.50, "height": 0.65, "mass": 0.8},
    "real_box": {"shape": "box", "size": (0.32, 0.26, 0.47), "mass": 25.0},
    "soft_cylinder": {
        "shape": "cylinder",
        "radius": 0.50,
        "height": 0.65,
        "mass": 0.8,
        "soft": {"stiffness": 1500.0, "damping": 30.0},
    },
    "ball_box": {
        "shape": "hollow",
        "size": (0.40, 0.40, 0.45),
        "wall": 0.015,
        "mass": 6.0,
        "ball": {"mass": 0.9, "radius": 0.11},
        "disturbed": {"count": 3, "force": 30.0},
    },
}
"""Objects that no parameter was chosen on. O §V pushed `lshape`, `real_box`, `soft_cylinder` and a
box with a ball of 0.9 kg; what it does not print (the foam's stiffness, the size and mass of the
box around the ball, how it was disturbed) is ours. `light_cylinder` is the soft one, rigid."""
FRICTIONS: dict[str, tuple[float, float]] = {"mu1": (0.3, 0.35), "mu2": (0.2, 0.5)}
"""Between object and ground, and between object and robot (O §III-B)."""


def _named(value: Any) -> Any:
    """Take the name of a known object for the object."""
    if not isinstance(value, str):
        return value
    known = {**PAPER, **OTHERS}
    if value not in known:
        raise ConfigurationError(f"unknown object '{value}'; {name_hint(value, known, 'objects')}")
    return known[value]


AnyObject = Annotated[ObjectConfig, BeforeValidator(_named)]


class _File(Model):
    thing: AnyObject


def named_object(name: str) -> ObjectConfig:
    """Give a known object.

    Raises:
        ConfigurationError: there is none of that name.
    """
    fields: dict[str, Any] = {"thing": name}
    return _File(**fields).thing


def read_object(path: Path) -> ObjectConfig:
    """Read an object from a URDF, or from a YAML file that holds the fields of one.

    Raises:
        ConfigurationError: the file is missing, or holds no object.
    """
    if path.suffix not in (".yaml", ".yml"):
        require_file(path, ConfigurationError)
        return UrdfObjectConfig(shape="urdf", urdf=str(path.resolve()))
    fields: dict[str, Any] = {"thing": read_yaml(path)}
    try:
        return rooted(_File(**fields), path.parent).thing
    except ConfigurationError as error:
        field = error.path.removeprefix("thing").lstrip(".")
        raise ConfigurationError(f"{path}: {ConfigurationError(error.problem, field)}") from None
