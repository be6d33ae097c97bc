"""Figures of the grasp experiment (extra `plot`)."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import write_whole
from contactfusion_lab.experiments.grasp.tables import Found

GOOD, BAD = COLOURS[2], COLOURS[1]


def draw_success(summaries: Mapping[str, Mapping[str, Any]], path: Path) -> Path:
    """Draw the success of each column with its interval, and how far the object was moved.

    Args:
        summaries: by column, as `summary_of` gives them.
        path: the PNG to write.
    """
    figure = new_figure(9.0, 1.2 + 0.45 * len(summaries))
    left, right = figure.subplots(1, 2, sharey=True)
    rows = np.arange(len(summaries))
    for axes, part, scale in ((left, "success", 100.0), (right, "moved", 100.0)):
        told = [summary["all"][part] for summary in summaries.values()]
        middle = scale * np.array([one["share" if part == "success" else "mean"] for one in told])
        ends = scale * np.array([[one["low"], one["high"]] for one in told]).T
        axes.barh(rows, middle, color=COLOURS[0], alpha=0.8)
        axes.errorbar(
            middle, rows, xerr=np.abs(ends - middle), fmt="none", color="black", capsize=3
        )
        axes.grid(axis="x", linewidth=0.3)
        axes.set_axisbelow(True)
    left.set_yticks(rows, [_label(name) for name in summaries])
    left.invert_yaxis()
    left.set(xlabel="lifted and held [%]", xlim=(0.0, 101.0))
    right.set(xlabel="moved before it was grasped [cm]")
    return _saved(figure, path)


def draw_places(found: Found, path: Path) -> Path:
    """Draw for each column how far aside the object stood, and what came of the grasp.

    Args:
        found: grasps by column.
        path: the PNG to write.
    """
    figure = new_figure(9.0, 1.2 + 0.6 * len(found))
    axes: Any = figure.subplots()
    for number, rows in enumerate(found.values()):
        offsets = 100.0 * np.array([row.offset for row in rows])
        good = np.array([row.success for row in rows])
        # the order of the trials spreads the dots
        spread = number + 0.3 * np.linspace(-1.0, 1.0, len(rows))
        for kept, colour, name in ((good, GOOD, "held"), (~good, BAD, "not held")):
            label = name if number == 0 else None
            axes.plot(offsets[kept], spread[kept], "o", markersize=3.0, color=colour, label=label)
    axes.set_yticks(range(len(found)), [_label(name) for name in found])
    axes.invert_yaxis()
    axes.set(xlabel="how far beside the hand's way the object stood, to the left [cm]")
    figure.legend(loc="outside upper right", ncols=2, fontsize="small")
    return _saved(figure, path)


def _label(column: str) -> str:
    sources, _, method = column.partition("-")
    return f"{sources}\n{method.replace('_', ' ')}" if method else "open loop"


def _saved(figure: Any, path: Path) -> Path:
    content = io.BytesIO()
    figure.savefig(content, dpi=120, format="png")
    write_whole(path, content.getvalue())
    return path
