"""The installed plug-ins, and the options of one."""

from typing import Any, get_args

from pydantic import BaseModel
from rich.console import Console
from rich.table import Table

from contactfusion.errors import PluginError, name_hint
from contactfusion.plugins import KINDS, Plugins


def list_plugins(strict: bool) -> None:
    """Print the installed plug-ins; nothing is imported unless `strict`.

    Raises:
        PluginError: in strict mode, when one cannot be used.
    """
    plugins = Plugins(strict=strict)
    if strict:
        plugins.offers("generators")
    table = Table(box=None, pad_edge=False)
    for heading in ("plug-in", "module", "from"):
        table.add_column(heading)
    for plugin in plugins.listing():
        table.add_row(plugin.name, plugin.module, plugin.distribution)
    console = Console(markup=False)
    console.print(table)
    for name, why in plugins.failures.items():
        console.print(f"{name} cannot be used: {why}")


def describe_plugin(name: str) -> None:
    """Print what a plug-in is and the options that it takes.

    Raises:
        PluginError: no such plug-in is installed, or it cannot be imported.
    """
    plugins = Plugins()
    console = Console(markup=False)
    for kind in KINDS:
        cls = plugins.offers(kind).get(name)
        if cls is not None:
            summary = (cls.__doc__ or "").strip().splitlines()[0]
            console.print(f"{name} ({kind.removesuffix('s')}): {summary}", highlight=False)
            if hasattr(cls, "Config"):
                console.print(_options(cls.Config))
            return
    if name in plugins.failures:
        raise PluginError(f"the plug-in '{name}' cannot be used: {plugins.failures[name]}")
    known = [key for kind in KINDS for key in plugins.offers(kind)]
    raise PluginError(f"there is no plug-in '{name}'; {name_hint(name, known, 'plug-ins')}")


def _options(model: type[BaseModel]) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("option", "default", "meaning"):
        table.add_column(heading)
    _add_options(table, model, "")
    return table


def _add_options(table: Table, model: type[BaseModel], prefix: str) -> None:
    """Add a row for each option, and below it for the options that it holds."""
    for name, field in model.model_fields.items():
        inner = next((a for a in _types(field.annotation) if issubclass(a, BaseModel)), None)
        default = field.get_default(call_default_factory=True, validated_data={})
        told = "required" if field.is_required() else "" if inner else str(default)
        table.add_row(prefix + name, told, " ".join((field.description or "").split()))
        if inner:
            _add_options(table, inner, f"{prefix}{name}.")


def _types(annotation: Any) -> list[type]:
    """Give the classes that an annotation such as ``X | None`` allows."""
    return [a for a in (annotation, *get_args(annotation)) if isinstance(a, type)]
