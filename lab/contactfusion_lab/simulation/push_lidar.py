"""What a LiDAR on the base sees of a push."""

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, vectors_in
from contactfusion.robots.description import LidarConfig
from contactfusion_lab.simulation.push_config import LidarNoise
from contactfusion_lab.simulation.push_view import Planar, PushView


class PushLidar:
    """A spinning LiDAR; a whole turn is measured at once.

    Args:
        config: its rings and reach.
        pose: where it is in the base's frame.
        view: what there is to see.
        noise: how wrong it is.
    """

    def __init__(self, config: LidarConfig, pose: Pose, view: PushView, noise: LidarNoise) -> None:
        self._reach, self._noise, self._view = config.reach, noise, view
        self._directions = directions(config)
        self._rays = view.rays(pose[:3, 3], vectors_in(pose, self._directions))

    def points(self, base: Planar, thing: Planar, rng: np.random.Generator) -> FloatArray:
        """Give all returns, shape (n, 3) [m], in the LiDAR's frame.

        Args:
            base: where the base is.
            thing: where the object is.
            rng: of the noise.
        """
        ranges, noise = self._view.distances(self._rays, base, thing)[0], self._noise
        count = len(ranges)
        measured = ranges + noise.range * rng.standard_normal(count)
        chance = rng.random(count)
        jumping = np.flatnonzero(chance < noise.jumps)
        measured[jumping] += rng.uniform(-noise.jump, noise.jump, len(jumping))
        lost = chance >= 1.0 - noise.dropout
        nearest, farthest = self._reach
        kept = (measured >= nearest) & (measured <= farthest) & ~lost
        points: FloatArray = self._directions[kept] * measured[kept, None]
        return points


def directions(config: LidarConfig) -> FloatArray:
    """Give the direction of each measurement, shape (n, 3), column by column, in its frame."""
    first, last = config.window
    turns = np.arange(-config.columns, config.columns + 1) * 360.0 / config.columns
    turns = np.radians(turns[(turns >= first) & (turns < last)])
    up = np.radians(np.linspace(-config.fov / 2.0, config.fov / 2.0, config.rings))
    turn, rise = (axis.ravel() for axis in np.meshgrid(turns, up, indexing="ij"))
    return np.stack(
        [np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=1
    )
