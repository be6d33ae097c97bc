"""The rule `posterior`: a product of fields tells where, existence tells whether."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from contactfusion import Fusion, HypothesisCloud, HypothesisKind
from contactfusion.arrays import FloatArray
from contactfusion.shapes import BodyConfig
from contactfusion.surface import Surface
from contactfusion_lab.baselines.posterior import Belief, belief_of
from lab.tests import baseline_steps
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
    law,
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


def measured(
    source: str,
    positions: FloatArray,
    likelihoods: FloatArray | float,
    spread: float,
    kind: HypothesisKind = REGULAR,
    single: bool = False,
    forces: FloatArray | None = None,
) -> HypothesisCloud:
    """Give a cloud of places as they were measured."""
    n = len(positions)
    p = np.broadcast_to(np.asarray(likelihoods, np.float64), n)
    spreads = np.full(n, spread)
    return HypothesisCloud(
        source, kind, 0.0, "base", positions, p, forces, spreads=spreads, single=single
    )


def fused(*clouds: HypothesisCloud, surface: Surface | None = None, **config: Any) -> Fusion:
    return baseline_steps.fused(*clouds, surface=surface, **{"floor": FLOOR, **config})


def believed(fusion: Fusion) -> Belief:
    found = belief_of(fusion.field)
    assert found is not None
    return found


def belief(*clouds: HypothesisCloud, **others: Any) -> Belief:
    return believed(fused(*clouds, **others))


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
    return Surface.rectangle("base", np.array([0.0, 0.0, height]), *edges, 0.004)


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


def test_beyond_nine_standard_deviations_nothing_but_the_floor_is_left() -> None:
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
    assert belief_of(fusion.field) is None and fusion.contacts == ()
    assert by_voxel(fusion) == {HERE: 0.0} and verdicts(fusion) == {HERE: "support_only"}


def test_support_chooses_among_the_places_of_evidence() -> None:
    evidence = cloud("a", {HERE: 0.5, THERE: 0.5})
    found = weights(evidence, cloud("motion", {THERE: 0.1, (80, 0, 0): 0.1}, SUPPORT))
    assert set(found) == {HERE, THERE}
    assert found[THERE] / found[HERE] == pytest.approx((1.0 + FLOOR) / FLOOR)


def test_without_entries_there_is_nothing() -> None:
    fusion = fused(cloud("a", {}), cloud("b", {}, NULL))
    assert fusion.contacts == () and belief_of(fusion.field) is None and by_voxel(fusion) == {}


def test_a_source_that_is_silent_adds_nothing() -> None:
    told = belief(cloud("a", {HERE: 0.5}), cloud("silent", {})).told
    assert told == pytest.approx(np.array([[math.log((1.0 + FLOOR) / FLOOR)], [0.0]]))


def test_a_source_whose_entries_live_is_not_silent() -> None:
    one = baseline_steps.integrator(law(**baseline_steps.MODES))
    one.plug("watch", sensitivity=0.99)
    for stamp, likelihoods in ((0.0, {HERE: 0.5}), (0.1, {})):
        one.receive(plain_cloud("skin", stamp, {HERE: 0.95}))
        one.receive(plain_cloud("watch", stamp, likelihoods))
        found = believed(one.step(stamp)).exists
        assert found == pytest.approx(0.975)


# Null


def test_null_lowers_existence_by_bayes_and_is_no_veto() -> None:
    free = cloud("free", {HERE: 1.0}, NULL)
    kept = 0.9 * FLOOR
    fusion = fused(cloud("a", {HERE: 0.9}), free)
    assert believed(fusion).exists == pytest.approx(kept / (0.1 + kept), rel=1e-5)
    assert verdicts(fusion) == {HERE: "nulled"}
    assert belief(cloud("a", {HERE: 1.0}), free).exists == 1.0


def test_null_at_one_of_two_places_takes_half_of_the_existence_and_moves_the_place() -> None:
    evidence, free = cloud("a", {HERE: 0.5, THERE: 0.5}), cloud("free", {HERE: 1.0}, NULL)
    found = belief(evidence, free)
    kept = 0.5 * (1.0 + FLOOR) / 2.0
    assert found.exists == pytest.approx(kept / (0.5 + kept))
    assert weights(evidence, free)[HERE] == pytest.approx(FLOOR / (1.0 + FLOOR))


def test_support_has_no_say_in_whether_there_is_a_contact_beside_null_either() -> None:
    evidence = cloud("a", {HERE: 0.9, THERE: 0.9})
    free = cloud("free", {HERE: 0.9}, NULL)
    for place in (HERE, THERE):
        support = cloud("motion", {place: 0.5}, SUPPORT)
        with_it, without_it = belief(evidence, free, support), belief(evidence, free)
        assert with_it.exists == pytest.approx(without_it.exists)


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
    found = believed(fusion)
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


# Tails: spreads that are stated too small


@pytest.mark.parametrize(("times", "told"), [(2.0, 0.1959), (3.0, 0.0652), (4.0, 0.0377)])
def test_a_source_that_is_some_stated_spreads_off_still_speaks(times: float, told: float) -> None:
    stated = 0.008
    truth = np.array([times * stated, 0.0, 0.0])
    wrong = measured("wrong", np.zeros((1, 3)), 0.5, stated, single=True)
    found = belief(wrong, measured("eye", truth[None], 0.5, stated))
    at_truth = np.linalg.norm(found.places - truth, axis=1).argmin()
    added = math.log((told + FLOOR) / FLOOR)  # told: of its 1.1 at its own place
    assert found.told[1, at_truth] == pytest.approx(added, rel=1e-3)


@pytest.mark.parametrize("too_small", [2.0, 3.0])
@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("surface", [None, "plate"])
def test_a_source_whose_spread_is_stated_too_small_still_draws_the_contact(
    too_small: float, single: bool, surface: str | None
) -> None:
    truth, other = np.array([-0.04, 0.0, 0.0]), np.array([0.04, 0.0, 0.0])
    true_spread = 0.012
    measured_at = truth - [0.0, 4.5 / too_small * true_spread, 0.0]
    wrong = measured("wrong", measured_at[None], 0.6, true_spread / too_small, SUPPORT, single)
    eye = measured("eye", np.array([truth, other]), 0.6, 0.004)
    found = belief(eye, wrong, surface=plate() if surface else None, floor=0.01)
    drawn = found.weights[found.places[:, 0] < 0.0].sum()
    assert drawn > 0.8


# Friction: a force pushes into the surface

NARROW = 1.0 / math.hypot(1.0, 0.5)
"""The cosine of the friction cone's half angle."""


