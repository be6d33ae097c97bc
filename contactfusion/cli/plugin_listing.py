"""The installed plug-ins, what each is for, and the options of one."""

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel
from rich.console import Console
from rich.table import Table

from contactfusion.errors import (
    ConfigurationError,
    ContactFusionError,
    PluginError,
    cause_of,
    name_hint,
)
from contactfusion.hooks import GROUP
from contactfusion.plugins import (
    KINDS,
    Plugin,
    Plugins,
    class_fault,
    configured,
    installed_plugins,
    refuse,
)
from contactfusion.readings.codec import Codec
from contactfusion.readings.registry import Kinds, installed_kinds
from contactfusion.vendors import VENDORS

READING = "reading"
"""What is listed as the kind of a plug-in that is a kind of reading."""


def list_plugins(
    strict: bool, commands: Sequence[Plugin] = (), command_failures: Mapping[str, str] | None = None
) -> None:
    """Print the installed plug-ins with kind and purpose; nothing is imported unless `strict`.

    Args:
        strict: whether to import and build each.
        commands: what plug-ins add to the command line; modules as MODULE:FUNCTION.
        command_failures: why a command cannot be used, by its name.

    Raises:
        PluginError: in strict mode, when some cannot be used; all of them are printed.
    """
    plugins = installed_plugins()
    table = Table(box=None, pad_edge=False)
    for heading in ("plug-in", "kind", "purpose", "from"):
        table.add_column(heading)
    order = {kind.removesuffix("s"): place for place, kind in enumerate(KINDS)}
    rows = [(*declared(plugin), plugin) for plugin in plugins.listing()]
    for kind, purpose, plugin in sorted(rows, key=lambda row: order.get(row[0], len(order))):
        table.add_row(plugin.name, kind, purpose, plugin.distribution)
    for plugin in commands:
        words = plugin.name.replace(".", " ")
        table.add_row(words, "command", declared_purpose(plugin.module), plugin.distribution)
    kinds = installed_kinds()
    for plugin in kinds.listing():
        table.add_row(plugin.name, READING, declared_purpose(plugin.module), plugin.distribution)
    console = Console(markup=False, highlight=False)
    console.print(table)
    found = dict(_strict_failures(plugins)) if strict else dict(plugins.failures)
    found |= command_failures or {}
    found |= dict(_strict_failures_of_kinds(kinds)) if strict else kinds.failures
    for name, why in found.items():
        console.print(f"{name} cannot be used: {why}", soft_wrap=True)
    if strict and found:
        count = f"{len(found)} plug-in{'s' if len(found) > 1 else ''}"
        raise PluginError(f"{count} cannot be used: {', '.join(found)}")


def describe_plugin(name: str) -> None:
    """Print what a plug-in is and the options that it takes.

    Raises:
        PluginError: no such plug-in is installed, or it cannot be used.
    """
    plugins = Plugins()
    console = Console(markup=False)
    for kind in KINDS:
        cls = plugins.offers(kind).get(name)
        if cls is not None:
            word = kind.removesuffix("s")
            console.print(f"{name} ({word}): {_first_line(cls.__doc__)}", highlight=False)
            if hasattr(cls, "Config"):
                refuse(name, cls, class_fault(cls, object, BaseModel))
                console.print(_options(cls.Config))
            if name in VENDORS and kind == "generators":
                console.print(*_vendors(name), sep="\n", highlight=False)
            return
    if codec := installed_kinds().find(name):
        _describe_kind(codec, console)
        return
    if name in plugins.failures:
        raise PluginError(f"the plug-in '{name}' cannot be used: {plugins.failures[name]}")
    known = [key for kind in KINDS for key in plugins.offers(kind)]
    raise PluginError(f"there is no plug-in '{name}'; {name_hint(name, known, 'plug-ins')}")


def _describe_kind(codec: Codec[Any], console: Console) -> None:
    """Print what a kind of reading is: its ROS messages, and the columns of a log."""
    console.print(f"{codec.name} ({READING}): {_first_line(codec.__doc__)}", highlight=False)
    console.print(f"ROS messages: {', '.join(codec.messages) or 'none'}", highlight=False)
    if codec.definition:
        console.print(codec.definition.strip(), highlight=False, soft_wrap=True)
    if codec.Columns is None:
        console.print("a log can't hold it")
    else:
        console.print(f"columns of a log: {_first_line(codec.Columns.__doc__)}", highlight=False)
        console.print(_options(codec.Columns))


def declared(plugin: Plugin) -> tuple[str, str]:
    """Kind and purpose of a plug-in, as its source declares them; the module is not imported.

    Returns:
        The kind, such as "generator", and the first line of the docstring of the class that its
        hook offers under its name. Empty where the source is missing, or names are not literal.
    """
    module = _parsed(plugin.module)
    kinds = list[str]()
    for node in module.body:
        kind = getattr(node, "name", "").removeprefix(f"{GROUP}_")
        if isinstance(node, ast.FunctionDef) and kind in KINDS:
            offered = _offered(node)
            if plugin.name in offered:
                return kind.removesuffix("s"), _purpose(module, offered[plugin.name])
            kinds.append(kind.removesuffix("s"))
    return ", ".join(kinds), ""


def declared_purpose(name: str) -> str:
    """The first line of the docstring of a function, MODULE:FUNCTION, that is not imported."""
    module, _, function = name.partition(":")
    return _purpose(_parsed(module), function)


