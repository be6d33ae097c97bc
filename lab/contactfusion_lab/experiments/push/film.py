"""One push again, as a film and as a recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.controllers.face import FaceConfig
from contactfusion.figures import COLOURS, new_figure
from contactfusion.frames import yaw_quaternion
from contactfusion.pipeline import Pipeline
from contactfusion.readings import ObjectPose
from contactfusion.recordings.mcap import McapWriter
from contactfusion_lab.experiments.push.plan import Plan, Push
from contactfusion_lab.experiments.push.trial import KINDS, Track, push_cycles, track_of
from contactfusion_lab.scenes.push.bodies import read_chassis
from contactfusion_lab.scenes.push.objects import outlines
from contactfusion_lab.scenes.push.scene import PushTruth
from contactfusion_lab.trials.folder import loaded_pillow, save_film

TRUTH = "truth"
"""Prefix of the topics that no sensor measures."""
FRAMES = 150
"""At most [frames]."""
LAST = 2.5
"""Duration of the last frame [s]."""
AROUND = 0.75
"""Margin around all trajectories [m]."""
TARGET, OBJECT, EDGE, TRUE, FELT = COLOURS[3], COLOURS[5], COLOURS[0], COLOURS[2], COLOURS[1]
SHADES = 12
"""Frames hold so many shades of each colour, between it and white: a small file."""


def record(plan: Plan, push: Push, controller: str, folder: Path) -> tuple[Path, Path]:
    """Push once more; write NAME.gif and NAME.mcap.

    The recording holds what the sensors read, before any faults, contacts and commands, and under
    "truth" the pose of the object in `odom`.

    Args:
        plan: the experiment.
        push: which.
        controller: by name.
        folder: the folder that takes both.

    Returns:
        The film and the recording.

    Raises:
        DependencyError: rosbags or matplotlib is not installed.
    """
    pipeline = Pipeline(plan.pipeline_of(push, controller), plan.sensing.ask)
    cycles = list(push_cycles(plan, push, pipeline))
    recording = folder / f"{push.name}.mcap"
    with McapWriter(recording) as writer:
        for cycle in cycles:
            for reading in cycle.readings:
                writer.reading(reading)
            writer.reading(_object(push, cycle.truth), prefix=TRUTH)
            writer.step(cycle.step)
    track = track_of(plan, push, controller, cycles)
    reasons = [cycle.step.command.reason if cycle.step.command else "" for cycle in cycles]
    shapes = Shapes(
        read_chassis(plan.robot).corners, outlines(plan.objects[push.object]), plan.face
    )
    return _drawn(track, reasons, shapes, folder / f"{push.name}.gif"), recording


def _object(push: Push, truth: PushTruth) -> ObjectPose:
    x, y, yaw = truth.object
    return ObjectPose(
        stamp=truth.stamp,
        frame="odom",
        sensor="object",
        name=push.object,
        position=np.array([x, y, 0.0]),
        orientation=yaw_quaternion(yaw),
    )


@dataclass(frozen=True, eq=False)
class Shapes:
    """The scene seen from above.

    Attributes:
        robot: shape (n, 2) [m], the corners of the robot in its frame.
        object: each of shape (n, 2) [m], the pieces of the object in its frame.
        face: what pushes.
    """

    robot: FloatArray
    object: Sequence[FloatArray]
    face: FaceConfig


def _drawn(track: Track, reasons: Sequence[str], shapes: Shapes, path: Path) -> Path:
    """Draw a push as an animated GIF.

    Args:
        track: of the push.
        reasons: of the controller, one a cycle.
        shapes: what is drawn.
        path: the GIF to write.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    image = loaded_pillow()
    scene = _Scene(track, reasons, shapes)
    stride = max(1, -(-len(track.stamp) // FRAMES))
    rows = sorted({*range(0, len(track.stamp), stride), len(track.stamp) - 1})
    pictures = [image.fromarray(scene.picture(row)) for row in rows]
    palette = image.new("P", (1, 1))
    palette.putpalette(_palette())
    frames = [picture.quantize(palette=palette, dither=image.Dither.NONE) for picture in pictures]
    return save_film(frames, path, LAST, optimize=False)


class _Scene:
    """Everything that is drawn; moved from frame to frame."""

    _robot: Any

    def __init__(self, track: Track, reasons: Sequence[str], shapes: Shapes) -> None:
        from matplotlib.patches import Circle, Polygon

        self._track, self._reasons, self._shapes = track, reasons, shapes
        self._figure = new_figure(6.4, 6.6)
        axes = self._figure.subplots()
        self._axes = axes
        _limit(axes, track)
        target = track.push.target
        axes.add_patch(Circle(target, track.within, color=TARGET, alpha=0.5, zorder=1))
        axes.plot(*target, "+", color=TARGET, markersize=12.0, label="target", zorder=6)
        (self._way,) = axes.plot([], [], color="#999999", linewidth=1.0, zorder=1)
        (self._object_way,) = axes.plot([], [], color=OBJECT, linewidth=1.0, zorder=1)
        self._robot = axes.add_patch(
            Polygon(shapes.robot, facecolor="#dddddd", edgecolor="#555555")
        )
        self._pieces: list[Any] = [
            axes.add_patch(Polygon(piece, facecolor=OBJECT, edgecolor=EDGE, alpha=0.7))
            for piece in shapes.object
        ]
        (self._face,) = axes.plot([], [], color="#333333", linewidth=3.0, zorder=3)
        (self._truth,) = axes.plot(
            [], [], "o", color=TRUE, markersize=9.0, label="true contact", zorder=4
        )
        (self._felt,) = axes.plot(
            [], [], "x", color=FELT, markersize=8.0, markeredgewidth=2.0, label="felt", zorder=5
        )
        axes.legend(loc="upper right", fontsize=8)
        self._title = axes.set_title(" \n ", loc="left", fontsize=9, family="monospace")

    def picture(self, row: int) -> NDArray[np.uint8]:
        """Draw one cycle, shape (height, width, 3)."""
        track, face = self._track, self._shapes.face
        base, pose = track.base[row], track.object[row]
        self._way.set_data(*track.base[: row + 1, :2].T)
        self._object_way.set_data(*track.object[: row + 1, :2].T)
        self._robot.set_xy(_placed(self._shapes.robot, base))
        for patch, piece in zip(self._pieces, self._shapes.object, strict=True):
            patch.set_xy(_placed(piece, pose))
        half = face.half_width
        edge = np.array([[face.ahead, -half], [face.ahead, half]])
        self._face.set_data(*_placed(edge, base).T)
        self._truth.set_data(*_placed(track.contact[row : row + 1], base).T)
        felt = np.array([[face.ahead, track.lateral[row]]])
        self._felt.set_data(*_placed(felt, base).T)
        self._title.set_text(self._heading(row))
        self._figure.canvas.draw()
        canvas: Any = self._figure.canvas
        return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()

    def _heading(self, row: int) -> str:
        track = self._track
        kind, estimate = KINDS[track.kind[row]], KINDS[track.estimate[row]]
        far = track.distance[row]
        left = "" if np.isnan(far) else f", truly {far:.2f} m to go"
        return (
            f"{track.stamp[row]:6.1f} s  {track.modes[track.mode[row]]}: {self._reasons[row]}\n"
            f"contact: {kind}, felt: {estimate}{left}"
        )


def _palette() -> list[int]:
    """Red, green and blue of all shades, one after the other."""
    from matplotlib.colors import to_rgb

    colours = np.array([to_rgb(name) for name in ("black", TARGET, OBJECT, EDGE, TRUE, FELT)])
    shares = np.linspace(0.0, 1.0, SHADES)[:, None, None]
    shades = 255.0 * (1.0 - shares * (1.0 - colours))
    return [round(value) for value in shades.ravel().tolist()]


def _placed(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Bring points of shape (n, 2) into the world by x, y and yaw."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    placed: FloatArray = points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    return placed


def _limit(axes: Any, track: Track) -> None:
    """Set limits that show all of the trajectories, as a square."""
    places = np.concatenate([track.base[:, :2], track.object[:, :2], [track.push.target]])
    low, high = places.min(axis=0) - AROUND, places.max(axis=0) + AROUND
    middle, half = (low + high) / 2.0, float((high - low).max()) / 2.0
    axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.grid(linewidth=0.3, color="#cccccc")
    axes.set_axisbelow(True)
