"""Contacts as rows of a table: what contacts.csv and Parquet files hold."""

from collections.abc import Iterator

from contactfusion.pipeline import Step

ENTRIES = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
"""The entries of a covariance that differ."""
COLUMNS = (
    *("stamp", "x", "y", "z", "likelihood", "dispersion", "voxels", "fx", "fy", "fz", "shares"),
    *(f"cov_{name}" for name in ENTRIES),
)
"""Stamp [s], place [m], likelihood, dispersion [m], voxels, force [N], share of each source,
covariance [m²]."""
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
        covariance = [contact.covariance[entry] for entry in ENTRIES.values()]
        cells, entries = ([f"{n:.6g}" for n in row] for row in (numbers, covariance))
        yield (f"{step.stamp:.6f}", *cells, shares, *entries)
