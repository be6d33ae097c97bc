"""A running robot as a stream: what arrives, when steps are due, and what is not fresh."""

import threading
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline, PipelineConfig
from contactfusion.changes import Change
from contactfusion.errors import ConfigurationError, RecordingError
from contactfusion.live.clock import SimulatedTime
from contactfusion.live.config import LiveConfig
from contactfusion.live.discovery import contents_of, mismatch, written_by_others
from contactfusion.live.queue import Packet, Queue
from contactfusion.live.stream import LiveStream
from contactfusion.live.transport import DEPTH, Quality, matches
from contactfusion.loop import play
from contactfusion.pipeline import Step
from contactfusion.readings import JointState
from contactfusion.readings.messages import header, message
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.recording import RawMessage
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion.recordings.ros.delivery import CHANGES, CYCLES
from contactfusion.recordings.ros.topics import Camera
from tests.arms import ARM, STILL
from tests.wire import MILLISECOND, PROBE, RELIABLE, SECOND, START, Clock, Wire, transforms, wrench

WRENCH = "geometry_msgs/msg/WrenchStamped"
START_OF_PROCESS = 5.0
"""Until it takes its first reading, and until it has answered it, on a busy machine [s]."""
SENSORS = {"wrist": ("/wrist",)}
ARM_WITHOUT_SKIN: dict[str, Any] = {
    "surface": None,
    "robot": {
        "urdf": "contactfusion.robots:arm_hand.urdf",
        "still": STILL,
        "spacing": 0.02,
        "efforts": {name: {"noise": 0.05} for name in ARM},
    },
    "generators": {"arm": {"type": "joint_torque", "joints": list(ARM), "effort": "external"}},
    "integrator": {"frame": "base"},
    "cycle": {"every": 0.02},
}


class Live:
    """A stream on a wire, whose pipeline is played until the queue is empty."""

    def __init__(self, wire: Wire, sensors: Mapping[str, Sequence[str]], **fields: Any) -> None:
        self.clock, self.wire, self.taped = Clock(), wire, list[RawMessage]()
        self.pipeline = Pipeline(PipelineConfig(**{**PROBE, **fields}), live=True)
        self.stream = LiveStream(
            wire, LiveConfig(), sensors, tap=self.taped.append, clock=self.clock
        )
        self.stream.listen()
        self.stream.begin(self.pipeline)

    def play(self) -> list[Step]:
        self.stream.end_soon()
        return list(play(self.pipeline, self.stream))

    def say(self, topic: str, sent: Any, at: int = 0) -> None:
        """A message arrives at a time after the start [ms]."""
        self.wire.say(topic, sent, START + at * MILLISECOND)


@pytest.fixture
def wire() -> Wire:
    made = Wire()
    made.writer("/wrist", WRENCH)
    return made


