"""Why a contact was reported, and why a voxel was not."""

from collections import Counter

import numpy as np

from contactfusion.contacts import Contact
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
    rest = fusion.without(source).contacts
    if not rest:
        return "no contact remains"
    away = [float(np.linalg.norm(other.position - contact.position)) for other in rest]
    nearest = int(np.argmin(away))
    reach = max(3.0 * contact.dispersion, 2.0 * fusion.field.entries.grid.voxel_size)
    if away[nearest] > reach:
        return f"no contact remains here; the nearest is {away[nearest] * 100:.1f} cm away"
    return (
        f"likelihood {rest[nearest].likelihood:.2f}, "
        f"{away[nearest] * 1000:.1f} mm from where it is now"
    )
