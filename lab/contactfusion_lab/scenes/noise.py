"""How wrong the sensors of a simulated robot are."""

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
"""Noises by name."""


class TouchNoise(Model):
    """Standard deviations; what is constant is drawn once a touch."""

    wrist_place: Spread = Field(default=0.0, ge=0)
    """Of where the arm's joints say that the hand is, by axis, constant [m]."""
    wrist_turn: float = Field(default=0.0, ge=0)
    """Of how they say that it is turned, by axis, constant [degrees]."""
    encoders: float = Field(default=0.0, ge=0)
    """Of the joints of the hand, constant [degrees]."""
    zeros: float = Field(default=0.0, ge=0)
    """Of the zeros of the joints of the hand, besides, constant [degrees]."""
    eye_place: Spread = Field(default=0.0, ge=0)
    """Of where cameras are believed to be, by axis, constant [m]."""
    eye_turn: float = Field(default=0.0, ge=0)
    """Of how they are believed to be turned, by axis, constant [degrees]."""
    depth: Spread = Field(default=0.0, ge=0)
    """Of the depth of each pixel [m]."""
    flying: float = Field(default=0.0, ge=0, le=1)
    """The part of the pixels that tell a depth up to 0.3 m before or behind what is there."""
    force: ForceNoise = Field(default=0.0, ge=0)
    """Of each sample of force, by axis [N]."""
    torque: TorqueNoise = Field(default=0.0, ge=0)
    """Of each sample of torque, by axis [N·m]."""
    force_zero: ForceNoise = Field(default=0.0, ge=0)
    """Of the zero of force, by axis, constant [N]."""
    torque_zero: TorqueNoise = Field(default=0.0, ge=0)
    """Of the zero of torque, by axis, constant [N·m]."""
    pressure: ForceNoise = Field(default=0.0, ge=0)
    """Of each value of a taxel [N]."""
    finger_stiffness: float = Field(default=10.0, gt=0)
    """How the joints of the hand yield [N·m/rad, N/m]."""
    belief: bool = True
    """Whether objects are believed where `sigma` and `sigma_yaw` put them; else where they are."""

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
