"""Kinds of reading: one module a kind, or for some that belong together, with all that is known.

A kind is a `Codec`: the class of its readings, ROS messages, columns of a log, what faults do to
it, and how it is drawn. `registry` finds those of plug-ins.
"""

from typing import Any

from contactfusion.readings.codec import Codec
from contactfusion.readings.depth_image import DepthImage, DepthImageCodec
from contactfusion.readings.joints import (
    JointCommand,
    JointCommandCodec,
    JointState,
    JointStateCodec,
)
from contactfusion.readings.markers import Markers, MarkersCodec
from contactfusion.readings.point_cloud import PointCloud, PointCloudCodec
from contactfusion.readings.poses import (
    ObjectPose,
    ObjectPoseCodec,
    Odometry,
    OdometryCodec,
    Transform,
    TransformCodec,
)
from contactfusion.readings.reading import Reading
from contactfusion.readings.switch import Switch, SwitchCodec
from contactfusion.readings.tactile_image import TactileImage, TactileImageCodec
from contactfusion.readings.twist import Twist, TwistCodec
from contactfusion.readings.wrench import Wrench, WrenchCodec

BUILT_IN: tuple[Codec[Any], ...] = (
    WrenchCodec(),
    TactileImageCodec(),
    SwitchCodec(),
    PointCloudCodec(),
    DepthImageCodec(),
    JointStateCodec(),
    JointCommandCodec(),
    OdometryCodec(),
    TwistCodec(),
    TransformCodec(),
    ObjectPoseCodec(),
    MarkersCodec(),
)
"""The kinds of this project, in the order in which they are listed."""

__all__ = [
    "BUILT_IN",
    "DepthImage",
    "JointCommand",
    "JointState",
    "Markers",
    "ObjectPose",
    "Odometry",
    "PointCloud",
    "Reading",
    "Switch",
    "TactileImage",
    "Transform",
    "Twist",
    "Wrench",
]
