"""Draws what sensors measured, at their poses of that time."""

from collections.abc import Hashable, Mapping, Sequence
from contextlib import suppress
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.errors import ContactFusionError, PluginError
from contactfusion.frames import Pose, points_in
from contactfusion.patches import PatchConfig
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.readings.canvas import PLAIN, Canvas, Colour, Colours, ramp
from contactfusion.readings.registry import installed_kinds
from contactfusion.view.recorder import (
    ROBOT,
    ArrowsByUnit,
    Recorder,
    Sheaf,
    entity,
    loaded_rerun,
)
from contactfusion.view.world import Absences, Places

MOST_POINTS = 10_000
"""Larger clouds are thinned evenly."""
WIDEST = 320
"""Wider depth images are thinned to whole steps of pixels."""
DOT = 1.2
"""The radius of a point of a cloud, whatever its distance [points of the screen]."""
LARGE_DOT = 3.0
"""The same of a point that is to be seen by itself."""
FURTHEST = 65.535
"""The greatest depth that fits in 16 bits of millimetres [m]."""
THICKNESS = 0.05
"""Of a drawn taxel, in parts of its shorter edge."""
UNTOUCHED = 0.1
"""Changes below this part of the largest have the colour of the robot."""


class Taxels:
    """Patches by sensor. Colours need the largest change of all, so they are written at the end.

    Args:
        config: of the pipeline, whose generators or robot define the poses of taxels.
    """

    def __init__(self, config: PipelineConfig) -> None:
        self._patches = _patches(config)
        self._images: dict[str, list[tuple[float, FloatArray]]] = {}
        self._refused: set[str] = set()

    def draw(self, recorder: Recorder, reading: Reading, values: FloatArray, path: str) -> None:
        """Draw the patch of a sensor when its first values, shape (n,), come; keep the values."""
        patch = self._patches.get(reading.sensor)
        if patch is None or len(patch.centres()) != len(values):
            if reading.sensor not in self._refused:
                self._refused.add(reading.sensor)
                text = f"{reading.label} is not drawn: no patch says where its taxels are"
                recorder.log("events/viewer", reading.stamp, "WARN", text)
            return
        if path not in self._images:
            recorder.draw(path, reading.stamp, _boxes(patch))
        self._images.setdefault(path, []).append((reading.stamp, values))

    def finish(self, recorder: Recorder) -> None:
        """Colour the taxels of all images."""
        for path, images in self._images.items():
            values = np.array([values for _, values in images])
            colours = _heat(values).reshape(-1, 3)
            columns = loaded_rerun().Boxes3D.columns(colors=colours)
            count = np.full(len(values), values.shape[1])
            recorder.send(path, np.array([stamp for stamp, _ in images]), columns.partition(count))


def _heat(values: FloatArray) -> Colours:
    """The colours of images, shape (k, n, 3), of k images (k, n) in any unit.

    The change is counted from the first image, in parts of the largest change of all taxels.
    """
    change = abs(values - values[0])
    share = change / max(float(change.max()), np.finfo(float).tiny)
    return np.where(share[..., None] < UNTOUCHED, np.array(ROBOT, np.uint8), ramp(share))


def _boxes(patch: PatchConfig) -> Any:
    """Taxels as flat boxes in the frame of the patch."""
    centres, halves, rotations = [], [], []
    for pose, places, edges in patch.sheets():
        centres.append(points_in(pose, places))
        half = np.array([*edges, THICKNESS * min(edges)]) / 2.0
        halves.append(np.tile(half * [0.94, 0.94, 1.0], (len(places), 1)))
        rotation = Rotation.from_matrix(pose[:3, :3]).as_quat()
        rotations.append(np.tile(rotation, (len(places), 1)))
    return loaded_rerun().Boxes3D(
        centers=np.concatenate(centres),
        half_sizes=np.concatenate(halves),
        quaternions=np.concatenate(rotations),
        fill_mode="solid",
    )


