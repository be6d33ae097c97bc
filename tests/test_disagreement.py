"""Two sources that lie apart in the same direction for long, by more than they state."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from contactfusion import Integrator, IntegratorConfig
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.integrator.disagreement import MOST, Disagreement
from contactfusion.integrator.sources import Event, EventKind
from contactfusion.surface import Surface
from tests.clouds import REGULAR
from tests.test_sets import PALM

STEP = 0.05


def disagreements(
    offset: Any,
    seconds: float = 6.0,
    noise: float = 0.0,
    surface: Surface | None = PALM,
    pauses: float = STEP,
) -> list[Event]:
    """What is reported of two skins in contact, the second of which is off, [mm] of 4 mm stated."""
    integrator, rng = Integrator(IntegratorConfig(frame="hand")), np.random.default_rng(0)
    events = list[Event]()
    for stamp in np.arange(0.0, seconds, pauses).tolist():
        for name, by in (("left", (0.0, 0.0, 0.0)), ("right", offset)):
            place = (np.array([10.0, 5.0, 0.0]) + by + noise * rng.standard_normal(3)) / 1e3
            place[2] = 0.0
            patch = place + np.array([(x, y, 0.0) for x in (-2, 2) for y in (-2, 2)]) / 1e3
            cloud = HypothesisCloud(
                name, REGULAR, stamp, "hand", patch, np.full(4, 0.9), spreads=np.full(4, 0.004)
            )
            integrator.receive(cloud)
        events += integrator.step(stamp, surface).report.events
    return [event for event in events if event.kind == EventKind.DISAGREES]


@pytest.mark.parametrize("surface", [None, PALM], ids=["no surface", "palm"])
def test_two_sources_that_stay_apart_are_reported_once(surface: Surface | None) -> None:
    (event,) = disagreements((0.0, -15.0, 0.0), surface=surface)
    assert event.source == "right"
    assert "'right' finds contacts 15 mm from where 'left' does, at (0, -15, 0) mm" in event.message
    assert "is one misplaced, or not calibrated?" in event.message


def test_sources_within_what_they_state_agree() -> None:
    assert not disagreements((0.0, -6.0, 0.0))
    assert not disagreements((0.0, 0.0, 0.0), noise=8.0)


def test_a_moment_is_no_disagreement() -> None:
    assert not disagreements((0.0, -15.0, 0.0), seconds=1.5)


def test_time_without_steps_counts_for_nothing() -> None:
    assert not disagreements((0.0, -15.0, 0.0), seconds=30.0, pauses=1.0)


def test_a_reset_forgets_what_was_apart() -> None:
    integrator = Integrator(IntegratorConfig(frame="hand"))
    for start in (0.0, 0.0):
        for stamp in np.arange(start, start + 1.5, STEP).tolist():
            for name, y in (("left", 0.005), ("right", -0.010)):
                place = np.array([[0.01, y, 0.0]])
                spreads = np.array([0.004])
                integrator.receive(
                    HypothesisCloud(
                        name, REGULAR, stamp, "hand", place, np.array([0.9]), spreads=spreads
                    )
                )
            step = integrator.step(stamp, PALM)
            assert not [e for e in step.report.events if e.kind == EventKind.DISAGREES]
        integrator.reset()


@pytest.mark.parametrize(("apart", "told"), [(MOST - 1, MOST - 1), (MOST, 0)])
def test_of_many_sources_the_first_by_name_are_compared(apart: int, told: int) -> None:
    offset = {row: np.full(3, 0.02 * (row == apart)) for row in range(MOST + 1)}
    centres = {f"skin {row:02d}": (offset[row], 0.004) for row in range(MOST + 1)}
    member: Any = SimpleNamespace(contact=SimpleNamespace(likelihood=0.9), centres=centres)
    watch = Disagreement()
    found = [pair for now in range(20) for pair in watch.watch(now * 250_000_000, [member])]
    assert len(found) == told


@pytest.mark.parametrize("contacts", [1, 2, 4])
def test_several_contacts_make_no_time_pass_faster(contacts: int) -> None:
    watch, centres = Disagreement(), {"a": (np.zeros(3), 0.004), "b": (np.full(3, 0.01), 0.004)}
    member: Any = SimpleNamespace(contact=SimpleNamespace(likelihood=1.0), centres=centres)
    told = [step for step in range(100) if [*watch.watch(step * 50_000_000, [member] * contacts)]]
    assert told == [40]


def test_a_source_that_is_mounted_anew_begins_anew() -> None:
    watch = Disagreement()
    centres = {"a": (np.zeros(3), 0.004), "b": (np.full(3, 0.01), 0.004)}
    member: Any = SimpleNamespace(contact=SimpleNamespace(likelihood=1.0), centres=centres)
    told = []
    for step in range(79):
        told += [*watch.watch(step * 50_000_000, [member])]
        if step == 39:
            watch.forget("b")
    assert not told
