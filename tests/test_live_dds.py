"""DDS as a transport: two participants hear each other as nodes of ROS 2 do."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing

import numpy as np
import pytest

pytest.importorskip("cyclonedds")

from contactfusion.errors import ConfigurationError, RecordingError
from contactfusion.live.dds import LOOPBACK, DdsTransport
from contactfusion.live.transport import RESULTS, End, Quality, Transport
from contactfusion.readings.messages import Message, header, message
from contactfusion.recordings.messages import defined, type_hash, typestore
from tests.wire import START, wrench

WRENCH = "geometry_msgs/msg/WrenchStamped"
CLOUD = "sensor_msgs/msg/PointCloud2"
RELIABLE, BEST_EFFORT, LATCHED = Quality(True, False), Quality(False, False), Quality(True, True)
DOMAIN = 110 + os.getpid() % 100
PATIENCE = 20.0
"""The longest wait for what happens between processes [s]."""


@pytest.fixture(autouse=True)
def on_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)


@pytest.fixture
def here(on_this_machine: None) -> Iterator[Transport]:
    with closing(DdsTransport(DOMAIN)) as transport:
        yield transport


@pytest.fixture
def there(on_this_machine: None) -> Iterator[Transport]:
    with closing(DdsTransport(DOMAIN)) as transport:
        yield transport


def numbered(number: int) -> bytes:
    sent = wrench(START, float(number))
    return bytes(typestore().serialize_cdr(sent, sent.__msgtype__))


def number_of(cdr: bytes) -> int:
    sent: Message = typestore().deserialize_cdr(cdr, WRENCH)
    return int(sent.wrench.force.z)


def until(is_so: Callable[[], object]) -> None:
    ends = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < ends, "it never came"
        time.sleep(0.01)


def ends_of(transport: Transport, topic: str, *, writes: bool) -> list[End]:
    return [end for end in transport.ends() if (end.topic, end.writes) == (topic, writes)]


def awaited(here: Transport, topic: str, *, writes: bool) -> End:
    """An end of a topic that another has, once it is known here."""
    until(lambda: [end for end in ends_of(here, topic, writes=writes) if not end.ours])
    return next(end for end in ends_of(here, topic, writes=writes) if not end.ours)


def listened(transport: Transport, topic: str, msgtype: str, quality: Quality) -> list[bytes]:
    heard: list[bytes] = []
    transport.listen(topic, msgtype, quality, lambda cdr, arrived: heard.append(cdr))
    return heard


def test_each_message_of_a_reliable_topic_arrives_once_and_in_order(
    here: Transport, there: Transport
) -> None:
    heard = listened(here, "/wrist", WRENCH, RELIABLE)
    send = there.advertise("/wrist", WRENCH)
    awaited(there, "/wrist", writes=False)
    awaited(here, "/wrist", writes=True)
    for number in range(1000):
        send(numbered(number))
        if number % RESULTS == 0:  # a writer keeps so many for a reader that lags
            time.sleep(0.005)
    until(lambda: len(heard) >= 1000)
    time.sleep(0.1)
    assert [number_of(cdr) for cdr in heard] == list(range(1000))
    assert not there.unsent


def test_a_large_cloud_arrives_as_it_was_sent(here: Transport, there: Transport) -> None:
    heard = listened(here, "/eye", CLOUD, RELIABLE)
    send = there.advertise("/eye", CLOUD)
    awaited(there, "/eye", writes=False)
    data = np.random.default_rng(0).integers(0, 256, 120_001, dtype=np.uint8)
    cloud = message(
        "sensor_msgs/PointCloud2",
        header=header(START, "eye"),
        height=1,
        width=len(data),
        fields=[],
        is_bigendian=False,
        point_step=1,
        row_step=len(data),
        data=data,
        is_dense=True,
    )
    send(typestore().serialize_cdr(cloud, cloud.__msgtype__))
    until(lambda: heard)
    came: Message = typestore().deserialize_cdr(heard[0], CLOUD)
    assert (came.data == data).all()


def test_an_end_shows_its_type_its_hash_its_quality_and_whose_it_is(
    here: Transport, there: Transport
) -> None:
    _writer = there.advertise("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
    listened(there, "/wrist", WRENCH, BEST_EFFORT)
    written = awaited(here, "/tf_static", writes=True)
    read = awaited(here, "/wrist", writes=False)
    msgtype = "tf2_msgs/msg/TFMessage"
    known = type_hash(msgtype, defined(msgtype))
    assert written[:-2] == ("/tf_static", msgtype, True, LATCHED, known)
    assert read[:-2] == ("/wrist", WRENCH, False, BEST_EFFORT, type_hash(WRENCH, defined(WRENCH)))
    assert written.peer == read.peer
    (same,) = ends_of(there, "/wrist", writes=False)
    assert same == read._replace(ours=True)


def test_a_late_reader_hears_the_last_messages_of_a_latched_topic_alone(
    here: Transport, there: Transport
) -> None:
    senders = (
        there.advertise("/latched", WRENCH, latched=True),
        there.advertise("/fleeting", WRENCH),
    )
    for number in range(RESULTS + 2):
        for send in senders:
            send(numbered(number))
    latched = listened(here, "/latched", WRENCH, LATCHED)
    fleeting = listened(here, "/fleeting", WRENCH, RELIABLE)
    until(lambda: len(latched) == RESULTS)
    assert [number_of(cdr) for cdr in latched] == list(range(2, RESULTS + 2))
    assert fleeting == []


def test_a_reader_that_asks_for_more_than_is_offered_hears_nothing(
    here: Transport, there: Transport
) -> None:
    demanding = listened(here, "/wrist", WRENCH, LATCHED)
    send = there.advertise("/wrist", WRENCH)
    other = listened(there, "/wrist", WRENCH, BEST_EFFORT)
    awaited(there, "/wrist", writes=False)
    until(lambda: (send(numbered(7)), other)[1])
    assert demanding == []


def test_what_is_ignored_is_heard_no_longer_until_it_is_listened_to_again(
    here: Transport, there: Transport
) -> None:
    first = listened(here, "/wrist", WRENCH, RELIABLE)
    send = there.advertise("/wrist", WRENCH)
    until(lambda: (send(numbered(1)), first)[1])
    here.ignore("/wrist")
    until(lambda: not [end for end in ends_of(there, "/wrist", writes=False) if not end.ours])
    count = len(first)
    send(numbered(2))
    second = listened(here, "/wrist", WRENCH, RELIABLE)
    until(lambda: (send(numbered(3)), second)[1])
    assert len(first) == count
    assert {number_of(cdr) for cdr in second} == {3}


def test_what_is_malformed_is_not_sent_and_counted(here: Transport, there: Transport) -> None:
    heard = listened(here, "/wrist", WRENCH, RELIABLE)
    send = there.advertise("/wrist", WRENCH)
    awaited(there, "/wrist", writes=False)
    send(numbered(1)[:20])
    assert there.unsent == {"/wrist": 1}
    until(lambda: (send(numbered(2)), heard)[1])
    assert {number_of(cdr) for cdr in heard} == {2}
    assert there.unsent == {"/wrist": 1}


@pytest.mark.parametrize("of", ["listen", "advertise"])
def test_a_type_that_nothing_defines_is_refused_in_a_sentence(here: Transport, of: str) -> None:
    with pytest.raises(RecordingError, match="^nothing defines the type toys_msgs/msg/Robot$"):
        if of == "listen":
            listened(here, "/robot", "toys_msgs/msg/Robot", RELIABLE)
        else:
            here.advertise("/robot", "toys_msgs/msg/Robot")


@pytest.mark.parametrize("named", ["233", "-1", "robots"])
def test_a_domain_that_does_not_exist_is_refused_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, named: str
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", named)
    with pytest.raises(ConfigurationError, match=f"'{named}' is no number from 0 to 232$"):
        DdsTransport()
    if named != "robots":
        with pytest.raises(ConfigurationError, match=f"'{named}' is no number from 0 to 232$"):
            DdsTransport(int(named))


def test_another_domain_is_another_network(here: Transport) -> None:
    _writer = here.advertise("/wrist", WRENCH)
    with closing(DdsTransport(DOMAIN + 1)) as other, closing(DdsTransport(DOMAIN)) as same:
        awaited(same, "/wrist", writes=True)
        assert ends_of(other, "/wrist", writes=True) == []


def test_who_closes_is_gone_for_the_others(here: Transport) -> None:
    other = DdsTransport(DOMAIN)
    _writer = other.advertise("/wrist", WRENCH)
    listened(other, "/base", WRENCH, RELIABLE)
    awaited(here, "/wrist", writes=True)
    awaited(here, "/base", writes=False)
    other.close()
    until(lambda: not here.ends())


SENDS = """
import sys, time
from contactfusion.live.dds import DdsTransport
from contactfusion.recordings.messages import typestore
from tests.test_live_dds import WRENCH, numbered

