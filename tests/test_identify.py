"""What joints report in free motion is identified, and what the motion cannot tell is named."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion import Pipeline, PipelineConfig, check_file, cli, identify_file
from contactfusion.arrays import FloatArray
from contactfusion.errors import ContactFusionError
from contactfusion.generators.external_torque import Effort, ExternalTorque
from contactfusion.identify.report import Identification
from contactfusion.readings import JointState
from contactfusion.robots.description import EffortConfig, LinkMassConfig, RobotConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel
from tests.arms import ARM, BENT, STILL, pushed, whole
from tests.free_motion import GRAVITY, TOOL, Joints, Sines, carrying, table, written

CURRENT = replace(Joints(), constant=np.linspace(2.0, 0.5, 7))
TRUTHS = {"measured": Joints(), "current": CURRENT}
WITHIN = 4.0
"""Standard errors; of some forty values one lies beyond three."""


@pytest.fixture(scope="module", params=["measured", "current"])
def identified(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path, Identification]:
    """A minute of free motion with a tool, identified into a file beside its configuration."""
    folder = tmp_path_factory.mktemp(request.param)
    config, recording = written(folder, table(TRUTHS[request.param]), request.param)
    return request.param, folder, identify_file(config, recording, folder / "identified.yaml")


def values(found: Identification) -> dict[str, dict[str, float]]:
    held: dict[str, dict[str, float]] = found.fields["robot"]["efforts"]
    return held


def errors(found: Identification) -> dict[str, list[tuple[float, float]]]:
    """The values of the table with their standard errors, by joint."""
    rows = {}
    for line in found.lines:
        words = line.split()
        if words[0] in ARM:
            at = [number for number, word in enumerate(words) if word == "±"]
            rows[words[0]] = [(float(words[n - 1]), float(words[n + 1])) for n in at]
    return rows


def test_all_that_joints_report_comes_back(identified: tuple[str, Path, Identification]) -> None:
    kind, _, found = identified
    truth, fields = TRUTHS[kind], ["offset", "coulomb", "viscous"]
    if kind == "current":
        fields.insert(1, "constant")
    assert not found.kept and not found.warnings
    for row, (name, rows) in enumerate(errors(found).items()):
        assert len(rows) == len(fields) + 1
        for field, (value, error) in zip(fields, rows, strict=False):
            assert abs(value - getattr(truth, field)[row]) < WITHIN * error + 1e-4, (name, field)
            assert values(found)[name][field] == pytest.approx(value, rel=1e-3)


def test_the_payload_comes_back(identified: tuple[str, Path, Identification]) -> None:
    _, _, found = identified
    payload = found.fields["robot"]["payload"]
    assert payload["frame"] == "link_7"
    assert payload["mass"] == pytest.approx(TOOL.mass, abs=0.02)
    np.testing.assert_allclose(payload["centre_of_mass"], TOOL.centre_of_mass, atol=0.002)


def observed(
    kind: Effort, rows: FloatArray, joints: Mapping[str, EffortConfig], model: RobotModel
) -> FloatArray:
    """The residual of the observer on a motion, shape (n, 7), once it has settled."""
    observer, left = ExternalTorque(Dynamics(model), joints, kind, gain=10.0, scale=0.0), []
    for row in rows:
        reading = JointState(
            stamp=row[0], frame="base", names=ARM, positions=row[1:8], efforts=row[8:]
        )
        found = observer.update(reading, whole(row[1:8]), GRAVITY)
        if found is not None and row[0] > 0.5:
            left.append(found[0][:7])
    return np.array(left)


def true_joints(truth: Joints) -> dict[str, EffortConfig]:
    fields = ("offset", "constant", "coulomb", "viscous")
    return {
        name: EffortConfig(noise=1.0, **{each: getattr(truth, each)[row] for each in fields})
        for row, name in enumerate(ARM)
    }


def test_noise_is_what_the_observer_leaves_where_all_is_known(
    identified: tuple[Effort, Path, Identification],
) -> None:
    kind, _, found = identified
    fresh = table(TRUTHS[kind], seconds=20.0, seed=1)
    left = observed(kind, fresh, true_joints(TRUTHS[kind]), carrying(TOOL))
    noise = [each["noise"] for each in values(found).values()]
    np.testing.assert_allclose(noise, left.std(axis=0), rtol=0.2)


def test_the_observer_with_what_was_identified_leaves_no_more_on_another_motion(
    identified: tuple[Effort, Path, Identification],
) -> None:
    kind, folder, found = identified
    config = PipelineConfig.from_file(taking(folder))
    assert config.robot is not None and config.robot.payload is not None
    fresh = table(TRUTHS[kind], seconds=20.0, seed=2)
    left = observed(kind, fresh, config.robot.efforts, RobotModel(config.robot))
    noise = [each["noise"] for each in values(found).values()]
    assert (np.sqrt(np.mean(left**2, axis=0)) < 1.25 * np.array(noise)).all()
    without = config.robot.model_copy(update={"payload": None})
    bare = observed(kind, fresh, config.robot.efforts, RobotModel(without))
    assert np.abs(bare).mean() > 3.0 * np.abs(left).mean()


def taking(folder: Path) -> Path:
    """A configuration that takes what was identified."""
    fields = yaml.safe_load((folder / "arm.yaml").read_text())
    fields["robot"]["spacing"] = 0.01
    path = folder / "taking.yaml"
    path.write_text(yaml.safe_dump({**fields, "identified": "identified.yaml"}))
    return path


def test_check_passes_what_was_identified(identified: tuple[str, Path, Identification]) -> None:
    _, folder, _ = identified
    found = check_file(taking(folder), folder / "free.yaml")
    assert not found.faults


def test_the_generator_is_silent_in_free_motion_and_finds_a_contact(
    identified: tuple[str, Path, Identification],
) -> None:
    kind, folder, _ = identified
    _, _, torques = pushed("link_6", 20.0, 4)
    about = Sines(span=np.full(7, 0.02), middle=BENT)  # where the push loads joints as there
    rows = table(TRUTHS[kind], seconds=4.0, seed=3, sines=about, push=(2.0, 4.0, torques))
    pipeline = Pipeline(PipelineConfig.from_file(taking(folder)))
    touched = []
    for row in rows:
        pipeline.receive(
            JointState(
                stamp=row[0], frame="base", sensor="arm", names=ARM, positions=row[1:8],
                efforts=row[8:],
            )
        )  # fmt: skip
        touched.append(bool(pipeline.step(row[0]).fusion.contacts))
    assert not any(touched[60:400])
    assert np.mean(touched[460:]) > 0.9


# External torques


def external(seconds: float = 20.0) -> FloatArray:
    """Torques that a driver computed: offsets and noise, and no contact."""
    rng, rows = np.random.default_rng(0), table(Joints(), seconds=seconds, rate=100.0)
    rows[:, 8:] = 0.3 + 0.1 * rng.standard_normal((len(rows), 7))
    return rows


def test_of_external_torques_offset_and_noise_are_told(tmp_path: Path) -> None:
    found = identify_file(*written(tmp_path, external(), "external"))
    for joint in values(found).values():
        assert joint["offset"] == pytest.approx(0.3, abs=0.02)
        assert joint["noise"] == pytest.approx(0.1, rel=0.1)
    assert "payload" not in found.fields["robot"] and not found.kept and not found.warnings


# What the motion cannot tell


def told(folder: Path, rows: FloatArray, kind: str = "measured", **fields: Any) -> Identification:
    return identify_file(*written(folder, rows, kind, **fields))


def short(joints: Joints | None = None, **options: Any) -> FloatArray:
    """Motion of 20 s."""
    return table(joints or Joints(), **{"seconds": 20.0, **options})


def test_positions_in_degrees_are_refused(tmp_path: Path) -> None:
    rows = short()
    rows[:, 1:8] = np.degrees(rows[:, 1:8])
    with pytest.raises(ContactFusionError, match="is it in degrees, or another joint"):
        told(tmp_path, rows)


def test_a_joint_that_hardly_moves_keeps_what_is_configured(tmp_path: Path) -> None:
    span = np.full(7, 0.5)
    span[2] = 0.001
    known = {name: {"noise": 1.0, "offset": 0.123, "coulomb": 0.456} for name in ARM}
    robot = {"urdf": "contactfusion.robots:arm_hand.urdf", "still": dict(STILL), "efforts": known}
    found = told(tmp_path, short(sines=Sines(span=span)), robot=robot)
    (sentence,) = found.kept
    assert sentence.startswith("arm: arm_3 hardly moved")
    assert values(found)["arm_3"]["offset"] == 0.123
    assert values(found)["arm_3"]["coulomb"] == 0.456
    assert values(found)["arm_2"]["coulomb"] == pytest.approx(Joints().coulomb[1], abs=0.1)


def test_offset_and_friction_are_one_where_a_joint_turns_one_way(tmp_path: Path) -> None:
    rows = short()
    turning = Joints()
    one_way = one_way_rows(turning)
    assert rows.shape == one_way.shape
    found = told(tmp_path, one_way)
    assert any("arm_1 moved in one direction" in sentence for sentence in found.kept)
    assert values(found)["arm_1"]["coulomb"] == values(found)["arm_1"]["offset"] == 0.0


def one_way_rows(joints: Joints) -> FloatArray:
    """Motion in which the first joint turns on and on, about the vertical."""

    class Turning(Sines):
        def at(self, stamps: FloatArray, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
            found = super().at(stamps, seed)
            found[0][:, 0] = 0.25 * stamps - 0.1 * np.cos(stamps)
            found[1][:, 0] = 0.25 + 0.1 * np.sin(stamps)
            found[2][:, 0] = 0.1 * np.cos(stamps)
            return found

    return short(joints, sines=Turning())


def test_a_vertical_axis_that_moves_slowly_tells_no_constant(tmp_path: Path) -> None:
    class Slow(Sines):
        def at(self, stamps: FloatArray, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
            positions, speeds, accelerations = super().at(0.3 * stamps, seed)
            speeds, accelerations = 0.3 * speeds, 0.09 * accelerations
            for other in range(1, 7):
                speeds[:, other] = accelerations[:, other] = 0.0
                positions[:, other] = self.middle[other]
            return positions, speeds, accelerations

    found = told(tmp_path, short(CURRENT, sines=Slow()), "current")
    assert any("arm_1 bore too little of gravity and inertia" in each for each in found.kept)
    assert "constant" not in values(found)["arm_1"]  # as it is configured
    assert sum("hardly moved" in each for each in found.kept) == 6
    assert any("payload stays open" in each for each in found.kept)


def test_an_arm_without_payload_has_none(tmp_path: Path) -> None:
    found = told(tmp_path, short(payload=None))
    assert "payload" not in found.fields["robot"]
    assert [each for each in found.kept if "there is no payload" in each]


class Level(Sines):
    """Slow motion in which the last link stays upright, as on a palletiser."""

    def at(self, stamps: FloatArray, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        found = super().at(0.2 * stamps, seed)
        for order, values in enumerate(found):
            values *= 0.2**order
            values[:, [2, 4]] = 0.0
            values[:, 5] = values[:, 3] - values[:, 1]
        return found


def test_a_payload_whose_wrist_never_tilts_keeps_its_height(tmp_path: Path) -> None:
    found = told(tmp_path, short(seconds=40.0, sines=Level()))
    (sentence,) = (each for each in found.kept if "payload" in each)
    assert "the payload's centre along z stays open: the wrist never tilted" in sentence
    payload = found.fields["robot"]["payload"]
    assert payload["mass"] == pytest.approx(TOOL.mass, abs=0.05)
    assert payload["centre_of_mass"][2] == 0.0


def test_a_motion_that_tells_no_payload_keeps_it_as_it_is(tmp_path: Path) -> None:
    span = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3])
    found = told(tmp_path, short(sines=Sines(span=span)))
    assert "payload" not in found.fields["robot"]
    assert any("the payload stays open" in sentence for sentence in found.kept)


def test_links_that_weigh_otherwise_than_in_the_description_are_weighed(tmp_path: Path) -> None:
    true = carrying(None)
    wrong: dict[str, Any] = {}
    for link, factor in (("link_2", 1.06), ("link_4", 0.92), ("link_6", 1.08)):
        mass, centre = true.mass_of(link)
        wrong[link] = {"mass": factor * mass, "centre_of_mass": centre.tolist()}
    robot = {"urdf": "contactfusion.robots:arm_hand.urdf", "still": dict(STILL), "masses": wrong}
    found = told(tmp_path, table(Joints(), payload=None), robot=robot)
    masses = found.fields["robot"]["masses"]
    weighed = RobotModel(true.config.model_copy(update={"masses": {
        name: LinkMassConfig(**each) for name, each in masses.items()
    }}))  # fmt: skip
    described = RobotModel(RobotConfig.model_validate(robot))
    rng, before, after = np.random.default_rng(0), list[FloatArray](), list[FloatArray]()
    for _ in range(20):
        at = whole(BENT + rng.uniform(-0.3, 0.3, len(ARM)))
        held, wrongly, now = (
            Dynamics(each).drift(at, np.zeros(len(at)), GRAVITY)[: len(ARM)]
            for each in (true, described, weighed)
        )
        before.append(wrongly - held)
        after.append(now - held)
    # a constant part is in the offsets of the joints
    assert np.std(after, axis=0).max() < 0.5 * np.std(before, axis=0).max()


# Doubts


def test_a_contact_is_named_with_its_time_and_left_out(tmp_path: Path) -> None:
    push = np.array([0.0, 8.0, 0.0, 5.0, 0.0, 2.0, 0.0])
    found = told(tmp_path, short(push=(8.0, 9.5, push)))
    (warning,) = found.warnings
    begin, end = (float(word) for word in warning.split() if word.replace(".", "").isdigit())
    assert begin == pytest.approx(8.0, abs=0.15) and end == pytest.approx(9.5, abs=0.15)
    assert "arm_2" in warning and "arm_4" in warning and "touched" in warning
    assert values(found)["arm_2"]["offset"] == pytest.approx(Joints().offset[1], abs=0.2)


def test_a_few_outliers_do_no_harm(tmp_path: Path) -> None:
    rows = short()
    clean = told(tmp_path, rows)
    rng = np.random.default_rng(0)
    rows[rng.integers(0, len(rows), 15), 9] += 200.0
    spiky = told(tmp_path, rows)
    for each in ("offset", "coulomb", "viscous"):
        before, after = (values(found)["arm_2"][each] for found in (clean, spiky))
        assert after == pytest.approx(before, abs=0.05)


def test_an_effort_that_saturates_is_named_and_left_out(tmp_path: Path) -> None:
    rows = short()
    clean = values(told(tmp_path, rows))["arm_2"]
    limit = np.quantile(rows[:, 9], 0.9)
    rows[:, 9] = np.minimum(rows[:, 9], limit)
    found = told(tmp_path, rows)
    assert any(f"effort of arm_2 saturates at {limit:g}" in each for each in found.warnings)
    assert values(found)["arm_2"]["offset"] == pytest.approx(clean["offset"], abs=0.2)


@pytest.mark.parametrize(("rows_late", "words"), [(20, "100 ms after"), (-10, "50 ms before")])
def test_efforts_that_come_late_are_named(rows_late: int, words: str, tmp_path: Path) -> None:
    rows = short()
    rows[:, 8:] = np.roll(rows[:, 8:], rows_late, axis=0)
    assert any(f"its efforts come {words} its positions" in each for each in told(
        tmp_path, rows[50:-50]).warnings)  # fmt: skip


@pytest.mark.parametrize("rate", [20.0, 200.0])
def test_a_delay_is_stated_in_seconds_at_any_rate(rate: float, tmp_path: Path) -> None:
    rows = table(Joints(), seconds=40.0, rate=rate)
    late = round(0.2 * rate)
    shifted = np.column_stack([rows[late:, :8], rows[:-late, 8:]])
    assert any("its efforts come 200 ms after" in each for each in told(tmp_path, shifted).warnings)


def test_rows_that_come_twice_count_once(tmp_path: Path) -> None:
    config, recording = written(tmp_path, short(seconds=10.0))
    once = identify_file(config, recording).fields
    rows = np.load(tmp_path / "free.npy")
    np.save(tmp_path / "free.npy", np.repeat(rows, 1 + (np.arange(len(rows)) % 20 == 0), axis=0))
    assert identify_file(config, recording).fields == once


def test_a_short_stretch_of_a_slow_recording_is_left_out(tmp_path: Path) -> None:
    rows = table(Joints(), seconds=30.0, rate=10.0)
    assert told(tmp_path, np.concatenate([rows[:200], rows[205:210], rows[216:]])).lines


def test_a_slow_observer_takes_a_longer_recording(tmp_path: Path) -> None:
    quick, slow = (
        told(tmp_path, short(seconds=12.0), generators=of_gain(gain)).fields["robot"]["efforts"]
        for gain in (10.0, 2.0)
    )
    for name in ARM:
        assert slow[name]["noise"] < 2.0 * quick[name]["noise"]
    words = refused(tmp_path, short(seconds=12.0), generators=of_gain(1.0))
    assert "12.0 s are too few for its gain of 1: record 20 s or more" in words


def of_gain(gain: float) -> dict[str, Any]:
    """A generator with an observer of that gain."""
    arm = {"type": "joint_torque", "sensor": "arm", "effort": "measured", "joints": list(ARM)}
    return {"arm": {**arm, "gain": gain}}


def test_a_joint_without_limits_may_leap_by_a_turn(tmp_path: Path) -> None:
    urdf = tmp_path / "turning.urdf"
    text = carrying(None).urdf.path.read_text()
    first = text.index('<joint name="arm_7" type="revolute">')
    urdf.write_text(text[:first] + text[first:].replace("revolute", "continuous", 1))
    robot = {"urdf": "turning.urdf", "still": dict(STILL)}
    sines = Sines(middle=np.array([0.0, 0.6, 0.0, 1.2, 0.0, 0.8, 3.1]))
    config, recording = written(tmp_path, table(Joints(), sines=sines, seconds=20.0), robot=robot)
    smooth = identify_file(config, recording)
    rows = np.load(tmp_path / "free.npy")
    rows[:, 7] = (rows[:, 7] + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(np.diff(rows[:, 7])).max() > 6.0
    np.save(tmp_path / "free.npy", rows)
    leaping = identify_file(config, recording)
    assert leaping.fields == smooth.fields and not leaping.warnings


def test_velocities_that_are_not_those_of_positions_are_named(tmp_path: Path) -> None:
    config, recording = written(tmp_path, short())
    table = np.load(tmp_path / "free.npy")
    table[:, 8:15] = 0.0
    np.save(tmp_path / "free.npy", table)
    (warning,) = identify_file(config, recording).warnings
    assert "the velocities of arm_1, arm_2" in warning


def test_a_reversed_sign_is_named(tmp_path: Path) -> None:
    rows = short()
    rows[:, 11] *= -1.0
    found = told(tmp_path, rows)
    assert any("arm_4 reports less as its torque rises" in sentence for sentence in found.kept)


# Bad input


@pytest.mark.parametrize("kind", ["measured", "current"])
def test_a_sign_that_all_joints_contradict_is_refused(kind: str, tmp_path: Path) -> None:
    rows = short()
    rows[:, 8:] *= -1.0
    words = refused(tmp_path, rows, effort=kind)
    assert "generators.arm.sign: efforts fall as torques rise, in all" in words
    assert words.endswith("set sign: by_robot")


def test_measured_torques_are_not_taken_for_external_ones(tmp_path: Path) -> None:
    words = refused(tmp_path, short(), effort="external")
    assert "generators.arm.effort: the efforts of arm_1, arm_2, arm_3" in words
    assert words.endswith("set effort: measured")


def test_external_torques_with_an_offset_are_no_measured_ones(tmp_path: Path) -> None:
    rows = short()
    rows[:, 8:] = 2.0 + np.random.default_rng(0).normal(0.0, 0.3, (len(rows), 7))
    assert values(told(tmp_path, rows, "external"))["arm_2"]["offset"] == pytest.approx(
        2.0, abs=0.1
    )


def refused(folder: Path, rows: FloatArray, **options: Any) -> str:
    with pytest.raises(ContactFusionError) as refusal:
        identify_file(*written(folder, rows, **options))
    return str(refusal.value)


def test_efforts_that_are_missing_are_asked_for(tmp_path: Path) -> None:
    words = refused(tmp_path, short(seconds=6.0)[:, :8])
    assert "generators.arm: JointState of 'arm' has no efforts; a driver that" in words


def test_efforts_that_are_zero_are_named(tmp_path: Path) -> None:
    rows = short(seconds=6.0)
    rows[:, 9] = 0.0
    assert "the efforts of arm_2 are zero throughout" in refused(tmp_path, rows)


def test_joints_come_in_any_order(tmp_path: Path) -> None:
    rows, order = short(), np.array([3, 0, 6, 2, 5, 1, 4])
    straight = values(told(tmp_path, rows))
    turned = np.column_stack([rows[:, 0], rows[:, 1 + order], rows[:, 8 + order]])
    other = values(told(tmp_path, turned, names=[ARM[row] for row in order]))
    assert other == straight


def test_joints_of_other_names_are_named_with_those_that_exist(tmp_path: Path) -> None:
    names = [name.replace("arm_", "joint") for name in ARM]
    words = refused(tmp_path, short(seconds=6.0), names=names)
    assert "no effort of 'arm_1': the joints of the reading are: joint1, joint2" in words


def test_a_joint_that_the_robot_lacks_is_named_with_the_nearest(tmp_path: Path) -> None:
    arm = {"type": "joint_torque", "sensor": "arm", "effort": "measured", "joints": ["arm_8"]}
    words = refused(tmp_path, short(seconds=6.0), generators={"arm": arm})
    assert "generators.arm.joints: unknown joint 'arm_8'; did you mean" in words


def test_a_recording_that_is_too_short_is_refused(tmp_path: Path) -> None:
    assert "1.9 s of efforts" in refused(tmp_path, short(seconds=2.0))


def test_a_configuration_without_joints_or_wrists_lists_what_it_has(tmp_path: Path) -> None:
    motion = {"base": {"type": "motion"}}
    words = refused(tmp_path, short(seconds=6.0), generators=motion)
    assert "for generators of type joint_torque and force_torque; there are: base (motion)" in words


def test_a_robot_without_inertias_names_the_links(tmp_path: Path) -> None:
    light = tmp_path / "light.urdf"
    text = carrying(None).urdf.path.read_text()
    while "<inertial>" in text:
        head, _, tail = text.partition("<inertial>")
        text = head + tail.partition("</inertial>")[2]
    light.write_text(text)
    robot = {"urdf": "light.urdf", "still": dict(STILL)}
    words = refused(tmp_path, short(seconds=6.0), robot=robot)
    assert "joint 'arm_1' moves no mass: give inertias of link_1" in words


# In a configuration


def test_joints_of_a_generator_of_their_own_go_back_to_it(tmp_path: Path) -> None:
    joints = {name: {"noise": 1.0} for name in ARM}
    arm = {"type": "joint_torque", "sensor": "arm", "effort": "external", "joints": joints}
    found = told(tmp_path, external(), generators={"arm": arm})
    assert set(found.fields["generators"]["arm"]["joints"]) == set(ARM)
    assert "efforts" not in found.fields["robot"]


def test_two_generators_each_weigh_their_own_links(tmp_path: Path) -> None:
    arms = {
        name: {"type": "joint_torque", "sensor": "arm", "effort": "measured", "joints": joints}
        for name, joints in (("inner", list(ARM[:4])), ("outer", list(ARM[4:])))
    }
    found = told(tmp_path, short(seconds=20.0), generators=arms)
    assert set(values(found)) == set(ARM)
    weighed = found.fields["robot"]["masses"]
    assert {"link_2", "link_6"} <= set(weighed)


def test_an_output_replaces_no_file_that_the_description_of_the_robot_names(tmp_path: Path) -> None:
    text = carrying(None).urdf.path.read_text()
    (tmp_path / "arm.urdf").write_text(text)
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump({"urdf": "arm.urdf", "still": dict(STILL)}))
    config, recording = written(tmp_path, short(seconds=6.0), robot="robot.yaml")
    with pytest.raises(ContactFusionError, match="would replace what is read, arm.urdf"):
        identify_file(config, recording, tmp_path / "arm.urdf")
    assert (tmp_path / "arm.urdf").read_text() == text


def test_the_command_prints_what_it_found_and_writes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config, recording = written(tmp_path, external(), "external")
    out = tmp_path / "identified.yaml"
    arguments = ["identify", str(config), str(recording), "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["contactfusion", *arguments])
    with pytest.raises(SystemExit) as end:
        cli.main()
    said = capsys.readouterr()
    assert not end.value.code and not said.err
    assert "arm_7" in said.out and "±" in said.out
    assert said.out.endswith(f"{config} has `identified: identified.yaml`\n")
    assert set(yaml.safe_load(out.read_text())) == {"robot"}


def test_equal_recordings_give_equal_files(tmp_path: Path) -> None:
    config, recording = written(tmp_path, external(), "external")
    for name in ("one.yaml", "two.yaml"):
        identify_file(config, recording, tmp_path / name)
    assert (tmp_path / "one.yaml").read_bytes() == (tmp_path / "two.yaml").read_bytes()
