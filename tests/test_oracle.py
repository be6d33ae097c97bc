"""The oracle gives what a hand computes, the integrator what the oracle gives."""

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.errors import ContactFusionError, FrameError, SourceError, TimeError
from tests.clouds import law
from tests.oracle import ExpectedFusion, Oracle, Refused, Voxel
from tests.scenarios import Scenario, Step, scenario
from tests.soak import RARE, differences, live, live_seed, main, reconciled

REGULAR, SUPPORT, NULL = HypothesisKind.REGULAR, HypothesisKind.SUPPORT, HypothesisKind.NULL
HERE: Voxel = (0, 0, 0)


def config(**fields: Any) -> IntegratorConfig:
    return law(**{"voxel_size": 1.0, "rule": "de_morgan", **fields})


def cloud(
    source: str,
    stamp: float,
    likelihoods: Mapping[Voxel, float] | Sequence[tuple[Voxel, float]],
    *,
    kind: HypothesisKind = REGULAR,
    forces: Sequence[Sequence[float]] | None = None,
    frame: str = "base",
) -> HypothesisCloud:
    """Give a cloud with its hypotheses at the centres of voxels of side 1 m."""
    rows = list(likelihoods.items()) if isinstance(likelihoods, Mapping) else list(likelihoods)
    positions = np.array([voxel for voxel, _ in rows], dtype=float).reshape(-1, 3) + 0.5
    return HypothesisCloud(
        source=source,
        kind=kind,
        stamp=stamp,
        frame=frame,
        positions=positions,
        likelihoods=np.array([p for _, p in rows]),
        forces=None if forces is None else np.array(forces, dtype=float),
    )


def fused(
    *clouds: HypothesisCloud, now: float = 0.0, law: IntegratorConfig | None = None
) -> ExpectedFusion:
    oracle = Oracle(law or config())
    for one in clouds:
        oracle.receive(one)
    return oracle.step(now)


def likelihoods(fusion: ExpectedFusion) -> dict[Voxel, float]:
    return {row.voxel: row.likelihood for row in fusion.rows}


def verdicts(fusion: ExpectedFusion) -> dict[Voxel, str]:
    return {row.voxel: row.verdict for row in fusion.rows}


# The integrator against the oracle


lived = cache(live_seed)


@pytest.mark.parametrize("seeds", [range(n, n + 10) for n in range(0, 100, 10)], ids=str)
def test_the_integrator_gives_what_the_oracle_gives(seeds: range) -> None:
    assert [found for seed in seeds for found in lived(seed).differences] == []


@pytest.mark.parametrize("neighbour", [(1, 0, 0), (0, 1, 0), (0, 0, 1)])
def test_a_tolerance_below_a_side_joins_no_voxels(neighbour: Voxel) -> None:
    law = config(tolerance=0.5)
    two = cloud("skin", 0.0, {HERE: 0.5, neighbour: 0.5})
    integrator = Integrator(law)
    integrator.receive(two)
    expected = fused(two, law=law)
    assert len(expected.contacts) == 2
    assert list(differences(expected, integrator.step(0.0))) == []


# The comparison can fail


def both() -> tuple[ExpectedFusion, Fusion]:
    """Give a step with all verdicts, two contacts, forces, and a source without entries."""
    oracle, integrator = Oracle(config()), Integrator(config())
    clouds = (
        cloud("skin", 0.0, {HERE: 0.5, (1, 0, 0): 0.3}, forces=[[1, 2, 3], [3, 2, 1]]),
        cloud("wrist", 0.0, {HERE: 0.4, (9, 0, 0): 0.8, (9, 9, 9): 0.01}),
        cloud("motion", 0.0, {(5, 5, 5): 0.3}, kind=SUPPORT),
        cloud("skin/free", 0.0, {(20, 0, 0): 1.0}, kind=NULL),
        cloud("range", 0.0, {}),
    )
    for one in clouds:
        oracle.receive(one)
        integrator.receive(one)
    return oracle.step(0.0), integrator.step(0.0)


def with_rows(expected: ExpectedFusion, **fields: Any) -> ExpectedFusion:
    return altered(expected, rows=[replace(expected.rows[0], **fields), *expected.rows[1:]])


def with_contact(expected: ExpectedFusion, **fields: Any) -> ExpectedFusion:
    first, *others = expected.contacts
    return altered(expected, contacts=[replace(first, **fields), *others])


