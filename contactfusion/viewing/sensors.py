"""Draws what sensors said, where they were at that time."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in, pose_of
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
from contactfusion.viewing.arrows import Arrows, Sheaf
from contactfusion.viewing.colours import CLOUD, CONTACT, MARKER, TORQUE, WRENCH
from contactfusion.viewing.library import entity, loaded_rerun
from contactfusion.viewing.places import Absences, Places
from contactfusion.viewing.recorder import Recorder
from contactfusion.viewing.taxels import Taxels

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
    """Give the point that each pixel sees, shape (h, w, 3) [m], in the frame of the camera."""
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