def _purpose(module: ast.Module, name: str) -> str:
    """The first line of a docstring, or the `help` of a group of commands; imports are followed."""
    for node in module.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == name:
            return _first_line(ast.get_docstring(node))
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            if any(isinstance(target, ast.Name) and target.id == name for target in node.targets):
                return "".join(
                    str(ast.literal_eval(keyword.value))
                    for keyword in node.value.keywords
                    if keyword.arg == "help" and isinstance(keyword.value, ast.Constant)
                )
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _purpose(_parsed(node.module), alias.name)
    return ""


def _parsed(module: str) -> ast.Module:
    """The source of a module; empty when there is none, or it is no Python."""
    spec = _spec(module)
    try:
        return ast.parse(Path((spec and spec.origin) or "").read_bytes())
    except (OSError, SyntaxError, ValueError):
        return ast.Module([], [])


def _offered(hook: ast.FunctionDef) -> dict[str, str]:
    """The names of classes by the names that a hook offers them under, where both are literal."""
    return {
        key.value: value.id
        for node in ast.walk(hook)
        if isinstance(node, ast.Dict)
        for key, value in zip(node.keys, node.values, strict=True)
        if isinstance(key, ast.Constant) and isinstance(key.value, str)
        if isinstance(value, ast.Name)
    }


def _spec(module: str) -> ModuleSpec | None:
    """Find a module; `importlib.util.find_spec` would import the packages above it."""
    path: Any = None
    spec: ModuleSpec | None = None
    names = module.split(".")
    for depth in range(1, len(names) + 1):
        name = ".".join(names[:depth])
        found = (finder.find_spec(name, path) for finder in sys.meta_path)
        spec = next((spec for spec in found if spec is not None), None)
        if spec is None:
            return None
        path = spec.submodule_search_locations
    return spec


def _first_line(text: str | None) -> str:
    return next(iter(inspect.cleandoc(text or "").splitlines()), "")


def _strict_failures(plugins: Plugins) -> Iterator[tuple[str, str]]:
    """Import all plug-ins, build each with its defaults, and give why some cannot be used."""
    offers = {kind: plugins.offers(kind) for kind in KINDS}
    yield from plugins.failures.items()
    for kind, names in offers.items():
        for name in names:
            try:
                _build(kind, name)
            except ConfigurationError:
                continue  # it says which options it needs
            except ContactFusionError as error:
                yield name, str(error).removeprefix(f"the plug-in '{name}' cannot be used: ")


def _strict_failures_of_kinds(kinds: Kinds) -> Iterator[tuple[str, str]]:
    """Import all kinds of reading, make an example of each, and give why some cannot be used."""
    codecs = kinds.load()
    yield from kinds.failures.items()
    for codec in codecs:
        title = kinds.title(codec)
        try:
            example = codec.example(0.0, 1.0)
        except (Exception, SystemExit) as error:
            yield title, f"`example` raised {cause_of(error, type(codec))}"
        else:
            if not isinstance(example, codec.kind):
                yield title, f"`example` gives {example!r}, not a {codec.kind.__name__}"


def _build(kind: str, name: str) -> None:
    """Build a plug-in with its defaults, as a configuration that names it would."""
    from contactfusion.assembly import built_controller, built_generator, built_integrator
    from contactfusion.integrator.config import IntegratorConfig
    from contactfusion.pipeline_config import PipelineConfig
    from contactfusion.recordings.opening import recording_class
    from contactfusion.scene import scene_class
    from contactfusion.segmenter import built_segmenter, segmenter_class

    match kind:
        case "generators":
            built_generator(name, {"type": name})
        case "controllers":
            built_controller(PipelineConfig(controller={"type": name}))
        case "segmenters":
            built_segmenter(configured(name, segmenter_class(name), {"type": name}, ""))
        case "recordings":
            recording_class(name)
        case "scenes":
            scene_class(name)
        case "rules":
            built_integrator(PipelineConfig(integrator=IntegratorConfig(rule=name)))
        case "condensations":
            built_integrator(PipelineConfig(integrator=IntegratorConfig(condensation=name)))


def _options(model: type[BaseModel]) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("option", "default", "meaning"):
        table.add_column(heading)
    _add_options(table, model, "")
    return table


def _vendors(kind: str) -> Iterator[str]:
    """The conventions of drivers that a type of generator knows, each as a paragraph."""
    for name, known in VENDORS[kind].items():
        options = ", ".join(f"{option}: {value}" for option, value in known.options.items())
        gravity = "off" if known.compensated else "not off"
        yield (
            f"vendor {name} ({options}): of {known.frame}; the driver takes gravity "
            f"{gravity} ({known.source})"
        )


def _add_options(table: Table, model: type[BaseModel], prefix: str) -> None:
    """Add a row for each option, and below it for the options that it holds."""
    for name, field in model.model_fields.items():
        inner = next((a for a in _types(field.annotation) if issubclass(a, BaseModel)), None)
        default = field.get_default(call_default_factory=True, validated_data={})
        shown = "required" if field.is_required() else "" if inner else str(default)
        table.add_row(prefix + name, shown, " ".join((field.description or "").split()))
        if inner:
            _add_options(table, inner, f"{prefix}{name}.")


def _types(annotation: Any) -> list[type]:
    """The classes that an annotation such as ``X | None`` allows."""
    return [a for a in (annotation, *get_args(annotation)) if isinstance(a, type)]
