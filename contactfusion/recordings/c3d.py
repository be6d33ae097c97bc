"""C3D: force plates, markers and events of motion capture, read with ezc3d (extra `c3d`)."""

import lzma
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from itertools import zip_longest
from pathlib import Path
from typing import Any, final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.confined import MEMORY, confined
from contactfusion.errors import RecordingError, cause_of, missing_extra
from contactfusion.files import require_file
from contactfusion.frames import FrameConfig
from contactfusion.hooks import hookimpl
from contactfusion.model import Model
from contactfusion.readings import Markers, Reading, Transform, Wrench
from contactfusion.recordings.c3d_content import content
from contactfusion.recordings.recording import RecordingFormat
from contactfusion.recordings.series import LEAST_RATE, Series, even_stamps, merged
from contactfusion.time import to_nanoseconds
from contactfusion.unpacking import TIMES, require_zip

LAB = "lab"
"""The frame of the laboratory, in which markers and corners are."""
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
NEWTON_METRES = {"nm": 1.0, "ncm": 0.01, "nmm": 0.001}
NOT_POINTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")
"""Parameters that list points that are results of a model of the body."""
SECONDS = 5.0
"""The time that the reading of a small file may take [s]."""
SLOWEST = 1e6
"""The least speed of reading a large one, a tenth of what is usual [bytes/s]."""
BIG_ENDIAN = 86
"""The byte by which a C3D declares big-endian numbers."""


class C3DConfig(Model):
    """A C3D recording."""

    file: Path
    """A `.c3d`, or a `.zip` that holds one."""


@dataclass(frozen=True)
class MotionEvent:
    """A marked event of a motion recording.

    Attributes:
        stamp: on the clock of the readings [s].
        label: its kind, e.g. "Foot Strike".
        context: the side, e.g. "Left"; may be empty.
    """

    stamp: float
    label: str
    context: str


@final
class C3DRecording(RecordingFormat):
    """The force plates and markers of a C3D file.

    Each sample of a plate gives a `Wrench` of the sensor `plate_0`, `plate_1`, … in the frame of
    that name, which is parallel to the lab frame with its origin at the centre of the plate's
    surface. The plate stands for the robot: force and torque are those of the world on the plate,
    so that a person on it presses down. (Files and ezc3d hold the reaction, of the plate on the
    body; both are reversed here.) Each frame of the cameras gives a `Markers` reading of the
    sensor `markers` in the frame `lab`; a lost marker is NaN. Points that the file lists as angles,
    forces, moments or powers are left out.

    The clock starts with the original trial: `epoch_ns` is where this file was cut from it.

    Args:
        config: the file.
        folder: that of a relative file name.

    Raises:
        RecordingError: the file is missing, cut off, no C3D, or has a plate that can't be read.
        DependencyError: ezc3d is not installed.
    """

    Config = C3DConfig
    suffixes = (".c3d", ".zip")

    def __init__(self, config: C3DConfig, folder: Path = Path()) -> None:
        path = folder / config.file
        with _unpacked(path) as unpacked:
            held = _content(path, unpacked)
        try:
            self._take(path, held)
        except RecordingError:
            raise
        except Exception as error:  # of many kinds: parameters have any type and shape
            raise RecordingError(
                f"{path} holds what is no C3D: {cause_of(error, C3DRecording)}"
            ) from None

    def _take(self, path: Path, held: Any) -> None:
        parameters, points = held["parameters"], held["header"]["points"]
        rate = float(points["frame_rate"])
        if rate < LEAST_RATE:
            raise RecordingError(f"{path} gives no rate of its frames")
        start = int(points["first_frame"]) / rate
        self.epoch_ns = to_nanoseconds(start)
        self.corners: dict[str, FloatArray] = {}
        """By the frame of the plate: its corners in the lab frame, shape (4, 3) [m]."""
        self.events = _events(parameters, start)
        """The marked events, in order of time."""
        self._series = []
        topics: dict[str, type[Reading]] = {}
        self.topics: Mapping[str, type[Reading]] = topics
        metres = _metres(path, parameters)
        names = _marker_names(parameters)
        positions = held["data"]["points"][:3, list(names)].transpose(2, 1, 0) * metres
        if positions.size:
            make = partial(_markers, tuple(names.values()))
            self._series.append(_sampled(path, positions, rate, start, make))
            topics["markers"] = Markers
        rate = float(held["header"]["analogs"]["frame_rate"])
        for index, plate in enumerate(held["data"].get("platform", ())):
            name = f"plate_{index}"
            self.corners[name] = plate["corners"].T * metres
            torque_scale = _torque_scale(path, parameters, index, plate)
            reaction = np.hstack([plate["force"].T, plate["moment"].T * torque_scale])
            self._series.append(_sampled(path, -reaction, rate, start, partial(_wrench, name)))
            topics[name] = Wrench

    @classmethod
    def opened(cls, config: C3DConfig, folder: Path) -> "C3DRecording":
        """The recording in the file."""
        return cls(config, folder)

    def readings(self) -> Iterator[Reading]:
        """The readings in order of their stamps; of one stamp, markers come first.

        Before all, a static transform gives the pose of each plate in the lab frame.
        """
        for name, frame in self.frames().items():
            yield Transform(
                stamp=0.0,
                frame=frame.parent,
                child_frame=name,
                sensor="tf_static",
                position=np.array(frame.xyz),
                orientation=np.array([0.0, 0.0, 0.0, 1.0]),
                static=True,
            )
        yield from merged(self._series, self.epoch_ns)

    def frames(self) -> dict[str, FrameConfig]:
        """The frame of each plate, in the lab frame."""
        return {
            name: FrameConfig(parent=LAB, xyz=tuple(corners.mean(axis=0).tolist()))
            for name, corners in self.corners.items()
        }


