"""What the second paper reached (O Table I, §IV)."""

from dataclasses import dataclass

Group = tuple[str, str]
"""An object and a friction."""
GROUPS: tuple[Group, ...] = tuple(
    (thing, friction) for thing in ("box", "cylinder", "nonuniform") for friction in ("mu1", "mu2")
)
START = "nominal"
"""Its pushes started so."""


@dataclass(frozen=True)
class Reached:
    """One row of the paper.

    Attributes:
        sensing: what felt.
        targets: the name of the set.
        each: pushes of each object and friction.
        hits: successes, in the order of `GROUPS`; the paper judges by the estimated contact.
        share: of all pushes.
        measures: by the names of results.csv, in their units. The paper prints errors in cm; 0.4 mm
            is less than its sensors can tell, and m is taken to be meant (method §8).
    """

    sensing: str
    targets: str
    each: int
    hits: tuple[int, ...]
    share: float
    measures: dict[str, float]


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
