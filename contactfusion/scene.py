"""The contract of scenes: what a simulated robot does while a pipeline listens."""

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from contactfusion.errors import (
    ConfigurationError,
    DependencyError,
    Guard,
    PluginError,
    RobotError,
    name_hint,
)
from contactfusion.extras import in_lab
from contactfusion.model import Model, rooted
from contactfusion.pipeline import Pipeline, Step
from contactfusion.plugins import class_fault, configured, installed_plugins, refuse
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import shared_robot
from contactfusion.stream import Facts, Stream, Verdict

LAB_SCENES = ("grasp", "press", "push", "touch")
"""Scenes that contactfusion-lab brings."""


class Scene(Stream):
    """A stream of what a simulated robot does while a pipeline listens; can be played once."""

    Config: ClassVar[type[Model]]
    """The type of the options; a field `type` holds the name of the scene."""
    epoch_ns = 10**18  # 2001: to ROS a stamp of 0 means "the latest"

    @classmethod
    @abstractmethod
    def opened(cls, config: Any, robot: RobotConfig, seed: int) -> Self:
        """A scene at its start.

        Args:
            config: an instance of `Config`.
            robot: the robot that acts in it.
            seed: of all chance.

        Raises:
            ConfigurationError: the options do not fit the robot.
            DependencyError: a package that the scene needs is not installed.
        """

    @abstractmethod
    def facts(self) -> Facts:
        """The true contacts and poses of objects now, while the scene runs and when it is over."""

    @abstractmethod
    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """What really happened, once the scene is over.

        Args:
            pipeline: which listened.
            last: its last step.
        """


def open_scene(
    description: Mapping[str, Any], robot: RobotConfig, seed: int = 0, folder: Path = Path()
) -> Scene:
    """Open a scene.

    Args:
        description: its `type` and the fields of its `Config`.
        robot: the robot that acts in it.
        seed: of all chance.
        folder: where relative file names start.

    Raises:
        ConfigurationError: the description is wrong, or does not fit the robot; the path begins
            with "scene".
        PluginError: the scene cannot be used.
        DependencyError: contactfusion-lab, or what the scene or the robot needs, is not installed.
    """
    kind = description.get("type")
    if not isinstance(kind, str):
        hint = name_hint("", installed_plugins().offers("scenes"), "types of scene")
        wrong = "this field is required" if kind is None else f"unknown type '{kind}'"
        raise ConfigurationError(f"{wrong}; {hint}", "scene.type")
    cls = scene_class(kind)
    try:
        shared_robot(robot)
    except RobotError as error:
        raise ConfigurationError(str(error), "robot") from None
    config = configured(kind, cls, description, "scene")
    with Guard(f"scene: the plug-in '{kind}'", cls):
        try:
            return cls.opened(rooted(config, folder), robot, seed)
        except ConfigurationError as error:
            raise error.under("scene") from None
        except RobotError as error:
            raise ConfigurationError(str(error), "scene") from None


def scene_class(name: str) -> type[Scene]:
    """The class of a type of scene.

    Raises:
        ConfigurationError: no such type is installed.
        PluginError: its class breaks the contract, or cannot be imported.
        DependencyError: it comes with contactfusion-lab, which is not installed.
    """
    plugins = installed_plugins()
    try:
        cls: type[Scene] = plugins.find("scenes", name)
    except PluginError:
        if name in plugins.failures:
            raise
        if name in LAB_SCENES:
            sentence = in_lab(f"the scene '{name}'")
            raise DependencyError(f"scene.type: {sentence}") from None
        hint = name_hint(name, plugins.offers("scenes"), "types of scene")
        raise ConfigurationError(f"unknown type '{name}'; {hint}", "scene.type") from None
    refuse(name, cls, class_fault(cls, Scene, Model))
    return cls
