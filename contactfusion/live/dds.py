"""ROS 2 without an installation of ROS: Cyclone DDS, messages as they are on the wire."""

import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, final

from contactfusion.errors import ConfigurationError, missing_extra
from contactfusion.live.clock import machine_time
from contactfusion.live.transport import (
    DEPTH,
    RESULTS,
    End,
    Quality,
    Send,
    Take,
    Transport,
    domain_number,
)
from contactfusion.recordings.messages import defined, type_hash, typestore
from contactfusion.time import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from cyclonedds.core import ReadCondition
    from cyclonedds.domain import Domain
    from cyclonedds.qos import Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

PREFIX = "rt"
"""What DDS has before the topics of ROS; those of services begin otherwise."""
MIDDLE = "::dds_::"
"""What DDS has within the types of ROS: geometry_msgs::msg::dds_::Wrench_."""
HASH = "typehash="
"""The word before the hash of a type, in the user data of a reader or a writer."""
BLOCKING = 0.1
"""The longest time that sending waits for a reader that lags behind [s]."""
MOST = 10_000
"""The most ends, and the most participants, that are known at a time."""
AT_ONCE = 256
"""Number of messages that are taken from a reader at once."""
PATIENCE = 0.2
"""The longest wait of the thread that reads, before it looks whether it shall end [s]."""
LOOPBACK = """<CycloneDDS><Domain>
<General><AllowMulticast>false</AllowMulticast>
<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers>
<MaxAutoParticipantIndex>50</MaxAutoParticipantIndex></Discovery>
</Domain></CycloneDDS>"""
"""The configuration of Cyclone that keeps to this machine, and needs no multicast."""
BY_NAME = """<CycloneDDS><Domain><Compatibility>
<IgnoreTypeInformation>1.15,1.16</IgnoreTypeInformation>
</Compatibility></Domain></CycloneDDS>"""
"""The configuration that knows types of Fast DDS (vendor 1.15) and of Cyclone (1.16) by name alone,
as ROS does: what Fast DDS 3, that of ROS 2 Kilted, says of sequences is refused by Cyclone.
"""
OFTEN = """<CycloneDDS><Domain><Discovery>
<SPDPInterval>3s</SPDPInterval>
</Discovery></Domain></CycloneDDS>"""
"""The configuration that announces participants every 3 s, as Fast DDS does: one that stopped for
longer than its lease of 10 s is forgotten, and would be found again after up to 30 s.
"""
SHARED = threading.Lock()
"""Held while a domain is joined, or a topic made, which completes its type: all transports share
both."""


@dataclass(eq=False)
class _Listening:
    """A reader, and what takes its messages."""

    reader: "DataReader[Any]"
    condition: "ReadCondition"
    take: Take
    topic: "Topic[Any]" = field(repr=False)


