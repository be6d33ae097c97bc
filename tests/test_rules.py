"""The algebra of fusion by De Morgan; of whole fields: test_sets.py."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from tests import clouds as told
from tests.clouds import HERE, NULL, REGULAR, SUPPORT, Voxel, by_voxel, cloud, contents
from tests.clouds import given as given_by

fused = partial(told.fused, rule="de_morgan")
single = st.floats(0.0, 1.0, width=32).filter(lambda p: p == 0.0 or p > 1e-30)
"""Likelihoods that float32 holds, so that nothing is lost on the way in."""
likelihoods = st.lists(single, min_size=1, max_size=5)
moderate = st.lists(st.floats(1 / 64, 63 / 64, width=32), min_size=1, max_size=5)
few = settings(max_examples=25)


def combined(ps: Sequence[float]) -> float:
    """Fuse the likelihoods that several sources give in one voxel."""
    clouds = [cloud(f"s{number}", 0.0, {HERE: p}) for number, p in enumerate(ps)]
    return by_voxel(fused(*clouds)).get(HERE, 0.0)


def by_hand(ps: Sequence[float]) -> float:
    """Give method §2 by the book, in plain floats; a likelihood of 0 makes no entry."""
    return 1.0 - math.prod(1.0 - float(np.float32(p)) for p in ps)


# One voxel


@few
@given(ps=likelihoods)
def test_the_rule_gives_what_the_formula_gives(ps: list[float]) -> None:
    assert combined(ps) == pytest.approx(by_hand(ps), abs=1e-9)


@few
@given(ps=likelihoods)
def test_the_result_is_a_likelihood(ps: list[float]) -> None:
    assert 0.0 <= combined(ps) <= 1.0


@few
@given(p=single)
def test_one_source_alone_is_believed(p: float) -> None:
    assert combined([p]) == pytest.approx(p, abs=2e-6)


@few
@given(ps=likelihoods, data=st.data())
def test_the_rule_is_commutative(ps: list[float], data: st.DataObject) -> None:
    shuffled = data.draw(st.permutations(ps))
    assert combined(shuffled) == pytest.approx(combined(ps), abs=1e-9)


@few
@given(ps=moderate, others=moderate)
def test_the_rule_is_associative(ps: list[float], others: list[float]) -> None:
    first = float(np.float32(combined(ps)))
    assume(first < 1.0 - 1e-4)
    assert combined([first, *others]) == pytest.approx(combined([*ps, *others]), abs=1e-3)


@few
@given(ps=likelihoods, data=st.data())
def test_the_rule_is_monotone(ps: list[float], data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(ps) - 1))
    assume(ps[at] > 0.0 and min(ps) != 0.0)
    more = data.draw(st.floats(ps[at], 1.0, width=32))
    raised = [*ps[:at], more, *ps[at + 1 :]]
    assert combined(raised) >= combined(ps) - 1e-12


@few
@given(ps=likelihoods)
def test_certainty_absorbs(ps: list[float]) -> None:
    assert combined([*ps, 1.0]) == 1.0


@few
@given(ps=likelihoods, p=single)
def test_another_source_never_lowers_what_is_fused(ps: list[float], p: float) -> None:
    assert combined([*ps, p]) >= combined(ps)


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


@few
@given(clouds=streams(), data=st.data())
def test_the_order_of_clouds_of_different_sources_does_not_matter(
    clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    order = data.draw(st.permutations([one.source for one in clouds]))
    queues = {name: iter([one for one in clouds if one.source == name]) for name in KINDS}
    shuffled = [next(queues[name]) for name in order]
    assert contents(fused(*shuffled, now=NOW)) == contents(fused(*clouds, now=NOW))


@few
@given(clouds=streams(), data=st.data())
def test_the_order_of_rows_does_not_matter(
    clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    shuffled = [chosen(one, data.draw(st.permutations(range(len(one))))) for one in clouds]
    assert same(fused(*shuffled, now=NOW), fused(*clouds, now=NOW))


@few
@given(clouds=streams(), data=st.data())
def test_a_cloud_may_come_in_two_parts_of_one_stamp(
    clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    parts = []
    for one in clouds:
        at = data.draw(st.integers(0, len(one)))
        parts += [chosen(one, range(at)), chosen(one, range(at, len(one)))]
    assert same(fused(*parts, now=NOW), fused(*clouds, now=NOW))


@few
@given(clouds=streams(), data=st.data())
def test_when_a_cloud_is_fused_does_not_matter(
    clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    integrator = Integrator(IntegratorConfig(rule="de_morgan"))
    for one in sorted(clouds, key=lambda one: one.stamp):
        integrator.receive(one)
        if data.draw(st.booleans()):
            integrator.step(one.stamp)
    assert same(integrator.step(NOW), fused(*clouds, now=NOW))


@few
@given(clouds=streams(), shift=st.tuples(*[st.integers(-1000, 1000)] * 3))
@example(clouds=[cloud("a", 0.0, {(0, 0, 0): 0.5, (1, 0, 0): 0.9})], shift=(-1, -1, -1))
@pytest.mark.parametrize(("side", "exact"), [(2.0**-7, True), (0.005, False)])
def test_moving_all_by_whole_voxels_moves_the_result_and_changes_nothing_else(
    side: float, exact: bool, clouds: list[HypothesisCloud], shift: Voxel
) -> None:
    def at(offset: Voxel) -> Fusion:
        moved = (replace(one, positions=(one.positions / 0.005 + offset) * side) for one in clouds)
        return fused(*moved, now=NOW, voxel_size=side)

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


@few
@given(clouds=streams(), data=st.data())
def test_clouds_that_come_out_of_order_never_change_the_result(
    clouds: list[HypothesisCloud], data: st.DataObject
) -> None:
    sent = []
    for one in clouds:
        sent.append(one)
        if one.stamp > 0.0 and data.draw(st.booleans()):
            stamp = data.draw(st.sampled_from([s for s in STAMPS if s < one.stamp]))
            sent.append(cloud(one.source, stamp, data.draw(rows), one.kind))
    late = fused(*sent, now=NOW)
    assert contents(late) == contents(fused(*clouds, now=NOW))
    total = sum(source.late for source in late.report.sources.values())
    assert total == len(sent) - len(clouds)


@few
@given(clouds=streams("abd"), dead=streams("c"))
def test_a_dead_source_leaves_no_trace_after_its_timeout(
    clouds: list[HypothesisCloud], dead: list[HypothesisCloud]
) -> None:
    integrator = Integrator(IntegratorConfig(rule="de_morgan", timeout=10.0))
    integrator.plug("c", SUPPORT, timeout=0.25)
    for one in (*clouds, *dead):
        integrator.receive(one)
    integrator.step(NOW)
    expected = fused(*clouds, now=0.6, timeout=10.0)
    assert contents(integrator.step(0.6)) == contents(expected)


@few
@given(clouds=streams("abd"), gone=streams("c"), data=st.data())
def test_plugging_and_unplugging_is_as_if_it_had_never_been_plugged(
    clouds: list[HypothesisCloud], gone: list[HypothesisCloud], data: st.DataObject
) -> None:
    integrator = Integrator(IntegratorConfig(rule="de_morgan"))
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
    assert contents(integrator.step(NOW)) == contents(fused(*clouds, now=NOW))


@few
@given(clouds=streams("abc"), free=streams("d"))
def test_null_never_raises_a_likelihood_and_never_makes_a_contact(
    clouds: list[HypothesisCloud], free: list[HypothesisCloud]
) -> None:
    before, after = fused(*clouds, now=NOW), fused(*clouds, *free, now=NOW)
    old, new = by_voxel(before), by_voxel(after)
    nulled = given_by(after, "d")
    assert new == {**dict.fromkeys(nulled, 0.0), **old}
    touched = dict(zip(old, before.space.verdicts, strict=True))
    for voxel, verdict in zip(new, after.space.verdicts, strict=True):
        assert verdict == ("nulled" if voxel in nulled else touched[voxel])


@pytest.mark.parametrize("condensation", ["threshold", "cluster_centroid"])
@few
@given(clouds=streams("c"))
def test_support_alone_makes_no_contact(condensation: str, clouds: list[HypothesisCloud]) -> None:
    fusion = fused(*clouds, now=NOW, condensation=condensation)
    assert fusion.contacts == () and set(fusion.space.verdicts) <= {"support_only"}


@few
@given(clouds=streams())
def test_each_voxel_is_fused_by_itself_from_what_lives_in_it(clouds: list[HypothesisCloud]) -> None:
    naive: dict[Voxel, dict[str, tuple[float, float]]] = {}
    for one in clouds:
        for voxel, p in _pairs(one):
            entries = naive.setdefault(voxel, {})
            old = entries.get(one.source)
            if old is None or one.stamp > old[0] or p > old[1]:
                entries[one.source] = (one.stamp, p)
    expected = {
        voxel: by_hand([p for name, (_, p) in sorted(entries.items()) if name != "d"])
        for voxel, entries in naive.items()
        if any(p > 0.0 for _, p in entries.values())
    }
    assert by_voxel(fused(*clouds, now=NOW)) == pytest.approx(expected, abs=1e-9)


def _pairs(one: HypothesisCloud) -> list[tuple[Voxel, float]]:
    voxels = np.floor(one.positions * (1.0 / 0.005)).astype(int).tolist()
    ps = one.likelihoods.astype(np.float32).astype(np.float64).tolist()
    return [((x, y, z), p) for (x, y, z), p in zip(voxels, ps, strict=True)]


@pytest.mark.parametrize("kind", [REGULAR, SUPPORT, NULL])
def test_the_rule_keeps_null_out_and_support_in(kind: HypothesisKind) -> None:
    clouds = [cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {HERE: 0.25}, kind)]
    likelihood = by_voxel(fused(*clouds))[HERE]
    assert likelihood == pytest.approx(by_hand([0.5] if kind == NULL else [0.5, 0.25]))


def test_a_likelihood_that_rounds_to_nothing_is_no_contact() -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 1e-30}), threshold=1e-7)
    assert fusion.contacts == () and list(fusion.space.verdicts) == ["below_threshold"]
