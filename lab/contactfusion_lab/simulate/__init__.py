"""The robot of a scene in real time: its base and its sensors as nodes of ROS 2."""

from enum import StrEnum


class Part(StrEnum):
    """A part of a robot, which is a process."""

    ALL = "all"
    """Both of them, the sensors as a process beside this one."""
    BASE = "base"
    SENSORS = "sensors"
