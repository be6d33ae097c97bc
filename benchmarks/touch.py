"""The arm's generators: a touch from first to last, a cycle of all seven, the wrench's way."""

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.interleave import Spread, interleave, timed
from benchmarks.table import Row
from contactfusion import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import PointCloud, Reading, Wrench
from contactfusion.robots.model import shared_robot
from contactfusion_lab.experiments.touch.plan import DEFAULT, Plan, Touch, read_plan
from contactfusion_lab.scenes.touch.scene import TouchScene

POINTS = 20_000
"""Of a cloud."""
PLACES = 10_000
"""Around the arm."""
CYCLES = 100
"""Of a round; the camera gives a cloud in each."""


def rows(rounds: int) -> Iterator[Row]:
    """Measure the arm and its hand with the seven generators of the touch experiment."""
    plan, _ = read_plan(DEFAULT, [], 15, "prototype", (), 7)
    touches = [touch for touch in plan.touches(["box"], 1) if not touch.short][::2]
    config = _seven(plan)
    pipeline = Pipeline(config)
    _touch(plan, touches[0], pipeline)  # compiles, fits spheres
    seconds = [_touch(plan, touch, pipeline) for touch in touches]
    yield Row("touch, simulated and felt by seven generators", Spread.of(seconds), "s", 0.5)
    readings = _readings(plan, touches[0])
    cycle = _last_cycle(readings)
    slowest = [1e3 * _slowest(pipeline, cycle) for _ in range(rounds)]
    yield Row(f"cycle of seven generators, {POINTS} points: p99", Spread.of(slowest), "ms", 60.0)
    steps = [1e3 * _slowest_step(pipeline, readings, cycle) for _ in range(rounds + 1)][1:]
    yield Row("  its fusion while it touches: p99", Spread.of(steps), "ms", 15.0)
    medians = [1e3 * _wrench(pipeline, cycle) for _ in range(rounds)]
    yield Row("a wrench becomes hypotheses", Spread.of(medians), "ms", 1.0)
    yield _nearest(rounds, pipeline)
    yield from _beside_clouds(rounds, config, cycle)


def _nearest(rounds: int, pipeline: Pipeline) -> Row:
    """Measure the search for the nearest surface points and links of places around the arm."""
    surface = pipeline.state(0.0).surface
    assert surface is not None
    rng = np.random.default_rng(0)
    chosen = surface.points[rng.integers(len(surface.points), size=PLACES)]
    places = chosen + 0.05 * rng.standard_normal((PLACES, 3))
    times = interleave(
        {"ours": timed(lambda: surface.nearest(places))}, rounds=rounds, repeats={"ours": 10}
    ).time("ours")
    spread = Spread(*(1e3 * value for value in (times.median, times.low, times.high)))
    return Row(f"nearest surface points of {PLACES:,} places", spread, "ms", 5.0)


def _beside_clouds(rounds: int, config: PipelineConfig, cycle: list[Reading]) -> Iterator[Row]:
    """Measure the wrench's way while processes of their own work on clouds, on all cores."""
    bound = os.sched_getaffinity(0)
    os.sched_setaffinity(0, range(os.cpu_count() or 1))
    pipeline = Pipeline(_isolated(config))
    try:
        seconds = [_beside(pipeline, cycle) for _ in range(rounds)]
    finally:
        pipeline.close()
        os.sched_setaffinity(0, bound)
    medians = [1e3 * float(np.median(each)) for each in seconds]
    tails = [1e3 * float(np.percentile(each, 99)) for each in seconds]
    yield Row("  while clouds are worked on beside it", Spread.of(medians), "ms", 1.0)
    yield Row("  p99 of that", Spread.of(tails), "ms")


def _seven(plan: Plan) -> PipelineConfig:
    """Leave out the second range generator, which waits for objects that move."""
    config = plan.pipeline_of("box")
    generators = {name: options for name, options in config.generators.items() if name != "moving"}
    return config.model_copy(update={"generators": generators})


