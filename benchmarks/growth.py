"""How a step grows with the number of sources that find the same three contacts.

    python -m benchmarks.growth

Each source sends five hypotheses a step, around contacts on a sphere; the surface is given or not.
Prints the time of a step, and of a source in it; `make bench` has the growth from 10 to 100.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.interleave import Spread
from benchmarks.table import Row
from contactfusion import HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.shapes import BodyConfig
from contactfusion.surface import Surface

RADIUS, SPACING, SPREAD = 0.2, 0.01, 0.003
"""Of the sphere, of the points on it, and of the hypotheses around a contact [m]."""
STEPS = 4
FEW, MANY = 10, 100
"""Sources between which the growth is measured."""


def rows(rounds: int) -> Iterator[Row]:
    """Measure how a step grows with the number of sources."""
    surface = _sphere()
    for rule in ("sets", "de_morgan"):
        grown = [
            step_of(MANY, rule, surface) / step_of(FEW, rule, surface) for _ in range(rounds + 1)
        ]
        name = f"{rule}, {MANY} sources against {FEW}"
        yield Row(name, Spread.of(grown[1:]), "x time", 1.1 * MANY / FEW)


def _sphere() -> Surface:
    body = BodyConfig.model_validate(
        {"frame": "base", "shapes": [{"shape": "sphere", "radius": RADIUS}], "spacing": SPACING}
    )
    return body.sampled(Path())


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument("--sources", type=int, nargs="+", default=[10, 100, 300, 1000])
    surface = _sphere()
    counts = parser.parse_args().sources
    for rule, known in (("sets", surface), ("sets", None), ("de_morgan", surface)):
        for count in counts:
            took = step_of(count, rule, known)
            what = f"{rule}, {count} sources{'' if known else ', no surface'}"
            print(f"{what}: {1e3 * took:.1f} ms, {1e3 * took / count:.3f} each")


def step_of(count: int, rule: str, surface: Surface | None) -> float:
    """The shortest time of a step with so many sources [s]."""
    integrator, rng, shortest = (
        Integrator(IntegratorConfig(rule=rule)),
        np.random.default_rng(0),
        [],
    )
    contacts = rng.normal(size=(3, 3))
    contacts *= RADIUS / np.linalg.norm(contacts, axis=1, keepdims=True)
    for step in range(STEPS):
        for row in range(count):
            positions = contacts[row % 3] + rng.normal(0.0, SPREAD, (5, 3))
            cloud = HypothesisCloud(
                f"source {row}",
                HypothesisKind.REGULAR,
                0.1 * step,
                "base",
                positions,
                np.full(5, 0.15),
            )
            integrator.receive(cloud)
        began = time.perf_counter()
        integrator.step(0.1 * step, surface)
        shortest.append(time.perf_counter() - began)
    return min(shortest[1:])  # the first waits for kernels


if __name__ == "__main__":
    main()
