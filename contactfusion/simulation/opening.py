"""One way to open every scene: by a description of what happens in it."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.model import rooted
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import shared_robot
from contactfusion.simulation.grasp import GraspScene
from contactfusion.simulation.grasp_config import GraspConfig
from contactfusion.simulation.grasping import Grasping
from contactfusion.simulation.push import PushScene
from contactfusion.simulation.push_config import PushConfig
from contactfusion.simulation.pushing import Pushing
from contactfusion.simulation.scene import Scene
from contactfusion.simulation.touch import TouchScene
from contactfusion.simulation.touch_config import TouchConfig


def _touch(
    description: Mapping[str, Any], folder: Path, robot: RobotConfig, seed: int
) -> TouchScene:
    config = rooted(TouchConfig(**description), folder)
    return TouchScene(config, shared_robot(robot), seed)


def _push(description: Mapping[str, Any], folder: Path, robot: RobotConfig, seed: int) -> Pushing:
    config = rooted(PushConfig(**description), folder)
    return Pushing(PushScene(config, robot, seed))


def _grasp(description: Mapping[str, Any], folder: Path, robot: RobotConfig, seed: int) -> Grasping:
    config = rooted(GraspConfig(**description), folder)
    return Grasping(GraspScene(config, shared_robot(robot), seed))


TYPES: dict[str, Callable[[Mapping[str, Any], Path, RobotConfig, int], Scene]] = {
    "touch": _touch,
    "push": _push,
    "grasp": _grasp,
}
"""What opens each type of scene, given its description, its folder, the robot and a seed."""


def open_scene(
    description: Mapping[str, Any], robot: RobotConfig, seed: int = 0, folder: Path = Path()
) -> Scene:
    """Open a scene.

    Args:
        description: its `type` and the fields of `TouchConfig` (`touch`), `PushConfig` (`push`) or
            `GraspConfig` (`grasp`).
        robot: the robot that acts in it.
        seed: of all chance.
        folder: where relative file names start.

    Raises:
        ConfigurationError: the description is wrong, or does not fit the robot; the path begins
            with "scene".
        DependencyError: pybullet, or what the robot needs, is not installed.
    """
    kind = description.get("type")
    if not isinstance(kind, str) or kind not in TYPES:
        hint = name_hint(str(kind or ""), TYPES, "types of scene")
        wrong = "this field is required" if kind is None else f"unknown type '{kind}'"
        raise ConfigurationError(f"{wrong}; {hint}", "scene.type")
    try:
        shared_robot(robot)
    except RobotError as error:
        raise ConfigurationError(str(error), "robot") from None
    try:
        return TYPES[kind](description, folder, robot, seed)
    except ConfigurationError as error:
        raise error.under("scene") from None
    except RobotError as error:
        raise ConfigurationError(str(error), "scene") from None
