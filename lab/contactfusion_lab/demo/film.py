"""Pictures of the push: figures over time, an animated GIF, its frame in which the skin dies."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import write_whole
from contactfusion.frames import planar_rotation
from contactfusion_lab.demo.account import Story
from contactfusion_lab.demo.scene import FACE, Moment
from contactfusion_lab.scenes.push.objects import outlines
from contactfusion_lab.scenes.push.scene import mobile_base

SHOWN, DEATH, LAST = 100, 1500, 3000
"""Durations of frames: of most, of that in which the skin dies, of the last one [ms]."""
SHADES = 96
"""Colours in the palette of the GIF."""
AROUND = 0.55
"""Margin around the paths of robot and object [m]."""
CLOSE = (-34.0, 34.0, -12.0, 24.0)
"""Limits of the close-up, relative to the middle of the robot's face: lateral from right to left,
and from behind to before the face [cm]."""
SIGMAS = 2.0
"""Standard deviations of the ellipse."""
TARGET, BOX, EDGE = COLOURS[3], "#b9d7ea", "#51748a"
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Rotation of rows of x forward and y left into rows of right and up."""
SKIN = np.array([[-0.41, 0.3], [0.3, 0.3], [0.3, -0.3], [-0.41, -0.3]])
"""Outline of the skin, in the robot's frame [m]."""
SOURCES = {"skin": COLOURS[1], "lidar": COLOURS[0], "motion": COLOURS[2]}
"""The colour of each source, here and in the film."""
TRUTH, BELIEVED, DEAD = "#222222", COLOURS[3], "#cc0000"
SIZE = (5.6, 3.6)
"""Small, so that letters are large beside it [inches]."""
Figure = Any


def film(story: Story, path: Path, still: Path, stride: int = 2) -> tuple[int, int]:
    """Draw the push as an animated GIF.

    Args:
        story: of the push.
        path: the GIF to write.
        still: the PNG to write: the frame in which the skin dies.
        stride: cycles from frame to frame.

    Returns:
        Width and height [pixels].
    """
    from PIL import Image

    moments = [*story.moments[:-1:stride], story.last]
    drawn = Frames(story, stride)
    pictures = [Image.fromarray(drawn.picture(moment)) for moment in moments]
    death = next((n for n, moment in enumerate(moments) if dies(story, moment, stride)), -1)
    palette = pictures[death].quantize(SHADES)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    shown = [SHOWN] * len(frames)
    shown[death], shown[-1] = DEATH, LAST
    content = io.BytesIO()
    frames[0].save(
        content,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=shown,
        loop=0,
        optimize=False,
    )
    write_whole(path, content.getvalue())
    content = io.BytesIO()
    pictures[death].save(content, format="PNG")
    write_whole(still, content.getvalue())
    width, height = pictures[death].size
    return width, height


