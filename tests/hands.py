"""A robot whose hand is one box on a slide, for cases that can be worked out by hand."""

from pathlib import Path

import numpy as np

from contactfusion import Grid, State
from contactfusion.arrays import FloatArray
from contactfusion.frames import FrameTree
from contactfusion.readings import JointState
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot

GRID = Grid("base", 0.005)
SLIDE = """<robot name="slide">
  <link name="base"/>
  <link name="hand">
    <inertial><origin xyz="0.02 0 0"/><mass value="2"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="base"/><child link="hand"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>"""


def slide(folder: Path, **fields: object) -> RobotModel:
    """Build the robot: at 0 its hand, a cube of 0.1 m, is centred at the base's origin."""
    path = folder / "slide.urdf"
    path.write_text(SLIDE)
    return RobotModel(RobotConfig.model_validate({"urdf": str(path), **fields}))


def posed(robot: RobotModel, x: float = 0.0) -> PosedRobot:
    """Put its hand at x [m]."""
    return PosedRobot(robot, np.array([x]), "base", np.eye(4))


def state(robot: RobotModel | None, x: float = 0.0, now: float = 0.0) -> State:
    """Give what is known with the hand at x [m]."""
    there = posed(robot, x) if robot else None
    frames = FrameTree({"hand": ("base", np.array(there.poses["hand"]))} if there else {})
    surface = there.surface if there else None
    return State(now=now, grid=GRID, frames=frames, surface=surface, robot=there)


def joints(x: float, stamp: float = 0.0, velocity: float | None = None) -> JointState:
    """Read the slide."""
    speed: FloatArray | None = None if velocity is None else np.array([velocity])
    return JointState(
        stamp=stamp, frame="base", names=("slide",), positions=np.array([x]), velocities=speed
    )
