"""The way of a reading through the pipeline, with toy generators."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactfusion import HypothesisCloud, Pipeline, PipelineConfig, Reading, State, Step
from contactfusion.assembly import AnyGenerator
from contactfusion.errors import ConfigurationError, PluginError, SourceError
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.sources import EventKind
from contactfusion.pipeline import asked
from contactfusion.readings import JointState, Odometry, PointCloud
from contactfusion.robot_state import Robot
from tests.toys import Echo, Pilot, offer_toys, point, wrench

FRONT = (0.1025, 0.0025, 0.0025)
LEFT = (0.0025, 0.1025, 0.0025)
ECHO = {"type": "echo"}
FEELER = {"type": "feeler"}


@pytest.fixture(autouse=True)
def _toys(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)


def pipeline(**config: Any) -> Pipeline:
    return Pipeline(PipelineConfig(**config))


def accepted(step: Step) -> dict[str, int]:
    return {name: source.accepted for name, source in step.fusion.report.sources.items()}


def driven(stamp: float, x: float, turn: float = 0.0) -> Odometry:
    return Odometry(
        stamp=stamp,
        frame="odom",
        child_frame="base",
        position=np.array([x, 0.0, 0.0]),
        orientation=Rotation.from_rotvec([0.0, 0.0, turn]).as_quat(),
    )


def test_a_reading_goes_to_the_generators_of_its_type_only() -> None:
    pipe = pipeline(generators={"eye": ECHO, "wrist": FEELER})
    pipe.receive(wrench(0.0, *FRONT))
    assert accepted(pipe.step(0.0)) == {"eye": 0, "wrist": 1}


def test_a_generator_with_a_sensor_hears_that_sensor_only() -> None:
    left = {"type": "echo", "sensor": "left"}
    pipe = pipeline(generators={"left": left, "both": ECHO})
    pipe.receive(point(0.0, *LEFT, sensor="left"))
    pipe.receive(point(0.1, *LEFT, sensor="right"))
    assert accepted(pipe.step(0.1)) == {"left": 1, "both": 2}


def test_a_cloud_in_the_frame_of_a_sensor_ends_up_in_that_of_the_space() -> None:
    camera = {"parent": "base", "xyz": (1.0, 0.0, 0.0), "rpy": (0.0, np.pi / 2, 0.0)}
    pipe = pipeline(generators={"eye": ECHO}, frames={"camera": camera})
    pipe.receive(point(0.0, 0.0, 0.0, 0.5025, frame="camera"))
    (contact,) = pipe.step(0.0).fusion.contacts
    assert contact.frame == "base"
    assert contact.position == pytest.approx([1.5025, 0.0, 0.0], abs=0.003)
    assert contact.force == pytest.approx([1.0, 0.0, 0.0])


def test_clouds_of_other_stamps_take_the_frames_of_these_and_build_no_state(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built: list[float] = []
    at = Robot._at

    def counted(robot: Robot, stamp: float, lag: float) -> State:
        built.append(stamp)
        return at(robot, stamp, lag)

    monkeypatch.setattr(Robot, "_at", counted)

    def lagging(
        generator: AnyGenerator, reading: Reading, state: State
    ) -> Sequence[HypothesisCloud]:
        (cloud,) = asked(generator, reading, state)
        return [replace(cloud, stamp=reading.stamp - lag) for lag in (1.0, 0.5, 0.0)]

    integrator: Any = {"frame": "odom", "timeout": 9.0}
    config = PipelineConfig(generators={"eye": ECHO}, integrator=integrator)
    heard: list[HypothesisCloud] = []
    pipe = Pipeline(config, ask=lagging, tell=heard.append)
    for reading in (driven(0.0, 0.0), driven(1.0, 8.0), point(1.0, *LEFT), point(1.0, *FRONT)):
        pipe.receive(reading)
    pipe.step(1.0)
    pipe.state(1.0)
    forward = [cloud.positions[0, 0] - LEFT[0] for cloud in heard[:3]]
    assert forward == pytest.approx([0.0, 4.0, 8.0])
    assert built == [1.0]


def test_a_cloud_in_an_unknown_frame_is_counted_and_named_and_hurts_nobody() -> None:
    pipe = pipeline(generators={"eye": ECHO, "wrist": FEELER})
    pipe.receive(point(0.0, *LEFT, frame="camara"))
    pipe.receive(wrench(0.0, *FRONT))
    step = pipe.step(0.0)
    (refused,) = [event for event in step.events if event.kind == EventKind.REFUSED]
    assert refused.source == "eye" and "'camara'" in refused.message
    assert step.fusion.report.sources["eye"].invalid == 1
    assert step.fusion.contacts[0].position == pytest.approx(FRONT)


def test_ready_steps_when_every_active_source_has_reported() -> None:
    pipe = pipeline(generators={"eye": ECHO, "wrist": FEELER}, cycle="ready")
    readings = [
        point(0.00, *LEFT),
        point(0.01, *LEFT),
        wrench(0.02, *FRONT),
        wrench(0.03, *FRONT),
        point(0.04, *LEFT),
    ]
    assert [step.stamp for step in pipe.run(readings)] == [0.02, 0.04]


def test_every_steps_at_its_period_from_the_first_reading_on() -> None:
    pipe = pipeline(generators={"eye": ECHO}, cycle={"every": 0.1})
    steps = list(pipe.run([point(stamp, *LEFT) for stamp in (5.0, 5.1, 5.35)]))
    assert [step.stamp for step in steps] == pytest.approx([5.1, 5.2, 5.3, 5.4])
    assert [accepted(step)["eye"] for step in steps] == [2, 2, 2, 3]


@pytest.mark.parametrize("on", ["wrench", "wrist"])
def test_on_steps_after_each_reading_of_that_type_or_sensor(on: str) -> None:
    pipe = pipeline(generators={"eye": ECHO, "wrist": FEELER}, cycle={"on": on})
    readings: list[Reading] = [
        point(0.0, *LEFT),
        wrench(0.1, *FRONT, sensor="wrist"),
        point(0.2, *LEFT),
        wrench(0.3, *FRONT, sensor="wrist"),
    ]
    assert [step.stamp for step in pipe.run(readings)] == [0.1, 0.3]


def test_no_readings_no_steps() -> None:
    for cycle in ({"every": 0.1}, {"on": "wrench"}, "ready"):
        assert list(pipeline(generators={"eye": ECHO}, cycle=cycle).run([])) == []


def test_a_long_pause_is_passed_over_until_the_step_before_the_next_reading() -> None:
    pipe = pipeline(generators={"eye": ECHO}, cycle={"every": 0.5})
    stamps = [step.stamp for step in pipe.run([point(0.0), point(90_000.2)])]
    assert stamps[:3] == [0.5, 1.0, 1.5] and stamps[119:] == [60.0, 90_000.0, 90_000.5]


@pytest.mark.parametrize("period", [0.05, 0.1, 0.3])
def test_after_a_pause_steps_are_those_that_there_would_have_been(period: float) -> None:
    for begin in np.arange(1000.0, 1001.0, 0.05).tolist():
        readings = [point(begin), point(begin + 64.9), point(begin + 65.3)]
        pipe = pipeline(generators={"eye": ECHO}, cycle={"every": period})
        stamps = [step.stamp for step in pipe.run(readings)]
        count = round((stamps[-1] - begin) / period)
        all_ = [begin + n * period for n in range(1, count + 1)]
        assert set(stamps) <= set(all_)
        late = [stamp for stamp in all_ if stamp >= begin + 64.9 - period]
        assert [stamp for stamp in stamps if stamp >= begin + 64.9 - period] == late


def test_a_kilohertz_wrench_and_a_slow_cloud_both_count_in_every_step() -> None:
    pipe = pipeline(generators={"eye": ECHO, "wrist": FEELER}, cycle={"every": 0.01})
    steps = list(pipe.run(interleaved(1.0)))
    assert len(steps) == 100
    for step in steps:
        stamps = {tuple(c.position.round(4)): c.stamp for c in step.fusion.contacts}
        assert step.stamp - stamps[FRONT] < 0.0015
        assert step.stamp - stamps[LEFT] < 0.1015
    rates = {name: source.rate for name, source in steps[-1].fusion.report.sources.items()}
    assert rates == pytest.approx({"eye": 10.0, "wrist": 1000.0})


def interleaved(seconds: float) -> Iterator[Reading]:
    for tick in range(round(1000 * seconds)):
        if tick % 100 == 0:
            yield point(tick / 1000, *LEFT)
        yield wrench(tick / 1000, *FRONT)


def test_a_place_on_a_moving_robot_is_taken_at_the_stamp_of_its_reading() -> None:
    pipe = pipeline(generators={"eye": ECHO}, integrator={"frame": "odom"})
    pipe.receive(driven(0.0, 0.0))
    pipe.receive(driven(1.0, 2.0, np.pi / 2))
    pipe.receive(point(0.5, 1.0, 0.0, 0.0025))
    (contact,) = pipe.step(1.0).fusion.contacts
    half = np.sqrt(0.5)
    assert contact.position == pytest.approx([1.0 + half, half, 0.0025], abs=0.005)


def test_a_generator_is_given_the_state_at_the_stamp_of_its_reading() -> None:
    pipe = pipeline(generators={"eye": ECHO})
    for stamp, angle in ((0.0, 0.0), (1.0, 1.0)):
        pipe.receive(
            JointState(stamp=stamp, frame="base", names=("j",), positions=np.array([angle]))
        )
    pipe.receive(driven(0.0, 3.0))
    pipe.receive(point(0.25, *LEFT))
    pipe.step(0.3)
    pipe.receive(point(0.5, *LEFT))
    early, late = states(pipe, "eye")
    assert early.now == 0.25 and early.grid.frame == "base"
    assert early.joints is not None and early.joints.positions == pytest.approx([0.25])
    assert early.base_pose is not None
    assert early.base_pose[:3, 3] == pytest.approx([3.0, 0.0, 0.0])
    assert early.contacts == () and len(late.contacts) == 1


def states(pipe: Pipeline, name: str) -> Sequence[Any]:
    echo = pipe.generators[name]
    assert isinstance(echo, Echo)
    return echo.states


def test_the_surface_moves_with_the_robot_and_is_missed_by_name_before_it_is_placed() -> None:
    box = {"frame": "base", "spacing": 0.1, "shapes": [{"shape": "box", "size": (0.2, 0.2, 0.2)}]}
    pipe = pipeline(generators={"eye": ECHO}, integrator={"frame": "odom"}, surface=box)
    pipe.receive(point(0.0, *LEFT, frame="odom"))
    step = pipe.step(0.0)
    assert len(step.fusion.contacts) == 1
    assert any(e.source == "surface" and "'base'" in e.message for e in step.events)
    pipe.receive(driven(0.1, 5.0))
    surface = pipe.state(0.1).surface
    assert surface is not None and surface.frame == "odom"
    assert surface.points.mean(axis=0) == pytest.approx([5.0, 0.0, 0.0])
    assert pipe.step(0.1).events == ()


def test_the_controller_acts_on_the_contacts_of_its_step() -> None:
    pipe = pipeline(generators={"eye": ECHO}, controller={"type": "pilot"})
    pipe.receive(point(0.0, *LEFT))
    command = pipe.step(0.0).command
    assert command is not None
    assert (command.mode, command.reason) == ("step 1", "1 contacts")


def test_the_controller_is_told_the_wrenches_since_the_last_step() -> None:
    pipe = pipeline(generators={"eye": ECHO}, controller={"type": "pilot"})
    reading = wrench(0.0, 0.0, 0.0, 1.0)
    with patch.object(Pilot, "command", autospec=True) as command:
        for count in (2, 0, 1):
            for _ in range(count):
                pipe.receive(reading)
            pipe.step(0.1)
        pipe.receive(reading)
        pipe.reset()
        pipe.step(0.0)
    assert [len(call.args[2].wrenches) for call in command.call_args_list] == [2, 0, 1, 0]


@pytest.mark.parametrize(
    ("how", "reason"),
    [("raises", "RuntimeError: out of order"), ("nothing", "it gave NoneType, not a Command")],
)
def test_a_controller_that_fails_commands_a_fault_and_no_motion(how: str, reason: str) -> None:
    pipe = pipeline(generators={"eye": ECHO}, controller={"type": "pilot", "how": how})
    pipe.receive(point(0.0, *LEFT))
    step = pipe.step(0.0)
    assert len(step.fusion.contacts) == 1
    command = step.command
    assert command is not None and command.mode == "fault" and reason in command.reason
    assert command.twist is None and command.joint_velocities is None and command.gripper is None


def test_without_a_controller_there_is_no_command() -> None:
    assert pipeline(generators={"eye": ECHO}).step(0.0).command is None


def test_after_a_reset_the_same_readings_give_the_same_steps() -> None:
    pipe = pipeline(generators={"eye": ECHO, "wrist": FEELER}, controller={"type": "pilot"})
    first = [told(step) for step in pipe.run(interleaved(0.2))]
    assert states(pipe, "eye")
    pipe.reset()
    assert not states(pipe, "eye")
    assert pipe.state(0.0).contacts == ()
    assert [told(step) for step in pipe.run(interleaved(0.2))] == first


def told(step: Step) -> tuple[object, ...]:
    assert step.command is not None
    contacts = tuple((c.position.tobytes(), c.likelihood) for c in step.fusion.contacts)
    return step.stamp, contacts, step.command.mode, step.command.reason


def test_unplugging_while_running_takes_away_all_that_the_generator_said() -> None:
    pipe = pipeline(generators={"eye": ECHO, "wrist": FEELER})
    pipe.receive(point(0.0, *LEFT))
    pipe.receive(wrench(0.0, *FRONT))
    assert len(pipe.step(0.0).fusion.contacts) == 2
    pipe.unplug("eye")
    pipe.receive(point(0.01, *LEFT))
    step = pipe.step(0.01)
    assert [tuple(c.position.round(4)) for c in step.fusion.contacts] == [FRONT]
    assert [(e.kind, e.source) for e in step.events] == [(EventKind.UNPLUGGED, "eye")]
    pipe.plug("eye", ECHO)
    pipe.receive(point(0.02, *LEFT))
    assert len(pipe.step(0.02).fusion.contacts) == 2


def test_unplugging_a_stranger_names_who_is_there() -> None:
    with pytest.raises(SourceError, match="did you mean 'wrist'"):
        pipeline(generators={"wrist": FEELER}).unplug("writs")


def test_a_name_can_be_plugged_once_only() -> None:
    with pytest.raises(SourceError, match="'eye' is plugged already"):
        pipeline(generators={"eye": ECHO}).plug("eye", FEELER)


def test_a_wrong_option_is_named_with_its_generator() -> None:
    with pytest.raises(ConfigurationError, match=r"generators\.eye\.timout: .*'timeout'"):
        pipeline(generators={"eye": {"type": "echo", "timout": 1.0}})


def test_an_unknown_type_gets_the_nearest_name() -> None:
    with pytest.raises(PluginError, match="there is no generator 'ekho'; did you mean 'echo'"):
        pipeline(generators={"eye": {"type": "ekho"}})


def test_a_class_that_is_no_generator_is_refused() -> None:
    with pytest.raises(PluginError, match="'stranger' cannot be used: int is no subclass of"):
        pipeline(generators={"eye": {"type": "stranger"}})


@pytest.mark.parametrize("cycle", [{}, {"every": 0.1, "on": "wrench"}, {"every": 0.0}])
def test_a_cycle_has_exactly_one_policy(cycle: Any) -> None:
    with pytest.raises(ConfigurationError, match="cycle"):
        PipelineConfig(cycle=cycle)


def watched(sensitivity: float) -> float:
    """Give the existence after one source told of a contact and the other one found nothing."""
    watch = {**ECHO, "sensor": "watch", "sensitivity": sensitivity}
    eye = {**ECHO, "sensor": "eye"}
    pipe = pipeline(generators={"eye": eye, "watch": watch}, integrator={})
    pipe.receive(point(0.0, *LEFT, sensor="eye"))
    nothing = PointCloud(stamp=0.0, frame="base", sensor="watch", points=np.empty((0, 3)))
    pipe.receive(nothing)
    step = pipe.step(0.0)
    assert accepted(step) == {"eye": 1, "watch": 1}
    (member,) = step.fusion.field.members or []
    return member.contact.likelihood


def test_a_generator_that_would_have_told_and_says_nothing_lowers_existence() -> None:
    assert watched(0.0) == pytest.approx(0.9)
    assert watched(0.99) == pytest.approx(0.9 * 0.01 / (0.1 + 0.9 * 0.01), abs=1e-6)


@pytest.mark.parametrize("sensitivity", [1.0, -0.5, 3.0])
def test_the_sensitivity_of_a_generator_is_a_probability_under_one(sensitivity: float) -> None:
    with pytest.raises(ConfigurationError, match=r"generators\.eye\.sensitivity"):
        pipeline(generators={"eye": {**ECHO, "sensitivity": sensitivity}})


@pytest.mark.parametrize(
    ("outputs", "evidence"),
    [({"": HypothesisKind.SUPPORT}, 0), (dict.fromkeys(("1", "2"), HypothesisKind.REGULAR), 2)],
)
def test_a_sensitivity_is_for_one_output_of_evidence(
    outputs: dict[str, HypothesisKind], evidence: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Echo, "outputs", outputs)
    with pytest.raises(ConfigurationError, match=f"one output of evidence.*'eye' has {evidence}"):
        pipeline(generators={"eye": {**ECHO, "sensitivity": 0.5}})
    pipeline(generators={"eye": ECHO})


def test_the_free_space_of_a_generator_has_no_part_in_its_sensitivity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kinds = {"": HypothesisKind.REGULAR, "free": HypothesisKind.NULL}
    monkeypatch.setattr(Echo, "outputs", kinds)
    pipe = pipeline(generators={"skin": {**ECHO, "sensitivity": 0.5}})
    sources = pipe.step(0.0).fusion.report.sources
    assert {name: source.kind for name, source in sources.items()} == {
        "skin": HypothesisKind.REGULAR,
        "skin/free": HypothesisKind.NULL,
    }
