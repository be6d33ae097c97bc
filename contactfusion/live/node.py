"""ROS 2 by rclpy: a plain node of the ROS that is sourced, messages as they are on the wire."""

# pyright: reportMissingImports=false

import importlib
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final
from uuid import uuid4

from contactfusion.errors import ConfigurationError, DependencyError, RecordingError
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
from contactfusion.time import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

ENDLESS = 1e9
"""A deadline from which on there is none [s]."""


@final
class NodeTransport(Transport):
    """A node of ROS 2, with the middleware, the security and the network that ROS is set up for.

    Args:
        domain: number of the domain; None: `ROS_DOMAIN_ID`, or 0.

    Raises:
        DependencyError: rclpy can't be imported.
        ConfigurationError: there is no such domain, or the middleware can't join it.
    """

    def __init__(self, domain: int | None = None) -> None:
        super().__init__()
        try:
            from rclpy.context import Context
            from rclpy.executors import SingleThreadedExecutor
            from rclpy.node import Node
        except ImportError as error:
            raise DependencyError(
                f"rclpy can't be imported ({error}): it comes with an installation of ROS 2, of "
                "whose Python this has to be, once its setup.bash is sourced; `--ros dds` needs "
                "none"
            ) from None
        number = domain_number(domain)
        self._context = Context()  # of its own: it leaves the signals to `live`
        try:
            self._context.init([], domain_id=number)
            self._node = Node(
                f"contactfusion_{uuid4().hex[:8]}",
                context=self._context,
                use_global_arguments=False,
                enable_rosout=False,
                start_parameter_services=False,
            )
        except Exception as error:  # of the middleware, by its own classes
            self._context.try_shutdown()
            reason = " ".join(str(error).split())
            raise ConfigurationError(f"ROS can't join domain {number}: {reason}") from None
        self._listening: dict[str, Subscription] = {}
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, name="rclpy", daemon=True)
        self._thread.start()

    def ends(self) -> Sequence[End]:
        """All publishers and subscriptions that ROS knows of."""
        return [
            _end(topic, info, writes, self._node.get_fully_qualified_name())
            for topic, _ in self._node.get_topic_names_and_types()
            for writes, infos in (
                (True, self._node.get_publishers_info_by_topic(topic)),
                (False, self._node.get_subscriptions_info_by_topic(topic)),
            )
            for info in infos
        ]

    def listen(self, topic: str, msgtype: str, quality: Quality, take: Take) -> None:
        """Receive the messages of a topic from now on, in the thread of the executor."""
        self._listening[topic] = self._node.create_subscription(
            _type(msgtype),
            topic,
            lambda cdr: take(cdr, machine_time()),
            _quality_of_service(quality, DEPTH),
            raw=True,
        )

    def ignore(self, topic: str) -> None:
        """Destroy the subscription of a topic."""
        if found := self._listening.pop(topic, None):
            self._node.destroy_subscription(found)

    def advertise(self, topic: str, msgtype: str, latched: bool = False) -> Send:
        """A publisher of a topic."""
        qos = _quality_of_service(Quality(True, latched), RESULTS)
        publisher = self._node.create_publisher(_type(msgtype), topic, qos)

        def send(cdr: bytes | memoryview) -> None:
            """Send a message, unless the middleware refuses it."""
            try:
                publisher.publish(bytes(cdr))
            except RuntimeError:  # as errors of rcl are
                self.unsent[topic] += 1

        return send

    def close(self) -> None:
        """Leave the domain, and end the thread."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()


def _type(msgtype: str) -> Any:
    """The class of a type in the Python of ROS; no message of it is made.

    Raises:
        RecordingError: its package is not there, or has no such type.
    """
    package, _, name = msgtype.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise RecordingError(
            f"nothing defines the type {msgtype}: the ROS package {package} is not sourced, or "
            f"lacks it ({error})"
        ) from None


def _end(topic: str, info: "TopicEndpointInfo", writes: bool, node: str) -> End:
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    qos = info.qos_profile
    deadline = qos.deadline.nanoseconds / NANOSECONDS_PER_SECOND
    quality = Quality(
        qos.reliability == ReliabilityPolicy.RELIABLE,
        qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
        deadline if 0 < deadline < ENDLESS else None,
    )
    hashed = str(info.topic_type_hash)
    peer = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
    return End(
        topic,
        info.topic_type,
        writes,
        quality,
        hashed if hashed.startswith("RIHS") else "",
        peer,
        peer == node,
    )


def _quality_of_service(quality: Quality, depth: int) -> "QoSProfile":
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE
        if quality.reliable
        else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL
        if quality.latched
        else DurabilityPolicy.VOLATILE,
    )
