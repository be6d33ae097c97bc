"""Condensations: from voxels to contacts."""

import itertools
import math
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from contactfusion import Contact, Fusion, HypothesisCloud, Integrator, IntegratorConfig
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from tests.clouds import HERE, NULL, SIDE, SUPPORT, THERE, Voxel, centres, cloud
from tests.clouds import fused as fused_by

WIDE = 0.125
"""The side of the voxels of tests that reach to the ends of the space [m]; exact in binary."""


def fused(*clouds: HypothesisCloud, now: float = 0.0, **config: Any) -> Fusion:
    return fused_by(*clouds, now=now, **{"rule": "de_morgan", **config})


def contacts_of(likelihoods: dict[Voxel, float], **config: Any) -> tuple[Contact, ...]:
    return fused(cloud("a", 0.0, likelihoods), **config).contacts


def only(fusion: Fusion) -> Contact:
    (contact,) = fusion.contacts
    return contact


# threshold


def test_threshold_makes_each_voxel_a_contact_of_its_own() -> None:
    voxels: dict[Voxel, float] = {HERE: 0.75, (1, 0, 0): 0.5, (2, 0, 0): 0.875}
    found = contacts_of(voxels, condensation="threshold", threshold=0.6)
    assert [contact.likelihood for contact in found] == [0.875, 0.75]
    assert np.array_equal([contact.position for contact in found], centres([(2, 0, 0), HERE]))
    for contact in found:
        assert (contact.voxels, contact.dispersion, contact.shares) == (1, 0.0, {"a": 1.0})
        assert np.array_equal(contact.extent, [contact.position] * 2)


@pytest.mark.parametrize("condensation", ["threshold", "cluster_centroid"])
def test_what_was_nulled_or_only_predicted_is_no_contact(condensation: str) -> None:
    fusion = fused(
        cloud("skin", 0.0, {HERE: 0.9}),
        cloud("free", 0.0, {HERE: 0.1}, NULL),
        cloud("motion", 0.0, {HERE: 0.9, (1, 0, 0): 0.9}, SUPPORT),
        condensation=condensation,
    )
    assert fusion.contacts == ()


# cluster_centroid: which voxels belong together


@pytest.mark.parametrize(
    ("offset", "tolerance", "clusters"),
    [
        ((2, 0, 0), None, 1),
        ((0, -2, 0), None, 1),
        ((1, 1, 1), None, 1),
        ((2, 1, 0), None, 2),
        ((0, 0, 3), None, 2),
        ((3, 0, 0), 3 * SIDE, 1),
        ((3, 1, 0), 3 * SIDE, 2),
        ((2, 2, 1), 3 * SIDE, 1),
        ((1, 1, 0), math.sqrt(2) * SIDE, 1),
        ((1, 1, 1), math.sqrt(2) * SIDE, 2),
        ((1, 0, 0), 0.99 * SIDE, 2),
        ((1, 0, 0), SIDE, 1),
        ((1, 0, 0), 1e-9, 2),
        ((100, 0, 0), 100 * SIDE, 1),
        ((100, 1, 0), 100 * SIDE, 2),
    ],
)
def test_voxels_belong_together_up_to_exactly_the_tolerance(
    offset: Voxel, tolerance: float | None, clusters: int
) -> None:
    assert len(contacts_of({HERE: 0.5, offset: 0.5}, tolerance=tolerance)) == clusters


def test_a_chain_is_one_contact_however_long_and_a_gap_makes_two() -> None:
    chain: dict[Voxel, float] = {(2 * i, 0, 0): 0.5 for i in range(30)}
    assert len(contacts_of(chain)) == 1
    del chain[(20, 0, 0)]
    assert [contact.voxels for contact in contacts_of(chain)] == [10, 19]


def test_a_voxel_under_the_threshold_is_no_bridge() -> None:
    ends: dict[Voxel, float] = {HERE: 0.5, (4, 0, 0): 0.5}
    assert len(contacts_of({**ends, (2, 0, 0): 0.5})) == 1
    assert len(contacts_of({**ends, (2, 0, 0): 0.05})) == 2


def test_voxels_belong_together_across_zero() -> None:
    block = itertools.product((-1, 0), repeat=3)
    assert len(contacts_of({(x, y, z): 0.5 for x, y, z in block})) == 1


