"""The poses of object and hand at the start of a grasp."""

import itertools

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.frames import Pose, pose_of
from contactfusion.robots.model import RobotModel
from contactfusion_lab.scenes.approach import led_by, solved, tries
from contactfusion_lab.scenes.grasp.config import GraspConfig

SEARCHES = 20
"""Initial guesses of inverse kinematics at most."""


def placed(config: GraspConfig, azimuth: float, rng: np.random.Generator) -> Pose:
    """The true pose of the object, random: lateral of the hand's path, and turned.

    Args:
        config: the grasp.
        azimuth: direction from the object to the hand [rad].
        rng: draws offset and yaw.

    Returns:
        In the root link's frame.
    """
    pose = config.object.pose.pose()
    lateral, yaw = rng.uniform(*config.offset), rng.uniform(*config.yaw)
    pose[:3, :3] = Rotation.from_euler("z", yaw, degrees=True).as_matrix() @ pose[:3, :3]
    pose[:3, 3] += lateral * np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    return pose


def facing(config: GraspConfig, azimuth: float) -> Pose:
    """The pose of the tool at the start: level, its z towards where the object should be.

    Its x points to the left as it goes, its y up.

    Args:
        config: the grasp.
        azimuth: direction from the object to the hand [rad].

    Returns:
        In the root link's frame.
    """
    out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    left, up = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0]), np.array([0.0, 0.0, 1.0])
    rotation = np.stack([left, up, -out], axis=1)
    position = config.object.pose.pose()[:3, 3] + config.distance * out + config.height * up
    return pose_of(position, rotation)


def starting(
    config: GraspConfig, model: RobotModel, tool: Pose, rng: np.random.Generator
) -> FloatArray:
    """Joint positions with the tool in a pose, shape (n,) [rad, m].

    Args:
        config: the grasp.
        model: the robot.
        tool: the pose, in the root link's frame.
        rng: draws initial guesses.

    Raises:
        RobotError: the arm does not reach it.
    """
    names = model.joint_names
    posture = np.array(
        [config.posture.get(name, model.config.still.get(name, 0.0)) for name in names]
    )
    for name, (opened, closed) in config.gripper.items():
        posture[names.index(name)] = opened + config.begin * (closed - opened)
    for name, position in config.stuck.items():
        posture[names.index(name)] = position
    moving = led_by(model, config.tool)
    for start in itertools.islice(tries(model, posture, moving, rng), SEARCHES):
        found = solved(model, config.tool, tool, start, moving)
        if found is not None:
            return found
    x, y, z = tool[:3, 3]
    raise RobotError(
        f"the arm does not reach where the grasp begins, ({x:.2f}, {y:.2f}, {z:.2f}) m: the object "
        "stands out of its reach"
    )


def check_names(config: GraspConfig, model: RobotModel) -> None:
    """Check that the robot has what the scene names, and that poses are in its root link.

    Raises:
        RobotError: the robot lacks the tool.
        ConfigurationError: it lacks a joint, one of the gripper moves the tool, one would stand
            beyond its limits, or an object is placed in another frame.
    """
    model.urdf.require_link(config.tool)
    for field in ("gripper", "posture"):
        for name in getattr(config, field):
            if name not in model.joint_names:
                hint = name_hint(name, model.joint_names, "joints")
                raise ConfigurationError(f"unknown joint '{name}': {hint}", f"{field}.{name}")
    _check_joints(config, model)
    placing = {"object": config.object}
    placing |= {f"surroundings.{name}": fixed for name, fixed in config.surroundings.items()}
    for path, located in placing.items():
        if located.pose.parent != model.root:
            raise ConfigurationError(
                f"the scene is placed in the robot's root link '{model.root}', "
                f"not in '{located.pose.parent}'",
                f"{path}.pose.parent",
            )


def _check_joints(config: GraspConfig, model: RobotModel) -> None:
    """Check that joint positions are within limits, and that no finger moves the tool."""
    rows = {name: row for row, name in enumerate(model.joint_names)}
    leading = led_by(model, config.tool)
    for name in config.gripper:
        if leading[rows[name]] > 0.0:
            raise ConfigurationError(
                f"it leads the tool '{config.tool}', so it is no joint of fingers",
                f"gripper.{name}",
            )
    given = [("gripper", name, end) for name, ends in config.gripper.items() for end in ends]
    given += [("posture", *joint) for joint in config.posture.items()]
    given += [("stuck", *joint) for joint in config.stuck.items()]
    for field, name, position in given:
        low, high = model.limits[rows[name]]
        if not low <= position <= high:
            raise ConfigurationError(
                f"{position:g} is beyond the limits of the joint, {low:g} and {high:g}",
                f"{field}.{name}",
            )
