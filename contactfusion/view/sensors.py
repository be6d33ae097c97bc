"""Draws what sensors measured, where they were at that time."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in, pose_of
from contactfusion.patches import PatchConfig
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import (
    DepthImage,
    Markers,
    ObjectPose,
    PointCloud,
    Reading,
    Switch,
    TactileImage,
    Wrench,
)
from contactfusion.view.recorder import (
    CLOUD,
    CONTACT,
    MARKER,
    ROBOT,
    TORQUE,
    WRENCH,
    Arrows,
    Colours,
    Recorder,
    Sheaf,
    entity,
    loaded_rerun,
    ramp,
)
from contactfusion.view.world import Absences, Places

MOST_POINTS = 10_000
"""Larger clouds are thinned evenly."""
WIDEST = 320
"""Wider depth images are thinned to whole steps of pixels."""
DOT = 1.2
"""The radius of a point of a cloud, whatever its distance [points of the screen]."""
MARKER_DOT = 3.0
"""The same of a marker."""
FURTHEST = 65.535
"""The greatest depth that fits in 16 bits of millimetres [m]."""
THICKNESS = 0.05
"""Of a drawn taxel, in parts of its shorter edge."""
UNTOUCHED = 0.1
"""Changes below this part of the largest have the colour of the robot."""


class Taxels:
    """Patches by sensor. Colours need the largest change of all, so they are written at the end.

    Args:
        config: of the pipeline, whose generators or robot say where taxels are.
    """

    def __init__(self, config: PipelineConfig) -> None:
        self._patches = _patches(config)
        self._images: dict[str, list[tuple[float, FloatArray]]] = {}
        self._refused: set[str] = set()

    def draw(self, recorder: Recorder, reading: TactileImage, path: str) -> None:
        """Draw the patch when its first image comes, and remember the image."""
        patch = self._patches.get(reading.sensor)
        if patch is None or len(patch.centres()) != len(reading.values):
            if reading.sensor not in self._refused:
                self._refused.add(reading.sensor)
                text = f"{reading.label} is not drawn: no patch says where its taxels are"
                recorder.say("events/viewer", reading.stamp, "WARN", text)
            return
        if path not in self._images:
            recorder.draw(path, reading.stamp, _boxes(patch))
        self._images.setdefault(path, []).append((reading.stamp, reading.values))

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
    """Draw taxels as flat boxes in the frame of the patch."""
    centres, halves, turns = [], [], []
    for pose, places, edges in patch.sheets():
        centres.append(points_in(pose, places))
        half = np.array([*edges, THICKNESS * min(edges)]) / 2.0
        halves.append(np.tile(half * [0.94, 0.94, 1.0], (len(places), 1)))
        turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
        turns.append(np.tile(turn, (len(places), 1)))
    return loaded_rerun().Boxes3D(
        centers=np.concatenate(centres),
        half_sizes=np.concatenate(halves),
        quaternions=np.concatenate(turns),
        fill_mode="solid",
    )


def _patches(config: PipelineConfig) -> dict[str, PatchConfig]:
    """The patches by sensor: those of the robot, and those that generators are told."""
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
    """Draws readings of clouds, depth images, taxels, wrenches, switches, markers and objects.

    Args:
        taxels: draws patches.
        forces: draws forces.
        torques: draws torques.
        absences: takes what cannot be placed.
    """

    def __init__(self, taxels: Taxels, forces: Arrows, torques: Arrows, absences: Absences) -> None:
        self._taxels, self._forces, self._torques = taxels, forces, torques
        self._absences = absences
        self._lost: set[str] = set()
        self.cameras: dict[str, str] = {}
        """The path of each camera's image, by the name of the camera."""

    def draw(self, recorder: Recorder, reading: Reading, places: Places) -> FloatArray:
        """Draw a reading of one of the kinds in `DRAWN`.

        Returns:
            The points that it saw, in the world, shape (n, 3) [m].
        """
        seen = np.empty((0, 3))
        name = reading.sensor or reading.frame
        path = entity("world", "sensors", name)
        pose = places.find(reading.frame)
        if pose is None:
            self._say_lost(recorder, reading, places)
            return seen
        recorder.place(path, reading.stamp, pose)
        match reading:
            case PointCloud():
                seen = _thinned(reading.points[np.isfinite(reading.points).all(axis=1)])
                recorder.draw(path, reading.stamp, _cloud(seen, CLOUD))
            case DepthImage():
                self.cameras[name] = f"{path}/image"
                seen = _draw_image(recorder, reading, path)
            case Wrench(force=force, torque=torque):
                force_sheaf = Sheaf(reading.stamp, force[None])
                self._forces.draw(recorder, f"{path}/force", WRENCH, force_sheaf)
                torque_sheaf = Sheaf(reading.stamp, torque[None])
                self._torques.draw(recorder, f"{path}/torque", TORQUE, torque_sheaf)
            case TactileImage():
                self._taxels.draw(recorder, reading, path)
            case Switch():
                recorder.draw(path, reading.stamp, _lamp(reading))
            case Markers():
                rows = np.flatnonzero(np.isfinite(reading.positions).all(axis=1))
                seen = reading.positions[rows]
                recorder.draw(path, reading.stamp, _markers(reading, rows))
            case ObjectPose():
                self._draw_object(recorder, reading, pose)
        return points_in(pose, seen)

    def _draw_object(self, recorder: Recorder, reading: ObjectPose, pose: Pose) -> None:
        from scipy.spatial.transform import Rotation

        rotation = Rotation.from_quat(reading.orientation).as_matrix()
        path = entity("world", "objects", reading.name)
        recorder.place(path, reading.stamp, pose @ pose_of(reading.position, rotation))
        axes = loaded_rerun().Arrows3D(
            vectors=0.1 * np.eye(3), colors=255 * np.eye(3, dtype=np.uint8)
        )
        recorder.draw(path, reading.stamp, axes)
        name = loaded_rerun().Points3D(
            [[0.0, 0.0, 0.1]], colors=CLOUD, radii=1e-4, labels=[reading.name], show_labels=True
        )
        recorder.draw(f"{path}/name", reading.stamp, name)

    def _say_lost(self, recorder: Recorder, reading: Reading, places: Places) -> None:
        """Report once for each frame that what comes in it cannot be drawn, and note since when."""
        text, why = f"{reading.label} is not drawn", places.why_lost(reading.frame)
        self._absences.add(text, reading.stamp, why)
        if reading.frame not in self._lost:
            self._lost.add(reading.frame)
            recorder.say("events/viewer", reading.stamp, "WARN", f"{text}: {why}")


