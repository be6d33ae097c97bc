"""Outcomes of pushes: the measures of method §8, failure modes, and comparisons in pairs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.hypotheses import HypothesisKind
from contactfusion_lab.experiments.push.trial import Track
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import Ending
from contactfusion_lab.trials.measures import CASE, Comparison, compared
from contactfusion_lab.trials.tables import frame_of

EDGE = 0.22
"""Lateral offset from which contacts are at an edge of the face [m]."""
SILENT, FAINT = 0.2, 0.6
"""A contact that is felt in less than these shares of its time is not felt, or hardly."""
PROGRESS = 0.02
"""Coming nearer to the target by less than this is no progress [m]."""
CUTOFF = 0.10
"""Contacts further apart than this are a missed and a false one (GOSPA) [m]."""
LIMIT = float(PushConfig.model_fields["longest"].default)
"""Time that a push without true success counts as: the greatest that it may take [s]."""
COMPARED = ["lateral_true", "lateral_estimate", "swept", "time"]
"""Measures over pushes that both bring to true success (O §III-C)."""
COMPARED_ALL = ["gospa", "time_to_success"]
"""Measures over all pushes, failures included."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of one push by one controller; a measure without a value is NaN.

    Attributes:
        trial: the name of the push.
        controller: by name.
        sensing: label of the sensor suite.
        object: by name.
        friction: by name.
        target_x: [m].
        target_y: [m].
        offset: of the object to the left at the start [m].
        yaw: of the object at the start [degrees].
        ending: why it ended.
        success_true: arrival was declared, with the true contact near enough at that moment.
        success_estimate: arrival was declared.
        ever_true: the true contact was near enough at some time.
        time: it took [s].
        time_to_success: the same, or of a push without true success the greatest that it may
            take [s].
        final_distance: from the true contact to the target, when they last touched [m].
        least_distance: the smallest of these [m].
        path: that the robot drove [m].
        lateral_true: mean of |l| of true contacts [m].
        lateral_estimate: mean of |l| of estimated contacts [m].
        swept: Σ|Δθ| / (t_min - t_start), until the true contact was nearest (O Eq 12) [rad/s].
        without_contact: [s].
        type_accuracy: how often none, point or line was estimated right.
        contact_accuracy: how often it was estimated right whether there is a contact.
        location_rmse: of the estimated l, in cycles in which both are there [m].
        gospa: mean over cycles of the GOSPA of true and estimated contact along the face, with a
            cut-off of 10 cm [m].
        gospa_distance: of paired contacts, root mean square [m].
        missed: share of the cycles with a true contact and no estimate within the cut-off.
        false: share of the cycles with an estimate and no true contact within the cut-off.
        sources_two: of the cycles with a true contact, in how many two sources or more have a share
            in the contact on the face.
        evidence_two: the same of sources of evidence alone, without support.
        searches: how often the controller began to search.
        escapes: how often it began to escape.
        realigning: share of the time.
        cause: of the failure, in a few words.
    """

    trial: str
    controller: str
    sensing: str
    object: str
    friction: str
    target_x: float
    target_y: float
    offset: float
    yaw: float
    ending: str
    success_true: bool
    success_estimate: bool
    ever_true: bool
    time: float
    time_to_success: float
    final_distance: float
    least_distance: float
    path: float
    lateral_true: float
    lateral_estimate: float
    swept: float
    without_contact: float
    type_accuracy: float
    contact_accuracy: float
    location_rmse: float
    gospa: float
    gospa_distance: float
    missed: float
    false: float
    sources_two: float
    evidence_two: float
    searches: int
    escapes: int
    realigning: float
    cause: str


def outcome(track: Track) -> Outcome:
    """Measure a push; its first row is before any cycle, and has no part in shares and durations.

    Args:
        track: of it.
    """
    push, distances = track.push, track.distance[~np.isnan(track.distance)]
    declared = track.ending == Ending.ARRIVED
    within = track.distance <= track.within
    errors = (track.lateral - track.contact[:, 1])[~np.isnan(track.distance + track.lateral)]
    return Outcome(
        trial=push.name,
        controller=track.controller,
        sensing=track.sensing,
        object=push.object,
        friction=push.friction,
        target_x=push.target[0],
        target_y=push.target[1],
        offset=push.offset,
        yaw=push.yaw,
        ending=track.ending,
        success_true=bool(declared and within[-1]),
        success_estimate=declared,
        ever_true=bool(within.any()),
        time=float(track.stamp[-1]),
        time_to_success=float(track.stamp[-1]) if declared and within[-1] else LIMIT,
        final_distance=float(distances[-1]) if len(distances) else np.nan,
        least_distance=float(distances.min()) if len(distances) else np.nan,
        path=float(np.hypot(*np.diff(track.base[:, :2], axis=0).T).sum()),
        lateral_true=_mean(np.abs(track.contact[:, 1])),
        lateral_estimate=_mean(np.abs(track.lateral)),
        swept=swept(track),
        without_contact=float((track.kind[1:] == 0).sum() * track.period),
        type_accuracy=_share((track.kind == track.estimate)[1:]),
        contact_accuracy=_share(((track.kind > 0) == (track.estimate > 0))[1:]),
        location_rmse=float(np.sqrt((errors**2).mean())) if len(errors) else np.nan,
        **_localised(track),
        sources_two=_share(_sharing(track, list(track.sources.values())) >= 2),
        evidence_two=_share(_sharing(track, [HypothesisKind.REGULAR]) >= 2),
        searches=beginnings(track, "search"),
        escapes=beginnings(track, "escape"),
        realigning=_share(_in_mode(track, "realign")[1:]),
        cause=cause(track),
    )


def _localised(track: Track) -> dict[str, float]:
    """GOSPA of each cycle and its parts; each has one true contact and one estimate at most."""
    true, estimated = track.contact[1:, 1], track.lateral[1:]
    apart = np.abs(true - estimated)  # NaN where one of them is none
    paired = apart < CUTOFF
    missed, false = np.isfinite(true) & ~paired, np.isfinite(estimated) & ~paired
    squares = np.where(paired, apart, 0.0) ** 2
    gospa = np.sqrt(squares + CUTOFF**2 / 2.0 * (missed + 1.0 * false))
    return {
        "gospa": _mean(gospa),
        "gospa_distance": float(np.sqrt(squares[paired].mean())) if paired.any() else np.nan,
        "missed": _share(missed),
        "false": _share(false),
    }


def swept(track: Track) -> float:
    """Σ|Δθ| / (t_min - t_start), t_min when the true contact is nearest (O Eq 12) [rad/s].

    NaN where there is no contact after the start.
    """
    if np.isnan(track.distance).all():
        return np.nan
    nearest = int(np.nanargmin(track.distance))
    elapsed = float(track.stamp[nearest] - track.stamp[0])
    if elapsed == 0.0:
        return np.nan
    turns = np.diff(np.unwrap(track.base[: nearest + 1, 2]))
    return float(np.abs(turns).sum()) / elapsed


def beginnings(track: Track, mode: str) -> int:
    """Count how often a controller goes into a mode."""
    inside = _in_mode(track, mode)
    return int((inside[1:] & ~inside[:-1]).sum()) + int(inside[0])


def _sharing(track: Track, kinds: Sequence[str]) -> NDArray[np.intp]:
    """Count the sources of some kinds that have a share, in each cycle with a true contact."""
    counted = np.array([kind in kinds for kind in track.sources.values()], np.bool_)
    touching = track.kind[1:] > 0
    sharing: NDArray[np.intp] = (track.shares[1:, counted][touching] > 0.0).sum(axis=1)
    return sharing


def _in_mode(track: Track, mode: str) -> NDArray[np.bool_]:
    return np.array([name == mode for name in track.modes])[track.mode]


def _share(cycles: NDArray[np.bool_]) -> float:
    return float(cycles.mean()) if len(cycles) else np.nan


def _mean(values: FloatArray) -> float:
    there = values[~np.isnan(values)]
    return float(there.mean()) if len(there) else np.nan


def cause(track: Track) -> str:
    """Why a push failed; nothing when it was a true success."""
    touching, final = track.kind > 0, track.distance[-1]
    if track.ending == Ending.ARRIVED:
        if np.isnan(final):
            return "arrived by estimate, without contact in truth"
        if final > track.within:
            return f"arrived by estimate, {final * 100:.2f} cm away in truth"
        return ""
    if not touching.any():
        return "never touched"
    if (track.estimate[touching] > 0).mean() < SILENT:
        force = float(np.median(track.force[touching]))
        return f"felt nothing: presses with {force:.1f} N, under the activation"
    if track.ending == Ending.AWAY:
        what = "object carried out of the field"
    elif track.ending == Ending.LOST:
        what = _lost(track)
    else:
        what = f"no progress for {_idle(track)}"
    felt = float((track.estimate[touching] > 0).mean())
    faint = f"; only {felt:.0%} of the contact felt" if felt < FAINT else ""
    return f"{what}; at best {np.nanmin(track.distance):.2f} m away{faint}"


def _lost(track: Track) -> str:
    touching = track.kind > 0
    last = int(np.flatnonzero(touching)[-1])
    times = int((touching[:-1] & ~touching[1:]).sum())
    lateral = float(track.contact[last, 1])
    side = "left" if lateral > 0 else "right"
    place = f"at the {side} edge" if abs(lateral) > EDGE else f"{lateral * 100:+.0f} cm aside"
    if track.stamp[-1] - track.stamp[last] > 0.5 * track.period * (~touching).sum():
        return f"lost {place} after {track.stamp[last]:.1f} s, never found again"
    return f"lost {times} times, last {place}"


def _idle(track: Track) -> str:
    """For how long there was no progress, and what the controller did most of that time."""
    nearest, since = np.inf, 0
    for row in np.flatnonzero(~np.isnan(track.distance)):
        if track.distance[row] < nearest - PROGRESS:
            nearest, since = track.distance[row], int(row)
    modes = np.bincount(track.mode[since:], minlength=len(track.modes))
    return f"{track.stamp[-1] - track.stamp[since]:.0f} s, mostly {track.modes[modes.argmax()]}"


def outcomes_of(tracks: Sequence[Track]) -> pd.DataFrame:
    """The outcomes of pushes, one row each; SENSING/CONTROLLER is the case."""
    frame = frame_of(map(outcome, tracks), Outcome)
    return frame.assign(**{CASE: frame["sensing"] + "/" + frame["controller"]})


def compare_all(frame: pd.DataFrame, seed: int) -> list[Comparison]:
    """Compare each sensor suite and controller but the first with one before it.

    That is the first with the same controller; without one, the first with the same sensing;
    without that, too, the first of all. `COMPARED_ALL` is compared over all pushes, `COMPARED`
    where both truly succeed.

    Args:
        frame: of all outcomes.
        seed: of the intervals.
    """
    before, pairs = list[str](), list[tuple[str, str]]()
    for case in frame[CASE].unique():
        sensing, controller = case.split("/")
        alike = [each for each in before if each.endswith(f"/{controller}")]
        alike += [each for each in before if each.startswith(f"{sensing}/")]
        if before:
            pairs.append((case, [*alike, before[0]][0]))
        before.append(case)
    succeeded = frame.copy()
    succeeded[COMPARED] = frame[COMPARED].where(frame["success_true"])
    return compared(succeeded, pairs, "success_true", [*COMPARED_ALL, *COMPARED], seed)