@pytest.mark.parametrize("corner", list(itertools.product((-1, 1), repeat=3)))
def test_voxels_at_opposite_ends_of_the_space_do_not_meet(corner: Voxel) -> None:
    far = (1 << 20) - 1
    x, y, z = (far - 1) * corner[0], far * corner[1], far * corner[2]
    ends: dict[Voxel, float] = {(x, y, z): 0.5, (x, y, -z): 0.5, (x, -y, z): 0.5}
    fusion = fused(cloud("a", 0.0, ends, side=WIDE), voxel_size=WIDE, tolerance=3.0 * WIDE)
    assert len(fusion.contacts) == 3


def test_a_tolerance_wider_than_the_scene_makes_one_contact() -> None:
    assert len(contacts_of({HERE: 0.5, (150, 9, 0): 0.5}, tolerance=1.0)) == 1


@pytest.mark.parametrize("tolerance", [100.0, 1e300])
def test_a_tolerance_beyond_all_measure_is_refused_or_costs_no_more(tolerance: float) -> None:
    contacts_of({HERE: 0.5})
    start = time.process_time()
    try:
        assert len(contacts_of({HERE: 0.5, THERE: 0.5}, tolerance=tolerance)) == 1
    except ConfigurationError as error:
        assert error.path == "tolerance"
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(("min_voxels", "sizes"), [(1, [3, 1]), (2, [3]), (3, [3]), (4, [])])
def test_clusters_of_too_few_voxels_are_no_contacts(min_voxels: int, sizes: list[int]) -> None:
    voxels: dict[Voxel, float] = {HERE: 0.5, (1, 0, 0): 0.5, (2, 0, 0): 0.5, THERE: 0.5}
    found = contacts_of(voxels, min_voxels=min_voxels)
    assert [contact.voxels for contact in found] == sizes


def brute_force(voxels: list[Voxel], reach_squared: float) -> list[list[int]]:
    """Join every pair that is near enough; give the members of each cluster, by first voxel."""
    label = list(range(len(voxels)))
    for i, j in itertools.combinations(range(len(voxels)), 2):
        if sum((a - b) ** 2 for a, b in zip(voxels[i], voxels[j], strict=True)) <= reach_squared:
            old, new = label[j], label[i]
            label = [new if one == old else one for one in label]
    groups: dict[int, list[int]] = {}
    for row, one in enumerate(label):
        groups.setdefault(one, []).append(row)
    return list(groups.values())


index = st.integers(-6, 6)


@settings(max_examples=150)
@given(
    voxels=st.sets(st.tuples(index, index, index), min_size=1, max_size=40),
    sides=st.one_of(st.integers(0, 30).map(math.sqrt), st.floats(0.1, 5.0)),
    corner=st.sampled_from([(0, 0, 0), (-(1 << 20) + 7, 0, 0), (5, (1 << 20) - 7, -9)]),
)
@example(voxels={HERE}, sides=2.0, corner=HERE)
def test_clusters_are_those_of_joining_every_pair(
    voxels: set[Voxel], sides: float, corner: Voxel
) -> None:
    rows = sorted((x + corner[0], y + corner[1], z + corner[2]) for x, y, z in voxels)
    weights = {voxel: 0.5 + n / 256 for n, voxel in enumerate(rows)}
    tolerance = max(sides, 1e-3)
    expected = brute_force(rows, math.floor(tolerance**2 + 1e-6))
    scaled = {"voxel_size": WIDE, "tolerance": tolerance * WIDE}
    fusion = fused(cloud("a", 0.0, weights, side=WIDE), **scaled)
    wanted = sorted(
        (max(weights[rows[i]] for i in members), len(members), *_centroid(rows, weights, members))
        for members in expected
    )
    found = sorted((c.likelihood, c.voxels, *c.position.tolist()) for c in fusion.contacts)
    assert np.allclose(found, wanted, rtol=0.0, atol=1e-8)


def _centroid(rows: list[Voxel], weights: dict[Voxel, float], members: list[int]) -> FloatArray:
    chosen = [rows[i] for i in members]
    centroid: FloatArray = np.average(
        centres(chosen, WIDE), axis=0, weights=[weights[voxel] for voxel in chosen]
    )
    return centroid


# cluster_centroid: what a contact carries


LINE: dict[Voxel, float] = {(0, 0, 0): 0.25, (0, 1, 0): 0.5, (0, 3, 0): 0.25}


