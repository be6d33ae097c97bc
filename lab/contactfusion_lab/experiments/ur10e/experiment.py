"""Contact by the motor currents of a real UR10e: when, whether, and on which links.

Whatever is learned for runs of one profile of motion is learned on those of the other: the noise of
free motion and the threshold of the alarm, and what a contact does to residuals. The
pose of the profile `direct` is known: there `joint_torque` says on which links a contact may be,
with constants of the motors by all other runs of it.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.figures import COLOURS, new_figure
from contactfusion_lab.experiments.ur10e.alarm import Alarm, plain_first
from contactfusion_lab.experiments.ur10e.evidence import (
    LENGTH,
    Evidence,
    Part,
    discriminant,
    judged,
)
from contactfusion_lab.experiments.ur10e.links import MEASURED, Motors, located
from contactfusion_lab.experiments.ur10e.runs import JOINTS, MARGIN, Run, read
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import Measure, auc, grouped, p50, p90, proportion

NAME = "ur10e_currents"
KNOWN_POSE = "direct"
MEDIAN = 0.010
"""What is asked of the median of alarms, before or after contact [s]."""
TAIL = {"UR": 0.030, "ACF": 0.100}
"""What is asked of the 90th percentile of alarms, by controller [s]."""
AREA = {"UR": 0.97, "ACF": 0.92}
"""What is asked of the area under the ROC curve."""
DIGITS = 4
"""Stamps were stored as single-precision numbers: those of delays [s]."""


def measure(folder: Path, out: Path) -> list[Measure]:
    """Measure alarms, evidence of contact, and links that may be touched; draw some alarms."""
    runs = [*read(folder)]
    profiles = sorted({run.profile for run in runs})
    for profile, controller in sorted({(run.profile, run.controller) for run in runs}):
        if not any(run.profile != profile and run.controller == controller for run in runs):
            raise RecordingError(
                f"all runs under {controller} control in '{folder}' are of the profile "
                f"'{profile}': there is no other to learn from"
            )
    alarms = {
        profile: Alarm.fitted([run for run in runs if run.profile != profile])
        for profile in profiles
    }
    measures = [*_alarm_measures(runs, alarms)]
    for part in ("windows", "samples"):
        for profile in profiles:
            measures += _areas(runs, profile, part)
    measures += _link_measures([run for run in runs if run.profile == KNOWN_POSE])
    _draw(runs, alarms, out / f"{NAME}.png")
    return measures


def _alarm_measures(runs: Sequence[Run], alarms: dict[str, Alarm]) -> Iterator[Measure]:
    """How long after contact runs are alarmed, and how many are early."""
    others = {p: [run for run in runs if run.profile != p] for p in alarms}
    first = {
        "alarm": np.array([alarms[run.profile].first(run) for run in runs]),
        "largest residual": np.array([plain_first(run, others[run.profile]) for run in runs]),
    }
    controllers = np.array([run.controller for run in runs])
    onsets = np.array([run.onset for run in runs])
    leaves = np.array([run.leaves_noise for run in runs])
    ends = np.array([run.stamps[-1] for run in runs])
    for name, stamps in first.items():
        asked = name == "alarm"
        for controller in (*sorted({*controllers.tolist()}), "all"):
            rows = np.isfinite(onsets) & ((controllers == controller) | (controller == "all"))
            last = np.minimum(stamps, ends)[rows]  # where it is silent, the end of the run
            delays = np.asarray(np.round(last - onsets[rows], DIGITS), np.float64)
            case, n = f"{name}, {controller} control", len(delays)
            rng, note = np.random.default_rng(0), "threshold by the other profile"
            middle = grouped(delays, p50, np.arange(n), rng)
            apart = grouped(delays, _apart, np.arange(n), rng)
            tail = grouped(delays, p90, np.arange(n), rng)
            yield Measure(NAME, case, "after 5 N, p50", *middle, "s", n, None, "less", note)
            least = MEDIAN if asked else None
            yield Measure(NAME, case, "p50 apart from 5 N", *apart, "s", n, least, "less", note)
            least = TAIL.get(controller) if asked else None
            yield Measure(NAME, case, "after 5 N, p90", *tail, "s", n, least, "less", note)
        early = stamps < np.where(np.isfinite(onsets), leaves, np.inf) - MARGIN
        share, low, high = proportion(early)
        n = len(early)
        yield Measure(
            NAME, f"{name}, all control", "early runs", share * n, low * n, high * n, "runs", n,
            1.0 if asked else None, "less", "over 20 ms before the force leaves its noise",
        )  # fmt: skip


def _areas(runs: Sequence[Run], profile: str, part: Part) -> Iterator[Measure]:
    """Areas under the ROC curve for runs of a profile, by what the other one taught."""
    for controller in sorted({run.controller for run in runs}):
        own = [run for run in runs if run.controller == controller]
        rest = [run for run in own if run.profile != profile]
        tried = judged([run for run in own if run.profile == profile], part)
        given, note = judged(rest, part), "learned on the other profile"
        if part == "windows":
            total = sum(len(run.stamps) // LENGTH for run in own if run.profile == profile)
            note += f"; {1.0 - len(tried.contact) / total:.0%} left out, as the force passes 5 N"
        scores = {
            "evidence": Evidence.learned(given).of(tried.residuals),
            "linear discriminant": tried.residuals @ discriminant(given),
        }
        for name, values in scores.items():
            both = np.column_stack([values, tried.contact.astype(np.float64)])
            figures = grouped(both, _area, tried.group, np.random.default_rng(0))
            least = AREA.get(controller) if name == "evidence" else None
            yield Measure(
                NAME, f"{profile}, {controller} control, {part}", f"area under ROC, {name}",
                *figures, "", len(values), least, note=note,
            )  # fmt: skip


def _area(scored: FloatArray) -> float:
    """The area under the ROC curve of scores and labels, shape (n, 2)."""
    contact = scored[:, 1] > 0.0
    return auc(scored[contact, 0], scored[~contact, 0])


def _link_measures(runs: Sequence[Run]) -> Iterator[Measure]:
    """Sets of links that hold 90 % of the probability, with motors that other runs taught."""
    if len(runs) < 2:
        raise RecordingError(
            f"constants are learned on other runs of '{KNOWN_POSE}': two are needed"
        )
    case, motors, found, groups = f"{KNOWN_POSE}, links", [], [], []
    for number, run in enumerate(runs):
        motors.append(Motors.learned([other for other in runs if other is not run]))
        found.append(located(run, motors[-1]))
        groups += [number] * len(found[-1].held)
    held = np.concatenate([each.held for each in found])
    sizes = np.concatenate([each.sizes for each in found]).astype(np.float64)
    n, note = len(held), "none claimed counts as not held; intervals over runs"
    share = proportion(held, groups)
    yield Measure(NAME, case, "90 % set holds the tool", *share, "", n, 0.95, note=note)
    claimed, of_runs = sizes > 0.0, np.array(groups)
    middle = grouped(sizes[claimed], p50, of_runs[claimed], np.random.default_rng(0))
    yield Measure(NAME, case, "links in the set, p50", *middle, "", int(claimed.sum()), 2.0, "less")
    none = proportion(~claimed, groups)
    yield Measure(NAME, case, "no link claimed", *none, "", n, None, "less")
    constants = np.array([each.constants for each in motors])
    note = f"range over the {len(runs)} times that a run is left out"
    for joint in np.flatnonzero([measured == joint for joint, measured in MEASURED.items()]):
        own = constants[:, joint]
        yield Measure(
            NAME, f"{KNOWN_POSE}, joint {joint + 1}", "current constant", float(own.mean()),
            float(own.min()), float(own.max()), "N·m/A", len(runs), note=note,
        )  # fmt: skip


def _apart(values: FloatArray) -> float:
    """How far the median is from 0."""
    return abs(p50(values))


def _draw(runs: Sequence[Run], alarms: dict[str, Alarm], path: Path) -> None:
    """A run of each profile and controller: residuals, force, and the alarm."""
    kinds = sorted({(run.profile, run.controller) for run in runs})
    figure = new_figure(13.0, 3.0 * len(kinds))
    for row, kind in zip(figure.subplots(len(kinds), 2, squeeze=False), kinds, strict=True):
        run = next(run for run in runs if (run.profile, run.controller) == kind)
        first = alarms[run.profile].first(run)
        for axes, near in zip(row, (False, True), strict=True):
            for joint in range(JOINTS):
                axes.plot(
                    run.stamps, run.residual[:, joint], lw=0.8, color=COLOURS[joint],
                    label=f"joint {joint + 1}",
                )  # fmt: skip
            axes.axvline(first, color="black", ls="--", lw=1.0, label="first alarm")
            axes.set(xlabel="time [s]", ylabel="I − Id [A]", ylim=(-4.0, 10.0))
            forces = axes.twinx()
            forces.fill_between(run.force_stamps, run.forces, color="0.85", zorder=-1)
            forces.set(ylabel="force [N]", ylim=(-60.0, 150.0))
            axes.set_zorder(forces.get_zorder() + 1)
            axes.patch.set_visible(False)
            if near:
                axes.set(xlim=(run.onset - 0.1, run.onset + 0.1))
        delay = 1e3 * (first - run.onset)
        title = f"{run.profile}, {run.controller} control, {run.force:g} N, {run.speed:g} m/s"
        row[0].set_title(title)
        row[1].set_title(f"alarm {delay:.0f} ms after 5 N")
        row[1].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.12, 0.5))
    save_figure(figure, path, dpi=100)
