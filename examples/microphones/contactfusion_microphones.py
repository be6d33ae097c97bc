"""Microphones on a shell: a kind of reading of their own, and where a tap was heard loudest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

import contactfusion as cf

FloatArray = NDArray[np.float64]
VIOLET = (190, 140, 255)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sound(cf.Reading):
    """How loud it is at each microphone of an array.

    Attributes:
        levels: shape (n,), the sound pressure [Pa].
        positions: shape (n, 3), of the microphones in `frame` [m].
    """

    levels: FloatArray
    positions: FloatArray

    def _check(self) -> None:
        self._freeze("positions", self._freeze("levels", None).size, 3)


class SoundColumns(cf.ColumnsConfig):
    """One column a microphone."""

    positions: tuple[tuple[float, float, float], ...] = Field(min_length=1)
    """Of the microphones, in the order of the columns [m]."""

    def counts(self) -> tuple[int, ...]:
        """As many as microphones."""
        return (len(self.positions),)

    def reading(self, at: Mapping[str, Any], row: FloatArray) -> Sound:
        """The levels of one row."""
        return Sound(levels=row, positions=np.array(self.positions), **at)


class SoundCodec(cf.Codec[Sound]):
    """Sound pressure at the microphones of an array."""

    name = "sound"
    kind = Sound
    messages = ("microphone_msgs/msg/Sound",)
    definition = """
std_msgs/Header header
float64[] levels                 # at each microphone [Pa]
geometry_msgs/Point[] positions  # of the microphones [m]
"""
    settings = ("positions",)
    Columns = SoundColumns
    values = cf.ElementValues("levels")

    def from_message(self, message: Any, at: Mapping[str, Any]) -> Sound:
        """The levels of a microphone_msgs/Sound."""
        positions = np.array([(one.x, one.y, one.z) for one in message.positions])
        return Sound(levels=message.levels, positions=positions.reshape(-1, 3), **at)

    def to_message(self, reading: Sound, top: Any) -> Any:
        """A microphone_msgs/Sound."""
        positions = [
            cf.message("geometry_msgs/Point", x=x, y=y, z=z)
            for x, y, z in reading.positions.tolist()
        ]
        return self.message(header=top, levels=reading.levels, positions=positions)

    def draw(self, canvas: cf.Canvas, reading: Sound) -> None:
        """The microphones, and an arrow towards the loudest."""
        canvas.points(reading.positions, VIOLET, large=True)
        loudest = int(np.argmax(reading.levels))
        direction = reading.positions[loudest] / np.linalg.norm(reading.positions[loudest])
        canvas.arrow("loudest", reading.levels[loudest] * direction, "Pa", VIOLET)

    def example(self, stamp: float, scale: float) -> Sound:
        """Three microphones, the second one the nearest."""
        positions = 0.1 * np.eye(3)
        levels = scale * np.array([0.1, 2.0, 0.3])
        return Sound(stamp=stamp, frame="sensor", levels=levels, positions=positions)


class TapConfig(cf.GeneratorConfig):
    """The options of `tap`."""

    threshold: float = Field(default=0.5, gt=0)
    """The sound pressure of which every second tap is one on the shell [Pa]."""
    spread: float = Field(default=0.01, gt=0)
    """One standard deviation of the distance from the loudest microphone [m]."""


class TapGenerator(cf.Generator[TapConfig]):
    """Regular: a tap is where it is loudest."""

    Config = TapConfig
    readings = (Sound,)

    def generate(self, reading: cf.Reading, state: cf.State) -> Sequence[cf.HypothesisCloud]:
        """The position of the loudest microphone; nothing where all are quiet."""
        assert isinstance(reading, Sound)
        level = float(reading.levels.max(initial=0.0))
        if level <= 0.0:
            return [self.nothing(reading)]
        likelihood = level / (level + self.config.threshold)
        position = reading.positions[np.argmax(reading.levels)]
        return [self.cloud(reading, position, likelihood, spreads=[self.config.spread])]


@cf.hookimpl
def contactfusion_generators() -> Mapping[str, type[cf.Generator[TapConfig]]]:
    """Offer the tap."""
    return {"tap": TapGenerator}