def test_a_contact_lies_at_the_centroid_weighted_by_likelihood() -> None:
    contact = only(fused(cloud("a", 0.0, LINE)))
    assert contact.position == pytest.approx([0.0025, (0.5 + 1.25) * SIDE, 0.0025])
    assert (contact.likelihood, contact.voxels, contact.frame) == (0.5, 3, "base")


def test_the_dispersion_is_the_weighted_distance_from_the_centroid() -> None:
    variance = 0.25 * 1.25**2 + 0.5 * 0.25**2 + 0.25 * 1.75**2
    contact = only(fused(cloud("a", 0.0, LINE)))
    assert contact.dispersion == pytest.approx(math.sqrt(variance) * SIDE)


def test_the_covariance_of_a_line_lies_along_it_beside_that_of_a_voxel() -> None:
    contact = only(fused(cloud("a", 0.0, LINE)))
    variance = 0.25 * 1.25**2 + 0.5 * 0.25**2 + 0.25 * 1.75**2
    expected = (np.diag([0.0, variance, 0.0]) + np.eye(3) / 12) * SIDE**2
    assert contact.covariance == pytest.approx(expected, abs=1e-15)


def test_the_covariance_of_one_voxel_is_that_of_a_cube() -> None:
    contact = only(fused(cloud("a", 0.0, {HERE: 0.5})))
    assert contact.covariance == pytest.approx(np.eye(3) * SIDE**2 / 12)


@pytest.mark.parametrize("condensation", ["threshold", "cluster_centroid"])
def test_the_covariance_of_one_hypothesis_is_its_spread_beside_that_of_a_voxel(
    condensation: str,
) -> None:
    unsure = cloud("a", 0.0, {HERE: 0.5}, spreads=np.array([0.02]))
    contact = only(fused(unsure, condensation=condensation))
    assert contact.covariance == pytest.approx(np.eye(3) * (0.02**2 + SIDE**2 / 12))
    assert contact.dispersion == 0.0


def test_spreads_count_as_their_voxel_does_and_in_it_by_likelihood_null_apart() -> None:
    """De Morgan weighs the voxels by 0.75 and 0.5; in the first the sources count alike."""
    fusion = fused(
        cloud("a", 0.0, {HERE: 0.5, (0, 0, 1): 0.5}, spreads=np.array([0.03, 0.02])),
        cloud("b", 0.0, {HERE: 0.5}, SUPPORT, spreads=np.array([0.01])),
        cloud("free", 0.0, {THERE: 0.9}, NULL, spreads=np.array([0.5])),
    )
    variance = (0.75 * (0.03**2 + 0.01**2) / 2.0 + 0.5 * 0.02**2) / 1.25
    assert only(fusion).covariance[0, 0] == pytest.approx(variance + SIDE**2 / 12)


@given(
    voxels=st.dictionaries(
        st.tuples(*[st.integers(-2, 2)] * 3), st.sampled_from((0.2, 0.5, 0.9)), min_size=1
    ),
    spread=st.floats(0.0, 0.1),
)
def test_spreads_change_nothing_of_a_contact_but_the_diagonal_of_its_covariance(
    voxels: dict[Voxel, float], spread: float
) -> None:
    sharp = fused(cloud("a", 0.0, voxels))
    unsure = fused(cloud("a", 0.0, voxels, spreads=np.full(len(voxels), spread)))
    for one, other in zip(sharp.contacts, unsure.contacts, strict=True):
        for name in ("position", "extent"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        assert (one.likelihood, one.dispersion) == (other.likelihood, other.dispersion)
        wider = one.covariance + np.eye(3) * np.float32(spread).astype(float) ** 2
        assert other.covariance == pytest.approx(wider, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 1)])
def test_the_extent_of_a_line_are_the_centres_of_its_ends(direction: Voxel) -> None:
    x, y, z = direction
    line: list[Voxel] = [(n * x, n * y, n * z) for n in range(6)]
    voxels = dict.fromkeys(line, 0.5)
    contact = only(fused(cloud("a", 0.0, voxels)))
    ends = contact.extent[np.argsort(contact.extent @ direction)]
    assert ends == pytest.approx(centres([line[0], line[-1]]), abs=1e-9)


