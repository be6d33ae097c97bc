"""One trial of the iCub grasp set: five fingers of twelve taxels, and the encoders of the hand.

The set is H. Soh, Y. Su, Y. Demiris, "Online spatio-temporal Gaussian process experts with
application to tactile classification", IROS 2012.
"""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.files import require_file
from contactfusion.hooks import hookimpl
from contactfusion.model import Model
from contactfusion.readings import JointState, Reading, TactileImage
from contactfusion.recordings.recording import RecordingFormat
from contactfusion.recordings.series import Series, even_stamps, merged
from contactfusion.units import Period

FINGERS = ("thumb", "index", "middle", "ring", "little")
JOINTS = (
    "hand_finger",
    "thumb_oppose",
    "thumb_proximal",
    "thumb_distal",
    "index_proximal",
    "index_distal",
    "middle_proximal",
    "middle_distal",
    "pinky",
)
"""Joints 7 to 15 of the arm, in the order of the encoders; `pinky` bends ring and little finger."""
FIRST_LINE = "-10000"
WIDTHS = (len(JOINTS), len(FINGERS), *[12] * len(FINGERS))
"""Cells in each of the seven lines of a frame: encoders, maxima, then the taxels of each finger."""


class IcubConfig(Model):
    """A trial of the iCub grasp set."""

    file: Path
    """The text file of the trial."""
    period: Period = Field(default=0.1, gt=0)
    """The time from frame to frame [s]; nominal, as the files hold no stamps."""


@final
class IcubRecording(RecordingFormat):
    """The readings of one trial of the iCub grasp set.

    Each frame gives a `JointState` of the sensor `hand` (frame `hand`, [rad]) and a `TactileImage`
    of each finger (sensor and frame `thumb`, `index`, `middle`, `ring`, `little`), with its 12
    values as recorded: 0 to 255, about 243 untouched, falling under pressure. The second line of a
    frame, maxima of different moments, is left out. The files hold no stamps:
    frames are `period` apart (0.1 s, a nominal value).

    Args:
        config: the file and the period.
        folder: that of a relative file name.

    Raises:
        RecordingError: the file is missing, cut off, or no trial of the set.
    """

    Config = IcubConfig
    suffixes = (".txt",)

    def __init__(self, config: IcubConfig, folder: Path = Path()) -> None:
        path = folder / config.file
        frames = _frames(path)
        stamps = even_stamps(len(frames), 1.0 / config.period)
        shared: dict[str, Any] = {
            "origin": str(path),
            "stamps": stamps,
            "rows": np.arange(len(frames)) + 1,
        }
        joints = np.radians(frames[:, : len(JOINTS)])
        self._series = [Series(values=joints, make=_joint_state, **shared)]
        self.topics: Mapping[str, type[Reading]] = {
            "hand": JointState,
            **dict.fromkeys(FINGERS, TactileImage),
        }
        for finger, taxels in zip(FINGERS, np.split(frames[:, 14:], 5, axis=1), strict=True):
            make = partial(_tactile_image, finger)
            self._series.append(Series(values=taxels, make=make, **shared))

    @classmethod
    def opened(cls, config: IcubConfig, folder: Path) -> "IcubRecording":
        """The recording in the file."""
        return cls(config, folder)

    def readings(self) -> Iterator[Reading]:
        """Frame by frame, the joints and then the fingers from thumb to little finger."""
        return merged(self._series, self.epoch_ns)


def _joint_state(stamp: float, row: FloatArray) -> Reading:
    return JointState(stamp=stamp, frame="hand", sensor="hand", names=JOINTS, positions=row)


def _tactile_image(finger: str, stamp: float, row: FloatArray) -> Reading:
    return TactileImage(stamp=stamp, frame=finger, sensor=finger, values=row)


def _frames(path: Path) -> NDArray[np.float64]:
    """The numbers of each frame, shape (n, 74)."""
    require_file(path, RecordingError)
    try:
        first, *lines = path.read_text(encoding="utf-8").split("\n")
    except UnicodeDecodeError:
        first, lines = "", []
    if first.strip() != FIRST_LINE:
        raise RecordingError(f"{path} is no trial of the iCub grasp set: it must start with -10000")
    if lines and lines[-1].strip():
        raise RecordingError(
            f"{path} is cut off: line {len(lines) + 1} does not end, and so may its last number"
        )
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines or len(lines) % len(WIDTHS):
        raise RecordingError(
            f"{path} is cut off: {len(lines)} lines are no whole number of frames of {len(WIDTHS)}"
        )
    numbers: list[float] = []
    for row, line in enumerate(lines):
        cells, width = line.split(), WIDTHS[row % len(WIDTHS)]
        if len(cells) != width:
            raise RecordingError(f"{path}, line {row + 2}: {len(cells)} numbers instead of {width}")
        try:
            numbers.extend(float(cell) for cell in cells)
        except ValueError as error:
            raise RecordingError(f"{path}, line {row + 2}: {error}") from None
    return np.array(numbers).reshape(-1, sum(WIDTHS))


@hookimpl
def contactfusion_recordings() -> dict[str, type[RecordingFormat]]:
    """The recording."""
    return {"icub": IcubRecording}
