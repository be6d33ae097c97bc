"""The robot of a scene in real time: it obeys, it brakes, and it senses what the scene senses."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.live.dds import DdsTransport
from contactfusion.live.transport import Quality, Send
from contactfusion.readings import DepthImage, PointCloud, Reading, TactileImage
from contactfusion.readings.messages import Message, twist
from contactfusion.recordings.messages import typestore
from contactfusion.run.configuration import RunConfig, setting_of_file
from contactfusion.run.recorder import TRUTH, record_scene
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import PushScene
from contactfusion_lab.simulate.base import (
    COMMANDS,
    FASTEST,
    STILL,
    TIMEOUT,
    TWIST,
    Commanded,
    RealTime,
    run_base,
)
from contactfusion_lab.simulate.sensors import run_sensors
from contactfusion_lab.simulate.topics import Publisher, state_messages, state_of
from lab.tests.test_push_world import base
from tests.mcap_files import read_by_rosbags
from tests.test_cli import Ask, ask, folder, one_sentence

__all__ = ["ask", "folder"]

SCENES = Path(__file__).parents[2] / "examples" / "scenes"
FUSED = SCENES / "push_fused.yaml"
SEES = "scene.sees=[lidar,camera]"
DOMAIN = 20 + os.getpid() % 200
"""Of this process alone, as far as there are enough."""
SOON = 20.0
"""More than anything here takes [s]."""


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep to this machine, and to a domain of this process."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))


def config(*overrides: str) -> RunConfig:
    return setting_of_file(FUSED, overrides).run_config()


def scene(**fields: Any) -> PushScene:
    return PushScene(PushConfig(**{"target": (0.6, 0.1), **fields}), base())


@contextmanager
def running(*parts: Callable[[DdsTransport, threading.Event], object]) -> Iterator[None]:
    """Run nodes, each in a thread with a transport of its own."""
    ended, transports = threading.Event(), [DdsTransport() for _ in parts]
    threads = [
        threading.Thread(target=part, args=(transport, ended))
        for part, transport in zip(parts, transports, strict=True)
    ]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        for thread, transport in zip(threads, transports, strict=True):
            thread.join()
            transport.close()


def until(true: Callable[[], Any]) -> None:
    """Wait for something that comes soon."""
    ends = time.monotonic() + SOON
    while not true():
        assert time.monotonic() < ends
        time.sleep(0.01)


def cdr(velocity: Sequence[float]) -> bytes:
    forward, lateral, yaw_rate = velocity
    sent = twist(np.array([forward, lateral, 0.0]), np.array([0.0, 0.0, yaw_rate]))
    return bytes(typestore().serialize_cdr(sent, TWIST))


# Commands


def test_a_command_holds_until_its_time_is_over() -> None:
    now = 5.0
    commanded = Commanded(lambda: now)
    assert commanded.velocity() == STILL
    commanded.take(cdr((0.2, 0.1, -0.3)), 0)
    now += TIMEOUT - 0.01
    assert commanded.velocity() == (0.2, 0.1, -0.3)
    now += 0.02
    assert commanded.velocity() == STILL


def test_a_command_beyond_the_limits_is_limited() -> None:
    commanded = Commanded()
    commanded.take(cdr((1e300, -1e300, 5.0)), 0)
    forward, lateral, yaw_rate = FASTEST
    assert commanded.velocity() == (forward, -lateral, yaw_rate)


def test_a_command_without_numbers_is_none() -> None:
    commanded = Commanded()
    commanded.take(cdr((0.2, 0.0, float("nan"))), 0)
    assert commanded.velocity() == STILL
    assert commanded.count == 0


def test_a_world_that_was_late_goes_on_from_now(capsys: pytest.CaptureFixture[str]) -> None:
    clock = RealTime()
    time.sleep(0.3)
    clock.wait()
    before = clock.stamp
    clock.wait()
    assert clock.behind > 0.25
    assert clock.stamp - before == pytest.approx(1e9 / 240.0, abs=1.0)
    assert "base: real time was missed by 0." in capsys.readouterr().out


# The base


def test_a_velocity_for_each_step_moves_as_one_for_the_cycle() -> None:
    whole, stepwise = scene(gap=1.0), scene(gap=1.0)
    for _ in range(5):
        whole.drive(0.2, 0.1, 0.5)
        stepwise.follow([(0.2, 0.1, 0.5)] * 24)
    assert stepwise.truth().base == pytest.approx(whole.truth().base, abs=1e-4)
    assert stepwise.stamp == whole.stamp


def test_the_base_moves_as_it_is_commanded_and_stands_without_commands() -> None:
    speeds, transport = list[float](), DdsTransport()

    def take(raw: bytes, arrived: int) -> None:
        sent: Message = typestore().deserialize_cdr(raw, "geometry_msgs/msg/TwistStamped")
        speeds.append(sent.twist.linear.x)

    with running(lambda node, ended: run_base(scene(), config(), node, ended)):
        send: Send = transport.advertise(COMMANDS, TWIST)
        quality = Quality(reliable=True, latched=False)
        transport.listen(f"/{TRUTH}/twist", "geometry_msgs/msg/TwistStamped", quality, take)
        until(lambda: speeds)

        def driven() -> bool:
            send(cdr((0.1, 0.0, 0.0)))
            time.sleep(0.02)
            return speeds[-1] == pytest.approx(0.1, abs=1e-3)

        until(driven)
        until(lambda: speeds[-1] == pytest.approx(0.0, abs=1e-3))
    transport.close()
    assert max(speeds) < 0.11


# The sensors


def test_sensors_read_from_the_truth_what_they_read_in_the_scene() -> None:
    fields = {"sees": ("lidar", "camera"), "noise": "hard"}
    true, copy = scene(**fields), scene(**fields)
    for _ in range(4):
        sent = {
            topic: typestore().deserialize_cdr(
                typestore().serialize_cdr(each, each.__msgtype__), each.__msgtype__
            )
            for topic, each in state_messages(true.world.state, 10**18)
        }
        expected = true.sensor_readings(true.stamp, true.world.state)
        for there, here in zip(
            copy.sensor_readings(true.stamp, state_of(sent)), expected, strict=True
        ):
            assert (there.label, there.stamp) == (here.label, here.stamp)
            assert np.allclose(values(there), values(here), atol=1e-6)
        true.drive(0.15, 0.05, 0.1)
    skin = true.sensor_readings(true.stamp, true.world.state)[0]
    assert values(skin).max() > 1.0


def values(reading: Reading) -> Any:
    match reading:
        case TactileImage():
            return reading.values
        case PointCloud():
            return reading.points
        case DepthImage():
            return reading.depth
    raise AssertionError(reading)


@pytest.mark.slow
def test_the_topics_are_those_of_a_recording_of_the_scene(tmp_path: Path) -> None:
    recorded = tmp_path / "push.mcap"
    record_scene(FUSED, [SEES], recorded, duration=0.3)
    expected = {
        topic: messages[0].kind
        for topic, messages in read_by_rosbags(recorded).items()
        if not topic.startswith(f"/{TRUTH}/")
    }
    found, transport = dict[str, str](), DdsTransport()

    def looked() -> bool:
        ends = [end for end in transport.ends() if end.writes]
        found.update({end.topic: end.msgtype for end in ends})
        return expected.items() <= found.items()

    with running(
        lambda node, ended: run_base(scene(), config(), node, ended),
        lambda node, ended: run_sensors(scene(sees=("lidar", "camera")), config(), node, ended),
    ):
        until(looked)
        latched = {end.topic for end in transport.ends() if end.writes and end.quality.latched}
    transport.close()
    assert {topic for topic in found if not topic.startswith(f"/{TRUTH}/")} == set(expected)
    assert latched == {"/robot_description", "/tf_static"}


class Wire:
    """A transport that keeps the topics of what is sent."""

    def __init__(self) -> None:
        self.sent = list[str]()

    def advertise(self, topic: str, kind: str, latched: bool) -> Send:
        return lambda cdr: self.sent.append(topic)


def test_readings_pass_faults_on_their_way_and_the_truth_does_not() -> None:
    wire = Wire()
    faults = config("faults=[{fault: silent, sensor: odometry, start: 1}]").faults
    publisher = Publisher(wire, 0, faults)  # type: ignore[arg-type]
    for stamp in (0.5, 1.5):
        odometry, wheels = scene().motion_readings(stamp)
        publisher.readings([odometry, wheels])
        publisher.truth(wheels)
    assert wire.sent == ["/odometry", "/tf", *["/wheels", "/truth/wheels"] * 2]


# The command


def test_only_a_push_runs_in_real_time(ask: Ask) -> None:
    sentence = one_sentence(ask("simulate", str(SCENES / "touch_box.yaml")))
    assert "touch_box.yaml: scene.type: only a scene of type push" in sentence


def test_a_fault_is_of_a_sensor_that_the_scene_has(ask: Ask) -> None:
    failing = "faults=[{fault: silent, sensor: lidar}, {fault: silent, sensor: skim}]"
    words = "simulate", str(FUSED), "--part", "sensors", "--set", failing
    sentence = one_sentence(ask(*words))
    assert "faults.1.sensor: no reading of 'skim' came; did you mean 'skin'?" in sentence


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_both_parts_end_in_order_by_a_signal(number: signal.Signals) -> None:
    main = [sys.executable, "-m", "contactfusion", "simulate", str(FUSED)]
    with subprocess.Popen(main, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = list[str]()
        for line in process.stdout:
            lines.append(line)
            if line.startswith("sensors: the base is there"):
                process.send_signal(number)
    assert process.returncode == 0
    assert any(line.startswith("sensors:") and "cycles sensed" in line for line in lines)
    assert any(line.startswith("base:") and line.endswith("0 commands\n") for line in lines)