def thin_plate(thickness: float = 0.004) -> Surface:
    """Give both sides of a plate; the upper one faces +z."""
    above, below = plate(thickness / 2.0), plate(-thickness / 2.0)
    points = np.concatenate([above.points, below.points])
    return Surface("base", points, np.concatenate([above.normals, -below.normals]))


def line(force: Sequence[float], source: str = "wrist", p: float = 0.9) -> HypothesisCloud:
    """Give the line of a force through the origin, with as much of it above as below z = 0."""
    along = np.array(force) / np.linalg.norm(force)
    positions = np.outer(np.arange(-2, 3) * SIDE, along) + 1e-6
    felt = np.tile(np.array(force, np.float64), (5, 1))
    return measured(source, positions, p / 5, 0.005, single=True, forces=felt)


def above(found: Belief) -> float:
    """Give the weight of the places above z = 0."""
    return float(found.weights[found.places[:, 2] > 0.0].sum())


pushes = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.sampled_from((-10.0, 10.0)))


@few
@given(force=pushes, floor=st.sampled_from((0.001, 0.01, 0.1)))
def test_of_the_two_sides_of_a_thin_plate_the_one_that_is_pushed_wins(
    force: tuple[float, float, float], floor: float
) -> None:
    found = belief(line(force), surface=thin_plate(), floor=floor)
    pushed = above(found) if force[2] < 0.0 else 1.0 - above(found)
    assert pushed == pytest.approx((1.0 + floor) / (1.0 + 2.0 * floor), abs=5e-3)


def test_a_contact_lies_on_the_side_that_is_pushed() -> None:
    for force, height in (([0.0, 0.0, -5.0], 0.002), ([0.0, 0.0, 5.0], -0.002)):
        (contact,) = fused(line(force), surface=thin_plate()).contacts
        assert contact.position[2] == pytest.approx(height, abs=2e-4)
        assert contact.force.tolist() == force


@pytest.mark.parametrize("degrees", [0.0, 20.0, 26.5, 30.0, 40.0, 60.0])
def test_a_force_fits_within_the_cone_of_friction_and_less_and_less_beyond(degrees: float) -> None:
    angle = math.radians(degrees)
    force = [5.0 * math.sin(angle), 0.0, -5.0 * math.cos(angle)]
    fits = math.exp(-0.5 * (max(0.0, NARROW - math.cos(angle)) / 0.15) ** 2)
    opposite = math.exp(-0.5 * ((NARROW + math.cos(angle)) / 0.15) ** 2)
    told = belief(line(force), surface=thin_plate()).told
    deaf = belief(replace(line(force), forces=None), surface=thin_plate()).told
    added = told - deaf
    places = belief(line(force), surface=thin_plate()).places
    up = places[:, 2] > 0.0
    assert added[0, up] == pytest.approx(math.log(fits + FLOOR), abs=1e-6)
    assert added[0, ~up] == pytest.approx(math.log(opposite + FLOOR), abs=1e-6)


