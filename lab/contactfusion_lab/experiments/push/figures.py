"""Figures of the push experiment: where it succeeds, the trajectories, how it moves."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, product
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd

from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion_lab.experiments.push.trial import Track
from contactfusion_lab.scenes.push.scene import mobile_base
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import CASE, Comparison

STRIDE = 5
"""Cycles between two points of a drawn trajectory."""
LARGE = 40
"""Number of targets of a panel up to which they are drawn large."""
REACH = (2.9, 3.4)
"""Least extent of the floor in a panel: while targets are near, and else [m]."""
FAR = 2.6
"""Distance up to which targets are near [m]."""
TRUE, DECLARED, FAILED = COLOURS[2], COLOURS[4], COLOURS[1]
FRICTIONS = {"mu1": "µ1", "mu2": "µ2"}
BARS: dict[str, tuple[str, float]] = {
    "lateral_true": ("mean |l| [cm]", 100.0),
    "lateral_estimate": ("mean |l̂| [cm]", 100.0),
    "swept": ("swept angle (Eq 12) [rad/s]", 1.0),
    "time": ("time [s]", 1.0),
}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Trajectories of robot and object.

    Attributes:
        base: shape (n, 2), of the robot's frame in `odom` [m].
        object: shape (n, 2), of the object [m].
    """

    base: FloatArray
    object: FloatArray

    @classmethod
    def of(cls, track: Track) -> Self:
        """Thin out a track."""
        rows = np.unique(np.append(np.arange(0, len(track.stamp), STRIDE), len(track.stamp) - 1))
        return cls(track.base[rows, :2], track.object[rows, :2])


def draw_map(outcomes: pd.DataFrame, path: Path) -> Path:
    """Draw the outcomes of the pushes to each target, one panel an object (as O Fig 3).

    Args:
        outcomes: of one sensor suite and controller.
        path: the PNG to write.
    """
    objects, frictions = (list(outcomes[name].unique()) for name in ("object", "friction"))
    figure = new_figure(4.3 * len(objects), 5.1)
    panels = figure.subplots(1, len(objects), squeeze=False, sharey=True)[0]
    for axes, name in zip(panels, objects, strict=True):
        here = outcomes[outcomes["object"] == name]
        large = len(here) <= LARGE * len(frictions)
        for number, friction in enumerate(frictions):
            shift = (number - (len(frictions) - 1) / 2.0) * 0.3 * large
            _mark(here[here["friction"] == friction], axes, shift, large, number)
        _floor(axes, outcomes)
        axes.set_title(f"{name}: {here['success_true'].sum()} of {len(here)} true successes")
    title = f"{outcomes[CASE].iloc[0]}; numbers: least true distance without true success [cm]"
    _dress(figure, title, _map_legend(frictions))
    return save_figure(figure, path)


def draw_trajectories(
    outcomes: pd.DataFrame, trajectories: Sequence[Trajectory], path: Path
) -> Path:
    """Draw the trajectories of robot and object, one panel an object and friction.

    Args:
        outcomes: of one sensor suite and controller.
        trajectories: of these pushes.
        path: the PNG to write.
    """
    from matplotlib.lines import Line2D

    objects, frictions = (list(outcomes[name].unique()) for name in ("object", "friction"))
    shape = len(frictions), len(objects)
    figure = new_figure(4.3 * len(objects), 4.3 * len(frictions) + 0.8)
    panels = figure.subplots(*shape, squeeze=False, sharex=True, sharey=True)
    for (row, friction), (column, name) in product(enumerate(frictions), enumerate(objects)):
        axes = panels[row, column]
        chosen = (outcomes["object"] == name) & (outcomes["friction"] == friction)
        pushes = outcomes[chosen].to_dict("records")
        for trajectory, push in zip(compress(trajectories, chosen), pushes, strict=True):
            colour = COLOURS[0] if push["success_true"] else FAILED
            axes.plot(*trajectory.base.T, color="#bbbbbb", linewidth=0.5, zorder=1)
            axes.plot(*trajectory.object.T, color=colour, linewidth=0.9, zorder=2, alpha=0.8)
            axes.plot(
                push["target_x"], push["target_y"], "+", color=colour, markersize=7.0, zorder=3
            )
        _floor(axes, outcomes)
        axes.set_title(f"{name} {FRICTIONS.get(friction, friction)}")
    handles = [
        Line2D([], [], color=COLOURS[0], label="object, true success"),
        Line2D([], [], color=FAILED, label="object, none"),
        Line2D([], [], color="#bbbbbb", label="robot's frame"),
        Line2D([], [], color="black", marker="+", linestyle="", label="target"),
    ]
    _dress(figure, outcomes[CASE].iloc[0], handles)
    return save_figure(figure, path)


