"""The push experiment's table beside the paper's, and the measures of each controller."""

from collections.abc import Mapping, Sequence
from typing import Any
from zlib import crc32

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.experiments.measures import CONFIDENCE, RESAMPLES, proportion
from contactfusion.experiments.push.outcomes import Outcome

Group = tuple[str, str]
"""An object and a friction."""
SUCCESSES = {
    "success_true": "true",
    "success_estimate": "by estimate",
    "ever_true": "ever",
}
"""The three, and what the table calls them (method §7)."""
PAPER: dict[Group, int] = {
    ("box", "mu1"): 23,
    ("box", "mu2"): 24,
    ("cylinder", "mu1"): 19,
    ("cylinder", "mu2"): 19,
    ("nonuniform", "mu1"): 19,
    ("nonuniform", "mu2"): 23,
}
"""Of 24 targets of the grid, by contact skin (O Table I)."""
EACH = 24
MEASURES: dict[str, tuple[str, float, str]] = {
    "time": ("time s", 1.0, ".1f"),
    "path": ("path m", 1.0, ".2f"),
    "final_distance": ("final distance cm", 100.0, ".1f"),
    "lateral_true": ("mean abs. l cm", 100.0, ".1f"),
    "lateral_estimate": ("mean abs. l̂ cm", 100.0, ".1f"),
    "swept": ("swept rad/s", 1.0, ".3f"),
    "without_contact": ("without contact s", 1.0, ".1f"),
    "type_accuracy": ("type accuracy %", 100.0, ".1f"),
    "location_rmse": ("location RMSE cm", 100.0, ".2f"),
    "realigning": ("realigning %", 100.0, ".1f"),
}
"""What is told of them beside success: heading, scale and form."""
COUNTED = ("searches", "escapes")
LISTED = 40
"""So many failures of a controller are listed in the table; all are in results.csv."""


def groups_of(outcomes: Sequence[Outcome]) -> list[Group]:
    """Give pairs of object and friction, in their order."""
    return list(dict.fromkeys((one.object, one.friction) for one in outcomes))


def summary_of(outcomes: Sequence[Outcome], seed: int) -> dict[str, Any]:
    """Give what one controller reached: of all pushes, and of each object and friction.

    Successes have Wilson intervals, medians percentile bootstrap intervals over pushes.

    Args:
        outcomes: of one controller.
        seed: of the bootstrap; each figure has chance of its own.
    """
    parts = {"all": outcomes} | {
        " ".join(group): [one for one in outcomes if (one.object, one.friction) == group]
        for group in groups_of(outcomes)
    }
    return {name: _summary(name, part, seed) for name, part in parts.items()}


def success_text(found: Mapping[str, Sequence[Outcome]], targets: str, starts: str) -> str:
    """Give the paper's table as Markdown, with three rows a controller.

    Args:
        found: outcomes by controller.
        targets: the name of the set.
        starts: "nominal" or "random"; beside the `grid` from nominal starts stands the paper's row.
    """
    groups = groups_of([one for outcomes in found.values() for one in outcomes])
    headings = [f"{thing} {friction.replace('mu', 'µ')}" for thing, friction in groups]
    lines = [_line(["", *headings, "all"]), "|" + "---|" * (len(groups) + 2)]
    if targets == "grid" and starts == "nominal" and set(groups) <= set(PAPER):
        theirs = [PAPER[group] for group in groups]
        cells = [f"{one}/{EACH}" for one in theirs]
        whole = _share(sum(theirs), EACH * len(theirs))
        lines.append(_line(["*paper, contact skin*", *cells, whole]))
    for controller, outcomes in found.items():
        for success, name in SUCCESSES.items():
            cells = []
            for group in groups:
                hits = [
                    getattr(one, success) for one in outcomes if (one.object, one.friction) == group
                ]
                cells.append(f"{sum(hits)}/{len(hits)}" if hits else "-")
            won = np.array([getattr(one, success) for one in outcomes])
            _, low, high = proportion(won)
            interval = f" [{low * 100:.1f}, {high * 100:.1f}]"
            whole = _share(int(won.sum()), len(won)) + interval
            lines.append(_line([f"{controller}, {name}", *cells, whole]))
    return "\n".join(lines)


def measures_text(summaries: Mapping[str, Mapping[str, Any]]) -> str:
    """Give the medians of each controller over all pushes as Markdown, with their intervals."""
    lines = [
        _line(["median", *(heading for heading, _, _ in MEASURES.values()), *COUNTED]),
        "|" + "---|" * (1 + len(MEASURES) + len(COUNTED)),
    ]
    for controller, summary in summaries.items():
        cells = []
        for name, (_, scale, form) in MEASURES.items():
            one = summary["all"][name]
            told = [one[key] for key in ("median", "low", "high")]
            if told[0] is None:
                cells.append("-")
                continue
            median, low, high = (f"{value * scale:{form}}" for value in told)
            cells.append(f"{median} [{low}, {high}]")
        lines.append(_line([controller, *cells, *(str(summary["all"][n]) for n in COUNTED)]))
    return "\n".join(lines)


def failures_text(found: Mapping[str, Sequence[Outcome]]) -> str:
    """List the pushes without true success, each with its cause."""
    lines = []
    for controller, outcomes in found.items():
        failed = [one for one in outcomes if not one.success_true]
        lines.append(f"**{controller}**: {len(failed)} of {len(outcomes)} without true success")
        lines += [
            f"- {one.trial} to ({one.target_x:.2f}, {one.target_y:.2f}): {one.cause}"
            for one in failed[:LISTED]
        ]
        if len(failed) > LISTED:
            lines.append(f"- and {len(failed) - LISTED} more, in results.csv")
        lines.append("")
    return "\n".join(lines).strip()


def _summary(name: str, outcomes: Sequence[Outcome], seed: int) -> dict[str, Any]:
    told: dict[str, Any] = {"n": len(outcomes)}
    for success in SUCCESSES:
        hits = np.array([getattr(one, success) for one in outcomes])
        value, low, high = proportion(hits)
        told[success] = {"hits": int(hits.sum()), "share": value, "low": low, "high": high}
    for measure in MEASURES:
        values = np.array([getattr(one, measure) for one in outcomes])
        entropy = f"{outcomes[0].controller}, {name}, {measure}"
        rng = np.random.default_rng([seed, crc32(entropy.encode())])
        told[measure] = _median(values[np.isfinite(values)], rng)
    return told | {name: sum(getattr(one, name) for one in outcomes) for name in COUNTED}


def _median(values: FloatArray, rng: np.random.Generator) -> dict[str, float | int | None]:
    if not len(values):
        return {"n": 0, "mean": None, "median": None, "low": None, "high": None}
    drawn = np.median(values[rng.integers(len(values), size=(RESAMPLES, len(values)))], axis=1)
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(drawn, [tail, 1.0 - tail]).tolist()
    mean, median = float(values.mean()), float(np.median(values))
    return {"n": len(values), "mean": mean, "median": median, "low": low, "high": high}


def _share(hits: int, n: int) -> str:
    return f"{hits}/{n}, {100.0 * hits / n:.2f} %"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
