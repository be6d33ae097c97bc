"""A recording of an arm that presses a tool on something, as a robot's recorder writes it."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from contactfusion.readings.messages import message
from tests.ros_bags import SECOND, Said, joints, top, transforms, vector
from tests.urdfs import joint, link, written

BIAS = 3.0
"""What the force sensor reads along z before anything touches [N]."""
TOUCH = 1.0
"""Something touches from then on [s]."""


def arm(folder: Path) -> Path:
    """Write the URDF of an arm of one joint, with a force sensor between arm and tool."""
    return written(
        folder,
        link("base", '<box size="0.2 0.2 0.1"/>', 5.0),
        link("arm", '<cylinder radius="0.04" length="0.4"/>', 2.0, at="0 0 0.2"),
        link("ft"),
        link("tool", '<sphere radius="0.03"/>', 0.2),
        joint("turn", "base", "arm", xyz="0 0 0.05"),
        joint("wrist", "arm", "ft", "fixed", "", xyz="0 0 0.4"),
        joint("flange", "ft", "tool", "fixed", "", xyz="0 0 0.05"),
    )


def pressed(seconds: float = 2.0, placed: bool = True) -> Sequence[Said]:
    """Give joint states, wrenches of a push on the tool along -x, clouds, and where sensors are.

    Args:
        seconds: how long.
        placed: whether /tf_static says where the force sensor is.
    """
    return sorted(_said(seconds, placed), key=lambda said: said[1])


def _said(seconds: float, placed: bool) -> Iterator[Said]:
    static = [(0, "base", "eye")]
    if placed:
        static.append((0, "base", "ft"))
    yield "/tf_static", 0, transforms(*static)
    for number in range(int(100 * seconds)):
        stamp = number * SECOND // 100
        yield "/ft/wrench", stamp + 2_000_000, _wrench(stamp)
        if number % 2 == 0:
            yield "/joint_states", stamp, joints(stamp, name=["turn"], position=np.array([0.1]))
        if number % 10 == 0:
            yield "/eye/points", stamp, cloud(stamp)
            yield "/imu", stamp, message("sensor_msgs/Imu", header=top(stamp, "imu"), **_imu())


def _wrench(stamp: int) -> object:
    """A push of 10 N on the side of the tool, 5 cm above the sensor's origin, after `TOUCH`."""
    force = np.array([-10.0 if stamp >= TOUCH * SECOND else 0.0, 0.0, BIAS])
    torque = np.cross([0.03, 0.0, 0.05], [force[0], 0.0, 0.0])
    both = message("geometry_msgs/Wrench", force=vector(*force), torque=vector(*torque))
    return message("geometry_msgs/WrenchStamped", header=top(stamp, "ft"), wrench=both)


def cloud(stamp: int) -> object:
    """A PointCloud2 of a patch of 400 points in front of the eye."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 20), np.linspace(-0.1, 0.1, 20))
    points = np.stack([x.ravel(), y.ravel(), np.full(400, 0.5)], axis=1).astype(np.float32)
    fields = [
        message("sensor_msgs/PointField", name=name, offset=4 * place, datatype=7, count=1)
        for place, name in enumerate("xyz")
    ]
    return message(
        "sensor_msgs/PointCloud2",
        header=top(stamp, "eye"),
        height=1,
        width=400,
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=4800,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )


def _imu() -> dict[str, object]:
    none = np.zeros(9)
    return {
        "orientation": message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        "orientation_covariance": none,
        "angular_velocity": vector(0.0, 0.0, 0.0),
        "angular_velocity_covariance": none,
        "linear_acceleration": vector(0.0, 0.0, 9.81),
        "linear_acceleration_covariance": none,
    }
