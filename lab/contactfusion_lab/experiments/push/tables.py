"""The push experiment's tables beside the paper's: success, perception and measures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from contactfusion.arrays import FloatArray
from contactfusion_lab.experiments.push.trial import Track
from contactfusion_lab.trials import tables
from contactfusion_lab.trials.measures import CONFIDENCE, RESAMPLES

SUCCESSES = {
    "success_true": ", true",
    "success_estimate": ", by estimate",
    "ever_true": ", ever",
}
"""The three, and what the table calls them (method §7)."""
GROUPED = ("object", "friction")
"""Pushes of one object and friction stand together."""
MEASURES: tables.Units = {
    "time": ("time s", 1.0, ".1f"),
    "path": ("path m", 1.0, ".2f"),
    "final_distance": ("final distance cm", 100.0, ".1f"),
    "lateral_true": ("mean abs. l cm", 100.0, ".1f"),
    "lateral_estimate": ("mean abs. l̂ cm", 100.0, ".1f"),
    "swept": ("swept rad/s", 1.0, ".3f"),
    "without_contact": ("without contact s", 1.0, ".1f"),
    "type_accuracy": ("type accuracy %", 100.0, ".1f"),
    "contact_accuracy": ("contact or none %", 100.0, ".1f"),
    "location_rmse": ("location RMSE cm", 100.0, ".2f"),
    "sources_two": ("two sources or more %", 100.0, ".1f"),
    "evidence_two": ("two of evidence %", 100.0, ".1f"),
    "realigning": ("realigning %", 100.0, ".1f"),
}
"""The units of what is measured beside success."""
PERCEIVED: tables.Units = {
    name: MEASURES[name] for name in ("location_rmse", "type_accuracy", "contact_accuracy")
}
DIFFERENCES: tables.Units = {
    "success_true": ("true success", 1.0, "g"),
    "lateral_true": ("mean abs. l cm", 100.0, ".2f"),
    "lateral_estimate": ("mean abs. l̂ cm", 100.0, ".2f"),
    "swept": ("swept rad/s", 1.0, ".3f"),
    "time": ("time s", 1.0, ".1f"),
}
"""The units of what is compared."""
COUNTED = ("searches", "escapes")
LISTED = 40
"""So many failures of a controller are listed in the table; all are in results.csv."""
Group = tuple[str, str]
"""An object and a friction."""
GROUPS: tuple[Group, ...] = tuple(
    (thing, friction) for thing in ("box", "cylinder", "nonuniform") for friction in ("mu1", "mu2")
)
START = "nominal"
"""Its pushes started so."""


def success_text(frame: pd.DataFrame, targets: str, starts: str) -> str:
    """The paper's table as Markdown, with three rows a sensing and controller.

    Args:
        frame: of the outcomes of a set of targets.
        targets: its name.
        starts: "nominal" or "random"; beside nominal starts stand the paper's rows of the set.
    """
    groups = list(tables.parts_of(frame, GROUPED))
    published = _papers_successes(groups, targets) if starts == START else []
    return tables.success_text(frame, GROUPED, SUCCESSES, published)


@dataclass(frozen=True)
class Perception:
    """What is perceived against what is true; each with its interval over resampled pushes.

    Attributes:
        location_rmse: root mean square error of l̂ where both tell of a contact [m].
        type_accuracy: of none, point and line.
        contact_accuracy: of contact or none.
    """

    location_rmse: tuple[float, float, float]
    type_accuracy: tuple[float, float, float]
    contact_accuracy: tuple[float, float, float]


def perception_text(found: Mapping[str, Perception], targets: str, starts: str) -> str:
    """How well contacts are perceived, over all cycles, beside the paper, as Markdown.

    Args:
        found: by sensing and controller.
        targets: the name of the set.
        starts: "nominal" or "random"; beside nominal starts stand the paper's rows of the set.
    """
    lines = []
    for row in PAPER:
        if row.measures and row.targets == targets and starts == START:
            cells = [
                f"{row.measures[name] * scale:{form}}" if name in row.measures else "-"
                for name, (_, scale, form) in PERCEIVED.items()
            ]
            lines.append([f"*paper, {row.sensing}*", *cells])
    for label, perceived in found.items():
        cells = []
        for name, (_, scale, form) in PERCEIVED.items():
            value, low, high = getattr(perceived, name)
            cells.append(tables.cell(value, low, high, scale, form))
        lines.append([label, *cells])
    return tables.markdown(["", *(heading for heading, _, _ in PERCEIVED.values())], lines)


def failures_text(frame: pd.DataFrame) -> str:
    """List the pushes without true success as Markdown, each with its cause."""
    sentences = [
        f"{one['trial']} to ({one['target_x']:.2f}, {one['target_y']:.2f}): {one['cause']}"
        for one in frame.to_dict("records")
    ]
    return tables.failures_text(frame, "success_true", sentences, LISTED)


def _papers_successes(groups: Sequence[Group], targets: str) -> list[list[str]]:
    """The paper's rows of a set of targets, where it pushed all of these."""
    if not set(groups) <= set(GROUPS):
        return []
    rows = [row for row in PAPER if row.targets == targets]
    return [_papers_row(row, groups) for row in rows if row.hits or set(groups) == set(GROUPS)]


