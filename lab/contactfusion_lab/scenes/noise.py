"""Measurement errors of the sensors of a simulated robot."""

from typing import Any

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.units import ForceNoise, Spread, TorqueNoise

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
NOISES: dict[str, dict[str, Any]] = {
    "none": {"belief": False},
    "prototype": PROTOTYPE,
    "full": PROTOTYPE | HARDER,
}
"""Named sets of errors."""


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
    belief: bool = True
    """Whether believed poses of objects err by `sigma` and `sigma_yaw`; else they are true."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if value not in NOISES:
            raise ConfigurationError(
                f"unknown noise '{value}'; {name_hint(value, NOISES, 'noises')}"
            )
        return NOISES[value]