def altered(expected: ExpectedFusion, **fields: object) -> ExpectedFusion:
    copy = replace(expected)
    for name, value in fields.items():
        object.__setattr__(copy, name, value)
    return copy


def test_equal_results_do_not_differ() -> None:
    assert list(differences(*both())) == []


@pytest.mark.parametrize(
    "change",
    [
        lambda e: with_rows(e, likelihood=e.rows[0].likelihood + 2e-6),
        lambda e: with_rows(e, verdict="below_threshold"),
        lambda e: with_rows(e, voxel=(0, 0, 1)),
        lambda e: with_rows(e, likelihoods={"skin": 0.5, "wrist": 0.4}),
        lambda e: with_rows(e, likelihoods={"skin": 0.5}),
        lambda e: with_rows(e, force=(1.0, 2.0, 3.1)),
        lambda e: with_rows(e, force=None),
        lambda e: altered(e, rows=e.rows[1:]),
        lambda e: altered(e, kinds={"skin": REGULAR}),
        lambda e: altered(e, contacts=e.contacts[1:]),
        lambda e: altered(e, contacts=e.contacts[::-1]),
        lambda e: with_contact(e, position=(0.0, 0.0, 1e-6)),
        lambda e: with_contact(e, likelihood=e.contacts[0].likelihood - 2e-6),
        lambda e: with_contact(e, dispersion=e.contacts[0].dispersion + 1e-5),
        lambda e: with_contact(e, covariance=((1.0, 0.0, 0.0),) * 3),
        lambda e: with_contact(e, extent=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))),
        lambda e: with_contact(e, force=(0.0, 0.0, 0.0)),
        lambda e: with_contact(e, voxels=7),
        lambda e: with_contact(e, shares={"skin": 1.0}),
        lambda e: with_contact(e, stamp=1),
        lambda e: altered(e, sources={**e.sources, "skin": replace(e.sources["skin"], late=1)}),
        lambda e: altered(e, sources={**e.sources, "skin": replace(e.sources["skin"], early=1)}),
        lambda e: altered(e, sources={**e.sources, "skin": replace(e.sources["skin"], invalid=1)}),
        lambda e: altered(e, sources={**e.sources, "skin": replace(e.sources["skin"], accepted=0)}),
        lambda e: altered(
            e, sources={**e.sources, "range": replace(e.sources["range"], active=False)}
        ),
        lambda e: altered(e, sources={"skin": e.sources["skin"]}),
    ],
)
def test_every_altered_result_differs(
    change: Callable[[ExpectedFusion], ExpectedFusion],
) -> None:
    expected, actual = both()
    assert list(differences(change(expected), actual)) != []


class Forgetful(Integrator):
    """An integrator that loses every tenth cloud."""

    heard = 0

    def receive(self, cloud: HypothesisCloud) -> None:
        self.heard += 1
        if self.heard % 10:
            super().receive(cloud)


class Unready(Integrator):
    """An integrator that is never ready."""

    def ready(self, now: float) -> bool:
        return False


class Lenient(Integrator):
    """An integrator that refuses no cloud."""

    def receive(self, cloud: HypothesisCloud) -> None:
        try:
            super().receive(cloud)
        except ContactFusionError:
            return


class Crashing(Integrator):
    """An integrator that fails."""

    def reset(self) -> None:
        raise ZeroDivisionError


@pytest.mark.parametrize("wrong", [Forgetful, Unready, Lenient, Crashing])
def test_a_wrong_integrator_is_found_out(wrong: type[Integrator]) -> None:
    found = (live(scenario(seed), wrong).differences for seed in range(30))
    assert any(found)


def test_a_difference_names_its_seed_its_step_and_its_action() -> None:
    result = next(r for r in (live(scenario(n), Forgetful) for n in range(30)) if r.differences)
    named = re.match(r"seed (\d+), step (\d+), action (\d+)", result.differences[0])
    assert named is not None
    seed, step, action = map(int, named.groups())
    assert seed == result.seed
    assert step == sum(isinstance(one, Step) for one in scenario(seed).actions[:action])


