"""`contactfusion live` in processes of their own, over DDS: from start to each of its ends."""

import json
import math
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import numpy as np
import pytest
import yaml

pytest.importorskip("cyclonedds")

from contactfusion.errors import ConfigurationError
from contactfusion.live.control import Control, ask
from contactfusion.live.dds import DdsTransport
from contactfusion.live.transport import Quality, Send
from contactfusion.readings.messages import Message
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.ros.files import Bag
from tests.wire import PROBE, wrench

STRONGEST = "/contactfusion/contacts/strongest"
HEARD = Quality(False, False)
PATIENCE = 60.0
"""The longest wait for a process on a busy machine [s]."""


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator["Robot"]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    made = Robot(tmp_path)
    yield made
    made.close()


class Robot:
    """A wrist sensor on DDS, what it hears, and a pipeline that listens."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.transport = folder, DdsTransport()
        self.heard: dict[str, list[tuple[int, Message]]] = {}
        self.plug()
        self.live: subprocess.Popen[str] | None = None

    def listen(self, topic: str, msgtype: str) -> None:
        heard = self.heard[topic] = []
        decode = typestore().deserialize_cdr
        take = lambda cdr, at: heard.append((at, decode(cdr, msgtype)))  # noqa: E731
        self.transport.listen(topic, msgtype, HEARD, take)

    def start(self, *options: str, **fields: Any) -> None:
        """Start `live`, and press until its first contact is heard."""
        file = self.folder / "probe.yaml"
        file.write_text(yaml.safe_dump({**PROBE, **fields}), encoding="utf-8")
        self.listen(STRONGEST, "geometry_msgs/msg/WrenchStamped")
        command = [sys.executable, "-m", "contactfusion", "live", str(file), *options]
        self.live = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=self.folder
        )
        self.push_until(lambda: bool(self.heard[STRONGEST]))

    def push_until(self, is_so: Any, fz: float = -5.0) -> None:
        """Press at 100 Hz until something is so."""
        ends = time.monotonic() + PATIENCE
        while not is_so():
            assert time.monotonic() < ends, "it never came"
            assert self.live is None or self.live.poll() is None, self.live.communicate()[0]
            self.push(fz)

    def plug(self) -> None:
        """A driver of the wrist sensor starts."""
        self._driver = DdsTransport()
        self.send: Send = self._driver.advertise("/wrist", "geometry_msgs/msg/WrenchStamped")

    def unplug(self) -> None:
        """It is gone."""
        self._driver.close()

    def wait_for(self, event: str) -> None:
        """Wait until an event is heard."""
        wait_until(lambda: self.has_heard(event))

    def has_heard(self, event: str) -> bool:
        return any(event in sent.data for _, sent in self.heard["/contactfusion/events"])

    def memory(self) -> float:
        """The resident memory of `live` [MB]."""
        assert self.live is not None
        pages = Path(f"/proc/{self.live.pid}/statm").read_text(encoding="utf-8").split()[1]
        return int(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6

    def push(self, fz: float = -5.0) -> None:
        sent = wrench(time.time_ns(), fz)
        self.send(typestore().serialize_cdr(sent, sent.__msgtype__))
        time.sleep(0.01)

    def end(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """End `live` by a signal: its exit status, and what it printed."""
        assert self.live is not None
        self.live.send_signal(number)
        printed = self.live.communicate(timeout=PATIENCE)[0]
        return self.live.returncode, printed

    def close(self) -> None:
        if self.live is not None and self.live.poll() is None:
            self.live.kill()
            self.live.communicate()
        self._driver.close()
        self.transport.close()


def diagnosed(robot: Robot) -> set[str]:
    """The parts whose state was diagnosed."""
    states = {state.name for _, m in robot.heard["/diagnostics"] for state in m.status}
    return {name.removeprefix("contactfusion: ") for name in states}


def wait_until(is_so: Callable[[], bool]) -> None:
    ends = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < ends, "it never came"
        time.sleep(0.05)


def messages_of(path: Path, topic: str) -> list[bytes]:
    with Bag(path) as bag:
        channels = [channel for channel in bag.channels if channel.topic == topic]
        return [bytes(channel.cdr(raw)) for channel, _, raw in bag.messages(channels)]


def test_a_wrench_becomes_a_contact_that_other_nodes_hear(robot: Robot) -> None:
    robot.listen("/contactfusion/contacts/markers", "visualization_msgs/msg/MarkerArray")
    robot.listen("/contactfusion/contacts/cloud", "sensor_msgs/msg/PointCloud2")
    robot.listen("/contactfusion/events", "std_msgs/msg/String")
    robot.listen("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    robot.start()
    robot.push_until(lambda: all(robot.heard.values()) and "wrist" in diagnosed(robot))
    _, strongest = robot.heard[STRONGEST][-1]
    assert strongest.wrench.force.z == pytest.approx(-5.0)
    assert strongest.wrench.torque.y == pytest.approx(0.1, abs=0.03)
    cloud = next(m for _, m in robot.heard["/contactfusion/contacts/cloud"] if m.width)
    x, _, z, probability = cloud.data.view(np.float32)
    assert (x, z) == pytest.approx((0.02, 0.046), abs=0.005)
    assert probability > 0.5
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "probability"]
    events = [json.loads(m.data) for _, m in robot.heard["/contactfusion/events"]]
    assert "made" in [event.get("change") for event in events]
    assert diagnosed(robot) == {"cycle", "wrist"}


def test_what_is_recorded_live_is_found_again_when_it_is_played(robot: Robot) -> None:
    robot.start("--record", "live.mcap", "--name", "probe")
    for row in range(60):
        robot.push(-5.0 if row % 20 < 12 else 0.0)
    assert ask("threshold 0.9", "probe") == "the threshold is 0.9, and was 0.5"
    for row in range(60):
        robot.push(-8.0 if row % 20 < 12 else 0.0)
    status, printed = robot.end()
    assert status == 0, printed
    live, again = robot.folder / "live.mcap", robot.folder / "again.mcap"
    played = ["run", "probe.yaml", str(live), "--out", str(again)]
    command = [sys.executable, "-m", "contactfusion", *played]
    subprocess.run(command, cwd=robot.folder, check=True, capture_output=True)
    for topic in ("contacts", "events", "cycles", "changes"):
        first = messages_of(live, f"/contactfusion/{topic}")
        assert first == messages_of(again, f"/contactfusion/{topic}")
        assert first


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_it_ends_by_a_signal_with_a_whole_recording(robot: Robot, number: int) -> None:
    robot.start("--record", "live.mcap")
    for _ in range(20):
        robot.push()
    status, printed = robot.end(number)
    assert status == 0
    assert "results: live.mcap" in printed
    assert messages_of(robot.folder / "live.mcap", "/wrist")
    assert not list(robot.folder.glob(".live.mcap*"))


def test_a_console_that_is_gone_ends_nothing(robot: Robot) -> None:
    robot.listen("/contactfusion/events", "std_msgs/msg/String")
    robot.start("--record", "live.mcap")
    assert robot.live is not None and robot.live.stdout is not None
    robot.live.stdout.close()
    robot.push(fz=math.nan)
    robot.push_until(lambda: robot.has_heard("1 refused"))  # a warning, which is printed, too
    before = len(robot.heard[STRONGEST])
    robot.push_until(lambda: len(robot.heard[STRONGEST]) > before + 20)
    robot.live.send_signal(signal.SIGINT)
    robot.live.wait(timeout=PATIENCE)
    assert messages_of(robot.folder / "live.mcap", "/wrist")
    assert not list(robot.folder.glob(".live.mcap*"))


def test_what_was_recorded_outlives_a_process_that_is_killed(robot: Robot) -> None:
    robot.start("--record", "live.mcap")
    for _ in range(250):
        robot.push()
    robot.end(signal.SIGKILL)
    (left,) = robot.folder.glob(".live.mcap*/recording/recording.mcap")
    played = [sys.executable, "-m", "contactfusion", "run", "probe.yaml", str(left)]
    done = subprocess.run(played, cwd=robot.folder, capture_output=True, text=True)
    cut = re.search(r"recording.mcap is cut off after (\d+) messages", done.stderr)
    assert cut is not None, done.stderr
    assert int(cut[1]) > 500
    assert re.search(r"\d+ steps, \d+ with contact", done.stdout), done.stdout


def test_the_page_shows_what_runs_and_records_it(robot: Robot) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    robot.start("--web", str(port))
    page = f"http://127.0.0.1:{port}"
    with urlopen(f"{page}/status") as stream:
        statuses = (json.loads(line[6:]) for line in stream if line.startswith(b"data: "))
        shown = next(each["sources"] for each in statuses if each["sources"])
    assert [source["name"] for source in shown] == ["wrist"]
    with urlopen(f"{page}/surface") as answer:
        points = np.frombuffer(answer.read(), "<f4").reshape(-1, 3)
    assert np.linalg.norm(points, axis=1) == pytest.approx(0.05, abs=1e-4)
    record = Request(f"{page}/change", b"record start", {"Origin": page})
    with urlopen(record) as answer:
        assert b"probe-" in answer.read()
    robot.push()
    code, printed = robot.end()
    assert (code, f"a page shows it: {page}/" in printed) == (0, True), printed
    (recording,) = robot.folder.glob("probe-*.mcap")
    assert messages_of(recording, "/wrist")


def test_the_page_is_opened_in_a_browser_where_it_is_wanted(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = robot.folder / "opened"
    browser = robot.folder / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > {opened}\n', encoding="utf-8")
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", str(browser))
    robot.start("--view")
    with urlopen(opened.read_text(encoding="utf-8").strip()) as answer:
        assert b"<html" in answer.read()
    robot.end()
    monkeypatch.setenv("BROWSER", "/bin/false")
    command = [sys.executable, "-m", "contactfusion", "live", "probe.yaml", "--view", "--wait", "0"]
    done = subprocess.run(command, cwd=robot.folder, capture_output=True, text=True)
    assert done.returncode == 1
    assert "contactfusion: --view: no browser opens here; --web 8080 serves" in done.stderr


SPHERE = """<robot name="probe"><link name="probe"><collision><geometry><sphere radius="0.05"/>
</geometry></collision></link><link name="mount"/>
<joint name="flange" type="fixed"><parent link="probe"/><child link="mount"/></joint></robot>"""


def test_another_robot_on_the_network_is_told(robot: Robot) -> None:
    (robot.folder / "probe.urdf").write_text(SPHERE, encoding="utf-8")
    robot.listen("/contactfusion/events", "std_msgs/msg/String")
    described = "/robot_description", "std_msgs/msg/String"
    send = robot.transport.advertise(*described, latched=True)
    sent = typestore().types[described[1]](data=SPHERE.replace("flange", "gripper"))
    send(typestore().serialize_cdr(sent, described[1]))
    robot.start(robot={"urdf": "probe.urdf", "spacing": 0.004}, surface=None)
    robot.wait_for("the robot on /robot_description is another: it lacks the joint flange")
    robot.wait_for("it has the joint gripper besides")


def test_orders_change_what_runs_and_wrong_ones_are_answered_with_a_sentence(robot: Robot) -> None:
    robot.start()
    robot.push_until(lambda: json.loads(ask("status"))["sources"])
    (source,) = json.loads(ask("status"))["sources"]
    assert (source["name"], source["topic"], source["health"]) == ("wrist", "/wrist", "ok")
    assert ask("unplug wrist") == "'wrist' is unplugged"
    assert ask("plug wrist") == "'wrist' is plugged"
    with pytest.raises(ValueError, match="unknown generator 'wrst'; did you mean 'wrist'"):
        ask("unplug wrst")
    with pytest.raises(ValueError, match="unknown change 'fly'"):
        ask("fly")
    with pytest.raises(ValueError, match="no `contactfusion live` runs as 'arm'"):
        ask("status", "arm")
    (robot.folder / "taken.mcap").mkdir()
    with pytest.raises(ValueError, match=r"taken\.mcap"):
        ask("record start taken.mcap")
    late = robot.folder / "a late one.mcap"
    assert ask("record start 'a late one.mcap'") == f"recording to {late}"
    with pytest.raises(ValueError, match=r"a late one.mcap is being recorded; stop that first"):
        ask("record start other.mcap")
    for _ in range(20):
        robot.push()
    assert ask("record stop") == f"{late} is recorded"
    assert messages_of(late, "/wrist")
    for wrong in ("record start 'a b", "record start a.mcap b.mcap", "record stop a.mcap"):
        with pytest.raises(ValueError, match="write record start|No closing quotation"):
            ask(wrong)
    with pytest.raises(ValueError, match="answers are recorded, and can't be ordered"):
        ask("answer wrist 1")


@pytest.mark.parametrize(
    ("live", "sentence"),
    [
        ({"twist": "cmd vel"}, "live.twist: "),
        (5, "live: takes fields such as `twist`, not 5"),
        (False, "live: takes fields such as `twist`, not False"),
    ],
)
def test_a_configuration_that_is_wrong_ends_it_before_it_starts(
    live: object, sentence: str, tmp_path: Path
) -> None:
    file = tmp_path / "probe.yaml"
    file.write_text(yaml.safe_dump({**PROBE, "live": live}), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "contactfusion", "live", str(file)], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert sentence in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(("name", "why"), [("x" * 200, "path too long"), ("a/b", "no slash")])
def test_a_name_that_is_none_is_a_sentence(
    name: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(ConfigurationError, match=f"^--name {name}: .*{why}"):
        Control(name, str)


def test_an_order_that_fails_is_a_sentence_and_the_next_is_carried_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def order(text: str) -> str:
        if text == "open":
            raise OSError("no such device")
        return str(1 // len(text.removeprefix("tare")))

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with Control("probe", order):
        for text, why in (
            ("tare", "ZeroDivisionError: integer"),
            ("open", "OSError: no such device"),
        ):
            with pytest.raises(ConfigurationError, match=f"^the order '{text}' failed: {why}"):
                ask(text)
        assert ask("x") == "1"


def test_an_order_waits_for_want_of_descriptors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with (
        Control("probe", str.upper),
        socket.socket(socket.AF_UNIX) as first,
        socket.socket(socket.AF_UNIX) as second,
    ):
        (path,) = tmp_path.rglob("probe.sock")
        resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
        try:
            for client in (first, second):
                client.connect(str(path))
                client.sendall(b"tare\n")
            second.settimeout(0.3)  # where `accept` waits already, the first has a descriptor
            with pytest.raises(TimeoutError):
                second.recv(1000)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for client in (first, second):
            client.settimeout(PATIENCE)
            assert b"TARE" in client.recv(1000)
        assert ask("tare") == "TARE"


@pytest.mark.skipif(find_spec("rclpy") is not None, reason="rclpy is installed")
def test_without_rclpy_a_sentence_says_where_it_comes_from(tmp_path: Path) -> None:
    file = tmp_path / "probe.yaml"
    file.write_text(yaml.safe_dump(PROBE), encoding="utf-8")
    command = [sys.executable, "-m", "contactfusion", "live", str(file), "--ros", "rclpy"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "rclpy can't be imported" in done.stderr
    assert "`--ros dds` needs none" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_sensor_that_is_gone_makes_the_belief_stale_and_is_heard_again_when_it_is_back(
    robot: Robot,
) -> None:
    robot.listen("/contactfusion/events", "std_msgs/msg/String")
    robot.start()
    robot.unplug()
    robot.wait_for("commands are zero: no sensor of contacts has reported for 0.")
    wait_until(lambda: json.loads(ask("status"))["contacts"] == [])
    robot.plug()
    heard = len(robot.heard[STRONGEST])
    robot.push_until(lambda: len(robot.heard[STRONGEST]) > heard)
    robot.push_until(lambda: robot.has_heard("commands go on"))


def test_a_flood_leaves_the_loop_alive_and_memory_bounded(robot: Robot) -> None:
    robot.start()
    sent = wrench(time.time_ns())
    cdr = bytes(typestore().serialize_cdr(sent, sent.__msgtype__))
    before = robot.memory()
    ends = time.monotonic() + 3.0
    while time.monotonic() < ends:
        for _ in range(200):  # about 10 kHz and more
            robot.send(cdr)
        time.sleep(0.01)
    state = json.loads(ask("status"))
    assert state["topics"][0]["messages"] > 1000
    assert state["cycle"]["rate"] > 0.0
    assert robot.memory() < before + 100.0


def test_garbage_is_reported_and_harms_nothing(robot: Robot) -> None:
    robot.listen("/contactfusion/events", "std_msgs/msg/String")
    robot.start()
    other = DdsTransport()
    send = other.advertise("/wrist", "std_msgs/msg/String")
    sent = typestore().types["std_msgs/msg/String"](data="x" * 10)
    send(typestore().serialize_cdr(sent, sent.__msgtype__))
    robot.wait_for("it has writers of several types")
    other.close()
    heard = len(robot.heard[STRONGEST])
    robot.push_until(lambda: len(robot.heard[STRONGEST]) > heard)


def test_what_ends_before_it_answers_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as ends:
        (tmp_path / "contactfusion").mkdir(mode=0o700)
        ends.bind(str(tmp_path / "contactfusion" / "arm.sock"))
        ends.listen()

        def hang_up() -> None:
            for _ in range(2):  # the first asks whether it runs
                ends.accept()[0].close()

        thread = threading.Thread(target=hang_up)
        thread.start()
        with pytest.raises(ConfigurationError, match="^'arm' ended, or hangs: it gave no answer$"):
            ask("status")
        thread.join()