@final
class DdsTransport(Transport):
    """A participant of DDS that speaks as ROS 2 does.

    Interfaces and peers are those of `CYCLONEDDS_URI`; `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`
    keeps to this machine.

    Args:
        domain: number of the domain; None: `ROS_DOMAIN_ID`, or 0.

    Raises:
        DependencyError: cyclonedds is not installed.
        ConfigurationError: there is no such domain, or no network interface for it.
    """

    def __init__(self, domain: int | None = None) -> None:
        super().__init__()
        try:
            from cyclonedds.builtin import (
                BuiltinDataReader,
                BuiltinTopicDcpsParticipant,
                BuiltinTopicDcpsPublication,
                BuiltinTopicDcpsSubscription,
            )
            from cyclonedds.core import DDSException, GuardCondition, WaitSet
            from cyclonedds.domain import DomainParticipant
        except ImportError:
            raise missing_extra("cyclonedds", "ros2") from None
        number = domain_number(domain)
        try:
            with SHARED:
                _domain(number)
            self._participant: DomainParticipant = DomainParticipant(number)
        except DDSException as error:
            raise ConfigurationError(
                f"DDS can't join domain {number}: {error}; interfaces and peers are those of "
                "CYCLONEDDS_URI, and `contactfusion doctor --live` shows what there is"
            ) from None
        self._guid = str(self._participant.guid)
        self._found = [
            (writes, BuiltinDataReader(self._participant, of))
            for writes, of in (
                (True, BuiltinTopicDcpsPublication),
                (False, BuiltinTopicDcpsSubscription),
            )
        ]
        self._peers = BuiltinDataReader(self._participant, BuiltinTopicDcpsParticipant)
        self._looking = threading.Lock()
        self._known: dict[str, End] = {}
        self._names: dict[str, str] = {}
        self._listening: dict[str, _Listening] = {}
        self._topics: dict[tuple[str, str], Topic[Any]] = {}
        self._lock = threading.Lock()
        self._waiting = WaitSet(self._participant)
        self._wake = GuardCondition(self._participant)
        self._waiting.attach(self._wake)  # without any condition, it would not wait at all
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, name="DDS", daemon=True)
        self._thread.start()

    def ends(self) -> Sequence[End]:
        """All readers and writers of topics of ROS that are alive."""
        with self._looking:  # what has changed alone is read: cyclonedds leaks a bit of each
            for sample in self._peers.take(MOST):
                if _is_alive(sample):
                    self._names[str(sample.key)] = _peer(sample)
                else:
                    self._names.pop(str(sample.key), None)
            for writes, reader in self._found:
                for sample in reader.take(MOST):
                    if not _is_alive(sample):
                        self._known.pop(str(sample.key), None)
                    elif sample.topic_name.startswith(f"{PREFIX}/"):
                        ours = str(sample.participant_key) == self._guid
                        self._known[str(sample.key)] = _end(sample, writes, ours=ours)
            return [
                end._replace(peer=self._names.get(end.peer, end.peer))
                for end in self._known.values()
            ]

    def listen(self, topic: str, msgtype: str, quality: Quality, take: Take) -> None:
        """Receive the messages of a topic from now on, in the thread of the reader."""
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader

        qos = _quality_of_service(msgtype, quality, DEPTH)
        of = self._topic(topic, msgtype)
        reader = DataReader(self._participant, of, qos=qos)
        anything = SampleState.NotRead | ViewState.Any | InstanceState.Any
        condition = ReadCondition(reader, anything)
        with self._lock:
            self._listening[topic] = _Listening(reader, condition, take, of)
            self._waiting.attach(condition)

    def ignore(self, topic: str) -> None:
        """Delete the reader of a topic."""
        with self._lock:
            if found := self._listening.pop(topic, None):
                self._waiting.detach(found.condition)
                found.reader.__del__()  # also where the thread still holds it

    def advertise(self, topic: str, msgtype: str, latched: bool = False) -> Send:
        """A writer of a topic."""
        from cyclonedds._clayer import ddspy_write
        from cyclonedds.pub import DataWriter

        qos = _quality_of_service(msgtype, Quality(True, latched), RESULTS)
        writer = DataWriter(self._participant, self._topic(topic, msgtype), qos=qos)

        def send(cdr: bytes | memoryview) -> None:
            """Send a message, unless no reader makes room for it, or it is malformed."""
            whole = bytes(cdr)
            if ddspy_write(writer._ref, whole.ljust((len(whole) + 3) & ~3, b"\0")) < 0:
                self.unsent[topic] += 1

        return send

    def close(self) -> None:
        """Leave the domain, and end the thread."""
        self._ended.set()
        self._wake.set(True)
        self._thread.join(5.0)
        self._participant.__del__()  # with all that is in it, also what others hold
        self._listening.clear()
        self._topics.clear()
        self._found.clear()

    def _topic(self, topic: str, msgtype: str) -> "Topic[Any]":
        from cyclonedds.topic import Topic as DdsTopic

        key = topic, msgtype
        with SHARED:
            if key not in self._topics:
                self._topics[key] = DdsTopic(self._participant, PREFIX + topic, dds_type(msgtype))
            return self._topics[key]

    def _read(self) -> None:
        """Pass on what comes, until the transport is closed."""
        from cyclonedds._clayer import ddspy_take
        from cyclonedds.core import InstanceState, SampleState, ViewState

        anything = SampleState.Any | ViewState.Any | InstanceState.Any
        patience = int(PATIENCE * NANOSECONDS_PER_SECOND)
        while not self._ended.is_set():
            self._waiting.wait(patience)
            with self._lock:
                listening = [*self._listening.values()]
            for each in listening:
                taken: Any = AT_ONCE * [None]
                while not isinstance(taken, int) and len(taken) == AT_ONCE:
                    taken = ddspy_take(each.reader._ref, anything, AT_ONCE)
                    arrived = machine_time()
                    for cdr, info in () if isinstance(taken, int) else taken:
                        if info.valid_data:
                            each.take(cdr, arrived)