def test_a_step_is_due_after_each_reading_of_the_sensor_that_is_named(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.clock.now += MILLISECOND
    live.say("/wrist", wrench(START), 1)
    (step,) = live.play()
    (contact,) = step.fusion.contacts
    assert step.stamp == pytest.approx(1e-3)
    assert contact.position[2] > 0.04
    assert contact.frame == "probe"


def test_readings_that_wait_together_share_a_step_and_the_newest_counts(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    for row in range(5):
        live.say("/wrist", wrench(START + row * MILLISECOND, fz=-5.0 - row), row)
    live.clock.now += 5 * MILLISECOND
    (step,) = live.play()
    (contact,) = step.fusion.contacts
    assert contact.force[2] == pytest.approx(-9.0)
    assert live.stream.overruns == 4
    assert "4 steps were missed: the loop is slow" in [event.message for event in step.events]
    for row in range(5, 7):
        live.say("/wrist", wrench(START + row * MILLISECOND), row)
    (step,) = live.play()
    assert live.stream.overruns == 5
    assert not step.events  # once a second


def test_steps_at_a_period_follow_the_clock_and_those_missed_are_skipped(wire: Wire) -> None:
    live = Live(wire, SENSORS, cycle={"every": 0.1})
    times = iter([0, 100, 100, 100, 350, 350, 350, 360, 360, 360, 500, 500, 500])

    def come_round(now: int) -> None:
        try:
            live.clock.now = START + next(times) * MILLISECOND
        except StopIteration:
            live.stream.end_soon()

    live.stream.idle = come_round
    stamps = [round(step.stamp, 3) for step in play(live.pipeline, live.stream)]
    assert stamps == [0.1, 0.35, 0.5]
    assert live.stream.overruns == 2


def test_a_reading_waits_for_the_transform_that_places_it(wire: Wire) -> None:
    wire.writer("/tf", "tf2_msgs/msg/TFMessage")
    sensors = {**SENSORS, "tf": ("/tf",)}
    live = Live(wire, sensors, integrator={"frame": "base"})
    live.say("/tf", transforms(START - MILLISECOND, "base", "probe"))
    live.say("/wrist", wrench(START), 0)
    live.say("/tf", transforms(START + 20 * MILLISECOND, "base", "probe"), 20)
    live.clock.now += 20 * MILLISECOND
    (step,) = live.play()
    assert [contact.frame for contact in step.fusion.contacts] == ["base"]


def test_a_reading_that_no_transform_places_in_time_is_refused_with_the_reason(wire: Wire) -> None:
    wire.writer("/tf", "tf2_msgs/msg/TFMessage")
    live = Live(wire, {**SENSORS, "tf": ("/tf",)}, integrator={"frame": "base"})
    live.say("/tf", transforms(START - MILLISECOND, "base", "probe"))
    live.say("/wrist", wrench(START), 0)
    live.clock.now += 99 * MILLISECOND
    live.stream.queue.put(lambda: setattr(live.clock, "now", START + 101 * MILLISECOND))
    (step,) = live.play()
    refused = [event.message for event in step.events if event.kind == "refused"]
    assert any("'base' is not known at 0.000 s" in message for message in refused)


NTP = ": set both by NTP or PTP"


@pytest.mark.parametrize(
    ("stamp", "why"),
    [
        (START + 3600 * SECOND, "its clock is 3,600.000 s ahead of this machine's" + NTP),
        (START - 3600 * SECOND, "its clock is 3,600.000 s behind this machine's" + NTP),
        (7 * SECOND, "it counts simulated time, and this pipeline does not: --sim-time"),
    ],
)
def test_a_stamp_of_another_clock_is_refused_by_name(wire: Wire, stamp: int, why: str) -> None:
    live = Live(wire, SENSORS)
    live.say("/wrist", wrench(stamp))
    assert live.play() == []
    (trouble,) = live.stream.troubles()
    assert trouble.note == f"1 refused: {why}"


def test_simulated_time_is_that_of_the_clock_topic() -> None:
    wire = Wire()
    clock = message("builtin_interfaces/Time", sec=7, nanosec=5)
    told = message("rosgraph_msgs/Clock", clock=clock)
    hear = threading.Timer(0.1, lambda: wire.say("/clock", told, 0))
    hear.start()
    simulated = SimulatedTime(wire, patience=10.0)
    wire.takes["/clock"](b"damaged", 0)
    assert simulated() == 7 * SECOND + 5
    with pytest.raises(ConfigurationError, match="nothing came on /clock within 0.01 s"):
        SimulatedTime(Wire(), patience=0.01)


def test_a_message_without_a_stamp_counts_from_its_arrival(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.clock.now += 3 * MILLISECOND
    live.say("/wrist", wrench(0), 3)
    (step,) = live.play()
    assert step.fusion.contacts[0].stamp == pytest.approx(3e-3)


def test_garbage_is_counted_and_the_loop_goes_on(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    whole = bytes(typestore().serialize_cdr(wrench(START), WRENCH))
    lying = whole[:12] + b"\xff\xff\xff\x7f" + whole[16:]
    for garbage in (b"", b"\x00", whole[:20], lying, bytes(300)):
        wire.takes["/wrist"](garbage, START)
    live.say("/wrist", wrench(START))
    assert len(live.play()) == 1
    (trouble,) = live.stream.troubles()
    assert trouble.note.startswith("5 unreadable: ") or "unreadable" in trouble.note


def test_what_is_stale_is_named_and_what_reports_again_is_not(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.say("/wrist", wrench(START))
    live.play()
    assert live.stream.stale(START + 250 * MILLISECOND) == ""
    late = live.stream.stale(START + 300 * MILLISECOND)
    assert late == "no sensor of contacts has reported for 0.30 s"


@pytest.mark.parametrize("what", ["NaN", "garbage", "another clock"])
def test_what_cannot_be_used_keeps_nothing_fresh(wire: Wire, what: str) -> None:
    live = Live(wire, SENSORS)
    live.say("/wrist", wrench(START), 1)
    for at in range(10, 500, 10):
        live.clock.now = START + at * MILLISECOND
        stamp = live.clock.now - (3600 * SECOND if what == "another clock" else 0)
        if what == "garbage":
            wire.takes["/wrist"](b"\0\1\0\0garbage", live.clock.now)
        else:
            live.say("/wrist", wrench(stamp, fz=float("nan") if what == "NaN" else -5.0), at)
    live.play()
    late = live.stream.stale(START + 500 * MILLISECOND)
    assert late == "no sensor of contacts has reported for 0.50 s"


def test_a_sensor_whose_process_is_gone_stays_stale(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.say("/wrist", wrench(START))
    live.play()
    wire.writers.clear()
    live.stream.discovered(wire.ends())
    gone = live.stream.stale(START + SECOND)
    assert gone == "no sensor of contacts has reported for 1.00 s"


def test_without_any_sensor_of_contacts_nothing_is_fresh(wire: Wire) -> None:
    live = Live(wire, {})
    live.stream.discovered(wire.ends())
    assert live.stream.stale(live.clock.now + SECOND).startswith("no sensor of contacts has")


def test_odometry_that_came_and_ceased_is_stale_beside_a_sensor_that_reports(wire: Wire) -> None:
    wire.writer("/odom", "nav_msgs/msg/Odometry")
    live = Live(wire, {**SENSORS, "odom": ("/odom",)})
    live.stream.arrived |= {"/wrist": START + 400 * MILLISECOND, "/odom": START}
    live.stream.listen()
    assert live.stream.stale(START + 400 * MILLISECOND) == "/odom has been silent for 0.40 s"


def test_wheels_that_are_gone_are_silent(wire: Wire) -> None:
    wire.writer("/odom", "nav_msgs/msg/Odometry")
    live = Live(wire, {**SENSORS, "odom": ("/odom",)})
    live.stream.rematch = lambda stream: SENSORS
    live.stream.listen()
    del wire.writers[-1]
    live.stream.arrived |= {"/wrist": START + SECOND, "/odom": START}
    live.stream.discovered(wire.ends())
    assert live.stream.stale(START + SECOND) == "/odom has been silent for 1.00 s"


def test_a_topic_that_comes_late_is_listened_to_once_it_is_matched(wire: Wire) -> None:
    bare = Wire()
    live = Live(bare, {})
    live.stream.rematch = lambda stream: SENSORS
    bare.writer("/wrist", WRENCH)
    live.stream.discovered(bare.ends())
    live.say("/wrist", wrench(START))
    assert len(live.play()[0].fusion.contacts) == 1


def test_a_topic_that_came_between_the_match_and_the_loop_is_listened_to(wire: Wire) -> None:
    live = Live(wire, {})
    live.stream.rematch = lambda stream: SENSORS
    live.stream.discovered(wire.ends())
    live.say("/wrist", wrench(START))
    assert len(live.play()[0].fusion.contacts) == 1


def test_a_driver_that_comes_back_without_reliability_is_heard(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.stream.rematch = lambda stream: SENSORS
    assert wire.asked["/wrist"].reliable
    live.say("/wrist", wrench(START))
    wire.writer("/wrist", WRENCH, quality=Quality(reliable=False, latched=False))
    live.stream.discovered(wire.ends())  # the one before is not known to be gone yet
    assert not wire.asked["/wrist"].reliable
    live.say("/wrist", wrench(START + MILLISECOND), 1)
    live.play()
    assert live.stream.states["/wrist"].tally.readings == 2
    del wire.writers[1]
    live.stream.discovered(wire.ends())  # who asks for less hears who offers more
    assert not wire.asked["/wrist"].reliable


def test_a_topic_whose_type_the_transport_lacks_is_named_and_the_others_are_heard(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    listen, lacks = wire.listen, "nothing defines the type sensor_msgs/msg/JointState"

    def only_wrenches(topic: str, msgtype: str, *more: Any) -> None:
        if msgtype != WRENCH:
            raise RecordingError(lacks)
        listen(topic, msgtype, *more)

    monkeypatch.setattr(wire, "listen", only_wrenches)
    wire.writer("/joints", "sensor_msgs/msg/JointState")
    live = Live(wire, {**SENSORS, "joints": ("/joints",)})
    assert live.stream.unread == {"/joints": lacks}
    live.say("/wrist", wrench(START), 1)
    assert len(live.play()) == 1


def test_the_tape_holds_messages_steps_and_changes_in_their_order(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.say("/wrist", wrench(START))
    live.stream.queue.put(Change("threshold 0.7"))
    live.play()
    assert [raw.topic for raw in live.taped] == ["/wrist", CHANGES, CYCLES]
    stamps = [raw.log_stamp_ns for raw in live.taped]
    assert stamps == sorted(set(stamps))
    assert live.pipeline.integrator.config.threshold == 0.7


def test_clouds_of_a_process_of_its_own_come_again_when_they_came(
    wire: Wire, tmp_path: Path
) -> None:
    wrist = {**PROBE["generators"]["wrist"], "isolate": True}
    live = Live(wire, SENSORS, generators={"wrist": wrist})
    for row in range(12):
        live.say("/wrist", wrench(START + row * MILLISECOND, fz=-5.0 - row), row)
        live.stream.queue.put(partial(time.sleep, START_OF_PROCESS if row < 2 else 0.05))
    steps = live.play()
    live.pipeline.close()
    assert sum(raw.topic == CHANGES for raw in live.taped) > 1
    with McapWriter(tmp_path / "live.mcap", live.stream.epoch_ns) as writer:
        writer.text("/contactfusion/configuration", "{}")
        for raw in live.taped:
            writer.copy(raw)
    again = Pipeline(live.pipeline.config)
    try:
        recording = RosRecording(RosConfig(file=tmp_path / "live.mcap"))
        replayed = list(play(again, recording))
    finally:
        again.close()
    assert found(replayed) == found(steps)
    assert any(step.fusion.contacts for step in steps)


def test_a_simulation_that_begins_again_ends_it_with_a_sentence(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.say("/wrist", wrench(START))
    live.clock.now += 20 * SECOND
    live.stream.queue.put(lambda: setattr(live.clock, "now", START))
    with pytest.raises(RecordingError, match=r"the clock fell from 17\d+\.000 s to 17\d+\.000 s"):
        live.play()


def live_recording(path: Path, wire: Wire, *changes: str) -> None:
    """A recording of a running robot: a touch, and changes that were made before it."""
    live = Live(wire, SENSORS)
    for text in changes:
        live.stream.queue.put(Change(text))
    live.say("/wrist", wrench(START))
    live.play()
    with McapWriter(path, live.stream.epoch_ns) as writer:
        for raw in live.taped:
            writer.copy(raw)


def test_a_change_in_a_recording_names_files_beside_the_recording_alone(
    wire: Wire, tmp_path: Path
) -> None:
    weights = tmp_path / "mine" / "weights.safetensors"
    weights.parent.mkdir()
    weights.write_bytes(b"")
    change = f"plug spy type=lidar_cpm weights={weights}"
    path = tmp_path / "theirs" / "live.mcap"
    path.parent.mkdir()
    live_recording(path, wire, change)
    pipeline, recording = Pipeline(PipelineConfig(**PROBE)), RosRecording(RosConfig(file=path))
    (step,) = play(pipeline, recording)
    assert list(pipeline.generators) == ["wrist"]
    assert len(step.fusion.contacts) == 1
    (trouble,) = recording.troubles()
    assert trouble.note.startswith(f"1 of 1 could not be made: '{change}': ")
    assert f"may name files in {path.parent} only" in trouble.note


def test_of_a_recording_that_is_a_folder_a_change_names_files_in_it_alone(
    wire: Wire, tmp_path: Path
) -> None:
    (tmp_path / "mine.safetensors").write_bytes(b"")
    live_recording(tmp_path / "bag" / "live.mcap", wire, "plug x type=lidar_cpm weights=../mine")
    recording = RosRecording(RosConfig(file=tmp_path / "bag"))
    list(play(Pipeline(PipelineConfig(**PROBE)), recording))
    (trouble,) = recording.troubles()
    assert f"may name files in {tmp_path / 'bag'} only" in trouble.note


@pytest.mark.parametrize("isolated", ["in the configuration", "by a change"])
def test_a_step_before_the_first_answer_of_a_process_is_played_again(
    isolated: str, wire: Wire, tmp_path: Path
) -> None:
    wrist = {**PROBE["generators"]["wrist"], "isolate": isolated == "in the configuration"}
    live = Live(wire, SENSORS, generators={"wrist": wrist})
    if isolated == "by a change":
        live.stream.queue.put(Change("isolate wrist"))
    live.say("/wrist", wrench(START))
    live.clock.now += MILLISECOND
    steps = live.play()  # the process has only begun to start
    live.pipeline.close()
    with McapWriter(tmp_path / "live.mcap", live.stream.epoch_ns) as writer:
        writer.text("/contactfusion/configuration", "{}")
        for raw in live.taped:
            writer.copy(raw)
    again = Pipeline(live.pipeline.config)
    try:
        replayed = list(play(again, RosRecording(RosConfig(file=tmp_path / "live.mcap"))))
    finally:
        again.close()
    assert found(replayed) == found(steps)
    assert len(steps) == 1 and not steps[0].fusion.contacts


def test_what_the_configuration_names_is_plugged_again_by_a_recording(
    wire: Wire, tmp_path: Path
) -> None:
    live_recording(tmp_path / "live.mcap", wire, "unplug wrist", "plug wrist")
    pipeline = Pipeline(PipelineConfig(**PROBE))
    recording = RosRecording(RosConfig(file=tmp_path / "live.mcap"))
    (step,) = play(pipeline, recording)
    assert len(step.fusion.contacts) == 1
    assert not list(recording.troubles())


@pytest.mark.parametrize("mark", [CYCLES, CHANGES])
def test_marks_of_another_type_are_refused(wire: Wire, tmp_path: Path, mark: str) -> None:
    live = Live(wire, SENSORS)
    live.say("/wrist", wrench(START))
    live.play()
    other = message("std_msgs/Bool", data=True)
    cdr = bytes(typestore().serialize_cdr(other, other.__msgtype__))
    with McapWriter(tmp_path / "live.mcap", live.stream.epoch_ns) as writer:
        for raw in live.taped:
            if raw.topic != mark:
                writer.copy(raw)
        writer.copy(RawMessage(mark, other.__msgtype__, "bool data", START, cdr))
    with pytest.raises(RecordingError, match=f"{mark} holds std_msgs/msg/Bool, not std_msgs/msg/"):
        RosRecording(RosConfig(file=tmp_path / "live.mcap"))


def found(steps: list[Step]) -> list[tuple[float, list[bytes]]]:
    """The stamp of each step, and the places of its contacts to the bit."""
    return [
        (step.stamp, [contact.position.tobytes() for contact in step.fusion.contacts])
        for step in steps
    ]


def test_of_a_flood_the_oldest_are_dropped_and_counted() -> None:
    queue = Queue()
    for row in range(DEPTH + 7):
        queue.packet("/wrist", b"%d" % row, row)
    assert len(queue) == DEPTH
    assert queue.dropped["/wrist"] == 7
    first = queue.take(0.0)
    assert getattr(first, "arrived", None) == 7
    assert Queue().take(0.0) is None


def test_large_messages_that_wait_take_bounded_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactfusion.live.queue.MOST_BYTES", 100)
    queue = Queue()
    for row, size in enumerate((30, 30, 30, 80, 10, 10, 5, 300)):
        queue.packet("/eye", bytes(size), row)
        queue.packet("/wrist", b"w", row)
    assert queue.dropped == {"/eye": 7}
    taken = [each for _ in range(len(queue)) if isinstance(each := queue.take(0.0), Packet)]
    assert [each.arrived for each in taken if each.topic == "/eye"] == [7]
    assert [each.arrived for each in taken if each.topic == "/wrist"] == [*range(8)]
    queue.packet("/eye", bytes(60), 8)
    queue.packet("/eye", bytes(40), 9)
    assert queue.dropped == {"/eye": 7}


@pytest.mark.parametrize(
    ("writers", "kind"),
    [
        ([("/eye/depth", "sensor_msgs/msg/Image")], None),
        ([("/skin", "sensor_msgs/msg/Imu")], None),
    ],
)
def test_what_no_reading_is_made_of_is_not_read(
    writers: list[tuple[str, str]], kind: object
) -> None:
    wire = Wire()
    for topic, msgtype in writers:
        wire.writer(topic, msgtype)
    assert contents_of(wire.ends())[writers[0][0]].kind is kind


def test_an_image_beside_its_camera_info_is_one_of_depth_by_its_name() -> None:
    wire = Wire()
    wire.writer("/eye/camera_info", "sensor_msgs/msg/CameraInfo")
    for name in ("depth", "color"):
        wire.writer(f"/eye/{name}", "sensor_msgs/msg/Image")
    found = contents_of(wire.ends())
    assert found["/eye/depth"].kind is not None
    assert found["/eye/color"].kind is None


def test_a_type_that_is_another_by_its_hash_and_one_of_two_types_are_not_read() -> None:
    wire = Wire()
    wire.writer("/wrist", WRENCH, type_hash="RIHS01_00")
    wire.writer("/both", WRENCH)
    wire.writer("/both", "sensor_msgs/msg/JointState")
    found = contents_of(wire.ends())
    assert found["/wrist"].kind is None
    assert found["/both"].kind is None
    written = written_by_others(wire.ends())
    assert "another than that of ROS 2 Jazzy: its hash is RIHS01_00" in mismatch(written["/wrist"])
    assert "writers of several types, geometry_msgs/msg/Wrench" in mismatch(written["/both"])


def test_faults_are_for_what_is_played(wire: Wire) -> None:
    with pytest.raises(ValueError, match="faults act on what `run` plays, not on a robot"):
        Live(wire, SENSORS, faults=[{"sensor": "wrist", "fault": "silent"}])


def test_a_reader_may_ask_for_no_more_than_is_offered() -> None:
    assert matches(offered=RELIABLE, asked=Quality(False, False))
    assert not matches(offered=Quality(False, False), asked=RELIABLE)
    assert not matches(offered=RELIABLE, asked=Quality(True, True))
    assert matches(offered=Quality(True, False, 0.1), asked=Quality(True, False, 0.2))
    assert not matches(offered=RELIABLE, asked=Quality(True, False, 0.2))


def test_joints_are_the_sensor_of_contacts_of_an_arm_without_skin() -> None:
    wire = Wire()
    wire.writer("/joints", "sensor_msgs/msg/JointState")
    live = Live(wire, {"joints": ("/joints",)}, **ARM_WITHOUT_SKIN)
    live.stream.arrived["/joints"] = START + SECOND
    assert live.stream.stale(START + SECOND) == ""
    late = live.stream.stale(START + 2 * SECOND)
    assert late == "no sensor of contacts has reported for 1.00 s"


def test_joints_that_are_silent_stop_an_arm_beside_a_sensor_that_reports(wire: Wire) -> None:
    wire.writer("/joints", "sensor_msgs/msg/JointState")
    generators = {**ARM_WITHOUT_SKIN["generators"], **PROBE["generators"]}
    fields = {**ARM_WITHOUT_SKIN, "generators": generators}
    live = Live(wire, {**SENSORS, "joints": ("/joints",)}, **fields)
    live.stream.arrived |= {"/wrist": START + SECOND, "/joints": START}
    assert live.stream.stale(START + SECOND) == "/joints has been silent for 1.00 s"


def test_a_sensor_that_no_transform_places_any_more_keeps_nothing_fresh(wire: Wire) -> None:
    wire.writer("/tf", "tf2_msgs/msg/TFMessage")
    live = Live(wire, {**SENSORS, "tf": ("/tf",)}, integrator={"frame": "base"})
    live.say("/tf", transforms(START, "base", "probe"), 0)
    live.say("/wrist", wrench(START), 0)

    times = iter(range(10, 1500, 10))

    def press(now: int) -> None:
        if (at := next(times, None)) is None:
            live.stream.idle = lambda now: None
            live.stream.end_soon()
        else:
            live.clock.now = START + at * MILLISECOND
            live.say("/wrist", wrench(live.clock.now), at)

    live.stream.idle = press
    list(play(live.pipeline, live.stream))
    assert live.pipeline.lost == {"wrist"}
    late = live.stream.stale(live.clock.now)
    assert late.startswith("no sensor of contacts has reported for 1.")
    live.say("/tf", transforms(live.clock.now, "base", "probe"), 1500)
    live.say("/wrist", wrench(live.clock.now), 1500)
    live.play()
    live.say("/wrist", wrench(live.clock.now), 1500)
    live.play()
    assert live.stream.stale(live.clock.now) == ""


def test_at_a_period_no_reading_that_waited_too_long_forces_a_step(wire: Wire) -> None:
    wire.writer("/tf", "tf2_msgs/msg/TFMessage")
    fields = {"integrator": {"frame": "base"}, "cycle": {"every": 1.0}}
    live = Live(wire, {**SENSORS, "tf": ("/tf",)}, **fields)
    live.say("/tf", transforms(START - SECOND, "base", "probe"))
    for at in range(0, 900, 10):
        live.say("/wrist", wrench(START + at * MILLISECOND), at)
    live.clock.now += 900 * MILLISECOND
    assert live.play() == []


def test_topics_are_listed_once_however_often_the_network_changes(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.stream.rematch = lambda stream: stream.sensors  # as where several topics fit
    wire.writers.clear()
    for number in range(3):
        wire.writer(f"/rosout_{number}", "rcl_interfaces/msg/Log")
        live.stream.discovered(wire.ends())
    assert live.stream.sensors == {"wrist": ["/wrist"]}


def test_a_topic_that_comes_back_with_another_type_is_read_as_that(wire: Wire) -> None:
    live = Live(wire, SENSORS)
    live.stream.rematch = lambda stream: SENSORS
    wire.writers.clear()
    live.stream.discovered(wire.ends())
    wire.writer("/wrist", "sensor_msgs/msg/JointState")
    live.stream.discovered(wire.ends())
    joints = message(
        "sensor_msgs/JointState",
        header=header(START, "base"),
        name=["elbow"],
        position=np.zeros(1),
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )
    live.say("/wrist", joints)
    live.play()
    assert live.stream.states["/wrist"].listener.kind is JointState
    assert live.stream.states["/wrist"].tally.readings == 1


def test_a_camera_keeps_its_camera_info_when_other_nodes_come(wire: Wire) -> None:
    topics = {
        "/eye/depth": "sensor_msgs/msg/Image",
        "/eye/camera_info": "sensor_msgs/msg/CameraInfo",
    }
    for name, msgtype in topics.items():
        wire.writer(name, msgtype)
    sensors = {"eye": ("/eye/depth",)}
    live = Live(wire, sensors)
    live.stream.rematch = lambda stream: sensors
    before = live.stream.states["/eye/depth"].listener
    assert isinstance(before, Camera)
    before.beside.keep("camera_info", 0, header(START, "eye"))
    wire.writer("/rosout", "rcl_interfaces/msg/Log")
    live.stream.discovered(wire.ends())
    after = live.stream.states["/eye/depth"].listener
    assert isinstance(after, Camera) and after.beside is before.beside
