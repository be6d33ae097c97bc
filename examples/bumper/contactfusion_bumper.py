"""A bumper with one switch: a contact somewhere on its face while it is closed (F Eq 2)."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

import contactfusion as cf

Vector = tuple[float, float, float]


class BumperConfig(cf.GeneratorConfig):
    """A rectangular face, in the frame of the switch's readings."""

    centre: Vector = (0.0, 0.0, 0.0)
    """The middle of the face [m]."""
    u: Vector = (0.0, 0.1, 0.0)
    """Vector from the centre to the middle of an edge [m]."""
    v: Vector = (0.0, 0.0, 0.05)
    """Vector from the centre to the middle of the next edge [m]."""
    spacing: float = Field(default=0.005, gt=0)
    """The greatest distance between neighbouring hypotheses [m]; at most the side of a voxel."""
    probability: float = Field(default=1.0, ge=0, le=1)
    """Probability of a contact when the switch is closed; 1: certain."""


class BumperGenerator(cf.Generator[BumperConfig]):
    """Regular, single contact: uniform over the face, the sum is the probability (F Eq 2)."""

    Config = BumperConfig
    readings = (cf.Switch,)

    def generate(self, reading: cf.Reading, state: cf.State) -> Sequence[cf.HypothesisCloud]:
        """The face while the switch is closed; each position stands for a cell around it."""
        assert isinstance(reading, cf.Switch)
        if not reading.closed:
            return [self.nothing(reading)]
        c = self.config
        centre, u, v = np.array([c.centre, c.u, c.v])
        face = cf.Surface.rectangle(reading.frame, centre, u, v, c.spacing).points
        spreads = np.full(len(face), c.spacing / np.sqrt(12.0))
        share = c.probability / len(face)
        return [self.cloud(reading, face, share, spreads=spreads, single=True)]


@cf.hookimpl
def contactfusion_generators() -> Mapping[str, type[cf.Generator[BumperConfig]]]:
    """The bumper, as a plug-in."""
    return {"bumper": BumperGenerator}
