"""Clouds of points and depth images as ROS 2 messages, and the points in clouds of others."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.kernels import REGULAR
from contactfusion.integrator.store import unpack
from contactfusion.readings import DepthImage, PointCloud
from contactfusion.recordings.messages import Message, Posting, message

UINT8, FLOAT32 = 2, 7
"""What sensor_msgs/PointField calls them."""
VOXEL = np.dtype([("place", "<f4", 3), ("likelihood", "<f4"), ("verdict", "u1"), ("", "V3")])
"""A voxel in a cloud, four bytes for each field."""
FLOATS = {7: "f4", 8: "f8"}
"""The types of floats by the numbers that sensor_msgs/PointField gives them."""


def point_cloud(reading: PointCloud, top: Message) -> Message:
    """Sensor_msgs/PointCloud2 with x, y and z as float32; no returns are kept.

    Args:
        reading: the cloud.
        top: the header.
    """
    points = reading.points
    fields = [
        message("sensor_msgs/PointField", name=name, offset=4 * i, datatype=FLOAT32, count=1)
        for i, name in enumerate("xyz")
    ]
    return message(
        "sensor_msgs/PointCloud2",
        header=top,
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points),
        data=_float_bytes(points),
        is_dense=bool(np.isfinite(points).all()),
    )


def is_drawn(fusion: Fusion) -> NDArray[np.bool_]:
    """Which voxels a cloud of them holds: those with evidence, nulled or not."""
    drawn: NDArray[np.bool_] = (fusion.field.entries.bits & REGULAR) > 0
    return drawn


def voxel_cloud(fusion: Fusion, top: Message) -> Message:
    """Sensor_msgs/PointCloud2 of all voxels with evidence, for viewers.

    What is only predicted, or only ruled out, is left out: the robot's motion and a healthy skin
    cover all of it at each step. The fields are x, y, z [m] and `likelihood` as float32, and
    `verdict` as uint8: 1 below the threshold, 2 contact, 3 nulled.

    Args:
        fusion: of one step.
        top: the header, in the frame of the space.
    """
    entries, verdicts = fusion.field.entries, fusion.verdict_codes
    rows = np.flatnonzero(is_drawn(fusion))
    points = np.zeros(len(rows), VOXEL)
    points["place"] = entries.grid.centres(unpack(entries.keys[rows]))
    points["likelihood"] = fusion.field.likelihoods[rows]
    points["verdict"] = verdicts[rows]
    names = [*"xyz", "likelihood", "verdict"]
    kinds = [*[FLOAT32] * 4, UINT8]
    fields = [
        message("sensor_msgs/PointField", name=name, offset=4 * i, datatype=kind, count=1)
        for i, (name, kind) in enumerate(zip(names, kinds, strict=True))
    ]
    return message(
        "sensor_msgs/PointCloud2",
        header=top,
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=VOXEL.itemsize,
        row_step=points.nbytes,
        data=points.view(np.uint8),
        is_dense=True,
    )


def depth_image(reading: DepthImage, topic: str, top: Message) -> Iterator[Posting]:
    """Sensor_msgs/Image in float32 metres, with its camera beside it.

    Viewers look for the camera of .../depth on .../camera_info.

    Args:
        reading: the image; its colours and its mask become images of their own.
        topic: below which all of them go.
        top: the header of all of them.
    """
    height, width = reading.depth.shape
    yield f"{topic}/depth", _image(_float_bytes(reading.depth), "32FC1", (height, width), top)
    yield f"{topic}/camera_info", _camera_info(reading, top)
    if reading.colour is not None:
        yield f"{topic}/colour", _image(reading.colour.ravel(), "rgb8", (height, width), top)
    if reading.mask is not None:
        mask = np.where(reading.mask, np.uint8(255), np.uint8(0)).ravel()
        yield f"{topic}/mask", _image(mask, "mono8", (height, width), top)


def _image(data: NDArray[np.uint8], encoding: str, shape: tuple[int, int], top: Message) -> Message:
    height, width = shape
    return message(
        "sensor_msgs/Image",
        header=top,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=len(data) // height if height else 0,
        data=data,
    )


def _camera_info(reading: DepthImage, top: Message) -> Message:
    height, width = reading.depth.shape
    whole = message(
        "sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return message(
        "sensor_msgs/CameraInfo",
        header=top,
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=reading.intrinsics.ravel(),
        r=np.eye(3).ravel(),
        p=np.column_stack([reading.intrinsics, np.zeros(3)]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=whole,
    )


def _float_bytes(values: FloatArray) -> NDArray[np.uint8]:
    """Values as the bytes of float32; one too large becomes infinite, which is no return."""
    with np.errstate(over="ignore"):
        return values.astype("<f4").reshape(-1).view(np.uint8)


def points_of(cloud: Message) -> FloatArray:
    """X, y and z of all points, row by row; what is not finite is no return.

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
