"""What an ablation found: a table, a CSV file, a JSON file and a picture."""

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.errors import ContactFusionError
from contactfusion.explaining.ablation import Worth
from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import make_folder, write_whole

CAUTION = (
    "Each step was fused again without the source. Controllers, and generators that remember, were "
    "not run again. Steps that follow each other are alike: these are counts, not intervals."
)
HEADS = ("without", "lost", "gained", "steps with contact", "median", "p95", "likelihood", "share")


def table(worths: Sequence[Worth]) -> str:
    """Give the table for people; what belongs to a generator stands indented below it."""
    names = _names(worths)
    rows = [HEADS, *((name, *_cells(one)) for name, one in zip(names, worths, strict=True))]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADS))]
    lines = []
    for row in rows:
        first, *rest = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        lines.append("  ".join([row[0].ljust(len(first)), *rest]).rstrip())
    return "\n".join([*lines, "", CAUTION])


def as_csv(worths: Sequence[Worth]) -> str:
    """Give one row a generator or source; lengths in m, empty for NaN."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Worth.__dataclass_fields__)
    for one in worths:
        writer.writerow([_plain(value) for value in asdict(one).values()])
    return text.getvalue()


def as_json(worths: Sequence[Worth]) -> str:
    """Give a list of objects; lengths in m, null for NaN."""
    rows = [{name: _plain(value) for name, value in asdict(one).items()} for one in worths]
    return json.dumps({"caution": CAUTION, "without": rows}, indent=1) + "\n"


def picture(worths: Sequence[Worth]) -> bytes:
    """Draw what is lost, gained and moved without each; a PNG file.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    figure = new_figure(11.0, 1.8 + 0.45 * len(worths))
    counts, moves = figure.subplots(1, 2, sharey=True)
    rows = -np.arange(len(worths))
    contacts = max((one.contacts for one in worths), default=0) or 1
    lost = [100.0 * one.lost / contacts for one in worths]
    gained = [100.0 * one.gained / contacts for one in worths]
    counts.barh(rows + 0.2, lost, height=0.36, color=COLOURS[1], label="lost without it")
    counts.barh(rows - 0.2, gained, height=0.36, color=COLOURS[0], label="there only without it")
    for row, one in zip(rows, worths, strict=True):
        median, far = one.moved_median * 1000.0, one.moved_p95 * 1000.0
        moves.plot([median, far], [row, row], color="#888888", zorder=1)
        first = row == 0
        moves.plot(median, row, "o", color=COLOURS[2], label="median" if first else None)
        moves.plot(far, row, "|", markersize=12, color="#222222", label="95 %" if first else None)
    counts.set(xlabel=f"part of {contacts} contacts [%]", xlim=(0.0, max(100.0, *gained)))
    counts.set_yticks(rows, _names(worths))
    moves.set(xlabel="contacts that remain move by [mm]")
    moves.set_xlim(left=0.0)
    for axes in (counts, moves):
        axes.grid(axis="x", linewidth=0.3, color="#cccccc")
        axes.set_axisbelow(True)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    counts.set_ylim(-len(worths) + 0.4, 0.6)
    content = io.BytesIO()
    figure.savefig(content, dpi=120, format="png")
    return content.getvalue()


def write_ablation(worths: Sequence[Worth], out: Path) -> list[Path]:
    """Write ablation.csv and ablation.json, and return their paths.

    Raises:
        ContactFusionError: there was no step or no source, so there is nothing to tell.
    """
    if not worths:
        raise ContactFusionError("the recording leads to no step with a source, so nothing is left")
    make_folder(out)
    contents = {"ablation.csv": as_csv(worths), "ablation.json": as_json(worths)}
    for name, content in contents.items():
        write_whole(out / name, content)
    return [out / name for name in contents]


def write_picture(worths: Sequence[Worth], out: Path) -> Path:
    """Write ablation.png, and return its path.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    write_whole(out / "ablation.png", picture(worths))
    return out / "ablation.png"


def _names(worths: Sequence[Worth]) -> list[str]:
    """Give what people call the rows; sources of a generator with several stand indented."""
    several = {one.name.split("/")[0] for one in worths if not one.whole}
    return [
        f"  {one.name}" if not one.whole else one.name + " (all)" * (one.name in several)
        for one in worths
    ]


def _cells(one: Worth) -> tuple[str, ...]:
    steps = f"{one.steps_with} -> {one.steps_without} of {one.steps}"
    change = "-" if math.isnan(one.likelihood_change) else f"{one.likelihood_change:+.2f}"
    share = "-" if math.isnan(one.share) else f"{one.share:.0%}"
    lost = f"{one.lost} of {one.contacts}"
    moves = (_millimetres(one.moved_median), _millimetres(one.moved_p95))
    return lost, str(one.gained), steps, *moves, change, share


def _millimetres(metres: float) -> str:
    return "-" if math.isnan(metres) else f"{metres * 1000.0:.1f} mm"


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value
