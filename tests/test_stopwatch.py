"""How often generators take longer than their budgets."""

import itertools
from typing import Any

import pytest

from contactfusion import Grid, State
from contactfusion.generator import GeneratorConfig
from contactfusion.stopwatch import StopWatch
from tests.toys import Echo, Naughty, NaughtyConfig, point

STATE = State(now=0.0, grid=Grid("base", 0.005))


def test_calls_over_budget_are_counted_with_the_longest() -> None:
    clock = itertools.chain(*((10.0 * n, 10.0 * n + took) for n, took in enumerate((1, 2, 9, 3))))
    watch = StopWatch(lambda: next(clock))
    slow = Echo("slow", GeneratorConfig(budget=2.5))
    for _ in range(4):
        (cloud,) = watch.ask(slow, point(0.0, 1.0, 2.0, 3.0), STATE)
        assert cloud.source == "slow"
    assert watch.took == 3.0
    (line,) = watch.lines()
    told = "2 of 4 calls of 'slow' took longer than its budget of 2.5 s (at most 9 s)"
    assert line.strip() == told


def test_a_call_that_raises_counts_as_well_and_one_in_time_is_not_told() -> None:
    clock: Any = itertools.count()
    watch = StopWatch(lambda: float(next(clock)))
    naughty = Naughty("naughty", NaughtyConfig(how="raises"))
    with pytest.raises(RuntimeError, match="out of order"):
        watch.ask(naughty, point(0.0, 1.0, 2.0, 3.0), STATE)
    watch.ask(Echo("fast", GeneratorConfig(budget=1.0)), point(0.0, 1.0, 2.0, 3.0), STATE)
    assert [line.split("'")[1] for line in watch.lines()] == ["naughty"]
