"""Depth images from sensor_msgs/Image, with the camera, the colours and the mask beside them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.readings import DepthImage
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.messages import Message
from contactfusion.recordings.ros.readings import At

DEPTHS = {"32FC1": ("f4", 1.0), "16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3)}
"""By encoding: the type of a pixel, and its unit [m]."""
COLOURS = {
    "rgb8": (3, [0, 1, 2]),
    "bgr8": (3, [2, 1, 0]),
    "rgba8": (4, [0, 1, 2]),
    "bgra8": (4, [2, 1, 0]),
    "mono8": (1, [0, 0, 0]),
}
"""By encoding: the bytes of a pixel, and which of them are red, green and blue."""
INFO, COLOUR, MASK = "camera_info", "colour", "mask"
"""What stands beside a depth image: the last parts of the topics."""


class Beside:
    """What was heard beside the depth images of a camera, of the last two seconds."""

    def __init__(self) -> None:
        self._parts: dict[str, dict[int, Message]] = {INFO: {}, COLOUR: {}, MASK: {}}

    def hear(self, name: str, stamp: int, message: Message) -> None:
        """Keep a message; the last one is kept however old it is.

        Args:
            name: `INFO`, `COLOUR` or `MASK`.
            stamp: that of its header [ns].
            message: sensor_msgs/CameraInfo for `INFO`, else sensor_msgs/Image.
        """
        part = self._parts[name]
        part[stamp] = message
        for old in [one for one in part if one < stamp - 2 * LONGEST_FALL]:
            del part[old]

    def image(self, message: Message, stamp: int, at: At) -> DepthImage:
        """Make a reading of a depth image, its camera as told last, colours of the same stamp.

        Args:
            message: sensor_msgs/Image.
            stamp: that of its header [ns].
            at: stamp [s], frame and sensor of the reading.

        Raises:
            RecordingError: it is no image of depth, or no camera is known.
        """
        depth = depth_of(message)
        infos = self._parts[INFO]
        if not infos:
            raise RecordingError("no camera_info was there by then")
        info = infos[max((one for one in infos if one <= stamp), default=min(infos))]
        if (info.height, info.width) not in ((0, 0), depth.shape):
            raise RecordingError(
                f"its camera_info is of {info.height} x {info.width} pixels, "
                f"and the image has {depth.shape[0]} x {depth.shape[1]}"
            )
        colour, mask = (self._parts[name].get(stamp) for name in (COLOUR, MASK))
        return DepthImage(
            depth=depth,
            intrinsics=info.k.reshape(3, 3),
            colour=colour_of(colour) if _fits(colour, depth) else None,
            mask=colour_of(mask)[:, :, 0] > 0 if _fits(mask, depth) else None,
            **at,
        )


def depth_of(image: Message) -> FloatArray:
    """Give the depths in a sensor_msgs/Image, shape (height, width) [m]; 0 and NaN: no return.

    Raises:
        RecordingError: its encoding is not one of depth, or its bytes are too few.
    """
    if image.encoding not in DEPTHS:
        raise RecordingError(
            f"its encoding {image.encoding} is not one of depth, which are {', '.join(DEPTHS)}"
        )
    kind, unit = DEPTHS[image.encoding]
    pixels = _pixels(image, np.dtype((">" if image.is_bigendian else "<") + kind), 1)
    depth: FloatArray = np.multiply(pixels[:, :, 0], unit, dtype=np.float64)
    return depth


def colour_of(image: Message) -> NDArray[np.uint8]:
    """Give the colours in a sensor_msgs/Image, shape (height, width, 3), RGB in 0..255.

    Raises:
        RecordingError: its encoding is unknown, or its bytes are too few.
    """
    if image.encoding not in COLOURS:
        raise RecordingError(
            f"the encoding {image.encoding} beside it is not one of: {', '.join(COLOURS)}"
        )
    size, order = COLOURS[image.encoding]
    pixels: NDArray[np.uint8] = _pixels(image, np.dtype(np.uint8), size)
    return pixels[:, :, order]


def _pixels(image: Message, kind: "np.dtype[Any]", channels: int) -> NDArray[Any]:
    """Give the pixels as they lie in the bytes, shape (height, width, channels)."""
    height, width, step = image.height, image.width, image.step
    row = width * channels * kind.itemsize
    if not (height and width):
        return np.empty((height, width, channels), kind)
    if step < row or len(image.data) < (height - 1) * step + row:
        raise RecordingError(
            f"its {len(image.data)} bytes are no {height} rows of {width} pixels "
            f"of {image.encoding}, {step} bytes a row"
        )
    steps = (step, channels * kind.itemsize, kind.itemsize)
    return np.ndarray((height, width, channels), kind, image.data, 0, steps)


def _fits(image: Message | None, depth: FloatArray) -> bool:
    return image is not None and (image.height, image.width) == depth.shape
