"""Free space in the view of a range camera: no contact there (F §III-A: Null)."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import Pose
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.grid import Grid
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import DepthImage, Reading
from contactfusion.state import State
from contactfusion.units import Position, Reach, Spread

MOST_VOXELS = 2_000_000
"""The greatest number of voxels; a larger region is a mistake in its units."""
WINDOWS = (1, 2, 4, 8, 16, 32, 64)
"""Half widths, in pixels, of the windows in which the image is compared with a voxel: the first
that covers it is used. A voxel that is so near that it covers more is not free."""


class FreeSpaceConfig(GeneratorConfig):
    """The options of `free_space`."""

    box: tuple[Position, Position] | None = None
    """Two corners of the region, in the frame of the hypothesis space [m]; None: the region around
    `links`."""
    links: tuple[str, ...] = ()
    """The links of the robot in the region, such as those of the hand; empty: all."""
    reach: Reach = Field(default=0.05, gt=0)
    """Margin of the region around the links [m]."""
    margin: Spread = Field(default=0.03, ge=0)
    """Margin before a return in which space is not free [m]; well above the noise of the camera,
    the error of its pose and a voxel's diagonal together."""


class FreeSpaceGenerator(Generator[FreeSpaceConfig]):
    """Null: voxels that the camera sees through, a margin before any return; p = 1.

    A voxel is free when all pixels that it covers have a return, and all returns lie behind it: at
    least the nine about its centre. A missing return is not free: glass, black and too near look
    alike.
    """

    Config = FreeSpaceConfig
    readings = (DepthImage,)
    outputs = {"": HypothesisKind.NULL}

    def most_hypotheses(self, grid: Grid) -> int | None:
        """The voxels of the box; None around links, since the joints are unknown yet."""
        if self.config.box is None:
            return None
        return round(_count(*_corners(self.config.box), grid))

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The centres of the free voxels.

        Raises:
            ConfigurationError: there is neither a box nor a robot to look around, or the region has
                too many voxels.
            RobotError: no link of a name that is configured.
            FrameError: nothing joins the camera to the hypothesis space.
        """
        assert isinstance(reading, DepthImage)
        axes = _centres(*self._region(state), state.grid, self.name)
        to_camera = state.frames.pose(reading.frame, of=state.grid.frame)
        free = seen_through(axes, to_camera, reading, self.config.margin, state.grid.voxel_size)
        centres = [axis[rows] for axis, rows in zip(axes, np.nonzero(free), strict=True)]
        return (self.cloud(reading, np.stack(centres, axis=1), 1.0, frame=state.grid.frame),)

    def _region(self, state: State) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest corner of the region, shape (3,) [m]."""
        if self.config.box is not None:
            return _corners(self.config.box)
        if state.robot is None:
            raise ConfigurationError(
                f"'{self.name}' needs a `box` to look at, or the robot to look around: configure "
                "`robot`, and see that its joints come and that `frames` join it to the hypothesis "
                "space"
            )
        points = state.robot.surface_of(self.config.links).points
        if not len(points):
            raise ConfigurationError(f"the links of '{self.name}' have no surface to look around")
        return points.min(axis=0) - self.config.reach, points.max(axis=0) + self.config.reach


def seen_through(
    axes: Sequence[FloatArray], to_camera: Pose, image: DepthImage, margin: float, side: float
) -> NDArray[np.bool_]:
    """Which voxels lie between the camera and its returns, a margin before them.

    Args:
        axes: coordinates of their centres along x, y and z [m]; each combination is a voxel.
        to_camera: transforms centres to the camera's frame: x right, y down, z forward.
        image: the depth image.
        margin: [m], along the optical axis.
        side: of a voxel [m].

    Returns:
        Shape (len(x), len(y), len(z)), bool.
    """
    returned = np.where(np.isfinite(image.depth), image.depth, 0.0)
    furthest = returned.max(initial=0.0) - margin
    half = np.sqrt(0.75) * side  # of a voxel's diagonal
    spread = half * _pixels_a_radian(image)
    z = _over_voxels(to_camera[2], axes)
    seen: NDArray[np.bool_] = (z >= half + spread / WINDOWS[-1]) & (z < furthest)
    z = z[seen]
    columns, rows = (
        # voxels outside the image fall on its rim, which is never seen through
        np.rint(_over_voxels(line, axes)[seen] / z).clip(0, size - 1).astype(np.intp)
        for line, size in zip(
            image.intrinsics[:2] @ to_camera[:3], returned.shape[::-1], strict=True
        )
    )
    free = np.zeros(len(z), np.bool_)
    far = np.inf
    for window in WINDOWS:  # in the interval of distances where it is the first that covers
        near = half + spread / window
        here = np.flatnonzero((z >= near) & (z < far))
        if len(here):
            least = _least_about(returned, rows[here], columns[here], window)
            free[here] = z[here] + margin < least
        far = near
    seen[seen] = free
    return seen


def _over_voxels(line: FloatArray, axes: Sequence[FloatArray]) -> FloatArray:
    """a·x + b·y + c·z + d for each voxel; `line` has shape (4,)."""
    (a, b, c, d), (x, y, z) = line, axes
    values: FloatArray = (a * x)[:, None, None] + (b * y)[:, None] + (c * z + d)
    return values


def _pixels_a_radian(image: DepthImage) -> float:
    """Upper bound of the pixels that a ball at a distance of 1 covers per unit of its radius."""
    (focal_x, _, x), (_, focal_y, y), _ = image.intrinsics
    height, width = image.depth.shape
    corner = np.hypot(max(x, width - 1 - x), max(y, height - 1 - y))
    return float(np.hypot(max(focal_x, focal_y), corner))


def _least_about(
    depth: FloatArray, rows: NDArray[np.intp], columns: NDArray[np.intp], window: int
) -> FloatArray:
    """The least depth about pixels, `window` to each side; outside the image it is 0 [m]."""
    from scipy.ndimage import minimum_filter

    top, left = (max(int(each.min()) - window, 0) for each in (rows, columns))
    part = depth[top : rows.max() + window + 1, left : columns.max() + window + 1]
    least: FloatArray = minimum_filter(part, 2 * window + 1, mode="constant", cval=0.0)
    return least[rows - top, columns - left]


def _corners(box: tuple[Position, Position]) -> tuple[FloatArray, FloatArray]:
    """The least and the greatest corner, shape (3,) [m]."""
    corners = np.array(box)
    return corners.min(axis=0), corners.max(axis=0)


def _count(low: FloatArray, high: FloatArray, grid: Grid) -> float:
    """The number of voxels of a region."""
    return float(np.prod(np.ceil((high - low) / grid.voxel_size) + 1.0))


def _centres(low: FloatArray, high: FloatArray, grid: Grid, name: str) -> list[FloatArray]:
    """Coordinates of the centres of a region's voxels along x, y and z [m]."""
    count = _count(low, high, grid)
    if count > MOST_VOXELS:
        raise ConfigurationError(
            f"'{name}' would look at {count:.3g} voxels, more than {MOST_VOXELS:.0e}: make its "
            "region smaller, or the voxels larger"
        )
    first, last = grid.voxels(np.stack([low, high]))
    return [grid.centres(np.arange(a, b + 1)) for a, b in zip(first, last, strict=True)]


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[FreeSpaceConfig]]]:
    """The free-space generator."""
    return {"free_space": FreeSpaceGenerator}
