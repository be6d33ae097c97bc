"""Results of a step of the pipeline as ROS 2 messages: contacts, their picture, the command."""

import math
from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from contactfusion.contacts import Contact
from contactfusion.controller import Command
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.kernels import REGULAR
from contactfusion.integrator.store import unpack
from contactfusion.integrator.tracks import ContactEvent
from contactfusion.pipeline import Step
from contactfusion.readings.messages import (
    Message,
    Posting,
    header,
    message,
    numbers,
    point,
    pose,
    ros_time,
    twist,
    vector,
)
from contactfusion.readings.point_cloud import FLOAT32
from contactfusion.recordings.messages import recorded_stamp

OURS = "/contactfusion/"
"""The prefix of topics that this project writes, and no sensor."""
SMALLEST = 0.02
"""The smallest diameter of a visible sphere beside a robot [m]."""
TEXT_HEIGHT = 0.03
"""Height of labels [m]."""
ADD, DELETE_ALL, SPHERE, TEXT = 0, 3, 2, 9
"""Constants of visualization_msgs/Marker."""
UINT8 = 2
"""The number of an unsigned byte in sensor_msgs/PointField."""
VOXEL = np.dtype([("place", "<f4", 3), ("likelihood", "<f4"), ("verdict", "u1"), ("", "V3")])
"""A voxel in a cloud, four bytes for each field."""
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def step_messages(step: Step, epoch_ns: int, pictures: bool = True) -> Iterator[Posting]:
    """The messages of a step, each with its topic.

    Args:
        step: the step.
        epoch_ns: the origin of stamps [ns].
        pictures: whether to draw the contacts and the voxels.

    Raises:
        RecordingError: a stamp lies where ROS has none.
    """
    stamp = recorded_stamp(step.stamp, epoch_ns)
    top = header(stamp, step.fusion.field.entries.grid.frame)
    yield contact_message(step.fusion.contacts, top, epoch_ns, OURS)
    if step.fusion.changes:
        yield f"{OURS}events", _events(step.fusion.changes, top, epoch_ns)
    if pictures:
        yield marker_message(step.fusion.contacts, top, OURS)
        yield f"{OURS}contacts/voxels", voxel_cloud(step.fusion, top)
    if step.command is not None:
        yield from _command(step.command, stamp)


def contact_message(
    contacts: tuple[Contact, ...], top: Message, epoch_ns: int, below: str
) -> Posting:
    """Contacts as a list, with its topic.

    Args:
        contacts: all of one instant.
        top: the header: that instant, and the frame of the contacts.
        epoch_ns: the origin of their own stamps [ns].
        below: the prefix of the topic, from slash to slash.

    Raises:
        RecordingError: a stamp lies where ROS has none.
    """
    listed = [_contact(contact, epoch_ns) for contact in contacts]
    return f"{below}contacts", message(
        "contactfusion_msgs/ContactArray", header=top, contacts=listed
    )


def marker_message(contacts: tuple[Contact, ...], top: Message, below: str) -> Posting:
    """Contacts as a picture, with its topic; earlier drawings are deleted."""
    markers = list(_markers(contacts, top))
    return f"{below}contacts/markers", message("visualization_msgs/MarkerArray", markers=markers)


def is_drawn(fusion: Fusion) -> NDArray[np.bool_]:
    """Which voxels a cloud of them holds: those with evidence, nulled or not."""
    drawn: NDArray[np.bool_] = (fusion.field.entries.bits & REGULAR) > 0
    return drawn


def voxel_cloud(fusion: Fusion | None, top: Message) -> Message:
    """Sensor_msgs/PointCloud2 of all voxels with evidence, for viewers.

    What is only predicted, or only ruled out, is left out: the robot's motion and a healthy skin
    cover all of it at each step. The fields are x, y, z [m] and `likelihood` as float32, and
    `verdict` as uint8: 1 below the threshold, 2 contact, 3 nulled.

    Args:
        fusion: of one step; None: there are no voxels.
        top: the header, in the frame of the space.
    """
    points = np.zeros(0, VOXEL) if fusion is None else _voxels(fusion)
    names = [*"xyz", "likelihood", "verdict"]
    kinds = [*[FLOAT32] * 4, UINT8]
    fields = [
        message("sensor_msgs/PointField", name=name, offset=4 * i, datatype=kind, count=1)
        for i, (name, kind) in enumerate(zip(names, kinds, strict=True))
    ]
    return message(
        "sensor_msgs/PointCloud2",
        header=top,
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=VOXEL.itemsize,
        row_step=points.nbytes,
        data=points.view(np.uint8),
        is_dense=True,
    )


