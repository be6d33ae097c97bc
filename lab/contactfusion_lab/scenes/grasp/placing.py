"""Where object and hand of a grasp begin."""

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
"""So many searches for joint positions are made."""


def placed(config: GraspConfig, azimuth: float, rng: np.random.Generator) -> Pose:
    """Draw where the object truly stands: beside the hand's way, and turned.

    Args:
        config: the grasp.
        azimuth: where the hand comes from [rad].
        rng: draws what is left to chance.

    Returns:
        Its pose in the root link's frame.
    """
    pose = config.object.pose.pose()
    aside, turn = rng.uniform(*config.offset), rng.uniform(*config.yaw)
    pose[:3, :3] = Rotation.from_euler("z", turn, degrees=True).as_matrix() @ pose[:3, :3]
    pose[:3, 3] += aside * np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    return pose


def facing(config: GraspConfig, azimuth: float) -> Pose:
    """The pose of the tool at the start: level, its z towards where the object should be.

    Its x points to the left as it goes, its y up.

    Args:
        config: the grasp.
        azimuth: where the hand comes from [rad].

    Returns:
        In the root link's frame.
    """
    out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    left, up = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0]), np.array([0.0, 0.0, 1.0])
    turn = np.stack([left, up, -out], axis=1)
    place = config.object.pose.pose()[:3, 3] + config.distance * out + config.height * up
    return pose_of(place, turn)


def starting(
    config: GraspConfig, model: RobotModel, tool: Pose, rng: np.random.Generator
) -> FloatArray:
    """Find positions of the joints with the tool in a pose, shape (n,) [rad, m].

    Args:
        config: the grasp.
        model: the robot.
        tool: the pose, in the root link's frame.
        rng: draws where searches begin.

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
    """Make sure that the robot has what the scene names, and that objects are placed by it.

    Raises:
        RobotError: the robot lacks the tool.
        ConfigurationError: it lacks a joint, one of the gripper leads the tool, one would stand
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
    placing |= {f"surroundings.{name}": one for name, one in config.surroundings.items()}
    for path, one in placing.items():
        if one.pose.parent != model.root:
            raise ConfigurationError(
                f"the scene is placed in the robot's root link '{model.root}', "
                f"not in '{one.pose.parent}'",
                f"{path}.pose.parent",
            )


def _check_joints(config: GraspConfig, model: RobotModel) -> None:
    """Make sure that joints can stand where they are told, and that fingers lead no tool."""
    rows = {name: row for row, name in enumerate(model.joint_names)}
    leading = led_by(model, config.tool)
    for name in config.gripper:
        if leading[rows[name]] > 0.0:
            raise ConfigurationError(
                f"it leads the tool '{config.tool}', so it is no joint of fingers",
                f"gripper.{name}",
            )
    told = [("gripper", name, one) for name, both in config.gripper.items() for one in both]
    told += [("posture", *one) for one in config.posture.items()]
    told += [("stuck", *one) for one in config.stuck.items()]
    for field, name, position in told:
        low, high = model.limits[rows[name]]
        if not low <= position <= high:
            raise ConfigurationError(
                f"{position:g} is beyond the limits of the joint, {low:g} and {high:g}",
                f"{field}.{name}",
            )