def _sampled(path: Path, values: FloatArray, rate: float, start: float, make: Any) -> Series:
    count = len(values)
    return Series(
        origin=str(path),
        stamps=even_stamps(count, rate, start),
        values=values,
        rows=np.arange(count) + 1,
        make=make,
    )


def _markers(names: tuple[str, ...], stamp: float, row: FloatArray) -> Reading:
    return Markers(stamp=stamp, frame=LAB, sensor="markers", names=names, positions=row)


def _wrench(name: str, stamp: float, row: FloatArray) -> Reading:
    return Wrench(stamp=stamp, frame=name, sensor=name, force=row[:3], torque=row[3:])


@contextmanager
def _unpacked(path: Path) -> Iterator[Path]:
    """The file itself, or the one C3D of a zip, which exists while it is read."""
    require_file(path, RecordingError)
    if path.suffix.lower() != ".zip":
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        try:
            with zipfile.ZipFile(path) as archive:
                require_zip(archive, path.stat().st_size)
                names = [
                    name
                    for name in archive.namelist()
                    if name.lower().endswith(".c3d") and not Path(name).name.startswith("._")
                ]  # macOS adds a file of that name for each
                if len(names) != 1:
                    raise RecordingError(f"{path} must hold one C3D file, not {len(names)}")
                unpacked = Path(archive.extract(names[0], folder))
        except (zipfile.BadZipFile, zlib.error, EOFError) as error:
            raise RecordingError(f"{path} is cut off, or no zip file: {error}") from None
        # encrypted, an unknown compression, or damaged within bzip2 or LZMA
        except (ValueError, RuntimeError, OSError, lzma.LZMAError) as error:
            raise RecordingError(f"{path} can't be unpacked: {error}") from None
        yield unpacked


def _content(path: Path, unpacked: Path) -> Any:
    """The content by ezc3d, which reads a file that is cut off as a shorter one."""
    if find_spec("ezc3d") is None:
        raise missing_extra("ezc3d", "c3d")
    try:
        size = unpacked.stat().st_size
        read = confined(
            content,
            str(unpacked.resolve()),
            seconds=SECONDS + size / SLOWEST,
            memory=MEMORY + TIMES * size,
        )
    except Exception as error:  # of several kinds
        raise RecordingError(f"{path} can't be read as C3D: {error}") from None
    frames, promised = read["data"]["points"].shape[2], _promised_frames(unpacked)
    if frames < promised:
        raise RecordingError(f"{path} is cut off: it holds {frames} of {promised} frames")
    return read


