"""Entries remember where their hypotheses were measured, where a rule needs that (method §1)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.arrays import FloatArray
from contactfusion.integrator.entries import Entries
from tests.clouds import NULL, REGULAR, SIDE, SUPPORT, Voxel, centres, law

Place = tuple[float, float, float]
Row = tuple[Place, float]
A: Place = (0.0012, 0.0034, 0.0005)
B: Place = (0.0044, 0.0001, 0.0049)
NEAR: Place = (0.0061, 0.0002, 0.0003)
FAR: Place = (-1.2345, 0.6789, 2.0)
HOME: Voxel = (0, 0, 0)
"""The voxel of A and B; the others lie in voxels of their own."""
KINDS = {"free": NULL, "motion": SUPPORT}


def cloud(source: str, stamp: float, *rows: Row, **others: Any) -> HypothesisCloud:
    return HypothesisCloud(
        source=source,
        kind=KINDS.get(source, REGULAR),
        stamp=stamp,
        frame="base",
        positions=np.array([place for place, _ in rows]).reshape(-1, 3),
        likelihoods=np.array([p for _, p in rows]),
        **others,
    )


def integrator(**config: Any) -> Integrator:
    return Integrator(law(**config))


def fused(*clouds: HypothesisCloud, now: float = 0.0, **config: Any) -> Fusion:
    one = integrator(**config)
    for each in clouds:
        one.receive(each)
    return one.step(now)


def voxel_of(place: Place) -> Voxel:
    x, y, z = np.floor(np.array(place) * (1.0 / SIDE)).astype(int).tolist()
    return x, y, z


def places(entries: Entries) -> dict[tuple[str, Voxel], Place]:
    """Give the place of each entry, by its source and voxel."""
    found = {}
    rows, ends = entries.positions.tolist(), entries.begin.tolist()
    voxels = entries.voxels[entries.places].tolist()
    for number, source in enumerate(entries.sources):
        for (x, y, z), (i, j, k) in zip(
            rows[ends[number] : ends[number + 1]],
            voxels[ends[number] : ends[number + 1]],
            strict=True,
        ):
            found[source.name, (i, j, k)] = (x, y, z)
    return found


def mean(*rows: Row) -> Any:
    """Give the weighted mean of places, as exact as single precision of an offset is."""
    weights = np.array([p for _, p in rows])
    return pytest.approx(weights @ np.array([place for place, _ in rows]) / weights.sum(), abs=1e-9)


# Where


def test_a_hypothesis_keeps_its_place_also_metres_from_the_origin() -> None:
    entries = fused(cloud("a", 0.0, (A, 0.5), (NEAR, 0.2), (FAR, 1.0))).field.entries
    assert places(entries) == {
        ("a", voxel_of(place)): mean((place, 1.0)) for place in (A, NEAR, FAR)
    }


def test_several_in_one_voxel_have_their_mean_weighted_by_likelihood() -> None:
    found = places(fused(cloud("a", 0.0, (A, 0.25), (NEAR, 0.5), (B, 0.75))).field.entries)
    assert found["a", HOME] == mean((A, 0.25), (B, 0.75))
    assert found["a", voxel_of(NEAR)] == mean((NEAR, 0.5))


@pytest.mark.parametrize("source", ["a", "motion", "free"])
def test_places_are_kept_of_every_kind(source: str) -> None:
    found = places(fused(cloud(source, 0.0, (A, 0.5))).field.entries)
    assert found == {(source, HOME): mean((A, 0.5))}


def test_each_source_has_a_place_of_its_own_in_a_voxel() -> None:
    clouds = [cloud("a", 0.0, (A, 0.5)), cloud("b", 0.0, (B, 0.1)), cloud("c", 0.0, (NEAR, 0.3))]
    found = places(fused(*clouds).field.entries)
    assert found["a", HOME] == mean((A, 0.5)) and found["b", HOME] == mean((B, 0.1))


def test_a_rule_that_needs_no_places_gets_the_centres_of_voxels_and_costs_no_room() -> None:
    one = Integrator(IntegratorConfig(rule="de_morgan"))
    for stamp in (0.0, 0.1):
        one.receive(cloud("a", stamp, (A, 0.25), (B, 0.75), (NEAR, 0.5)))
        entries = one.step(stamp).field.entries
        assert entries.columns.offsets.shape == (0, 4)
        assert entries.without("a").columns.offsets.shape == (0, 4)
        expected = centres([HOME, voxel_of(NEAR)])
        assert entries.positions == pytest.approx(expected, abs=0.0)


def test_an_empty_step_has_no_places() -> None:
    entries = fused(cloud("a", 0.0)).field.entries
    assert entries.positions.shape == (0, 3) and entries.columns.offsets.shape == (0, 4)


# The newest


def test_rows_of_one_stamp_have_one_mean_in_one_cloud_in_two_and_in_two_steps() -> None:
    first, second = cloud("a", 0.0, (A, 0.25)), cloud("a", 0.0, (B, 0.75))
    expected = mean((A, 0.25), (B, 0.75))
    for order in ([first, second], [second, first]):
        assert places(fused(*order).field.entries)["a", HOME] == expected
        one = integrator()
        steps = []
        for each in order:
            one.receive(each)
            steps.append(one.step(0.0))
        entries = steps[-1].field.entries
        assert places(entries)["a", HOME] == expected
        assert entries.columns.likelihoods.tolist() == [0.75]


def test_a_newer_row_replaces_the_place_also_when_it_is_less_likely() -> None:
    clouds = [cloud("a", 0.0, (A, 0.9), (NEAR, 0.9)), cloud("a", 0.1, (B, 0.1))]
    expected = {("a", HOME): mean((B, 0.1)), ("a", voxel_of(NEAR)): mean((NEAR, 0.9))}
    assert places(fused(*clouds, now=0.1).field.entries) == expected
    one = integrator()
    steps = []
    for each in clouds:
        one.receive(each)
        steps.append(one.step(each.stamp))
    assert places(steps[-1].field.entries) == expected


def test_zero_takes_the_place_away_and_what_follows_starts_anew() -> None:
    gone, back = cloud("a", 0.1, (B, 0.0)), cloud("a", 0.1, (B, 0.5))
    old = cloud("a", 0.0, (A, 0.9), (NEAR, 0.9))
    assert set(places(fused(old, gone, now=0.1).field.entries)) == {("a", voxel_of(NEAR))}
    found = places(fused(old, gone, back, now=0.1).field.entries)
    assert found["a", HOME] == mean((B, 0.5))


def test_zero_of_the_same_stamp_moves_no_place() -> None:
    found = places(fused(cloud("a", 0.0, (A, 0.5), (B, 0.0))).field.entries)
    assert found["a", HOME] == mean((A, 0.5))


def test_a_source_that_replaces_keeps_the_places_of_its_newest_cloud() -> None:
    one = integrator()
    one.plug("a", replace=True)
    for stamp, rows in ((0.0, [(A, 0.9), (FAR, 0.9)]), (0.0, [(B, 0.3), (NEAR, 0.3)])):
        one.receive(cloud("a", stamp, *rows))
        entries = one.step(stamp).field.entries
    assert places(entries) == {("a", HOME): mean((B, 0.3)), ("a", voxel_of(NEAR)): mean((NEAR, 1))}


def test_places_stay_with_their_entries_when_others_die() -> None:
    one = integrator(timeout=0.5)
    one.plug("quick", timeout=0.1)
    one.receive(cloud("a", 0.0, (A, 0.5), (NEAR, 0.5)))
    one.receive(cloud("quick", 0.0, (A, 0.5), (FAR, 0.5)))
    one.receive(cloud("z", 0.1, (B, 0.5)))
    kept = {("a", HOME): mean((A, 1)), ("a", voxel_of(NEAR)): mean((NEAR, 1))}
    last = {("z", HOME): mean((B, 1))}
    assert places(one.step(0.2).field.entries) == {**kept, **last}
    assert places(one.step(0.55).field.entries) == last


def test_places_stay_with_their_entries_when_voxels_die() -> None:
    one = integrator(timeout=0.5, expiry="voxel")
    one.receive(cloud("a", 0.0, (FAR, 0.5), (A, 0.5), (NEAR, 0.5)))
    one.receive(cloud("z", 0.4, (B, 0.5)))
    found = places(one.step(0.8).field.entries)
    assert found == {("a", HOME): mean((A, 1)), ("z", HOME): mean((B, 1))}


def test_places_stay_with_their_entries_without_a_source_and_in_some_voxels() -> None:
    clouds = [cloud("a", 0.0, (A, 0.5), (NEAR, 0.5)), cloud("b", 0.0, (FAR, 0.5), (B, 0.5))]
    entries = fused(*clouds, cloud("c", 0.0, (NEAR, 0.5))).field.entries
    everything = places(entries)
    assert places(entries.without("a")) == {k: v for k, v in everything.items() if k[0] != "a"}
    wanted = entries.voxels[:, 0] >= 0
    kept = {(name, voxel): v for (name, voxel), v in everything.items() if voxel[0] >= 0}
    assert places(entries.in_voxels(wanted)) == kept != everything


# Existence


def existence(fusion: Fusion) -> float:
    (member,) = fusion.field.members or []
    return member.contact.likelihood


@pytest.mark.parametrize("size", [0.001, 0.005, 0.05, 1.0])
def test_a_single_contact_loses_no_existence_to_voxels_that_hold_several_of_its_places(
    size: float,
) -> None:
    rng = np.random.default_rng(0)
    rows: list[Row] = [((x, y, z), 0.9 / 40) for x, y, z in rng.uniform(0.0, 0.02, (40, 3))]
    for split in (40, 13):
        clouds = [cloud("a", 0.0, *part, single=True) for part in (rows[:split], rows[split:])]
        found = fused(*clouds, voxel_size=size, existence=0.01)
        assert existence(found) == pytest.approx(0.9, abs=1e-6)
        assert len(found.field.entries.keys) == 1 or size < 0.02


def test_of_several_contacts_the_likeliest_of_a_voxel_tells_whether_there_is_one() -> None:
    assert existence(fused(cloud("a", 0.0, (A, 0.3), (B, 0.6)))) == pytest.approx(0.6)


# What holds for all clouds: the same, by a table that is written row by row

Table = dict[tuple[str, Voxel], tuple[float, float, FloatArray, float]]
"""The likelihood, the stamp, Σpx and Σp of each entry."""
LIFE, QUICK = 0.5, 0.25


def written(
    table: Table, step: Sequence[HypothesisCloud], now: float, replaces: bool, by_voxel: bool
) -> Table:
    table = dict(table)
    for source in "ab":
        clouds = [one for one in step if one.source == source]
        if replaces and clouds and source == "b":
            clouds = clouds[-1:]
            table = {key: entry for key, entry in table.items() if key[0] != source}
        for one in clouds:
            rows = zip(one.positions, one.likelihoods.astype(np.float32).tolist(), strict=True)
            for place, p in rows:
                key = source, voxel_of((place[0], place[1], place[2]))
                most, stamp, moment, total = table.get(key, (0.0, 0.0, np.zeros(3), 0.0))
                newer = most == 0.0 or one.stamp > stamp
                if newer:
                    most, moment, total = 0.0, np.zeros(3), 0.0
                if p or newer:
                    table[key] = max(most, p), one.stamp, moment + p * place, total + p
    table = {key: entry for key, entry in table.items() if entry[0] > 0.0}
    if by_voxel:
        newest: dict[Voxel, float] = {}
        for (_, voxel), (_, stamp, _, _) in table.items():
            newest[voxel] = max(newest.get(voxel, stamp), stamp)
        return {key: one for key, one in table.items() if now - newest[key[1]] <= LIFE + 1e-9}
    lives = {"a": LIFE, "b": QUICK}
    return {key: one for key, one in table.items() if now - one[1] <= lives[key[0]] + 1e-9}


coordinate = st.sampled_from((-0.0032, -0.0001, 0.0, 0.0017, 0.0049, 0.0077))
rows_of = st.lists(
    st.tuples(
        st.tuples(coordinate, coordinate, st.just(0.001)), st.sampled_from((0.0, 0.1, 0.4, 1.0))
    ),
    max_size=12,
)
arrivals = st.lists(
    st.tuples(st.sampled_from("ab"), st.sampled_from((0.0, 0.125)), rows_of), max_size=4
)


@given(
    steps=st.lists(arrivals, min_size=1, max_size=5),
    replaces=st.booleans(),
    by_voxel=st.booleans(),
    forces=st.booleans(),
)
def test_places_are_those_of_a_table_that_is_written_row_by_row(
    steps: list[list[tuple[str, float, list[Row]]]], replaces: bool, by_voxel: bool, forces: bool
) -> None:
    one = integrator(timeout=LIFE, expiry="voxel" if by_voxel else "source")
    one.plug("a", HypothesisKind.REGULAR)
    one.plug("b", HypothesisKind.REGULAR, timeout=QUICK, replace=replaces)
    table: Table = {}
    for number, arriving in enumerate(steps):
        now = 0.25 * number
        clouds = []
        for source, lag, rows in sorted(arriving, key=lambda arrival: -arrival[1]):
            felt = {"forces": np.ones((len(rows), 3))} if forces and source == "a" else {}
            clouds.append(cloud(source, now - lag, *rows, **felt))
            one.receive(clouds[-1])
        table = written(table, clouds, now, replaces, by_voxel)
        entries = one.step(now).field.entries
        found = places(entries)
        assert set(found) == set(table)
        for key, (_, _, moment, total) in table.items():
            assert found[key] == pytest.approx(moment / total, abs=1e-9)
        sums = {key: entry[3] for key, entry in table.items()}
        kept = dict(zip(found, entries.columns.offsets[:, 3].tolist(), strict=True))
        assert kept == pytest.approx(sums, rel=1e-6)