def test_too_few_rare_cases_are_no_success(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--scenarios", "2", "--seed", "0"]) == int("too few" in capsys.readouterr().out)


def test_a_scenario_depends_on_its_seed_alone() -> None:
    def told(one: Scenario) -> list[str]:
        return [repr(action) for action in one.actions]

    assert told(scenario(7)) == told(scenario(7)) != told(scenario(8))


def test_a_scenario_has_at_least_thirty_cycles() -> None:
    for seed in range(20):
        assert sum(isinstance(action, Step) for action in scenario(seed).actions) >= 30


def test_rare_cases_come_often() -> None:
    events: Counter[str] = Counter()
    for seed in range(40):
        events.update(lived(seed).events)
    assert {name: count for name in RARE if (count := events[name]) < 20} == {}


@pytest.mark.parametrize(
    ("likelihood", "either_order"), [(0.5000005, True), (0.5000006, False), (0.500002, False)]
)
def test_only_the_edge_of_rounding_lets_contacts_change_places(
    likelihood: float, either_order: bool
) -> None:
    near, far = (fused(cloud("skin", 0.0, {v: 0.5})).contacts[0] for v in (HERE, (9, 0, 0)))
    wanted = [replace(near, likelihood=likelihood), replace(far, likelihood=0.500001)]
    integrator = Integrator(config())
    integrator.receive(cloud("skin", 0.0, {HERE: 0.5, (9, 0, 0): 0.6}))
    actual = integrator.step(0.0).contacts
    assert (reconciled(wanted, actual, 1.0) == wanted[::-1]) is either_order


# What a hand computes


def test_two_sources_that_meet_combine_by_de_morgan() -> None:
    fusion = fused(cloud("skin", 0.0, {HERE: 0.5}), cloud("wrist", 0.0, {HERE: 0.5}))
    assert likelihoods(fusion) == {HERE: 0.75}
    assert verdicts(fusion) == {HERE: "contact"}


def test_null_forbids_a_contact_and_alone_has_no_likelihood() -> None:
    fusion = fused(
        cloud("skin", 0.0, {HERE: 0.5}),
        cloud("skin/free", 0.0, {HERE: 0.1, (1, 0, 0): 1.0}, kind=NULL),
    )
    assert verdicts(fusion) == {HERE: "nulled", (1, 0, 0): "nulled"}
    assert likelihoods(fusion) == pytest.approx({HERE: 0.5, (1, 0, 0): 0.0})
    assert fusion.contacts == []


def test_support_counts_only_together_with_evidence() -> None:
    fusion = fused(
        cloud("motion", 0.0, {HERE: 0.5, (1, 0, 0): 0.5}, kind=SUPPORT),
        cloud("skin", 0.0, {HERE: 0.5}),
    )
    assert likelihoods(fusion) == {HERE: 0.75, (1, 0, 0): 0.5}
    assert verdicts(fusion) == {HERE: "contact", (1, 0, 0): "support_only"}


@pytest.mark.parametrize("threshold", [0.1, 0.3, 0.6, 0.7, 1.0])
def test_a_likelihood_at_the_threshold_is_a_contact(threshold: float) -> None:
    fusion = fused(
        cloud("skin", 0.0, {HERE: threshold, (1, 0, 0): threshold - 2e-6}),
        law=config(threshold=threshold),
    )
    assert verdicts(fusion) == {HERE: "contact", (1, 0, 0): "below_threshold"}


def test_a_voxel_holds_its_lower_face() -> None:
    places = np.array([[0.0, -0.1, 1.0], [-1e-9, 0.999, -1.0]])
    one = HypothesisCloud("skin", REGULAR, 0.0, "base", places, np.array([0.5, 0.5]))
    assert list(likelihoods(fused(one))) == [(-1, 0, -1), (0, -1, 1)]


def test_likelihoods_are_kept_as_float32() -> None:
    assert fused(cloud("skin", 0.0, {HERE: 0.1})).rows[0].likelihoods == {"skin": np.float32(0.1)}


def test_one_stamp_keeps_the_largest_likelihood_and_a_newer_one_replaces_it() -> None:
    first = cloud("skin", 0.1, [(HERE, 0.25), (HERE, 0.5)])
    same = cloud("skin", 0.1, {HERE: 0.375})
    newer = cloud("skin", 0.2, {HERE: 0.125})
    assert likelihoods(fused(first, same, now=0.2)) == {HERE: 0.5}
    assert likelihoods(fused(first, same, newer, now=0.2)) == {HERE: 0.125}


def test_zero_removes_an_older_entry_only() -> None:
    some, zero = {HERE: 0.5}, {HERE: 0.0}
    assert likelihoods(fused(cloud("skin", 0.1, some), cloud("skin", 0.1, zero), now=0.2)) == some
    assert likelihoods(fused(cloud("skin", 0.1, some), cloud("skin", 0.2, zero), now=0.2)) == {}
    assert likelihoods(fused(cloud("skin", 0.1, some), cloud("a", 0.2, zero), now=0.2)) == some


def test_a_newer_cloud_leaves_other_voxels_unless_it_replaces() -> None:
    clouds = cloud("skin", 0.1, {HERE: 0.5}), cloud("skin", 0.1, {(1, 0, 0): 0.5})
    assert list(likelihoods(fused(*clouds, now=0.1))) == [HERE, (1, 0, 0)]
    oracle = Oracle(config())
    oracle.plug("skin", kind=REGULAR, replace=True)
    for one in clouds:
        oracle.receive(one)
    assert list(likelihoods(oracle.step(0.1))) == [(1, 0, 0)]


def test_an_entry_lives_until_exactly_its_timeout() -> None:
    oracle = Oracle(config(timeout=0.3))
    oracle.plug("wrist", kind=REGULAR, timeout=0.2)
    oracle.receive(cloud("skin", 0.1, {HERE: 0.5}))
    oracle.receive(cloud("wrist", 0.1, {HERE: 0.5}))
    assert likelihoods(oracle.step(0.3)) == {HERE: 0.75}
    assert likelihoods(oracle.step(0.300000001)) == {HERE: 0.5}
    assert likelihoods(oracle.step(0.4)) == {HERE: 0.5}
    assert likelihoods(oracle.step(0.400000001)) == {}


def test_under_voxel_expiry_the_newest_entry_keeps_all_alive() -> None:
    silent, alive = cloud("skin", 0.0, {HERE: 0.5}), cloud("wrist", 0.5, {HERE: 0.5})
    for expiry, expected in (("voxel", 0.75), ("source", 0.5)):
        law = config(expiry=expiry, timeout=0.3)
        oracle = Oracle(law)
        oracle.receive(silent)
        oracle.step(0.3)
        oracle.receive(alive)
        assert likelihoods(oracle.step(0.5)) == {HERE: expected}
        assert likelihoods(oracle.step(0.9)) == {}


def test_late_clouds_are_dropped_and_early_ones_wait() -> None:
    oracle = Oracle(config(max_ahead=0.1))
    oracle.receive(cloud("skin", 0.2, {HERE: 0.5}))
    oracle.receive(cloud("skin", 0.1, {(1, 0, 0): 0.5}))
    oracle.receive(cloud("skin", 0.5, {(2, 0, 0): 0.5}))
    for now in (0.2, 0.3):
        fusion = oracle.step(now)
        assert list(likelihoods(fusion)) == [HERE]
        report = fusion.sources["skin"]
        assert (report.accepted, report.late, report.early) == (1, 1, 1)
    fusion = oracle.step(0.4)
    assert list(likelihoods(fusion)) == [HERE, (2, 0, 0)]
    assert (fusion.sources["skin"].accepted, fusion.sources["skin"].early) == (2, 1)


def test_clouds_against_the_law_are_refused_and_counted() -> None:
    oracle = Oracle(config())
    oracle.plug("skin", kind=REGULAR)
    far = 2**20
    for wrong in (
        cloud("skin", 0.0, {HERE: 0.5}, frame="tool"),
        cloud("skin", 0.0, {HERE: 0.5}, kind=NULL),
        cloud("skin", 0.0, {(0, 0, far): 0.5}),
        cloud("skin", 0.0, {(-far, 0, 0): 0.0}),
    ):
        with pytest.raises(Refused):
            oracle.receive(wrong)
    oracle.receive(cloud("skin", 0.0, {(1 - far, 0, far - 1): 0.5}))
    fusion = oracle.step(0.0)
    assert fusion.sources["skin"].invalid == 4
    assert list(likelihoods(fusion)) == [(1 - far, 0, far - 1)]


def test_unknown_sources_plug_themselves_in_unless_told_not_to() -> None:
    assert list(fused(cloud("skin", 0.0, {})).sources) == ["skin"]
    with pytest.raises(Refused) as refusal:
        fused(cloud("skin", 0.0, {}), law=config(strict_sources=True))
    assert refusal.value.reasons == (SourceError,)


def test_an_unplugged_source_leaves_nothing_and_is_refused_until_plugged() -> None:
    oracle = Oracle(config())
    oracle.receive(cloud("skin", 0.0, {HERE: 0.5}))
    oracle.step(0.0)
    oracle.receive(cloud("skin", 0.1, {(1, 0, 0): 0.5}))
    oracle.unplug("skin")
    assert oracle.step(0.1).rows == []
    with pytest.raises(Refused):
        oracle.receive(cloud("skin", 0.1, {HERE: 0.5}))
    oracle.plug("skin", kind=NULL)
    oracle.receive(cloud("skin", 0.0, {HERE: 0.5}, kind=NULL))
    assert verdicts(oracle.step(0.1)) == {HERE: "nulled"}


def test_a_source_keeps_its_kind_while_plugged() -> None:
    oracle = Oracle(config())
    oracle.plug("skin", kind=REGULAR)
    oracle.plug("skin", kind=REGULAR, replace=True)
    with pytest.raises(Refused):
        oracle.plug("skin", kind=NULL)


def test_time_runs_forward_until_reset() -> None:
    oracle = Oracle(config())
    oracle.receive(cloud("skin", 1.0, {HERE: 0.5}))
    oracle.step(1.0)
    with pytest.raises(Refused) as refusal:
        oracle.step(0.999999999)
    assert refusal.value.reasons == (TimeError,)
    oracle.reset()
    fusion = oracle.step(0.0)
    assert (fusion.rows, fusion.sources["skin"].accepted) == ([], 1)


def test_readiness_waits_for_every_active_source() -> None:
    oracle = Oracle(config(stale_after=0.5))
    oracle.plug("wrist", kind=REGULAR)
    oracle.receive(cloud("skin", 0.0, {}))
    assert not oracle.ready(0.0)
    oracle.receive(cloud("wrist", 0.0, {}))
    assert oracle.ready(0.0)
    assert all(source.active for source in oracle.step(0.0).sources.values())
    assert not oracle.ready(0.0)
    oracle.receive(cloud("skin", 0.5, {}))
    assert not oracle.ready(0.5)
    assert oracle.step(0.5).sources["wrist"].active
    oracle.receive(cloud("skin", 0.6, {}))
    assert oracle.ready(0.6)
    assert not oracle.step(0.6).sources["wrist"].active


def test_the_force_of_a_voxel_is_a_mean_of_means() -> None:
    fusion = fused(
        cloud("skin", 0.0, [(HERE, 0.25), (HERE, 0.75)], forces=[[4, 0, 0], [0, 4, 0]]),
        cloud("wrist", 0.0, {HERE: 0.25}, forces=[[0, 0, 8]]),
        cloud("range", 0.0, {HERE: 1.0}),
        cloud("motion", 0.0, {HERE: 1.0}, forces=[[9, 9, 9]], kind=SUPPORT),
    )
    # skin: (1, 3, 0) with 0.75; wrist: (0, 0, 8) with 0.25
    assert fusion.rows[0].force == (0.75, 2.25, 2.0)


def test_a_cloud_without_forces_clears_the_force() -> None:
    felt = cloud("skin", 0.0, {HERE: 0.5}, forces=[[1, 0, 0]])
    unfelt = cloud("skin", 0.0, {HERE: 0.25})
    again = cloud("skin", 0.0, {HERE: 0.25}, forces=[[0, 1, 0]])
    absent = cloud("skin", 0.0, {HERE: 0.0})
    assert fused(felt, unfelt).rows[0].force is None
    assert fused(felt, unfelt, again).rows[0].force == (0.0, 1.0, 0.0)
    assert fused(felt, absent).rows[0].force == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("side", "tolerance", "far", "contacts"),
    [
        (0.005, None, (2, 0, 0), 1),
        (0.005, None, (2, 1, 0), 2),
        (0.005, 0.010, (0, -2, 0), 1),
        (0.1, 0.3, (0, 0, 3), 1),
        (0.1, 0.1 * math.sqrt(3), (1, 1, -1), 1),
        (0.1, 0.1 * math.sqrt(3), (2, 0, 0), 2),
        (0.1, 0.09, (0, 0, 1), 2),
    ],
)
def test_voxels_exactly_the_tolerance_apart_are_one_contact(
    side: float, tolerance: float | None, far: Voxel, contacts: int
) -> None:
    places = (np.array([HERE, far]) + 0.5) * side
    one = HypothesisCloud("skin", REGULAR, 0.0, "base", places, np.array([0.5, 0.5]))
    law = config(voxel_size=side, tolerance=tolerance)
    assert len(fused(one, law=law).contacts) == contacts


