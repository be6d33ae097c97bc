"""Builds generators and controllers from their `type` and options."""

from pathlib import Path
from typing import Any

from contactfusion.controller import Controller
from contactfusion.errors import ConfigurationError, PluginError, name_hint
from contactfusion.generator import Generator
from contactfusion.model import Model, rooted
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.robots.description import RobotConfig

AnyGenerator = Generator[Any]


DESCRIBED = {"patch": "patches", "wrist": "wrists", "camera": "cameras", "fingers": "fingers"}
"""Options that may name, alone or as a list, what the robot's description holds."""


def built_generator(
    name: str,
    options: dict[str, Any],
    folder: Path = Path(),
    robot: RobotConfig | None = None,
    within: Path | None = None,
) -> AnyGenerator:
    """Build a generator from its `type` and options.

    Args:
        name: what it is called.
        options: its `type` and the fields of its `Config`; a patch, wrist or camera may be a name
            from the robot's description.
        folder: where relative file names start.
        robot: the description of the robot.
        within: the folder that all files have to lie in; None: they may lie anywhere.

    Raises:
        PluginError: no such type is installed.
        ConfigurationError: an option is wrong.
    """
    given = {key: value for key, value in options.items() if key != "type"}
    given |= _described(given, robot, f"generators.{name}")
    cls = generator_class(options["type"])
    config = _configured(cls.Config, given, f"generators.{name}", folder, within)
    try:
        return cls(name, config)
    except ConfigurationError as error:
        raise error.under(f"generators.{name}") from None


def generator_class(name: str) -> type[AnyGenerator]:
    """Give the class of a type of generators.

    Raises:
        PluginError: no such type is installed, or it is no generator.
    """
    cls: type[AnyGenerator] = installed_plugins().find("generators", name)
    _refuse_stranger(cls, Generator, name)
    return cls


def built_controller(config: PipelineConfig) -> Controller | None:
    """Build the controller of a pipeline, if it has one.

    Raises:
        PluginError: no such type is installed.
        ConfigurationError: an option is wrong.
    """
    if config.controller is None:
        return None
    given = {key: value for key, value in config.controller.items() if key != "type"}
    cls: type[Controller] = installed_plugins().find("controllers", config.controller["type"])
    _refuse_stranger(cls, Controller, config.controller["type"])
    return cls(_configured(cls.Config, given, "controller", config.folder, config.within))


def _described(options: dict[str, Any], robot: RobotConfig | None, path: str) -> dict[str, Any]:
    """Look up the options that are names from the robot's description."""
    found: dict[str, Any] = {}
    for option, kind in DESCRIBED.items():
        given, known = options.get(option), getattr(robot, kind) if robot else {}
        names = [given] if isinstance(given, str) else given
        if not isinstance(names, list | tuple):
            continue
        for name in names:
            if name not in known:
                hint = name_hint(str(name), known, f"{kind} of the robot")
                raise ConfigurationError(f"unknown name '{name}': {hint}", f"{path}.{option}")
        described = {name: known[name] for name in names}
        found[option] = described[given] if isinstance(given, str) else described
    return found


def _refuse_stranger(cls: type[Any], contract: type[Any], name: str) -> None:
    if not issubclass(cls, contract):
        raise PluginError(f"the plug-in class {cls.__name__} of '{name}' is no {contract.__name__}")


def _configured(
    model: type[Any], options: dict[str, Any], path: str, folder: Path, within: Path | None
) -> Model:
    try:
        configured: Model = model(**options)
        return rooted(configured, folder, within)
    except ConfigurationError as error:
        raise error.under(path) from None
