"""The card that lies beside the weights of networks: what they were trained for, and how well."""

import json
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.files import require_file
from contactfusion.generators.proximity import ProximityConfig
from contactfusion.model import Model

Kinds = tuple[Literal["none"], Literal["point"], Literal["line"]]
KINDS: Kinds = ("none", "point", "line")
"""How an object touches, in the order of the type's outputs."""


class Scale(Model):
    """The range of a quantity in the training set; scaled, it reaches from 0 to 1."""

    minimum: float
    maximum: float

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.maximum <= self.minimum:
            raise ConfigurationError(f"is not above the minimum, {self.minimum:g}", "maximum")
        return self

    def scaled(self, values: ArrayLike) -> FloatArray:
        """Bring values from the range to [0, 1]."""
        return (np.asarray(values, np.float64) - self.minimum) / (self.maximum - self.minimum)

    def unscaled(self, values: ArrayLike) -> FloatArray:
        """Bring values from [0, 1] to the range."""
        return self.minimum + np.asarray(values, np.float64) * (self.maximum - self.minimum)


class NetworksCard(Model):
    """What two networks were trained for, on what, and how well."""

    proximity: ProximityConfig
    """The region, and the cells that give its proximity lengths."""
    window: int = Field(ge=1, le=1000)
    """The lengths of so many instants, one after the other, are looked at together."""
    rate: float = Field(gt=0)
    """Of these instants [Hz]."""
    kinds: Kinds = KINDS
    """In the order of the type's outputs."""
    length: Scale
    """Of the proximity lengths [m]."""
    lateral: Scale
    """Of the location [m]."""
    sigma: dict[str, Annotated[float, Field(gt=0)]]
    """How far the location errs over validation, root mean square, where the true contact is a
    `point` and where it is a `line` [m]."""
    figures: dict[str, float]
    """What was measured of the networks, by names that end in the unit."""
    seeds: dict[str, int]
    """Of the training of each network."""
    data: str
    """What the networks were trained on, in words."""
    data_sha256: str
    weights_sha256: str

    @model_validator(mode="after")
    def _both_kinds(self) -> Self:
        if set(self.sigma) != {"point", "line"}:
            raise ConfigurationError("is to tell of point and line", "sigma")
        return self


def read_card(path: Path) -> NetworksCard:
    """Read a card.

    Raises:
        ConfigurationError: the file is missing, or is no card.
    """
    require_file(path, ConfigurationError)
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        raise ConfigurationError(f"{path} is no JSON text, or is cut off") from None
    if not isinstance(fields, dict):
        raise ConfigurationError(f"{path} holds no card of networks")
    try:
        return NetworksCard(**fields)
    except ConfigurationError as error:
        raise ConfigurationError(error.problem, f"{path}: {error.path}") from None
