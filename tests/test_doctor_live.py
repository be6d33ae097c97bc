"""`doctor --live`: what is on a network, which ends do not match, whose clock is another."""

import os
import subprocess
import sys
import threading
import time

import pytest

from contactfusion.doctor.live import Heard, interfaces, network_findings
from contactfusion.live.transport import End, Quality
from contactfusion.recordings.messages import defined, type_hash, typestore
from tests.wire import SECOND, START, wrench

WRENCH = "geometry_msgs/msg/WrenchStamped"
RELIABLE, BEST_EFFORT = Quality(True, False), Quality(False, False)


def end(peer: str, writes: bool, quality: Quality = RELIABLE, msgtype: str = WRENCH) -> End:
    hashed = type_hash(msgtype, defined(msgtype))
    return End("/wrist", msgtype, writes, quality, hashed, peer, ours=False)


def heard(late: int, count: int = 11) -> Heard:
    """Messages at 10 Hz that arrive so long after their stamps [ns]."""
    made = Heard(stamped=True)
    for index in range(count):
        stamp = START + index * SECOND // 10
        made.take(bytes(typestore().serialize_cdr(wrench(stamp), WRENCH)), stamp + late)
    return made


def found(*ends: End, **came: Heard) -> tuple[list[str], list[str]]:
    """What is, and what is wrong."""
    findings = list(network_findings(ends, {f"/{name}": each for name, each in came.items()}))
    return [str(f) for f in findings if not f.core], [str(f) for f in findings if f.core]


def test_a_topic_is_listed_with_its_ends_quality_rate_and_delay() -> None:
    lines, faults = found(end("arm", True), end("screen", False), wrist=heard(SECOND // 500))
    assert faults == []
    assert lines == [
        "peers: arm, screen",
        f"/wrist ({WRENCH}): written by arm (reliable); read by screen (reliable); makes Wrench; "
        "10.0 Hz, 0.0020 s after its stamps (0.0020 to 0.0020)",
    ]


@pytest.mark.parametrize(
    ("offered", "asked", "words"),
    [
        (BEST_EFFORT, RELIABLE, "which offers best effort; it asks for reliable"),
        (RELIABLE, Quality(True, True), "which offers reliable; it asks for reliable, latched"),
        (
            Quality(True, False, 1.0),
            Quality(True, False, 0.1),
            "which offers reliable, deadline 1 s; it asks for reliable, deadline 0.1 s",
        ),
    ],
)
def test_a_reader_that_asks_for_more_than_is_offered_is_a_fault(
    offered: Quality, asked: Quality, words: str
) -> None:
    _, faults = found(end("arm", True, offered), end("screen", False, asked))
    assert faults == [
        f"/wrist: screen does not hear arm, {words}: give both the same quality of service"
    ]


def test_a_reader_that_asks_for_less_hears() -> None:
    _, faults = found(end("arm", True, Quality(True, True, 0.1)), end("screen", False, BEST_EFFORT))
    assert faults == []


def test_ends_of_several_types_are_a_fault() -> None:
    _, faults = found(end("arm", True), end("screen", False, msgtype="geometry_msgs/msg/Wrench"))
    assert faults == [
        f"/wrist: screen does not hear arm, which writes {WRENCH}; it reads "
        "geometry_msgs/msg/Wrench: give one of both another topic"
    ]


def test_another_definition_of_a_type_is_a_fault() -> None:
    _, (fault,) = found(end("arm", True)._replace(type_hash="RIHS01_00"))
    assert fault.startswith(f"/wrist: its {WRENCH} is another than that of ROS 2 Jazzy")


@pytest.mark.parametrize(
    ("late", "words"),
    [
        (-3600 * SECOND, "its clock is 3,600.000 s ahead of this machine's: set both by NTP"),
        (60 * SECOND, "its clock is 60.000 s behind this machine's: set both by NTP"),
        (START, "it counts simulated time, and this pipeline does not: --sim-time"),
    ],
)
def test_a_clock_that_is_another_is_a_fault(late: int, words: str) -> None:
    _, (fault,) = found(end("arm", True), wrist=heard(late))
    assert f"/wrist: {words}" in fault


def test_a_network_without_peers_is_a_fault() -> None:
    _, (fault,) = found()
    assert fault.startswith("no peer answers: compare ROS_DOMAIN_ID")


def test_a_topic_that_nothing_came_on_or_nobody_writes_says_so() -> None:
    lines, _ = found(end("arm", True), wrist=Heard(stamped=True))
    assert lines[1].endswith("nothing came")
    lines, _ = found(end("screen", False))
    assert "no writer; read by screen (reliable)" in lines[1]


def test_interfaces_have_addresses() -> None:
    assert any("127.0.0.1" in each for each in interfaces())


def test_the_command_finds_a_writer_of_another_process(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cyclonedds")
    from contactfusion.live.dds import DdsTransport

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    domain = str(1 + os.getpid() % 99)
    transport = DdsTransport(int(domain))
    send = transport.advertise("/wrist", WRENCH)
    ended = threading.Event()

    def write() -> None:
        while not ended.wait(0.01):
            send(typestore().serialize_cdr(wrench(time.time_ns() - 3600 * SECOND), WRENCH))

    writing = threading.Thread(target=write)
    writing.start()
    command = [sys.executable, "-m", "contactfusion", "doctor", "--live", "--domain", domain]
    done = subprocess.run(command, capture_output=True, text=True)
    ended.set()
    writing.join()
    transport.close()
    assert (done.returncode, done.stderr) == (1, "")
    assert f"written by process {os.getpid()} on " in done.stdout
    assert "makes Wrench; " in done.stdout
    assert "fault: /wrist: its clock is 3,600.0" in done.stdout
