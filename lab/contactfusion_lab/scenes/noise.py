"""Measurement errors of the sensors of a simulated hand, and how unkind its world is."""

from collections.abc import Mapping
from typing import Any

from pydantic import Field, field_validator, model_validator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.units import ForceNoise, Seconds, Spread, TorqueNoise
from contactfusion_lab.scenes.ranges import AnyRange, Range
from contactfusion_lab.scenes.sensor_errors import Delays, RangeNoise, TaxelNoise

PROTOTYPE: dict[str, Any] = {
    "wrist_place": 0.0026,
    "wrist_turn": 0.3,
    "encoders": 0.2,
    "eye_place": 0.004,
    "eye_turn": 0.3,
    "depth": 0.0025,
    "force": 0.2,
    "torque": 0.01,
    "force_zero": 0.1,
    "torque_zero": 0.005,
    "pressure": 0.02,
}
HARDER = {
    "force_zero": 0.2,
    "torque_zero": 0.01,
    "finger_stiffness": 3.0,
    "flying": 0.02,
    "zeros": 1.0,
}
PARTS: dict[str, dict[str, Any]] = {
    "light": {"press": (1.0, 6.0)},
    "wrist": {
        "force_zero": 0.6,
        "torque_zero": 0.03,
        "force_drift": 0.2,
        "torque_drift": 0.01,
        "crosstalk": 0.02,
        "payload": 0.05,
    },
    "taxels": {"taxels": {"gain": 0.2, "hysteresis": 0.1, "crosstalk": 0.05, "dead": 1}},
    "surface": {"surface": 0.002, "zeros": 1.0},
    # 1 cm and 1 degree, root mean square over all directions
    "mounting": {"eye_place": 0.0058, "eye_turn": 0.58},
    "range": {"ranges": {"bias": 0.01, "mixed": 0.5}, "flying": 0.02},
    "clutter": {"clutter": True},
    "motion": {
        "slide": 0.2,
        "delays": {
            "joints": (0.002, 0.01),
            "skins": (0.01, 0.04),
            "wrenches": (0.002, 0.01),
            "sights": (0.05, 0.12),
        },
    },
}
"""What `hard` adds to `prototype`, part by part."""


def composed(
    name: str, named: Mapping[str, Mapping[str, Any]], parts: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """The fields of a noise: a named set, and parts of `hard`, with "+" between them.

    Args:
        name: such as "prototype", "hard" or "prototype+wrist".
        named: the sets of fields by name; `hard` is `prototype` with all parts.
        parts: of `hard`, by name; later parts replace the fields of earlier ones.

    Raises:
        ConfigurationError: a name is unknown.
    """
    first, *added = name.split("+")
    known = {**named, "hard": named["prototype"]}
    if first not in known:
        raise ConfigurationError(f"unknown noise '{first}'; {name_hint(first, known, 'noises')}")
    for part in added:
        if part not in parts:
            raise ConfigurationError(
                f"unknown part of the noise hard '{part}'; {name_hint(part, parts, 'parts')}"
            )
    fields = dict(known[first])
    for part in parts if first == "hard" else added:
        fields |= parts[part]
    return fields


NOISES: dict[str, dict[str, Any]] = {
    "none": {"belief": False},
    "prototype": PROTOTYPE,
    "full": PROTOTYPE | HARDER,
}
"""Named sets of errors, beside `hard`."""


class TouchNoise(Model):
    """Standard deviations; constant errors are drawn once a run."""

    wrist_place: Spread = Field(default=0.0, ge=0)
    """Of the hand's position by the arm's joints, by axis, constant [m]."""
    wrist_turn: float = Field(default=0.0, ge=0)
    """Of its orientation by them, by axis, constant [degrees]."""
    encoders: float = Field(default=0.0, ge=0)
    """Of the joint encoders of the hand, constant [degrees]."""
    zeros: float = Field(default=0.0, ge=0)
    """Of their zeros, in addition, constant [degrees]."""
    eye_place: Spread = Field(default=0.0, ge=0)
    """Of the extrinsic position of each camera, by axis, constant [m]."""
    eye_turn: float = Field(default=0.0, ge=0)
    """Of its extrinsic orientation, by axis, constant [degrees]."""
    depth: Spread = Field(default=0.0, ge=0)
    """Of the depth of each pixel [m]."""
    flying: float = Field(default=0.0, ge=0, le=1)
    """Share of pixels whose depth is up to 0.3 m before or behind the surface (flying pixels)."""
    force: ForceNoise = Field(default=0.0, ge=0)
    """Of each sample of force, by axis [N]."""
    torque: TorqueNoise = Field(default=0.0, ge=0)
    """Of each sample of torque, by axis [N·m]."""
    force_zero: ForceNoise = Field(default=0.0, ge=0)
    """Of the zero offset of force, by axis, constant [N]."""
    torque_zero: TorqueNoise = Field(default=0.0, ge=0)
    """Of the zero offset of torque, by axis, constant [N·m]."""
    pressure: ForceNoise = Field(default=0.0, ge=0)
    """Of each value of a taxel [N]."""
    finger_stiffness: float = Field(default=10.0, gt=0)
    """Stiffness of the joints of the hand, no deviation [N·m/rad, N/m]."""
    force_drift: ForceNoise = Field(default=0.0, ge=0)
    """Of the rate at which the zero of force moves, by axis, constant [N/min]."""
    torque_drift: TorqueNoise = Field(default=0.0, ge=0)
    """Of the rate at which the zero of torque moves, by axis, constant [N·m/min]."""
    crosstalk: float = Field(default=0.0, ge=0, le=1)
    """Of the share of each component of force in the others, and of each of torque, constant."""
    payload: float = Field(default=0.0, ge=0, le=1)
    """Of the error of the mass that hangs on a wrist, as a share of it, constant."""
    taxels: TaxelNoise = TaxelNoise()
    """Further errors of taxels."""
    ranges: RangeNoise = RangeNoise()
    """Further errors of cameras."""
    surface: Spread = Field(default=0.0, ge=0)
    """Of the true size and position of each shape of the robot, by axis, from those of its
    URDF [m]."""
    delays: Delays = Delays()
    """Delays of readings, drawn from ranges, no deviation."""
    press: AnyRange | None = None
    """Contact force at which the hand stops, in place of the scene's `press` [N]."""
    clutter: bool = False
    """Whether other bodies stand around the object."""
    slide: Seconds = Field(default=0.0, ge=0)
    """Time for which the hand slides sideways at its speed once the contact force is reached; a
    touch ends then, while the hand moves; 0: it ends at rest [s]."""
    belief: bool = True
    """Whether believed poses of objects err by `sigma` and `sigma_yaw`; else they are true."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        return composed(value, NOISES, PARTS)

    @field_validator("press")
    @classmethod
    def _presses(cls, value: Range | None) -> Range | None:
        if value is not None and value[0] <= 0.0:
            raise ValueError("give forces greater than 0")
        return value