@dataclass(frozen=True)
class Reached:
    """One row of the paper.

    Attributes:
        sensing: what felt.
        targets: the name of the set.
        each: pushes of each object and friction.
        hits: successes, in the order of `GROUPS`; the paper judges by the estimated contact.
        share: of all pushes.
        measures: by the names of results.csv, in their units. The paper prints errors in cm; 0.4 mm
            is less than its sensors can tell, and m is taken to be meant (method §8).
    """

    sensing: str
    targets: str
    each: int
    hits: tuple[int, ...]
    share: float
    measures: dict[str, float]


def _papers_row(row: Reached, groups: Sequence[Group]) -> list[str]:
    by_group = dict(zip(GROUPS, row.hits, strict=False))
    cells = [f"{by_group[group]}/{row.each}" if by_group else "-" for group in groups]
    n = row.each * len(groups)
    hits = sum(by_group[group] for group in groups) if by_group else round(row.share * n)
    return [f"*paper, {row.sensing}*", *cells, _share(hits, n)]


def _share(hits: int, n: int) -> str:
    return f"{hits}/{n}, {100.0 * hits / n:.2f} %"


PAPER = (
    Reached("contact skin", "grid", 24, (23, 24, 19, 19, 19, 23), 0.8819, {}),
    Reached(
        "LiDAR", "grid", 24, (24, 24, 22, 22, 22, 24), 0.9583,
        {"type_accuracy": 0.8939, "location_rmse": 0.0415},
    ),
    Reached(
        "LiDAR", "new", 12, (12, 12, 11, 11, 11, 12), 0.9583,
        {"type_accuracy": 0.9015, "location_rmse": 0.042},
    ),
    Reached(
        "RGB-D", "new", 12, (), 0.8611,
        {"type_accuracy": 0.5195, "contact_accuracy": 0.9279, "location_rmse": 0.0879},
    ),
)  # fmt: skip


def perception(tracks: Sequence[Track], seed: int) -> Perception:
    """Pool the cycles of pushes; the first of a push is before anything moves, and left out.

    Args:
        tracks: at least one.
        seed: of the bootstrap over pushes.
    """
    counts = np.array([_counted(track) for track in tracks])
    rows = np.random.default_rng(seed).integers(len(tracks), size=(RESAMPLES, len(tracks)))
    drawn = np.array([_measured(counts[row].sum(axis=0)) for row in rows])
    found = _measured(counts.sum(axis=0))
    return Perception(
        *(_resampled_interval(one, some) for one, some in zip(found, drawn.T, strict=True))
    )


def _resampled_interval(found: float, drawn: FloatArray) -> tuple[float, float, float]:
    """A figure with its interval; all are NaN where nothing was located."""
    there = drawn[np.isfinite(drawn)]
    if not len(there):
        return found, np.nan, np.nan
    low, high = np.quantile(there, [(1.0 - CONFIDENCE) / 2.0, (1.0 + CONFIDENCE) / 2.0])
    return float(found), float(low), float(high)


def _counted(track: Track) -> FloatArray:
    """Sums over cycles: squared errors, how many; right types, right contacts, cycles."""
    errors = (track.lateral - track.contact[:, 1])[1:]
    errors = errors[np.isfinite(errors)]
    types = (track.kind == track.estimate)[1:]
    contacts = ((track.kind > 0) == (track.estimate > 0))[1:]
    return np.array([(errors**2).sum(), len(errors), types.sum(), contacts.sum(), len(types)])


def _measured(sums: FloatArray) -> FloatArray:
    squares, located, types, contacts, cycles = sums
    with np.errstate(invalid="ignore"):  # nothing was located: NaN
        return np.array([np.sqrt(squares / located), types / cycles, contacts / cycles])
