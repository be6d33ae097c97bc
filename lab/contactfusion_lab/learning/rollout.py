"""Pushes to learn from: those of the paper, and varied ones (O §III-B)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal
from zlib import crc32

import numpy as np

from contactfusion_lab.experiments.push.plan import GRID, VALIDATION, Place
from contactfusion_lab.scenes.push.config import FRICTIONS, PAPER

Split = Literal["training", "validation"]
MOUNTINGS = ("lidar", "lidar_side", "lidar_tilted")
"""Every push is seen from all of them at once."""
SKIN = "skin"
"""The driver that feels the truth's own skin."""
WITHOUT = 12
"""So many pushes of the paper's never touch (O §III-B)."""
HELD = 7
"""Every so-manieth varied push is for validation; drivers and frictions alternate by 2, 3 and 5."""
FIELD, NEAREST = 3.0, 0.6
"""Varied targets lie within this along x and y, and not so near to the start [m]."""
OFFSET, YAW = 0.2, 45.0
"""How far varied objects stand to either side [m], and how they are turned [degrees]."""
AS_IN_PAPER = 0.6
"""The share of varied pushes with one of the paper's objects; others have some of their kind."""
VARIED_DRIVERS = ("tuned", "tuned", "tuned_neither", "paper", "tuned_realign_only")
"""Who steers varied pushes by skin."""


Motion = tuple[float, float, float]
"""Ahead, to the left [m/s], turn [rad/s]."""


@dataclass(frozen=True)
class Detour:
    """A while in which the base moves as told, whatever the controller says.

    Attributes:
        start: [s].
        end: [s].
        motion: of the base.
    """

    start: float
    end: float
    motion: Motion


@dataclass(frozen=True)
class Lesson:
    """One push to learn from.

    Attributes:
        name: of the push, and of its file.
        split: what it is for.
        round: 0 when the skin drives; later ones are driven by the networks of the one before.
        object: its name, or its fields.
        friction: its name.
        target: where to, in `odom` [m].
        offset: of the object to the left [m].
        yaw: of the object [degrees].
        driver: "skin", or the mounting whose networks drive.
        controller: the parameters of reactive pushing.
        detours: when the base moves as told.
        seed: of all chance in it.
    """

    name: str
    split: Split
    round: int
    object: Any
    friction: str
    target: Place
    offset: float = 0.0
    yaw: float = 0.0
    driver: str = SKIN
    controller: str = "tuned"
    detours: tuple[Detour, ...] = ()
    seed: int = 0

    def detour_at(self, stamp: float) -> Motion | None:
        """Give how the base is to move at a stamp [s], when it is not the controller's turn."""
        for detour in self.detours:
            if detour.start <= stamp < detour.end:
                return detour.motion
        return None


def first_lessons(varied: int, seed: int) -> list[Lesson]:
    """Give the paper's 156 + 36 pushes by skin, and varied ones.

    Args:
        varied: how many of these.
        seed: of all chance.
    """
    lessons: list[Lesson] = []
    sets: dict[Split, Sequence[Place]] = {"training": GRID, "validation": VALIDATION}
    for split, places in sets.items():
        for thing in PAPER:
            for friction in FRICTIONS:
                for row, target in enumerate(places):
                    name = f"{split}-{thing}-{friction}-{row:02d}"
                    chance = _seed(seed, name)
                    lessons.append(Lesson(name, split, 0, thing, friction, target, seed=chance))
    for row in range(WITHOUT):
        rng = np.random.default_rng([seed, 1, row])
        thing = list(PAPER)[row % len(PAPER)]
        away = Detour(0.0, 15.0, (-float(rng.uniform(0.05, 0.3)), *_aside(rng)))
        name = f"training-without-{row:02d}"
        chance = _seed(seed, name)
        lessons.append(
            Lesson(name, "training", 0, thing, "mu1", (2.0, 0.0), detours=(away,), seed=chance)
        )
    lessons += [_varied(row, 0, SKIN, seed) for row in range(varied)]
    return lessons


def driven_lessons(count: int, turn: int, mountings: Sequence[str], seed: int) -> list[Lesson]:
    """Give varied pushes that networks drive, each from one of the mountings."""
    return [_varied(row, turn, mountings[row % len(mountings)], seed) for row in range(count)]


def _varied(row: int, turn: int, driver: str, seed: int) -> Lesson:
    rng = np.random.default_rng([seed, 2, turn, row])
    split: Split = "validation" if row % HELD == HELD - 1 else "training"
    detours, stamp = [], 0.0
    for _ in range(rng.integers(0, 4)):
        stamp += float(rng.uniform(1.5, 12.0))
        end = stamp + float(rng.uniform(0.3, 4.0))
        detours.append(Detour(stamp, end, (float(rng.uniform(-0.3, 0.1)), *_aside(rng))))
        stamp = end
    controller = VARIED_DRIVERS[row % len(VARIED_DRIVERS)] if driver == SKIN else "tuned"
    name = f"{split}-varied-{turn}-{row:03d}"
    return Lesson(
        name, split, turn, _object(rng), list(FRICTIONS)[row % 2], _target(rng),
        float(rng.uniform(-OFFSET, OFFSET)), float(rng.uniform(-YAW, YAW)), driver, controller,
        tuple(detours), _seed(seed, name),
    )  # fmt: skip


def _seed(seed: int, name: str) -> int:
    """Give the seed of all that is left to chance in a lesson."""
    return crc32(f"{seed} {name}".encode())


def _object(rng: np.random.Generator) -> Any:
    """Draw one of the paper's objects, or one like them of another size."""
    name = list(PAPER)[rng.integers(len(PAPER))]
    if rng.random() < AS_IN_PAPER:
        return name
    height, mass = float(rng.uniform(0.45, 0.85)), float(rng.uniform(5.0, 30.0))
    if rng.random() < 0.4:
        radius = float(rng.uniform(0.12, 0.35))
        return {"shape": "cylinder", "radius": radius, "height": height, "mass": mass}
    width, length = rng.uniform(0.2, 0.6, 2).tolist()
    return {"shape": "box", "size": (length, width, height), "mass": mass}


def _target(rng: np.random.Generator) -> Place:
    while True:
        x, y = rng.uniform(-FIELD, FIELD, 2).tolist()
        if np.hypot(x, y) >= NEAREST and not (-0.8 <= x <= 0.0 and abs(y) <= 0.35):
            return x, y


def _aside(rng: np.random.Generator) -> tuple[float, float]:
    return float(rng.uniform(-0.15, 0.15)), float(rng.uniform(-0.4, 0.4))
