"""The condensation `modes`: contacts are the modes of a belief."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from contactfusion import Contact, Fusion, HypothesisCloud
from contactfusion.arrays import FloatArray
from contactfusion.surface import Surface
from contactfusion_lab.baselines.posterior import belief_of
from lab.tests import baseline_steps
from tests.clouds import HERE, NULL, REGULAR, SIDE, SUPPORT, THERE, Voxel, centres, cloud

FLOOR = 0.02
MIDDLE: Voxel = (1, 0, 0)
few = settings(max_examples=40)


def fused(*clouds: HypothesisCloud, **config: Any) -> Fusion:
    return baseline_steps.fused(*clouds, **{"floor": FLOOR, **config})


def contacts_of(likelihoods: dict[Voxel, float], **config: Any) -> tuple[Contact, ...]:
    return fused(cloud("a", 0.0, likelihoods), **config).contacts


def only(*clouds: HypothesisCloud, **config: Any) -> Contact:
    (contact,) = fused(*clouds, **config).contacts
    return contact


def line(count: int, first: int = 0, p: float = 0.9) -> dict[Voxel, float]:
    return {(first + x, 0, 0): p for x in range(count)}


def places(contacts: tuple[Contact, ...]) -> FloatArray:
    return np.array([contact.position for contact in contacts])


# Whether


def test_without_entries_there_is_no_contact() -> None:
    assert fused().contacts == ()
    assert fused(cloud("a", 0.0, {}), cloud("free", 0.0, {HERE: 1.0}, NULL)).contacts == ()


def test_prediction_alone_is_no_contact() -> None:
    assert fused(cloud("motion", 0.0, {HERE: 1.0}, SUPPORT)).contacts == ()


@pytest.mark.parametrize(("existence", "count"), [(0.74, 1), (0.76, 0)])
def test_a_contact_is_told_from_a_probability_of_existence(existence: float, count: int) -> None:
    clouds = [cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {HERE: 0.5})]
    assert len(fused(*clouds, existence=existence).contacts) == count


@pytest.mark.parametrize("p", [0.6, 0.7, 0.9, 0.95])
def test_a_probability_that_is_the_least_is_enough_however_it_is_rounded(p: float) -> None:
    assert len(contacts_of({HERE: p}, existence=p)) == 1


def test_one_contact_spread_over_twelve_voxels_is_found_with_all_its_probability() -> None:
    twelve = {(x, y, 0): 0.9 / 12 for x in range(4) for y in range(3)}
    contact = only(cloud("wrench", 0.0, twelve, single=True))
    assert contact.likelihood == pytest.approx(0.9)
    assert contact.position == pytest.approx(np.array([2.0, 1.5, 0.5]) * SIDE, abs=1e-5)


def test_null_takes_a_contact_away_that_is_not_sure_and_leaves_one_that_is() -> None:
    free = cloud("free", 0.0, {HERE: 1.0}, NULL)
    assert fused(cloud("a", 0.0, {HERE: 0.9}), free).contacts == ()
    assert only(cloud("a", 0.0, {HERE: 1.0}), free).likelihood == 1.0


def test_null_moves_a_contact_away() -> None:
    evidence = cloud("a", 0.0, line(3))
    free = cloud("free", 0.0, {HERE: 1.0}, NULL)
    assert only(evidence).position[0] == pytest.approx(1.5 * SIDE, abs=1e-5)
    assert only(evidence, free).position[0] > 1.8 * SIDE


# Where


def test_two_sources_that_are_two_voxels_apart_meet_in_the_middle() -> None:
    clouds = [cloud("a", 0.0, {HERE: 0.9}), cloud("b", 0.0, {(2, 0, 0): 0.9})]
    contact = only(*clouds)
    assert contact.position == pytest.approx(centres([MIDDLE])[0], abs=1e-5)
    assert contact.likelihood == pytest.approx(0.99)


def test_a_line_within_a_basin_is_one_contact_with_its_ends_in_its_middle() -> None:
    for count in range(2, 10):
        contact = only(cloud("skin", 0.0, line(count)))
        assert contact.position == pytest.approx([count / 2 * SIDE, SIDE / 2, SIDE / 2], abs=5e-4)
        ends = contact.extent[np.argsort(contact.extent[:, 0])]
        assert ends == pytest.approx(centres([HERE, (count - 1, 0, 0)]), abs=1e-9)
        assert contact.voxels == count and contact.likelihood == pytest.approx(0.9)


def test_a_place_under_a_tenth_of_the_heaviest_is_no_end() -> None:
    row = {**line(3), (4, 0, 0): 0.05}
    contact = only(cloud("skin", 0.0, row))
    assert contact.extent[:, 0].max() == pytest.approx(2.5 * SIDE) and contact.voxels == 4


def test_two_distant_places_of_two_sources_are_two_contacts() -> None:
    found = fused(cloud("a", 0.0, {HERE: 0.9}), cloud("b", 0.0, {THERE: 0.9})).contacts
    assert places(found) == pytest.approx(centres([HERE, THERE]))
    assert [contact.likelihood for contact in found] == pytest.approx([0.99 / 2] * 2)


@pytest.mark.parametrize(("mode_share", "count"), [(0.15, 3), (0.25, 2), (0.35, 1)])
def test_a_further_contact_needs_its_share_of_the_belief(mode_share: float, count: int) -> None:
    rows = {HERE: 0.9, THERE: 0.53, (80, 0, 0): 0.33}  # weights near 51, 30 and 19 %
    found = contacts_of(rows, mode_share=mode_share)
    assert places(found) == pytest.approx(centres(rows)[:count])


def test_no_more_than_eight_contacts_are_told() -> None:
    many = {(30 * x, 0, 0): 0.9 for x in range(12)}
    assert len(contacts_of(many, mode_share=0.01)) == 8


def test_contacts_come_by_falling_likelihood_however_sharp_they_are() -> None:
    wide = {(x, 40, 0): 0.8 for x in range(-4, 5)}
    block = {(x, y, 0): 0.9 for x in range(2) for y in range(3)}
    found = contacts_of({**wide, **block}, mode_share=0.2)
    likelihoods = [contact.likelihood for contact in found]
    assert len(found) == 2 and likelihoods == sorted(likelihoods, reverse=True)
    assert found[0].voxels == 9 and sum(likelihoods) == pytest.approx(0.9)


def test_equal_contacts_come_by_first_voxel() -> None:
    rows = {(x, 0, 0): 0.9 for x in (60, 30, -30)}
    found = contacts_of(rows, mode_share=0.2)
    assert places(found) == pytest.approx(centres(sorted(rows)))


def test_what_belongs_to_one_contact_belongs_to_no_other() -> None:
    found = contacts_of({**line(20), **line(20, first=30)}, mode_share=0.3)
    assert len(found) == 2
    assert [contact.voxels for contact in found] == [20, 20]
    assert [contact.likelihood for contact in found] == pytest.approx([0.45, 0.45])
    low, high = sorted(tuple(sorted(c.extent[:, 0])) for c in found)
    assert low == pytest.approx((0.5 * SIDE, 19.5 * SIDE))
    assert high == pytest.approx((30.5 * SIDE, 49.5 * SIDE))


# A line, and two places


@pytest.mark.parametrize("count", [20, 21, 40])
@pytest.mark.parametrize("axis", range(3))
def test_a_line_of_voxels_is_one_contact_with_all_of_the_likelihood(count: int, axis: int) -> None:
    x, y, z = (tuple(np.roll([1, 0, 0], axis) * i) for i in (0, 1, count - 1))
    row: dict[Voxel, float] = {tuple(np.roll([i, 0, 0], axis).tolist()): 0.9 for i in range(count)}
    contact = only(cloud("skin", 0.0, row))
    ends = contact.extent[np.argsort(contact.extent[:, axis])]
    assert ends == pytest.approx(centres([x, z]), abs=1e-9)
    assert contact.position == pytest.approx(ends.mean(axis=0), abs=5e-4)
    assert contact.likelihood == pytest.approx(0.9) and contact.voxels == count
    assert contact.dispersion == pytest.approx(SIDE * math.sqrt((count**2 - 1) / 12.0), rel=0.01)


X, Y, _ = np.eye(3)
TABLE = Surface.rectangle("base", np.zeros(3), 0.15 * X, 0.15 * Y, 0.004)
angles = st.floats(0.0, 2.0 * math.pi)
lengths = st.floats(0.1, 0.2)
middles = st.tuples(*[st.floats(-0.02, 0.02)] * 2)


def drawn(
    along: FloatArray, length: float, middle: FloatArray, pitch: float, spread: float = 0.004
) -> HypothesisCloud:
    """Give a line of hypotheses so far apart."""
    count = round(length / pitch) + 1
    offsets = np.linspace(-length / 2.0, length / 2.0, count)
    positions = middle + np.outer(offsets, along)
    return measured("skin", positions, np.full(count, 0.9), spread)


def measured(
    source: str, positions: FloatArray, likelihoods: FloatArray, spread: float = 0.004
) -> HypothesisCloud:
    spreads = np.full(len(positions), spread)
    return HypothesisCloud(
        source, REGULAR, 0.0, "base", positions, likelihoods, None, spreads=spreads
    )


def on(surface: Surface | None, *clouds: HypothesisCloud, **config: Any) -> tuple[Contact, ...]:
    return fused(*clouds, surface=surface, **config).contacts


@few
@given(angle=angles, length=lengths, middle=middles, pitch=st.floats(0.003, 0.006))
def test_a_line_on_a_surface_is_one_contact_in_its_middle_in_any_direction(
    angle: float, length: float, middle: tuple[float, float], pitch: float
) -> None:
    along = np.array([math.cos(angle), math.sin(angle), 0.0])
    centre = np.array([*middle, 0.0])
    (contact,) = on(TABLE, drawn(along, length, centre, pitch))
    assert np.linalg.norm(contact.position - centre) < 0.004
    assert 0.85 < contact.likelihood <= 0.9
    reach = np.sort((contact.extent - centre) @ along)
    assert reach == pytest.approx([-length / 2.0, length / 2.0], abs=0.008)


COARSE = Surface.rectangle("base", np.zeros(3), 0.3 * X, 0.3 * Y, 0.0125)


@few
@given(angle=angles, length=st.floats(0.2, 0.4), middle=middles)
def test_a_line_on_a_coarse_surface_is_one_contact_with_its_ends(
    angle: float, length: float, middle: tuple[float, float]
) -> None:
    """Points 12.5 mm apart: the lengths by which places hang together grow with them."""
    along = np.array([math.cos(angle), math.sin(angle), 0.0])
    centre = np.array([*middle, 0.0])
    pressed = drawn(along, length, centre, 0.0125, spread=0.0125)
    (contact,) = on(COARSE, pressed, voxel_size=0.0125)
    assert np.linalg.norm(contact.position - centre) < 0.01
    assert contact.likelihood > 0.8
    reach = np.sort((contact.extent - centre) @ along)
    assert reach == pytest.approx([-length / 2.0, length / 2.0], abs=0.02)


def test_a_line_of_coarse_voxels_without_a_surface_is_one_contact() -> None:
    row = line(12)
    (contact,) = fused(cloud("skin", 0.0, row, side=0.0125), voxel_size=0.0125).contacts
    assert contact.voxels == 12 and contact.likelihood == pytest.approx(0.9)
    assert np.ptp(contact.extent[:, 0]) == pytest.approx(11 * 0.0125)


directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


@few
@given(direction=directions, length=lengths, pitch=st.floats(0.003, 0.006))
def test_a_line_without_a_surface_is_one_contact_with_its_ends_in_any_direction(
    direction: tuple[float, float, float], length: float, pitch: float
) -> None:
    along = np.array(direction) / np.linalg.norm(direction)
    (contact,) = on(None, drawn(along, length, np.zeros(3), pitch))
    assert contact.likelihood == pytest.approx(0.9, abs=1e-6)
    reach = np.sort(contact.extent @ along)
    assert reach == pytest.approx([-length / 2.0, length / 2.0], abs=0.004)
    off = contact.position - (contact.position @ along) * along
    assert np.linalg.norm(off) < 0.002


@settings(max_examples=100, phases=[Phase.generate])
@given(direction=directions, length=lengths, pitch=st.floats(0.003, 0.006))
def test_a_line_without_a_surface_is_one_contact_in_its_middle_in_any_direction(
    direction: tuple[float, float, float], length: float, pitch: float
) -> None:
    along = np.array(direction) / np.linalg.norm(direction)
    (contact,) = on(None, drawn(along, length, np.zeros(3), pitch))
    assert np.linalg.norm(contact.position) < 0.005


def blob(source: str, centre: FloatArray, p: float) -> HypothesisCloud:
    """Give nine taxels around a place."""
    x, y = np.meshgrid([-0.0045, 0.0, 0.0045], [-0.0045, 0.0, 0.0045])
    offsets = np.stack([x.ravel(), y.ravel(), np.zeros(9)], axis=1)
    return measured(source, centre + offsets, np.full(9, p))


@few
@given(angle=angles, middle=middles)
def test_two_places_six_centimetres_apart_stay_two_when_each_has_its_share(
    angle: float, middle: tuple[float, float]
) -> None:
    away = 0.03 * np.array([math.cos(angle), math.sin(angle), 0.0])
    centre = np.array([*middle, 0.0])
    clouds = [blob("left", centre - away, 0.8), blob("right", centre + away, 0.8)]
    found = on(TABLE, *clouds, mode_share=0.4)
    assert len(found) == 2
    truths = np.array([centre - away, centre + away])
    nearest = [int(np.linalg.norm(truths - c.position, axis=1).argmin()) for c in found]
    assert sorted(nearest) == [0, 1]
    for contact, one in zip(found, nearest, strict=True):
        assert np.linalg.norm(contact.position - truths[one]) < 0.004
        assert 0.4 * 0.96 <= contact.likelihood <= 0.6
        name = ("left", "right")[one]
        assert contact.shares[name] > 0.9


def test_two_places_in_the_air_share_by_their_voxels() -> None:
    square = [(x, y, 0) for x in range(3) for y in range(3)]
    both: dict[Voxel, float] = {(x + far, y, z): 0.9 for x, y, z in square for far in (0, 12)}
    found = contacts_of(both, mode_share=0.4)
    assert places(found) == pytest.approx(centres([(1, 1, 0), (13, 1, 0)]), abs=1e-5)
    assert [contact.likelihood for contact in found] == pytest.approx([0.45, 0.45])


def test_of_two_places_one_that_has_less_than_its_share_is_no_contact() -> None:
    away = np.array([0.03, 0.0, 0.0])
    both = np.concatenate([blob("skin", side, 1.0).positions for side in (-away, away)])
    uneven = measured("skin", both, np.repeat([0.9, 0.3], 9))
    (contact,) = on(TABLE, uneven, mode_share=0.4)
    assert contact.position == pytest.approx(-away, abs=0.003)
    assert len(on(TABLE, uneven, mode_share=0.2)) == 2


# What a contact carries


def test_the_covariance_is_that_of_the_belief_beside_that_of_a_voxel() -> None:
    contact = only(cloud("a", 0.0, line(3)))
    expected = (np.diag([2.0 / 3.0, 0.0, 0.0]) + np.eye(3) / 12.0) * SIDE**2
    assert contact.covariance == pytest.approx(expected, abs=1e-10)
    assert contact.dispersion == pytest.approx(math.sqrt(2.0 / 3.0) * SIDE, abs=1e-8)


def test_the_covariance_of_one_voxel_is_that_of_a_cube() -> None:
    contact = only(cloud("a", 0.0, {HERE: 0.9}))
    assert contact.covariance == pytest.approx(np.eye(3) * SIDE**2 / 12.0)
    assert contact.dispersion == 0.0
    assert contact.extent == pytest.approx(centres([HERE, HERE]))


@pytest.mark.parametrize("spread", [0.0004, 0.02])
def test_without_a_surface_the_covariance_holds_the_spreads_of_the_hypotheses(
    spread: float,
) -> None:
    contact = only(cloud("a", 0.0, {HERE: 0.9}, spreads=np.array([spread])))
    assert contact.covariance == pytest.approx(np.eye(3) * (spread**2 + SIDE**2 / 12.0))


def test_over_a_surface_the_belief_alone_is_as_wide_as_the_spreads() -> None:
    (contact,) = on(TABLE, measured("a", np.zeros((1, 3)), np.array([0.9]), 0.008))
    across = np.sqrt(contact.covariance[0, 0])
    assert 0.008 < across < 0.012
    assert contact.covariance[2, 2] == pytest.approx(SIDE**2 / 12.0)


def test_the_shares_are_what_each_source_adds_null_and_silence_apart() -> None:
    contact = only(
        cloud("a", 0.0, {HERE: 0.9}),
        cloud("b", 0.0, {HERE: 0.9}),
        cloud("far", 0.0, {THERE: 0.1}, SUPPORT),
        cloud("free", 0.0, {THERE: 0.9}, NULL),
        cloud("silent", 0.0, {}),
    )
    assert contact.shares == pytest.approx({"a": 0.5, "b": 0.5, "far": 0.0, "silent": 0.0})


def test_a_source_has_its_share_in_its_own_contact_only() -> None:
    clouds = [cloud("a", 0.0, {HERE: 0.9}), cloud("b", 0.0, {THERE: 0.9})]
    first, second = fused(*clouds).contacts
    assert first.shares == pytest.approx({"a": 1.0, "b": 0.0})
    assert second.shares == pytest.approx({"a": 0.0, "b": 1.0})


def test_the_force_is_that_of_the_nearest_voxel_that_has_one() -> None:
    felt = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
    wrench = cloud("wrench", 0.0, {(3, 0, 0): 0.1, (9, 0, 0): 0.1}, forces=felt)
    assert only(cloud("skin", 0.0, {HERE: 0.9}), wrench).force.tolist() == [1.0, 0.0, 0.0]


def test_without_a_force_there_is_none() -> None:
    pushed = cloud("motion", 0.0, {HERE: 0.9}, SUPPORT, forces=[[9.0, 9.0, 9.0]])
    assert np.isnan(only(cloud("a", 0.0, {HERE: 0.9}), pushed).force).all()


def test_the_stamp_is_that_of_the_newest_entry() -> None:
    clouds = [cloud("a", 0.25, {HERE: 0.9}), cloud("b", 0.125, {HERE: 0.9})]
    contact = only(*clouds, now=0.25)
    assert (contact.stamp, contact.frame) == (0.25, "base")


def test_a_force_that_was_felt_far_from_a_contact_is_not_its_own() -> None:
    for away, felt in ((3, True), (5, False), (40, False)):  # 20 mm end at the fourth voxel
        wrench = cloud("wrench", 0.0, {(away, 0, 0): 0.01}, forces=np.ones((1, 3)))
        skin = cloud("skin", 0.0, {HERE: 0.9}), cloud("more", 0.0, {HERE: 0.9})
        contact = fused(*skin, wrench).contacts[0]
        assert contact.position == pytest.approx(centres([HERE])[0], abs=1e-3)
        assert np.isfinite(contact.force).tolist() == [felt] * 3


def test_each_of_two_contacts_has_the_force_that_was_felt_in_it() -> None:
    push, pull = np.array([[0.0, 0.0, -5.0]]), np.array([[0.0, 4.0, 0.0]])
    clouds = [
        cloud("a", 0.0, {HERE: 0.9}, forces=push),
        cloud("b", 0.0, {THERE: 0.9}, forces=pull),
        cloud("c", 0.0, {(80, 0, 0): 0.9}),
    ]
    found = fused(*clouds, mode_share=0.2).contacts
    assert [contact.force.tolist() for contact in found[:2]] == [push[0].tolist(), pull[0].tolist()]
    assert np.isnan(found[2].force).all()


def test_the_stamp_is_that_of_the_newest_source_that_has_a_part_in_the_contact() -> None:
    clouds = [
        cloud("a", 0.0, {HERE: 0.9}),
        cloud("b", 0.25, {THERE: 0.9}),
        cloud("free", 0.375, {HERE: 0.1}, NULL),
        cloud("motion", 0.125, {HERE: 0.3}, SUPPORT),
        cloud("silent", 0.375, {}),
    ]
    found = fused(*clouds, now=0.375, mode_share=0.01).contacts
    stamps = {tuple(contact.position.round(4)): contact.stamp for contact in found}
    assert stamps == {(0.0025, 0.0025, 0.0025): 0.125, (0.2025, 0.0025, 0.0025): 0.25}


# What is worked out when somebody looks


def test_modes_are_found_without_the_likelihoods_of_voxels() -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 0.9}))
    assert fusion.contacts and "likelihoods" not in vars(fusion.field)
    assert fusion.space.likelihoods.tolist() == pytest.approx([0.9])
    assert "likelihoods" in vars(fusion.field)


def test_modes_never_ask_for_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> FloatArray:
        raise AssertionError("nobody looked")

    monkeypatch.setattr("contactfusion_lab.baselines.posterior._by_voxel", fail)
    fusion = fused(cloud("a", 0.0, {HERE: 0.9}), cloud("motion", 0.0, {THERE: 0.9}, SUPPORT))
    assert len(fusion.contacts) == 1 and len(fusion.without("motion").contacts) == 1
    with pytest.raises(AssertionError, match="nobody looked"):
        _ = fusion.space


def test_looking_at_the_space_changes_no_contact() -> None:
    clouds = [cloud("a", 0.0, line(3)), cloud("b", 0.0, {THERE: 0.3})]
    looked, blind = fused(*clouds), fused(*clouds)
    assert looked.space is looked.space
    assert [c.position.tobytes() for c in looked.contacts] == [
        c.position.tobytes() for c in blind.contacts
    ]


def test_a_contact_cannot_be_written() -> None:
    contact = only(cloud("a", 0.0, line(2), forces=np.ones((2, 3))))
    for array in (contact.position, contact.covariance, contact.extent, contact.force):
        assert not array.flags.writeable


# What holds for all clouds

voxel = st.tuples(st.integers(-2, 2), st.integers(-1, 1), st.integers(0, 1))
rows = st.dictionaries(
    st.one_of(voxel, st.sampled_from([THERE, (0, -40, 0)])),
    st.sampled_from((0.1, 0.3, 0.5, 0.9)),
    min_size=1,
    max_size=8,
)


@few
@given(first=rows, second=rows, third=rows, kind=st.sampled_from([REGULAR, SUPPORT, NULL]))
def test_contacts_share_the_belief_and_lie_among_its_places(
    first: dict[Voxel, float],
    second: dict[Voxel, float],
    third: dict[Voxel, float],
    kind: Any,
) -> None:
    clouds = [cloud("a", 0.0, first), cloud("b", 0.0, second), cloud("c", 0.0, third, kind)]
    fusion = fused(*clouds, mode_share=0.05, existence=0.01)
    belief = belief_of(fusion.field)
    assert belief is not None and fusion.contacts
    assert sum(contact.likelihood for contact in fusion.contacts) <= belief.exists + 1e-9
    low, high = belief.places.min(axis=0), belief.places.max(axis=0)
    for contact in fusion.contacts:
        assert (contact.position >= low - 1e-9).all() and (contact.position <= high + 1e-9).all()
        assert np.linalg.eigvalsh(contact.covariance).min() >= SIDE**2 / 12.0 * (1.0 - 1e-9)
        assert sum(contact.shares.values()) == pytest.approx(1.0)
        assert min(contact.shares.values()) >= 0.0


@few
@given(
    first=rows,
    second=rows,
    p=st.sampled_from((0.01, 0.3, 0.9)),
    spread=st.sampled_from((0.0, 0.005)),
)
def test_more_evidence_at_the_place_of_a_contact_never_lowers_its_likelihood(
    first: dict[Voxel, float], second: dict[Voxel, float], p: float, spread: float
) -> None:
    clouds = [cloud("a", 0.0, first), cloud("b", 0.0, second)]
    before = fused(*clouds, existence=0.01)
    belief, contact = belief_of(before.field), before.contacts[0]
    assert belief is not None
    nearest = belief.places[((belief.places - contact.position) ** 2).sum(axis=1).argmin()]
    x, y, z = np.floor(nearest / SIDE).astype(int).tolist()
    more = cloud("more", 0.0, {(x, y, z): p}, spreads=np.array([spread]))
    after = fused(*clouds, more, existence=0.01).contacts[0]
    assert after.likelihood >= contact.likelihood - 1e-9
