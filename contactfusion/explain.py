"""Why a contact was reported, and why a voxel was not: in short, of one fusion alone.

`contactfusion.explaining` tells more, of a moment in a recording.
"""

from collections import Counter

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.explaining.remains import reach_of, without
from contactfusion.integrator.fusion import Fusion

REASONS = {
    "below_threshold": "too unlikely",
    "support_only": "predicted, but no sensor felt them",
    "nulled": "ruled out",
}


def explain(fusion: Fusion) -> str:
    """Tell for each contact who gave it and what would remain without each source.

    Returns:
        One line a contact, a line for each of its sources, and one line on all other voxels.
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
