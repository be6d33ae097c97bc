"""The outcomes of all pushes of a folder: tables beside the paper's, files and figures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.terminal import note
from contactfusion_lab.experiments.push import figures
from contactfusion_lab.experiments.push.outcomes import compare_all, outcomes_of
from contactfusion_lab.experiments.push.plan import PROTOTYPE, Plan, Targets
from contactfusion_lab.experiments.push.trial import Track, load
from contactfusion_lab.scenes.push.config import FRICTIONS
from contactfusion_lab.trials import tables
from contactfusion_lab.trials.folder import TRIALS
from contactfusion_lab.trials.measures import CONFIDENCE, RESAMPLES, parts_of

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
    "gospa": ("GOSPA cm", 100.0, ".2f"),
    "gospa_distance": ("of it distance cm", 100.0, ".2f"),
    "missed": ("missed %", 100.0, ".1f"),
    "false": ("false %", 100.0, ".1f"),
    "sources_two": ("two sources or more %", 100.0, ".1f"),
    "evidence_two": ("two of evidence %", 100.0, ".1f"),
    "realigning": ("realigning %", 100.0, ".1f"),
}
"""The units of what is measured beside success."""
PERCEIVED: tables.Units = {
    name: MEASURES[name] for name in ("location_rmse", "type_accuracy", "contact_accuracy")
}
"""Perceived against true contacts, over all cycles."""
Perceived = Mapping[str, tuple[float, float, float]]
"""These figures, each with its interval over resampled pushes."""
DIFFERENCES: tables.Units = {
    "success_true": ("true success", 1.0, "g"),
    "gospa": ("GOSPA cm, all pushes", 100.0, ".2f"),
    "time_to_success": ("time s, all pushes", 1.0, ".1f"),
    "lateral_true": ("mean abs. l cm", 100.0, ".2f"),
    "lateral_estimate": ("mean abs. l̂ cm", 100.0, ".2f"),
    "swept": ("swept rad/s", 1.0, ".3f"),
    "time": ("time s", 1.0, ".1f"),
}
"""The units of what is compared."""
COUNTED = ("searches", "escapes")
LISTED = 40
"""Number of failures of a controller listed in the table; all are in results.csv."""
TUNED = "tuned"
TUNED_ON = (
    "parameters searched on random pushes of the paper's objects (seeds 11 to 17) and of eight "
    "others (seeds 31 to 35, 41 and 42)"
)
"""The set of parameters that is ours, and what it was searched on."""
Group = tuple[str, str]
"""An object and a friction."""
GROUPS: tuple[Group, ...] = tuple(
    (name, friction) for name in ("box", "cylinder", "nonuniform") for friction in ("mu1", "mu2")
)
Order = tuple[int, int, int, int]
"""Columns that identify a push: its targets, object and friction, and its number."""
START = "nominal"
"""Its pushes started so."""


def evaluate(
    plan: Plan,
    settings: Mapping[str, Any],
    failed: Sequence[str],
    out: Path,
    learned: Mapping[str, Mapping[str, str]],
) -> None:
    """Measure every push that a folder holds; write tables, files and figures.

    Args:
        plan: of pushes made last.
        settings: of the folder: its suites and controllers, of which the others are compared with
            the first, its objects and its sets of targets.
        failed: a sentence for each push that could not be made.
        out: the folder with the pushes, which takes the results.
        learned: on what networks were trained, by generator, of suites by their labels.

    Raises:
        ConfigurationError: a file holds none of these pushes, or another than that of its name.
    """
    tracks = list(_gathered(plan, settings, out))
    frame = outcomes_of(tracks)
    sets = frame["trial"].map({track.push.name: track.push.targets for track in tracks})
    by_targets = {name: frame[sets == name] for name in settings["targets"] if (sets == name).any()}
    perceived = {
        name: {
            case: perception([tracks[row] for row in part.index], plan.seed)
            for case, part in parts_of(outcomes).items()
        }
        for name, outcomes in by_targets.items()
    }
    summaries = {case: _summary(part, plan.seed) for case, part in parts_of(frame).items()}
    comparisons = compare_all(frame, plan.seed)
    success = _for_each(by_targets, success_text, plan)
    tables.write_results(
        out,
        frame,
        {
            "targets": list(by_targets),
            "starts": plan.starts,
            **({} if plan.noise == PROTOTYPE else {"noise": plan.noise}),
            "reached": summaries,
            "perceived": perceived,
            "tests": [asdict(each) for each in comparisons],
            "not made": list(failed),
        },
        {
            "Success": success,
            "Perception": _for_each(perceived, perception_text, plan),
            "Chosen and trained before": tables.bullets(chosen_before(settings, learned)),
            "Measures": tables.measures_text(summaries, "median", MEASURES, COUNTED),
            "Compared push by push": tables.comparisons_text(comparisons, DIFFERENCES),
            "Failures": failures_text(frame),
            "Not made": tables.bullets(failed),
        },
    )
    for case, part in parts_of(frame).items():
        stem = case.replace("/", "_")
        figures.draw_map(part, out / f"map_{stem}.png")
        trajectories = [figures.Trajectory.of(tracks[row]) for row in part.index]
        figures.draw_trajectories(part, trajectories, out / f"paths_{stem}.png")
    figures.draw_bars(frame, comparisons, out / "bars.png")
    note(success, end="\n\n", lines=True)


def chosen_before(
    settings: Mapping[str, Any], learned: Mapping[str, Mapping[str, str]]
) -> list[str]:
    """Sentences on the pushes on which controllers were tuned and networks trained.

    Args:
        settings: of the folder.
        learned: on what networks were trained, by generator, of suites by their labels.
    """
    tuned = [f"`{name}`: {TUNED_ON}" for name in settings["controllers"] if name == TUNED]
    return tuned + [
        f"networks of `{label}`, {generator}: {data}"
        for label, generators in learned.items()
        for generator, data in generators.items()
    ]


def _summary(part: pd.DataFrame, seed: int) -> dict[str, dict[str, Any]]:
    """Success rates of a case; over all pushes also searches and escapes of its controller."""
    summary = tables.summary_of(part, GROUPED, SUCCESSES, MEASURES, "median", seed)
    summary["all"] |= {name: int(part[name].sum()) for name in COUNTED}
    return summary


def _for_each(
    by_targets: Mapping[str, Any], text: Callable[[Any, str, str], str], plan: Plan
) -> str:
    noise = "" if plan.noise == PROTOTYPE else f", noise `{plan.noise}`"
    return "\n\n".join(
        f"Targets `{name}`{noise}:\n\n{text(part, name, plan.starts)}"
        for name, part in by_targets.items()
    )


def _gathered(plan: Plan, settings: Mapping[str, Any], out: Path) -> Iterator[Track]:
    """The pushes of a folder by sensor suite and controller, those of each in their order.

    Args:
        plan: of pushes made last.
        settings: of the folder.
        out: the folder.

    Raises:
        ConfigurationError: a file holds none of these pushes, or another than that of its name.
    """
    sets = {name: _targets(name, places) for name, places in settings["targets"].items()}
    plans = {name: replace(plan, targets=targets) for name, targets in sets.items()}
    for sensing, controller in product(settings["sensings"], settings["controllers"]):
        ordered = [
            (_order(track, path, plans, list(settings["objects"])), track)
            for path, track in _tracks(out, sensing, controller)
        ]
        yield from (track for _, track in sorted(ordered, key=lambda row: row[0]))


def _targets(name: str, places: Any) -> Targets:
    return Targets(name, None if isinstance(places, str) else tuple((x, y) for x, y in places))


def _tracks(out: Path, sensing: str, controller: str) -> Iterator[tuple[Path, Track]]:
    for path in sorted((out / TRIALS / sensing / controller).glob("*.npz")):
        track = load(path)
        if (track.sensing, track.controller, track.push.name) != (sensing, controller, path.stem):
            raise _stranger(path)
        yield path, track


def _order(track: Track, path: Path, plans: Mapping[str, Plan], objects: Sequence[str]) -> Order:
    """The place of a push among all, after a look at whether it is the plan's.

    Raises:
        ConfigurationError: the plan has none of its name, or another one.
    """
    push = track.push
    try:
        rows = (
            list(plans).index(push.targets),
            objects.index(push.object),
            list(FRICTIONS).index(push.friction),
            push.number,
        )
        plan = plans[push.targets]
        if plan.targets.places or push.object in plan.objects:  # else where it is touched is gone
            planned = plan.push(push.object, push.friction, push.number)
        else:
            planned = push
    except (ValueError, IndexError):
        raise _stranger(path) from None
    if planned != push:
        raise _stranger(path)
    return rows


def _stranger(path: Path) -> ConfigurationError:
    return ConfigurationError(
        f"{path} holds another push than this experiment's of its name: remove it, or give "
        "another --out"
    )


def success_text(frame: pd.DataFrame, targets: str, starts: str) -> str:
    """The paper's table as Markdown, with three rows a suite and controller.

    Args:
        frame: of the outcomes of a set of targets.
        targets: its name.
        starts: "nominal" or "random"; beside nominal starts stand the paper's rows of the set.
    """
    groups = list(parts_of(frame, GROUPED))
    published = _papers_successes(groups, targets) if starts == START else []
    return tables.success_text(frame, GROUPED, SUCCESSES, published)


def perception_text(found: Mapping[str, Perceived], targets: str, starts: str) -> str:
    """Accuracy of perceived contacts, over all cycles, beside the paper, as Markdown.

    Args:
        found: by sensor suite and controller.
        targets: the name of the set.
        starts: "nominal" or "random"; beside nominal starts stand the paper's rows of the set.
    """
    lines = []
    for row in PAPER if starts == START else ():
        if row.measures and row.targets == targets:
            cells = [
                f"{row.measures[name] * scale:{form}}" if name in row.measures else "-"
                for name, (_, scale, form) in PERCEIVED.items()
            ]
            lines.append([f"*paper, {row.sensing}*", *cells])
    for label, perceived in found.items():
        cells = []
        for name, (_, scale, form) in PERCEIVED.items():
            value, low, high = perceived[name]
            cells.append(tables.cell(value, low, high, scale, form))
        lines.append([label, *cells])
    return tables.markdown(["", *(heading for heading, _, _ in PERCEIVED.values())], lines)


def failures_text(frame: pd.DataFrame) -> str:
    """List the pushes without true success as Markdown, each with its cause."""
    sentences = [
        f"{push['trial']} to ({push['target_x']:.2f}, {push['target_y']:.2f}): {push['cause']}"
        for push in frame.to_dict("records")
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
        sensing: label of the sensor suite.
        targets: the name of the set.
        each: pushes of each object and friction.
        hits: successes, in the order of `GROUPS`; the paper rates by the estimated contact.
        share: of all pushes.
        measures: by the names of results.csv, in their units. The paper prints errors in cm; 0.4 mm
            is less than its sensors can resolve, and m is assumed to be meant (method §8).
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


def perception(tracks: Sequence[Track], seed: int) -> Perceived:
    """Pool the cycles of pushes; the first of a push is before anything moves, and left out.

    Args:
        tracks: at least one.
        seed: of the bootstrap over pushes.
    """
    counts = np.array([_counted(track) for track in tracks])
    rows = np.random.default_rng(seed).integers(len(tracks), size=(RESAMPLES, len(tracks)))
    drawn = np.array([_measured(counts[row].sum(axis=0)) for row in rows])
    found = _measured(counts.sum(axis=0)).tolist()
    ends = [(1.0 - CONFIDENCE) / 2.0, (1.0 + CONFIDENCE) / 2.0]
    perceived = dict[str, tuple[float, float, float]]()
    for name, value, column in zip(PERCEIVED, found, drawn.T, strict=True):
        there = column[np.isfinite(column)]  # none where nothing was located
        low, high = np.quantile(there, ends).tolist() if len(there) else (np.nan, np.nan)
        perceived[name] = value, low, high
    return perceived


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
