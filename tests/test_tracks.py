"""Contacts over time, with nothing set: identity, belief, and what happens to them."""

import math
from typing import Any

import numpy as np
import pytest

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.frames import pose_at
from contactfusion.rule import Neighbourhood
from contactfusion.surface import RigidPart, Surface

CYCLE = 0.05
HERE, THERE = (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)


class Stepped:
    """An integrator that is stepped cycle by cycle; sources replace what they said."""

    def __init__(self, cycle: float = CYCLE, **config: Any) -> None:
        self.integrator = Integrator(IntegratorConfig(**{"frame": "hand", **config}))
        self.cycle, self.now = cycle, 0.0

    def step(
        self,
        *said: tuple[tuple[float, float, float], float],
        surface: Surface | None = None,
        notes: tuple[str, ...] = (),
    ) -> Fusion:
        """One cycle, in which a skin gives places [m] and likelihoods."""
        self.now += self.cycle
        positions = np.reshape([place for place, _ in said], (-1, 3))
        likelihoods = np.array([p for _, p in said], np.float64)
        spreads = np.full(len(said), 0.004)
        self.integrator.plug("skin", HypothesisKind.REGULAR, replace=True)
        cloud = HypothesisCloud(
            "skin", HypothesisKind.REGULAR, self.now, "hand", positions, likelihoods,
            spreads=spreads, notes=notes,
        )  # fmt: skip
        self.integrator.receive(cloud)
        return self.integrator.step(self.now, surface)

    def wait(self, seconds: float) -> Fusion:
        """A step without new clouds."""
        self.now += seconds
        return self.integrator.step(self.now)


def settled() -> Stepped:
    """A loop in which nothing has been felt for half a second."""
    stepped = Stepped()
    for _ in range(10):
        stepped.step()
    return stepped


def made(fusion: Fusion) -> list[tuple[str, int]]:
    """What happened, and to which contact."""
    return [(str(event.change), event.contact.track) for event in fusion.changes]


# Whether


def test_the_first_step_reports_what_it_is_told() -> None:
    fusion = Stepped().step((HERE, 0.8))
    (contact,) = fusion.contacts
    assert contact.likelihood == pytest.approx(0.8)
    assert (contact.track, contact.since) == (1, CYCLE)
    assert made(fusion) == [("made", 1)]
    assert str(fusion.changes[0]) == f"0.050 s: track 1 made, {contact}"


def test_one_wrong_step_makes_no_contact_and_two_do() -> None:
    stepped = settled()
    assert not stepped.step((HERE, 0.95)).contacts
    assert not stepped.step().contacts
    stepped = settled()
    stepped.step((HERE, 0.95))
    fusion = stepped.step((HERE, 0.95))
    assert len(fusion.contacts) == 1 and made(fusion) == [("made", 1)]


def test_sources_that_agree_make_a_contact_in_one_step() -> None:
    stepped = settled()
    positions, likelihoods = np.zeros((1, 3)), np.array([0.9])
    for name in ("camera", "wrist"):
        cloud = HypothesisCloud(
            name, HypothesisKind.REGULAR, stepped.now + CYCLE, "hand", positions, likelihoods
        )
        stepped.integrator.receive(cloud)
    assert len(stepped.step((HERE, 0.9)).contacts) == 1


def test_one_missed_step_breaks_no_contact_and_two_do() -> None:
    stepped = settled()
    for _ in range(5):
        stepped.step((HERE, 0.95))
    (contact,) = stepped.step().contacts
    assert contact.track == 1
    stepped.step((HERE, 0.95))
    stepped.step()
    fusion = stepped.step()
    assert not fusion.contacts and made(fusion) == [("broken", 1)]


def test_ten_unsure_steps_are_surer_than_one() -> None:
    stepped = settled()
    reported = [stepped.step((HERE, 0.7)).contacts for _ in range(10)]
    assert not reported[0] and reported[-1]
    assert reported[-1][0].likelihood > 0.95


def test_steps_in_which_nothing_new_is_said_change_nothing() -> None:
    stepped = settled()
    stepped.step((HERE, 0.8))
    for _ in range(50):
        assert not stepped.wait(0.001).contacts


@pytest.mark.parametrize("cycles", [1, 5])
def test_a_wrong_step_is_no_news_in_the_steps_after_it(cycles: int) -> None:
    stepped = Stepped(cycle=0.001)
    for _ in range(500):
        stepped.step()
    assert not stepped.step((HERE, 0.8)).contacts
    for _ in range(cycles):
        assert not stepped.wait(0.001).contacts


def test_of_a_source_that_keeps_what_it_said_only_a_repetition_is_news() -> None:
    integrator = Integrator(IntegratorConfig(frame="hand", timeout=1.0))
    places = [[HERE], [], [], [THERE], [], [HERE]]
    believed = []
    for step, said in enumerate(places):
        positions = np.reshape(said, (-1, 3))
        likelihoods = np.full(len(said), 0.6)
        cloud = HypothesisCloud(
            "skin", HypothesisKind.REGULAR, 0.1 * step, "hand", positions, likelihoods
        )
        integrator.receive(cloud)
        contacts = integrator.step(0.1 * step).contacts
        believed += [c.likelihood for c in contacts if c.position[0] < 0.05]
    assert believed[:5] == sorted(believed[:5], reverse=True)
    assert believed[4] < 0.6 < believed[5]


