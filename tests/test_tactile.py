"""Pressed taxels become hypotheses; a patch that may be dead rules nothing out."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Grid, Pipeline, PipelineConfig, State
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.files import write_npz
from contactfusion.generators.tactile import PERSISTS, Health, TactileConfig, TactileGenerator
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Note
from contactfusion.integrator.sources import EventKind
from contactfusion.pipeline import Step
from contactfusion.readings import TactileImage

SIDE = 0.005
GRID = Grid("palm", SIDE)
ROW = {"grid": {"rows": 1, "columns": 4, "pitch": (SIDE, SIDE)}}
"""Four taxels as large as a voxel, along y."""
WIDE = {"grid": {"rows": 1, "columns": 4, "pitch": (0.02, 0.02)}}
"""Four taxels of 4 × 4 voxels, along y."""


OF_READING: dict[str, Any] = {"relative_to": "reading"}


def generator(patch: dict[str, Any] = ROW, **options: Any) -> TactileGenerator:
    return TactileGenerator("skin", TactileConfig(**{"patch": patch, **options}))


def image(*values: float, stamp: float = 0.0) -> TactileImage:
    return TactileImage(stamp=stamp, frame="palm", values=np.array(values))


def felt(reading: TactileImage, patch: dict[str, Any] = ROW, **options: Any) -> HypothesisCloud:
    state = State(now=reading.stamp, grid=GRID)
    return generator(patch, **options).generate(reading, state)[0]


def by_taxel(cloud: HypothesisCloud) -> dict[float, float]:
    """The likelihood at each y [mm]."""
    y = (cloud.positions[:, 1] * 1000.0).round(6)
    return dict(zip(y.tolist(), cloud.likelihoods.tolist(), strict=True))


def test_the_likelihood_is_the_value_over_the_largest_of_the_reading() -> None:
    cloud = felt(image(10.0, 20.0, 40.0, 0.0), p_max=1.0, **OF_READING)
    assert by_taxel(cloud) == {-7.5: 0.25, -2.5: 0.5, 2.5: 1.0}
    assert cloud.kind == HypothesisKind.REGULAR and not cloud.single


def _read(gen: TactileGenerator, pressed: int, readings: int, stuck: bool) -> HypothesisCloud:
    """A row of taxels with noise, the last of which stays at 3; one is pressed at last."""
    rng, clouds = np.random.default_rng(0), []
    for number in range(readings):
        values = 0.1 * rng.standard_normal(4)
        values[pressed] += 10.0 * (number == readings - 1)
        values[3] = 3.0 if stuck else 3.0 + 0.1 * rng.standard_normal()
        reading = image(*values, stamp=0.05 * number)
        clouds.append(gen.generate(reading, State(now=reading.stamp, grid=GRID))[0])
    return clouds[-1]


def test_a_taxel_that_never_changes_is_stuck() -> None:
    quiet = {"baseline": {"noise": 0.1}}
    cloud = _read(generator(**quiet), 0, 20, stuck=True)
    assert set(by_taxel(cloud)) == {-7.5}
    assert cloud.notes == ("1 of the taxels never change: stuck?",)
    assert set(by_taxel(_read(generator(**quiet), 0, 20, stuck=False))) == {-7.5, 7.5}


def test_a_stuck_taxel_alone_is_silence() -> None:
    cloud = _read(generator(baseline={"noise": 0.1}, floor=500.0), 0, 20, stuck=True)
    assert not len(cloud) and not cloud.notes


def test_nothing_is_stuck_before_most_taxels_have_changed() -> None:
    cloud = _read(generator(baseline={"noise": 0.1}), 0, 8, stuck=True)
    assert set(by_taxel(cloud)) == {-7.5, 7.5}
    still = generator()
    for number in range(30):
        reading = image(0.0, 0.0, 10.0, 0.0, stamp=0.05 * number)
        cloud = still.generate(reading, State(now=reading.stamp, grid=GRID))[0]
    assert set(by_taxel(cloud)) == {2.5}


def test_with_a_gain_the_forces_add_up_to_a_resultant() -> None:
    values, gain = np.array([10.0, 20.0, 40.0, 0.0]), 0.05
    y = np.array([-7.5, -2.5, 2.5, 7.5]) / 1e3
    cloud = felt(image(*values), gain=gain, baseline={"noise": 0.5}, noise=0.001)
    assert cloud.resultant is not None
    np.testing.assert_allclose(cloud.resultant.force, (0.0, 0.0, -gain * values.sum()))
    centre = values @ y / values.sum()
    expected = np.cross((0.0, centre, 0.0), cloud.resultant.force)
    np.testing.assert_allclose(cloud.resultant.torque, expected, atol=1e-12)
    assert cloud.resultant.force_deviation == pytest.approx(gain * 0.5 * np.sqrt(3.0))
    strength = gain * values.sum()
    assert 0.001 * strength < cloud.resultant.torque_deviation < 0.0012 * strength
    assert felt(image(*values)).resultant is None
    assert felt(image(0.0, 0.0, 0.0, 0.0), gain=gain).resultant is None


def test_forces_point_against_the_facing_of_the_taxels() -> None:
    turned = {"grid": {**ROW["grid"], "rpy": (np.pi / 2.0, 0.0, 0.0)}}
    cloud = felt(image(0.0, 20.0, 20.0, 0.0), turned, gain=0.1)
    assert cloud.resultant is not None
    np.testing.assert_allclose(cloud.resultant.force, (0.0, 4.0, 0.0), atol=1e-12)


def test_the_largest_is_that_of_all_patches_in_the_reading() -> None:
    two = {"places": [(0.0, 0.0, 0.0), (0.0, 0.1, 0.0)], "size": (SIDE, SIDE)}
    cloud = felt(image(10.0, 40.0), two, p_max=1.0, **OF_READING)
    assert by_taxel(cloud) == {0.0: 0.25, 100.0: 1.0}


def test_relative_to_its_neighbours_a_light_press_beside_a_firm_one_counts() -> None:
    two = {"grid": {"rows": 1, "columns": 7, "pitch": (SIDE, SIDE)}}
    cloud = felt(image(40, 20, 0, 0, 6, 8, 0), two, relative_to="neighbours")
    expected = {-15.0: 0.95, -10.0: 0.5, 5.0: 0.75, 10.0: 0.95}
    assert by_taxel(cloud) == pytest.approx(expected)
    assert not len(felt(image(0, 0, 0, 0, 0, 0, 0), two, relative_to="neighbours"))


def test_a_likelihood_is_capped() -> None:
    cloud = felt(image(10.0, 39.0, 40.0, 0.0), **OF_READING)
    assert by_taxel(cloud) == {-7.5: 0.25, -2.5: 0.95, 2.5: 0.95}


def test_a_taxel_under_five_sigma_is_not_touched() -> None:
    baseline = {"values": (100.0, 0.0, 0.0, 0.0), "noise": (2.0, 2.0, 2.0, 20.0)}
    reading = image(110.0, 9.9, 20.0, 99.0)
    cloud = felt(reading, baseline=baseline, p_max=1.0, **OF_READING)
    assert by_taxel(cloud) == {-7.5: 0.5, 2.5: 1.0}
    assert not len(felt(image(109.0, 9.0, 9.0, 99.0), baseline=baseline))
    assert by_taxel(felt(reading, baseline=baseline, floor=10.0)) == {2.5: 0.95}


@pytest.mark.parametrize(
    ("touch", "expected"),
    [("rises", {-7.5}), ("falls", {-2.5}), ("either", {-7.5, -2.5})],
)
def test_taxels_may_rise_fall_or_do_either(touch: str, expected: set[float]) -> None:
    reading = image(250.0, 150.0, 200.0, 200.0)
    assert set(by_taxel(felt(reading, baseline={"values": 200.0, "touch": touch}))) == expected


def test_a_wide_taxel_gives_places_over_its_area_with_spreads_of_their_voxels() -> None:
    cloud = felt(image(0.0, 9.0, 0.0, 0.0), WIDE, noise=0.0)
    assert len(np.unique(GRID.voxels(cloud.positions), axis=0)) == len(cloud) == 16
    assert np.abs(cloud.positions - [0.0, -0.01, 0.0]).max() <= 0.01
    assert cloud.spreads is not None
    np.testing.assert_allclose(cloud.spreads, 0.005 / np.sqrt(12.0))  # of a uniform square
    unsure = felt(image(0.0, 9.0, 0.0, 0.0), WIDE, noise=0.004).spreads
    assert unsure is not None
    np.testing.assert_allclose(unsure, np.hypot(0.005 / np.sqrt(12.0), 0.004))


def in_palm(generators: dict[str, Any], **config: Any) -> Pipeline:
    fields = {"generators": generators, "integrator": {"frame": "palm"}, **config}
    return Pipeline(PipelineConfig(**fields))


def pipeline(rule: str = "sets", **options: Any) -> Pipeline:
    skin = {"type": "tactile", "sensor": "palm", "patch": WIDE, **options}
    # A second source stands for a LiDAR: one taxel that may lie anywhere.
    lidar = {
        "type": "tactile",
        "sensor": "lidar",
        "patch": {"places": [(0.0, 0.03, 0.0)], "size": (SIDE, SIDE)},
    }
    return in_palm({"skin": skin, "lidar": lidar}, integrator={"frame": "palm", "rule": rule})


def cycle(pipe: Pipeline, palm: FloatArray | None, lidar: bool, stamp: float) -> Step:
    if palm is not None:
        pipe.receive(replace(image(*palm, stamp=stamp), sensor="palm"))
    pipe.receive(replace(image(50.0 if lidar else 0.0, stamp=stamp), sensor="lidar"))
    return pipe.step(stamp)


def test_neighbours_form_one_cluster_whose_centroid_interpolates() -> None:
    for share, expected in ((1.0, 0.0), (0.5, -0.0033), (0.25, -0.006)):
        pipe = pipeline("de_morgan", p_max=1.0)
        step = cycle(pipe, np.array([0.0, 80.0, 80.0 * share, 0.0]), False, 0.0)
        (contact,) = step.fusion.contacts
        assert contact.position[1] == pytest.approx(expected, abs=0.0005)


def test_a_baseline_file_is_found_from_the_folder_of_the_configuration(tmp_path: Path) -> None:
    write_npz(tmp_path / "palm.npz", values=np.full(4, 30.0), noise=np.ones(4))
    skin = {"type": "tactile", "patch": ROW, "baseline": {"file": "palm.npz"}}
    pipe = in_palm({"skin": skin}, folder=tmp_path)
    pipe.receive(image(30.0, 30.0, 40.0, 30.0))
    (contact,) = pipe.step(0.0).fusion.contacts
    assert contact.position[1] == pytest.approx(0.0025)


def test_a_missing_baseline_file_is_named_with_its_generator(tmp_path: Path) -> None:
    skin = {"type": "tactile", "patch": ROW, "baseline": {"file": "palm.npz"}}
    with pytest.raises(ConfigurationError, match="generators.skin: there is no file 'palm.npz'"):
        in_palm({"skin": skin}, folder=tmp_path)


def test_another_number_of_values_is_refused_and_counted() -> None:
    with pytest.raises(InvalidReadingError, match="3 values, but the patch of 'skin' has 4 taxels"):
        felt(image(1.0, 2.0, 3.0))
    step = cycle(pipeline(), np.ones(3), False, 0.0)
    assert step.fusion.report.sources["skin"].invalid == 1
    assert [event.source for event in step.events if event.kind == EventKind.REFUSED] == ["skin"]


def test_a_value_that_is_not_finite_is_no_reading() -> None:
    with pytest.raises(InvalidReadingError, match="row 1 of the values"):
        image(1.0, np.nan)


@pytest.mark.parametrize(
    ("options", "problem"),
    [({"replace": False}, "free needs replace"), ({"timeout": 3.0}, "may not exceed")],
)
def test_options_by_which_a_dead_patch_rules_out_for_long_are_refused(
    options: dict[str, Any], problem: str
) -> None:
    generator(**options)
    with pytest.raises(ConfigurationError, match=problem):
        generator(free=True, **options)


# What a patch rules out: the output "free".

NOISE = np.random.default_rng(0).normal(size=(2000, 4))
"""Untouched values; the noise of the baseline is 1."""


def noisy(step: int) -> FloatArray:
    values: FloatArray = NOISE[step]
    return values


def free(ft: TactileGenerator, reading: TactileImage) -> HypothesisCloud:
    return ft.generate(reading, State(now=reading.stamp, grid=GRID))[1]


def test_noise_lets_a_patch_rule_contacts_out() -> None:
    skin = generator(WIDE, free=True)
    first = free(skin, image(*noisy(0)))
    assert not len(first) and first.notes == (Note.UNHEALTHY,)
    second = free(skin, image(*noisy(1), stamp=0.01))
    assert second.kind == HypothesisKind.NULL and not second.notes
    assert len(second) == 4 * 16 and (second.likelihoods == 1.0).all()


def test_noise_on_less_than_half_of_the_taxels_is_not_enough() -> None:
    skin = generator(WIDE, free=True)
    for step in range(100):
        values = noisy(step) * [1.0, 0.0, 0.0, 0.0]
        assert free(skin, image(*values, stamp=0.01 * step)).notes == (Note.UNHEALTHY,)


def test_a_patch_that_stops_changing_falls_silent_after_the_window() -> None:
    skin = generator(WIDE, free=True, health_window=1.0)
    free(skin, image(*noisy(0)))
    free(skin, image(*noisy(1), stamp=1.0))
    assert len(free(skin, image(*noisy(1), stamp=2.0)))
    assert not len(free(skin, image(*noisy(1), stamp=2.01)))
    assert len(free(skin, image(*noisy(2), stamp=2.02)))


def test_a_self_test_makes_a_patch_healthy_for_the_window() -> None:
    skin = generator(WIDE, free=True, health_window=1.0)
    assert not len(free(skin, image(0.0, 0.0, 0.0, 0.0, stamp=0.0)))
    skin.self_test_passed(0.5)
    assert len(free(skin, image(0.0, 0.0, 0.0, 0.0, stamp=1.5)))
    assert not len(free(skin, image(0.0, 0.0, 0.0, 0.0, stamp=1.51)))


def test_a_reset_forgets_that_it_was_healthy() -> None:
    skin = generator(WIDE, free=True)
    skin.self_test_passed(0.0)
    skin.reset()
    assert not len(free(skin, image(0.0, 0.0, 0.0, 0.0)))


def test_a_touched_taxel_and_its_neighbours_rule_nothing_out() -> None:
    skin = generator(WIDE, free=True)
    skin.self_test_passed(0.0)
    cloud = free(skin, image(90.0, 0.0, 0.0, 0.0))
    assert set(np.sign(cloud.positions[:, 1])) == {1.0}  # the third and the fourth taxel


@pytest.mark.parametrize("shift", [0.0, 0.001, 0.0024, 0.004])
def test_a_patch_never_rules_out_its_own_contact(shift: float) -> None:
    # Taxels of 4 mm share voxels of 5 mm with their neighbours, wherever the patch lies.
    places = [(0.004 * i, 0.004 * j + shift, shift) for i in range(9) for j in range(9)]
    skin = {
        "type": "tactile",
        "patch": {"places": places, "size": (0.004, 0.004)},
        "free": True,
    }
    pipe = in_palm({"skin": skin})
    rng = np.random.default_rng(0)
    ruled_out = 0
    for step in range(10):
        values = rng.normal(size=81)
        values[40] += 50.0
        pipe.receive(image(*values, stamp=0.01 * step))
        fusion = pipe.step(0.01 * step).fusion
        (contact,) = fusion.contacts
        assert np.linalg.norm(contact.position - places[40]) < 0.005
        ruled_out += "nulled" in fusion.space.verdicts
    assert ruled_out == 9  # all but the first, when nothing showed it healthy


def test_a_contact_that_another_source_confirms_shows_health() -> None:
    pipe = pipeline(free=True, health_window=1.0)
    constant = np.array([0.0, 0.0, 0.0, 60.0])  # a quiet, quantised skin that is pressed
    unhealthy, ruling_out = [], []
    for step in range(150):
        fusion = cycle(pipe, constant, 50 <= step < 60, 0.02 * step).fusion
        unhealthy.append(("skin/free", Note.UNHEALTHY) in fusion.report.notes)
        ruling_out.append("nulled" in fusion.space.verdicts)
    assert all(unhealthy[:51]) and not any(unhealthy[51:109]) and all(unhealthy[111:])
    assert ruling_out == [not ill for ill in unhealthy]


def seen(step: Step) -> bool:
    """Whether a contact of the LiDAR was reported."""
    return any(contact.shares["lidar"] > 0.0 for contact in step.fusion.contacts)


def test_a_healthy_patch_rules_out_a_short_contact_of_another_source() -> None:
    pipe = pipeline(free=True)
    for step in range(20):
        assert not seen(cycle(pipe, noisy(step), step >= 10, 0.01 * step))


def test_it_falls_silent_where_the_evidence_of_another_source_persists() -> None:
    pipe = pipeline(free=True)
    first = None
    for step in range(200):
        told = cycle(pipe, noisy(step), step >= 50, 0.01 * step)
        if seen(told):
            first = first or 0.01 * step
            assert "nulled" in told.fusion.space.verdicts  # other taxels still rule out
        else:
            assert first is None  # from then on the contact stays
    assert first == pytest.approx(0.5 + PERSISTS, abs=0.05)


def test_it_speaks_again_when_the_other_source_is_done() -> None:
    pipe = pipeline(free=True)
    for step in range(200):
        cycle(pipe, noisy(step), 50 <= step < 100, 0.01 * step)
    assert not seen(cycle(pipe, noisy(200), True, 2.0))


WINDOW = 1.0
FAULT = 0.5
"""When the patch fails [s]."""
FAULTS: dict[str, Callable[[FloatArray], FloatArray | None]] = {
    "silent": lambda last: None,
    "stuck at zero": lambda last: np.zeros(4),
    "stuck at its last value": lambda last: last,
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("pressed", [False, True])
@pytest.mark.parametrize("period", [1, 15, 1000], ids=["flickers", "pulses", "stays"])
def test_no_fault_forbids_another_sources_contact_for_longer_than_the_window(
    fault: str, pressed: bool, period: int
) -> None:
    # The LiDAR's contact comes for good, or in pulses too short to persist.
    pipe = pipeline("de_morgan", free=True, health_window=WINDOW, timeout=0.5)
    last = noisy(0)
    forbidden = []
    for step in range(220):
        now = 0.01 * step
        if now < FAULT:
            last = noisy(step) + [90.0 * pressed, 0.0, 0.0, 0.0]
        palm = last if now < FAULT else FAULTS[fault](last)
        touching = now > FAULT and step // period % 2 == 0
        told = cycle(pipe, palm, touching, now)
        if touching and not seen(told):
            forbidden.append(now)
    assert forbidden
    assert max(forbidden) <= FAULT + WINDOW + 0.02


def test_the_three_faults_look_different_in_the_report() -> None:
    reports = {}
    for fault, broken in FAULTS.items():
        pipe = pipeline(free=True, health_window=WINDOW, stale_after=0.5)
        last, steps = noisy(0), []
        for step in range(250):
            last = last if 0.01 * step >= FAULT else noisy(step) + [90.0, 0.0, 0.0, 0.0]
            palm = last if 0.01 * step < FAULT else broken(last)
            steps.append(cycle(pipe, palm, False, 0.01 * step))
        events = {(event.kind, event.source) for step in steps for event in step.events}
        fusion = steps[-1].fusion
        stale = (EventKind.STALE, "skin") in events
        unhealthy = ("skin/free", Note.UNHEALTHY) in fusion.report.notes
        reports[fault] = stale, unhealthy, bool(fusion.contacts)
    assert reports == {
        "silent": (True, False, False),
        "stuck at zero": (False, True, False),
        "stuck at its last value": (False, True, True),
    }


# Signs of life, and how long they count

YES, NO = np.array([True, True]), np.array([False, False])


def test_nothing_is_known_at_first() -> None:
    assert not Health(2, window=1.0).healthy(0.0)


def test_the_first_values_are_no_change() -> None:
    health = Health(2, window=1.0)
    health.watch(0.0, np.array([5.0, 6.0]))
    assert not health.healthy(0.0)


def test_a_change_of_half_the_taxels_counts_for_one_window() -> None:
    health = Health(4, window=1.0)
    health.watch(0.0, np.zeros(4))
    health.watch(0.5, np.array([1.0, 0.0, 0.0, 0.0]))
    assert not health.healthy(0.5)
    health.watch(1.0, np.array([1.0, 1.0, 0.0, 0.0]))
    assert health.healthy(1.5)
    assert not health.healthy(1.75)  # the first taxel changed more than a window ago
    health.watch(1.75, np.array([1.0, 1.0, 0.0, 0.0]))
    assert not health.healthy(1.75)


def test_a_confirmation_counts_for_one_window() -> None:
    health = Health(2, window=1.0)
    health.confirm(1.0)
    assert health.healthy(2.0)
    assert not health.healthy(2.01)


def test_a_dispute_is_one_that_lasts() -> None:
    health = Health(2, window=1.0)
    assert not health.disputed(1.0, YES).any()
    assert not health.disputed(1.0 + PERSISTS, np.array([True, False])).any()
    assert health.disputed(1.001 + PERSISTS, YES).tolist() == [True, False]
    assert not health.disputed(1.1 + PERSISTS, NO).any()
    assert not health.disputed(1.2 + PERSISTS, YES).any()
