"""Builds generators and controllers from their `type` and options."""

from pathlib import Path
from typing import Any

from contactfusion.controller import Controller
from contactfusion.errors import ConfigurationError, Guard, name_hint
from contactfusion.generator import Generator, OfRobot, generator_fault, instance_fault
from contactfusion.model import Model, rooted
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import class_fault, configured, installed_plugins, refuse
from contactfusion.robots.description import RobotConfig

AnyGenerator = Generator[Any]


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
        options: its `type` and the fields of its `Config`; those marked by `OfRobot` may be names
            from the robot's description.
        folder: where relative file names start.
        robot: the description of the robot.
        within: the folder that all files have to lie in; None: they may lie anywhere.

    Raises:
        PluginError: no such type is installed, or it breaks the contract.
        ConfigurationError: an option is wrong.
    """
    path, kind = f"generators.{name}", options["type"]
    given = {key: value for key, value in options.items() if key != "type"}
    cls = generator_class(kind)
    given |= _described(cls.Config, given, robot, path)
    config = _own(configured(kind, cls, given, path), path, folder, within)
    with Guard(f"{path}: the plug-in '{kind}'", cls):
        try:
            generator = cls(name, config)
        except ConfigurationError as error:
            raise error.under(path) from None
        refuse(kind, cls, instance_fault(generator, name))
    return generator


def generator_class(name: str) -> type[AnyGenerator]:
    """Give the class of a type of generators.

    Raises:
        PluginError: no such type is installed, or its class breaks the contract.
    """
    cls: type[AnyGenerator] = installed_plugins().find("generators", name)
    refuse(name, cls, generator_fault(cls))
    return cls


def built_controller(config: PipelineConfig) -> Controller | None:
    """Build the controller of a pipeline, if it has one.

    Raises:
        PluginError: no such type is installed.
        ConfigurationError: an option is wrong.
    """
    if config.controller is None:
        return None
    kind = config.controller["type"]
    given = {key: value for key, value in config.controller.items() if key != "type"}
    cls: type[Controller] = installed_plugins().find("controllers", kind)
    refuse(kind, cls, class_fault(cls, Controller, Model))
    options = configured(kind, cls, given, "controller")
    own = _own(options, "controller", config.folder, config.files_within)
    with Guard(f"controller: the plug-in '{kind}'", cls):
        return cls(own)


def described_options(config: type[Model]) -> dict[str, str]:
    """The options that may be names from the robot's description, and its field that holds them."""
    return {
        option: mark.kind
        for option, field in config.model_fields.items()
        for mark in field.metadata
        if isinstance(mark, OfRobot)
    }


def _described(
    config: type[Model], options: dict[str, Any], robot: RobotConfig | None, path: str
) -> dict[str, Any]:
    """The options that are names from the robot's description, looked up there."""
    found: dict[str, Any] = {}
    for option, kind in described_options(config).items():
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


def _own(config: Model, path: str, folder: Path, within: Path | None) -> Model:
    """The options of a plug-in with file names that start at a folder."""
    try:
        return rooted(config, folder, within)
    except ConfigurationError as error:
        raise error.under(path) from None