@pytest.mark.parametrize("friction", [0.5, 1.0, 3.0])
def test_the_more_friction_the_wider_the_cone(friction: float) -> None:
    at_its_edge = [friction, 0.0, -1.0]
    found = belief(line(at_its_edge), surface=thin_plate(), friction=friction)
    steep = belief(line(at_its_edge), surface=thin_plate(), friction=friction / 2.0)
    top, steep_top = found.told.max(), steep.told.max()
    assert top == pytest.approx(math.log((1 + FLOOR) / FLOOR) + math.log(1 + FLOOR), abs=0.01)
    assert steep_top < top - 1e-3


@few
@given(force=pushes, clouds=st.deferred(lambda: scenes("abc")))
def test_without_normals_a_force_chooses_no_place(
    force: tuple[float, float, float], clouds: list[HypothesisCloud]
) -> None:
    felt = line(force)
    with_force, without = belief(*clouds, felt), belief(*clouds, replace(felt, forces=None))
    assert with_force.weights.tolist() == without.weights.tolist()
    assert with_force.told.tolist() == without.told.tolist()


@pytest.mark.parametrize("others", [{"single": False}, {"forces": np.zeros((5, 3))}])
def test_the_force_of_several_contacts_or_none_chooses_no_side(others: dict[str, Any]) -> None:
    found = belief(replace(line([0.0, 0.0, -5.0]), **others), surface=thin_plate())
    assert above(found) == pytest.approx(0.5, abs=1e-3)


# The space, where somebody looks


@few
@given(clouds=st.deferred(lambda: scenes("abc")), surface=st.sampled_from([None, "plate"]))
def test_a_voxel_has_the_existence_times_the_heaviest_place_within_a_side_and_0_further_off(
    clouds: list[HypothesisCloud], surface: str | None
) -> None:
    fusion = fused(*clouds, surface=plate() if surface else None)
    found, space = believed(fusion), fusion.space
    away = np.linalg.norm(space.positions[:, None] - found.places[None], axis=2)
    most = found.exists / found.weights.max()
    within, about = (
        most * np.where(away <= side, found.weights, 0.0).max(axis=1)
        for side in (SIDE - 1e-9, SIDE + 1e-9)
    )
    assert (space.likelihoods >= within - 1e-12).all()
    assert (space.likelihoods <= about + 1e-12).all()
    assert (space.likelihoods[away.min(axis=1) > SIDE + 1e-9] == 0.0).all()


# Finer and shifted grids, on clouds as sensors give them

BODIES = {
    "plate": BodyConfig.model_validate(
        {"frame": "base", "shapes": [{"shape": "rectangle", "size": (0.2, 0.2)}]}
    ).sampled(Path()),
    "cylinder": BodyConfig.model_validate(
        {"frame": "base", "shapes": [{"shape": "cylinder", "radius": 0.04, "length": 0.2}]}
    ).sampled(Path()),
}
Touch = tuple[Surface, list[HypothesisCloud]]


def skin(rng: np.random.Generator, place: FloatArray, across: FloatArray) -> HypothesisCloud:
    """Give a patch of taxels, 4 to 5 mm apart, pressed around a place."""
    rows, columns, pitch = rng.integers(1, 5), rng.integers(1, 5), rng.uniform(0.004, 0.005)
    grid = np.stack(np.meshgrid(np.arange(rows), np.arange(columns)), axis=-1).reshape(-1, 2)
    flat = pitch * (grid - grid.mean(axis=0))
    pressed = np.exp(-0.5 * np.square((flat - rng.normal(0.0, 0.002, 2)) / 0.006).sum(axis=1))
    positions = place + (flat + rng.normal(0.0, 0.003, 2)) @ across
    return measured("skin", positions, 0.95 * pressed / pressed.max(), 0.004)


def wrist(rng: np.random.Generator, place: FloatArray, normal: FloatArray) -> HypothesisCloud:
    """Give the line of a force that crosses the surface at a place."""
    force = rng.normal(0.0, 0.3, 3) - normal
    force *= 10.0 / np.linalg.norm(force)
    steps = np.arange(rng.uniform(-0.010, -0.005), 0.010, 0.005)
    positions = place + rng.normal(0.0, 0.004, 3) + np.outer(steps, force / 10.0)
    felt, p = np.tile(force, (len(steps), 1)), rng.uniform(0.5, 1.0) / len(steps)
    spread = rng.uniform(0.003, 0.012)
    return measured("wrist", positions, p, spread, single=True, forces=felt)


