"""Depth images, with the colours and the mask of the same view."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.readings.canvas import Canvas
from contactfusion.readings.codec import Codec
from contactfusion.readings.messages import Message, Posting, message
from contactfusion.readings.point_cloud import float_bytes
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import MOVE_ITS_FRAME, Elements, Values

IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
DEPTH, INFO, COLOUR, MASK = "depth", "camera_info", "colour", "mask"
"""The last parts of the topics of a depth image and of what stands beside it."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthImage(Reading):
    """A depth image; 0 and NaN are no return.

    Attributes:
        depth: shape (h, w) [m], along the optical axis.
        intrinsics: shape (3, 3), the camera matrix [pixels].
        colour: shape (h, w, 3), RGB in 0..255, or None.
        mask: shape (h, w), True on the object of interest, or None.
    """

    depth: FloatArray
    intrinsics: FloatArray
    colour: NDArray[np.uint8] | None = None
    mask: NDArray[np.bool_] | None = None

    def _check(self) -> None:
        height, width = self._freeze("depth", None, None, finite=False).shape
        self._freeze("intrinsics", 3, 3)
        if self.colour is not None:
            self._freeze("colour", height, width, 3, dtype=np.uint8)
        if self.mask is not None:
            self._freeze("mask", height, width, dtype=np.bool_)


class DepthValues(Values[DepthImage]):
    """The depths; colours and mask stay."""

    senseless = MOVE_ITS_FRAME
    counts = (1,)
    meaning = "1 number: depth [m]"

    def zeroed(self, reading: DepthImage) -> DepthImage:
        """No return anywhere."""
        return replace(reading, depth=np.zeros_like(reading.depth))

    def changes(
        self, reading: DepthImage, amount: Sequence[float], elements: Elements
    ) -> FloatArray:
        """A number for each pixel, shape (h, w)."""
        return np.broadcast_to(np.array(amount, dtype=np.float64), reading.depth.shape)

    def added(self, reading: DepthImage, change: FloatArray) -> DepthImage:
        """Pixels without a return keep none, and one that would get 0 or less loses it."""
        depth = reading.depth
        shifted = np.where(depth > 0.0, np.maximum(depth + change, 0.0), depth)
        return replace(reading, depth=shifted)


class DepthImageCodec(Codec[DepthImage]):
    """Depths that a range camera saw."""

    name = "depth_image"
    kind = DepthImage
    messages = (IMAGE,)
    settings = ("intrinsics",)
    values = DepthValues()

    def from_message(self, message: Message, at: At) -> DepthImage:
        """The depths of a sensor_msgs/Image; `at` holds what is reported beside it."""
        return DepthImage(depth=depth_of(message), **at)

    def to_message(self, reading: DepthImage, top: Message) -> Message:
        """A sensor_msgs/Image in float32 metres."""
        return self._image(float_bytes(reading.depth), "32FC1", reading, top)

    def postings(self, reading: DepthImage, topic: str, top: Message) -> Iterator[Posting]:
        """The image, with its camera, its colours and its mask beside it.

        Viewers look for the camera of .../depth on .../camera_info.
        """
        yield f"{topic}/{DEPTH}", self.to_message(reading, top)
        yield f"{topic}/{INFO}", _camera_info(reading, top)
        if reading.colour is not None:
            yield f"{topic}/{COLOUR}", self._image(reading.colour.ravel(), "rgb8", reading, top)
        if reading.mask is not None:
            mask = np.where(reading.mask, np.uint8(255), np.uint8(0)).ravel()
            yield f"{topic}/{MASK}", self._image(mask, "mono8", reading, top)

    def draw(self, canvas: Canvas, reading: DepthImage) -> None:
        """The image, and the points that it saw."""
        canvas.depth_image(reading.depth, reading.intrinsics, reading.colour)

    def example(self, stamp: float, scale: float) -> DepthImage:
        """A wall, all of it of interest."""
        return DepthImage(
            stamp=stamp,
            frame="sensor",
            depth=np.full((48, 64), 0.5 * scale),
            intrinsics=np.array([[60.0, 0.0, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]]),
            colour=np.full((48, 64, 3), 128, np.uint8),
            mask=np.ones((48, 64), np.bool_),
        )

    def _image(
        self, data: NDArray[np.uint8], encoding: str, reading: DepthImage, top: Message
    ) -> Message:
        height, width = reading.depth.shape
        return self.message(
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


def require_depth(image: Message) -> None:
    """Make sure that a sensor_msgs/Image is one of depth.

    Raises:
        RecordingError: its encoding is another.
    """
    if image.encoding not in DEPTHS:
        raise RecordingError(
            f"its encoding {image.encoding} is not one of depth, which are {', '.join(DEPTHS)}"
        )


def depth_of(image: Message) -> FloatArray:
    """The depths in a sensor_msgs/Image, shape (height, width) [m]; 0 and NaN: no return.

    Raises:
        RecordingError: its encoding is not one of depth, or its bytes are too few.
    """
    require_depth(image)
    kind, unit = DEPTHS[image.encoding]
    pixels = _pixels(image, np.dtype((">" if image.is_bigendian else "<") + kind), 1)
    depth: FloatArray = np.multiply(pixels[:, :, 0], unit, dtype=np.float64)
    return depth


def colour_of(image: Message) -> NDArray[np.uint8]:
    """The colours in a sensor_msgs/Image, shape (height, width, 3), RGB in 0..255.

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
    """The pixels as they lie in the bytes, shape (height, width, channels)."""
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
