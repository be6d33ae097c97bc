"""Images of tactile patches: pads, skins, and sheets without taxels."""

from dataclasses import dataclass

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.readings.canvas import Canvas
from contactfusion.readings.codec import Codec
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.messages import Message
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import ElementValues


@dataclass(frozen=True, kw_only=True, eq=False)
class TactileImage(Reading):
    """The values of a tactile patch, in the sensor's own unit.

    Attributes:
        values: shape (n,), one value a taxel or channel, in the order of the patch.
    """

    values: FloatArray

    def _check(self) -> None:
        if isinstance(self.values, np.ndarray):
            self._set("values", self.values.ravel())
        self._freeze("values", None)


class TactileImageColumns(ColumnsConfig):
    """One column a taxel or channel, in the order of the patch."""

    angles = "none"

    def reading(self, at: At, row: FloatArray) -> TactileImage:
        """The image."""
        return TactileImage(values=row, **at)


class TactileImageCodec(Codec[TactileImage]):
    """Values of taxels or channels."""

    name = "tactile_image"
    kind = TactileImage
    messages = ("contactfusion_msgs/msg/TactileImage",)
    Columns = TactileImageColumns
    values = ElementValues("values")

    def from_message(self, message: Message, at: At) -> TactileImage:
        """The image of a contactfusion_msgs/TactileImage."""
        return TactileImage(values=message.values, **at)

    def to_message(self, reading: TactileImage, top: Message) -> Message:
        """A contactfusion_msgs/TactileImage."""
        return self.message(header=top, values=reading.values)

    def draw(self, canvas: Canvas, reading: TactileImage) -> None:
        """The taxels, coloured by their changes."""
        canvas.taxels(reading.values)

    def example(self, stamp: float, scale: float) -> TactileImage:
        """Sixteen taxels, one pressed harder than the other."""
        values = scale * np.linspace(0.0, 100.0, 16)
        return TactileImage(stamp=stamp, frame="sensor", values=values)
