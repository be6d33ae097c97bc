"""A push by configuration: object, start, target, and errors of the sensors."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.files import require_file
from contactfusion.model import Model, rooted
from contactfusion.units import Limit, Reach, Spread
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.scenes.push.noise import (
    EXACT_CAMERA,
    EXACT_LIDAR,
    CameraNoise,
    LidarNoise,
    MisplacedConfig,
    PushNoise,
)
from contactfusion_lab.scenes.push.objects import (
    DisturbanceConfig,
    ObjectConfig,
    SoftConfig,
    UrdfObjectConfig,
)

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
    "wedge": {"shape": "prism", "sides": 3, "radius": 0.32, "height": 0.50, "mass": 9.0},
    "cross": {
        "shape": "compound",
        "pieces": (
            {"piece": {"shape": "box", "size": (0.60, 0.16, 0.50), "mass": 6.0}},
            {"piece": {"shape": "box", "size": (0.16, 0.22, 0.50), "mass": 3.0}, "at": (0.0, 0.19)},
            {
                "piece": {"shape": "box", "size": (0.16, 0.22, 0.50), "mass": 3.0},
                "at": (0.0, -0.19),
            },
        ),
    },
    "stool": {
        "shape": "compound",
        "pieces": (
            {
                "piece": {"shape": "cylinder", "radius": 0.22, "height": 0.04, "mass": 3.0},
                "bottom": 0.42,
            },
            *(
                {
                    "piece": {"shape": "cylinder", "radius": 0.03, "height": 0.42, "mass": 1.0},
                    "at": (x, y),
                }
                for x in (-0.15, 0.15)
                for y in (-0.15, 0.15)
            ),
        ),
    },
}
"""Objects on which no parameter was chosen, and of which no network has seen a push. O §V pushed
`lshape`, `real_box`, `soft_cylinder` and a box with a ball of 0.9 kg; values that it does not print
(the foam's stiffness, the size and mass of the box around the ball, the disturbances) are ours.
`light_cylinder` is the soft one, rigid. `wedge`, `cross` and `stool` have shapes (three faces,
hollow corners, legs with gaps between) of which nothing was tuned or trained on any size either."""
FRICTIONS: dict[str, tuple[float, float]] = {"mu1": (0.3, 0.35), "mu2": (0.2, 0.5)}
"""Coefficients between object and ground, and between object and robot (O §III-B)."""
RATE = 240
"""Steps of the physics a second [Hz]."""
Distance = Annotated[float, Field(ge=-100, le=100)]


def _named(value: Any) -> Any:
    """An object; a name stands for the known object."""
    if not isinstance(value, str):
        return value
    known = {**PAPER, **OTHERS}
    if value not in known:
        raise ConfigurationError(f"unknown object '{value}'; {name_hint(value, known, 'objects')}")
    return known[value]


AnyObject = Annotated[ObjectConfig, BeforeValidator(_named)]


class _File(Model):
    object: AnyObject


def named_object(name: str) -> ObjectConfig:
    """The known object of a name.

    Raises:
        ConfigurationError: there is none of that name.
    """
    fields: dict[str, Any] = {"object": name}
    return _File(**fields).object


def read_object(path: Path) -> ObjectConfig:
    """An object from a URDF, or from a YAML file that holds the fields of one.

    Raises:
        ConfigurationError: the file is missing, or holds no object.
    """
    if path.suffix not in (".yaml", ".yml"):
        require_file(path, ConfigurationError)
        return UrdfObjectConfig(shape="urdf", urdf=str(path.resolve()))
    fields: dict[str, Any] = {"object": read_yaml(path)}
    try:
        return rooted(_File(**fields), path.parent).object
    except ConfigurationError as error:
        field = error.path.removeprefix("object").lstrip(".")
        raise ConfigurationError(f"{path}: {ConfigurationError(error.problem, field)}") from None


class FrictionConfig(Model):
    """Coulomb friction between object and ground, and between object and robot."""

    ground: float = Field(gt=0, le=2)
    """Coefficient between object and ground."""
    robot: float = Field(ge=0, le=2)
    """Coefficient between object and robot."""


def _friction(value: Any) -> Any:
    """Frictions; a name stands for the known pair."""
    if not isinstance(value, str):
        return value
    if value not in FRICTIONS:
        hint = name_hint(value, FRICTIONS, "frictions")
        raise ConfigurationError(f"unknown friction '{value}'; {hint}")
    ground, robot = FRICTIONS[value]
    return {"ground": ground, "robot": robot}


class SkinConfig(Model):
    """The skin: its pad, activation and noise."""

    pad: SoftConfig | None = Field(
        default_factory=lambda: SoftConfig(stiffness=10_000.0, damping=400.0)
    )
    """Compliance over the whole height of the front; None: it is hard. Two hard faces rattle: of a
    flat contact now one end touches and now the other."""
    activation: float = Field(default=1.0, ge=0)
    """Least mean force over a cycle at which a taxel responds; below it the taxel reads 0 [N]."""
    noise: float = Field(default=0.05, ge=0)
    """Standard deviation of each value of a taxel [N]."""


class PushConfig(Model):
    """A base pushes an object to a target; the first contact of a nominal start is at (0, 0).

    Frames: `odom` on the floor, x forward at the start; the robot's front is at its x = 0.
    """

    type: Literal["push"] = "push"
    """The kind of scene."""
    object: AnyObject = Field(default_factory=lambda: PAPER["box"], validate_default=True)
    """The object, by name, such as `box` or `soft_cylinder`, or by its fields."""
    friction: Annotated[FrictionConfig, BeforeValidator(_friction)] = Field(
        default="mu1", validate_default=True
    )
    """Friction: `mu1`, `mu2`, or the coefficients `ground` and `robot`."""
    target: tuple[Distance, Distance]
    """Target of the contact, x and y in `odom` [m]."""
    offset: float = Field(default=0.0, ge=-5, le=5)
    """Lateral offset of the object, to the left of the robot's middle [m]."""
    yaw: float = Field(default=0.0, ge=-360, le=360)
    """Yaw of the object at the start [degrees]."""
    gap: Reach = Field(default=0.001, ge=0, le=2)
    """Distance between the robot's front and the object at the start [m]."""
    disturbances: tuple[DisturbanceConfig, ...] = ()
    """Shoves of the object, in addition to its own `disturbed`."""
    skin: SkinConfig = Field(default_factory=SkinConfig)
    """The skin: its pad, activation and noise."""
    sees: tuple[str, ...] = ()
    """The LiDARs and cameras of the robot that are switched on, by name."""
    lidar_noise: LidarNoise = Field(default_factory=LidarNoise)
    """Errors of LiDARs."""
    camera_noise: CameraNoise = Field(default_factory=CameraNoise)
    """Errors of cameras."""
    misplaced: dict[str, MisplacedConfig] = Field(default_factory=dict)
    """Extrinsic errors of LiDARs and cameras that are switched on, by name: their true pose against
    the robot's description."""
    noise: PushNoise = Field(default_factory=PushNoise)
    """Further errors of the sensors, and other bodies: `none`, `prototype`, `hard`, `prototype`
    with parts of `hard`, such as `prototype+odometry+clutter`, or fields."""
    period: float = Field(default=0.1, ge=0.05, le=1)
    """Period of commands and readings: whole steps of the physics, 1/240 s each [s]."""
    window: bool = False
    """Show PyBullet's window; needs a screen."""
    longest: Limit = Field(default=300.0, gt=0)
    """Time limit of the push [s]."""
    longest_lost: Limit = Field(default=150.0, gt=0)
    """Time without contact, in all, after which the push ends [s]."""
    furthest: float = Field(default=6.0, gt=0)
    """Distance of the object from the origin beyond which the push ends [m]."""
    within: Spread = Field(default=0.05, gt=0)
    """Tolerance of the target: a contact so near has arrived [m]."""

    @field_validator("period")
    @classmethod
    def _whole_steps(cls, period: float) -> float:
        if abs(period * RATE - round(period * RATE)) > 1e-6:
            raise ValueError(f"the physics takes {RATE} steps a second; the period is whole steps")
        return period

    @property
    def white(self) -> tuple[SkinConfig, LidarNoise, CameraNoise]:
        """The skin, and the errors of LiDARs and cameras, as far as `noise` leaves them."""
        if self.noise.sensors:
            return self.skin, self.lidar_noise, self.camera_noise
        return self.skin.model_copy(update={"noise": 0.0}), EXACT_LIDAR, EXACT_CAMERA

    @model_validator(mode="after")
    def _reachable(self) -> "PushConfig":
        reach = math.hypot(*self.target)
        if reach > self.furthest - 1.0:
            raise ConfigurationError(
                f"{self.target} is out of reach: a push ends when the object is further than "
                f"`furthest` {self.furthest:g} m away, and the object needs room",
                "target",
            )
        return self
