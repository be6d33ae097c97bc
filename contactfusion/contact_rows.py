"""Contacts as rows of a table: what contacts.csv and Parquet files hold."""

from collections.abc import Iterator

from contactfusion.pipeline import Step

COLUMNS = ("stamp", "x", "y", "z", "likelihood", "dispersion", "voxels", "fx", "fy", "fz", "shares")
"""Stamp [s], place [m], likelihood, dispersion [m], voxels, force [N], share of each source."""
Row = tuple[str | int | float, ...]


def contact_rows(step: Step) -> Iterator[Row]:
    """Give one row a contact, as text with six digits, in the order of `COLUMNS`."""
    for contact in step.fusion.contacts:
        shares = " ".join(f"{name}:{share:.4f}" for name, share in contact.shares.items())
        numbers = [
            *contact.position,
            contact.likelihood,
            contact.dispersion,
            contact.voxels,
            *contact.force,
        ]
        yield (f"{step.stamp:.6f}", *(f"{n:.6g}" for n in numbers), shares)
