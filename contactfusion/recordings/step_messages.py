"""Results of a step of the pipeline as ROS 2 messages: contacts, their picture, the command."""

import math
from collections.abc import Iterator
from functools import cache

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.controller import Command
from contactfusion.pipeline import Step
from contactfusion.recordings.messages import (
    Message,
    Posting,
    header,
    message,
    numbers,
    point,
    pose,
    recorded_stamp,
    ros_time,
    twist,
    vector,
)
from contactfusion.recordings.range_messages import voxel_cloud

OURS = "/contactfusion/"
"""The prefix of topics that this project writes, and no sensor."""
SMALLEST = 0.02
"""The smallest diameter of a visible sphere beside a robot [m]."""
TEXT_HEIGHT = 0.03
"""Height of labels [m]."""
ADD, DELETE_ALL, SPHERE, TEXT = 0, 3, 2, 9
"""Constants of visualization_msgs/Marker."""
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
        sources=list(contact.shares),
        shares=numbers(contact.shares.values()),
    )


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
