"""Scans of real Ouster sensors: what the proximity descriptor makes of them.

No recording shows a robot, and the pose of the sensor is unknown: for each a pose is assumed
in which near points lie in the region before a robot's face. So the accuracy of the lengths is not
measured. Measured are: whether the descriptor is what plain loops make of the paper's
equations, its time, and the loss when every 4th ring of an OS-0-128 is kept, as an OS-0-32 has.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contactfusion import terminal
from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion.frames import points_in, pose_at
from contactfusion.generators.proximity import ProximityConfig
from contactfusion.readings import PointCloud
from contactfusion.recordings.ouster import COMMAND, convert, is_ready
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import Measure, p50

NAME = "ouster"
REPEATS = 21
"""Repetitions of a scan for the median of its time."""
EXACT = 1e-9
"""Tolerance between loops and arrays, which differ by rounding only [m]."""


@dataclass(frozen=True)
class Scanned:
    """A recording, and the assumed pose of its sensor.

    Attributes:
        file: its name.
        xyz: where the sensor stands in the robot's frame [m].
        yaw: the sensor is turned by this about the vertical [degrees].
        rings: how many its sensor has.
        near: whether any points are near.
    """

    file: str
    xyz: tuple[float, float, float]
    yaw: float
    rings: int = 128
    near: bool = True

    @property
    def stem(self) -> str:
        """Name of the file without its suffix."""
        return Path(self.file).stem

    def __str__(self) -> str:
        x, y, z = self.xyz
        return f"sensor taken to stand at ({x:g}, {y:g}, {z:g}) m, turned by {self.yaw:g}°"


RECORDINGS = (
    Scanned("512x10_raw.bag", (0.1, 0.0, 0.0), -75.0),
    Scanned("windowed_frame1.pcap", (0.1, 0.0, 0.0), -90.0),
    Scanned("OS-0-128_v3.0.1_1024x10_20241017_141645.osf", (-0.1, 0.0, 0.0), 0.0),
    Scanned("OS-0-128-U1_v2.3.0_1024x10.pcap", (0.1, 0.0, 0.1), -130.0),
    Scanned("OS-0-32-U1_v2.2.0_1024x10.pcap", (0.0, 0.0, 0.0), 0.0, rings=32, near=False),
)


def measure(folder: Path, out: Path) -> list[Measure]:
    """Measure the descriptor on each scan, with all rings and with every 4th; draw what is near."""
    if not is_ready():
        terminal.note(f"  left out: Ouster files can be read once this has been run: {COMMAND}")
        return []
    config = ProximityConfig()
    return [
        measured
        for recording in RECORDINGS
        for measured in _measured(folder, out, recording, config)
    ]


def _measured(
    folder: Path, out: Path, recording: Scanned, config: ProximityConfig
) -> list[Measure]:
    """Measure on one recording."""
    terminal.note(f"  {recording.stem}: {recording}")
    whole = _scans(folder, out, recording, 1)
    measures = _figures(recording, recording.rings, whole, config)
    if not recording.near:
        return measures
    thin = _scans(folder, out, recording, 4)
    rings = recording.rings // 4
    measures += _figures(recording, rings, thin, config)
    few, many = config.lengths_of_cloud(thin[-1]), config.lengths_of_cloud(whole[-1])
    apart = np.abs(few - many)
    case = f"{recording.stem}, {rings} rings instead of {recording.rings}"
    measures += [
        _figure(case, "greatest difference of a strip", float(apart.max()), "m", len(apart)),
        _figure(case, "median difference of a strip", p50(apart), "m", len(apart)),
    ]
    if len(whole) > 1:
        before = config.lengths_of_cloud(whole[-2])
        case = f"{recording.stem}, from one scan to the next"
        change = float(np.abs(many - before).max())
        measures.append(_figure(case, "greatest change of a strip", change, "m", len(many)))
    title = f"{recording.stem}, from above\n{recording}"
    clouds = {recording.rings: whole[-1], rings: thin[-1]}
    _draw_strips(title, clouds, config, out / f"ouster_{recording.stem}.png")
    return measures


def _scans(folder: Path, out: Path, recording: Scanned, every_nth_row: int) -> list[FloatArray]:
    """The returns of each scan in the robot's frame, each of shape (n, 3) [m]."""
    source = folder / recording.file
    made = out / "ouster" / f"{recording.stem}_rows_{every_nth_row}.mcap"
    if not made.exists() or made.stat().st_mtime < source.stat().st_mtime:
        convert(source, made, every_nth_row)
    pose = pose_at(recording.xyz, (0.0, 0.0, np.radians(recording.yaw)))
    readings = RosRecording(RosConfig(file=made)).readings()
    clouds = [reading.points for reading in readings if isinstance(reading, PointCloud)]
    return [points_in(pose, points[np.isfinite(points).all(axis=1)]) for points in clouds]