def _patches(config: PipelineConfig) -> dict[str, PatchConfig]:
    """The patches by sensor: those of the robot, and those in the options of generators."""
    known = dict(config.robot.patches) if config.robot else {}
    found: dict[str, PatchConfig] = {**known}
    for options in config.generators.values():
        sensor, patch = options.get("sensor"), options.get("patch")
        if sensor is None or patch is None:
            continue
        if isinstance(patch, str) and patch in known:
            found[sensor] = known[patch]
        elif isinstance(patch, PatchConfig):
            found[sensor] = patch
        elif isinstance(patch, Mapping):
            found[sensor] = PatchConfig(**patch)
    return found


class Sensors:
    """Draws readings of all kinds whose codecs implement `draw`.

    Args:
        taxels: draws patches.
        arrows: of the recording.
        absences: takes what cannot be placed.
    """

    def __init__(self, taxels: Taxels, arrows: ArrowsByUnit, absences: Absences) -> None:
        self.taxels, self.arrows = taxels, arrows
        for unit in ("N", "N·m"):  # what an arrow means is reported in this order
            arrows.of(unit)
        self._absences = absences
        self._kinds = installed_kinds()
        self._lost: set[str] = set()
        self._failed: set[type[Reading]] = set()
        self.cameras: dict[str, str] = {}
        """The path of each camera's image, by the name of the camera."""

    def channel(self, reading: Reading) -> Hashable:
        """Identity of the drawing that a reading replaces: sensor, kind, and what it is of."""
        codec = self._kinds.of(type(reading))
        whose: tuple[str, ...] = ()
        if codec is not None:
            with suppress(PluginError), self._kinds.guard(codec):  # reported when it is drawn
                whose = codec.whose(reading)
        return reading.sensor or reading.frame, type(reading), whose

    def draw(self, recorder: Recorder, reading: Reading, places: Places) -> FloatArray:
        """Draw a reading.

        Returns:
            The points that it measured, in the world, shape (n, 3) [m].
        """
        path = entity("world", "sensors", reading.sensor or reading.frame)
        pose, codec = places.find(reading.frame), self._kinds.of(type(reading))
        if codec is None or type(reading) in self._failed:
            return np.empty((0, 3))
        if pose is None:
            self._report_lost(recorder, reading, places)
            return np.empty((0, 3))
        recorder.place(path, reading.stamp, pose)
        canvas = _RerunCanvas(self, recorder, reading, path, pose)
        try:
            with self._kinds.guard(codec):
                codec.draw(canvas, reading)
        except ContactFusionError as error:
            self._failed.add(type(reading))
            self._report(recorder, reading, f"{error}; no further one is drawn")
        return points_in(pose, canvas.seen)

    def _report_lost(self, recorder: Recorder, reading: Reading, places: Places) -> None:
        """Report once for each frame that its readings cannot be drawn; later, since when."""
        why = places.why_lost(reading.frame)
        if reading.frame not in self._lost:
            self._lost.add(reading.frame)
            self._report(recorder, reading, why)
        else:
            self._absences.add(f"{reading.label} is not drawn", reading.stamp, why)

    def _report(self, recorder: Recorder, reading: Reading, why: str) -> None:
        text = f"{reading.label} is not drawn"
        self._absences.add(text, reading.stamp, why)
        recorder.log("events/viewer", reading.stamp, "WARN", f"{text}: {why}")


