"""Writes drawings into a file of rerun, whole or not at all; its colours and arrows."""

import math
import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.errors import ContactFusionError, WritingError, missing_extra
from contactfusion.files import require_file, whole_file
from contactfusion.frames import Pose
from contactfusion.readings.canvas import Colour

APPLICATION = "contactfusion"
TIMELINE = "time"
"""Stamps as the pipeline counts them [s]."""
UNENDING = 1e9
"""Longer than any run takes [s]."""
BACKGROUND = (13, 16, 17)
ROBOT = (150, 158, 170)
COMMAND = (255, 170, 60)
TURN = (255, 110, 60)
VOXELS = {
    "contact": (255, 140, 60),
    "below_threshold": (170, 90, 235),
    "support_only": (86, 180, 233),
    "nulled": (150, 150, 160),
}
"""By verdict."""
LINES = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 190, 140),
    (240, 130, 190),
    (240, 228, 66),
    (230, 110, 40),
    (90, 140, 255),
)
"""Of sources in plots; distinct for colour-blind readers, too."""
THICKNESS = 2.0
"""The radius of an arrow, whatever its distance [points of the screen]."""
RULER = 0.1
"""Length of the arrow whose meaning the title of the scene names [m]."""


class Recorder:
    """A file of rerun in the making; poses and time lines are written when it ends.

    Args:
        path: the .rrd to write. Its name identifies the recording in the viewer.

    Raises:
        ContactFusionError: the file cannot be written.
        DependencyError: rerun is not installed.
    """

    def __init__(self, path: Path) -> None:
        rerun = loaded_rerun()
        self._path = path
        self._poses: dict[str, list[tuple[float, Pose]]] = {}
        self._values: dict[str, list[tuple[float, float]]] = {}
        self._shown: set[str] = set()
        self._states: dict[str, str] = {}
        self._stream: Any = rerun.RecordingStream(
            APPLICATION,
            recording_id=path.stem,
            send_properties=False,
            # by size, never by the clock: the same steps are written in the same pieces
            batcher_config=rerun.ChunkBatcherConfig(flush_tick=UNENDING),
        )
        self._stream.set_log_time_enabled(False)
        self._end = ExitStack()
        try:
            self._written = self._end.enter_context(whole_file(path))
            self._stream.save(self._written)
        except (OSError, RuntimeError) as error:
            raise ContactFusionError(f"{path} cannot be written: {error}") from None
        self._end.callback(self._stream.disconnect)

    def draw(self, path: str, stamp: float | None, archetype: Any) -> None:
        """Draw an archetype until the next one of its path; stamp None: at all times."""
        if stamp is not None:
            self._stream.set_time(TIMELINE, duration=_nanoseconds(stamp))
        self._stream.log(path, archetype, static=stamp is None, strict=True)

    def show(self, path: str, stamp: float, archetype: Any, there: bool) -> None:
        """Draw an archetype while it is there, and its empty form once when it no longer is."""
        if there or path in self._shown:
            self.draw(path, stamp, archetype)
        (self._shown.add if there else self._shown.discard)(path)

    def place(self, path: str, stamp: float, pose: Pose) -> None:
        """Set the pose of a path from a stamp [s] on."""
        poses = self._poses.setdefault(path, [])
        if not poses or not np.array_equal(poses[-1][1], pose):
            poses.append((stamp, pose))

    def plot(self, path: str, stamp: float, value: float) -> None:
        """Add a point to a time line; NaN, nothing known, adds none."""
        if not math.isnan(value):
            self._values.setdefault(path, []).append((stamp, value))

    def enter(self, path: str, stamp: float, state: str) -> None:
        """Set the state of a path from a stamp [s] on."""
        if self._states.get(path) != state:
            self._states[path] = state
            self.draw(path, stamp, loaded_rerun().StateChange(state=state))

    def log(self, path: str, stamp: float, level: str, text: str) -> None:
        """Add a line to the text log of a path; the level is INFO or WARN."""
        self.draw(path, stamp, loaded_rerun().TextLog(f"{stamp:.2f} s: {text}", level=level))

    def send(self, path: str, stamps: FloatArray, columns: Any) -> None:
        """Write the columns of a path at many stamps, shape (n,) [s], at once."""
        times = loaded_rerun().TimeColumn(TIMELINE, duration=_nanoseconds(stamps))
        self._stream.send_columns(path, indexes=[times], columns=columns, strict=True)

    def close(self, blueprint: Any) -> None:
        """Write all that is left, and give the file its name.

        Args:
            blueprint: the layout of the viewer.

        Raises:
            WritingError: the file could not be written, as when the disk is full; none is left.
        """
        with self._end:
            self._send_poses()
            self._send_values()
            self._stream.send_blueprint(blueprint)
            self._stream.disconnect()
            try:
                require_recording(self._written)  # rerun writes by itself, and raises nothing
            except ContactFusionError:
                raise WritingError(f"{self._path} can't be written: is the disk full?") from None

    def abandon(self, error: BaseException) -> None:
        """Leave no file after an error."""
        self._end.__exit__(type(error), error, None)

    def _send_poses(self) -> None:
        for path, poses in self._poses.items():
            matrices = np.array([pose for _, pose in poses])
            columns = loaded_rerun().Transform3D.columns(
                translation=matrices[:, :3, 3],
                quaternion=Rotation.from_matrix(matrices[:, :3, :3]).as_quat(),
            )
            self.send(path, np.array([stamp for stamp, _ in poses]), columns)

    def _send_values(self) -> None:
        for path, values in self._values.items():
            stamps, scalars = np.array(values).T
            self.send(path, stamps, loaded_rerun().Scalars.columns(scalars=scalars))


