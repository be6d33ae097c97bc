"""Where a range camera sees through, nothing touches (F §III-A: Null)."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import points_in
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.grid import Grid
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import DepthImage, Reading
from contactfusion.state import State

Vector = tuple[float, float, float]
MOST_VOXELS = 2_000_000
"""A region of more voxels is a mistake in its units."""


class FreeSpaceConfig(GeneratorConfig):
    """The options of `free_space`."""

    box: tuple[Vector, Vector] | None = None
    """Two corners of the region to look at, in the frame of the hypothesis space [m]; none: around
    `links`."""
    links: tuple[str, ...] = ()
    """The links of the robot to look around, such as those of the hand; none: all."""
    reach: float = Field(default=0.05, gt=0)
    """How far around the links to look [m]."""
    margin: float = Field(default=0.03, ge=0)
    """What ends so much before a return is free [m]: well over the noise of the camera, the error
    of its place and a voxel's diagonal together."""


class FreeSpaceGenerator(Generator[FreeSpaceConfig]):
    """Null: voxels that the camera sees through, a margin before any return; p = 1.

    A voxel is free when all nine pixels about its centre have a return, and all of them lie behind
    it. No return is not free: glass, black and too near look alike.
    """

    Config = FreeSpaceConfig
    readings = (DepthImage,)
    outputs = {"": HypothesisKind.NULL}

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give the centres of the free voxels.

        Raises:
            ConfigurationError: there is neither a box nor a robot to look around, or the region has
                too many voxels.
            RobotError: no link of a name that is configured.
        """
        assert isinstance(reading, DepthImage)
        places = _centres(*self._region(state), state.grid, self.name)
        to_camera = state.frames.pose(reading.frame, of=state.grid.frame)
        free = places[seen_through(points_in(to_camera, places), reading, self.config.margin)]
        return (self.cloud(reading, free, 1.0, frame=state.grid.frame),)

    def _region(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Give the least and the greatest corner of where to look, shape (3,) [m]."""
        if self.config.box is not None:
            corners = np.array(self.config.box)
            return corners.min(axis=0), corners.max(axis=0)
        points = state.posed_robot(self.name).surface_of(self.config.links).points
        if not len(points):
            raise ConfigurationError(f"the links of '{self.name}' have no surface to look around")
        return points.min(axis=0) - self.config.reach, points.max(axis=0) + self.config.reach


def seen_through(places: FloatArray, image: DepthImage, margin: float) -> NDArray[np.bool_]:
    """Tell which places lie on the way from the camera to what it sees, a margin before it.

    Args:
        places: shape (n, 3) [m], in the camera's frame: x right, y down, z ahead.
        image: the depth image.
        margin: [m], along the optical axis.

    Returns:
        Shape (n,), bool.
    """
    from scipy.ndimage import minimum_filter

    returned = np.where(np.isfinite(image.depth), image.depth, 0.0)
    nearest = minimum_filter(returned, size=3, mode="constant", cval=0.0)
    height, width = nearest.shape
    free = np.zeros(len(places), np.bool_)
    ahead = np.flatnonzero(places[:, 2] > 0.0)
    x, y, z = places[ahead].T
    column = np.round(image.intrinsics[0, 0] * x / z + image.intrinsics[0, 2])
    row = np.round(image.intrinsics[1, 1] * y / z + image.intrinsics[1, 2])
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    depth = nearest[row[inside].astype(np.intp), column[inside].astype(np.intp)]
    free[ahead[inside]] = z[inside] + margin < depth
    return free


def _centres(low: FloatArray, high: FloatArray, grid: Grid, name: str) -> FloatArray:
    """Give the centres of all voxels of a region, shape (n, 3) [m]."""
    first, last = grid.voxels(np.stack([low, high]))
    count = np.prod((last - first + 1).astype(np.float64))
    if count > MOST_VOXELS:
        raise ConfigurationError(
            f"'{name}' would look at {count:.3g} voxels, more than {MOST_VOXELS:.0e}: make its "
            "region smaller, or the voxels larger"
        )
    axes = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
    voxels = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid.centres(voxels)


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[FreeSpaceConfig]]]:
    """Offer the free-space generator."""
    return {"free_space": FreeSpaceGenerator}