def test_what_ended_is_forgotten() -> None:
    stepped = Stepped()
    for place in range(40):
        for _ in range(3):
            stepped.step(((0.03 * place, 0.0, 0.0), 0.8))
    for _ in range(20):
        stepped.step()
    assert stepped.integrator._tracks is not None and not stepped.integrator._tracks._tracks


def test_what_one_of_two_sources_withdraws_no_longer_counts() -> None:
    stepped = Stepped(timeout=3.0)
    stepped.integrator.plug("camera", HypothesisKind.REGULAR, replace=True)
    for p in [*[()] * 10, (0.6,)]:
        cloud = HypothesisCloud(
            "camera", HypothesisKind.REGULAR, stepped.now + CYCLE, "hand", np.zeros((len(p), 3)),
            np.array(p, np.float64), spreads=np.full(len(p), 0.006),
        )  # fmt: skip
        stepped.integrator.receive(cloud)
        assert not stepped.step().contacts
    (wrong,) = stepped.step(((0.009, 0.0, 0.0), 0.95)).contacts
    assert wrong.likelihood > 0.7
    assert made(stepped.step()) == [("broken", 1)]


@pytest.mark.parametrize("cycle", [1.0, 10.0])
def test_a_slow_loop_believes_what_it_is_told(cycle: float) -> None:
    stepped = Stepped(cycle)
    stepped.step()
    assert len(stepped.step((HERE, 0.8)).contacts) == 1
    assert not stepped.step().contacts


def test_a_contact_ends_when_what_was_said_of_it_is_too_old() -> None:
    stepped = Stepped(timeout=0.2)
    stepped.step((HERE, 0.9))
    assert stepped.wait(0.15).contacts
    fusion = stepped.wait(0.1)
    assert not fusion.contacts and made(fusion) == [("broken", 1)]


def test_a_contact_whose_source_cannot_tell_lasts_as_long_as_by_a_silent_one() -> None:
    def lasts(stepped: Stepped, notes: tuple[str, ...]) -> int:
        for _ in range(3):
            stepped.step((HERE, 0.95))
        for step in range(30):
            fusion = stepped.step(notes=notes) if notes else stepped.wait(CYCLE)
            if not fusion.contacts:
                assert made(fusion) == [("broken", 1)]
                return step
        return 30

    assert lasts(settled(), ("unhealthy",)) == lasts(settled(), ()) == 10


def test_a_source_that_could_not_tell_for_long_is_believed_at_once() -> None:
    stepped = settled()
    for _ in range(40):
        stepped.step(notes=("unhealthy",))
    assert len(stepped.step((HERE, 0.8)).contacts) == 1


def test_why_a_single_step_makes_no_contact_is_explained() -> None:
    stepped = settled()
    fusion = stepped.step((HERE, 0.95))
    around = Neighbourhood(np.zeros(3), 0.02, np.ones(1, np.bool_), 0)
    (reason,) = fusion.condensation.objections(fusion.field, np.empty(0, np.uint8), around)
    assert reason.sentence == (
        "P(contact) 0.95 by skin 0.95, but one step alone makes no contact after others without it"
    )
    for _ in range(3):
        fusion = stepped.step((HERE, 0.8))
    (contact,) = fusion.contacts
    told = fusion.condensation.explain(fusion.field, around, contact)
    assert told == (
        f"P(contact) {contact.likelihood:.2f} over time; of this step P(contact) 0.80 by skin 0.80"
    )


# Which


def test_a_contact_keeps_its_number_and_a_new_one_gets_another() -> None:
    stepped = Stepped()
    stepped.step((HERE, 0.9), (THERE, 0.8))
    fusion = stepped.step((HERE, 0.8), (THERE, 0.9))
    numbers = {round(c.position[0], 2): c.track for c in fusion.contacts}
    assert numbers == {0.0: 1, 0.1: 2}
    for _ in range(5):
        stepped.step((THERE, 0.9))
    for _ in range(5):
        fusion = stepped.step((HERE, 0.9), (THERE, 0.9))
    assert {round(c.position[0], 2): c.track for c in fusion.contacts} == {0.0: 3, 0.1: 2}
    assert {c.track: round(c.since, 2) for c in fusion.contacts}[2] == CYCLE


def test_an_improbable_contact_takes_no_number_from_a_probable_one() -> None:
    stepped = Stepped()
    stepped.step((HERE, 0.9))
    (contact,) = stepped.step((HERE, 0.3), ((0.02, 0.0, 0.0), 0.9)).contacts
    assert contact.track == 1 and contact.position[0] > 0.009


