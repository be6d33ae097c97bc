"""Builds generators and controllers from their `type` and options."""

from pathlib import Path
from typing import Any

from contactfusion.controller import Controller
from contactfusion.errors import ConfigurationError, PluginError
from contactfusion.generator import Generator
from contactfusion.model import Model, rooted
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins

AnyGenerator = Generator[Any]


def built_generator(name: str, options: dict[str, Any], folder: Path = Path()) -> AnyGenerator:
    """Build a generator from its `type` and options; relative file names start at `folder`.

    Raises:
        PluginError: no such type is installed.
        ConfigurationError: an option is wrong.
    """
    given = {key: value for key, value in options.items() if key != "type"}
    cls: type[AnyGenerator] = installed_plugins().find("generators", options["type"])
    _refuse_stranger(cls, Generator, options["type"])
    config = _configured(cls.Config, given, f"generators.{name}", folder)
    try:
        return cls(name, config)
    except ConfigurationError as error:
        raise error.under(f"generators.{name}") from None


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
    return cls(_configured(cls.Config, given, "controller", config.folder))


def _refuse_stranger(cls: type[Any], contract: type[Any], name: str) -> None:
    if not issubclass(cls, contract):
        raise PluginError(f"the plug-in class {cls.__name__} of '{name}' is no {contract.__name__}")


def _configured(model: type[Any], options: dict[str, Any], path: str, folder: Path) -> Model:
    try:
        configured: Model = model(**options)
    except ConfigurationError as error:
        raise error.under(path) from None
    return rooted(configured, folder)
