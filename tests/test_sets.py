"""The rule `sets` and the condensation `members`: any number of contacts, with nothing set."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactfusion import Contact, Fusion, HypothesisCloud, Integrator, IntegratorConfig
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.hypotheses import HypothesisKind, Resultant
from contactfusion.integrator import likelihood_fields
from contactfusion.integrator.likelihood_fields import product
from contactfusion.integrator.sets import MOST
from contactfusion.patches import PatchConfig, TaxelGridConfig
from contactfusion.shapes import BodyConfig, PartConfig, ShapeConfig
from contactfusion.surface import Surface
from tests.clouds import NULL, REGULAR, SUPPORT, contents

PALM = ShapeConfig(shape="rectangle", size=(0.1, 0.08)).sampled("hand", 0.004)
FINGERS = Surface.joined(
    [
        ShapeConfig(shape="cylinder", radius=0.012, length=0.06, xyz=(x, 0.0, 0.0)).sampled(
            "hand", 0.004
        )
        for x in (-0.022, 0.022)
    ]
)
HALVES = BodyConfig(
    frame="hand",
    shapes=tuple(
        PartConfig(shape="rectangle", size=(0.05, 0.08), xyz=(x, 0.0, 0.0), link=link)
        for x, link in ((-0.025, "left"), (0.025, "right"))
    ),
).sampled(Path())
"""The palm, of which a sensor may carry one half."""
SURFACES = pytest.mark.parametrize("surface", [None, PALM], ids=["no surface", "palm"])
PATCH = np.array([(x, y, 0.0) for x in (-5, 0, 5) for y in (-5, 0, 5)])
PRESSES = np.array(
    [(-35, -25, 0), (35, 25, 0), (-20, 20, 0), (15, -10, 0), (35, -25, 0), (5, 25, 0)], np.float64
)
DOWN = (0.0, 0.0, -5.0)


def emit(
    source: str,
    p: Any,
    mm: Any,
    spread: float | None = 4.0,
    kind: HypothesisKind = REGULAR,
    **others: Any,
) -> HypothesisCloud:
    """A cloud of a source: likelihoods, positions [mm] and spread [mm]."""
    positions = np.array(mm, np.float64).reshape(-1, 3) / 1e3
    likelihoods = np.array(np.broadcast_to(p, len(positions)))
    spreads = None if spread is None else np.full(len(positions), spread / 1e3)
    given: dict[str, Any] = {"spreads": spreads, **others}
    return HypothesisCloud(source, kind, 1.0, "hand", positions, likelihoods, **given)


def fused(*clouds: HypothesisCloud, surface: Surface | None = None, **misses: float) -> Fusion:
    integrator = Integrator(IntegratorConfig(frame="hand"))
    for name, sensitivity in misses.items():
        integrator.plug(name, sensitivity=sensitivity)
    for cloud in clouds:
        integrator.receive(cloud)
    return integrator.step(1.0, surface)


def only(*clouds: HypothesisCloud, surface: Surface | None = None, **misses: float) -> Contact:
    (contact,) = fused(*clouds, surface=surface, **misses).contacts
    return contact


def away(contact: Contact, mm: Any) -> float:
    """The distance of a contact from a place [mm]."""
    return float(np.linalg.norm(contact.position * 1e3 - mm))


def places(fusion: Fusion) -> FloatArray:
    """The positions of all contacts [mm], sorted."""
    found = np.array([contact.position for contact in fusion.contacts]).reshape(-1, 3) * 1e3
    return found[np.lexsort(found.round(1).T)]


# How many


def test_without_evidence_there_is_no_contact() -> None:
    assert fused().contacts == ()
    assert fused(emit("free", 1.0, (0, 0, 0), kind=NULL)).contacts == ()
    assert fused(emit("motion", 0.9, (0, 0, 0), kind=SUPPORT)).contacts == ()


@SURFACES
@pytest.mark.parametrize("count", [1, 2, 4, 6])
@pytest.mark.parametrize("spread", [None, 4.0])
def test_each_press_of_a_skin_is_a_contact(
    count: int, surface: Surface | None, spread: float | None
) -> None:
    pressed = PRESSES[:count]
    fusion = fused(emit("skin", 0.8, pressed[:, None] + PATCH / 2, spread), surface=surface)
    found = places(fusion)
    assert len(found) == count
    assert np.linalg.norm(found - pressed[:, None], axis=2).min(axis=1).max() < 1.2
    assert all(c.likelihood == pytest.approx(0.8, abs=0.01) for c in fusion.contacts)


def test_sources_that_never_share_a_voxel_are_one_contact() -> None:
    skin = emit("skin", (0.9, 0.5, 0.4), [(0, 1, 0), (5, 1, 0), (0, 6, 0)])
    camera = emit("camera", 0.4, PATCH + (18, 8, 0), 12.0)
    for surface in (None, PALM):
        contact = only(skin, camera, surface=surface)
        assert away(contact, (0, 3, 0)) < 4.0
        assert contact.likelihood == pytest.approx(1.0 - 0.1 * 0.6)


def test_each_of_two_fingers_is_a_contact_by_a_source_of_its_own() -> None:
    ends = [(-34, 0, 0), (34, 0, 0)]
    clouds = [emit(f"tip_{x}", 0.8, [(x, y, z)]) for x, y, z in ends]
    fusion = fused(*clouds, surface=FINGERS)
    np.testing.assert_allclose(places(fusion), ends, atol=2.0)
    assert [set(c.shares) for c in fusion.contacts] == [{"tip_-34", "tip_34"}] * 2
    assert sorted(max(c.shares.values()) for c in fusion.contacts) == [1.0, 1.0]


def test_a_line_of_force_is_one_contact_at_the_end_that_a_prediction_tells() -> None:
    ends = [
        (x + (144 - y * y) ** 0.5, y, z) for x in (-22, 22) for y in (-1, 4, 9) for z in (-2, 2)
    ]
    force = emit("force", 0.9 / 12, ends, single=True, forces=np.array([(-8.0, 0.0, 0.0)] * 12))
    prediction = emit("prediction", 0.4, PATCH + (42, 10, 0), 15.0, SUPPORT)
    contact = only(force, prediction, surface=FINGERS)
    assert away(contact, (33.3, 4, 0)) < 3.0
    np.testing.assert_array_equal(contact.force, (-8.0, 0.0, 0.0))


def test_a_flat_face_of_taxels_is_one_contact_with_extent() -> None:
    face = [(0, y, z) for y in range(-475, 476, 50) for z in (-150, -100, -50)]
    for likelihoods in (0.9, np.tile([0.9, 0.6, 0.75], 20)):
        contact = only(emit("skin", likelihoods, face, 50 / 12**0.5))
        assert away(contact, (0, 0, -100)) < 5.0
        np.testing.assert_allclose(np.ptp(contact.extent[:, 1]), 0.95, atol=0.05)
        assert contact.scatter[1, 1] == pytest.approx(0.288**2, rel=0.01)


@pytest.mark.parametrize("spread", [5.0, 20.0, 40.0])
@pytest.mark.parametrize("half", [0.0, 120.0])
def test_a_contact_is_as_wide_as_it_is_however_unsure_its_position(
    half: float, spread: float
) -> None:
    """As of a base that sees what it pushes: a column, or a strip, over the height of its face."""
    face = ShapeConfig(shape="rectangle", size=(0.6, 0.35)).sampled("hand", 0.01)
    across = np.linspace(-half, half, 1 + int(half) // 5)
    strip = [(x, y, 0.0) for x in across for y in np.linspace(-170.0, 170.0, 35)]
    contact = only(emit("lidar", 0.9, strip, spread), surface=face)
    assert np.sqrt(3.0 * contact.scatter[0, 0]) * 1e3 == pytest.approx(half, abs=0.15 * half + 8.0)
    assert np.sqrt(3.0 * contact.scatter[1, 1]) * 1e3 == pytest.approx(170.0, abs=30.0)


def test_presses_a_taxel_apart_are_two_when_what_is_between_them_is_unlikely() -> None:
    row = [(0, 0, 0), (0, 50, 0), (0, 100, 0)]
    assert len(fused(emit("skin", (0.9, 0.2, 0.9), row, 50 / 12**0.5)).contacts) == 2
    assert len(fused(emit("skin", (0.9, 0.8, 0.9), row, 50 / 12**0.5)).contacts) == 1


@SURFACES
@pytest.mark.parametrize("spread", [4.3, 6.0])
def test_presses_that_a_skin_tells_apart_are_two_though_its_place_is_unsure(
    spread: float, surface: Surface | None
) -> None:
    x, y = np.meshgrid(np.arange(-25.0, 26.0, 5.0), [-5.0, 0.0, 5.0])
    ends = np.array([(-10.0, 0.0, 0.0), (10.0, 0.0, 0.0)])
    pressed = np.exp(-0.5 * ((x - ends[:, :1, None]) ** 2 + y**2) / 5.0**2)
    taxels = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    found = places(
        fused(emit("skin", 0.9 * pressed.max(axis=0).ravel(), taxels, spread), surface=surface)
    )
    assert len(found) == 2
    np.testing.assert_allclose(found[found[:, 0].argsort()], ends, atol=2.5)


@pytest.mark.parametrize("spread", [1.5, 4.3])
def test_a_face_pressed_unevenly_or_with_a_dead_taxel_is_one(spread: float) -> None:
    x, y = np.meshgrid(np.arange(0.0, 30.0, 5.0), np.arange(0.0, 30.0, 5.0))
    taxels = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    uneven = np.where((x + 2.0 * y) % 25.0 == 5.0, 0.2, 0.9).ravel()
    alive = np.delete(taxels, 14, axis=0)
    for cloud in (emit("skin", uneven, taxels, spread), emit("skin", 0.9, alive, spread)):
        assert away(only(cloud), cloud.positions.mean(axis=0) * 1e3) < 4.0


@pytest.mark.parametrize("pitch", [0.0035, 0.006, 0.007])
def test_presses_on_a_skin_are_two_though_voxels_mix_its_taxels(pitch: float) -> None:
    side = IntegratorConfig(frame="hand").voxel_size
    patch = PatchConfig(grid=TaxelGridConfig(rows=24, columns=24, pitch=(pitch, pitch)))
    positions, taxels = patch.covered(side)
    ends = np.array([(-3.0, 0.0, 0.0), (3.0, 0.0, 0.0)]) * pitch
    away = np.linalg.norm(patch.centres()[:, None] - ends, axis=2).min(axis=1) / pitch
    likelihoods = 0.95 * np.exp(-0.5 * away**2)
    touched = (likelihoods > 0.05)[taxels]
    for turn in Rotation.random(10, random_state=0):
        mm = turn.apply(positions[touched]) * 1e3
        contacts = fused(emit("skin", likelihoods[taxels][touched], mm, 4.2)).contacts
        assert len(contacts) == 2
        found = turn.inv().apply([contact.position for contact in contacts])
        np.testing.assert_allclose(found[found[:, 0].argsort()], ends, atol=pitch / 2.0)


@SURFACES
def test_presses_with_untouched_taxels_between_them_are_two(surface: Surface | None) -> None:
    ends = np.array([(-12.5, 0.0, 0.0), (12.5, 0.0, 0.0)])
    pressed = (ends[:, None] + PATCH).reshape(-1, 3)
    found = places(fused(emit("skin", 0.9, pressed, 4.3), surface=surface))
    assert len(found) == 2
    np.testing.assert_allclose(found[found[:, 0].argsort()], ends, atol=1.5)


@pytest.mark.parametrize("pitch", [10.0, 20.0, 40.0])
def test_a_press_on_a_skin_whose_taxels_are_longer_than_wide_is_one(pitch: float) -> None:
    x, y = (each.ravel() for each in np.meshgrid(np.arange(16) * 5.0, np.arange(8) * pitch))
    taxels, spread = np.stack([x, y, np.zeros(x.size)], axis=1), pitch / 12**0.5

    def pressed(*places: tuple[float, float]) -> HypothesisCloud:
        squared = ((taxels[:, :2] - np.array(places)[:, None]) ** 2).sum(axis=2).min(axis=0)
        likelihoods = 0.95 * np.exp(-0.5 * squared / pitch**2)
        felt = likelihoods > 0.1
        return emit("skin", likelihoods[felt], taxels[felt], spread)

    only(pressed((36.0, 3.2 * pitch)))
    assert len(fused(pressed((36.0, 0.5 * pitch), (36.0, 6.5 * pitch))).contacts) == 2


@pytest.mark.parametrize("mirrored", [1.0, -1.0])
def test_presses_are_as_many_from_either_side_of_a_long_row(mirrored: float) -> None:
    taxels = np.array([*range(30), 33, 34, 35])
    pressed = np.array([0.9, 0.1, 0.9, *[0.05] * 27, 0.9, 0.1, 0.9])
    row = np.zeros((len(taxels), 3))
    row[:, 0] = 6.0 * mirrored * taxels
    assert len(fused(emit("skin", pressed, row, 6.0)).contacts) == 4


def test_what_a_skin_feels_off_the_surface_ends_no_step() -> None:
    x, y = (each.ravel() for each in np.meshgrid(*[np.arange(-4.0, 5.0, 2.0)] * 2))
    square = np.stack([x, y, np.zeros(25)], axis=1) / 1e3
    surface = Surface("hand", square, np.tile((0.0, 0.0, 1.0), (25, 1)))
    x, y = np.meshgrid(-22.0 - 8.0 * np.arange(4), 8.0 * np.arange(-2, 3))
    taxels = np.stack([x.ravel(), y.ravel(), np.zeros(20)], axis=1)
    positions = np.concatenate([taxels, [(0.0, 0.0, 16.0)]]) / 1e3
    spreads = np.array([0.01] * 20 + [0.001])
    cloud = HypothesisCloud(
        "skin", REGULAR, 1.0, "hand", positions, np.full(21, 0.9), spreads=spreads
    )
    assert fused(cloud, surface=surface).contacts


def test_hypotheses_at_nearly_one_place_are_one_contact() -> None:
    ends = np.array([(4.9999999999, 0.0, 0.0), (5.0000000001, 0.0, 0.0), (5.0, 4.9999999999, 0.0)])
    only(emit("skin", (0.9, 0.2, 0.9), ends, 4.0))
    only(emit("skin", (0.9, 0.2, 0.9), np.zeros((3, 3)), 0.0))


def test_a_gap_in_what_is_sampled_by_chance_parts_no_contact() -> None:
    rng = np.random.default_rng(0)
    halves = np.concatenate(
        [rng.uniform(-5.0, 5.0, (40, 3)) + (x, 0.0, 0.0) for x in (-11.0, 11.0)]
    )
    only(emit("camera", 0.8, halves * (1.0, 1.0, 0.0), 7.0))


def test_likelihoods_that_vary_within_the_spread_are_one_contact() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        radii, turns = 20.0 * np.sqrt(rng.uniform(size=80)), rng.uniform(0.0, 2.0 * np.pi, 80)
        cloud = np.stack([radii * np.cos(turns), radii * np.sin(turns), 0.0 * turns], axis=1)
        only(emit("camera", rng.uniform(0.2, 0.9, 80), cloud, 8.0))


@pytest.mark.parametrize("spread", [3.0, 4.0])
def test_presses_two_centimetres_apart_are_two_of_one_skin_and_of_two(spread: float) -> None:
    ends = np.array([(-10, 0, 0), (10, 0, 0)])
    for clouds in (
        [emit("skin", 0.8, ends, spread)],
        [emit(f"skin_{number}", 0.8, place, spread) for number, place in enumerate(ends)],
    ):
        found = places(fused(*clouds, surface=PALM))
        assert len(found) == 2
        np.testing.assert_allclose(found, ends, atol=2.0)


@SURFACES
@pytest.mark.parametrize("names", ["ab", "ba"])
def test_a_single_contact_is_not_where_another_source_has_its_own(
    names: str, surface: Surface | None
) -> None:
    wrist = emit(names[0], 0.9, (-35, -20, 0), 5.0, single=True)
    for skin in (
        emit(names[1], 0.9, (35, 20, 0), 5.0),
        emit(names[1], 0.9, (35, 20, 0), 5.0, single=True),
        emit(names[1], 0.9, [(35, 20, 0), (35, -20, 0), (-35, 20, 0)], 5.0),
    ):
        contacts = fused(wrist, skin, surface=surface).contacts
        assert len(contacts) == len(skin.positions) + 1
        for contact in contacts:
            assert contact.likelihood == pytest.approx(0.9, abs=0.01)
            assert np.sqrt(np.linalg.eigvalsh(contact.covariance)[-1]) < 6e-3


@pytest.mark.parametrize("kind", [REGULAR, SUPPORT])
def test_a_precise_source_elsewhere_changes_no_contact(kind: HypothesisKind) -> None:
    skin = emit("skin", 0.9, [(20 * number, 0, 0) for number in range(6)], 20 / 12**0.5)
    tip = emit("tip", 0.15, (0, 900, 0), None, kind)
    alone, beside = only(skin), only(skin, tip)
    np.testing.assert_array_equal(beside.position, alone.position)
    np.testing.assert_array_equal(beside.extent, alone.extent)
    np.testing.assert_array_equal(beside.covariance, alone.covariance)
    assert away(alone, (50, 0, 0)) < 0.1
    assert np.ptp(alone.extent[:, 0]) == pytest.approx(0.1)


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("surface", [None, PALM], ids=["no surface", "palm"])
@pytest.mark.parametrize("spreads", [(5.0,) * 5, (5.0,) * 10, (3.0, 20.0)])
def test_one_touch_is_one_contact_by_however_many_sources_with_true_spreads(
    spreads: tuple[float, ...], surface: Surface | None, single: bool
) -> None:
    rng, several = np.random.default_rng(3), 0
    for _ in range(60):
        offsets = rng.standard_normal((len(spreads), 3)) * np.array(spreads)[:, None]
        if surface is not None:
            offsets[:, 2] = 0.0
        clouds = [
            emit(f"s{number}", 0.9, offset, spread, single=single)
            for number, (offset, spread) in enumerate(zip(offsets, spreads, strict=True))
        ]
        several += len(fused(*clouds, surface=surface).contacts) > 1
    most = 3 if surface is not None else 12 if single else 7
    assert several <= most  # by a gate at two deviations, of 5 and 10 sources 36 and 50 in the air


@pytest.mark.parametrize("pitch", [2.0, 3.0, 4.0, 5.0, 8.0])
@pytest.mark.parametrize("shift", [0.0, 1.3, 2.6, 3.9])
def test_a_face_on_a_dense_skin_is_one_wherever_voxels_end(pitch: float, shift: float) -> None:
    face = np.array([(x, y, 0.1) for x in range(6) for y in range(3)]) * (pitch, pitch, 1.0)
    contact = only(emit("skin", 0.9, face + (shift, shift, 0.0), pitch / 12**0.5))
    assert away(contact, face.mean(axis=0) + (shift, shift, 0.0)) < 2.5
    assert np.ptp(contact.extent[:, 0]) * 1e3 == pytest.approx(5 * pitch, abs=3.0)


@pytest.mark.parametrize("shift", [0.0, 1.3, 2.6, 3.9])
@pytest.mark.parametrize("apart", [8.0, 9.9])
def test_taps_further_apart_than_voxels_are_unsure_are_two_wherever_voxels_end(
    shift: float, apart: float
) -> None:
    found = places(fused(emit("skin", 0.8, [(shift, 0, 0), (shift + apart, 0, 0)], None)))
    np.testing.assert_allclose(found[:, 0], (shift, shift + apart), atol=0.01)


def test_each_of_very_many_skins_makes_its_own_contact() -> None:
    places_of_skins = [(30 * i, 30 * j, 0) for i in range(20) for j in range(10)]
    clouds = [emit(f"skin_{n:03d}", 0.9, place) for n, place in enumerate(places_of_skins)]
    contacts = fused(*clouds).contacts
    assert len(contacts) == MOST
    assert all(min(away(contact, place) for place in places_of_skins) < 2.0 for contact in contacts)


# The resultant of all contacts


@SURFACES
def test_a_stuck_taxel_is_no_contact_when_the_force_is_explained_without_it(
    surface: Surface | None,
) -> None:
    stuck = emit("skin", 0.95, (-30, -20, 0))
    camera = emit("camera", 0.4, PATCH + (28, 14, 0), 12.0)
    felt: dict[str, Any] = {"single": True, "forces": np.array([DOWN] * 9)}
    wrist = emit("wrist", 0.1, PATCH + (20, 10, 0), 6.0, **felt)
    contact = only(stuck, camera, wrist, surface=surface)
    assert away(contact, (21, 11, 0)) < 2.0
    assert contact.shares["skin"] == 0.0


def test_a_second_contact_is_kept_when_the_force_needs_it() -> None:
    two = [(-30, 0, 0), (30, 0, 0)]
    skin = emit("skin", 0.95, two)
    felt: dict[str, Any] = {"single": True, "forces": np.array([DOWN] * 9)}
    between = emit("wrist", 0.1, PATCH / 2, 4.0, **felt)
    np.testing.assert_allclose(places(fused(skin, between, surface=PALM)), two, atol=2.0)


def test_a_force_that_is_hardly_a_contact_makes_none() -> None:
    faint = emit("wrist", 0.005, PATCH, single=True, forces=np.array([DOWN] * 9))
    assert fused(faint).contacts == ()


# What speaks against


def test_null_and_silence_are_missed_detections_and_no_veto() -> None:
    skin = emit("skin", (0.9, 0.5, 0.4), [(0, 1, 0), (5, 1, 0), (0, 6, 0)])
    free = emit("camera", 0.6, PATCH + (5, 2, 0), kind=NULL)
    alone, doubted = only(skin), only(skin, free)
    assert 0.5 < doubted.likelihood < alone.likelihood == pytest.approx(0.9)
    silent = emit("wrist", 0.0, [])
    doubted = only(skin, silent, wrist=0.5)
    assert doubted.likelihood == pytest.approx(0.9 * 0.5 / (0.1 + 0.9 * 0.5))


def test_support_raises_the_likelihood_of_a_contact_and_makes_none() -> None:
    here = emit("simulator", 0.5, (0, 0, 0), kind=SUPPORT)
    assert only(emit("skin", 0.8, (0, 0, 0)), here).likelihood == pytest.approx(0.9)
    far = emit("simulator", 0.5, (300, 0, 0), kind=SUPPORT)
    assert only(emit("skin", 0.8, (0, 0, 0)), far).likelihood == pytest.approx(0.8)


@SURFACES
@pytest.mark.parametrize("away_mm", [15, 25, 35])
def test_a_vague_source_hardly_moves_a_contact_that_an_exact_one_locates(
    away_mm: float, surface: Surface | None
) -> None:
    vague = emit("camera", 0.8, (away_mm, 0, 0), 10.0)
    alone = emit("skin", 0.8, (0, 0, 0), 3.0)
    pressed = emit("skin", 0.8 * np.exp(-0.5 * (PATCH / 5.0) ** 2).prod(axis=1), PATCH, 2.0)
    for skin in (alone, pressed):
        assert away(only(skin, vague, surface=surface), (0, 0, 0)) < 6.0


@SURFACES
def test_the_further_two_sources_are_apart_the_less_sure_is_the_position(
    surface: Surface | None,
) -> None:
    spreads = []
    for away_mm in (0, 10, 20, 30, 35):
        other = emit("camera", 0.8, (away_mm, 0, 0), 10.0)
        found = only(emit("skin", 0.8, (0, 0, 0), 10.0), other, surface=surface)
        spreads.append(np.sqrt(found.covariance[0, 0]) * 1e3)
    assert all(less < more for less, more in itertools.pairwise(spreads))
    assert spreads[-1] > 17.0


@SURFACES
def test_support_counts_less_the_further_away_it_is(surface: Surface | None) -> None:
    skin, believed = emit("skin", 0.6, (0, 0, 0)), []
    for away_mm in (0, 4, 8, 12, 20, 30):
        expected = emit("simulator", 0.9, (away_mm, 0, 0), kind=SUPPORT)
        believed.append(only(skin, expected, surface=surface).likelihood)
    assert believed[0] > 0.85
    assert all(near > far for near, far in itertools.pairwise(believed))
    assert believed[-1] < 0.62


def test_a_contact_lies_where_evidence_is_left_however_much_support_is_elsewhere() -> None:
    ends = [(-34, 0, 0), (34, 0, 0)]
    tips = [emit(f"tip_{place[0]}", 0.9, place) for place in ends]
    expected = [emit(f"support_{n}", 0.5, PATCH / 2 + (34, 5, 0), 6.0, SUPPORT) for n in range(4)]
    found = places(fused(*tips, *expected, surface=FINGERS))
    np.testing.assert_allclose(found, ends, atol=7.0)


def test_free_space_everywhere_leaves_the_area_of_a_press_where_it_is() -> None:
    skin = emit("skin", (0.9, 0.95, 0.9), [(20, 0, 0), (24, 0, 0), (28, 0, 0)])
    free = emit("camera", 0.95, PALM.points * 1e3, 4.0, NULL)
    members = fused(skin, free, surface=PALM).field.members
    assert members is not None and len(members) == 1
    assert np.abs(members[0].contact.extent * 1e3 - (24, 0, 0)).max() < 10.0


def test_two_feet_on_a_plate_are_two_contacts_each_with_its_part_of_the_weight() -> None:
    plate = ShapeConfig(shape="rectangle", size=(0.6, 0.5)).sampled("hand", 0.01)
    foot = [(x, y, 0) for x in range(-100, 101, 20) for y in range(-40, 41, 20)]
    left, right = np.array(foot) + (20, 120, 0), np.array(foot) + (-60, -130, 0)
    skin = emit("skin", 0.9, [*left, *right], 20 / 12**0.5)
    weights = {(20, 120): 300.0, (-60, -130): 450.0}
    force = np.array([0.0, 0.0, -750.0])
    torques = [np.cross((x / 1e3, y / 1e3, 0.0), (0.0, 0.0, -w)) for (x, y), w in weights.items()]
    measured = Resultant(force, np.sum(torques, axis=0), np.zeros(3), 2.0, 0.5)
    wrench = emit("wrench", [], [], resultant=measured)
    fusion = fused(skin, wrench, surface=plate)
    assert len(fusion.contacts) == 2
    for (x, y), weight in weights.items():
        contact = min(fusion.contacts, key=lambda each: away(each, (x, y, 0)))
        assert away(contact, (x, y, 0)) < 10.0
        assert contact.force[2] == pytest.approx(-weight, rel=0.05)
        assert np.ptp(contact.extent[:, 0]) == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize("pressed", [(-60.0, 10.0), (0.0, 0.0), (75.0, -20.0)])
def test_a_face_in_flat_contact_lies_at_its_centre_of_pressure(
    pressed: tuple[float, float],
) -> None:
    """The wrench of one foot: its force acts anywhere under it, with friction and torsion."""
    plate = ShapeConfig(shape="rectangle", size=(0.6, 0.5)).sampled("hand", 0.01)
    foot = [(x, y, 0) for x in range(-100, 101, 20) for y in range(-40, 41, 20)]
    skin = emit("skin", 0.9, foot, 20 / 12**0.5)
    force, place = np.array([20.0, -10.0, -500.0]), np.array([*pressed, 0.0]) / 1e3
    torque = np.cross(place, force) + (0.0, 0.0, 0.7)
    wrench = emit("wrench", [], [], resultant=Resultant(force, torque, np.zeros(3), 2.0, 0.5))
    contact = only(skin, wrench, surface=plate)
    assert away(contact, (*pressed, 0.0)) < 1.0
    assert np.ptp(contact.extent[:, 0]) == pytest.approx(0.2, abs=0.03)
    along = np.sqrt(contact.covariance.diagonal()[:2])
    np.testing.assert_allclose(along, 0.5 / 500.0, rtol=0.2)
    assert away(only(skin, surface=plate), (0.0, 0.0, 0.0)) < 5.0  # else it lies in its middle


def test_a_wrench_that_pulls_moves_no_face() -> None:
    plate = ShapeConfig(shape="rectangle", size=(0.6, 0.5)).sampled("hand", 0.01)
    foot = [(x, y, 0) for x in range(-100, 101, 20) for y in range(-40, 41, 20)]
    skin = emit("skin", 0.9, foot, 20 / 12**0.5)
    force = np.array([0.0, 0.0, 500.0])
    pulls = Resultant(force, np.array([0.0, -30.0, 0.0]), np.zeros(3), 2.0, 0.5)
    contact = only(skin, emit("wrench", [], [], resultant=pulls), surface=plate)
    assert away(contact, (0.0, 0.0, 0.0)) < 5.0


# What a contact says of itself


@pytest.mark.parametrize("spread", [2.0, 4.0, 10.0])
def test_a_stated_spread_comes_back_as_covariance(spread: float) -> None:
    alone = only(emit("skin", 0.9, (0, 0, 0), spread))
    np.testing.assert_allclose(alone.covariance, np.eye(3) * (spread / 1e3) ** 2, atol=1e-9)
    wide = ShapeConfig(shape="rectangle", size=(0.1, 0.1)).sampled("hand", 0.001)
    on_it = only(emit("skin", 0.9, (0, 0, 0), spread), surface=wide).covariance
    np.testing.assert_allclose(on_it[:2, :2], np.eye(2) * (spread / 1e3) ** 2, rtol=0.12, atol=1e-8)
    # across the surface a contact is as unsure as a position in a voxel, however wide the spread
    assert np.sqrt(on_it[2, 2]) == pytest.approx(0.005 / np.sqrt(12.0), rel=0.05)


def test_a_force_that_crosses_the_hand_twice_leaves_both_ends_in_the_covariance() -> None:
    line = np.array([(x, 0.0, 0.0) for x in range(-60, 61, 4)])
    wrench = emit("wrench", np.full(len(line), 0.9 / len(line)), line, 6.0, single=True)
    contact = only(wrench, surface=FINGERS)
    other = contact.position * (-1, 1, 1)
    offset = other - contact.position
    assert offset @ np.linalg.solve(contact.covariance, offset) < 2.5**2
    assert np.ptp(contact.extent, axis=0).max() == 0.0  # it is not known to be large


@given(sure=st.tuples(st.floats(0.05, 0.99), st.floats(0.05, 0.99)), x=st.floats(-10.0, 30.0))
@settings(deadline=None, max_examples=50)
def test_the_surer_free_space_is_the_less_likely_is_a_contact_near_it(
    sure: tuple[float, float], x: float
) -> None:
    skin = emit("skin", (0.6, 0.9, 0.7), [(0, 0, 0), (4, 0, 0), (8, 0, 0)])
    likelihoods = []
    for p in sorted(sure):
        free = emit("free", p, PATCH + (x, 0, 0), 4.0, NULL)
        members = fused(skin, free, surface=PALM).field.members
        assert members is not None
        likelihoods.append(members[0].contact.likelihood)
    assert likelihoods[1] <= likelihoods[0] + 1e-6


def test_a_position_without_spread_is_as_unsure_as_its_voxel() -> None:
    contact = only(emit("skin", 0.9, (0, 0, 0), None))
    np.testing.assert_allclose(contact.covariance, np.eye(3) * 0.005**2 / 12.0)


def test_what_lies_off_the_surface_is_no_contact_beside_what_lies_on_it() -> None:
    on, off = emit("skin", 0.8, (0, 0, 0)), emit("camera", 0.9, (0, 0, 400))
    assert away(only(on, off, surface=PALM), (0, 0, 0)) < 1.0
    assert away(only(off, surface=PALM), (0, 0, 400)) < 1.0


def test_members_needs_a_rule_that_finds_contacts() -> None:
    with pytest.raises(ConfigurationError, match="'members' needs a rule that finds the contacts"):
        Integrator(IntegratorConfig(rule="de_morgan", condensation="members"))


def test_voxels_are_as_likely_as_the_contact_near_them() -> None:
    fusion = fused(emit("skin", 0.8, [(0, 0, 0), (60, 0, 0)]), emit("camera", 0.5, (60, 0, 0)))
    likelihoods = dict(zip(fusion.space.voxels[:, 0], fusion.space.likelihoods, strict=True))
    assert likelihoods == pytest.approx({0: 0.8, 12: 0.9})


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    sources=st.integers(1, 4),
    surface=st.sampled_from([None, PALM, HALVES]),
    pitch=st.sampled_from([None, 5.0, 8.0]),
)
def test_any_clouds_give_contacts_with_probabilities_the_same_ones_again(
    seed: int, sources: int, surface: Surface | None, pitch: float | None
) -> None:
    rng = np.random.default_rng(seed)
    clouds = []
    for number in range(sources):
        n = int(rng.integers(0, 40))
        single = bool(rng.integers(2))
        p = rng.uniform(0.01, 0.95, n) / (max(n, 1) if single else 1)
        mm = rng.uniform(-60, 60, (n, 3)) * (1, 1, 0.1)
        if pitch is not None:  # as taxels lie
            grid = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4), [0]), axis=-1)
            mm = pitch * rng.permutation(grid.reshape(-1, 3))[:n]
        kind = (REGULAR, REGULAR, SUPPORT, NULL)[int(rng.integers(4))]
        spread, others = float(rng.uniform(0.5, 20.0)), dict[str, Any]()
        if single and kind == REGULAR:
            force = rng.normal(0, 3, 3)
            others["forces"] = force + rng.normal(0, rng.choice([0.0, 3.0]), (n, 3))
            links = ((), ("left",), ("right",), ("left", "right"))[int(rng.integers(4))]
            if links or rng.integers(2):
                torque = rng.normal(0, 0.1, 3)
                others["resultant"] = Resultant(force, torque, np.zeros(3), 0.2, 0.01, links)
        clouds.append(emit(f"s{number}", p, mm, spread, kind, single=single, **others))
    fusion = fused(*clouds, surface=surface)
    assert contents(fusion) == contents(fused(*clouds[::-1], surface=surface))
    for contact in fusion.contacts:
        assert 0.5 - 1e-5 <= contact.likelihood <= 1.0
        assert np.linalg.eigvalsh(contact.covariance)[0] > 0.0
        assert sum(contact.shares.values()) == pytest.approx(1.0)
        assert np.isfinite(contact.position).all() and np.isfinite(contact.extent).all()


@SURFACES
def test_many_sources_that_agree_find_one_contact(surface: Surface | None) -> None:
    """The product of what so many say is beyond what a float holds."""
    rng = np.random.default_rng(0)
    clouds = [emit(f"source {row}", 0.5, PATCH + rng.normal(0.0, 1.0, 3)) for row in range(400)]
    contact, *others = fused(*clouds, surface=surface).contacts
    assert np.linalg.norm(contact.position) < 3e-3
    assert contact.likelihood > 0.99
    assert not others


def test_places_of_many_sources_in_one_voxel_are_one(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    clouds = [emit(f"source {row}", 0.5, PATCH + rng.normal(0.0, 1.0, 3)) for row in range(40)]
    before = fused(*clouds).contacts[0]
    monkeypatch.setattr(likelihood_fields, "MANY", 100)
    fusion = fused(*clouds)
    assert away(fusion.contacts[0], 1e3 * before.position) < 2.5  # half a voxel
    assert fusion.field.members is not None
    voxels = fusion.field.entries.grid.voxels(fusion.field.members[0].places)
    assert len(np.unique(voxels, axis=0)) == len(voxels)


def test_of_many_factors_the_product_is_relative_and_of_few_it_is_exact() -> None:
    few = np.array([[2.0, 3.0, 1.0], [0.5, 0.25, 1.0]])
    np.testing.assert_array_equal(product(few), [1.0, 0.75, 1.0])
    many = np.repeat([[50.0, 25.0, 1.0]], 400, axis=0)
    np.testing.assert_allclose(product(many), [1.0, 0.5**400, 0.0], rtol=1e-9, atol=1e-300)
    np.testing.assert_allclose(product(1.0 / many)[2], 1.0)


def pushed(
    source: str, p: float, at: Any, force: Any = DOWN, spread: float = 4.0
) -> HypothesisCloud:
    """A single contact whose force a source knows, somewhere in a square of 1 cm [mm]."""
    mm, forces = PATCH + np.asarray(at), np.tile(force, (len(PATCH), 1))
    return emit(source, p / len(mm), mm, spread, single=True, forces=forces)


@pytest.mark.parametrize("p", [0.2, 0.3, 0.49, 0.6, 0.8])
def test_a_force_makes_no_contact_surer_than_its_source_is(p: float) -> None:
    field = fused(pushed("wrist", p, (0, 0, 0)), surface=PALM).field
    assert field.members is not None
    assert max(each.contact.likelihood for each in field.members) == pytest.approx(p, abs=1e-6)


def test_silence_and_null_speak_against_a_contact_by_force_alone() -> None:
    wrist, silent = pushed("wrist", 0.6, (0, 0, 0)), emit("skin", [], [])
    free = emit("free", 0.95, PALM.points * 1e3, kind=NULL)
    (alone,) = fused(wrist, surface=PALM).contacts
    assert alone.likelihood == pytest.approx(0.6, abs=1e-6)
    for others in ((silent,), (free,), (silent, free)):
        field = fused(wrist, *others, surface=PALM, skin=0.9).field
        assert all(each.contact.likelihood < 0.3 for each in field.members or ())


def test_names_of_sources_of_force_make_no_difference() -> None:
    def contacts(first: str, second: str) -> list[float]:
        clouds = (
            pushed(first, 0.85, (-26, -19, 0), (-0.5, 0.6, -4.9)),
            pushed(second, 0.84, (30, -32, 0), (-0.6, -0.1, -5.0)),
        )
        found = fused(*clouds, surface=PALM).contacts
        return sorted(round(contact.likelihood, 6) for contact in found)

    assert contacts("a", "b") == contacts("b", "a") != []


FAR = (60, 0, 0)


@pytest.mark.parametrize(
    ("clouds", "contacts"),
    [
        pytest.param([emit(f"s{k:03d}", 1.0, (0, 0, 0)) for k in range(170)], 1, id="170 agree"),
        pytest.param(
            [emit("skin", 0.9, (0, 0, 0)), emit("b", 0.3, FAR)]
            + [emit(f"s{k:03d}", 0.5, FAR, kind=SUPPORT) for k in range(200)],
            2,
            id="200 support elsewhere",
        ),
        pytest.param(
            [emit("skin", 0.9, (0, 0, 0))]
            + [emit(f"s{k:03d}", 1.0, (0, 0, 0), kind=NULL) for k in range(170)],
            0,
            id="170 null",
        ),
        pytest.param([emit("skin", 0.9, [(0, 0, 0), (20, 0, 0)], 1e8)], 1, id="100 km unsure"),
    ],
)
def test_hundreds_of_sources_and_vast_spreads_are_taken(
    clouds: list[HypothesisCloud], contacts: int
) -> None:
    assert len(fused(*clouds).contacts) == contacts


WRENCH = Resultant(np.array(DOWN), np.array([1.0, 1.0, 0.0]), np.zeros(3), 0.1, 0.01)
"""Which no contact explains alone."""
POINT = Surface("hand", np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
SHEET = Surface(
    "hand",
    np.concatenate([PALM.points + (0.0, 0.0, z) for z in (-5e-4, 5e-4)]),
    np.concatenate([np.tile((0.0, 0.0, z), (len(PALM.points), 1)) for z in (-1.0, 1.0)]),
)
"""Thin, and seen from both sides."""


@pytest.mark.parametrize("surface", [POINT, SHEET], ids=["a point", "a thin sheet"])
def test_a_wrench_is_explained_on_any_surface(surface: Surface) -> None:
    skin = emit("skin", 0.9, (0, 0, 0))
    for wrench in (WRENCH, Resultant(np.array(DOWN), np.zeros(3), np.zeros(3), 0.1, 0.01)):
        contacts = fused(skin, emit("wrist", [], [], resultant=wrench), surface=surface).contacts
        assert contacts and all(np.isfinite(each.covariance).all() for each in contacts)


@pytest.mark.parametrize("kind", [SUPPORT, NULL])
def test_only_evidence_measures_a_sum(kind: HypothesisKind) -> None:
    clouds = emit("skin", 0.9, (20, 0, 0)), emit("wrist", [], [], kind=kind, resultant=WRENCH)
    (contact,) = fused(*clouds, surface=PALM).contacts
    assert contact.likelihood == pytest.approx(0.9, abs=1e-6)


def test_a_wrench_beside_hundreds_of_nulls_is_taken() -> None:
    nulls = [emit(f"s{k:03d}", 1.0, PALM.points * 1e3, kind=NULL) for k in range(400)]
    skin, wrist = emit("skin", 0.9, (20, 0, 0)), emit("wrist", [], [], resultant=WRENCH)
    assert not fused(skin, wrist, *nulls, surface=PALM).contacts