class Frames:
    """Draws moments of a push.

    Args:
        story: of the push.
        stride: cycles from frame to frame.
    """

    def __init__(self, story: Story, stride: int) -> None:
        self._story, self._stride = story, stride
        self._pieces = outlines(story.push.object)
        self._figure = new_figure(6.0, 5.6)
        grid = self._figure.add_gridspec(2, 2, height_ratios=[2.0, 1.0], width_ratios=[1.6, 1.0])
        self._floor = self._figure.add_subplot(grid[0, :])
        self._close = self._figure.add_subplot(grid[1, 0])
        self._bars = self._figure.add_subplot(grid[1, 1])
        self._base = np.array([moment.truth.base[:2] for moment in story.moments])
        self._box = np.array([moment.truth.object[:2] for moment in story.moments])
        self._settled = False

    def picture(self, moment: Moment) -> NDArray[np.uint8]:
        """The picture of a moment, shape (height, width, 3)."""
        for axes in (self._floor, self._close, self._bars):
            axes.clear()
        self._draw_floor(moment)
        self._draw_close(moment)
        self._draw_bars(moment)
        self._figure.canvas.draw()
        if not self._settled:  # the layout stays that of the first frame
            self._figure.set_layout_engine("none")
            self._settled = True
        canvas: Any = self._figure.canvas
        return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()

    def _draw_floor(self, moment: Moment) -> None:
        from matplotlib.patches import Circle, Polygon

        axes: Any = self._floor
        push, truth = self._story.push, moment.truth
        far = sum(past.stamp <= moment.stamp for past in self._story.moments)
        axes.add_patch(Circle(push.target, push.within, color=TARGET, alpha=0.4))
        axes.plot(*push.target, "+", color=TARGET, markersize=14.0, markeredgewidth=2.0)
        axes.annotate("target", push.target, (8, 8), textcoords="offset points", color=TARGET)
        axes.plot(*self._base[:far].T, color="#999999", linewidth=1.0)
        axes.plot(*self._box[:far].T, color=EDGE, linewidth=1.5)
        axes.add_patch(
            Polygon(
                _placed(mobile_base().corners, truth.base), facecolor="#dddddd", edgecolor="none"
            )
        )
        axes.plot(*_placed(SKIN, truth.base).T, **_skin(moment, 3.0))
        for piece in self._pieces:
            corners = _placed(piece, truth.object)
            axes.add_patch(Polygon(corners, facecolor=BOX, edgecolor=EDGE))
        if moment.touch is not None:
            position = _placed(np.array([[FACE.ahead, moment.touch.lateral]]), truth.base)
            axes.plot(*position.T, "o", color=BELIEVED, markersize=7.0, markeredgecolor="white")
        if moment.stamp >= self._story.dies:
            row = sum(past.stamp < self._story.dies for past in self._story.moments)
            axes.plot(*self._base[row], "X", color=DEAD, markersize=10.0)
            near = {"textcoords": "offset points", "color": DEAD}
            axes.annotate("here the skin died", self._base[row], (8, -12), **near)
        points = np.concatenate([self._base, self._box, [push.target]])
        (left, low), (right, high) = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND
        axes.set(xlim=(left, right), ylim=(low, high), aspect="equal")
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.grid(linewidth=0.3, color="#cccccc")
        axes.set_axisbelow(True)
        dying = dies(self._story, moment, self._stride)
        for spine in axes.spines.values():
            spine.set(color=DEAD if dying else "black")
        if dying:
            here = {"transform": axes.transAxes, "ha": "center", "color": DEAD, "fontsize": 20}
            axes.text(0.5, 0.85, "THE SKIN DIES", fontweight="bold", **here)
        dead = moment.stamp >= self._story.dies
        health = f"SKIN SILENT for {moment.silent:.1f} s" if dead else "skin well"
        left_over = f"{moment.left:.2f} m to go" if moment.touch else "no contact"
        title = f"{moment.stamp:4.1f} s   {moment.mode}   {left_over}"
        axes.set_title(title, loc="left", fontsize=11)
        colour = DEAD if dead else SOURCES["skin"]
        axes.set_title(health, loc="right", color=colour, fontsize=11, fontweight="bold")

    def _draw_close(self, moment: Moment) -> None:
        """Draw the contact in the robot's frame, forward is up [cm]."""
        from matplotlib.patches import Ellipse, Polygon

        axes, truth, centre = self._close, moment.truth, np.array([FACE.ahead, 0.0])

        def shown(points: FloatArray) -> FloatArray:
            turned: FloatArray = 100.0 * (points - centre) @ TURN.T
            return turned

        for piece in self._pieces:
            corners = shown(_seen(_placed(piece, truth.object), truth.base))
            axes.add_patch(Polygon(corners, facecolor=BOX, edgecolor=EDGE))
        axes.add_patch(Polygon(shown(mobile_base().corners), facecolor="#dddddd", edgecolor="none"))
        axes.plot(*shown(SKIN).T, **_skin(moment, 4.0))
        if moment.contact is not None:
            position = shown(moment.contact.position[None, :2])[0]
            sigmas = 100.0 * np.sqrt(np.diag(moment.contact.covariance)[[1, 0]])
            ellipse = Ellipse(
                position, *(2.0 * SIGMAS * sigmas), color=BELIEVED, alpha=0.45, zorder=4
            )
            axes.add_patch(ellipse)
        for source, lateral in moment.alone.items():
            at = shown(np.array([[FACE.ahead - 0.02, lateral]]))[0]
            axes.plot(*at, "^", color=SOURCES.get(source, "#555555"), markersize=8.0, zorder=5)
        if moment.touch is not None:
            at = shown(np.array([[FACE.ahead, moment.touch.lateral]]))[0]
            axes.plot(*at, "o", color=BELIEVED, markersize=8.0, markeredgecolor="white", zorder=6)
        if truth.kind != "none":
            at = shown(np.array([truth.contact]))[0]
            axes.plot(*at, "o", color=TRUTH, fillstyle="none", markersize=11.0, zorder=7)
        axes.set(xlim=CLOSE[:2], ylim=CLOSE[2:], aspect="equal", xticks=[], yticks=[])
        axes.set_title("close up, ahead is up", loc="left", fontsize=9)
        axes.set_xlabel("○ truth   ● fused, with 2σ   ▲ one source alone", fontsize=8)

    def _draw_bars(self, moment: Moment) -> None:
        """Draw the shares of sources in the contact."""
        axes, sources = self._bars, self._story.sources[::-1]
        shares = [100.0 * moment.shares.get(name, 0.0) for name in sources]
        colours = [SOURCES.get(name, "#555555") for name in sources]
        axes.barh(sources, shares, color=colours)
        for row, share in enumerate(shares):
            axes.text(share + 3.0, row, f"{share:.0f} %", va="center", fontsize=9)
        axes.set(xlim=(0.0, 135.0), xticks=[])
        axes.set_title("who feels it", loc="left", fontsize=9)
        axes.set_xlabel("share of the contact", fontsize=8)


