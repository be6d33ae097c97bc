"""A ball behind a wrist that slides along its axis, for tests of what a wrist feels."""

from pathlib import Path
from typing import Any

from contactfusion.robots.model import RobotModel
from tests.urdfs import built, joint

RADIUS = 0.02
"""Of the ball at the poker's end [m]."""
BALL = f'<origin xyz="0.05 0.03 0.08"/><geometry><sphere radius="{RADIUS}"/></geometry>'
WRISTS: dict[str, Any] = {
    "cell": {"frame": "cell", "sign": "on_robot"},
    "reverse": {"frame": "flange", "sign": "by_robot"},
    "whole": {"frame": "carriage", "sign": "on_robot"},
}


def heavy(name: str, mass: float, at: str, collision: str = "") -> str:
    """Write a link whose inertia stands askew."""
    turned = f'<origin xyz="{at}" rpy="0.3 0.4 0.5"/>'
    inertia = '<inertia ixx="0.01" iyy="0.02" izz="0.015" ixy="0.003" ixz="0" iyz="0"/>'
    shape = f"<collision>{collision}</collision>" if collision else ""
    inertial = f'<inertial>{turned}<mass value="{mass}"/>{inertia}</inertial>'
    return f'<link name="{name}">{inertial}{shape}</link>'


def poker(folder: Path, effort: float = 500.0, foot: str = "fixed", **fields: Any) -> RobotModel:
    """Build a ball behind a wrist, 3.5 kg in all, that slides along its z: the base's x.

    PyBullet takes what is fixed to a robot's first link for a part of the base, so the slide
    does not move the first.
    """
    limit = f'<limit lower="-1" upper="1" effort="{effort}" velocity="1"/>'
    ahead = '<origin xyz="0 0 0.5" rpy="1.5707963267948966 0 1.5707963267948966"/>'
    return built(
        folder,
        '<link name="base"/><link name="stand"/>',
        heavy("carriage", 2.0, "0.01 0 0"),
        heavy("flange", 0.5, "0.01 0.02 0.03"),
        heavy("palm", 1.0, "0.03 -0.02 0.05", BALL),
        '<link name="mark"/>',
        joint("foot", "base", "stand", foot, axis="0 1 0", inside=limit),
        f'<joint name="slide" type="prismatic"><parent link="stand"/><child link="carriage"/>'
        f'{ahead}<axis xyz="0 0 1"/>{limit}</joint>',
        '<joint name="bolt" type="fixed"><parent link="carriage"/><child link="flange"/>'
        '<origin xyz="0.02 0 0.1" rpy="0.3 0.2 0.1"/></joint>',
        joint("hand", "flange", "palm", "fixed", "", "0 0 0.02"),
        joint("paint", "palm", "mark", "fixed", ""),
        **{
            "frames": {
                "cell": {"parent": "flange", "xyz": (0.01, -0.04, 0.02), "rpy": (0.5, -0.6, 0.7)}
            },
            "wrists": WRISTS,
            **fields,
        },
    )