@cache
def _domain(number: int) -> "Domain | None":
    """The domain with its settings, as long as this process lasts: with it all who joined leave.

    None: others in this process have joined it, and its settings hold.
    """
    from cyclonedds.core import DDSException
    from cyclonedds.domain import Domain

    local = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() == "LOCALHOST"
    network = LOOPBACK if local else os.environ.get("CYCLONEDDS_URI", "")
    try:
        return Domain(number, ",".join(filter(None, (OFTEN, network, BY_NAME))))
    except DDSException:
        return None


def _is_alive(sample: Any) -> bool:
    from cyclonedds.core import InstanceState

    return bool(sample.sample_info.instance_state & InstanceState.Alive)


def _peer(sample: Any) -> str:
    """The process of a participant and its machine, as Cyclone and Fast DDS name them; its key."""
    from cyclonedds.qos import Policy

    known = {each.key: each.value for each in sample.qos if isinstance(each, Policy.Property)}
    host = known.get("__Hostname") or known.get("fastdds.physical_data.host", "").partition(":")[0]
    process = known.get("__Pid") or known.get("fastdds.physical_data.process")
    return f"process {process} on {host}" if host and process else str(sample.key)


def _end(sample: Any, writes: bool, *, ours: bool) -> End:
    from cyclonedds.qos import Policy

    qos = sample.qos
    deadline = qos[Policy.Deadline] if Policy.Deadline in qos else None
    seconds = deadline and deadline.deadline / NANOSECONDS_PER_SECOND
    endless = seconds is None or seconds > 1e9
    latched = Policy.Durability.Volatile not in qos
    data = qos[Policy.Userdata].data.decode(errors="replace") if Policy.Userdata in qos else ""
    hashed = data.partition(HASH)[2].partition(";")[0]
    reliable = isinstance(qos[Policy.Reliability], Policy.Reliability.Reliable)
    return End(
        str(sample.topic_name).removeprefix(PREFIX),
        str(sample.type_name).replace(MIDDLE, "::").removesuffix("_").replace("::", "/"),
        writes,
        Quality(reliable, latched, None if endless else seconds),
        hashed,
        str(sample.participant_key),
        ours,
    )


def _quality_of_service(msgtype: str, quality: Quality, depth: int) -> "Qos":
    from cyclonedds.qos import Policy, Qos

    blocking = int(BLOCKING * NANOSECONDS_PER_SECOND)
    hashed = f"{HASH}{type_hash(msgtype, defined(msgtype))};"
    return Qos(
        Policy.Reliability.Reliable(blocking)
        if quality.reliable
        else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if quality.latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DurabilityService(0, Policy.History.KeepLast(depth), -1, -1, -1),  # for late readers
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.Userdata(hashed.encode()),
    )


@cache
def dds_type(msgtype: str) -> Any:
    """The type of DDS for a type of ROS 2; its instances are never made.

    What is sent and received are bytes; the members are there for peers that compare types.

    Args:
        msgtype: as ROS 2 calls it.
    """
    from cyclonedds.idl import IdlStruct

    defined(msgtype)  # refuses what is not known
    package, _, name = msgtype.rpartition("/")
    fields = typestore().fielddefs[msgtype][1]
    members = {member: _member(kind) for member, kind in fields}
    body = {
        "__annotations__": members,
        "__idl_typename__": f"{package.replace('/', '::')}{MIDDLE}{name}_",
        "__idl_annotations__": {},
        "__idl_field_annotations__": {},
    }
    made: Any = type(IdlStruct)
    return dataclass(made(name, (IdlStruct,), body))


def _member(kind: Any) -> Any:
    """The type of a member in the terms of cyclonedds."""
    import cyclonedds.idl.types
    from rosbags.interfaces import Nodetype

    types: Any = cyclonedds.idl.types
    node, of = kind
    match node:
        case Nodetype.NAME:
            return dds_type(of)
        case Nodetype.ARRAY:
            return types.array[_member(of[0]), of[1]]
        case Nodetype.SEQUENCE:
            inner = _member(of[0])
            return types.sequence[inner, of[1]] if of[1] else types.sequence[inner]
    base, limit = of
    if base in ("string", "wstring"):
        return types.bounded_str[limit] if limit else str
    return {"bool": bool, "octet": types.byte}.get(base) or getattr(types, base)