def dies(story: Story, moment: Moment, stride: int) -> bool:
    """Whether the skin dies in the frame of a moment.

    Args:
        story: of the push.
        moment: that is drawn.
        stride: cycles from frame to frame.
    """
    return 0.0 <= moment.stamp - story.dies < stride * story.push.period - 1e-6


def _skin(moment: Moment, width: float) -> dict[str, Any]:
    """Style of the skin's line, healthy or silent."""
    if moment.silent > 0.0:
        return {"color": DEAD, "linestyle": ":", "linewidth": width, "zorder": 3}
    return {"color": SOURCES["skin"], "linewidth": width, "zorder": 3}


def _placed(points: FloatArray, pose: tuple[float, float, float]) -> FloatArray:
    """Points of shape (n, 2) [m] in the world, from the frame at x, y [m] and yaw [rad]."""
    placed: FloatArray = points @ planar_rotation(pose[2]).T + pose[:2]
    return placed


def _seen(points: FloatArray, pose: tuple[float, float, float]) -> FloatArray:
    """Points of shape (n, 2) [m] in the frame at x, y [m] and yaw [rad], from the world."""
    seen: FloatArray = (points - np.array(pose[:2])) @ planar_rotation(pose[2])
    return seen


def distance_figure(story: Story) -> bytes:
    """Figure of the distance of the contact from the target, true and believed, as PNG."""
    figure, axes = _empty(story, "to the target [m]")
    alone = [moment for moment in story.alone if moment.truth.kind != "none"]
    # between two touches the box stands still
    stamps = [*(moment.stamp for moment in alone), story.alone[-1].stamp]
    distances = [*(moment.truth.distance for moment in alone), alone[-1].truth.distance]
    style = {"color": "#888888", "linestyle": ":", "label": "with the skin alone"}
    axes.step(stamps, distances, where="post", **style)
    rows = [(moment.stamp, moment.truth.distance, moment.left) for moment in story.moments]
    stamp, true, believed = np.array(rows).T
    axes.plot(stamp, true, color=TRUTH, linewidth=2.5, label="truth")
    axes.plot(stamp, believed, color=BELIEVED, linestyle="--", label="believed")
    axes.axhspan(0.0, story.push.within, color=COLOURS[2], alpha=0.3, label="arrived")
    axes.set_ylim(bottom=0.0)
    return _png(figure, axes)


def lateral_figure(story: Story) -> bytes:
    """Figure of the lateral position of the contact, true, fused and by single sources, as PNG."""
    figure, axes = _empty(story, "contact, left of the middle [cm]")
    stamp = [moment.stamp for moment in story.moments]
    true = [100.0 * moment.truth.contact[1] for moment in story.moments]
    fused = [100.0 * moment.touch.lateral if moment.touch else np.nan for moment in story.moments]
    axes.plot(stamp, true, color=TRUTH, linewidth=2.5, label="truth")
    for source in story.last.alone:
        beliefs = [100.0 * moment.alone[source] for moment in story.moments]
        colour = SOURCES.get(source, "#555555")
        axes.plot(stamp, beliefs, ".", color=colour, markersize=4.0, label=f"{source} alone")
    axes.plot(stamp, fused, color=BELIEVED, linestyle="--", label="fused")
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.8, zorder=0)
    return _png(figure, axes)


def shares_figure(story: Story) -> bytes:
    """Figure of the shares of sources in the contact, as PNG."""
    figure, axes = _empty(story, "share of the contact [%]")
    stamp = [moment.stamp for moment in story.moments]
    shares = [
        [100.0 * moment.shares.get(source, 0.0) for moment in story.moments]
        for source in story.sources
    ]
    colours = [SOURCES.get(source, "#555555") for source in story.sources]
    axes.stackplot(stamp, shares, labels=story.sources, colors=colours, alpha=0.8)
    axes.set_ylim(0.0, 100.0)
    return _png(figure, axes)


def _png_of(figure: Figure) -> bytes:
    """A figure as a PNG file."""
    content = io.BytesIO()
    figure.savefig(content, dpi=160, format="png")
    return content.getvalue()


def _empty(story: Story, label: str) -> tuple[Figure, Any]:
    figure = new_figure(*SIZE)
    axes = figure.subplots()
    axes.axvline(story.dies, color=DEAD, linewidth=1.5, zorder=5)
    axes.annotate(
        "the skin dies",
        (story.dies, 1.0),
        (4.0, -4.0),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        color=DEAD,
        va="top",
        zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5},
    )
    axes.set(xlabel="time [s]", ylabel=label, xlim=(0.0, story.last.stamp))
    axes.locator_params(axis="x", steps=[1, 2, 5, 10])
    axes.grid(linewidth=0.3, color="#cccccc")
    axes.set_axisbelow(True)
    return figure, axes


def _png(figure: Figure, axes: Any) -> bytes:
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=4, frameon=False)
    return _png_of(figure)
