"""What a skin around a base tells of the points that press it."""

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import inverse, points_in
from contactfusion.patches import PatchConfig, TaxelGridConfig
from contactfusion.robots.description import PatchOnLink
from contactfusion_lab.simulation.push_config import SkinConfig
from contactfusion_lab.simulation.push_world import Touches

FACING = np.cos(np.pi / 4.0)
"""A strip feels what presses it steeper than this."""


class PushSkin:
    """Strips of taxels around a base.

    A point presses the two taxels that are nearest to it along the strip, each the more the nearer
    it is; a taxel tells the mean of a cycle, or nothing when that is under its activation.

    Args:
        patch: its grids have one row each, in the frame of the robot.
        config: how well it feels.

    Raises:
        ConfigurationError: the patch is not made of such strips.
    """

    def __init__(self, patch: PatchConfig, config: SkinConfig) -> None:
        if any(grid.rows != 1 for grid in patch.grids) or not patch.grids:
            raise ConfigurationError("a skin around a base is made of `grids` of one row each")
        self._config = config
        self._strips = [(inverse(grid.pose()), grid.columns, grid.pitch[1]) for grid in patch.grids]

    def values(self, touches: Touches, steps: int, rng: np.random.Generator) -> FloatArray:
        """Give the value of each taxel, shape (n,) [N].

        Args:
            touches: what pressed the robot in one cycle.
            steps: how many steps of the physics the cycle had.
            rng: of the noise.
        """
        pressed = []
        for pose, columns, pitch in self._strips:
            felt = -(touches.normals @ pose[2, :3]) > FACING
            along = points_in(pose, touches.points[felt])[:, 1]
            place = (along / pitch + (columns - 1) / 2.0).clip(0.0, columns - 1.0)
            lower = np.minimum(place.astype(np.intp), max(columns - 2, 0))
            upper_share = place - lower
            forces = touches.forces[felt] / steps
            on_lower = np.bincount(lower, forces * (1.0 - upper_share), columns)
            on_upper = np.bincount(
                np.minimum(lower + 1, columns - 1), forces * upper_share, columns
            )
            pressed.append(on_lower + on_upper)
        mean = np.concatenate(pressed)
        mean[mean < self._config.activation] = 0.0
        return mean + self._config.noise * rng.standard_normal(len(mean))


def with_taxels(patch: PatchOnLink, columns: int) -> PatchOnLink:
    """Give a skin whose front has so many taxels, and whose sides have taxels as wide.

    Args:
        patch: its first strip is the front.
        columns: taxels of the front.
    """
    front = patch.grids[0]
    pitch = front.columns * front.pitch[1] / columns

    def divided(grid: TaxelGridConfig) -> TaxelGridConfig:
        count = max(1, round(grid.columns * grid.pitch[1] / pitch))
        return grid.model_copy(update={"columns": count, "pitch": (grid.pitch[0], pitch)})

    return patch.model_copy(update={"grids": tuple(map(divided, patch.grids))})