def test_a_bridge_makes_two_contacts_one() -> None:
    banks = cloud("skin", 0.0, {HERE: 0.5, (4, 0, 0): 0.5})
    assert [one.voxels for one in fused(banks).contacts] == [1, 1]
    assert [one.voxels for one in fused(banks, cloud("a", 0.0, {(2, 0, 0): 0.5})).contacts] == [3]


def test_a_contact_sums_up_its_voxels() -> None:
    fusion = fused(
        cloud("skin", 0.1, {HERE: 0.75}, forces=[[4, 0, 0]]),
        cloud("wrist", 0.2, {(2, 0, 0): 0.25}, forces=[[0, 4, 0]]),
        cloud("skin/free", 0.3, {(7, 7, 7): 0.5}, kind=NULL),
        cloud("range", 0.3, {}),
        now=0.3,
    )
    [contact] = fusion.contacts
    assert contact.position == (1.0, 0.5, 0.5)
    assert contact.likelihood == 0.75
    # Σ H (x − 1)² / Σ H = 0.75 · 0.25 + 0.25 · 2.25
    assert contact.dispersion == pytest.approx(math.sqrt(0.75))
    assert np.array(contact.covariance) == pytest.approx(np.diag([0.75, 0, 0]) + np.eye(3) / 12)
    assert contact.extent is not None
    ends = np.array([[0.5, 0.5, 0.5], [2.5, 0.5, 0.5]])
    assert np.array(sorted(contact.extent)) == pytest.approx(ends)
    assert contact.force == (3.0, 1.0, 0.0)
    assert contact.voxels == 2
    assert contact.shares == {"skin": 0.75, "wrist": 0.25, "range": 0.0}
    assert contact.stamp == 200_000_000


