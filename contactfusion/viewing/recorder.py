"""Writes what is drawn into a file of rerun: the whole file, or none."""

import math
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.errors import ContactFusionError
from contactfusion.files import whole_file
from contactfusion.frames import Pose
from contactfusion.viewing.library import loaded_rerun

APPLICATION = "contactfusion"
TIMELINE = "time"
"""Stamps as the pipeline counts them [s]."""

UNENDING = 1e9
"""Longer than any run takes [s]."""


class Recorder:
    """A file of rerun in the making; poses and time lines are written when it ends.

    Args:
        path: the .rrd to write. Its name tells one recording from another in the viewer.

    Raises:
        ContactFusionError: the file cannot be written.
        DependencyError: rerun is not installed.
    """

    def __init__(self, path: Path) -> None:
        rerun = loaded_rerun()
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
            self._stream.save(self._end.enter_context(whole_file(path)))
        except (OSError, RuntimeError) as error:
            raise ContactFusionError(f"{path} cannot be written: {error}") from None
        self._end.callback(self._stream.disconnect)

    def draw(self, path: str, stamp: float | None, thing: Any) -> None:
        """Draw a thing that stands until the next one of its path; None: at all times."""
        if stamp is not None:
            self._stream.set_time(TIMELINE, duration=_nanoseconds(stamp))
        self._stream.log(path, thing, static=stamp is None, strict=True)

    def show(self, path: str, stamp: float, thing: Any, there: bool) -> None:
        """Draw a thing that comes and goes: its empty form once, when it has gone."""
        if there or path in self._shown:
            self.draw(path, stamp, thing)
        (self._shown.add if there else self._shown.discard)(path)

    def place(self, path: str, stamp: float, pose: Pose) -> None:
        """Say where the things of a path are from a stamp [s] on."""
        poses = self._poses.setdefault(path, [])
        if not poses or not np.array_equal(poses[-1][1], pose):
            poses.append((stamp, pose))

    def plot(self, path: str, stamp: float, value: float) -> None:
        """Add a point to a time line; NaN, nothing known, adds none."""
        if not math.isnan(value):
            self._values.setdefault(path, []).append((stamp, value))

    def enter(self, path: str, stamp: float, state: str) -> None:
        """Say in which state something is from a stamp [s] on."""
        if self._states.get(path) != state:
            self._states[path] = state
            self.draw(path, stamp, loaded_rerun().StateChange(state=state))

    def say(self, path: str, stamp: float, level: str, text: str) -> None:
        """Add a line to a log; the level is INFO or WARN."""
        self.draw(path, stamp, loaded_rerun().TextLog(f"{stamp:.2f} s: {text}", level=level))

    def send(self, path: str, stamps: FloatArray, columns: Any) -> None:
        """Write what a path looked like at many stamps, shape (n,) [s], at once."""
        times = loaded_rerun().TimeColumn(TIMELINE, duration=_nanoseconds(stamps))
        self._stream.send_columns(path, indexes=[times], columns=columns, strict=True)

    def close(self, blueprint: Any) -> None:
        """Write all that is left, and give the file its name.

        Args:
            blueprint: what the viewer shows at first.
        """
        with self._end:
            self._send_poses()
            self._send_values()
            self._stream.send_blueprint(blueprint)

    def abandon(self, error: BaseException) -> None:
        """Leave no file, as something went wrong."""
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
    """Give stamps [s] as whole nanoseconds, alike wherever they are written."""
    return np.rint(np.multiply(stamps, 1e9)).astype("timedelta64[ns]")
