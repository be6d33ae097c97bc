"""A picture of a robot: its surface, frames, patches, and fields of view."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.figures import new_figure
from contactfusion.files import write_whole
from contactfusion.frames import Pose, points_in
from contactfusion.robots.description import CameraConfig
from contactfusion.robots.posed import PosedRobot

ELEVATION, AZIMUTH = 22.0, 40.0
"""The direction of view [degrees]."""
MOST_POINTS = 20_000
WIDTH = 480.0
"""The approximate width of a robot on paper [points]."""
AXES = ("#d62728", "#2ca02c", "#1f77b4")
"""The colours of x, y and z."""
BACKGROUND, LINES, TEXT = 1, 2, 3
"""Drawing order, from back to front."""


def draw_robot(robot: PosedRobot, path: Path) -> Path:
    """Draw the whole robot, and beside it a close-up of the parts with patches.

    Args:
        robot: in the pose to draw.
        path: of the PNG.

    Returns:
        The path.

    Raises:
        DependencyError: matplotlib is not installed.
        ContactFusionError: the picture, or its folder, can't be written.
    """
    config, points = robot.model.config, robot.surface.points
    origins = [robot.pose_of(camera.frame)[None, :3, 3] for camera in config.cameras.values()]
    taxels = [
        points_in(robot.pose_of(patch.frame), patch.centres()) for patch in config.patches.values()
    ]
    figure = new_figure(14.0, 8.5)
    whole: Any = figure.add_subplot(1, 2 if taxels else 1, 1, projection="3d")
    _draw_surface(whole, robot, np.concatenate([points, *origins]), margin=0.02)
    size = 0.08 * float(np.ptp(points, axis=0).max())
    for name, wrist in config.wrists.items():
        _draw_frame(whole, robot.pose_of(wrist.frame), size, name)
    for name, camera in config.cameras.items():
        _draw_camera(whole, robot.pose_of(camera.frame), camera, 3.0 * size, name)
    _draw_frame(whole, robot.base, 1.5 * size, robot.model.root)
    whole.set_title("joints at the middle of their limits")
    if taxels:
        close: Any = figure.add_subplot(1, 2, 2, projection="3d")
        centres = np.concatenate(taxels)
        size = float(np.ptp(centres, axis=0).max())
        _draw_surface(close, robot, centres, margin=0.02 + 0.2 * size)
        close.scatter(*centres.T, s=3.0, color="black", zorder=LINES, depthshade=False)
        for name, patch in config.patches.items():
            _draw_frame(close, robot.pose_of(patch.frame), 0.01 + 0.08 * size, name)
        close.set_title("patches: taxels in black, z in blue")
    names = list(robot.model.parts)
    dots = [whole.scatter([], [], [], color=_colours(robot)[name], label=name) for name in names]
    figure.legend(handles=dots, loc="outside lower center", ncols=8, fontsize="small")
    return _saved(figure, path)


def _draw_surface(axes: Any, robot: PosedRobot, shown: FloatArray, margin: float) -> None:
    """Draw the surface around what is shown, as far as it faces the viewer."""
    from matplotlib.ticker import MultipleLocator

    axes.view_init(elev=ELEVATION, azim=AZIMUTH)
    axes.set_proj_type("ortho")
    axes.computed_zorder = False
    low, high = shown.min(axis=0) - margin, shown.max(axis=0) + margin
    surface, colours = robot.surface, _colours(robot)
    up, around = np.radians([ELEVATION, AZIMUTH])
    viewer = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    facing = surface.normals @ viewer
    seen = (facing > 0.0) & ((surface.points > low) & (surface.points < high)).all(axis=1)
    rows = np.flatnonzero(seen)
    stride = max(1, -(-len(rows) // MOST_POINTS))
    rows = rows[::stride]
    table = np.array([colours.get(name, (0.0, 0.0, 0.0)) for name in surface.link_names])
    shaded = table[surface.links[rows]] * (0.45 + 0.55 * facing[rows, None])
    extent = float((high - low).max())
    apart = robot.model.config.spacing * np.sqrt(stride)
    # dots touch each other, so that they hide those behind
    dot = float(np.clip((WIDTH * apart / extent) ** 2, 2.5, 150.0))
    look = {"s": dot, "color": shaded, "linewidths": 0.0, "depthshade": False}
    axes.scatter(*surface.points[rows].T, zorder=BACKGROUND, **look)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=0.92)
    step = 10.0 ** np.floor(np.log10(extent / 2.0))
    step *= 2.0 if extent / step > 8.0 else 1.0
    for axis, name in ((axes.xaxis, "x"), (axes.yaxis, "y"), (axes.zaxis, "z")):
        axis.set_major_locator(MultipleLocator(step))
        axis.set_tick_params(labelsize="small")
        axis.set_label_text(f"{name} [m]", fontsize="small")


def _draw_frame(axes: Any, pose: Pose, size: float, name: str) -> None:
    """Draw the axes of a frame, and its name."""
    origin = pose[:3, 3]
    for axis, colour in enumerate(AXES):
        axes.plot(*zip(origin, origin + size * pose[:3, axis], strict=True), color=colour,
                  linewidth=1.5, zorder=LINES)  # fmt: skip
    _draw_name(axes, origin + 1.3 * size * pose[:3, 2], name)


def _draw_camera(axes: Any, pose: Pose, camera: CameraConfig, length: float, name: str) -> None:
    """Draw the field of view of a camera as a pyramid, up to a length [m]."""
    half = np.tan(np.radians(camera.fov) / 2.0)
    x, y = half, half * camera.height / camera.width
    corners = length * np.array([[-x, -y, 1.0], [x, -y, 1.0], [x, y, 1.0], [-x, y, 1.0]])
    corners = points_in(pose, corners)
    origin = pose[:3, 3]
    loop = np.concatenate([corners, corners[:1]])
    axes.plot(*loop.T, color="black", linewidth=0.8, zorder=LINES)
    for corner in corners:
        axes.plot(*zip(origin, corner, strict=True), color="black", linewidth=0.8, zorder=LINES)
    _draw_name(axes, origin - 0.1 * length * pose[:3, 2], name)


def _draw_name(axes: Any, position: FloatArray, name: str) -> None:
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.5, foreground="white")]
    axes.text(*position, name, fontsize="small", ha="center", zorder=TEXT, path_effects=halo)


def _colours(robot: PosedRobot) -> dict[str, tuple[float, ...]]:
    """The colour of each link that has a surface."""
    from matplotlib import colormaps

    names = list(robot.model.parts)
    return {name: colormaps["tab20"](number % 20)[:3] for number, name in enumerate(names)}


def _saved(figure: Any, path: Path) -> Path:
    content = io.BytesIO()
    figure.savefig(content, dpi=110, format="png")
    write_whole(path, content.getvalue())
    return path