def test_the_covariance_holds_the_spreads_of_the_likeliest_hypotheses() -> None:
    rows = [(HERE, 0.25), (HERE, 0.5), ((1, 0, 0), 0.5), ((1, 0, 0), 0.5)]
    unsure = replace(cloud("skin", 0.0, rows), spreads=np.array([9.0, 2.0, 1.0, 3.0]))
    free = cloud("skin/free", 0.0, {(7, 7, 7): 0.5}, kind=NULL)
    [contact] = fused(unsure, free).contacts
    assert contact.covariance[2][2] == pytest.approx((2.0**2 + 3.0**2) / 2 + 1 / 12)
    assert contact.dispersion == 0.5


def test_the_longest_axis_of_a_square_is_not_defined() -> None:
    square: dict[Voxel, float] = {(x, y, 0): 0.5 for x in (0, 1) for y in (0, 1)}
    assert fused(cloud("skin", 0.0, square)).contacts[0].extent is None


def test_contacts_come_by_falling_likelihood_and_then_by_place() -> None:
    ordered = {(0, 0, 0): 0.5, (5, 0, 0): 0.7, (9, 0, 0): 0.7000001, (-9, 0, 0): 0.3}
    contacts = fused(cloud("skin", 0.0, ordered)).contacts
    assert [one.first[0] for one in contacts] == [5, 9, 0, -9]


