"""How a step grows with the number of sources that find the same three contacts.

    python -m benchmarks.growth

Each source sends five hypotheses a step, around contacts on a sphere; the surface is given or not.
Prints the time of a step, and of a source in it.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from contactfusion import HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.shapes import BodyConfig
from contactfusion.surface import Surface

RADIUS, SPACING, SPREAD = 0.2, 0.01, 0.003
"""Of the sphere, of the points on it, and of the hypotheses around a contact [m]."""
STEPS = 4


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument("--sources", type=int, nargs="+", default=[10, 100, 300, 1000])
    body = BodyConfig.model_validate(
        {"frame": "base", "shapes": [{"shape": "sphere", "radius": RADIUS}], "spacing": SPACING}
    )
    surface = body.sampled(Path())
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
