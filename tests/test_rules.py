"""The algebra of fusion: what each rule promises, and that it keeps it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from tests.clouds import HERE, NULL, REGULAR, SUPPORT, Voxel, by_voxel, cloud, contents, fused
from tests.clouds import given as given_by

PRIOR = 0.05


@dataclass(frozen=True)
class Promises:
    """What a rule promises beyond what all rules do.

    Attributes:
        associative: fusing two sources first changes nothing.
        neutral: a source that gives this likelihood changes nothing, None: there is none.
        absorbing: one source that is certain makes certain, whatever the others say.
        growing: another source of any likelihood never lowers what is fused.
        idempotent: a source that repeats another changes nothing.
    """

    associative: bool = True
    neutral: float | None = None
    absorbing: bool = False
    growing: bool = False
    idempotent: bool = False


PROMISES = {
    "de_morgan": Promises(absorbing=True, growing=True),
    "max": Promises(absorbing=True, growing=True, idempotent=True),
    "log_odds": Promises(neutral=PRIOR),
    "dempster_shafer": Promises(associative=False, neutral=PRIOR),
}


def promising(**wanted: Any) -> list[str]:
    """Name the rules that make a promise."""
    return [
        rule
        for rule, promises in PROMISES.items()
        if all(getattr(promises, name) == value for name, value in wanted.items())
    ]


all_rules = pytest.mark.parametrize("rule", PROMISES)

single = st.floats(0.0, 1.0, width=32).filter(lambda p: p == 0.0 or p > 1e-30)
"""Likelihoods that float32 holds, so that nothing is lost on the way in."""
likelihoods = st.lists(single, min_size=1, max_size=5)
moderate = st.lists(st.floats(1 / 64, 63 / 64, width=32), min_size=1, max_size=5)
few = settings(max_examples=25)


def combined(rule: str, ps: Sequence[float]) -> float:
    """Fuse the likelihoods that several sources give in one voxel."""
    clouds = [cloud(f"s{number}", 0.0, {HERE: p}) for number, p in enumerate(ps)]
    return by_voxel(fused(*clouds, rule=rule, prior=PRIOR)).get(HERE, 0.0)


def by_hand(rule: str, ps: Sequence[float]) -> float:
    """Give method §2 by the book, in plain floats; a likelihood of 0 makes no entry."""
    ps = [float(np.float32(p)) for p in ps if p > 0.0]
    if not ps:
        return 0.0
    match rule:
        case "de_morgan":
            return 1.0 - math.prod(1.0 - p for p in ps)
        case "max":
            return max(ps)
        case "log_odds":
            base = math.log(PRIOR / (1.0 - PRIOR))
            clipped = [min(max(p, 1e-6), 1.0 - 1e-6) for p in ps]
            odds = base + sum(math.log(p / (1.0 - p)) - base for p in clipped)
            return 1.0 / (1.0 + math.exp(-odds))
    yes, no, unknown = 0.0, 0.0, 1.0
    for p in ps:
        for_it, against = max(0.0, (p - PRIOR) / (1 - PRIOR)), max(0.0, (PRIOR - p) / PRIOR)
        rest = 1.0 - for_it - against
        clash = yes * against + no * for_it
        yes = (yes * (for_it + rest) + unknown * for_it) / (1.0 - clash)
        no = (no * (against + rest) + unknown * against) / (1.0 - clash)
        unknown = unknown * rest / (1.0 - clash)
    return yes + PRIOR * unknown


# One voxel


@all_rules
@few
@given(ps=likelihoods)
def test_the_rule_gives_what_the_formula_gives(rule: str, ps: list[float]) -> None:
    if rule == "dempster_shafer":  # it divides by what is left when almost all is conflict
        ps = [min(max(p, 0.01), 0.99) for p in ps]
    assert combined(rule, ps) == pytest.approx(by_hand(rule, ps), abs=1e-9)


@pytest.mark.parametrize(
    ("rule", "ps", "expected"),
    [
        ("de_morgan", [0.5, 0.5, 0.5], 0.875),
        ("max", [0.25, 0.75, 0.5], 0.75),
        ("log_odds", [0.5, 0.5], 19 / 20),  # odds 1 · 1 · 19
        ("log_odds", [0.5, 0.05], 1 / 2),
        ("log_odds", [0.01, 0.5], (19 / 99) / (1 + 19 / 99)),
        ("dempster_shafer", [0.525], 0.525),  # mass 1/2 for it: 1/2 + 0.05 / 2
        ("dempster_shafer", [0.525, 0.525], 0.75 + PRIOR / 4),
        ("dempster_shafer", [0.025], 0.025),  # mass 1/2 against it
        ("dempster_shafer", [0.525, 0.025], (0.25 + PRIOR * 0.25) / 0.75),  # conflict 1/4
        ("dempster_shafer", [1.0, 0.025], 1.0),
    ],
)
def test_the_rule_gives_what_a_hand_computes(rule: str, ps: list[float], expected: float) -> None:
    assert combined(rule, ps) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("rule", promising(neutral=PRIOR))
@pytest.mark.parametrize("prior", [0.05, 0.5])
def test_the_prior_moves_where_evidence_begins(rule: str, prior: float) -> None:
    here = by_voxel(fused(cloud("a", 0.0, {HERE: 0.25}), rule=rule, prior=prior))[HERE]
    assert here == pytest.approx(0.25, abs=1e-6)
    two = [cloud(name, 0.0, {HERE: 0.25}) for name in "ab"]
    assert (by_voxel(fused(*two, rule=rule, prior=prior))[HERE] > 0.25) == (prior < 0.25)


def test_the_conflict_of_sources_is_told() -> None:
    clouds = [cloud("a", 0.0, {HERE: 0.525}), cloud("b", 0.0, {HERE: 0.025})]
    details = fused(*clouds, rule="dempster_shafer").field.details
    assert details["conflict"] == pytest.approx([0.25])


def test_when_all_is_conflict_the_prior_is_left() -> None:
    assert combined("dempster_shafer", [1.0, 1e-30]) == PRIOR


@all_rules
@few
@given(ps=likelihoods)
def test_the_result_is_a_likelihood(rule: str, ps: list[float]) -> None:
    assert 0.0 <= combined(rule, ps) <= 1.0


@all_rules
@few
@given(p=single)
def test_one_source_alone_is_believed(rule: str, p: float) -> None:
    assert combined(rule, [p]) == pytest.approx(p, abs=2e-6)


@all_rules
@few
@given(ps=likelihoods, data=st.data())
def test_the_rule_is_commutative(rule: str, ps: list[float], data: st.DataObject) -> None:
    shuffled = data.draw(st.permutations(ps))
    assume(rule != "dempster_shafer" or min(ps) > 1e-9)
    assert combined(rule, shuffled) == pytest.approx(combined(rule, ps), abs=1e-9)


@all_rules
@few
@given(ps=moderate, others=moderate)
def test_the_rule_is_associative_where_it_promises_to_be(
    rule: str, ps: list[float], others: list[float]
) -> None:
    first = float(np.float32(combined(rule, ps)))
    assume(first < 1.0 - 1e-4)
    difference = abs(combined(rule, [first, *others]) - combined(rule, [*ps, *others]))
    assert difference < 1e-3 or not PROMISES[rule].associative


def test_dempsters_rule_is_not_associative_in_its_result_for_conflict_is_divided_out() -> None:
    first = combined("dempster_shafer", [0.525, 0.01])
    assert abs(combined("dempster_shafer", [first, 0.01]) - combined(
        "dempster_shafer", [0.525, 0.01, 0.01]
    )) > 1e-3  # fmt: skip


@all_rules
@few
@given(ps=likelihoods, data=st.data())
def test_the_rule_is_monotone(rule: str, ps: list[float], data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(ps) - 1))
    assume(ps[at] > 0.0 and min(ps) != 0.0)
    more = data.draw(st.floats(ps[at], 1.0, width=32))
    assume(rule != "dempster_shafer" or min(ps) > 1e-9)
    raised = [*ps[:at], more, *ps[at + 1 :]]
    assert combined(rule, raised) >= combined(rule, ps) - 1e-12


@pytest.mark.parametrize("rule", promising(absorbing=True))
@few
@given(ps=likelihoods)
def test_certainty_absorbs(rule: str, ps: list[float]) -> None:
    assert combined(rule, [*ps, 1.0]) == 1.0


@pytest.mark.parametrize("rule", promising(growing=True))
@few
@given(ps=likelihoods, p=single)
def test_another_source_never_lowers_what_is_fused(rule: str, ps: list[float], p: float) -> None:
    assert combined(rule, [*ps, p]) >= combined(rule, ps)


@pytest.mark.parametrize("rule", promising(growing=False))
def test_a_source_under_the_prior_speaks_against_a_contact(rule: str) -> None:
    assert combined(rule, [0.5, 0.01]) < combined(rule, [0.5]) - 0.1


@pytest.mark.parametrize("rule", promising(neutral=PRIOR))
@few
@given(ps=moderate)
def test_a_source_that_gives_the_prior_changes_nothing(rule: str, ps: list[float]) -> None:
    assert combined(rule, [*ps, PRIOR]) == pytest.approx(combined(rule, ps), abs=1e-6)


@all_rules
@few
@given(p=st.floats(1 / 16, 15 / 16, width=32))
def test_repeating_changes_nothing_only_where_that_is_promised(rule: str, p: float) -> None:
    assert (combined(rule, [p, p]) == p) == PROMISES[rule].idempotent


# Many voxels, sources and stamps

STAMPS = (0.0, 0.1, 0.2, 0.3)
NOW = 0.3
VOXELS: list[Voxel] = [(x, y, 0) for x in (-2, -1, 0, 3) for y in (-1, 0)]
KINDS = {"a": REGULAR, "b": REGULAR, "c": SUPPORT, "d": NULL}

rows = st.lists(
    st.tuples(st.sampled_from(VOXELS), st.sampled_from((0.0, 0.01, 0.05, 0.1, 0.3, 0.5, 0.9, 1.0))),
    max_size=6,
)


@st.composite
def streams(draw: st.DrawFn, sources: str = "abcd") -> list[HypothesisCloud]:
    """Draw clouds of several sources; the stamps of each source never fall."""
    clouds: list[HypothesisCloud] = []
    for source in draw(st.lists(st.sampled_from(sources), min_size=1, max_size=8)):
        earlier = [one.stamp for one in clouds if one.source == source]
        stamp = draw(st.sampled_from(STAMPS[STAMPS.index(max(earlier, default=0.0)) :]))
        pairs = draw(rows)
        forces = draw(st.booleans())
        vectors = np.array([[i, 1.0, -i] for i in range(len(pairs))]).reshape(-1, 3)
        clouds.append(
            cloud(source, stamp, pairs, KINDS[source], forces=vectors if forces else None)
        )
    return clouds


def chosen(cloud_: HypothesisCloud, order: Sequence[int]) -> HypothesisCloud:
    """Give a cloud of some rows in some order."""
    picked = list(order)
    forces = None if cloud_.forces is None else cloud_.forces[picked]
    return replace(
        cloud_,
        positions=cloud_.positions[picked],
        likelihoods=cloud_.likelihoods[picked],
        forces=forces,
    )


def same(one: Fusion, other: Fusion) -> bool:
    """Whether two steps say the same, up to the rounding of sums of forces."""
    pairs = zip(_parts(one), _parts(other), strict=True)
    forces = np.allclose(one.space.forces, other.space.forces, atol=1e-9, equal_nan=True)
    return forces and all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in pairs)


def _parts(fusion: Fusion) -> list[np.ndarray[Any, Any]]:
    space = fusion.space
    speaks = ~np.isnan(space.source_likelihoods).all(axis=0)
    contacts = [
        np.array([*c.position, c.likelihood, c.dispersion, c.voxels, c.stamp, *c.covariance.flat])
        for c in fusion.contacts
    ]
    spoken = space.source_likelihoods[:, speaks]
    return [space.voxels, space.likelihoods, space.verdicts, spoken, space.stamps, *contacts]


@all_rules
@few
@given(clouds=streams(), data=st.data())
def test_the_order_of_clouds_of_different_sources_does_not_matter(
    rule: str, clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    order = data.draw(st.permutations([one.source for one in clouds]))
    queues = {name: iter([one for one in clouds if one.source == name]) for name in KINDS}
    shuffled = [next(queues[name]) for name in order]
    assert contents(fused(*shuffled, now=NOW, rule=rule)) == contents(
        fused(*clouds, now=NOW, rule=rule)
    )


@all_rules
@few
@given(clouds=streams(), data=st.data())
def test_the_order_of_rows_does_not_matter(
    rule: str, clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    shuffled = [chosen(one, data.draw(st.permutations(range(len(one))))) for one in clouds]
    assert same(fused(*shuffled, now=NOW, rule=rule), fused(*clouds, now=NOW, rule=rule))


@all_rules
@few
@given(clouds=streams(), data=st.data())
def test_a_cloud_may_come_in_two_parts_of_one_stamp(
    rule: str, clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    parts = []
    for one in clouds:
        at = data.draw(st.integers(0, len(one)))
        parts += [chosen(one, range(at)), chosen(one, range(at, len(one)))]
    assert same(fused(*parts, now=NOW, rule=rule), fused(*clouds, now=NOW, rule=rule))


@all_rules
@few
@given(clouds=streams(), data=st.data())
def test_when_a_cloud_is_fused_does_not_matter(
    rule: str, clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    integrator = Integrator(IntegratorConfig(rule=rule))
    for one in sorted(clouds, key=lambda one: one.stamp):
        integrator.receive(one)
        if data.draw(st.booleans()):
            integrator.step(one.stamp)
    assert same(integrator.step(NOW), fused(*clouds, now=NOW, rule=rule))


@all_rules
@few
@given(clouds=streams(), shift=st.tuples(*[st.integers(-1000, 1000)] * 3))
@example(clouds=[cloud("a", 0.0, {(0, 0, 0): 0.5, (1, 0, 0): 0.9})], shift=(-1, -1, -1))
@pytest.mark.parametrize(("side", "exact"), [(2.0**-7, True), (0.005, False)])
def test_moving_all_by_whole_voxels_moves_the_result_and_changes_nothing_else(
    rule: str, side: float, exact: bool, clouds: list[HypothesisCloud], shift: Voxel
) -> None:
    def at(offset: Voxel) -> Fusion:
        moved = (replace(one, positions=(one.positions / 0.005 + offset) * side) for one in clouds)
        return fused(*moved, now=NOW, rule=rule, voxel_size=side)

    still, there = at((0, 0, 0)), at(shift)
    assert np.array_equal(there.space.voxels, still.space.voxels + shift)
    assert np.array_equal(there.space.likelihoods, still.space.likelihoods)
    assert np.array_equal(there.space.verdicts, still.space.verdicts)
    assert np.array_equal(there.space.forces, still.space.forces, equal_nan=True)
    vector = np.array(shift) * side
    if exact:
        assert np.array_equal(there.space.positions, still.space.positions + vector)
    for before, after in zip(still.contacts, there.contacts, strict=True):
        assert after.position == pytest.approx(before.position + vector, abs=1e-8 * side)
        assert after.extent == pytest.approx(before.extent + vector, abs=1e-8 * side)
        assert np.array_equal(after.covariance, before.covariance)
        assert (after.dispersion, after.likelihood, after.shares, after.voxels) == (
            before.dispersion,
            before.likelihood,
            before.shares,
            before.voxels,
        )


@all_rules
@few
@given(clouds=streams(), data=st.data())
def test_clouds_that_come_out_of_order_never_change_the_result(
    rule: str, clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    sent = []
    for one in clouds:
        sent.append(one)
        if one.stamp > 0.0 and data.draw(st.booleans()):
            stamp = data.draw(st.sampled_from([s for s in STAMPS if s < one.stamp]))
            sent.append(cloud(one.source, stamp, data.draw(rows), one.kind))
    late = fused(*sent, now=NOW, rule=rule)
    assert contents(late) == contents(fused(*clouds, now=NOW, rule=rule))
    total = sum(source.late for source in late.report.sources.values())
    assert total == len(sent) - len(clouds)


@all_rules
@few
@given(clouds=streams("abd"), dead=streams("c"))
def test_a_dead_source_leaves_no_trace_after_its_timeout(
    rule: str, clouds: list[HypothesisCloud], dead: list[HypothesisCloud]
) -> None:
    integrator = Integrator(IntegratorConfig(rule=rule, timeout=10.0))
    integrator.plug("c", SUPPORT, timeout=0.25)
    for one in (*clouds, *dead):
        integrator.receive(one)
    integrator.step(NOW)
    expected = fused(*clouds, now=0.6, rule=rule, timeout=10.0)
    assert contents(integrator.step(0.6)) == contents(expected)


@all_rules
@few
@given(clouds=streams("abd"), gone=streams("c"), data=st.data())
def test_plugging_and_unplugging_is_as_if_it_had_never_been_plugged(
    rule: str, clouds: list[HypothesisCloud], gone: list[HypothesisCloud], data: st.DataObject
) -> None:
    integrator = Integrator(IntegratorConfig(rule=rule))
    guests = iter(gone)
    for one in sorted(clouds, key=lambda one: one.stamp):
        if data.draw(st.booleans()):
            integrator.plug("c", SUPPORT, replace=data.draw(st.booleans()))
            if (guest := next(guests, None)) is not None:
                integrator.receive(guest)
            if data.draw(st.booleans()):
                integrator.step(one.stamp)
            integrator.unplug("c")
        integrator.receive(one)
    assert contents(integrator.step(NOW)) == contents(fused(*clouds, now=NOW, rule=rule))


@all_rules
@few
@given(clouds=streams("abc"), free=streams("d"))
def test_null_never_raises_a_likelihood_and_never_makes_a_contact(
    rule: str, clouds: list[HypothesisCloud], free: list[HypothesisCloud]
) -> None:
    before, after = fused(*clouds, now=NOW, rule=rule), fused(*clouds, *free, now=NOW, rule=rule)
    old, new = by_voxel(before), by_voxel(after)
    nulled = given_by(after, "d")
    assert new == {**dict.fromkeys(nulled, 0.0), **old}
    touched = dict(zip(old, before.space.verdicts, strict=True))
    for voxel, verdict in zip(new, after.space.verdicts, strict=True):
        assert verdict == ("nulled" if voxel in nulled else touched[voxel])


@all_rules
@pytest.mark.parametrize("condensation", ["threshold", "cluster_centroid", "cluster_mass"])
@few
@given(clouds=streams("c"))
def test_support_alone_makes_no_contact(
    rule: str, condensation: str, clouds: list[HypothesisCloud]
) -> None:
    fusion = fused(*clouds, now=NOW, rule=rule, condensation=condensation)
    assert fusion.contacts == () and set(fusion.space.verdicts) <= {"support_only"}


@all_rules
@few
@given(clouds=streams())
def test_each_voxel_is_fused_by_itself_from_what_lives_in_it(
    rule: str, clouds: list[HypothesisCloud]
) -> None:
    naive: dict[Voxel, dict[str, tuple[float, float]]] = {}
    for one in clouds:
        for voxel, p in _pairs(one):
            entries = naive.setdefault(voxel, {})
            old = entries.get(one.source)
            if old is None or one.stamp > old[0] or p > old[1]:
                entries[one.source] = (one.stamp, p)
    expected = {
        voxel: by_hand(rule, [p for name, (_, p) in sorted(entries.items()) if name != "d"])
        for voxel, entries in naive.items()
        if any(p > 0.0 for _, p in entries.values())
    }
    assert by_voxel(fused(*clouds, now=NOW, rule=rule)) == pytest.approx(expected, abs=1e-9)


def _pairs(one: HypothesisCloud) -> list[tuple[Voxel, float]]:
    voxels = np.floor(one.positions * (1.0 / 0.005)).astype(int).tolist()
    ps = one.likelihoods.astype(np.float32).astype(np.float64).tolist()
    return [((x, y, z), p) for (x, y, z), p in zip(voxels, ps, strict=True)]


@all_rules
@pytest.mark.parametrize("kind", [REGULAR, SUPPORT, NULL])
def test_every_rule_keeps_null_out_and_support_in(rule: str, kind: HypothesisKind) -> None:
    clouds = [cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {HERE: 0.25}, kind)]
    likelihood = by_voxel(fused(*clouds, rule=rule))[HERE]
    assert likelihood == pytest.approx(by_hand(rule, [0.5] if kind == NULL else [0.5, 0.25]))


def test_every_installed_rule_has_its_promises_here() -> None:
    from contactfusion.integrator.rules import contactfusion_rules

    of_whole_fields = {"posterior", "sets"}  # see test_posterior.py, test_sets.py
    assert set(contactfusion_rules()) == set(PROMISES) | of_whole_fields


def test_a_certain_contact_reaches_every_threshold_under_log_odds_too() -> None:
    fusion = fused(cloud("a", 0.0, {(0, 0, 0): 1.0}), rule="log_odds", threshold=1.0)
    assert len(fusion.contacts) == 1


def test_a_likelihood_that_rounds_to_nothing_is_no_contact() -> None:
    fusion = fused(cloud("a", 0.0, {(0, 0, 0): 1e-30}), threshold=1e-7)
    assert fusion.contacts == () and list(fusion.space.verdicts) == ["below_threshold"]