def _voxels(fusion: Fusion) -> NDArray[np.void]:
    entries, rows = fusion.field.entries, np.flatnonzero(is_drawn(fusion))
    points = np.zeros(len(rows), VOXEL)
    points["place"] = entries.grid.centres(unpack(entries.keys[rows]))
    points["likelihood"] = fusion.field.likelihoods[rows]
    points["verdict"] = fusion.verdict_codes[rows]
    return points


def _contact(contact: Contact, epoch_ns: int) -> Message:
    return message(
        "contactfusion_msgs/Contact",
        stamp=ros_time(recorded_stamp(contact.stamp, epoch_ns)),
        position=point(contact.position),
        likelihood=float(contact.likelihood),
        dispersion=float(contact.dispersion),
        covariance=contact.covariance.ravel(),
        extent=[point(end) for end in contact.extent],
        force=vector(contact.force),
        voxels=int(contact.voxels),
        track=contact.track,
        since=ros_time(recorded_stamp(contact.since, epoch_ns) if contact.track else 0),
        sources=list(contact.shares),
        shares=numbers(contact.shares.values()),
    )


def _events(changes: Sequence[ContactEvent], top: Message, epoch_ns: int) -> Message:
    events = [
        message(
            "contactfusion_msgs/ContactEvent",
            change=str(event.change),
            contact=_contact(event.contact, epoch_ns),
        )
        for event in changes
    ]
    return message("contactfusion_msgs/ContactEvents", header=top, events=events)


def _command(command: Command, stamp: int) -> Iterator[Posting]:
    velocity = command.twist
    top = header(stamp, velocity.frame if velocity else "")
    moving = twist(velocity.linear, velocity.angular) if velocity else twist(None, None)
    joints = command.joint_velocities or {}
    report = message(
        "contactfusion_msgs/Command",
        header=top,
        twist=moving,
        gripper=math.nan if command.gripper is None else float(command.gripper),
        joint_names=list(joints),
        joint_velocities=numbers(joints.values()),
        mode=command.mode,
        reason=command.reason,
    )
    yield f"{OURS}command", report
    if velocity:
        yield f"{OURS}cmd_vel", message("geometry_msgs/TwistStamped", header=top, twist=moving)


def _markers(contacts: tuple[Contact, ...], top: Message) -> Iterator[Message]:
    """The markers of the contacts, after one that deletes all earlier."""
    yield _marker(top, action=DELETE_ALL)
    for number, contact in enumerate(contacts):
        likelihood = float(contact.likelihood)
        diameter = max(SMALLEST, 2.0 * float(contact.dispersion))
        yield _marker(
            top,
            ns="contacts",
            id=number,
            pose=pose(contact.position, UPRIGHT),
            scale=vector(np.full(3, diameter)),
            color=_colour(1.0, 1.0 - likelihood, 0.0, 0.8),
        )
        above = contact.position + np.array([0.0, 0.0, 0.5 * diameter + TEXT_HEIGHT])
        yield _marker(
            top,
            ns="likelihoods",
            id=number,
            type=TEXT,
            pose=pose(above, UPRIGHT),
            text=f"{likelihood:.2f}",
        )


def _marker(top: Message, **fields: object) -> Message:
    return message("visualization_msgs/Marker", header=top, **{**_plain_marker(), **fields})


@cache
def _plain_marker() -> dict[str, object]:
    """The fields of a white marker by default."""
    nowhen = message("builtin_interfaces/Time", sec=0, nanosec=0)
    nowhere = message("std_msgs/Header", stamp=nowhen, frame_id="")
    return {
        "ns": "",
        "id": 0,
        "type": SPHERE,
        "action": ADD,
        "pose": pose(np.zeros(3), UPRIGHT),
        "scale": vector(np.full(3, TEXT_HEIGHT)),
        "color": _colour(1.0, 1.0, 1.0, 1.0),
        "lifetime": message("builtin_interfaces/Duration", sec=0, nanosec=0),
        "frame_locked": False,
        "points": [],
        "colors": [],
        "texture_resource": "",
        "texture": message(
            "sensor_msgs/CompressedImage", header=nowhere, format="", data=np.empty(0, np.uint8)
        ),
        "uv_coordinates": [],
        "text": "",
        "mesh_resource": "",
        "mesh_file": message(
            "visualization_msgs/MeshFile", filename="", data=np.empty(0, np.uint8)
        ),
        "mesh_use_embedded_materials": False,
    }


def _colour(red: float, green: float, blue: float, alpha: float) -> Message:
    return message("std_msgs/ColorRGBA", r=red, g=green, b=blue, a=alpha)