def _nanoseconds(stamps: float | FloatArray) -> Any:
    """Stamps [s] as whole nanoseconds, alike wherever they are written."""
    return np.rint(np.multiply(stamps, 1e9)).astype("timedelta64[ns]")


def require_recording(rrd: Path) -> None:
    """Make sure that a file is a recording of rerun, and whole.

    Raises:
        ContactFusionError: it is not.
        DependencyError: rerun is not installed.
    """
    loaded_rerun()
    require_file(rrd, ContactFusionError)
    from rerun.chunk import RrdReader

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # it reads what is cut off, and warns
            recordings = RrdReader(rrd).recordings()
    except (RuntimeError, Warning):
        recordings = []
    if not recordings:
        raise ContactFusionError(f"{rrd} is no recording of rerun, or it is cut off")


def loaded_rerun() -> Any:
    """The library rerun, loaded only where something is drawn or shown.

    Raises:
        DependencyError: it is not installed.
    """
    try:
        import rerun
    except ImportError:
        raise missing_extra("rerun-sdk", "view") from None
    return rerun


def entity(*names: str) -> str:
    """The path of an entity; names may hold slashes and spaces."""
    path: str = loaded_rerun().new_entity_path(list(names))
    return path


class Sheaf(NamedTuple):
    """Arrows of one path at one time.

    Attributes:
        stamp: from which on they are shown [s].
        vectors: shape (n, 3), in the unit of the drawn quantity.
        tips: where they end, shape (n, 3) [m]; None: they begin at the origin.
    """

    stamp: float
    vectors: FloatArray
    tips: FloatArray | None = None


class Arrows:
    """The forces of a recording, or its torques; written at its end, as the largest sets the scale.

    Args:
        unit: of their vectors.
        longest: the longest an arrow may be [m].
    """

    def __init__(self, unit: str, longest: float) -> None:
        self._unit, self._longest = unit, longest
        self._sheaves: dict[str, list[Sheaf]] = {}

    def draw(self, recorder: Recorder, path: str, colour: Colour, sheaf: Sheaf) -> None:
        """Draw arrows of one colour at a path until its next; without arrows it does not start."""
        if path not in self._sheaves:
            if not len(sheaf.vectors):
                return
            rerun = loaded_rerun()
            radii = rerun.Radius.ui_points(THICKNESS)
            look = rerun.Arrows3D.from_fields(colors=colour, radii=radii)
            recorder.draw(path, None, look)
        self._sheaves.setdefault(path, []).append(sheaf)

    def finish(self, recorder: Recorder) -> str:
        """Write all arrows; the value of an arrow of 10 cm with its unit, empty without arrows."""
        sheaves = [sheaf for some in self._sheaves.values() for sheaf in some]
        vectors = np.concatenate([np.empty((0, 3)), *(sheaf.vectors for sheaf in sheaves)])
        largest = float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
        if largest == 0.0:
            return ""
        meaning = _rounded_up(RULER / self._longest * largest)
        for path, some in self._sheaves.items():
            _send(recorder, path, some, RULER / meaning)
        return f"{meaning:g} {self._unit}"


class ArrowsByUnit:
    """All arrows of a recording: those of one unit share a scale.

    Args:
        longest: the longest an arrow may be [m].
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._arrows: dict[str, Arrows] = {}

    def of(self, unit: str) -> Arrows:
        """The arrows of a unit."""
        return self._arrows.setdefault(unit, Arrows(unit, self._longest))

    def finish(self, recorder: Recorder) -> str:
        """Write all arrows; the value of an arrow of 10 cm in each unit that was drawn."""
        return " or ".join(
            filter(None, [arrows.finish(recorder) for arrows in self._arrows.values()])
        )


def _send(recorder: Recorder, path: str, sheaves: list[Sheaf], scale: float) -> None:
    """Write the arrows of one path; the scale is the length of one unit [m]."""
    vectors = [scale * sheaf.vectors for sheaf in sheaves]
    origins = [
        np.zeros_like(arrows) if sheaf.tips is None else sheaf.tips - arrows
        for arrows, sheaf in zip(vectors, sheaves, strict=True)
    ]
    columns = loaded_rerun().Arrows3D.columns(
        vectors=np.concatenate(vectors), origins=np.concatenate(origins)
    )
    stamps = np.array([sheaf.stamp for sheaf in sheaves])
    recorder.send(path, stamps, columns.partition([len(arrows) for arrows in vectors]))


def _rounded_up(value: float) -> float:
    """The next greater number of one digit, with any power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return math.ceil(value / power - 1e-9) * power