def _figures(
    recording: Scanned, rings: int, scans: list[FloatArray], config: ProximityConfig
) -> list[Measure]:
    """Measures over all scans, and of the content of the last."""
    case = f"{recording.stem}, {rings} rings"
    millimetres = [_in_millimetres(config.lengths_of_cloud(scan)) for scan in scans]
    for number, lengths in enumerate(millimetres, 1):
        terminal.note(
            f"    {rings} rings, scan {number}, lengths from right to left [mm]: {lengths}"
        )
    last = config.lengths_of_cloud(scans[-1])
    wrong = max(
        float(np.abs(config.lengths_of_cloud(scan) - by_loops(scan, config)).max())
        for scan in scans
    )
    took = [_time(scan, config) for scan in scans for _ in range(REPEATS)]
    terminal.note(
        f"    {rings} rings: {p50(np.array(took)):.2f} ms a scan, at most {max(took):.2f} ms"
    )
    inside = int(config.region.holds(scans[-1]).sum())
    occupied = int((last < config.empty).sum())
    note = f"lengths [mm]: {millimetres[-1]}; {recording}"
    count = config.columns
    return [
        _figure(case, "points in the region", inside, "", len(scans[-1])),
        _figure(case, "strips with a point", occupied, "", count, note=note),
        _figure(case, "strips that one point decides", _lonely(scans[-1], config), "", count),
        _figure(case, "difference from plain loops", wrong, "m", len(scans) * count, EXACT),
    ]


def _in_millimetres(lengths: FloatArray) -> str:
    return ", ".join(f"{1000.0 * length:.0f}" for length in lengths)


def _lonely(points: FloatArray, config: ProximityConfig) -> int:
    """Count the strips in whose nearest occupied cell there is a single point."""
    x, y, _ = points[config.region.holds(points)].T
    strips = np.searchsorted(config.bounds(), y, side="right") - 1
    rows = np.floor((x - config.region.x[0]) / config.cell[0])
    depths = [rows[strips == strip] for strip in range(config.columns)]
    return sum(int((rows == rows.min()).sum()) == 1 for rows in depths if rows.size)


def _figure(
    case: str,
    metric: str,
    value: float,
    unit: str,
    n: int,
    asked: float | None = None,
    note: str = "",
) -> Measure:
    """A measure without an interval."""
    return Measure(NAME, case, metric, value, value, value, unit, n, asked, "less", note)


def _time(scan: FloatArray, config: ProximityConfig) -> float:
    """The time of one descriptor [ms]."""
    start = time.perf_counter()
    config.lengths_of_cloud(scan)
    return 1000.0 * (time.perf_counter() - start)


def by_loops(points: FloatArray, config: ProximityConfig) -> FloatArray:
    """The lengths of the strips by the equations as they are printed (O Eq 5-11).

    Args:
        points: shape (n, 3) [m], in the robot's frame; rows that are not finite are no points.
        config: the region and its cells.

    Returns:
        Shape (S,) [m], from right to left.
    """
    box, (deep, wide) = config.region, config.cell
    inside = [
        (x, y)
        for x, y, z in points.tolist()
        if box.x[0] < x < box.x[1] and box.y[0] < y < box.y[1] and box.z[0] < z < box.z[1]
    ]
    start = box.x[0] + deep / 2.0
    lengths = []
    for column in range(round((box.y[1] - box.y[0]) / wide)):
        right, left = box.y[0] + column * wide, box.y[0] + (column + 1) * wide
        strip = [x for x, y in inside if right <= y < left]
        end = box.x[1]
        for row in range(round((box.x[1] - box.x[0]) / deep)):
            low, high = box.x[0] + row * deep, box.x[0] + (row + 1) * deep
            cell = [x for x in strip if low <= x < high]
            if cell:
                end = sum(cell) / len(cell)
                break
        lengths.append(abs(end - start))
    return np.array(lengths)


def _draw_strips(
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
    save_figure(figure, path, dpi=120)
