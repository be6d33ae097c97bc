"""The trade between missed and false contacts: a curve for each field that was varied."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from contactfusion.figures import COLOURS, new_figure
from contactfusion.tuning.fusion import Trial, Tuned

TITLES = ("first half: chosen here", "second half: reported here")
CLEAR = 6.0
"""Values that lie so near to a named one are not named [%]."""
Axes = Any


def picture(tuned: Tuned) -> bytes:
    """Draw what is missed over what is false, for each half; a PNG file.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    figure = new_figure(11.0, 5.6)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for half, (axes, title) in enumerate(zip(panels, TITLES, strict=True)):
        _draw(axes, tuned, half)
        axes.set(title=title, xlabel="false contacts [% of steps without one]")
        axes.grid(linewidth=0.3, color="#cccccc")
        axes.set_axisbelow(True)
        if half == 0:
            axes.set_ylabel("missed contacts [% of steps with one]")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    content = io.BytesIO()
    figure.savefig(content, dpi=120, format="png")
    return content.getvalue()


def _draw(axes: Axes, tuned: Tuned, half: int) -> None:
    named: list[tuple[float, float]] = []
    for number, (path, curve) in enumerate(tuned.curves.items()):
        colour = COLOURS[number % len(COLOURS)]
        points = _points(curve, half)
        axes.plot(*points, "-o", color=colour, markersize=4.0, linewidth=1.2, label=path)
        for trial, x, y in zip(curve, *points, strict=True):
            if all(abs(x - other) + abs(y - at) > CLEAR for other, at in named):
                named.append((x, y))
                axes.annotate(
                    _short(trial.value), (x, y), (5.0, 5.0),
                    textcoords="offset points", fontsize=8, color=colour,
                )  # fmt: skip
        best = _points([tuned.best[path]], half)
        axes.plot(*best, "*", color=colour, markersize=13.0, markeredgecolor="white")
    marks = {"as configured": (tuned.configured, "s", "#222222")}
    if tuned.chosen.overrides:
        marks["chosen"] = (tuned.chosen, "o", "#cc0000")
    for label, (trial, marker, colour) in marks.items():
        axes.plot(
            *_points([trial], half), marker, color=colour, markerfacecolor="none", markersize=14.0,
            markeredgewidth=1.8, linestyle="none", label=label,
        )  # fmt: skip
    axes.plot([], [], "*", color="#888888", markersize=11.0, label="best of its field")
    axes.margins(0.12)


def _points(trials: Sequence[Trial], half: int) -> tuple[list[float], list[float]]:
    halves = [one.score.halves[half] for one in trials]
    false = [100.0 * float(np.nan_to_num(one.false.share)) for one in halves]
    return false, [100.0 * float(np.nan_to_num(one.missed.share)) for one in halves]


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
