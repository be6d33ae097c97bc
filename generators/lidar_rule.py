"""Contacts on the face of a base from one LiDAR scan, by a rule without training."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.generator import Generator
from contactfusion.generators.perceived import (
    NEAR,
    FaceGenerator,
    Kind,
    PerceivedConfig,
    Percept,
    nearest_strips,
    points_before,
)
from contactfusion.generators.proximity import ProximityConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import PointCloud, Reading
from contactfusion.state import State
from contactfusion.units import Spread


class RuleProximityConfig(ProximityConfig):
    """The region in front of the face, and its cells as seen from above (O §III-A)."""

    occupied: int = Field(default=2, ge=1)
    """The least number of points in an occupied cell; with 2, one false range is ignored."""


class LidarRuleConfig(PerceivedConfig):
    """The options of `lidar_rule`."""

    proximity: RuleProximityConfig = Field(default_factory=RuleProximityConfig)
    """The region in front of the face, and its cells."""
    touch: Spread = Field(default=0.01, gt=0)
    """The proximity below which an object touches [m]."""
    near: Spread = Field(default=NEAR, ge=0)
    """Strips of an object that are further than its nearest by no more than this touch, too [m]."""


class LidarRuleGenerator(FaceGenerator[LidarRuleConfig]):
    """Regular, multi contact: strips as near as the nearest touch, and l̂ is their middle."""

    Config = LidarRuleConfig
    readings = (PointCloud,)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The contact on the face.

        Raises:
            FrameError: nothing joins the LiDAR's frame to the robot's.
        """
        assert isinstance(reading, PointCloud)
        points = points_before(reading, state, self.config)
        proximity = self.config.proximity
        lengths = proximity.lengths_of_cloud(points)
        percept = self._percept(lengths)
        near = self.config.near
        return (self.face_cloud(reading, state, percept, lengths, proximity, near),)

    def _percept(self, lengths: FloatArray) -> Percept:
        first, last = nearest_strips(lengths, self.config.near)
        proximity = self.config.proximity
        bounds = proximity.bounds()
        lateral = float(bounds[first] + bounds[last + 1]) / 2.0
        if lengths.min() >= self.config.touch:
            kind = Kind.NONE
        else:
            kind = Kind.LINE if last - first > 1 else Kind.POINT
        sigma = proximity.cell[1] / np.sqrt(12.0)
        return Percept(kind, lateral, float(kind != Kind.NONE), sigma)


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[LidarRuleConfig]]]:
    """The rule."""
    return {"lidar_rule": LidarRuleGenerator}
