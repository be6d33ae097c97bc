"""Where objects are pushed to: sets of targets by name, from a file, or by chance (method §8)."""

from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.scenes.push.config import Distance

Place = tuple[float, float]

GRID: tuple[Place, ...] = tuple(
    (float(x), float(y)) for x in range(-2, 3) for y in range(-2, 3) if (x, y) != (0, 0)
)
"""24 places a metre apart (O Fig 3) [m]."""
VALIDATION: tuple[Place, ...] = tuple((x, y) for x in (-3.0, 0.0, 3.0) for y in (-3.0, 3.0))
"""The corners and two sides of a larger square; nothing else is at them [m]."""
NEW: tuple[Place, ...] = (
    (2.5, 0.5), (2.5, -1.5), (1.5, 2.5), (1.5, -0.5), (0.5, -2.5), (0.5, 1.5),
    (-0.5, 2.5), (-0.5, -1.5), (-1.5, 0.5), (-1.5, -2.5), (-2.5, 1.5), (-2.5, -0.5),
)  # fmt: skip
"""Twelve that are in neither of these [m]."""
REAL: tuple[Place, ...] = tuple((x, y) for x in (-2.0, 0.0, 2.0) for y in (-2.0, 2.0))
"""Those of the real robots (O §V), also in the grid [m]."""
REAL_NEAR: tuple[Place, ...] = tuple((x, y) for x in (-1.5, 0.0, 1.5) for y in (-1.5, 1.5))
"""Those for the L-shape there [m]."""
NAMED = {
    "grid": GRID,
    "validation": VALIDATION,
    "new": NEW,
    "real": REAL,
    "real_near": REAL_NEAR,
}
RANDOM = "random"


@dataclass(frozen=True)
class Targets:
    """A set of targets.

    Attributes:
        name: of the set.
        places: each x and y in `odom` [m]; None: drawn anew for every trial.
        trials: how many trials there are in all, when they are drawn.
    """

    name: str
    places: tuple[Place, ...] | None
    trials: int = 0


class _TargetFile(Model):
    targets: tuple[tuple[Distance, Distance], ...] = Field(min_length=1)
    """Each x and y [m]."""


def read_targets(told: str) -> Targets:
    """Give the targets of a named set, of `random:N`, or of a YAML file.

    Raises:
        ConfigurationError: it is none of these, or a target is no pair of finite numbers.
    """
    if told in NAMED:
        return Targets(told, NAMED[told])
    name, colon, count = told.partition(":")
    if name == RANDOM:
        if not colon or not count.isdecimal() or int(count) < 1:
            raise ConfigurationError(f"'{told}': write random:N, with N trials in all")
        return Targets(RANDOM, None, int(count))
    path = Path(told)
    if path.suffix not in (".yaml", ".yml"):
        hint = name_hint(told, [*NAMED, "random:N"], "targets")
        raise ConfigurationError(f"unknown targets '{told}'; {hint}, or a YAML file of `targets`")
    if path.stem in (*NAMED, RANDOM):
        raise ConfigurationError(f"there are targets '{path.stem}' already: rename {path}")
    try:
        return Targets(path.stem, _TargetFile(**read_yaml(path)).targets)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}" if error.path else str(error)) from None
