"""Construction of the plug-ins that a configuration names."""

from pathlib import Path
from typing import Any

from contactfusion.controller import Controller
from contactfusion.errors import ConfigurationError, Guard, name_hint
from contactfusion.generator import Generator, OfRobot, generator_fault, instance_fault
from contactfusion.integrator.integrator import Integrator
from contactfusion.model import Model, rooted
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import class_fault, configured, installed_plugins, refuse
from contactfusion.robots.description import RobotConfig
from contactfusion.rule import Condensation, Rule

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
        name: of the generator.
        options: its `type` and the fields of its `Config`; those marked by `OfRobot` may be names
            from the robot's description.
        folder: that of relative file names.
        robot: the description of the robot.
        within: the folder that all files have to lie in; None: no limit.

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
    """The class of a type of generators.

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
    try:
        with Guard(f"controller: the plug-in '{kind}'", cls):
            return cls(own)
    except ConfigurationError as error:
        raise error.under("controller") from None


def built_integrator(config: PipelineConfig) -> Integrator:
    """Build the integrator with its rule and condensation; it refuses sources that are unplugged.

    Raises:
        PluginError: no such rule or condensation is installed, it breaks the contract, or raises.
        ConfigurationError: an option is wrong, or the condensation does not fit the rule.
    """
    own = config.integrator.model_copy(update={"strict_sources": True})
    rule_class: type[Rule] = _part_class("rule", own.rule, Rule)
    condensation_class: type[Condensation] = _part_class(
        "condensation", own.condensation, Condensation
    )
    rule_options = _part_options("rule", own.rule, rule_class, own.rule_options, config)
    options = _part_options(
        "condensation", own.condensation, condensation_class, own.condensed_by, config
    )
    with Guard(f"integrator: the plug-in '{own.rule}'", rule_class):
        rule = rule_class(rule_options)
    with Guard(f"integrator: the plug-in '{own.condensation}'", condensation_class):
        condensation = condensation_class(options, own.linking_distance)
    try:
        return Integrator(own, rule=rule, condensation=condensation)
    except ConfigurationError as error:
        raise error.under("integrator") from None


def _part_class(part: str, name: str, contract: type[Any]) -> type[Any]:
    cls = installed_plugins().find(f"{part}s", name)
    refuse(name, cls, class_fault(cls, contract, Model))
    return cls


def _part_options(
    part: str, name: str, cls: type[Rule | Condensation], given: dict[str, Any], of: PipelineConfig
) -> Model:
    path = f"integrator.{part}"
    return _own(configured(name, cls, given, path), path, of.folder, of.files_within)


def described_options(config: type[Model]) -> dict[str, str]:
    """Options that may be names from the robot's description, with its field that holds them."""
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
        names = [str(name) for name in names]
        for name in names:
            if name not in known:
                hint = name_hint(name, known, f"{kind} of the robot")
                if kind == "efforts":
                    hint += "; `contactfusion identify` tells them from a free motion"
                raise ConfigurationError(f"unknown name '{name}': {hint}", f"{path}.{option}")
        described = {name: known[name] for name in names}
        found[option] = described[given] if isinstance(given, str) else described
    return found


def _own(config: Model, path: str, folder: Path, within: Path | None) -> Model:
    """The options of a plug-in, with file names rooted at a folder."""
    try:
        return rooted(config, folder, within)
    except ConfigurationError as error:
        raise error.under(path) from None