def _isolated(config: PipelineConfig) -> PipelineConfig:
    """Give what takes long a process of its own."""
    generators: dict[str, Any] = {
        name: {**options, "isolate": options["type"] in ("range", "free_space")}
        for name, options in config.generators.items()
    }
    return config.model_copy(update={"generators": generators})


def _touch(plan: Plan, touch: Touch, pipeline: Pipeline) -> float:
    """Give the CPU time of one touch [s]."""
    pipeline.reset()
    start = time.process_time()
    stamp = 0.0
    for reading in _readings(plan, touch):
        pipeline.receive(reading)
        stamp = reading.stamp
    pipeline.step(stamp)
    return time.process_time() - start


def _readings(plan: Plan, touch: Touch) -> list[Reading]:
    """Simulate a touch."""
    assert plan.pipeline.robot is not None
    scene = TouchScene(plan.scene_of(touch), shared_robot(plan.pipeline.robot), touch.seed)
    return list(scene.readings())


def _last_cycle(readings: list[Reading]) -> list[Reading]:
    """Return the last reading of every sensor, the cloud thinned to `POINTS`."""
    last = {(reading.sensor, type(reading)): reading for reading in readings}
    rng = np.random.default_rng(0)
    cycle = []
    for reading in last.values():
        if isinstance(reading, PointCloud):
            chosen = rng.permutation(len(reading.points))[:POINTS]
            reading = replace(reading, points=reading.points[chosen])
        cycle.append(reading)
    return cycle


def _slowest(pipeline: Pipeline, cycle: list[Reading]) -> float:
    """Give the 99th percentile of cycles at 10 Hz [s]."""
    pipeline.reset()
    seconds = []
    for number in range(CYCLES):
        stamp = 0.1 * number
        readings = [replace(reading, stamp=stamp) for reading in cycle]
        start = time.perf_counter()
        for reading in readings:
            pipeline.receive(reading)
        pipeline.step(stamp)
        seconds.append(time.perf_counter() - start)
    return float(np.percentile(seconds[1:], 99))


def _slowest_step(pipeline: Pipeline, readings: list[Reading], cycle: list[Reading]) -> float:
    """Return the 99th percentile of the integrator's steps at 10 Hz after a touch began [s]."""
    pipeline.reset()
    for reading in readings:
        pipeline.receive(reading)
    began, seconds = readings[-1].stamp, []
    for number in range(CYCLES):
        stamp = began + 0.1 * number
        for reading in cycle:
            pipeline.receive(replace(reading, stamp=stamp))
        start = time.perf_counter()
        fusion = pipeline.step(stamp).fusion
        seconds.append(time.perf_counter() - start)
        assert fusion.contacts
    return float(np.percentile(seconds[1:], 99))


def _wrench(pipeline: Pipeline, cycle: list[Reading]) -> float:
    """Give the median time in which a wrench becomes hypotheses [s]."""
    pipeline.reset()
    wrench = next(reading for reading in cycle if isinstance(reading, Wrench))
    for reading in cycle:
        if not isinstance(reading, PointCloud):
            pipeline.receive(replace(reading, stamp=0.0))
    return float(np.median(_received(pipeline, wrench, 0.0)))


def _beside(pipeline: Pipeline, cycle: list[Reading]) -> list[float]:
    """Give these times while other processes work on clouds [s]."""
    pipeline.reset()
    wrench = next(reading for reading in cycle if isinstance(reading, Wrench))
    seconds: list[float] = []
    for number in range(10):
        stamp = 0.1 * number
        for reading in cycle:
            pipeline.receive(replace(reading, stamp=stamp))
        seconds += _received(pipeline, wrench, stamp)
        pipeline.step(stamp + 0.099)
    return seconds


def _received(pipeline: Pipeline, wrench: Wrench, stamp: float) -> list[float]:
    seconds = []
    for number in range(1, 100):
        reading = replace(wrench, stamp=stamp + 0.001 * number)
        start = time.perf_counter()
        pipeline.receive(reading)
        seconds.append(time.perf_counter() - start)
    return seconds