def eye(
    rng: np.random.Generator, place: FloatArray, normal: FloatArray, surface: Surface
) -> HypothesisCloud:
    """Give the points of a ball that touches the surface at a place, as a range camera does."""
    radius, outward = rng.uniform(0.02, 0.06), rng.normal(size=(int(rng.integers(300, 1200)), 3))
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    ball = radius * (normal + outward[outward @ normal < -0.3])
    points = place + rng.normal(0.0, 0.005, 3) + ball + rng.normal(0.0, 0.0025, ball.shape)
    p = 1e-4 / (1e-4 + np.square(surface.nearest(points)[0]))
    return measured("eye", points, p, 0.012)


def motion(rng: np.random.Generator, place: FloatArray, surface: Surface) -> HypothesisCloud:
    """Give the part of the surface that moves ahead."""
    away = np.linalg.norm(surface.points - place - rng.normal(0.0, 0.005, 3), axis=1)
    ahead = surface.points[away < rng.uniform(0.02, 0.05)]
    return measured("motion", ahead, 0.3, rng.uniform(0.005, 0.02), SUPPORT)


@st.composite
def touches(draw: st.DrawFn) -> Touch:
    """Draw a body, a contact on it, and what some sensors say of that."""
    surface = BODIES[draw(st.sampled_from(sorted(BODIES)))]
    chosen = draw(st.sets(st.sampled_from(["skin", "wrist", "eye"]), min_size=1))
    chosen |= draw(st.sampled_from([set(), {"motion"}]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    row = rng.integers(len(surface.points))
    place, normal = surface.points[row], surface.normals[row]
    across = np.linalg.svd(normal[None])[2][1:]
    clouds = {
        "skin": skin(rng, place, across),
        "wrist": wrist(rng, place, normal),
        "eye": eye(rng, place, normal, surface),
        "motion": motion(rng, place, surface),
    }
    return surface, [clouds[name] for name in sorted(chosen)]


def shifted(touch: Touch, offset: FloatArray) -> Touch:
    surface, clouds = touch
    moved = [replace(one, positions=one.positions + offset) for one in clouds]
    return Surface("base", surface.points + offset, surface.normals), moved


def differences(before: Fusion, after: Fusion, offset: FloatArray) -> tuple[float, float]:
    """Give how far the contacts differ in likelihood, and in place [m]."""
    assert len(before.contacts) == len(after.contacts) > 0
    pairs = list(zip(before.contacts, after.contacts, strict=True))
    likelihoods = [abs(one.likelihood - other.likelihood) for one, other in pairs]
    places = [np.linalg.norm(other.position - one.position - offset) for one, other in pairs]
    return max(likelihoods), float(max(places))


def on_two_grids(touch: Touch, offset: FloatArray, *sides: float) -> tuple[float, float]:
    """Give how far the contacts differ between two grids, on the surface."""
    before, after = (
        fused(*clouds, surface=surface, floor=0.01, voxel_size=side, existence=0.01)
        for side, (surface, clouds) in zip(sides, (touch, shifted(touch, offset)), strict=True)
    )
    return differences(before, after, offset)


offsets = st.tuples(*[st.floats(0.0, 1.0, exclude_max=True)] * 3).map(np.array)
more = settings(max_examples=50)


@more
@given(touch=touches(), offset=offsets, side=st.sampled_from((0.0025, 0.00125)))
def test_on_grids_that_are_finer_than_sensors_contacts_hardly_change(
    touch: Touch, offset: FloatArray, side: float
) -> None:
    likelihood, place = on_two_grids(touch, side * offset, 0.0025, side)
    assert likelihood < 0.02 and place < 0.001


@more
@given(touch=touches(), offset=offsets, side=st.sampled_from((0.005, 0.0025, 0.00125)))
def test_on_a_grid_as_coarse_as_sensors_contacts_change_little(
    touch: Touch, offset: FloatArray, side: float
) -> None:
    likelihood, place = on_two_grids(touch, 0.005 * offset, 0.005, side)
    assert likelihood < 0.07 and place < 0.005  # of 1000 such touches: 0.048 and 2.3 mm at most


@few
@given(touch=touches(), offset=offsets)
def test_no_existence_hangs_on_the_grid_also_without_a_surface(
    touch: Touch, offset: FloatArray
) -> None:
    _, moved = shifted(touch, 0.005 * offset)
    one, other = belief(*touch[1]).exists, belief(*moved, voxel_size=0.0025).exists
    assert one == pytest.approx(other, abs=1e-6)


# More evidence


def nearest_to(found: Belief, place: FloatArray) -> FloatArray:
    """Give the place of a belief that is nearest to another one, shape (1, 3) [m]."""
    nearest: FloatArray = found.places[((found.places - place) ** 2).sum(axis=1).argmin()][None]
    return nearest


def with_more(touch: Touch, p: float, spread: float) -> tuple[Fusion, Fusion]:
    """Fuse a touch, and again with more evidence at the place of its contact."""
    surface, clouds = touch
    before = fused(*clouds, surface=surface, existence=0.01)
    there = nearest_to(believed(before), before.contacts[0].position)
    extra = measured("more", there, p, spread)
    return before, fused(*clouds, extra, surface=surface, existence=0.01)


@few
@given(touch=touches(), p=likelihood, spread=spread)
def test_more_evidence_never_lowers_existence_nor_takes_the_contact_away(
    touch: Touch, p: float, spread: float
) -> None:
    before, after = with_more(touch, p, spread)
    assert believed(after).exists >= believed(before).exists - 1e-12
    place = before.contacts[0].position
    away = min(float(np.linalg.norm(one.position - place)) for one in after.contacts)
    assert away < 0.012


# What one source can move


@few
@given(touch=touches(), broken=touches(), floor=st.sampled_from((0.005, 0.02, 0.2)))
def test_a_broken_source_moves_no_ratio_by_more_than_its_floors_allow(
    touch: Touch, broken: Touch, floor: float
) -> None:
    surface, clouds = touch
    before = belief(*clouds, surface=surface, floor=floor)
    for wrong in broken[1]:
        if wrong.kind == SUPPORT or "motion" in {one.source for one in clouds}:
            continue  # further places change the highest value of what Support says
        wrong = replace(wrong, source="broken")
        after = belief(*clouds, wrong, surface=surface, floor=floor)
        kept = dict(zip(map(tuple, after.places.tolist()), after.weights.tolist(), strict=True))
        now = np.log([kept[tuple(place)] for place in before.places.tolist()])
        fields = 2 if wrong.forces is not None else 1  # a force is a field with a floor of its own
        allowed = fields * math.log((1.0 + floor) / floor)
        assert np.ptp(now - np.log(before.weights)) <= allowed + 1e-6


@few
@given(touch=touches(), data=st.data())
def test_neither_the_order_nor_the_names_of_sensors_matter(
    touch: Touch, data: st.DataObject
) -> None:
    surface, clouds = touch
    names = data.draw(st.permutations("abcd"))
    renamed = [replace(one, source=new) for one, new in zip(clouds, names, strict=False)]
    before = fused(*clouds, surface=surface)
    after = fused(*data.draw(st.permutations(renamed)), surface=surface)
    assert table(after) == pytest.approx(table(before), abs=1e-7)


@few
@given(touch=touches(), p=likelihood, surfaced=st.booleans())
def test_a_sensor_that_says_the_same_everywhere_changes_nothing(
    touch: Touch, p: float, surfaced: bool
) -> None:
    surface, clouds = touch
    on = {"surface": surface if surfaced else None}
    vague = measured("vague", clouds[0].positions[:1], p, 1e3, SUPPORT)
    before, after = fused(*clouds, **on), fused(*clouds, vague, **on)
    assert table(after) == pytest.approx(table(before), abs=1e-5)


@few
@given(
    axis=st.sampled_from((0, 1)),
    spread=st.floats(0.004, 0.012),
    p=st.tuples(st.floats(0.3, 0.95), st.floats(0.3, 0.95)),
    single=st.booleans(),
)
def test_two_sensors_that_are_a_voxel_apart_agree_on_one_contact_between_them(
    axis: int, spread: float, p: tuple[float, float], single: bool
) -> None:
    half = SIDE / 2.0 * np.eye(3)[axis]
    centre = np.array([0.002, 0.002, 0.0])
    clouds = [
        measured(name, (centre + side * half)[None], one, spread, single=single)
        for name, side, one in zip("ab", (-1.0, 1.0), p, strict=True)
    ]
    (contact,) = fused(*clouds, surface=plate(), existence=0.01, floor=0.01).contacts
    assert contact.position == pytest.approx(centre, abs=1e-3)
    exists = 1.0 - (1.0 - p[0]) * (1.0 - p[1])
    assert 0.8 * exists < contact.likelihood <= exists + 1e-6
    assert contact.shares == pytest.approx({"a": 0.5, "b": 0.5}, abs=0.02)
