"""Tables and figures of the grasp experiment, and its summary."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import write_whole
from contactfusion_lab.experiments.grasp.trial import Row
from contactfusion_lab.trials.measures import holm, mcnemar, proportion, resampled

MEASURES: dict[str, tuple[str, float, str]] = {
    "moved": ("moved before cm", 100.0, ".1f"),
    "corrections": ("corrections", 1.0, ".2f"),
    "time": ("time s", 1.0, ".1f"),
    "force": ("greatest push N", 1.0, ".1f"),
}
"""What is told beside success: heading, scale and form."""
LISTED = 40
"""So many failures of a column are listed; all are in results.csv."""
Found = Mapping[str, Sequence[Row]]
"""Grasps by column."""
GOOD, BAD = COLOURS[2], COLOURS[1]


def summary_of(rows: Sequence[Row], seed: int) -> dict[str, Any]:
    """What a column reached: of all objects, and of each.

    Successes have Wilson intervals, means percentile bootstrap intervals over grasps.

    Args:
        rows: of one column.
        seed: of the bootstrap; each figure has chance of its own.
    """
    parts = {"all": rows} | {
        thing: [row for row in rows if row.object == thing]
        for thing in dict.fromkeys(row.object for row in rows)
    }
    return {name: _summary(name, part, seed) for name, part in parts.items()}


def success_text(found: Found, summaries: Mapping[str, Mapping[str, Any]]) -> str:
    """The table of all columns as Markdown: success by object, and the measures of all.

    Args:
        found: grasps by column.
        summaries: of each column, as `summary_of` gives it.
    """
    things = list(dict.fromkeys(row.object for rows in found.values() for row in rows))
    headings = ["", *things, "all, 95 % interval", *(told[0] for told in MEASURES.values())]
    lines = [_line(headings), "|" + "---|" * len(headings)]
    for column in found:
        told = summaries[column]
        cells = [column]
        for thing in things:
            part = told.get(thing)
            cells.append(f"{part['success']['hits']}/{part['n']}" if part else "-")
        share = told["all"]["success"]
        cells.append(
            f"{100.0 * share['share']:.1f} % [{100.0 * share['low']:.1f}, "
            f"{100.0 * share['high']:.1f}]"
        )
        for measure, (_, scale, form) in MEASURES.items():
            mean, low, high = (scale * told["all"][measure][key] for key in ("mean", "low", "high"))
            cells.append(f"{mean:{form}} [{low:{form}}, {high:{form}}]")
        lines.append(_line(cells))
    return "\n".join(lines)


def comparisons_of(found: Found) -> list[dict[str, Any]]:
    """Compare each column with the first, grasp by grasp, by McNemar's exact test.

    Every p-value is told twice: by itself, and as it counts among all of them. Nothing is compared
    when the first has no grasps.

    Args:
        found: grasps by column, perhaps none.
    """
    (first, ours), *others = found.items()
    if not ours:
        return []
    by_name = {row.trial: row.success for row in ours}
    compared = list[dict[str, Any]]()
    for column, rows in others:
        if not rows:
            continue
        pairs = [(by_name[row.trial], row.success) for row in rows if row.trial in by_name]
        only, other = pairs.count((True, False)), pairs.count((False, True))
        compared.append(
            {
                "column": column,
                "against": first,
                "grasps": len(pairs),
                "only it": other,
                "only the other": only,
                "p": mcnemar(only, other),
            }
        )
    corrected = holm([one["p"] for one in compared])
    return [{**one, "p (Holm)": p} for one, p in zip(compared, corrected, strict=True)]


def comparisons_text(compared: Sequence[Mapping[str, Any]]) -> str:
    """Comparisons as Markdown."""
    names = ["column", "against", "grasps", "only it", "only the other", "p", "p (Holm)"]
    lines = [_line(names), "|" + "---|" * len(names)]
    lines += [
        _line([f"{one[name]:.2g}" if name.startswith("p") else str(one[name]) for name in names])
        for one in compared
    ]
    return "\n".join(lines)


def failures_text(found: Found) -> str:
    """List the grasps that failed by column, with their ends and reasons."""
    lines: list[str] = []
    for column, rows in found.items():
        failed = [row for row in rows if not row.success]
        lines.append(f"{column}: {len(failed)} of {len(rows)}")
        for row in failed[:LISTED]:
            fallen = ", fallen over" if row.fallen else ""
            lines.append(
                f"- {row.trial}: {100.0 * row.offset:+.1f} cm aside: {row.ending}, {row.reason}; "
                f"{100.0 * row.height:.1f} cm high{fallen}"
            )
        if len(failed) > LISTED:
            lines.append(f"- … and {len(failed) - LISTED} more: results.csv")
        lines.append("")
    return "\n".join(lines).strip()


def _summary(name: str, rows: Sequence[Row], seed: int) -> dict[str, Any]:
    value, low, high = proportion(np.array([row.success for row in rows]))
    hits = sum(row.success for row in rows)
    told: dict[str, Any] = {
        "n": len(rows),
        "success": {"hits": hits, "share": value, "low": low, "high": high},
        "endings": {
            ending: sum(row.ending == ending for row in rows)
            for ending in dict.fromkeys(row.ending for row in rows)
        },
        "fallen": sum(row.fallen for row in rows),
    }
    for measure in MEASURES:
        values = np.array([getattr(row, measure) for row in rows], np.float64)
        entropy = f"{rows[0].column}, {name}, {measure}"
        rng = np.random.default_rng([seed, crc32(entropy.encode())])
        mean, low, high = resampled(values, np.mean, rng)
        told[measure] = {"mean": mean, "low": low, "high": high}
    return told


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


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
