"""Long lives of a pipeline: plugs in and out at random, and millions of cycles."""

import random
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion import HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig, Wrench
from contactfusion.errors import ContactFusionError
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from tests.torture.trial import Row

HOUR = 3600.0
CYCLES = 10_000_000
"""Of a small pipeline by De Morgan."""
MANY = 1000
"""Number of sources."""
PROBE: dict[str, Any] = {
    "surface": {
        "frame": "probe",
        "shapes": [{"shape": "sphere", "radius": 0.05}],
        "spacing": 0.01,
    },
    "integrator": {"frame": "probe"},
    "generators": {"wrist": {"type": "force_torque", "sensor": "wrist", "sign": "on_robot"}},
}
GROWN = 5.0
"""What memory may grow by [MB]."""


def plugs(_: Path) -> Iterator[Row]:
    """Plug in and out at random for an hour of simulated time, at 20 Hz."""
    rng, pipe = random.Random(0), Pipeline(PipelineConfig.model_validate(PROBE))
    faults, first, stamp = list[str](), 0.0, 0.0
    options = PROBE["generators"]["wrist"]
    for cycle in range(int(20 * HOUR)):
        stamp = 0.05 * cycle
        name = f"wrist_{rng.randrange(4)}"
        if rng.random() < 0.05:
            try:
                if name in pipe.generators:
                    pipe.unplug(name)
                else:
                    pipe.plug(name, {**options, "sensor": name})
            except ContactFusionError as error:
                faults.append(str(error))
        for sensor in ("wrist", *(f"wrist_{row}" for row in range(4))):
            pushes = np.array([0.0, 0.0, -5.0 * (cycle % 200 < 100)])
            torque = np.array([0.0, -0.02 * pushes[2], 0.0])
            pipe.receive(
                Wrench(stamp=stamp, frame="probe", sensor=sensor, force=pushes, torque=torque)
            )
        found = len(pipe.step(stamp).fusion.contacts)
        pressed = 20 < cycle % 200 < 100
        if pressed:
            faults.append("" if found else f"nothing is found at {stamp:.2f} s")
        if cycle == 2000:
            first = memory()
    faults.append(_grown(first))
    yield Row.of("plugs in and out for an hour, four sources beside one", faults)


def cycles(_: Path, count: int = CYCLES) -> Iterator[Row]:
    """Many cycles of a small integrator: neither memory nor the CPU time of a cycle grows."""
    rng = np.random.default_rng(0)
    integrator = Integrator(IntegratorConfig(rule="de_morgan"))
    integrator.plug("skin", HypothesisKind.REGULAR, replace=True)
    places = rng.uniform(-0.1, 0.1, (64, 4, 3))
    first = took = 0.0
    began = time.process_time()
    for cycle in range(count):
        stamp = 0.01 * cycle
        cloud = HypothesisCloud(
            "skin", HypothesisKind.REGULAR, stamp, "base", places[cycle % 64], np.full(4, 0.5)
        )
        integrator.receive(cloud)
        integrator.step(stamp)
        if cycle == count // 10:
            first, took, began = memory(), time.process_time() - began, time.process_time()
    slower = (time.process_time() - began) / 9.0 / max(took, 1e-9)
    faults = [_grown(first), "" if slower < 1.3 else f"a cycle takes {slower:.2f} times as long"]
    yield Row.of(f"{count:,} cycles of a small integrator", faults)


def many(_: Path) -> Iterator[Row]:
    """A thousand sources that find one contact."""
    integrator = Integrator()
    for row in range(MANY):
        place = np.random.default_rng(row).normal(0.0, 0.0005, (1, 3))
        integrator.receive(
            HypothesisCloud(
                f"source {row}", HypothesisKind.REGULAR, 0.0, "base", place, np.full(1, 0.5)
            )
        )
    contacts = integrator.step(0.0).contacts
    wrong = "" if len(contacts) == 1 else f"{len(contacts)} contacts"
    yield Row.of(f"{MANY:,} sources that find one contact", [wrong])


def memory() -> float:
    """The resident memory of this process [MB]."""
    fields = Path("/proc/self/statm").read_text(encoding="utf-8").split()
    return int(fields[1]) * 4096 / 1e6


def _grown(first: float) -> str:
    grown = memory() - first
    return "" if grown < GROWN else f"memory grew from {first:.0f} MB by {grown:.0f} MB"