send = DdsTransport(int(sys.argv[1])).advertise("/wrench", WRENCH)
while True:
    send(numbered(0))
    time.sleep(0.02)
"""


def test_who_stopped_for_so_long_that_it_was_forgotten_is_found_again_soon(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By itself Cyclone announces a participant every 30 s: in one of three stops that was late."""
    short = "<Discovery><LeaseDuration>1s</LeaseDuration>"
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK.replace("<Discovery>", short))
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    domain = str(10 + os.getpid() % 100)
    with ExitStack() as ending:
        here = ending.enter_context(closing(DdsTransport(int(domain))))
        sends = ending.enter_context(subprocess.Popen([sys.executable, "-c", SENDS, domain]))
        ending.callback(sends.kill)
        heard = listened(here, "/wrench", WRENCH, RELIABLE)
        for _ in range(4):
            until(lambda: heard)
            sends.send_signal(signal.SIGSTOP)
            time.sleep(1.6)
            heard.clear()
            sends.send_signal(signal.SIGCONT)
            went_on = time.monotonic()
            until(lambda: len(heard) > 50)  # more than lay in its queue
            assert time.monotonic() - went_on < 8.0


def test_others_of_this_process_stay_when_the_first_leaves(on_this_machine: None) -> None:
    first, second, third = (DdsTransport(DOMAIN + 1) for _ in range(3))
    heard = listened(second, "/wrist", WRENCH, RELIABLE)
    first.close()
    send = third.advertise("/wrist", WRENCH)
    awaited(third, "/wrist", writes=False)
    send(numbered(7))
    until(lambda: heard)
    for transport in (second, third):
        transport.close()


def test_many_join_at_the_same_time(on_this_machine: None) -> None:
    with ThreadPoolExecutor(8) as pool:
        transports = list(pool.map(lambda _: DdsTransport(DOMAIN + 2), range(8)))
    heard = listened(transports[0], "/wrist", WRENCH, RELIABLE)
    send = transports[-1].advertise("/wrist", WRENCH)
    awaited(transports[-1], "/wrist", writes=False)
    send(numbered(7))
    until(lambda: heard)
    for transport in transports:
        transport.close()


def test_one_that_only_sends_takes_no_time_of_the_processor(here: Transport) -> None:
    here.advertise("/wrist", WRENCH)
    began = time.process_time()
    time.sleep(1.0)
    assert time.process_time() - began < 0.05
