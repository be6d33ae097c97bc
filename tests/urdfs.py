"""Robots for tests: small URDFs written by hand, and the real ones, each built once."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.shapes import ShapeConfig

ARM_HAND = "contactfusion.robots:arm_hand.urdf"
PANDA = "pybullet_data:franka_panda/panda.urdf"
KUKA = "pybullet_data:kuka_iiwa/model.urdf"
REAL = (ARM_HAND, PANDA, KUKA)
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LIMIT = '<limit lower="-1" upper="2" effort="1" velocity="1"/>'


@cache
def real(urdf: str) -> RobotModel:
    """Build one of the real robots, once in all tests."""
    return RobotModel(RobotConfig(urdf=urdf))


def link(name: str, geometry: str = "", mass: float = 0.0, at: str = "0 0 0") -> str:
    """Write a link with one shape, whose mass is centred where the shape is."""
    inertial = f'<inertial><origin xyz="{at}"/><mass value="{mass}"/>{INERTIA}</inertial>'
    collision = f'<collision><origin xyz="{at}"/><geometry>{geometry}</geometry></collision>'
    return f'<link name="{name}">{inertial if mass else ""}{collision if geometry else ""}</link>'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    inside: str = LIMIT,
    xyz: str = "0 0 0",
    axis: str = "0 0 1",
) -> str:
    """Write a joint."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{inside}</joint>'
    )


def written(folder: Path, *elements: str) -> Path:
    """Write a URDF of these elements."""
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="robot">{"".join(elements)}</robot>')
    return path


def built(folder: Path, *elements: str, **fields: Any) -> RobotModel:
    """Build the robot of these elements, with further fields of its description."""
    return RobotModel(RobotConfig(urdf=str(written(folder, *elements)), **fields))


def random_joints(model: RobotModel, seed: int = 0) -> FloatArray:
    """Give joints within their limits, shape (n,) [rad, m]."""
    low, high = np.where(np.isfinite(model.limits), model.limits, np.pi * np.array([-1, 1])).T
    positions: FloatArray = np.random.default_rng(seed).uniform(low, high)
    return positions


def outside_of(shape: ShapeConfig, points: FloatArray) -> FloatArray:
    """Give signed distances to a primitive, shape (n,) [m]: exact ones, negative inside."""
    pose = shape.pose()
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    x, y, z = local.T
    match shape.shape:
        case "sphere":
            return np.asarray(np.linalg.norm(local, axis=1) - (shape.radius or 0.0))
        case "cylinder":
            over = np.stack(
                [np.hypot(x, y) - (shape.radius or 0.0), np.abs(z) - (shape.length or 0.0) / 2]
            ).T
        case _:
            over = np.abs(local) - np.array(shape.size) / 2.0
    beyond = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    return np.asarray(beyond + np.minimum(over.max(axis=1), 0.0))


def outside_of_all(shapes: Any, points: FloatArray) -> FloatArray:
    """Give distances to the union of primitives [m]: exact ones outside, negative inside."""
    return np.asarray(np.min([outside_of(shape, points) for shape in shapes], axis=0))