def test_the_force_of_a_contact_is_the_weighted_mean_over_its_voxels_that_have_one() -> None:
    fusion = fused(
        cloud("a", 0.0, {HERE: 0.25, (1, 0, 0): 0.75}, forces=[[4.0, 0, 0], [0, 8.0, 0]]),
        cloud("b", 0.0, {(2, 0, 0): 0.9}),
    )
    assert only(fusion).force == pytest.approx([1.0, 6.0, 0.0])


def test_a_contact_that_nobody_felt_has_no_force() -> None:
    clouds = [cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {THERE: 0.9}, forces=[[1, 2, 3]])]
    felt, unfelt = fused(*clouds).contacts
    assert felt.force.tolist() == [1.0, 2.0, 3.0] and np.isnan(unfelt.force).all()


def test_the_shares_are_what_each_source_gave_null_apart_and_sum_to_one() -> None:
    contact = only(
        fused(
            cloud("a", 0.0, {HERE: 0.5, (1, 0, 0): 0.25}),
            cloud("b", 0.0, {HERE: 0.5}),
            cloud("c", 0.0, {(1, 0, 0): 0.25, THERE: 0.9}, SUPPORT),
            cloud("d", 0.0, {THERE: 0.9}, NULL),
            cloud("e", 0.0, {}),
        )
    )
    assert contact.shares == pytest.approx({"a": 1 / 2, "b": 1 / 3, "c": 1 / 6, "e": 0})
    assert sum(contact.shares.values()) == pytest.approx(1.0)


def test_the_stamp_of_a_contact_is_that_of_its_newest_entry() -> None:
    clouds = [cloud("a", 0.25, {HERE: 0.5}), cloud("b", 0.125, {(1, 0, 0): 0.5})]
    assert only(fused(*clouds, now=0.25)).stamp == 0.25


def test_contacts_come_by_falling_likelihood_and_then_by_first_voxel() -> None:
    voxels: dict[Voxel, float] = {(x, 0, 0): p for x, p in ((30, 0.5), (0, 0.25), (60, 0.75))}
    found = contacts_of({**voxels, (-30, 0, 0): 0.5, (90, 0, 0): 0.5})
    order = [round(float(contact.position[0] / SIDE - 0.5)) for contact in found]
    assert order == [60, -30, 30, 90, 0]


def test_likelihoods_that_differ_by_rounding_only_do_not_change_the_order() -> None:
    found = contacts_of({(0, 0, 0): 0.5, (30, 0, 0): 0.5 + 1e-7})
    assert found[0].position[0] < found[1].position[0]


def test_a_far_cluster_is_as_precise_as_a_near_one() -> None:
    far = (1 << 20) - 10
    near, away = (
        only(
            fused(
                cloud("a", 0.0, {(at + x, at, at): 0.3 + 0.1 * x for x in range(4)}, side=WIDE),
                voxel_size=WIDE,
            )
        )
        for at in (0, far)
    )
    assert away.position - far * WIDE == pytest.approx(near.position, abs=1e-8)
    assert np.array_equal(away.covariance, near.covariance)


# All


@pytest.mark.parametrize("condensation", ["threshold", "cluster_centroid"])
def test_every_contact_is_made_of_voxels_of_the_space(condensation: str) -> None:
    rng = np.random.default_rng(0)
    voxels = {(int(x), int(y), int(z)): 0.9 for x, y, z in rng.integers(-9, 9, (200, 3))}
    fusion = fused(cloud("a", 0.0, voxels), condensation=condensation)
    assert sum(contact.voxels for contact in fusion.contacts) == len(voxels)
    low, high = fusion.space.positions.min(axis=0), fusion.space.positions.max(axis=0)
    for contact in fusion.contacts:
        assert (contact.position >= low - 1e-12).all() and (contact.position <= high + 1e-12).all()
        assert np.linalg.eigvalsh(contact.covariance).min() >= SIDE**2 / 12 * (1 - 1e-9)
        assert contact.dispersion >= 0.0 and sum(contact.shares.values()) == pytest.approx(1.0)


def test_the_contacts_of_a_step_are_a_tuple_that_stays() -> None:
    integrator = Integrator(IntegratorConfig())
    integrator.receive(cloud("a", 0.0, LINE))
    contacts = integrator.step(0.0).contacts
    before = [contact.position.copy() for contact in contacts]
    integrator.receive(cloud("a", 0.1, {(5, 5, 5): 1.0}))
    integrator.step(0.1)
    assert isinstance(contacts, tuple)
    assert np.array_equal(before, [contact.position for contact in contacts])
