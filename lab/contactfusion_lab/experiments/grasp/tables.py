"""Tables and figures of the grasp experiment, and its summary."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from contactfusion.figures import COLOURS, new_figure
from contactfusion.terminal import note
from contactfusion_lab.experiments.grasp.trial import Row
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import CASE, compared, parts_of
from contactfusion_lab.trials.tables import (
    Units,
    bullets,
    comparisons_text,
    failures_text,
    frame_of,
    measures_text,
    success_text,
    summary_of,
    write_results,
)

MEASURES: Units = {
    "moved": ("moved before cm", 100.0, ".1f"),
    "corrections": ("corrections", 1.0, ".2f"),
    "time": ("time s", 1.0, ".1f"),
    "force": ("greatest push N", 1.0, ".1f"),
}
"""The units of what is measured beside success."""
LISTED = 40
"""Number of failures of a column that are listed; all are in results.csv."""
GOOD, BAD = COLOURS[2], COLOURS[1]


def rows_of(found: Sequence[Row]) -> pd.DataFrame:
    """Grasps as a data frame, one row each; the column is the case."""
    frame = frame_of(found, Row)
    return frame.assign(**{CASE: frame["column"]})


def evaluate(
    found: Sequence[Row], columns: Sequence[str], failed: Sequence[str], seed: int, out: Path
) -> None:
    """Write tables, files and figures.

    Args:
        found: grasps that were made.
        columns: the first is the one that the others are compared with, if it has grasps.
        failed: a sentence for each grasp that could not be made.
        seed: of the bootstrap.
        out: the folder that takes the results.
    """
    frame = rows_of(found)
    cases = list(frame[CASE].unique())
    pairs = [(case, columns[0]) for case in cases if columns[0] in cases and case != columns[0]]
    compared_all = compared(frame, pairs, "success", list(MEASURES), seed)
    summaries = {case: _summary(part, seed) for case, part in parts_of(frame).items()}
    success = success_text(frame, ["object"], {"success": ""})
    measures = measures_text(summaries, "mean", MEASURES)
    write_results(
        out,
        frame,
        {
            "reached": summaries,
            "tests": [asdict(each) for each in compared_all],
            "not made": list(failed),
        },
        {
            "Success": success,
            "Measures": measures,
            "Compared grasp by grasp": comparisons_text(compared_all, MEASURES),
            "Failures": failures_text(frame, "success", [*map(_failure, found)], LISTED),
            "Not made": bullets(failed),
        },
    )
    draw_success(summaries, out / "success.png")
    draw_places(frame, out / "places.png")
    note(f"{success}\n\n{measures}", end="\n\n", lines=True)


def _summary(part: pd.DataFrame, seed: int) -> dict[str, dict[str, Any]]:
    """Success rates of a column; over all grasps also how they ended."""
    summary = summary_of(part, ["object"], ["success"], MEASURES, "mean", seed)
    endings = part["ending"].value_counts(sort=False).to_dict()
    summary["all"] |= {"endings": endings, "fallen": int(part["fallen"].sum())}
    return summary


def _failure(row: Row) -> str:
    fallen = ", fallen over" if row.fallen else ""
    return (
        f"{row.trial}: {100.0 * row.offset:+.1f} cm aside: {row.ending}, {row.reason}; "
        f"{100.0 * row.height:.1f} cm high{fallen}"
    )


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
        reached = [summary["all"][part] for summary in summaries.values()]
        value = "share" if part == "success" else "mean"
        middle = scale * np.array([each[value] for each in reached])
        ends = scale * np.array([[each["low"], each["high"]] for each in reached]).T
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
    return save_figure(figure, path, 120)


def draw_places(frame: pd.DataFrame, path: Path) -> Path:
    """Draw for each column the outcomes of grasps over the lateral offset of the object.

    Args:
        frame: of all grasps.
        path: the PNG to write.
    """
    columns = parts_of(frame)
    figure = new_figure(9.0, 1.2 + 0.6 * len(columns))
    axes: Any = figure.subplots()
    for number, part in enumerate(columns.values()):
        offsets, good = 100.0 * part["offset"].to_numpy(), part["success"].to_numpy()
        # the order of the trials spreads the dots
        spread = number + 0.3 * np.linspace(-1.0, 1.0, len(part))
        for kept, colour, name in ((good, GOOD, "held"), (~good, BAD, "not held")):
            label = name if number == 0 else None
            axes.plot(offsets[kept], spread[kept], "o", markersize=3.0, color=colour, label=label)
    axes.set_yticks(range(len(columns)), [_label(name) for name in columns])
    axes.invert_yaxis()
    axes.set(xlabel="how far beside the hand's way the object stood, to the left [cm]")
    figure.legend(loc="outside upper right", ncols=2, fontsize="small")
    return save_figure(figure, path, 120)


def _label(column: str) -> str:
    sources, _, method = column.partition("-")
    return f"{sources}\n{method.replace('_', ' ')}" if method else "open loop"