@final
class _RerunCanvas(Canvas):
    """Draws one reading at its path; its measured points are in `seen`, shape (n, 3) [m]."""

    def __init__(
        self, sensors: Sensors, recorder: Recorder, reading: Reading, path: str, pose: Pose
    ) -> None:
        self._sensors, self._recorder, self._reading = sensors, recorder, reading
        self._path, self._pose = path, pose
        self.seen: FloatArray = np.empty((0, 3))

    def points(
        self,
        points: FloatArray,
        colours: Colour | Colours = PLAIN,
        *,
        labels: Sequence[str] = (),
        large: bool = False,
    ) -> None:
        """Draw points; larger clouds are thinned evenly."""
        rows = _thinned(np.flatnonzero(np.isfinite(points).all(axis=1)))
        self.seen = np.concatenate([self.seen, points[rows]])
        rerun = loaded_rerun()
        drawn = rerun.Points3D(
            points[rows],
            colors=colours[rows] if isinstance(colours, np.ndarray) else colours,
            radii=rerun.Radius.ui_points(LARGE_DOT if large else DOT),
            labels=[labels[row] for row in rows] if labels else None,
            show_labels=False if labels else None,
        )
        self._recorder.draw(self._path, self._reading.stamp, drawn)

    def spheres(self, centres: FloatArray, radius: float, colour: Colour) -> None:
        """Draw spheres."""
        drawn = loaded_rerun().Points3D(centres, colors=colour, radii=radius)
        self._recorder.draw(self._path, self._reading.stamp, drawn)

    def arrow(self, name: str, vector: FloatArray, unit: str, colour: Colour) -> None:
        """Draw an arrow below the path."""
        sheaf = Sheaf(self._reading.stamp, vector[None])
        self._sensors.arrows.of(unit).draw(self._recorder, f"{self._path}/{name}", colour, sheaf)

    def taxels(self, values: FloatArray) -> None:
        """Draw the patch of the sensor."""
        self._sensors.taxels.draw(self._recorder, self._reading, values, self._path)

    def depth_image(
        self, depth: FloatArray, intrinsics: FloatArray, colour: Colours | None
    ) -> None:
        """Draw the image beneath the path of its camera, and its points."""
        path, stamp = f"{self._path}/image", self._reading.stamp
        self._sensors.cameras[self._reading.sensor or self._reading.frame] = path
        rerun = loaded_rerun()
        step = -(-depth.shape[1] // WIDEST)
        depth = np.nan_to_num(depth[::step, ::step], posinf=0.0, neginf=0.0)
        colour = None if colour is None else colour[::step, ::step]
        height, width = depth.shape
        intrinsics = np.diag([1.0 / step, 1.0 / step, 1.0]) @ intrinsics
        camera = rerun.Pinhole(
            image_from_camera=intrinsics, resolution=[width, height], image_plane_distance=0.1
        )
        self._recorder.draw(path, stamp, camera)
        seen = (depth > 0.0) & (depth < FURTHEST)
        millimetres = np.rint(np.where(seen, 1000.0 * depth, 0.0)).astype(np.uint16)
        image = rerun.DepthImage(millimetres, meter=1000.0, colormap="viridis")
        self._recorder.draw(path, stamp, image if colour is None else rerun.Image(colour))
        points = _seen_points(depth, intrinsics)[seen]
        self.points(points, PLAIN if colour is None else colour[seen])

    def axes(self, name: str, pose: Pose) -> None:
        """Draw axes beneath the objects of the world."""
        path, stamp = entity("world", "objects", name), self._reading.stamp
        self._recorder.place(path, stamp, self._pose @ pose)
        rerun = loaded_rerun()
        axes = rerun.Arrows3D(vectors=0.1 * np.eye(3), colors=255 * np.eye(3, dtype=np.uint8))
        self._recorder.draw(path, stamp, axes)
        text = rerun.Points3D(
            [[0.0, 0.0, 0.1]], colors=PLAIN, radii=1e-4, labels=[name], show_labels=True
        )
        self._recorder.draw(f"{path}/name", stamp, text)


def _thinned(rows: NDArray[Any]) -> NDArray[Any]:
    return rows[:: -(-len(rows) // MOST_POINTS) or 1]


def _seen_points(depth: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """The point of each pixel, shape (h, w, 3) [m], in the frame of the camera."""
    rows, columns = np.indices(depth.shape)
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    points: FloatArray = depth[..., None] * (pixels @ np.linalg.inv(intrinsics).T)
    return points
