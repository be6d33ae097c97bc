"""The arm of the package in one posture, and the torques of its joints when it is pushed."""

from functools import cache
from typing import Any

import numpy as np

from contactfusion import Grid, State
from contactfusion.arrays import FloatArray
from contactfusion.frames import FrameTree
from contactfusion.readings import JointState
from contactfusion.robots.description import EffortConfig, RobotConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.posed import PosedRobot

ARM = tuple(f"arm_{number}" for number in range(1, 8))
STILL = {f"finger_{n}_{part}": 0.0 for n in (1, 2) for part in (
    "spread", "proximal_joint", "distal_joint")} | {
    "finger_3_proximal_joint": 0.0, "finger_3_distal_joint": 0.0}  # fmt: skip
BENT = np.array([0.3, 0.5, -0.2, 1.2, 0.4, 0.9, -0.3])
SIGMA = 0.05


@cache
def robot() -> RobotModel:
    return shared_robot(
        RobotConfig(urdf="contactfusion.robots:arm_hand.urdf", still=STILL, spacing=0.01)
    )


def whole(arm: FloatArray) -> FloatArray:
    """The positions of all joints, the fingers' 0."""
    return np.array([*arm, *np.zeros(len(robot().joint_names) - len(ARM))])


def state(arm: FloatArray = BENT, base: FloatArray | None = None) -> State:
    """Of the arm in a posture, its base at a pose in the world."""
    pose = np.eye(4) if base is None else base
    posed = PosedRobot(robot(), whole(arm), "world", pose)
    return State(
        now=0.0, grid=Grid("world", 0.005), frames=FrameTree({}), surface=posed.surface, robot=posed
    )


def known(**fields: float) -> dict[str, EffortConfig]:
    """What is known of the joints of the arm."""
    return {name: EffortConfig(**{"noise": SIGMA, **fields}) for name in ARM}


def reading(
    efforts: FloatArray | None, arm: FloatArray = BENT, stamp: float = 0.0, **fields: Any
) -> JointState:
    """Of the joints of the arm."""
    return JointState(
        stamp=stamp, frame="base", names=ARM, positions=arm, efforts=efforts, **fields
    )


def pushed(link: str, newtons: float, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A random point of a link [m], the force that pushes it [N], and the torques of all joints."""
    rng, surface = np.random.default_rng(seed), state().placed_surface("test")
    own = np.flatnonzero(surface.links == surface.link_names.index(link))
    row = int(rng.choice(own[robot().exposed[link]]))
    force = -newtons * surface.normals[row]
    linear, angular = Dynamics(robot()).axes(whole(BENT))
    arms = linear + np.cross(angular, surface.points[row])
    loads = Dynamics(robot()).supports[robot().link_names.index(link)]
    torques = np.where(loads, arms @ force, 0.0)[: len(ARM)]
    return surface.points[row], force, torques + SIGMA * rng.standard_normal(len(ARM))
