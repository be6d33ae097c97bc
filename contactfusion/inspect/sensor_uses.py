"""The generator that each sensor of a recording feeds, as lines of a first configuration."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import compress
from typing import final

import numpy as np

from contactfusion.inspect.first_lines import (
    REST,
    force_torque_lines,
    free_space_lines,
    joint_torque_lines,
    motion_lines,
    range_lines,
    switch_lines,
    tactile_lines,
)
from contactfusion.inspect.inspection import Inspection, TopicInspection
from contactfusion.readings import (
    DepthImage,
    JointState,
    PointCloud,
    Reading,
    Switch,
    TactileImage,
    Wrench,
)
from contactfusion.robots.model import RobotModel
from contactfusion.vendors import convention_of

LONGEST_NAME = 200
"""Names of generators are cut: YAML takes keys of up to 1,024 characters."""
LOOK = 5.0
"""The part of a recording that is read, from its start [s]."""


@final
@dataclass(frozen=True)
class Use:
    """The use of a sensor of a recording.

    Attributes:
        sensor: its name.
        lines: the generator, as lines of YAML.
        left_out: why the generator is only a comment; empty where it is active.
    """

    sensor: str
    lines: tuple[str, ...]
    left_out: str = ""


@final
@dataclass
class Start:
    """The first seconds of a recording."""

    joints: set[str] = field(default_factory=set)
    """The names of all joints that report positions."""
    wrenches: dict[str, list[Wrench]] = field(default_factory=dict)
    """By sensor, those of its first `REST` seconds."""
    efforts: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """By sensor, the joints that report efforts that are not 0."""
    channels: dict[str, int] = field(default_factory=dict)
    """By tactile sensor, the number of its values."""


def start_of(readings: Iterable[Reading]) -> Start:
    """The first seconds of a recording; readings in the order of their stamps."""
    start, begin = Start(), None
    for reading in readings:
        begin = reading.stamp if begin is None else begin
        if reading.stamp > begin + LOOK:
            break
        match reading:
            case JointState():
                start.joints.update(reading.names)
                efforts = np.zeros(0) if reading.efforts is None else reading.efforts
                if reporting := tuple(compress(reading.names, np.nan_to_num(efforts) != 0.0)):
                    start.efforts[reading.sensor] = reporting
            case TactileImage():
                start.channels[reading.sensor] = len(reading.values)
            case Wrench():
                wrenches = start.wrenches.setdefault(reading.sensor, [])
                if not wrenches or reading.stamp <= wrenches[0].stamp + REST:
                    wrenches.append(reading)
            case _:
                pass
    return start


def uses_of(
    inspection: Inspection, start: Start, model: RobotModel | None, space: str
) -> Iterator[Use]:
    """The use of each sensor, in the order of the topics.

    Args:
        inspection: of the recording.
        start: its first seconds.
        model: the robot, or None.
        space: the frame of the contacts.
    """
    without_robot = "" if model else "it needs the robot: name its URDF by --robot"
    felt, moving = "", False
    for topic in inspection.topics:
        sensor, name = topic.sensor, generator_name(topic.sensor)
        lost = _lost(topic, inspection, model, space)
        if topic.reading == Wrench.__name__:
            if felt and model is None and not lost:
                lost = f"the `surface` hangs on {felt} alone"
            felt = felt or ("" if lost else sensor)
            vendor = convention_of("force_torque", topic.name)
            first = start.wrenches.get(sensor)
            lines = force_torque_lines(name, sensor, first, vendor, model)
            yield Use(sensor, tuple(lines), lost)
        elif topic.reading == PointCloud.__name__:
            yield Use(sensor, tuple(range_lines(name, sensor, "")), without_robot or lost)
        elif topic.reading == TactileImage.__name__:
            lines = tactile_lines(name, sensor, start.channels.get(sensor, 1))
            yield Use(sensor, tuple(lines), "say where its taxels are, under `patch`")
        elif topic.reading == Switch.__name__:
            yield Use(sensor, tuple(switch_lines(name, sensor, "")), without_robot or lost)
        elif topic.reading == DepthImage.__name__:
            why = "it forbids contacts: make sure of the camera's place before"
            lines = free_space_lines(name, sensor, "")
            yield Use(sensor, tuple(lines), without_robot or lost or why)
        elif topic.reading == JointState.__name__ and model:
            if not moving:
                moving = True
                yield Use(sensor, tuple(motion_lines(name, sensor)))
            vendor = convention_of("joint_torque", topic.name)
            reported = start.efforts.get(sensor, start.joints if vendor else ())
            if joints := [joint for joint in model.joint_names if joint in reported]:
                lines = joint_torque_lines(name, sensor, vendor, joints)
                what = "" if vendor else "what its efforts are, by `effort`, and "
                why = f"say {what}how noisy they are, under `joints` or by `contactfusion identify`"
                yield Use(sensor, tuple(lines), why)


def generator_name(sensor: str) -> str:
    """The name of the generator that a sensor feeds."""
    return sensor.replace("/", "_")[:LONGEST_NAME]


def _lost(
    topic: TopicInspection, inspection: Inspection, model: RobotModel | None, space: str
) -> str:
    """Why the frame of a sensor is not joined to that of the space; empty where it is."""
    frame = topic.frames[0] if topic.frames else ""
    if not frame:
        return "its headers name no frame"
    chain = inspection.ancestors(frame)
    joined = chain[-1] == inspection.ancestors(space)[-1]
    if joined or (model and not model.urdf.links.keys().isdisjoint(chain)):
        return ""
    return f"no transform joins its frame '{frame}' to '{space}': say under `frames` where it is"
