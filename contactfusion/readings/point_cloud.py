"""Clouds of points: of LiDARs, of laser scanners, of range cameras."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.readings.canvas import Canvas
from contactfusion.readings.codec import Codec
from contactfusion.readings.messages import Message, message
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import PointValues

CLOUD, SCAN = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/LaserScan"
FLOAT32, FLOAT64 = 7, 8
"""What sensor_msgs/PointField calls them."""
FLOATS = {FLOAT32: "f4", FLOAT64: "f8"}
"""The types of floats by the numbers that sensor_msgs/PointField gives them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointCloud(Reading):
    """A cloud of range returns; rows that are not finite are no returns.

    Attributes:
        points: shape (n, 3) [m].
    """

    points: FloatArray

    def _check(self) -> None:
        self._freeze("points", None, 3, finite=False)


class PointCloudCodec(Codec[PointCloud]):
    """Points that a LiDAR or a range camera saw."""

    name = "point_cloud"
    kind = PointCloud
    messages = (CLOUD, SCAN)
    values = PointValues("points")

    def from_message(self, message: Message, at: At) -> PointCloud:
        """The points of a sensor_msgs/PointCloud2, or of a sensor_msgs/LaserScan in its plane."""
        is_scan = message.__msgtype__ == SCAN
        return PointCloud(points=_scanned(message) if is_scan else points_of(message), **at)

    def to_message(self, reading: PointCloud, top: Message) -> Message:
        """A sensor_msgs/PointCloud2 with x, y and z as float32; no returns are kept."""
        with np.errstate(over="ignore"):  # one too large becomes infinite, which is no return
            rows = reading.points.astype("<f4")
        return cloud_message(top, "xyz", rows)

    def draw(self, canvas: Canvas, reading: PointCloud) -> None:
        """The points that are returns."""
        canvas.points(reading.points)

    def example(self, stamp: float, scale: float) -> PointCloud:
        """A square ahead of the sensor."""
        edge = np.linspace(-0.1, 0.1, 8)
        y, z = (axis.ravel() for axis in np.meshgrid(edge, edge))
        points = np.stack([0.4 * scale + 0.0 * y, y, z], axis=1)
        return PointCloud(stamp=stamp, frame="sensor", points=points)


def float_bytes(values: FloatArray) -> NDArray[np.uint8]:
    """Values as the bytes of float32; one too large becomes infinite, which is no return."""
    with np.errstate(over="ignore"):
        return values.astype("<f4").reshape(-1).view(np.uint8)


def _scanned(scan: Message) -> FloatArray:
    """The points of a sensor_msgs/LaserScan, shape (n, 3) [m]; what is out of range is NaN."""
    ranges = scan.ranges.astype(np.float64)
    seen = (ranges >= scan.range_min) & (ranges <= scan.range_max)
    ranges[~seen] = np.nan
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    points = np.zeros((len(ranges), 3))
    points[:, 0], points[:, 1] = ranges * np.cos(angles), ranges * np.sin(angles)
    points[~seen, 2] = np.nan
    return points


def points_of(cloud: Message) -> FloatArray:
    """The points of a sensor_msgs/PointCloud2, row by row; what is not finite is no return.

    Args:
        cloud: its fields may come in any order, with gaps between.

    Returns:
        Shape (height * width, 3) [m], read-only.

    Raises:
        RecordingError: there is no x, y or z in floats, or its bytes are not as many as it says.
    """
    fields = {field.name: field for field in cloud.fields}
    for name in "xyz":
        if name not in fields:
            held = ", ".join(fields) or "none"
            raise RecordingError(f"the cloud has no field '{name}'; its fields are: {held}")
        if fields[name].datatype not in FLOATS:
            raise RecordingError(
                f"'{name}' of the cloud is neither float32 nor float64: "
                f"its type is {fields[name].datatype}"
            )
    is_filled = _holds(cloud, [fields[name] for name in "xyz"])
    height, width = (cloud.height, cloud.width) if is_filled else (0, 0)
    points = np.empty((height * width, 3))
    if len(points):
        grid = points.reshape(height, width, 3)
        with np.errstate(invalid="ignore"):  # NaN that signals is no return, as any other is
            for axis, name in enumerate("xyz"):
                grid[:, :, axis] = _column(cloud, fields[name])
    return points


def _holds(cloud: Message, fields: Sequence[Any]) -> bool:
    """Whether there are any points.

    Raises:
        RecordingError: there are, and the bytes do not hold them.
    """
    height, width = cloud.height, cloud.width
    if not (height and width):
        return False
    row, size = width * cloud.point_step, len(cloud.data)
    needed = (height - 1) * cloud.row_step + row
    wrong = ""
    if height > 1 and cloud.row_step < row:
        wrong = "the rows overlap"
    elif size < needed:
        wrong = f"there are {size}, and it takes {needed}"
    for field in fields:
        if field.offset + _kind(cloud, field).itemsize > cloud.point_step:
            wrong = f"'{field.name}' lies beyond the {cloud.point_step} bytes of a point"
    if wrong:
        raise RecordingError(
            f"the bytes of the cloud are no {height} rows of {width} points: {wrong}"
        )
    return True


def _column(cloud: Message, field: Any) -> Any:
    """The values of a field as they lie in the bytes, shape (height, width)."""
    shape, steps = (cloud.height, cloud.width), (cloud.row_step, cloud.point_step)
    return np.ndarray(shape, _kind(cloud, field), cloud.data, field.offset, steps)


def _kind(cloud: Message, field: Any) -> "np.dtype[Any]":
    return np.dtype((">" if cloud.is_bigendian else "<") + FLOATS[field.datatype])


def cloud_message(top: Message, names: Iterable[str], rows: NDArray[Any]) -> Message:
    """A sensor_msgs/PointCloud2 of numbers alone.

    Args:
        top: its header.
        names: of the k fields.
        rows: a point each, shape (n, k), of float32 or float64, little-endian.
    """
    size, count = rows.itemsize, len(rows)
    kind = FLOAT32 if size == 4 else FLOAT64
    fields = [
        message("sensor_msgs/PointField", name=name, offset=size * i, datatype=kind, count=1)
        for i, name in enumerate(names)
    ]
    step = size * len(fields)
    return message(
        "sensor_msgs/PointCloud2",
        header=top,
        height=1,
        width=count,
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * count,
        data=np.ascontiguousarray(rows).reshape(-1).view(np.uint8),
        is_dense=bool(np.isfinite(rows).all()),
    )
