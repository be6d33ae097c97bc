"""All presses as one data frame, and a table by arm, force, link and row."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pandas as pd

from contactfusion.figures import COLOURS, new_figure
from contactfusion_lab.experiments.press.plan import SECONDS, Plan
from contactfusion_lab.experiments.press.trial import NEAR, Trial
from contactfusion_lab.trials.calibration import LEVEL
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import CASE, parts_of, proportion, resampled
from contactfusion_lab.trials.tables import bullets, cell, markdown, write_results

NEAR_BASE = 3
"""Links that at most so many joints move are near the base."""
READ = (
    "Presses are far from the base where more than three joints move each pressed link; links that "
    "the same joints move, as a hand and fingers that stay, count as the same. *Reported*: any "
    f"contact at the end of a press; *found*: a reported contact within {100.0 * NEAR:.0f} cm, "
    "mean over true contacts; error: of the likeliest contact; *right set*: the true link is that "
    "of the contact, or among those between which the generator states that it cannot decide, "
    "whose *parts* of the arm are counted where there are any; "
    "*alarms*: reports that begin in free motion. In brackets 95 % intervals, of shares of presses "
    "by Wilson, of other figures a bootstrap over presses. Each arm is one of five specimens of "
    "its kind, whose masses err by 5 %, and was identified by two minutes of free "
    "motion of its own. Published for real arms: 91.5 % detected and 3.0 cm on a Franka (Liang and "
    "Kroemer 2021), 73 % within 4 cm on a UR10e (Saleem 2025)."
)
Joints = Mapping[str, Mapping[str, frozenset[str]]]
"""By arm and link, the joints that a force on it loads."""
Figure = tuple[float, float, float]
"""A figure and the ends of its interval."""


def _share(column: str, part: pd.DataFrame, rng: np.random.Generator) -> Figure:
    flags = part[column].dropna().to_numpy(np.bool_)
    return proportion(flags) if len(flags) else (np.nan, np.nan, np.nan)


def _statistic(
    column: str, statistic: Callable[..., Any], part: pd.DataFrame, rng: np.random.Generator
) -> Figure:
    values = part[column].dropna().to_numpy(np.float64)
    return resampled(values, statistic, rng) if len(values) else (np.nan, np.nan, np.nan)


COLUMNS: Sequence[tuple[str, Callable[[pd.DataFrame, np.random.Generator], Figure], float, str]] = (
    ("reported %", partial(_share, "reported"), 100.0, ".0f"),
    ("found %", partial(_statistic, "recall", np.mean), 100.0, ".0f"),
    ("all found %", partial(_share, "all_found"), 100.0, ".0f"),
    ("error cm, median", partial(_statistic, "error", np.median), 100.0, ".2f"),
    ("p90", partial(_statistic, "error", partial(np.quantile, q=0.9)), 100.0, ".2f"),
    ("right link %", partial(_share, "right_link"), 100.0, ".0f"),
    ("right set %", partial(_share, "right_set"), 100.0, ".0f"),
    ("parts of the set", partial(_statistic, "parts", np.mean), 1.0, ".1f"),
    ("false", partial(_statistic, "false", np.mean), 1.0, ".2f"),
    ("in 95 % region %", partial(_share, "inside"), 100.0, ".0f"),
    ("its radius cm", partial(_statistic, "radius", np.median), 100.0, ".1f"),
    ("first report s", partial(_statistic, "latency", np.median), 1.0, ".2f"),
)
"""Of each column its figure, scale and form."""


def frame_of_trials(trials: Sequence[Trial], joints: Joints) -> pd.DataFrame:
    """One row for each trial and row of the table."""
    rows = []
    for trial in trials:
        press, parts = trial.press, joints[trial.press.arm]
        true = [parts[link] for link in trial.links]
        for found in trial.found:
            links = found.links or (found.link,)
            has, known = bool(true), bool(true) and found.contacts > 0
            rows.append(
                {
                    "arm": press.arm,
                    "trial": press.name,
                    "force": press.force,
                    "places": press.places,
                    "true_contacts": len(true),
                    "true_force": trial.forces[0] if has else np.nan,
                    "true_link": trial.links[0] if has else "",
                    "far": has and min(map(len, true)) > NEAR_BASE,
                    CASE: found.row,
                    "contacts": found.contacts,
                    "reported": found.contacts > 0,
                    "recall": found.found / len(true) if has else np.nan,
                    "all_found": has and found.found == len(true),
                    "error": found.error,
                    "link": found.link,
                    "right_link": parts[found.link] in true if known else np.nan,
                    "right_set": any(parts[each] in true for each in links if each)
                    if has
                    else np.nan,
                    "parts": float(len({parts[each] for each in links if each})) or np.nan,
                    "false": found.false,
                    "inside": found.level <= LEVEL if known else np.nan,
                    "radius": found.radius,
                    "probability": found.probability,
                    "latency": found.latency,
                    "alarms": found.alarms,
                }
            )
    return pd.DataFrame(rows)


def evaluate(
    trials: Sequence[Trial],
    plan: Plan,
    joints: Joints,
    failed: Sequence[str],
    out: Path,
) -> None:
    """Write results.csv, summary.json, table.md and a figure.

    Args:
        trials: the trials.
        plan: which they are of.
        joints: of each arm.
        failed: a sentence for each trial that could not be made.
        out: the folder that takes the files.
    """
    frame = frame_of_trials(trials, joints)
    summary, lines = list(_summary(frame, plan)), []
    for each in summary:
        cells = []
        for name, _, scale, form in COLUMNS:
            value, low, high = each[name]
            cells.append(cell(value, low, high, scale, form))
        alarms = each["alarms a minute"]
        ends = [f"{each[name]}" for name in ("arm", "force", "links", "row", "n")]
        lines.append([*ends, *cells, "-" if alarms is None else f"{alarms:.1f}"])
    names = [name for name, *_ in COLUMNS]
    table = markdown(["arm", "N", "links", "row", "n", *names, "alarms a minute"], lines)
    presses = frame[frame["places"] > 0].drop_duplicates("trial")
    slid = int((presses["true_contacts"] != presses["places"]).sum())
    left_out = f"{slid} of {len(presses)} presses touched at another number of places than meant."
    texts = {
        "Presses": table,
        "How to read it": READ,
        "Left out": left_out if slid else "",
        "Not made": bullets(failed),
    }
    write_results(out, frame.rename(columns={CASE: "row"}).assign(**{CASE: ""}), summary, texts)
    _draw(_as_meant(frame), out)


def _as_meant(frame: pd.DataFrame) -> pd.DataFrame:
    """The presses that touch at as many places as they were meant to."""
    return frame[(frame["places"] > 0) & (frame["true_contacts"] == frame["places"])]


def _summary(frame: pd.DataFrame, plan: Plan) -> Iterator[dict[str, Any]]:
    """The figures of each arm, force, part of the arm and row."""
    free = frame[frame["places"] == 0]
    minutes = free.groupby("arm")["trial"].nunique() * SECONDS / 60.0
    alarms = free.groupby(["arm", CASE])["alarms"].sum()
    pressed = _as_meant(frame)
    for (arm, force, far, row), part in parts_of(pressed, ["arm", "force", "far", CASE]).items():
        name = f"{arm}, {force:g}, {'far' if far else 'near'}, {row}"
        figures: dict[str, Any] = {
            "arm": arm, "force": f"{force:g}", "links": "far" if far else "near", "row": row,
            "n": len(part),
        }  # fmt: skip
        for column, figure, _, _ in COLUMNS:
            rng = np.random.default_rng([plan.seed, crc32(f"{name}, {column}".encode())])
            figures[column] = figure(part, rng)
        known = arm in minutes.index
        figures["alarms a minute"] = float(alarms[arm, row] / minutes[arm]) if known else None
        yield figures


def _draw(frame: pd.DataFrame, out: Path) -> None:
    """Draw the errors of each arm by row as cumulative shares of all presses."""
    if not len(frame):
        return
    arms = parts_of(frame, "arm")
    figure = new_figure(4.5 * len(arms), 3.6)
    panels = figure.subplots(1, len(arms), squeeze=False, sharey=True)[0]
    for (arm, part), axes in zip(arms.items(), panels, strict=True):
        for colour, (row, own) in zip(COLOURS, parts_of(part).items(), strict=False):
            errors = np.sort(own["error"].dropna().to_numpy(np.float64))
            shares = np.arange(1, len(errors) + 1) / len(own)
            axes.step(100.0 * errors, 100.0 * shares, color=colour, label=row, where="post")
        axes.set(title=arm, xlabel="error of the likeliest contact [cm]", xlim=(0.0, 15.0))
    panels[0].set(ylabel="of all presses [%]", ylim=(0.0, 100.0))
    panels[-1].legend(fontsize="small", loc="lower right")
    save_figure(figure, out / "press.png")