def test_a_contact_keeps_its_number_where_another_one_has_ended() -> None:
    stepped = settled()
    for _ in range(10):
        stepped.step(((0.04, 0.0, 0.0), 0.8))
    for _ in range(40):
        stepped.step()
    happened = []
    for step in range(60):
        happened += made(stepped.step(((0.001 * step, 0.0, 0.0), 0.9)))
    assert happened[0] == ("made", 2) and {*happened[1:]} == {("moved", 2)}


def test_a_contact_that_slides_away_has_moved() -> None:
    stepped, happened = Stepped(), []
    for step in range(20):
        happened += made(stepped.step(((0.002 * step, 0.0, 0.0), 0.9)))
    assert happened == [("made", 1), ("moved", 1), ("moved", 1)]


def test_a_contact_that_slides_over_a_surface_that_is_built_anew_has_moved() -> None:
    stepped, happened = Stepped(), []
    for step in range(20):
        surface = Surface("hand", ALONG, FINGER.normals)
        fusion = stepped.step(((0.002 * step, 0.0, 0.0), 0.9), surface=surface)
        happened += made(fusion)
    assert happened[0] == ("made", 1) and {*happened[1:]} == {("moved", 1)}


def test_noise_of_a_contact_at_rest_is_averaged() -> None:
    rng, stepped, alone = np.random.default_rng(7), Stepped(0.01), []
    errors = []
    for _ in range(200):
        x, y, _ = (rng.normal(0.0, 0.0015, 3)).tolist()
        (contact,) = stepped.step(((x, y, 0.0), 0.9)).contacts
        alone.append(math.hypot(x, y))
        errors.append(float(np.linalg.norm(contact.position[:2])))
    assert np.mean(errors[50:]) < 0.5 * np.mean(alone[50:])


ALONG = np.linspace(0.0, 0.1, 51)[:, None] * (1.0, 0.0, 0.0)
FINGER = RigidPart(ALONG, np.tile([0.0, 1.0, 0.0], (51, 1)), np.zeros(51, np.int32))
"""A straight finger along x, the same part in every step."""


def finger(angle: float) -> Surface:
    """The finger, turned around z."""
    pose = pose_at((0.0, 0.0, 0.0), (0.0, 0.0, angle))
    return Surface.of_parts("hand", [(FINGER, pose)], ["finger"])


def test_a_contact_moves_with_its_link() -> None:
    stepped = Stepped()
    for step in range(30):
        angle = 0.05 * step
        tip = (0.08 * math.cos(angle), 0.08 * math.sin(angle), 0.0)
        fusion = stepped.step((tip, 0.95), surface=finger(angle))
        assert [c.track for c in fusion.contacts] == [1]
        assert made(fusion) == ([("made", 1)] if step == 0 else [])
    missed = stepped.step(surface=finger(1.5))
    (contact,) = missed.contacts
    there = (0.08 * math.cos(1.5), 0.08 * math.sin(1.5), 0.0)
    np.testing.assert_allclose(contact.position, there, atol=0.002)


def test_a_contact_of_a_slow_source_moves_with_its_link_in_between() -> None:
    stepped, numbers = Stepped(cycle=0.01), set[int]()
    stepped.integrator.plug("slow", HypothesisKind.REGULAR, replace=True)
    for step in range(100):
        angle = 0.025 * step
        tip = (0.08 * math.cos(angle), 0.08 * math.sin(angle), 0.0)
        now = stepped.now + stepped.cycle
        if step % 10 == 0:
            cloud = HypothesisCloud(
                "slow", HypothesisKind.REGULAR, now, "hand", np.array([tip]), np.array([0.95]),
                spreads=np.full(1, 0.004),
            )  # fmt: skip
            stepped.integrator.receive(cloud)
        (contact,) = stepped.step(surface=finger(angle)).contacts
        numbers.add(contact.track)
        np.testing.assert_allclose(contact.position, tip, atol=0.005)
        np.testing.assert_allclose(contact.extent.mean(axis=0), contact.position, atol=0.003)
    assert numbers == {1}


def test_reset_begins_again() -> None:
    stepped = settled()
    for _ in range(3):
        stepped.step((HERE, 0.95))
    stepped.integrator.reset()
    stepped.now = 0.0
    (contact,) = stepped.step((HERE, 0.8)).contacts
    assert contact.track == 1 and contact.likelihood == pytest.approx(0.8)


def test_equal_steps_give_equal_contacts() -> None:
    def run() -> list[tuple[float, ...]]:
        rng, stepped, rows = np.random.default_rng(3), Stepped(), []
        for _ in range(40):
            places = rng.uniform(-0.05, 0.05, (int(rng.integers(0, 4)), 3))
            said = [((x, y, z), float(rng.uniform(0.1, 0.95))) for x, y, z in places.tolist()]
            for contact in stepped.step(*said).contacts:
                rows.append((contact.track, contact.likelihood, *contact.position))
        return rows

    assert run() == run() != []
