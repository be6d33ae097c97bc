"""Contacts over time by sources that are slower than the loop, or than each other."""

import os
import subprocess
import sys
from collections import deque
from typing import Any

import numpy as np
import pytest

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.hypotheses import Resultant

LOOP, SLOW = 0.01, 0.2
HERE = (0.0, 0.0, 0.0)

Said = tuple[tuple[tuple[float, float, float], float], ...]
"""Places [m] and likelihoods."""


class Loop:
    """A loop whose sources replace what they said; each reports at its own rate.

    Args:
        period: of the loop [s].
        config: of the integrator.
    """

    def __init__(self, period: float = LOOP, **config: Any) -> None:
        fields: dict[str, Any] = {"frame": "hand", "timeout": 1.0, **config}
        self.integrator = Integrator(IntegratorConfig(**fields))
        self.period, self.steps = period, 0

    @property
    def now(self) -> float:
        return self.period * self.steps

    def say(
        self, name: str, *said: tuple[tuple[float, float, float], float], **cloud: Any
    ) -> "Loop":
        """A source reports at the time of the next step."""
        replace, sensitivity = cloud.pop("replace", True), cloud.pop("sensitivity", 0.0)
        self.integrator.plug(name, replace=replace, sensitivity=sensitivity)
        positions = np.reshape([place for place, _ in said], (-1, 3))
        likelihoods = np.array([p for _, p in said], np.float64)
        spreads = np.full(len(said), 0.004)
        stamp = cloud.pop("stamp", self.now)
        given = name, HypothesisKind.REGULAR, stamp, "hand", positions, likelihoods
        self.integrator.receive(HypothesisCloud(*given, spreads=spreads, **cloud))
        return self

    def step(self) -> Fusion:
        fusion = self.integrator.step(self.now)
        self.steps += 1
        return fusion

    def is_due(self, period: float) -> bool:
        """Whether a source of such a period [s] reports before the next step."""
        return self.steps % round(period / self.period) == 0


def touched(loop: Loop, steps: int = 200, p: float = 0.95, period: float = 0.05) -> Fusion:
    """The last of some steps in which a skin reports one touch."""
    fusions = deque[Fusion](maxlen=1)
    for _ in range(steps):
        if loop.is_due(period):
            loop.say("skin", (HERE, p))
        fusions.append(loop.step())
    return fusions[0]


def happened(fusion: Fusion) -> list[str]:
    return [str(event.change) for event in fusion.changes]


def test_one_miss_of_a_source_slower_than_the_loop_breaks_no_contact() -> None:
    loop = Loop()
    touched(loop)
    loop.say("skin")
    changes = []
    for _ in range(5):
        changes += happened(loop.step())
    for _ in range(20):
        if loop.is_due(0.05):
            loop.say("skin", (HERE, 0.95))
        changes += happened(loop.step())
    assert not changes


def test_a_second_cloud_of_one_stamp_that_is_empty_breaks_no_contact() -> None:
    loop = Loop()
    (contact,) = touched(loop, period=LOOP).contacts
    for _ in range(20):
        loop.say("skin", (HERE, 0.95)).say("skin")
        assert [c.track for c in loop.step().contacts] == [contact.track]
        assert [c.track for c in loop.step().contacts] == [contact.track]
        loop.say("skin", (HERE, 0.95))
        assert [c.track for c in loop.step().contacts] == [contact.track]


def test_a_contact_that_was_missed_ends_when_its_source_falls_silent() -> None:
    loop = Loop()
    touched(loop)
    loop.say("skin")
    kept = [bool(loop.step().contacts) for _ in range(150)]
    assert kept[0] and not kept[-1]
    assert kept.index(False) == pytest.approx(100, abs=30)


@pytest.mark.parametrize("speed", [0.1, 0.15])
def test_a_contact_that_slides_is_one_by_a_fast_skin_and_a_slow_camera(speed: float) -> None:
    loop, seen, numbers = Loop(), list[int](), set[int]()
    for _ in range(500):
        place = (speed * loop.now, 0.0, 0.0)
        loop.say("skin", (place, 0.95))
        if loop.is_due(SLOW):
            loop.say("camera", (place, 0.9))
        contacts = loop.step().contacts
        seen.append(len(contacts))
        numbers |= {contact.track for contact in contacts}
    assert {*seen} == {1} and numbers == {1}


