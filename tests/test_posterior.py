"""The rule `posterior`: a product of fields tells where, existence tells whether (method §2)."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.arrays import FloatArray
from contactfusion.integrator.entries import Belief
from contactfusion.surface import Surface, rectangle
from tests.clouds import (
    HERE,
    NULL,
    REGULAR,
    SIDE,
    SUPPORT,
    THERE,
    Voxel,
    by_voxel,
    centres,
    contents,
    verdicts,
)
from tests.clouds import cloud as plain_cloud

FLOOR = 0.02
NEXT: Voxel = (1, 0, 0)
AFTER: Voxel = (2, 0, 0)
few = settings(max_examples=30)


def cloud(
    source: str,
    likelihoods: dict[Voxel, float],
    kind: HypothesisKind = REGULAR,
    spread: float = 0.0,
    **others: Any,
) -> HypothesisCloud:
    spreads = np.full(len(likelihoods), spread)
    return plain_cloud(source, 0.0, likelihoods, kind, spreads=spreads, **others)


def fused(*clouds: HypothesisCloud, surface: Surface | None = None, **config: Any) -> Fusion:
    fields = {"rule": "posterior", "condensation": "modes", "floor": FLOOR}
    integrator = Integrator(IntegratorConfig(**{**fields, **config}))
    for one in clouds:
        integrator.receive(one)
    return integrator.step(0.0, surface)


def belief(*clouds: HypothesisCloud, **others: Any) -> Belief:
    found = fused(*clouds, **others).field.belief
    assert found is not None
    return found


def weights(*clouds: HypothesisCloud, **others: Any) -> dict[Voxel, float]:
    """Give the weight of each place, by its voxel."""
    found = belief(*clouds, **others)
    voxels = np.floor(found.places / SIDE).astype(int).tolist()
    return {(x, y, z): w for (x, y, z), w in zip(voxels, found.weights.tolist(), strict=True)}


def bell(voxels: float, spread: float) -> float:
    """Give a Gaussian so many voxels from its middle; no spread is under 4 mm."""
    return math.exp(-0.5 * (voxels * SIDE / max(spread, 4e-3)) ** 2)


def tail(voxels: float, spread: float) -> float:
    """Give the tail of that Gaussian: a tenth as high, three times as wide."""
    return 0.1 * bell(voxels, 3.0 * max(spread, 4e-3))


def plate(height: float = 0.0) -> Surface:
    """Give a plate of 0.2 m by 0.2 m around the origin."""
    edges = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.1, 0.0])
    return rectangle("base", np.array([0.0, 0.0, height]), *edges, 0.004)


# One source


def test_one_hypothesis_takes_all_the_weight() -> None:
    assert weights(cloud("a", {HERE: 0.3})) == {HERE: 1.0}


def test_alternatives_of_one_contact_add_up() -> None:
    spread = 0.004
    next_to_it = bell(1, spread) + tail(1, spread)
    here = 0.6 * 1.1 + 0.3 * next_to_it
    there = 0.3 * 1.1 + 0.6 * next_to_it
    found = weights(cloud("a", {HERE: 0.6, NEXT: 0.3}, spread=spread, single=True))
    ratio = (1.0 + FLOOR) / (there / here + FLOOR)
    assert found[HERE] / found[NEXT] == pytest.approx(ratio, rel=1e-4)
    assert sum(found.values()) == pytest.approx(1.0)


def test_of_claims_of_several_contacts_the_strongest_counts() -> None:
    spread = 0.004
    there = max(0.3, 0.6 * bell(1, spread))
    found = weights(cloud("a", {HERE: 0.6, NEXT: 0.3}, spread=spread))
    assert found[HERE] / found[NEXT] == pytest.approx((1.0 + FLOOR) / (there / 0.6 + FLOOR))


def test_a_source_with_many_hypotheses_says_no_more_than_one_with_few() -> None:
    row: dict[Voxel, float] = {(x, 0, 0): 0.1 for x in range(10)}
    found = weights(cloud("many", row), cloud("few", {THERE: 0.1}))
    assert found[THERE] == pytest.approx(found[HERE])


def test_no_source_is_sharper_than_four_millimetres() -> None:
    blunt, sharp = (
        weights(cloud("a", {HERE: 0.5}, spread=s), cloud("b", {NEXT: 0.4, HERE: 0.1}))
        for s in (4e-3, 0.0)
    )
    assert sharp == pytest.approx(blunt, abs=1e-6)


def test_beyond_twelve_standard_deviations_nothing_but_the_floor_is_left() -> None:
    far = weights(cloud("a", {HERE: 0.5}, spread=0.004), cloud("b", {HERE: 0.5, THERE: 0.5}))
    assert far[HERE] / far[THERE] == pytest.approx((1.0 + FLOOR) / FLOOR)


# Several sources


def test_two_sources_that_are_a_voxel_apart_agree_on_the_place_between() -> None:
    spread = 0.005
    clouds = [
        cloud("a", {HERE: 0.5}, spread=spread),
        cloud("b", {AFTER: 0.5}, spread=spread),
        cloud("c", {HERE: 0.1, NEXT: 0.1, AFTER: 0.1}),
    ]
    found = weights(*clouds)
    between = (bell(1, spread) + FLOOR) ** 2
    beside = (1.0 + FLOOR) * (max(bell(2, spread), tail(2, spread)) + FLOOR)
    assert found[NEXT] / found[HERE] == pytest.approx(between / beside, rel=1e-5)
    assert found[NEXT] > found[HERE] == pytest.approx(found[AFTER])


@pytest.mark.parametrize("floor", [0.001, 0.02, 0.5])
def test_the_floor_bounds_what_one_source_takes_from_a_place(floor: float) -> None:
    clouds = [cloud("a", {HERE: 0.9, THERE: 0.9}), cloud("b", {HERE: 0.9})]
    found = weights(*clouds, floor=floor)
    assert found[HERE] / found[THERE] == pytest.approx((1.0 + floor) / floor)


@pytest.mark.parametrize(
    ("clouds", "expected"),
    [
        ([cloud("a", {HERE: 0.3, NEXT: 0.2}, single=True)], 0.5),
        ([cloud("a", {HERE: 0.3, NEXT: 0.2})], 0.3),
        ([cloud("a", {HERE: 0.3, NEXT: 0.2}, single=True), cloud("b", {THERE: 0.5})], 0.75),
        ([cloud("a", {HERE: 0.3, NEXT: 0.2}), cloud("b", {THERE: 0.5})], 0.65),
        ([cloud("a", {HERE: 0.5}), cloud("b", {})], 0.5),
        ([cloud("a", {HERE: 0.5}), cloud("b", {HERE: 0.9}, SUPPORT)], 0.5),
        ([cloud("a", {HERE: 1.0}), cloud("b", {HERE: 0.1})], 1.0),
        ([cloud("a", dict.fromkeys([HERE, NEXT, AFTER], 1 / 3), single=True)], 1.0),
    ],
)
def test_a_contact_exists_unless_every_sensor_is_wrong(
    clouds: list[HypothesisCloud], expected: float
) -> None:
    assert belief(*clouds).exists == pytest.approx(expected, abs=1e-6)


def test_support_alone_is_no_belief_and_gives_no_likelihood() -> None:
    fusion = fused(cloud("motion", {HERE: 0.9}, SUPPORT))
    assert fusion.field.belief is None and fusion.contacts == ()
    assert by_voxel(fusion) == {HERE: 0.0} and verdicts(fusion) == {HERE: "support_only"}


def test_support_chooses_among_the_places_of_evidence() -> None:
    evidence = cloud("a", {HERE: 0.5, THERE: 0.5})
    found = weights(evidence, cloud("motion", {THERE: 0.1, (80, 0, 0): 0.1}, SUPPORT))
    assert set(found) == {HERE, THERE}
    assert found[THERE] / found[HERE] == pytest.approx((1.0 + FLOOR) / FLOOR)


def test_without_entries_there_is_nothing() -> None:
    fusion = fused(cloud("a", {}), cloud("b", {}, NULL))
    assert fusion.contacts == () and fusion.field.belief is None and by_voxel(fusion) == {}


def test_a_source_that_is_silent_adds_nothing() -> None:
    told = belief(cloud("a", {HERE: 0.5}), cloud("silent", {})).told
    assert told == pytest.approx(np.array([[math.log((1.0 + FLOOR) / FLOOR)], [0.0]]))


# Null


def test_null_lowers_existence_by_bayes_and_is_no_veto() -> None:
    free = cloud("free", {HERE: 1.0}, NULL)
    kept = 0.9 * FLOOR
    fusion = fused(cloud("a", {HERE: 0.9}), free)
    assert fusion.field.belief is not None
    assert fusion.field.belief.exists == pytest.approx(kept / (0.1 + kept), rel=1e-5)
    assert verdicts(fusion) == {HERE: "nulled"}
    assert belief(cloud("a", {HERE: 1.0}), free).exists == 1.0


def test_null_at_one_of_two_places_takes_half_of_the_existence_and_moves_the_place() -> None:
    evidence, free = cloud("a", {HERE: 0.5, THERE: 0.5}), cloud("free", {HERE: 1.0}, NULL)
    found = belief(evidence, free)
    kept = 0.5 * (1.0 + FLOOR) / 2.0
    assert found.exists == pytest.approx(kept / (0.5 + kept))
    assert weights(evidence, free)[HERE] == pytest.approx(FLOOR / (1.0 + FLOOR))


def test_null_that_is_half_sure_takes_half() -> None:
    evidence, free = cloud("a", {HERE: 0.5, THERE: 0.5}), cloud("free", {HERE: 0.5}, NULL)
    found = weights(evidence, free)
    assert found[HERE] / found[THERE] == pytest.approx(1.0 - 0.5 * (1.0 - FLOOR))


def test_null_elsewhere_changes_nothing() -> None:
    clouds = [cloud("a", {HERE: 0.9}), cloud("free", {THERE: 1.0}, NULL)]
    assert belief(*clouds).exists == pytest.approx(0.9)
    assert by_voxel(fused(*clouds)) == {HERE: pytest.approx(0.9), THERE: 0.0}


# The space


def test_a_voxel_has_the_existence_times_its_weight_beside_the_best() -> None:
    clouds = [cloud("a", {HERE: 0.5, THERE: 0.5}), cloud("b", {HERE: 0.5})]
    assert by_voxel(fused(*clouds)) == pytest.approx(
        {HERE: 0.75, THERE: 0.75 * FLOOR / (1.0 + FLOOR)}
    )


def test_other_condensations_take_the_likelihoods_of_voxels() -> None:
    clouds = [cloud("a", {HERE: 0.9}), cloud("b", {HERE: 0.9})]
    (contact,) = fused(*clouds, condensation="cluster_centroid").contacts
    assert contact.likelihood == pytest.approx(0.99)


# The surface


def test_on_a_surface_the_places_are_its_points_where_evidence_says_more_than_its_floor() -> None:
    spread = 0.005
    points = belief(cloud("a", {HERE: 0.9}, spread=spread), surface=plate(SIDE / 2.0)).places
    assert (points[:, 2] == SIDE / 2.0).all()
    farthest = 3.0 * spread * math.sqrt(2.0 * math.log(0.1 / FLOOR))  # there the tail meets it
    away = np.linalg.norm(points - centres([HERE])[0], axis=1).max()
    assert farthest - 0.004 < away < farthest + 0.001
    assert len(points) == pytest.approx(np.pi * farthest**2 / 0.004**2, rel=0.1)


def test_a_contact_lies_on_the_surface_and_without_one_at_the_evidence() -> None:
    above = cloud("a", {(0, 0, 1): 0.9}, spread=0.005)
    (on,), (off,) = fused(above, surface=plate()).contacts, fused(above).contacts
    assert on.position == pytest.approx([0.0025, 0.0025, 0.0], abs=1e-3)
    assert off.position == pytest.approx(centres([(0, 0, 1)])[0])


@pytest.mark.parametrize(
    "surface", [plate(5.0), Surface("base", np.empty((0, 3)), np.empty((0, 3)))]
)
def test_a_surface_far_away_or_without_points_is_as_none(surface: Surface) -> None:
    clouds = [cloud("a", {HERE: 0.9, NEXT: 0.5}), cloud("b", {NEXT: 0.5})]
    assert contents(fused(*clouds, surface=surface)) == contents(fused(*clouds))


def test_one_source_that_is_kilometres_off_costs_no_memory_and_moves_no_contact() -> None:
    good = cloud("a", {HERE: 0.9})
    lost = cloud("lost", {(900_000, -900_000, 900_000): 0.9})
    before, after = (fused(*clouds, surface=plate()) for clouds in ([good], [good, lost]))
    position = before.contacts[0].position
    assert after.contacts[0].position == pytest.approx(position, abs=1e-9)


def test_more_evidence_takes_no_places_away() -> None:
    few_places = belief(cloud("a", {HERE: 0.9}), surface=plate()).places
    more = belief(cloud("a", {HERE: 0.9}), cloud("b", {(3, -5, 0): 0.9}), surface=plate()).places
    assert set(map(tuple, few_places.tolist())) <= set(map(tuple, more.tolist()))


# What holds for all clouds

KINDS = {"a": REGULAR, "b": REGULAR, "c": SUPPORT, "d": NULL}
CUBE: list[Voxel] = list(itertools.product(range(-2, 3), (-1, 0), (0, 1)))
ANYWHERE: list[Voxel] = [*CUBE, THERE, (-30, 5, 0)]
likelihood = st.sampled_from((0.01, 0.1, 0.3, 0.5, 0.9, 1.0))
spread = st.sampled_from((0.0, 0.003, 0.008, 0.02))


@st.composite
def clouds_of(
    draw: st.DrawFn, source: str, voxels: Sequence[Voxel] = ANYWHERE, most: int = 6
) -> HypothesisCloud:
    """Draw a cloud of one source, of a single contact or of several."""
    one = draw(st.booleans())
    given_ = draw(st.dictionaries(st.sampled_from(voxels), likelihood, min_size=1, max_size=most))
    total = sum(given_.values())
    if one and total > 1.0:
        given_ = {voxel: p / total for voxel, p in given_.items()}
    return cloud(source, given_, KINDS.get(source, REGULAR), draw(spread), single=one)


@st.composite
def scenes(draw: st.DrawFn, sources: str = "abcd") -> list[HypothesisCloud]:
    """Draw a cloud of some of the sources, one of evidence among them."""
    chosen = draw(st.sets(st.sampled_from(sources[1:])))
    return [draw(clouds_of(source)) for source in ("a", *sorted(chosen))]


surfaces = st.sampled_from([None, plate()])


def table(fusion: Fusion) -> FloatArray:
    """Give a row a contact: place, likelihood, dispersion and covariance."""
    rows = [[*c.position, c.likelihood, c.dispersion, *c.covariance.flat] for c in fusion.contacts]
    return np.array(rows, np.float64).reshape(-1, 14)


@few
@given(clouds=scenes(), surface=surfaces, data=st.data())
def test_the_order_of_clouds_does_not_matter_and_equal_input_gives_equal_bytes(
    clouds: list[HypothesisCloud], surface: Surface | None, data: st.DataObject
) -> None:
    shuffled = data.draw(st.permutations(clouds))
    assert contents(fused(*shuffled, surface=surface)) == contents(fused(*clouds, surface=surface))


@few
@given(clouds=scenes(), surface=surfaces, names=st.permutations("wxyz"))
@example(
    clouds=[cloud("a", {HERE: 0.5}), cloud("b", {THERE: 0.5}), cloud("c", {NEXT: 0.5}, SUPPORT)],
    surface=None,
    names=["z", "w", "x", "y"],
)
def test_the_names_of_sources_do_not_matter(
    clouds: list[HypothesisCloud], surface: Surface | None, names: list[str]
) -> None:
    new = dict(zip("abcd", names, strict=True))
    renamed = [replace(one, source=new[one.source]) for one in clouds]
    before, after = fused(*clouds, surface=surface), fused(*renamed, surface=surface)
    assert table(after) == pytest.approx(table(before), abs=1e-9)
    for one, other in zip(before.contacts, after.contacts, strict=True):
        assert {new[name]: share for name, share in one.shares.items()} == pytest.approx(
            other.shares, abs=1e-9
        )


@few
@given(clouds=scenes(), surface=surfaces, p=likelihood)
def test_a_source_that_says_the_same_everywhere_changes_nothing(
    clouds: list[HypothesisCloud], surface: Surface | None, p: float
) -> None:
    vague = replace(clouds[0], source="vague", kind=SUPPORT, single=False)
    n = len(vague)
    vague = replace(vague, likelihoods=np.full(n, p), spreads=np.full(n, 1e6))
    before, after = fused(*clouds, surface=surface), fused(*clouds, vague, surface=surface)
    assert table(after) == pytest.approx(table(before), abs=1e-6)
    assert by_voxel(after) == pytest.approx(by_voxel(before), abs=1e-6)


@few
@given(clouds=scenes(), broken=clouds_of("broken"), floor=st.sampled_from((0.005, 0.02, 0.2)))
def test_a_broken_source_changes_the_ratio_of_two_places_by_no_more_than_the_floor_allows(
    clouds: list[HypothesisCloud], broken: HypothesisCloud, floor: float
) -> None:
    broken = replace(broken, kind=SUPPORT)  # it may choose among places, and adds none
    before = np.log(belief(*clouds, floor=floor).weights)
    after = np.log(belief(*clouds, broken, floor=floor).weights)
    assert np.ptp(after - before) <= math.log((1.0 + floor) / floor) + 1e-9


@few
@given(clouds=scenes(), surface=surfaces)
def test_the_likelihoods_of_the_space_are_probabilities_and_null_alone_has_none(
    clouds: list[HypothesisCloud], surface: Surface | None
) -> None:
    fusion = fused(*clouds, surface=surface)
    space = fusion.space
    assert ((space.likelihoods >= 0.0) & (space.likelihoods <= 1.0)).all()
    null = [source in "d" for source in space.sources]
    counted = ~np.isnan(space.source_likelihoods[:, ~np.array(null)]).all(axis=1)
    assert (space.likelihoods[~counted] == 0.0).all()
    found = fusion.field.belief
    assert found is not None
    assert found.weights.sum() == pytest.approx(1.0) and (found.weights >= 0.0).all()
    assert 0.0 < found.exists <= 1.0 and found.told.shape == (len(clouds), len(found.places))


@few
@given(clouds=scenes("abc"), free=clouds_of("d"), surface=surfaces)
def test_null_never_raises_existence(
    clouds: list[HypothesisCloud], free: HypothesisCloud, surface: Surface | None
) -> None:
    before, after = belief(*clouds, surface=surface), belief(*clouds, free, surface=surface)
    assert after.exists <= before.exists + 1e-12


@few
@given(clouds=scenes(), surface=surfaces, data=st.data())
def test_without_a_source_is_as_if_it_had_never_spoken(
    clouds: list[HypothesisCloud], surface: Surface | None, data: st.DataObject
) -> None:
    gone = data.draw(st.sampled_from([one.source for one in clouds]))
    rest = [one for one in clouds if one.source != gone]
    fusion = fused(*clouds, surface=surface)
    assert contents(fusion.without(gone)) == contents(fused(*rest, surface=surface))
