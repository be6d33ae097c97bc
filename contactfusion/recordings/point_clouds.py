"""The points in a sensor_msgs/PointCloud2, however its bytes are laid out."""

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
        Shape (height * width, 3) [m].

    Raises:
        RecordingError: there is no x, y or z in floats, or its bytes are not as many as it says.
    """
    order = ">" if cloud.is_bigendian else "<"
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
    layout = {
        "names": list("xyz"),
        "formats": [order + FLOATS[fields[name].datatype] for name in "xyz"],
        "offsets": [fields[name].offset for name in "xyz"],
        "itemsize": cloud.point_step,
    }
    height, width = cloud.height, cloud.width
    needed = (height - 1) * cloud.row_step + width * cloud.point_step if height and width else 0
    try:
        if height > 1 and cloud.row_step < width * cloud.point_step:
            raise ValueError("the rows overlap")
        if len(cloud.data) < needed:
            raise ValueError(f"there are {len(cloud.data)}, and it takes {needed}")
        steps = (cloud.row_step, cloud.point_step)
        # numpy's types know no array over bytes with a record's layout
        grid = np.ndarray((height, width), np.dtype(layout), cloud.data, strides=steps)  # type: ignore[call-overload]
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f"the bytes of the cloud are no {height} rows of {width} points: {error}"
        ) from None
    points = np.stack([grid[name].ravel() for name in "xyz"], axis=1)
    return points.astype(np.float64)
