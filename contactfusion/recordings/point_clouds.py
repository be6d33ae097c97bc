"""The points in a sensor_msgs/PointCloud2, however its bytes are laid out."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.recordings.messages import Message

FLOATS = {7: "f4", 8: "f8"}
"""The types of floats by the numbers that sensor_msgs/PointField gives them."""


def points_of(cloud: Message) -> FloatArray:
    """Give x, y and z of all points, row by row; what is not finite is no return.

    Args:
        cloud: a sensor_msgs/PointCloud2; its fields may come in any order, with gaps between.

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
    """Tell whether there are any points.

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
    """Give the values of a field as they lie in the bytes, shape (height, width)."""
    shape, steps = (cloud.height, cloud.width), (cloud.row_step, cloud.point_step)
    return np.ndarray(shape, _kind(cloud, field), cloud.data, field.offset, steps)


def _kind(cloud: Message, field: Any) -> "np.dtype[Any]":
    return np.dtype((">" if cloud.is_bigendian else "<") + FLOATS[field.datatype])
