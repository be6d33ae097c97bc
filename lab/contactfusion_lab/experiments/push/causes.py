"""Why a push failed, in one short sentence, as its track tells it."""

import numpy as np

from contactfusion_lab.experiments.push.trial import Track
from contactfusion_lab.scenes.push.scene import Ending

EDGE = 0.22
"""Contacts further aside than this are at an edge of the face [m]."""
SILENT, FAINT = 0.2, 0.6
"""A contact that is felt in less than these shares of its time is not felt, or hardly."""
PROGRESS = 0.02
"""Coming nearer to the target by less than this is no progress [m]."""


def cause(track: Track) -> str:
    """Say why a push failed; nothing when it was a true success."""
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
    """Say for how long there was no progress, and what the controller did most of that time."""
    nearest, since = np.inf, 0
    for row in np.flatnonzero(~np.isnan(track.distance)):
        if track.distance[row] < nearest - PROGRESS:
            nearest, since = track.distance[row], int(row)
    modes = np.bincount(track.mode[since:], minlength=len(track.modes))
    return f"{track.stamp[-1] - track.stamp[since]:.0f} s, mostly {track.modes[modes.argmax()]}"