DRAWN = (PointCloud, DepthImage, Wrench, TactileImage, Switch, Markers, ObjectPose)


def _cloud(points: FloatArray, colours: Any) -> Any:
    rerun = loaded_rerun()
    return rerun.Points3D(points, colors=colours, radii=rerun.Radius.ui_points(DOT))


def _thinned(rows: NDArray[Any]) -> NDArray[Any]:
    return rows[:: -(-len(rows) // MOST_POINTS) or 1]


def _draw_image(recorder: Recorder, reading: DepthImage, path: str) -> FloatArray:
    """Draw the points of a depth image, and beneath its camera's path what the camera sees."""
    rerun = loaded_rerun()
    step = -(-reading.depth.shape[1] // WIDEST)
    depth = np.nan_to_num(reading.depth[::step, ::step], posinf=0.0, neginf=0.0)
    colour = None if reading.colour is None else reading.colour[::step, ::step]
    height, width = depth.shape
    intrinsics = np.diag([1.0 / step, 1.0 / step, 1.0]) @ reading.intrinsics
    eye = rerun.Pinhole(
        image_from_camera=intrinsics, resolution=[width, height], image_plane_distance=0.1
    )
    recorder.draw(f"{path}/image", reading.stamp, eye)
    seen = (depth > 0.0) & (depth < FURTHEST)
    millimetres = np.rint(np.where(seen, 1000.0 * depth, 0.0)).astype(np.uint16)
    image = rerun.DepthImage(millimetres, meter=1000.0, colormap="viridis")
    recorder.draw(f"{path}/image", reading.stamp, image if colour is None else rerun.Image(colour))
    points = _thinned(_seen_points(depth, intrinsics)[seen])
    colours = CLOUD if colour is None else _thinned(colour[seen])
    recorder.draw(path, reading.stamp, _cloud(points, colours))
    return points


def _seen_points(depth: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """The point that each pixel sees, shape (h, w, 3) [m], in the frame of the camera."""
    rows, columns = np.indices(depth.shape)
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    points: FloatArray = depth[..., None] * (pixels @ np.linalg.inv(intrinsics).T)
    return points


def _lamp(reading: Switch) -> Any:
    colour = CONTACT if reading.closed else CLOUD
    return loaded_rerun().Points3D([[0.0, 0.0, 0.0]], colors=colour, radii=0.02)


def _markers(reading: Markers, rows: NDArray[np.intp]) -> Any:
    names = [reading.names[row] for row in rows]
    rerun = loaded_rerun()
    return rerun.Points3D(
        reading.positions[rows],
        colors=MARKER,
        radii=rerun.Radius.ui_points(MARKER_DOT),
        labels=names,
        show_labels=False,
    )