def draw_bars(outcomes: pd.DataFrame, comparisons: Sequence[Comparison], path: Path) -> Path:
    """Draw means with standard errors (as O Fig 4), stars by Wilcoxon's test.

    Args:
        outcomes: of all sensor suites and controllers.
        comparisons: of each but the first with one before it.
        path: the PNG to write.
    """
    names = outcomes[CASE].unique()
    figure = new_figure(max(10.0, 1.1 * len(names) * len(BARS) / 2.0), 0.34 * len(names) + 1.8)
    panels = figure.subplots(1, len(BARS), sharey=True)
    places = np.arange(len(names))[::-1]
    stars = {(each.case, each.measure): each.stars for each in comparisons if each.trials}
    for axes, (measure, (title, scale)) in zip(panels, BARS.items(), strict=True):
        for row, (place, name) in enumerate(zip(places, names, strict=True)):
            values = outcomes.loc[outcomes[CASE] == name, measure].dropna().to_numpy() * scale
            if not len(values):
                continue
            mean = float(values.mean())
            error = float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0
            axes.barh([place], [mean], xerr=[error], height=0.7, color=COLOURS[5 * (row > 0)])
            text = f" {stars.get((name, measure), '')}"
            axes.text(mean + error, place, text, va="center", fontsize=8)
        axes.set_title(title, fontsize=10)
        axes.margins(x=0.18)
        axes.grid(axis="x", linewidth=0.3)
        axes.set_axisbelow(True)
    panels[0].set_yticks(places, names)
    figure.supxlabel(
        "mean and standard error over all pushes; against the first with the same controller, or "
        "else the same sensing, where both truly succeed: *** p (Holm) < 0.001, ** < 0.01, * < 0.05"
        if comparisons
        else "mean and standard error over all pushes",
        fontsize=8,
    )
    return save_figure(figure, path)


def _mark(outcomes: pd.DataFrame, axes: Any, shift: float, large: bool, number: int) -> None:
    """Mark targets by the outcomes of their pushes."""
    for push in outcomes.to_dict("records"):
        declared, won = push["success_estimate"], push["success_true"]
        colour = TRUE if won else DECLARED if declared else FAILED
        axes.scatter(
            [push["target_x"] + shift],
            [push["target_y"]],
            s=130.0 if large else 28.0,
            marker=("o", "s", "D", "^")[number % 4] if declared else "x",
            color=colour,
            linewidths=2.0 if not declared else 0.0,
            zorder=2 if won else 3,
        )
        if large and not won:
            least = push["least_distance"]
            text = f"{least * 100:.1f}" if np.isfinite(least) else "–"
            place = (push["target_x"] + shift, push["target_y"] - 0.22)
            axes.annotate(text, place, ha="center", va="top", fontsize=7, color=colour)


def _map_legend(frictions: Sequence[str]) -> list[Any]:
    from matplotlib.lines import Line2D

    shapes = [
        Line2D([], [], color="#555555", marker=marker, linestyle="", markersize=8.0,
               label=FRICTIONS.get(friction, friction))
        for friction, marker in zip(frictions, "osD^", strict=False)
    ]  # fmt: skip
    became = [
        Line2D([], [], color=TRUE, marker="o", linestyle="", label="true success"),
        Line2D([], [], color=DECLARED, marker="o", linestyle="", label="arrived by estimate only"),
        Line2D([], [], color=FAILED, marker="x", linestyle="", label="not arrived"),
    ]
    return [*shapes, *became]


def _dress(figure: Any, title: str, handles: Sequence[Any]) -> None:
    """Put a title over all panels and a legend under them, in lines of their own."""
    head, foot = 0.35 / figure.get_figheight(), 0.45 / figure.get_figheight()
    figure.get_layout_engine().set(rect=(0.0, foot, 1.0, 1.0 - foot - head))
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False)
    figure.text(0.5, 1.0 - head / 2.0, title, ha="center", va="center", fontsize=11)


def _floor(axes: Any, outcomes: pd.DataFrame) -> None:
    """Draw robot and axes; every panel shows as much, for all outcomes, also one that has none."""
    from matplotlib.patches import Rectangle

    length, width, _ = mobile_base().size
    robot = Rectangle(
        (-length, -width / 2.0), length, width, facecolor="#dddddd", edgecolor="#777777", zorder=0
    )
    axes.add_patch(robot)
    furthest = float(outcomes[["target_x", "target_y"]].abs().to_numpy().max(initial=0.0))
    reach = max(REACH[furthest > FAR], furthest + 0.3)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set_xlabel("x [m]", fontsize=8)
    axes.set_ylabel("y [m]", fontsize=8)
    axes.label_outer()