def test_the_condensations_differ_in_what_they_keep() -> None:
    clouds = (
        cloud("skin", 0.0, {HERE: 0.25, (1, 0, 0): 0.25, (2, 0, 0): 0.05, (9, 0, 0): 0.3}),
        cloud("motion", 0.0, {(3, 0, 0): 0.9}, kind=SUPPORT),
    )

    def sizes(**fields: Any) -> list[int]:
        return [one.voxels for one in fused(*clouds, law=config(threshold=0.2, **fields)).contacts]

    assert sizes(condensation="threshold", min_voxels=2) == [1, 1, 1]
    assert sizes(condensation="cluster_centroid") == [1, 2]
    assert sizes(condensation="cluster_centroid", min_voxels=2) == [2]


def test_a_fusion_without_a_source_leaves_the_first_as_it_was() -> None:
    fusion = fused(cloud("skin", 0.0, {HERE: 0.5}), cloud("wrist", 0.0, {HERE: 0.5, (9, 0, 0): 1}))
    assert likelihoods(fusion.without("wrist")) == {HERE: 0.5}
    assert list(fusion.without("wrist").kinds) == ["skin"]
    assert likelihoods(fusion) == {HERE: 0.75, (9, 0, 0): 1.0}


def test_refusals_name_every_reason() -> None:
    oracle = Oracle(config(strict_sources=True))
    with pytest.raises(Refused) as refusal:
        oracle.receive(cloud("skin", 0.0, {}, frame="tool"))
    assert refusal.value.reasons == (FrameError, SourceError)