def test_a_wrong_cloud_beside_a_faster_source_makes_no_contact() -> None:
    loop = Loop()
    for _ in range(100):
        assert not loop.say("skin").say("camera").step().contacts
    loop.say("camera", ((0.1, 0.0, 0.0), 0.95), (HERE, 0.95)).say("skin", (HERE, 0.05))
    assert not loop.step().contacts
    for _ in range(15):  # what the camera said of another place is not news of a contact there
        assert not loop.say("skin", ((0.1, 0.0, 0.0), 0.05)).step().contacts


def test_a_leftover_of_a_slow_source_makes_no_contact_of_its_own() -> None:
    loop = Loop()
    for _ in range(100):
        loop.say("skin").say("camera").step()
    near = ((0.006, 0.0, 0.0), 0.8)
    loop.say("camera", near, replace=False).say("skin", (HERE, 0.9)).step()
    loop.say("skin", (HERE, 0.9)).step()
    for step in range(30):
        loop.say("skin", ((0.002 * step, 0.0, 0.0), 0.9))
        assert len(loop.step().contacts) <= 1


def test_a_contact_of_a_slow_source_slides_and_keeps_its_number() -> None:
    loop, numbers = Loop(), set[int]()
    for _ in range(500):
        if loop.is_due(0.1):
            loop.say("skin", ((0.2 * loop.now, 0.0, 0.0), 0.95))
        numbers |= {contact.track for contact in loop.step().contacts}
    assert numbers == {1}


def test_the_mean_of_a_slow_source_is_of_the_last_fifth_of_a_second() -> None:
    loop, places = Loop(timeout=2.0), [0.0]
    for _ in range(600):
        if loop.is_due(0.5):
            places.append(0.002 * loop.now)
            loop.say("skin", ((places[-1], 0.0, 0.0), 0.95))
        (contact,) = loop.step().contacts
        assert contact.position[0] == pytest.approx(places[-1], abs=2e-4)


def test_what_was_said_once_is_counted_once_beside_a_faster_source() -> None:
    loop = Loop()
    for _ in range(100):
        loop.say("skin").say("camera").step()
    loop.say("camera", (HERE, 0.95))
    believed = []
    for _ in range(19):
        loop.say("skin", (HERE, 0.05))
        contacts = loop.step().contacts
        believed.append(contacts[0].likelihood if contacts else 0.0)
    assert max(believed) < 0.6


@pytest.mark.parametrize("period", [0.01, 0.02, 0.05, 0.1])
@pytest.mark.parametrize(("p", "sensitivity"), [(0.9, 0.95), (0.6, 0.9)])
def test_silence_speaks_against_each_news_of_a_faster_source(
    period: float, p: float, sensitivity: float
) -> None:
    loop = Loop()
    for _ in range(300):
        if loop.is_due(period):
            loop.say("wrist", sensitivity=sensitivity)
        assert not loop.say("skin", (HERE, p)).step().contacts


