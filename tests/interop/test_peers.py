"""Robots of other implementations: nothing is lost either way, and types have the same hashes."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("cyclonedds")

from contactfusion.live.dds import DdsTransport
from contactfusion.live.transport import Quality, Transport
from contactfusion.readings.messages import Message, header, message
from contactfusion.recordings.messages import defined, type_hash, typestore
from contactfusion.recordings.ros.files import Bag
from tests.interop.peers import BYTES, CLOUDS, COMMANDS, OF_ROS, WRENCHES, Robot
from tests.wire import PROBE, wrench

pytestmark = [
    pytest.mark.interop,
    pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning"),  # of rclpy
]

WRENCH = "geometry_msgs/msg/WrenchStamped"
CLOUD = "sensor_msgs/msg/PointCloud2"
STRONGEST = "/contactfusion/contacts/strongest"
RELIABLE, BEST_EFFORT = Quality(True, False), Quality(False, False)
EVERY = WRENCHES // CLOUDS
PATIENCE = 60.0
"""The longest wait for another process [s]."""


@pytest.fixture(autouse=True)
def on_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(20 + os.getpid() % 80))


@pytest.fixture(params=COMMANDS)
def name(request: pytest.FixtureRequest) -> str:
    """Of an implementation that is there."""
    program = COMMANDS[request.param][0]
    if not program.exists():
        pytest.skip(f"{program} is not there: scripts/interop.sh makes it, and says why it can't")
    return str(request.param)


@pytest.fixture(params=["dds", "rclpy"])
def ros(request: pytest.FixtureRequest, name: str) -> str:
    """How ROS is joined."""
    if request.param == "rclpy":
        pytest.importorskip("rclpy")
        if name == "cyclonedds":
            pytest.skip("Cyclone DDS 0.10 and the Fast DDS of rclpy do not find each other here")
    return str(request.param)


@pytest.fixture
def transport(ros: str, on_this_machine: None) -> Iterator[Transport]:
    if ros == "dds":
        opened: Transport = DdsTransport()
    else:
        from contactfusion.live.node import NodeTransport

        opened = NodeTransport()
    with closing(opened):
        yield opened


def cdr_of(sent: Message) -> bytes:
    return bytes(typestore().serialize_cdr(sent, sent.__msgtype__))


def wrench_of(number: int) -> Message:
    sent = wrench(time.time_ns())
    sent.wrench.force.x = 1e-9 * number
    return sent


def cloud_of(number: int) -> Message:
    return message(
        "sensor_msgs/PointCloud2",
        header=header(time.time_ns(), "probe"),
        height=1,
        width=BYTES,
        fields=[],
        is_bigendian=False,
        point_step=1,
        row_step=number,
        data=np.zeros(BYTES, np.uint8),
        is_dense=True,
    )


def number_of(cdr: bytes) -> int:
    sent: Message = typestore().deserialize_cdr(cdr, WRENCH)
    return round(1e9 * float(sent.wrench.force.x))


class Numbers:
    """The numbers of the messages of a topic that are heard, in their order."""

    def __init__(self, transport: Transport, topic: str, msgtype: str, quality: Quality) -> None:
        self._cdr: list[bytes] = []
        self._msgtype = msgtype
        self.came = threading.Event()
        transport.listen(topic, msgtype, quality, self._take)

    def _take(self, cdr: bytes, arrived: int) -> None:
        self._cdr.append(cdr)
        self.came.set()

    def list(self) -> list[int]:
        if self._msgtype == CLOUD:
            clouds: list[Message] = [typestore().deserialize_cdr(cdr, CLOUD) for cdr in self._cdr]
            return [cloud.row_step for cloud in clouds if len(cloud.data) == BYTES]
        return [number_of(cdr) for cdr in self._cdr]


def test_nothing_is_lost_either_way_and_hashes_are_the_same(
    name: str, transport: Transport
) -> None:
    wrenches = Numbers(transport, "/robot", WRENCH, RELIABLE)
    fleeting = Numbers(transport, "/robot_best_effort", WRENCH, BEST_EFFORT)
    clouds = Numbers(transport, "/robot_cloud", CLOUD, RELIABLE)
    send = transport.advertise("/ours", WRENCH)
    send_cloud = transport.advertise("/ours_cloud", CLOUD)
    with closing(Robot(name, "/robot", "/ours")) as robot:
        assert wrenches.came.wait(PATIENCE)
        theirs = [end for end in transport.ends() if not end.ours and end.topic == "/robot"]
        began = time.monotonic()
        for number in range(WRENCHES):
            time.sleep(max(0.0, began + 1e-3 * number - time.monotonic()))
            send(cdr_of(wrench_of(number)))
            if number % EVERY == 0:
                send_cloud(cdr_of(cloud_of(number // EVERY)))
        heard = robot.heard()
    assert heard.wrenches == list(range(WRENCHES))
    assert heard.clouds == list(range(CLOUDS))
    assert heard.sizes == {BYTES}
    assert wrenches.list() == list(range(WRENCHES))
    assert clouds.list() == list(range(CLOUDS))
    fewer = fleeting.list()
    assert len(fewer) > 0.9 * WRENCHES
    assert fewer == sorted(set(fewer))
    assert not transport.unsent
    assert [(end.writes, end.msgtype, end.quality) for end in theirs] == [(True, WRENCH, RELIABLE)]
    if name in OF_ROS:
        known = type_hash(WRENCH, defined(WRENCH))
        assert heard.hashes == [known]
        assert theirs[0].type_hash == known


def test_live_finds_the_contacts_of_a_robot_which_hears_them(
    name: str, ros: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    file = tmp_path / "probe.yaml"
    file.write_text(yaml.safe_dump({**PROBE, "cycle": {"every": 0.02}}), encoding="utf-8")
    command = [sys.executable, "-m", "contactfusion", "live", str(file), "--ros", ros]
    with closing(Robot(name, "/wrist", STRONGEST)) as robot:
        live = subprocess.Popen(
            [*command, "--wait", "20", "--record", "live.mcap"],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            heard = robot.heard()
        finally:
            live.terminate()
            printed = live.communicate(timeout=PATIENCE)[0]
    assert live.returncode == 0, printed
    assert len(heard.wrenches) > 20, printed
    with Bag(tmp_path / "live.mcap") as bag:
        (channel,) = (channel for channel in bag.channels if channel.topic == "/wrist")
        came = [bytes(channel.cdr(raw)) for _, _, raw in bag.messages([channel])]
    numbers = [number_of(cdr) for cdr in came]
    assert numbers == sorted(set(numbers))
    dropped = "dropped: they come faster than they are taken"  # where the machine has no time
    assert len(numbers) == WRENCHES or dropped in printed, printed
