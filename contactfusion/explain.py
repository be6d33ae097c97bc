"""Why a contact was reported, and why a voxel was not, as text."""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.explaining.accounting import account_of
from contactfusion.explaining.moment import moment_at
from contactfusion.explaining.remains import reach_of, without
from contactfusion.explaining.settings import Settings
from contactfusion.explaining.text import told
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline import Pipeline
from contactfusion.readings import Reading

REASONS = {
    "below_threshold": "too unlikely",
    "support_only": "predicted, but no sensor felt them",
    "nulled": "ruled out",
}


def explain_moment(pipeline: Pipeline, readings: Iterable[Reading], time: float) -> str:
    """Explanation of the last step until a time, as `contactfusion explain` prints it.

    Args:
        pipeline: it receives the readings until then.
        readings: in order of their stamps.
        time: [s].

    Returns:
        For each contact what its sources say, how old that is, and what would remain without each;
        where a contact might be expected, why there is none; then sources that are in trouble.

    Raises:
        TimeError: the time lies outside the steps, or there are none.
    """
    settings = Settings.of(pipeline)
    moment = moment_at(pipeline.run(readings), time, settings.tolerance)
    return told(account_of(moment, settings))


def explain_fusion(fusion: Fusion) -> str:
    """Short explanation of a single fusion, which needs no pipeline.

    Returns:
        One line a contact, a line for each of its sources with what would remain without it, and
        one line on all other voxels.
    """
    lines = []
    for contact in fusion.contacts:
        lines.append(str(contact))
        for source in sorted(name for name, share in contact.shares.items() if share > 0.0):
            lines.append(f"  without {source}: {_without(fusion, contact, source)}")
    if not lines:
        lines.append("no contact")
    verdicts = Counter(str(verdict) for verdict in fusion.space.verdicts)
    others = [f"{verdicts[key]} {words}" for key, words in REASONS.items() if verdicts[key]]
    if others:
        lines.append(f"other voxels: {', '.join(others)}")
    lines += [f"{source} remarks: {note}" for source, note in fusion.report.notes]
    return "\n".join(lines)


def _without(fusion: Fusion, contact: Contact, source: str) -> str:
    """Tell what becomes of a contact without one source."""
    reach = reach_of(contact, fusion.field.entries.grid.voxel_size)
    rest = without(fusion, source, contact.position, reach)
    if rest.contact:
        return f"likelihood {rest.likelihood:.2f}, {rest.moved * 1000:.1f} mm from where it is now"
    if np.isnan(rest.moved):
        return "no contact remains"
    return f"no contact remains here; the nearest is {rest.moved * 100:.1f} cm away"
