"""A wrench becomes places on the surface: hand-computed cases, and honest uncertainty."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactfusion import Grid, Pipeline, PipelineConfig, State
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.frames import FrameTree, Pose, inverse, points_in, pose_of, vectors_in
from contactfusion.generators.force_torque import (
    ForceTorqueConfig,
    ForceTorqueGenerator,
    line_of_action,
)
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Note
from contactfusion.integrator.sources import EventKind
from contactfusion.pipeline import Step
from contactfusion.readings import TactileImage, Wrench
from contactfusion.shapes import BodyConfig
from contactfusion.surface import Surface

GRID = Grid("base", 0.005)
DOWN = np.array([0.0, 0.0, -10.0])
PLACE = np.array([0.021, -0.033, 0.02])
"""On the top of the box."""


def body(**shape: Any) -> BodyConfig:
    return BodyConfig.model_validate({"frame": "base", "spacing": 0.004, "shapes": [shape]})


def sampled(**shape: Any) -> Surface:
    return body(**shape).sampled(Path())


BOX = sampled(shape="box", size=(0.2, 0.2, 0.04))


def generator(**options: Any) -> ForceTorqueGenerator:
    return ForceTorqueGenerator("wrist", ForceTorqueConfig(**{"sign": "on_robot", **options}))


def robot(surface: Surface | None = BOX, frames: FrameTree | None = None) -> State:
    return State(now=0.0, grid=GRID, surface=surface, frames=frames or FrameTree({}))


def touch(place: FloatArray, force: FloatArray, stamp: float = 0.0, frame: str = "base") -> Wrench:
    return Wrench(stamp=stamp, frame=frame, force=force, torque=np.cross(place, force))


def felt(reading: Wrench, state: State | None = None, **options: Any) -> HypothesisCloud:
    (cloud,) = generator(**options).generate(reading, state or robot())
    return cloud


def distance_to_line(places: FloatArray, through: FloatArray, along: FloatArray) -> FloatArray:
    distances: FloatArray = np.linalg.norm(
        np.cross(places - through, along / np.linalg.norm(along)), axis=1
    )
    return distances


def three_groups(force: FloatArray, torque: FloatArray, place: FloatArray) -> list[FloatArray]:
    """The places that F Eq 7 gives for the x, the y and the z of a place, where it can."""
    (fx, fy, fz), (tx, ty, tz), (x, y, z) = force, torque, place
    groups = []
    if fx != 0.0:
        groups.append(np.array([x, (fy * x - tz) / fx, (ty + fz * x) / fx]))
    if fy != 0.0:
        groups.append(np.array([(tz + fx * y) / fy, y, (fz * y - tx) / fy]))
    if fz != 0.0:
        groups.append(np.array([(fx * z - ty) / fz, (tx + fy * z) / fz, z]))
    return groups


@pytest.mark.parametrize("gone", [(), (0,), (1,), (2,), (0, 1), (1, 2), (0, 2)])
def test_the_line_is_that_of_all_three_groups_of_the_paper(gone: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        force, place = rng.normal(size=3), rng.normal(size=3)
        force[list(gone)] = 0.0
        torque = np.cross(place, force)
        on_line = line_of_action(force, torque) + rng.normal() * force
        groups = three_groups(force, torque, on_line)
        assert len(groups) == 3 - len(gone)
        np.testing.assert_allclose(groups, np.tile(on_line, (len(groups), 1)), atol=1e-9)
        assert distance_to_line(place[None], on_line, force) == pytest.approx(0.0, abs=1e-9)


def test_a_torque_about_z_is_fy_x_minus_fx_y() -> None:
    # F Eq 6 prints f_z in this row: a contact at x = 3, y = 2 under (5, 7, 0) N gives 7·3 - 5·2.
    force, place = np.array([5.0, 7.0, 0.0]), np.array([3.0, 2.0, 0.0])
    torque = np.array([0.0, 0.0, 11.0])
    np.testing.assert_allclose(np.cross(place, force), torque)
    assert distance_to_line(place[None], line_of_action(force, torque), force)[0] < 1e-12


def test_places_lie_on_the_line_at_the_surface_where_the_force_pushes_in() -> None:
    cloud = felt(touch(PLACE, DOWN))
    assert distance_to_line(cloud.positions, PLACE, DOWN).max() < 1e-12
    assert np.abs(cloud.positions[:, 2] - 0.02).max() <= 0.01
    assert np.abs(cloud.positions - PLACE).max(axis=1).min() <= GRID.voxel_size / 2.0


def test_the_side_where_the_line_leaves_the_body_is_left_out() -> None:
    below = PLACE * [1.0, 1.0, -1.0]
    assert felt(touch(below, DOWN)).positions[:, 2].min() > 0.0
    assert felt(touch(below, -DOWN)).positions[:, 2].max() < 0.0


def test_a_force_beyond_the_friction_cone_is_no_contact_there() -> None:
    slanted = np.array([10.0, 0.0, -10.0])
    assert len(felt(touch(PLACE, slanted), friction=1.1))
    assert not len(felt(touch(PLACE, slanted), friction=0.9))


def test_it_is_one_regular_contact_with_the_force_at_every_place() -> None:
    cloud = felt(touch(PLACE, DOWN))
    assert cloud.single and cloud.kind == HypothesisKind.REGULAR and not cloud.notes
    assert cloud.likelihoods.sum() == pytest.approx(1.0)
    assert np.ptp(cloud.likelihoods) == 0.0
    assert cloud.forces is not None
    np.testing.assert_allclose(cloud.forces, np.tile(DOWN, (len(cloud), 1)))


@pytest.mark.parametrize("tolerance", [0.002, 0.01, 0.05])
def test_at_most_one_place_falls_in_a_voxel(tolerance: float) -> None:
    surface = sampled(shape="sphere", radius=0.05)
    rng = np.random.default_rng(1)
    for _ in range(20):
        outward = rng.normal(size=3)
        outward /= np.linalg.norm(outward)
        force = -10.0 * outward + rng.normal(size=3)
        cloud = felt(
            touch(0.05 * outward, force), robot(surface), surface_tolerance=max(tolerance, 0.004)
        )
        voxels = GRID.voxels(cloud.positions)
        assert 0 < len(cloud) == len(np.unique(voxels, axis=0))


def test_a_tolerance_smaller_than_a_voxel_misses_no_contact() -> None:
    for height in np.linspace(0.0, 0.005, 11):
        surface = BOX.moved(pose_of((0.0, 0.0, height)), BOX.frame)
        place = PLACE + [0.0, 0.0, height]
        assert len(felt(touch(place, DOWN), robot(surface), surface_tolerance=0.003))


def test_under_the_gate_it_looked_and_found_nothing() -> None:
    assert not len(felt(touch(PLACE, 0.099 * DOWN)))  # five times 0.2 N
    assert len(felt(touch(PLACE, 0.101 * DOWN)))
    assert not len(felt(touch(PLACE, 0.29 * DOWN), min_force=3.0))
    assert len(felt(touch(PLACE, 0.31 * DOWN), min_force=3.0))


def test_spreads_are_the_noise_of_the_torque_over_the_force() -> None:
    at_origin = BOX.moved(pose_of((0.0, 0.0, -0.02)), BOX.frame)
    reading, state = touch(np.zeros(3), DOWN), robot(at_origin)
    cloud = felt(reading, state, force_noise=1e-6, min_force=1.0, noise=0.0)
    assert cloud.spreads is not None
    np.testing.assert_allclose(cloud.spreads, 0.01 / 10.0, rtol=1e-3)


def test_spreads_grow_with_the_lever_the_patch_and_the_doubt_about_the_surface() -> None:
    ft = generator(patch=0.003, noise=0.004)
    levers = np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.3]])  # across the force, and along it
    across, along = ft.spreads(DOWN, levers)
    assert across == pytest.approx(
        np.sqrt(0.001**2 + (0.3 * 0.02) ** 2 / 2.0 + 0.003**2 + 0.004**2)
    )
    assert along == pytest.approx(np.sqrt(0.001**2 + (0.3 * 0.02) ** 2 + 0.003**2 + 0.004**2))


def test_one_and_two_sigma_hold_as_many_truths_as_they_should() -> None:
    rng = np.random.default_rng(2)
    ft, state = generator(noise=0.0), robot()
    offsets = []
    for _ in range(1000):
        place = np.array([*rng.uniform(-0.08, 0.08, 2), 0.02])
        force = np.array([*rng.normal(size=2) * 2.0, rng.uniform(-20.0, -5.0)])
        exact = touch(place, force)
        noisy = Wrench(
            stamp=0.0,
            frame="base",
            force=exact.force + 0.2 * rng.normal(size=3),
            torque=exact.torque + 0.01 * rng.normal(size=3),
        )
        (cloud,) = ft.generate(noisy, state)
        if not len(cloud):
            continue
        assert cloud.forces is not None and cloud.spreads is not None
        nearest = int(np.argmin(np.linalg.norm(cloud.positions - place, axis=1)))
        axes = np.linalg.svd(cloud.forces[:1])[2][1:]  # across the line
        offsets.append(axes @ (place - cloud.positions[nearest]) / cloud.spreads[nearest])
    assert len(offsets) > 950
    within = np.abs(offsets)
    for times, ideal in ((1.0, 0.683), (2.0, 0.954)):
        assert (within <= times).mean() == pytest.approx(ideal, abs=0.03)
        assert (within <= times).mean(axis=0) == pytest.approx([ideal, ideal], abs=0.06)


@pytest.mark.parametrize(
    ("sigmas", "probability"),
    [(0.0, 1.0), (2.9, 1.0), (3.0, 1.0), (4.5, 0.5), (5.4, 0.2), (6.0, 0.0), (30.0, 0.0)],
)
def test_torque_along_the_force_is_explained_up_to_three_sigma(
    sigmas: float, probability: float
) -> None:
    # With the lever along z, torque has no part across the force: σ is that of the torque alone.
    place = np.array([0.0, 0.0, 0.02])
    exact = touch(place, DOWN)
    twisted = replace(exact, torque=exact.torque + [0.0, 0.0, sigmas * 0.01])
    explained = generator().explained(twisted.force, twisted.torque)
    assert explained == pytest.approx(probability, abs=1e-9)
    cloud = felt(twisted)
    assert cloud.likelihoods.sum() == pytest.approx(probability, abs=1e-9)
    assert (Note.MORE_THAN_ONE_CONTACT in cloud.notes) == (probability < 1.0)


def test_a_lever_across_the_force_makes_torque_along_it_less_certain() -> None:
    # σ² = 0.01² + (|τ| σ_f/|f|)², |τ| = 0.5 m · 10 N: σ = 0.1005 N·m, and 4.5 σ give one half.
    sigma = np.hypot(0.01, 5.0 * 0.2 / 10.0)
    torque = np.cross([0.5, 0.0, 0.0], DOWN) + [0.0, 0.0, 4.5 * sigma]
    assert generator().explained(DOWN, torque) == pytest.approx(0.5)


def test_a_pure_twist_about_a_weak_force_is_no_single_contact() -> None:
    assert generator().explained(0.11 * DOWN, np.array([0.0, 0.0, 1.0])) == 0.0


def test_a_patch_carries_torque_along_the_force() -> None:
    torque = np.array([0.0, 0.0, 0.05])  # 5 σ of the noise, but 1 σ of 5 mm times 10 N
    assert generator().explained(DOWN, torque) == pytest.approx(1.0 / 3.0)
    assert generator(patch=0.005).explained(DOWN, torque) == 1.0


def test_two_contacts_at_once_are_flagged() -> None:
    one = touch(np.array([0.08, 0.0, 0.02]), np.array([0.0, -8.0, -4.0]))
    other = touch(np.array([-0.08, 0.0, 0.02]), np.array([0.0, 8.0, -8.0]))
    both = replace(one, force=one.force + other.force, torque=one.torque + other.torque)
    for single in (one, other):
        assert not felt(single).notes
    assert felt(both).notes == (Note.MORE_THAN_ONE_CONTACT,)


def test_a_line_that_misses_the_surface_gives_nothing_and_says_so() -> None:
    cloud = felt(touch(np.array([0.15, 0.0, 0.0]), DOWN))
    assert not len(cloud) and cloud.notes == (Note.OFF_SURFACE,)


def test_a_force_that_pulls_on_a_surface_asks_for_the_sign() -> None:
    floor = robot(sampled(shape="rectangle", size=(0.2, 0.2)))
    pressed, pulled = touch(PLACE, DOWN), touch(PLACE, -DOWN)
    assert len(felt(pressed, floor)) and not felt(pressed, floor).notes
    cloud = felt(pulled, floor)
    assert not len(cloud) and cloud.notes == (Note.PULLS,)


def test_a_load_that_never_was_off_asks_for_the_tare() -> None:
    def remarks(ft: ForceTorqueGenerator, *forces: FloatArray) -> list[tuple[str, ...]]:
        readings = [touch(PLACE, force, stamp=0.5 * row) for row, force in enumerate(forces)]
        return [cloud.notes for one in readings for cloud in ft.generate(one, robot())]

    asks, more = (Note.NEVER_FREE,), 1.01 * DOWN
    assert remarks(generator(), DOWN, more, DOWN, DOWN) == [(), (), asks, asks]
    assert remarks(generator(), DOWN, 0.0 * DOWN, DOWN, DOWN) == [(), (), (), ()]
    assert remarks(generator(tare=0.4), 0.0 * DOWN, 0.0 * DOWN, DOWN, DOWN) == [(), (), ()]


def test_a_load_that_never_changes_is_no_bias_of_a_sensor() -> None:
    ft = generator()
    readings = [touch(PLACE, DOWN, stamp=0.5 * row) for row in range(4)]
    notes = [cloud.notes for one in readings for cloud in ft.generate(one, robot())]
    assert notes == [(), (), (Note.UNCHANGED,), (Note.UNCHANGED,)]
    (cloud,) = ft.generate(touch(PLACE, 1.01 * DOWN, stamp=2.0), robot())
    assert cloud.notes == (Note.NEVER_FREE,)
    ft.reset()
    assert felt(touch(PLACE, DOWN)).notes == ()


def test_a_tare_that_waits_blames_the_axis_that_scatters_most() -> None:
    ft = generator(tare=0.2, force_noise=0.1, torque_noise=0.01)
    for row in range(100):
        calm = np.array([0.05 * (-1) ** row, 0.0, 0.0])
        torque = np.array([0.0, 0.0, (0.05 if row < 50 else 0.08) * (-1) ** row])
        ft.generate(Wrench(stamp=0.01 * row, frame="base", force=calm, torque=torque), robot())
    assert ft.waits_for == (
        "its tare takes 0.2 s without contact while samples scatter by less than 2 times the "
        "stated noise, and torque z never scattered by less than 5.0 times: a contact "
        "meanwhile, a wrong column, a robot that moves, or more noise than stated"
    )


def test_a_tare_that_others_hold_up_blames_no_scatter() -> None:
    ft = generator(tare=0.2)
    pipe = pipeline(skin=SKIN)
    pipe.receive(TactileImage(stamp=0.0, frame="base", values=np.array([100.0])))
    touched = replace(robot(), fusion=pipe.step(0.0).fusion)
    assert touched.contacts
    for row in range(50):
        ft.generate(touch(PLACE, 0.0 * DOWN, 0.01 * row), touched)
    assert ft.waits_for == "its tare takes 0.2 s, and other sources report contacts all the time"


def test_it_says_what_it_waits_for_until_it_is_tared() -> None:
    ft = generator(tare=0.5)
    assert ft.waits_for == ""
    for stamp in (0.0, 0.001, 0.002):
        assert not ft.generate(touch(PLACE, 0.0 * DOWN, stamp), robot())
    assert ft.waits_for == (
        "its tare takes 0.5 s, and the readings span 0.002 s; is their unit of time right?"
    )
    for step, force in enumerate((DOWN, 0.0 * DOWN, DOWN, 0.0 * DOWN)):
        assert not ft.generate(touch(PLACE, force, 0.3 * step), robot())
    assert "force z never scattered by less than" in ft.waits_for
    for step in range(4, 8):
        ft.generate(touch(PLACE, 0.0 * DOWN, 0.3 * step), robot())
    assert ft.waits_for == ""


def test_a_sensor_that_gives_the_reverse_finds_the_same_places() -> None:
    exact = touch(PLACE, DOWN)
    reverse = replace(exact, force=-exact.force, torque=-exact.torque)
    ours, theirs = felt(exact), felt(reverse, sign="by_robot")
    np.testing.assert_array_equal(ours.positions, theirs.positions)
    assert ours.forces is not None and theirs.forces is not None
    np.testing.assert_array_equal(ours.forces, theirs.forces)


def test_the_sign_must_be_said() -> None:
    nothing: dict[str, Any] = {}
    with pytest.raises(ConfigurationError, match="give the sign, or a wrist of the robot"):
        ForceTorqueConfig(**nothing)


def turned_and_shifted() -> Pose:
    """The pose of the sensor in the base."""
    return pose_of([0.1, -0.2, 0.3], Rotation.from_euler("xyz", [0.4, -0.9, 1.7]).as_matrix())


def in_sensor(pose: Pose, place: FloatArray, force: FloatArray) -> Wrench:
    back = inverse(pose)
    there, push = points_in(back, place[None])[0], vectors_in(back, force[None])[0]
    return touch(there, push, frame="wrist")


def test_a_sensor_turned_and_shifted_finds_the_same_places() -> None:
    pose = turned_and_shifted()
    frames = FrameTree({"wrist": ("base", pose)})
    cloud = felt(in_sensor(pose, PLACE, DOWN), robot(frames=frames))
    assert cloud.frame == "base"
    assert distance_to_line(cloud.positions, PLACE, DOWN).max() < 1e-9
    assert np.linalg.norm(cloud.positions - PLACE, axis=1).min() <= GRID.voxel_size / 2.0 + 1e-9
    assert cloud.forces is not None and cloud.spreads is not None
    np.testing.assert_allclose(cloud.forces, np.tile(DOWN, (len(cloud), 1)), atol=1e-9)
    levers = cloud.positions - pose[:3, 3]
    np.testing.assert_allclose(cloud.spreads, generator().spreads(DOWN, levers))


def test_weight_and_bias_are_taken_off_however_the_sensor_is_turned() -> None:
    mass, centre = 1.5, np.array([0.01, -0.02, 0.06])
    force_bias, torque_bias = np.array([3.0, -1.0, 0.5]), np.array([0.1, 0.2, -0.3])
    ft = generator(
        compensation={
            "mass": mass,
            "centre_of_mass": tuple(centre),
            "force_bias": tuple(force_bias),
            "torque_bias": tuple(torque_bias),
        }
    )
    for angles in np.random.default_rng(3).uniform(-3.0, 3.0, (20, 3)):
        rotation = Rotation.from_euler("xyz", angles)
        pose = pose_of(np.zeros(3), rotation.as_matrix())
        weight = rotation.inv().apply([0.0, 0.0, -9.81 * mass])
        contact = in_sensor(pose, PLACE, DOWN)
        reading = replace(
            contact,
            force=contact.force + weight + force_bias,
            torque=contact.torque + np.cross(centre, weight) + torque_bias,
        )
        compensated = ft.compensated(reading, robot(frames=FrameTree({"wrist": ("base", pose)})))
        assert compensated is not None
        expected = [*contact.force, *contact.torque]
        np.testing.assert_allclose(compensated, expected, atol=1e-9)


def at_rest(offset: FloatArray, stamps: FloatArray) -> list[Wrench]:
    rng = np.random.default_rng(4)
    return [
        Wrench(
            stamp=stamp,
            frame="base",
            force=offset + 0.2 * rng.normal(size=3),
            torque=0.01 * rng.normal(size=3),
        )
        for stamp in stamps
    ]


def test_nothing_is_said_before_the_tare_is_done_and_then_it_is_taken_off() -> None:
    offset = np.array([4.0, 5.0, -6.0])
    ft = generator(tare=1.0)
    rest = at_rest(offset, np.arange(0.0, 1.0, 0.01))
    assert [ft.generate(reading, robot()) for reading in rest] == [()] * 100
    (cloud,) = ft.generate(at_rest(offset, np.array([1.0]))[0], robot())
    assert not len(cloud)
    wrench = ft.compensated(touch(PLACE, DOWN + offset, stamp=1.01), robot())
    assert wrench is not None
    np.testing.assert_allclose(wrench[:3], DOWN, atol=0.1)


def test_a_tare_starts_again_when_the_robot_moves() -> None:
    ft = generator(tare=1.0)
    moving = at_rest(np.zeros(3), np.arange(0.0, 1.0, 0.01))
    jolted = [replace(reading, force=reading.force + [0.0, 0.0, 5.0]) for reading in moving[50:]]
    for reading in [*moving[:50], *jolted, *at_rest(np.zeros(3), np.arange(1.0, 2.0, 0.01))]:
        assert ft.compensated(reading, robot()) is None
    wrench = ft.compensated(at_rest(np.zeros(3), np.array([2.02]))[0], robot())
    assert wrench is not None and np.linalg.norm(wrench[:3]) < 1.0


def test_a_reset_forgets_the_tare() -> None:
    ft = generator(tare=0.1)
    for reading in at_rest(np.zeros(3), np.arange(0.0, 0.2, 0.01)):
        ft.compensated(reading, robot())
    ft.reset()
    assert ft.compensated(at_rest(np.zeros(3), np.array([0.2]))[0], robot()) is None


def pipeline(**generators: dict[str, Any]) -> Pipeline:
    body = {"frame": "base", "shapes": [{"shape": "box", "size": (0.2, 0.2, 0.04)}]}
    fields: dict[str, Any] = {"generators": generators, "surface": body}
    return Pipeline(PipelineConfig(**fields))


SKIN = {"type": "tactile", "patch": {"grid": {"rows": 1, "columns": 1, "pitch": (0.01, 0.01)}}}
WRIST = {"type": "force_torque", "sign": "on_robot"}


def test_a_tare_waits_while_another_source_feels_a_contact() -> None:
    # A tare during the contact would take the contact's own force for bias, and never see it.
    pipe = pipeline(skin=SKIN, wrist={**WRIST, "tare": 0.2, "compensation": {}})
    found = {}
    for step in range(150):
        now = 0.01 * step
        pressed = now < 0.5
        pipe.receive(
            TactileImage(stamp=now, frame="base", values=np.array([100.0 if pressed else 0.0]))
        )
        pipe.receive(touch(PLACE, DOWN if pressed or now > 1.4 else 0.0 * DOWN, stamp=now))
        found[now] = pipe.step(now).fusion
    assert {f.report.sources["wrist"].accepted for t, f in found.items() if t < 0.69} == {0}
    assert [c.shares for c in found[1.49].contacts] == [{"skin": 0.0, "wrist": 1.0}]


def test_the_average_is_over_the_newest_samples_only() -> None:
    ft = generator(average=0.12)
    forces = []
    for step in range(10):
        wrench = ft.compensated(touch(PLACE, step * DOWN, stamp=0.05 * step), robot())
        assert wrench is not None
        forces.append(wrench[2] / -10.0)
    assert forces == pytest.approx([0.0, 0.5, *np.arange(1.0, 9.0)])


def test_other_sensors_are_given_the_newest_wrench_and_not_the_average() -> None:
    ft = generator(average=0.12)
    *_, (cloud,) = [
        ft.generate(touch(PLACE, step * DOWN, stamp=0.05 * step), robot()) for step in range(4)
    ]
    assert cloud.resultant is not None and ft.resultant is not None
    np.testing.assert_allclose(cloud.resultant.force, 2.0 * DOWN)
    np.testing.assert_allclose(ft.resultant.force, 3.0 * DOWN)
    ft.absorb(touch(PLACE, 4.0 * DOWN, stamp=0.2), robot())
    np.testing.assert_allclose(ft.resultant.force, 4.0 * DOWN)


def test_without_a_surface_the_error_is_counted_and_says_what_to_do() -> None:
    pipe = Pipeline(PipelineConfig(generators={"wrist": WRIST}))
    pipe.receive(touch(PLACE, DOWN))
    step = pipe.step(0.0)
    assert step.fusion.report.sources["wrist"].invalid == 1
    (refused,) = [event for event in step.events if event.kind == EventKind.REFUSED]
    assert "'wrist' needs the surface of the robot" in refused.message
    assert "configure `surface`" in refused.message


def test_remarks_reach_the_report_of_the_pipeline() -> None:
    pipe = pipeline(wrist=WRIST)
    pipe.receive(touch(np.array([0.15, 0.0, 0.0]), DOWN))
    assert pipe.step(0.0).fusion.report.notes == (("wrist", "off the surface"),)


def test_the_contact_of_a_pipeline_is_where_the_force_acts() -> None:
    pipe = pipeline(wrist=WRIST)
    pipe.receive(touch(PLACE, DOWN))
    (contact,) = pipe.step(0.0).fusion.contacts
    assert contact.position == pytest.approx(PLACE, abs=0.004)
    assert contact.force == pytest.approx(DOWN)


PLATES: dict[str, Any] = {
    "left": {"parent": "floor", "xyz": (0.0, 0.2, 0.0)},
    "right": {"parent": "floor", "xyz": (0.0, -0.2, 0.0)},
}
"""Two plates with a sensor each, side by side in the floor."""


def floor(links: Mapping[str, str]) -> Pipeline:
    """A floor of two plates, each of which is part of a link."""
    shapes = [
        {"shape": "rectangle", "size": (0.4, 0.38), "xyz": PLATES[plate]["xyz"], "link": link}
        for plate, link in links.items()
    ]
    fields = {
        "integrator": {"frame": "floor"},
        "generators": {plate: {**WRIST, "sensor": plate} for plate in PLATES},
        "surface": {"frame": "floor", "spacing": 0.01, "shapes": shapes},
        "frames": PLATES,
    }
    return Pipeline(PipelineConfig.model_validate(fields))


def stand(pipe: Pipeline, weights: Mapping[str, tuple[float, float]]) -> Step:
    """Press on each plate, at its x [m], with its weight [N]."""
    for plate, (x, weight) in weights.items():
        force, place = np.array([0.0, 0.0, -weight]), np.array([x, 0.0, 0.0])
        torque = np.cross(place, force)
        pipe.receive(Wrench(stamp=0.0, frame=plate, sensor=plate, force=force, torque=torque))
    return pipe.step(0.0)


@pytest.mark.parametrize("little", [30.0, 300.0])
def test_each_of_two_plates_measures_what_presses_on_itself_alone(little: float) -> None:
    weights = {"left": (0.1, little), "right": (-0.12, 700.0)}
    fusion = stand(floor({"left": "left", "right": "right"}), weights).fusion
    found = sorted(fusion.contacts, key=lambda contact: -contact.position[1])
    assert [contact.position[0] for contact in found] == pytest.approx([0.1, -0.12], abs=0.005)
    assert [contact.force[2] for contact in found] == pytest.approx([-little, -700.0], rel=0.05)
    assert min(contact.likelihood for contact in found) > 0.9


def test_a_sensor_that_is_on_no_link_of_a_divided_surface_is_told_the_links() -> None:
    step = stand(floor({"left": "left", "right": "rihgt"}), {"left": (0.0, 9.0), "right": (0, 9)})
    (refused,) = [event for event in step.events if event.kind == EventKind.REFUSED]
    assert "no transform joins 'right' to a link of the surface" in refused.message
    assert "(the links are: left, rihgt)" in refused.message


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_wrench_that_is_not_finite_is_no_reading(bad: float) -> None:
    with pytest.raises(InvalidReadingError, match="force of Wrench is not finite"):
        touch(PLACE, np.array([0.0, bad, 0.0]))


# A sensor that died

LOAD: dict[str, Any] = {"compensation": {"mass": 1.0}}
CARRIES_NOTHING: dict[str, Any] = {"compensation": {"force_bias": (3.0, 0.0, 0.0)}}
ZEROS = Wrench(stamp=0.0, frame="base", force=np.zeros(3), torque=np.zeros(3))


@pytest.mark.parametrize("options", [LOAD, {"load": "robot"}])
def test_a_sensor_that_carries_a_load_and_reads_exact_zeros_is_unhealthy(
    options: dict[str, Any],
) -> None:
    cloud = felt(ZEROS, **options)
    assert not len(cloud) and cloud.notes == (Note.UNHEALTHY,)


def test_a_sensor_that_carries_nothing_may_read_exact_zeros() -> None:
    cloud = felt(ZEROS)
    assert not len(cloud) and not cloud.notes
    pulled = felt(ZEROS, **CARRIES_NOTHING, min_force=100.0)
    assert not len(pulled) and not pulled.notes


@pytest.mark.parametrize("channel", range(6))
def test_the_least_of_six_channels_tells_that_a_sensor_lives(channel: int) -> None:
    wrench = np.zeros(6)
    wrench[channel] = 1e-12
    alive = replace(ZEROS, force=wrench[:3], torque=wrench[3:])
    assert felt(alive, **LOAD).notes != (Note.UNHEALTHY,)


def test_the_zeros_of_a_dead_sensor_are_no_tare() -> None:
    ft = generator(**LOAD, tare=0.1)
    for stamp in np.arange(0.0, 0.5, 0.01).tolist():
        (cloud,) = ft.generate(replace(ZEROS, stamp=stamp), robot())
        assert cloud.notes == (Note.UNHEALTHY,)
    assert ft.compensated(replace(ZEROS, stamp=0.5), robot()) is None


def existence_after(reading: Wrench, **options: Any) -> float:
    """Give the existence of a contact that the skin feels, after what a sensitive wrist read."""
    wrist = {**WRIST, "sensitivity": 0.99, **options}
    body = {"frame": "base", "shapes": [{"shape": "box", "size": (0.2, 0.2, 0.04)}]}
    fields: dict[str, Any] = {
        "generators": {"skin": SKIN, "wrist": wrist},
        "surface": body,
    }
    pipe = Pipeline(PipelineConfig(**fields))
    pipe.receive(TactileImage(stamp=0.0, frame="base", values=np.array([100.0])))
    pipe.receive(reading)
    members = pipe.step(0.0).fusion.field.members or ()
    (felt,) = (member for member in members if "skin" in member.given)
    return felt.contact.likelihood


def test_a_dead_sensor_says_nothing_about_contacts_and_one_that_rests_does() -> None:
    before = 0.95  # the most that a taxel is believed
    lowered = before * 0.01 / (1.0 - before + before * 0.01)
    weight = np.array([0.0, 0.0, -9.81])
    assert existence_after(ZEROS, **LOAD) == pytest.approx(before)
    assert existence_after(replace(ZEROS, force=weight), **LOAD) == pytest.approx(lowered, abs=1e-6)
    assert existence_after(ZEROS) == pytest.approx(lowered, abs=1e-6)


def test_a_wrench_that_cannot_be_explained_does_not_speak_against_a_contact() -> None:
    missed = touch(np.array([0.15, 0.0, 0.0]), DOWN)
    twisted = Wrench(stamp=0.0, frame="base", force=DOWN, torque=np.array([0.0, 0.0, 9.0]))
    for reading in (missed, twisted):
        assert existence_after(reading) == pytest.approx(0.95)


def test_an_unknown_bias_is_no_contact_and_hides_none() -> None:
    bias, wrist = np.array([0.9, 0.7, -0.8]), generator(unknown_bias=0.6)
    assert np.linalg.norm(bias) > wrist.least_force
    for stamp in np.arange(100) / 100:
        (cloud,) = wrist.generate(touch(np.zeros(3), bias, float(stamp)), robot())
        assert not len(cloud)
    both = Wrench(stamp=1.0, frame="base", force=bias + DOWN, torque=np.cross(PLACE, DOWN))
    (cloud,) = wrist.generate(both, robot())
    assert distance_to_line(cloud.positions, PLACE, DOWN).max() < 0.002
    wrist.reset()
    (cloud,) = wrist.generate(both, robot())
    assert len(cloud) and cloud.forces is not None
    np.testing.assert_allclose(cloud.forces[0], bias + DOWN)  # too much for a bias


def test_a_bias_is_not_learned_while_another_source_has_evidence_of_a_contact() -> None:
    weak = np.array([0.0, 0.0, -0.9])
    options = {"sign": "on_robot", "type": "force_torque", "sensor": "wrist"}
    taxels = {"patch": {"grid": {"rows": 1, "columns": 1, "pitch": (0.01, 0.01)}}}
    skin = {"type": "tactile", "sensor": "skin", "timeout": 10.0, **taxels}
    left = {}
    for pressed in (0.0, 50.0):
        pipeline = Pipeline(
            PipelineConfig(
                generators={"wrist": {**options, "unknown_bias": 0.6}, "skin": skin},
                surface=body(shape="box", size=(0.2, 0.2, 0.04)),
            )
        )
        pipeline.take(
            TactileImage(stamp=0.0, frame="base", sensor="skin", values=np.array([pressed]))
        )
        pipeline.step(0.0)
        wrist = pipeline.generators["wrist"]
        assert isinstance(wrist, ForceTorqueGenerator)
        for stamp in np.arange(1, 50) / 100:
            reading = touch(PLACE, weak, float(stamp))
            found = wrist.compensated(reading, pipeline.state(float(stamp)))
            assert found is not None
            left[pressed] = float(np.linalg.norm(found[:3]))
    assert left[0.0] < 0.1 and left[50.0] == pytest.approx(0.9)


def test_an_unknown_bias_is_no_negative_force() -> None:
    with pytest.raises(ConfigurationError, match="unknown_bias: .*greater than or equal to 0"):
        generator(unknown_bias=-1.0)


PRESS = Wrench(
    stamp=0.0, frame="wrist", force=np.array([0.0, 0.0, -10.0]), torque=np.zeros(3)
)  # into a surface whose normal is z


PLATE = Surface.rectangle(
    "wrist", np.zeros(3), np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.1, 0.0]), 0.005
)


def times_reversed(sign: str, state: State) -> int:
    """How often six seconds of a press make the sign suspect."""
    generator = ForceTorqueGenerator("wrist", ForceTorqueConfig.model_validate({"sign": sign}))
    clouds = (generator.generate(replace(PRESS, stamp=0.1 * step), state) for step in range(60))
    return [note for (cloud,) in clouds for note in cloud.notes].count(Note.REVERSED)


def test_a_reversed_weight_that_is_found_between_two_clouds_is_reported_by_the_next() -> None:
    generator = ForceTorqueGenerator(
        "wrist", ForceTorqueConfig.model_validate({"sign": "on_robot"})
    )
    generator._weight = SimpleNamespace(suspects=lambda stamp, *of: stamp == 0.1)  # type: ignore
    state = State(now=0.0, grid=Grid("wrist", 0.005), surface=PLATE)
    generator.absorb(replace(PRESS, stamp=0.1), state)
    notes = []
    for stamp in (0.2, 0.3):
        (cloud,) = generator.generate(replace(PRESS, stamp=stamp), state)
        notes.append(Note.REVERSED in cloud.notes)
    assert notes == [True, False]


def test_a_wrench_that_pulls_on_all_of_a_surface_is_told_once() -> None:
    state = State(now=0.0, grid=Grid("wrist", 0.005), surface=PLATE)
    assert times_reversed("by_robot", state) == 1
    assert times_reversed("on_robot", state) == 0


class Felt:
    """A last step in which another source has evidence at the top of a ball."""

    contacts = ()

    def evidence(self, without: str) -> FloatArray:
        return np.array([[0.0, 0.0, 0.06]])


def test_a_contact_that_others_find_opposite_to_the_force_is_told_once() -> None:
    shapes = [{"shape": "sphere", "radius": 0.06}]
    ball = BodyConfig.model_validate({"frame": "wrist", "shapes": shapes}).sampled(Path())
    state = State(now=0.0, grid=Grid("wrist", 0.005), surface=ball)
    assert times_reversed("by_robot", state) == 0  # nothing else tells of it
    assert times_reversed("by_robot", replace(state, fusion=Felt())) == 1
    assert times_reversed("on_robot", replace(state, fusion=Felt())) == 0