def _promised_frames(path: Path) -> int:
    """The number of frames in the header, modulo 65536 as it has two bytes."""
    content = path.read_bytes()
    processor = content[(content[0] - 1) * 512 + 3]
    first, last = struct.unpack_from(">2H" if processor == BIG_ENDIAN else "<2H", content, 6)
    return int(last - first + 1) % 65536


def _values(parameters: Any, group: str, name: str) -> Any:
    return parameters.get(group, {}).get(name, {"value": ()})["value"]


def _marker_names(parameters: Any) -> dict[int, str]:
    """The names of the points that are markers, by index; beyond 255 they continue in LABELS2."""
    keys = [key for key in parameters["POINT"] if key.startswith("LABELS")]
    keys.sort(key=lambda key: int(key.removeprefix("LABELS") or 1))
    names = [name.strip() for key in keys for name in _values(parameters, "POINT", key)]
    names = names[: int(parameters["POINT"]["USED"]["value"][0])]
    results = {name.strip() for key in NOT_POINTS for name in _values(parameters, "POINT", key)}
    return {index: name for index, name in enumerate(names) if name not in results}


def _unit(parameters: Any, group: str, channel: int) -> str:
    """The unit of a channel as bare small letters, "nmm" for N·mm; empty when there is none."""
    units = _values(parameters, group, "UNITS")
    return "".join(filter(str.isalpha, units[channel])).lower() if channel < len(units) else ""


def _metres(path: Path, parameters: Any) -> float:
    unit = _unit(parameters, "POINT", 0) or "m"
    if unit not in METRES:
        raise RecordingError(f"{path} gives lengths in '{unit}', not in {', '.join(METRES)}")
    return METRES[unit]


def _torque_scale(path: Path, parameters: Any, index: int, plate: Any) -> float:
    """The factor that converts the torques of a plate to N·m.

    ezc3d takes the unit for force times length. A file may declare another for the channels; then
    ezc3d has shifted the torque to the surface in a wrong unit, unless there was no shift.
    """
    if plate["unit_force"] != "N":
        raise RecordingError(f"{path} gives forces in '{plate['unit_force']}', not in N")
    assumed = NEWTON_METRES["n" + plate["unit_position"].lower()]
    kind = int(_values(parameters, "FORCE_PLATFORM", "TYPE")[index])
    if kind not in (2, 4):
        return assumed
    channel = int(_values(parameters, "FORCE_PLATFORM", "CHANNEL")[3, index]) - 1
    given = NEWTON_METRES.get(_unit(parameters, "ANALOG", channel), assumed)
    if given != assumed and plate["origin"].any():
        raise RecordingError(
            f"{path} gives lengths in {plate['unit_position']} but torques of plate {index} in "
            f"another unit, and its sensor is not at the surface: that can't be read"
        )
    return given


def _events(parameters: Any, start: float) -> tuple[MotionEvent, ...]:
    """The events, whose times (minutes, seconds) count from the original trial's start."""
    times = np.asarray(_values(parameters, "EVENT", "TIMES"), dtype=np.float64)
    if not times.size:
        return ()
    minutes, seconds = times.reshape(2, -1)
    stamps = minutes * 60.0 + seconds - start
    labels, contexts = (_values(parameters, "EVENT", name) for name in ("LABELS", "CONTEXTS"))
    events = (
        MotionEvent(float(stamp), label.strip(), context.strip())
        for stamp, label, context in zip_longest(stamps, labels, contexts, fillvalue="")
    )
    return tuple(sorted(events, key=lambda event: event.stamp))


@hookimpl
def contactfusion_recordings() -> dict[str, type[RecordingFormat]]:
    """The recording."""
    return {"c3d": C3DRecording}
