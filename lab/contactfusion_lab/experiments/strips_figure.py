"""A picture of the region before a robot's face: its points, its strips, and their lengths."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion.generators.proximity import ProximityConfig


def draw_strips(
    title: str, clouds: Mapping[int, FloatArray], config: ProximityConfig, path: Path
) -> None:
    """Draw two clouds of one scene as seen from above, and below them the strips' lengths.

    Args:
        title: what it shows.
        clouds: by the number of rings, shape (n, 3) [m], in the robot's frame.
        config: the region and its cells.
        path: the picture to write.
    """
    figure = new_figure(9.0, 9.5)
    above, bars = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    bounds = 1000.0 * config.bounds()
    low, high = (1000.0 * bound for bound in config.region.x)
    above.vlines(bounds, low, high, color="#cccccc", linewidth=0.6)
    cells = np.linspace(low, high, config.rows + 1)
    above.hlines(cells, bounds[0], bounds[-1], color="#cccccc", linewidth=0.6)
    middles, wide = (bounds[1:] + bounds[:-1]) / 2.0, float(bounds[1] - bounds[0])
    for (rings, points), colour, size, side in zip(
        clouds.items(), COLOURS, (5.0, 12.0), (0.2, -0.2), strict=False
    ):
        x, y, _ = 1000.0 * points[config.region.holds(points)].T
        label = f"{rings} rings, {len(x)} points"
        above.scatter(y, x, s=size, color=colour, linewidths=0, label=label)
        lengths = 1000.0 * config.lengths_of_cloud(points)
        drawn = bars.bar(middles + side * wide, lengths, 0.38 * wide, color=colour)
        bars.bar_label(drawn, fmt="%.0f", fontsize="x-small")
        ends = 1000.0 * config.start + lengths
        label = f"where vectors end, {rings} rings"
        above.hlines(ends, bounds[:-1], bounds[1:], colour, linewidth=3.0, alpha=0.6, label=label)
    above.set(xlim=(bounds[-1], bounds[0]), ylim=(low, high), ylabel="x, away from the face [mm]")
    above.set_title(title, fontsize="medium")
    empty = 1000.0 * config.empty
    bars.axhline(empty, color="#888888", linestyle="--", label="no point in the strip")
    bars.set(xlabel="y, to the left [mm]", ylabel="length of the strip's vector [mm]")
    bars.set_ylim(0.0, 1.1 * empty)
    figure.legend(loc="outside lower center", ncols=3, fontsize="small")
    figure.savefig(path, dpi=120)
