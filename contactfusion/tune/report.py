"""Report of `tune fusion`: a table, a picture, a CSV file, a JSON file and the line to use."""

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import write_whole
from contactfusion.terminal import printable
from contactfusion.tune.fusion import Trial, Tuned
from contactfusion.tune.score import ALIKE, Half, Rate

HEADS = ("setting", "missed", "false", "off by", "| missed", "false", "off by")
COLUMNS = (
    "set", "field", "value", "half", "configured", "chosen", "missed_steps", "contact_steps",
    "missed_share", "missed_low", "missed_high", "false_steps", "free_steps",
    "false_share", "false_low", "false_high", "error_median_m", "cost",
)  # fmt: skip
TITLES = ("first half: chosen here", "second half: reported here")
CLEAR = 6.0
"""Values of one field that lie nearer to a named point are not named [%]."""
Axes = Any


def table(tuned: Tuned) -> str:
    """The table for people: each run on the first half, and after the bar on the second."""
    idle = {path for path, curve in tuned.curves.items() if _is_idle(tuned, curve)}
    rows = [HEADS, *(_cells(tuned, trial) for trial in tuned.trials() if trial.field not in idle)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADS))]
    lines = [
        f"chosen on the first half, until {tuned.split:.6g} s | reported on the second; parts of "
        f"steps, with 95 % intervals as if {ALIKE:g} s were one sample",
        *(
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ),
        *(f"no value of {path} that was tried makes a difference" for path in sorted(idle)),
        "",
        advice(tuned),
    ]
    return "\n".join(map(printable, lines))


def advice(tuned: Tuned) -> str:
    """The settings to use, and how they do on the second half."""
    before, after = tuned.configured.reported_on, tuned.chosen.reported_on
    if not tuned.chosen.overrides:
        return "keep what is configured: nothing that was tried is better on the first half"
    shares = (
        f"on the second half it misses {_percent(after.missed.share)} and tells "
        f"{_percent(after.false.share)} falsely, as configured {_percent(before.missed.share)} "
        f"and {_percent(before.false.share)}"
    )
    if not tuned.is_better:
        return (
            f"keep what is configured: {set_line(tuned)} is better on the first half, but not on "
            f"the second: {shares}"
        )
    return f"use {set_line(tuned)}\n{shares}"


def set_line(tuned: Tuned) -> str:
    """The options that make the changes that were chosen."""
    return " ".join(f"--set {change}" for change in tuned.chosen.overrides)


def as_csv(tuned: Tuned) -> str:
    """One row a run and half; lengths in m, empty where there is none."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for trial in tuned.trials():
        for number, half in enumerate(trial.score.halves, 1):
            row = _row(tuned, trial, number, half)
            writer.writerow([row[name] for name in COLUMNS])
    return text.getvalue()


def as_json(tuned: Tuned) -> str:
    """The runs as in the CSV file, what was chosen, and whether it is better."""
    rows = [
        _row(tuned, trial, number, half)
        for trial in tuned.trials()
        for number, half in enumerate(trial.score.halves, 1)
    ]
    held = {
        "chosen": list(tuned.chosen.overrides),
        "better_on_second_half": tuned.is_better,
        "split_s": tuned.split,
        "best_by_field": {path: trial.value for path, trial in tuned.best.items()},
        "runs": rows,
    }
    return json.dumps(held, indent=1, allow_nan=False) + "\n"


def write_tuning(tuned: Tuned, out: Path) -> list[Path]:
    """Write tuning.csv and tuning.json; their paths."""
    contents = {"tuning.csv": as_csv(tuned), "tuning.json": as_json(tuned)}
    for name, content in contents.items():
        write_whole(out / name, content)
    return [out / name for name in contents]


def write_picture(tuned: Tuned, out: Path) -> Path:
    """Write tuning.png; its path.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    path = out / "tuning.png"
    write_whole(path, picture(tuned))
    return path


def _row(tuned: Tuned, trial: Trial, number: int, half: Half) -> dict[str, Any]:
    (missed_low, missed_high), (false_low, false_high) = half.missed.interval, half.false.interval
    values: dict[str, Any] = {
        "set": " ".join(trial.overrides),
        "field": trial.field,
        "value": trial.value,
        "half": number,
        "configured": trial is tuned.configured,
        "chosen": trial.overrides == tuned.chosen.overrides,
        "missed_steps": half.missed.wrong,
        "contact_steps": half.missed.steps,
        "missed_share": half.missed.share,
        "missed_low": missed_low,
        "missed_high": missed_high,
        "false_steps": half.false.wrong,
        "free_steps": half.false.steps,
        "false_share": half.false.share,
        "false_low": false_low,
        "false_high": false_high,
        "error_median_m": half.error,
        "cost": half.cost,
    }
    return {name: _plain(value) for name, value in values.items()}


def _cells(tuned: Tuned, trial: Trial) -> tuple[str, ...]:
    name = " ".join(trial.overrides) or "as configured"
    if trial is tuned.together:
        name = "the best of each together"
    mark = " *" if trial.overrides == tuned.chosen.overrides else ""
    first, second = (_half_cells(half) for half in trial.score.halves)
    return f"{name}{mark}", *first, f"| {second[0]}", *second[1:]


def _is_idle(tuned: Tuned, curve: Sequence[Trial]) -> bool:
    """Whether all values of a field give the same score."""
    same = [half.as_dict() for half in tuned.configured.score.halves]
    return all([half.as_dict() for half in trial.score.halves] == same for trial in curve)


def _half_cells(half: Half) -> tuple[str, str, str]:
    error = "-" if math.isnan(half.error) else f"{half.error * 1000.0:.1f} mm"
    return _share_cell(half.missed), _share_cell(half.false), error


def _share_cell(rate: Rate) -> str:
    if math.isnan(rate.share):
        return "-"
    low, high = rate.interval
    return f"{_percent(rate.share)} ({low:.0%} to {high:.0%})"


def _percent(share: float) -> str:
    return "nothing" if math.isnan(share) else f"{share:.1%}"


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value


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
    halves = [trial.score.halves[half] for trial in trials]
    false = [100.0 * float(np.nan_to_num(trial.false.share)) for trial in halves]
    return false, [100.0 * float(np.nan_to_num(trial.missed.share)) for trial in halves]


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