@pytest.mark.parametrize("period", [0.01, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("p", [0.6, 0.9])
def test_a_stuck_taxel_falls_by_a_wrench_slower_than_the_skin(period: float, p: float) -> None:
    loop, force = Loop(timeout=0.5), np.array([0.0, 0.0, -5.0])
    line = (HERE, 0.45), ((0.0, 0.0, 0.01), 0.45)
    measured = Resultant(force, np.zeros(3), np.zeros(3), 0.1, 0.005)
    for _ in range(100):
        if loop.is_due(period):
            forces = np.tile(force, (2, 1))
            loop.say("wrist", *line, single=True, forces=forces, resultant=measured)
        contacts = loop.say("skin", (HERE, 0.95), ((0.06, 0.0, 0.0), p)).step().contacts
        assert [contact.position[0] < 0.01 for contact in contacts] == [True]


@pytest.mark.parametrize("given", [(0.45, 0.45), (0.55, 0.55), (0.3, 0.3, 0.3)])
def test_sources_that_report_in_turn_make_a_contact_together(given: tuple[float, ...]) -> None:
    def made_after(phase: int) -> int:
        loop = Loop()
        for step in range(200):
            for number, p in enumerate(given):
                if step % 3 == phase * number:
                    said = ((HERE, p),) if step >= 51 else ()
                    loop.say(f"source_{number}", *said)
            if loop.step().contacts:
                return step - 51
        return 200

    assert made_after(0) <= made_after(1) <= 3 * made_after(0) + 5 < 100


@pytest.mark.parametrize(("period", "p"), [(0.05, 0.3), (0.1, 0.8), (0.4, 0.6), (0.4, 0.3)])
def test_a_contact_that_ends_ends_as_soon_as_its_slower_source_says_so(
    period: float, p: float
) -> None:
    loop, contacts = Loop(timeout=0.5), []
    for step in range(240):
        said = step < 121
        if loop.is_due(period):
            loop.say("slow", *[(HERE, p)] * said)
        contacts.append(len(loop.say("fast", *[(HERE, 0.9)] * said).step().contacts))
    assert contacts[120] == 1
    assert contacts[121:].index(0) <= round(period / LOOP)


def test_a_firm_moment_makes_no_light_touch_flicker() -> None:
    def broken(first: float) -> int:
        rng, loop, changes = np.random.default_rng(7), Loop(), list[str]()
        for step in range(600):
            said = [(HERE, first if step < 3 else 0.7)] * int(step < 3 or rng.random() > 0.25)
            changes += happened(loop.say("skin", *said).step())
        return changes.count("broken")

    assert broken(0.99) <= broken(0.7) + 1


@pytest.mark.parametrize("wrong", [0.0125, 0.0155])
def test_a_wrong_cloud_within_reach_moves_no_contact_of_a_slower_source(wrong: float) -> None:
    assert steady((((wrong, 0.0, 0.0), 0.9),)) == ["made"]


def test_clouds_of_a_single_contact_of_one_stamp_are_one_in_whichever_step_they_arrive() -> None:
    loop = Loop(period=0.1)
    halves = [((0.0, 0.0, 0.0), 0.45)], [((0.01, 0.0, 0.0), 0.45)]
    loop.say("wrist", *halves[0], single=True, replace=False, stamp=0.0).step()
    (contact,) = (
        loop.say("wrist", *halves[1], single=True, replace=False, stamp=0.0).step().alone.contacts
    )
    assert contact.likelihood == pytest.approx(0.9, abs=0.01)


def test_a_note_before_it_is_unplugged_keeps_no_belief_of_a_source() -> None:
    loop = Loop()
    for _ in range(100):
        if loop.is_due(SLOW):
            loop.say("skin", (HERE, 0.2))
        loop.say("camera", (HERE, 0.95)).step()
    loop.say("camera", notes=("unhealthy",)).say("skin", (HERE, 0.2)).step()
    loop.integrator.unplug("camera")
    for _ in range(3):
        assert not loop.step().contacts


@pytest.mark.parametrize(("threshold", "p"), [(0.1, 0.35), (0.3, 0.45)])
def test_a_contact_under_a_low_threshold_ends(threshold: float, p: float) -> None:
    loop = Loop(period=SLOW, threshold=threshold)
    assert touched(loop, steps=10, p=p, period=SLOW).contacts
    for _ in range(100):
        loop.say("skin").step()
    assert not loop.say("skin").step().contacts


def test_time_alone_makes_no_contact() -> None:
    loop = Loop(threshold=0.3, timeout=10.0)
    for _ in range(100):
        loop.say("skin").step()
    assert not loop.say("skin", (HERE, 0.9)).step().contacts
    for _ in range(500):
        assert not loop.step().contacts


def test_a_contact_that_fades_ends_as_soon_as_one_that_stops() -> None:
    def steps(*fading: float) -> int:
        loop = Loop(period=0.05)
        touched(loop)
        for p in fading:
            loop.say("skin", (HERE, p)).step()
        ends = [bool(loop.say("skin").step().contacts) for _ in range(20)]
        return ends.index(False)

    assert steps(0.2) <= steps() <= 2


def test_what_an_unplugged_source_said_no_longer_counts() -> None:
    loop = Loop(threshold=0.1)
    for _ in range(20):
        loop.say("camera", (HERE, 0.95)).say("skin", (HERE, 0.2)).step()
    loop.integrator.unplug("camera")
    fusion = loop.say("skin", (HERE, 0.2)).step()
    assert all(contact.likelihood <= 0.2 for contact in fusion.contacts)


def test_what_a_source_said_that_fell_silent_no_longer_counts() -> None:
    loop = Loop()
    for _ in range(20):
        loop.say("camera", (HERE, 0.95)).say("skin", (HERE, 0.2)).step()
    for _ in range(120):
        loop.say("skin", (HERE, 0.2)).step()
    assert not loop.say("skin", (HERE, 0.2)).step().contacts


def test_a_source_that_cannot_tell_for_a_moment_takes_nothing_from_a_contact_of_others() -> None:
    loop = Loop()
    for step in range(40):
        if step % 10 == 9:
            loop.say("wrist", notes=("several contacts",))
        else:
            loop.say("wrist", (HERE, 0.9))
        (contact,) = loop.say("skin", (HERE, 0.6)).step().contacts
        assert contact.track == 1 and (step < 9 or contact.likelihood > 0.99)


def test_a_newer_cloud_of_a_single_contact_replaces_the_one_before() -> None:
    loop, believed = Loop(period=0.1, threshold=0.1), []
    for step in range(9):
        loop.say("wrist", ((0.01 * step, 0.0, 0.0), 0.15), single=True, replace=False)
        believed += [contact.likelihood for contact in loop.step().contacts]
    assert max(believed) < 0.5


def test_a_source_that_measures_a_resultant_has_found_something() -> None:
    loop = Loop()
    loop.say("skin", (HERE, 0.8))
    force = Resultant(np.array([0.0, 0.0, -5.0]), np.zeros(3), np.zeros(3), 0.1, 0.01)
    loop.say("wrist", sensitivity=0.9, resultant=force)
    (contact,) = loop.step().contacts
    assert contact.likelihood == pytest.approx(0.8)


def test_a_note_on_a_cloud_of_zeros_says_that_its_source_could_not_tell() -> None:
    loop = Loop()
    for _ in range(100):
        loop.say("skin", (HERE, 0.0), notes=("unhealthy",)).step()
    assert len(loop.say("skin", (HERE, 0.8)).step().contacts) == 1


def test_neighbours_that_slide_together_keep_their_numbers() -> None:
    loop, numbers = Loop(period=0.05), set[tuple[int, ...]]()
    for step in range(12):
        first, second = ((0.011 * step, 0.0, 0.0), 0.95), ((0.011 * step + 0.02, 0.0, 0.0), 0.95)
        contacts = loop.say("skin", first, second).step().contacts
        by_place = sorted(contacts, key=lambda contact: contact.position[0])
        numbers.add(tuple(contact.track for contact in by_place))
    assert len(numbers) == 1


def steady(wrong: Said, *, replace: bool = True) -> list[str]:
    """What happens where a camera sees one contact five times a second, and a skin errs once."""
    loop, changes = Loop(timeout=0.5), []
    for step in range(200):
        if loop.is_due(SLOW):
            loop.say("camera", (HERE, 0.95), replace=replace)
        loop.say("skin", *(wrong if step == 115 else ()), replace=replace)
        changes += happened(loop.step())
    return changes


@pytest.mark.parametrize("away", [0.025, 0.035, 0.045])
@pytest.mark.parametrize("replace", [True, False])
def test_a_wrong_cloud_takes_no_contact_from_a_slower_source(away: float, replace: bool) -> None:
    assert steady((((away, 0.0, 0.0), 0.9),), replace=replace) == ["made"]


def test_a_second_contact_by_a_faster_source_gets_a_number_of_its_own() -> None:
    loop, numbers = Loop(timeout=0.5), {"here": set[int](), "there": set[int]()}
    for step in range(200):
        if loop.is_due(SLOW):
            loop.say("camera", (HERE, 0.95))
        loop.say("skin", *[((0.03, 0.0, 0.0), 0.9)] * (step >= 115))
        for contact in loop.step().contacts:
            numbers["here" if contact.position[0] < 0.01 else "there"].add(contact.track)
    assert numbers == {"here": {1}, "there": {2}}


def test_what_a_source_keeps_is_no_news_where_it_says_something_else() -> None:
    loop, moved = Loop(timeout=0.5), []
    for step in range(260):
        place = [(HERE, 0.95)] * (step < 150) + [((0.07, 0.0, 0.0), 0.95)] * (step == 180)
        moved += happened(loop.say("skin", *place, replace=False).step())
    assert moved == ["made", "broken"]


@pytest.mark.parametrize("apart", [0.015, 0.018])
def test_contacts_that_stand_still_keep_their_numbers_where_another_ends(apart: float) -> None:
    loop = Loop()
    numbers = list[dict[int, int]]()
    for step in range(60):
        places = [apart * (number + (step >= 50)) for number in range(3)]
        fusion = loop.say("skin", *[((x, 0.0, 0.0), 0.95) for x in places]).step()
        numbers.append({round(c.position[0] / apart): c.track for c in fusion.contacts})
    before, after = numbers[49], numbers[-1]
    assert (after[1], after[2]) == (before[1], before[2]) and after[3] == 4


@pytest.mark.parametrize(("period", "speed"), [(0.1, 0.15), (0.1, 0.1), (0.2, 0.1)])
def test_what_a_slower_source_said_is_no_contact_of_its_own(period: float, speed: float) -> None:
    loop, seen = Loop(period, timeout=0.5), set[tuple[int, ...]]()
    for _ in range(80):
        place = ((speed * loop.now, 0.0, 0.0), 0.95)
        if loop.is_due(0.4):
            loop.say("skin", place)
        contacts = loop.say("camera", place).step().contacts
        seen.add(tuple(contact.track for contact in contacts))
    assert seen == {(1,)}


def test_two_steps_at_one_time_keep_a_contact() -> None:
    loop = Loop()
    touched(loop, period=LOOP)
    for _ in range(5):
        assert [c.track for c in loop.say("skin", (HERE, 0.95)).step().contacts] == [1]
        loop.steps -= 1
        assert [c.track for c in loop.step().contacts] == [1]


def test_a_source_that_said_little_takes_no_belief_with_it() -> None:
    loop, believed = Loop(timeout=0.5), []
    loop.say("camera", (HERE, 0.12))
    for _ in range(100):
        if loop.is_due(0.02):
            loop.say("skin", (HERE, 0.7))
        believed += [contact.likelihood for contact in loop.step().contacts]
    assert min(believed[40:]) > 0.95


def test_what_stands_by_does_not_move_a_contact_when_another_source_withdraws() -> None:
    loop, positions = Loop(), []
    for _ in range(216):
        place = ((0.1 * loop.now, 0.0, 0.0), 0.95)
        if loop.is_due(SLOW):
            loop.say("skin", place)
        positions += [c.position[0] for c in loop.say("camera", place).step().contacts]
    for _ in range(4):
        positions += [c.position[0] for c in loop.say("camera").step().contacts]
    assert len(positions) == 220
    assert (np.diff(positions) >= -1e-9).all()


@pytest.mark.parametrize("threshold", [0.1, 0.3])
def test_time_beside_a_faint_report_makes_no_contact(threshold: float) -> None:
    loop = Loop(threshold=threshold)
    for _ in range(100):
        loop.say("skin").say("camera").step()
    loop.say("camera", (HERE, 0.6))
    for _ in range(80):
        assert not loop.say("skin", (HERE, 0.05)).step().contacts


def test_an_empty_cloud_replaces_one_of_a_single_contact() -> None:
    loop, believed = Loop(period=0.1, threshold=0.1), []
    for step in range(9):
        loop.say("wrist", ((0.02 * step, 0.0, 0.0), 0.3), single=True, replace=False)
        believed += [contact.likelihood for contact in loop.step().contacts]
        believed += [c.likelihood for c in loop.say("wrist", replace=False).step().contacts]
    assert max(believed) < 0.5


HASHED = """
import numpy as np
from contactfusion import HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
integrator = Integrator(IntegratorConfig(frame="hand", threshold=0.01))
for number in range(6):
    integrator.plug(f"source_{number}", replace=True)
for step in range(200):
    for number in range(6):  # five end a contact by which a slower one stands
        if step % 7 == 0 or number:
            count = int(step % 40 < 25)
            integrator.receive(
                HypothesisCloud(
                    f"source_{number}", HypothesisKind.REGULAR, 0.01 * step, "hand",
                    np.zeros((count, 3)), np.full(count, 0.21 + 0.07 * number),
                    spreads=np.full(count, 0.004),
                )
            )
    for contact in integrator.step(0.01 * step).contacts:
        print(contact.track, contact.likelihood.hex(), contact.position.tobytes().hex())
"""


def test_bytes_do_not_hang_on_the_hashes_of_names() -> None:
    def printed(seed: str) -> bytes:
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", HASHED]
        return subprocess.run(command, env=environment, check=True, capture_output=True).stdout

    first, *others = (printed(str(seed)) for seed in range(4))
    assert first and others == 3 * [first]


def test_a_line_that_two_touches_share_is_withdrawn_from_neither() -> None:
    loop = Loop(period=0.1)
    along = np.arange(-0.16, 0.165, 0.005)
    for step in range(100):
        if loop.is_due(0.2):
            loop.say("skin", ((0.0, -0.15, 0.0), 0.95), ((0.0, 0.15, 0.0), 0.95))
        surest = along if step // 3 % 2 else -along  # takes the touch at its end
        line = [((0.0, y, 0.0), 0.9 + 0.3 * end) for y, end in zip(along, surest, strict=True)]
        fusion = loop.say("lidar", *line).step()
        assert {contact.track for contact in fusion.contacts} == {1, 2}
        assert min(contact.likelihood for contact in fusion.contacts) > 0.8
