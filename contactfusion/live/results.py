"""What is found, for the other nodes of a robot: standard messages of ROS 2."""

import json
import time
from collections import Counter
from collections.abc import Callable
from typing import final

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.integrator.sources import Event
from contactfusion.integrator.tracks import ContactEvent
from contactfusion.live.clock import Clock
from contactfusion.live.config import LiveConfig
from contactfusion.live.transport import Send, Transport
from contactfusion.pipeline import Step
from contactfusion.readings.messages import Message, header, message, vector
from contactfusion.readings.point_cloud import cloud_message
from contactfusion.recordings.messages import recorded_stamp, typestore
from contactfusion.recordings.step_messages import OURS, is_drawn, marker_message, voxel_cloud

STRONGEST = f"{OURS}contacts/strongest"
"""The wrench of the contact with the greatest force, about the origin of its frame, when measured.
"""
CLOUD = f"{OURS}contacts/cloud"
"""A point a contact, with its probability."""
VOXELS = f"{OURS}contacts/voxels"
"""The voxels with evidence, with their likelihoods."""
MARKERS = f"{OURS}contacts/markers"
EVENTS = f"{OURS}events"
"""Contacts made, moved and broken, and all else that happens, as a line of JSON."""
DIAGNOSTICS = "/diagnostics"
TOPICS = {
    STRONGEST: "geometry_msgs/msg/WrenchStamped",
    CLOUD: "sensor_msgs/msg/PointCloud2",
    VOXELS: "sensor_msgs/msg/PointCloud2",
    MARKERS: "visualization_msgs/msg/MarkerArray",
    EVENTS: "std_msgs/msg/String",
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
}
"""The topics of results, with the types of their messages."""
AGAIN = 5.0
"""The least time between two equal events [s]."""
MOST_EVENTS = 1000
"""The most different events that are remembered."""
FIELDS = ("x", "y", "z", "probability")


@final
class Results:
    """Publishes contacts, what happens to them, and diagnostics.

    Args:
        transport: what takes the messages.
        config: how often pictures are sent.
        epoch_ns: the origin of stamps [ns since 1970].
        frame: of the contacts.
        clock: the time now [ns].
    """

    def __init__(
        self, transport: Transport, config: LiveConfig, epoch_ns: int, frame: str, clock: Clock
    ) -> None:
        self._senders: dict[str, Send] = {
            topic: transport.advertise(topic, msgtype) for topic, msgtype in TOPICS.items()
        }
        self._clock = clock
        self._epoch_ns, self._period, self._frame = epoch_ns, config.pictures, frame
        self._published: dict[Event, float] = {}
        """When each event was published last [s]."""
        self._mode = ""
        """Of the controller, as it was published last."""
        self._drawn_at = -np.inf
        self._has_drawn = self._has_voxels = True  # what an earlier process drew is deleted
        self.sent: Counter[str] = Counter()
        """Number of messages by topic."""
        self.on_event: Callable[[str, str], object] = lambda level, text: None
        """Takes the level of each event, info, warning or error, and its sentence."""

    def step(self, step: Step, is_fresh: bool = True) -> None:
        """Publish the contacts of a step, if what is believed is fresh, and what happened."""
        contacts = step.fusion.contacts if is_fresh else ()
        top = header(recorded_stamp(step.stamp, self._epoch_ns), self._frame)
        felt = [contact for contact in contacts if np.isfinite(contact.force).all()]
        if felt:
            strongest = max(felt, key=lambda contact: float(np.linalg.norm(contact.force)))
            measured = header(recorded_stamp(strongest.stamp, self._epoch_ns), self._frame)
            self._send(STRONGEST, _wrench(strongest, measured))
        for change in step.fusion.changes:
            self.event("info", f"contact {change.contact.track} {change.change}", _where(change))
        for event in step.events:
            if step.stamp - self._published.get(event, -np.inf) < AGAIN:
                continue
            if len(self._published) > MOST_EVENTS:
                self._published.clear()
            self._published[event] = step.stamp
            level = "warning" if event.kind.is_warning else "info"
            self.event(level, event.message, {"source": event.source, "kind": str(event.kind)})
        command = step.command
        if command is not None and command.mode != self._mode:
            self._mode = command.mode
            text = ": ".join(filter(None, ("controller", command.mode, command.reason)))
            self.event("info", text, {"mode": command.mode, "reason": command.reason})
        now = time.monotonic()
        if not is_fresh:
            self.none()
        elif now - self._drawn_at >= self._period:
            self._drawn_at = now
            has_voxels = bool(is_drawn(step.fusion).any())
            if contacts or self._has_drawn:
                self._draw(contacts, top)
            if has_voxels or self._has_voxels:
                self._send(VOXELS, voxel_cloud(step.fusion, top))
            self._has_drawn, self._has_voxels = bool(contacts), has_voxels

    def none(self) -> None:
        """Publish once that no contact is known, as when what is believed is not fresh."""
        top = header(self._clock(), self._frame)
        if self._has_drawn:
            self._draw((), top)
        if self._has_voxels:
            self._send(VOXELS, voxel_cloud(None, top))
        self._has_drawn = self._has_voxels = False

    def event(self, level: str, text: str, more: dict[str, object] | None = None) -> None:
        """Publish an event.

        Args:
            level: info, warning or error.
            text: a sentence.
            more: further fields.
        """
        self.on_event(level, text)
        data = json.dumps({"level": level, "text": text, **(more or {})})
        self._send(EVENTS, message("std_msgs/String", data=data))

    def diagnostics(self, states: list[tuple[str, int, str, dict[str, str]]]) -> None:
        """Publish the state of each part.

        Args:
            states: name, level (0 OK, 1 warning, 2 error, 3 stale), sentence, and values by name.
        """
        status = [
            message(
                "diagnostic_msgs/DiagnosticStatus",
                level=level,
                name=f"contactfusion: {name}",
                message=text,
                hardware_id="contactfusion",
                values=[
                    message("diagnostic_msgs/KeyValue", key=key, value=value)
                    for key, value in values.items()
                ],
            )
            for name, level, text, values in states
        ]
        top = header(self._clock(), "")
        sent = message("diagnostic_msgs/DiagnosticArray", header=top, status=status)
        self._send(DIAGNOSTICS, sent)

    def _draw(self, contacts: tuple[Contact, ...], top: Message) -> None:
        self._send(*marker_message(contacts, top, OURS))
        self._send(CLOUD, _cloud(contacts, top))

    def _send(self, topic: str, sent: Message) -> None:
        self.sent[topic] += 1
        self._senders[topic](typestore().serialize_cdr(sent, sent.__msgtype__))


def _wrench(contact: Contact, top: Message) -> Message:
    """The wrench of a contact on the robot, about the origin of the frame."""
    wrench = message(
        "geometry_msgs/Wrench",
        force=vector(contact.force),
        torque=vector(np.cross(contact.position, contact.force)),
    )
    return message("geometry_msgs/WrenchStamped", header=top, wrench=wrench)


def _cloud(contacts: tuple[Contact, ...], top: Message) -> Message:
    rows = [(*contact.position, contact.likelihood) for contact in contacts]
    return cloud_message(top, FIELDS, np.array(rows, "<f4").reshape(-1, len(FIELDS)))


def _where(change: ContactEvent) -> dict[str, object]:
    contact = change.contact
    return {
        "track": contact.track,
        "change": str(change.change),
        "position": [round(float(each), 4) for each in contact.position],
        "frame": contact.frame,
        "probability": round(float(contact.likelihood), 3),
    }
