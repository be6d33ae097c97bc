"""Plug-ins: found by entry point, imported on demand, and unable to take others down."""

import functools
import importlib
import inspect
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any

import pluggy

from contactfusion import hooks
from contactfusion.errors import (
    ConfigurationError,
    DefaultError,
    Guard,
    PluginError,
    cause_in,
    missing_plugin,
    place_of,
)
from contactfusion.extras import extra_of, installs
from contactfusion.hooks import GROUP

KINDS = (
    *("generators", "controllers", "rules", "condensations", "segmenters", "recordings"),
    "scenes",
)
"""Kinds of plug-ins; the hook of each is ``contactfusion_<kind>``."""

HOME = "contactfusion"
HOMES = (HOME, "contactfusion-lab")
"""The distributions whose names take precedence."""
NO_DISTRIBUTION = "no distribution"
"""The distribution of an entry point without one."""


@dataclass(frozen=True, slots=True)
class Plugin:
    """An installed plug-in, by its entry point; it is not imported.

    Attributes:
        name: of the entry point.
        module: that it points to.
        distribution: the package that installed it, with its version.
    """

    name: str
    module: str
    distribution: str


class Plugins:
    """The installed plug-ins.

    Args:
        strict: raise at the first plug-in that fails, instead of listing it in `failures`.
        points: the entry points; those installed by default.

    Raises:
        PluginError: in strict mode, when a plug-in fails or its name is taken.
    """

    def __init__(self, *, strict: bool = False, points: Iterable[EntryPoint] | None = None) -> None:
        self._strict = strict
        self._manager = pluggy.PluginManager(GROUP)
        self._manager.add_hookspecs(hooks)
        self._points: dict[str, EntryPoint] = {}
        self._offers: dict[str, dict[str, type[Any]]] = {kind: {} for kind in KINDS}
        self._loaded: set[str] = set()
        self.failures: dict[str, str] = {}
        """Why a plug-in could not be used, by its name."""
        found = entry_points(group=GROUP) if points is None else points
        for point in in_order(found):
            if point.name in self._points:
                owner = _distribution(self._points[point.name])
                self._fail(
                    f"{point.name} ({_distribution(point)})",
                    f"the name '{point.name}' is taken by {owner}",
                )
            else:
                self._points[point.name] = point

    def listing(self) -> tuple[Plugin, ...]:
        """The installed plug-ins; none is imported."""
        return tuple(map(plugin_of, self._points.values()))

    def find(self, kind: str, name: str) -> type[Any]:
        """The class of a plug-in; no more is imported than needed.

        Args:
            kind: one of `KINDS`.
            name: the name by which configurations choose it.

        Raises:
            PluginError: nothing of that name is installed, or it could not be imported.
        """
        if name in self._points:
            self._load(name)
        if name not in self._offers[kind]:
            for other in self._points:
                self._load(other)
        if name in self._offers[kind]:
            return self._offers[kind][name]
        singular = kind.removesuffix("s")
        if name in self.failures:
            raise PluginError(f"the {singular} '{name}' cannot be used: {self.failures[name]}")
        raise missing_plugin(singular, name, self._offers[kind])

    def offers(self, kind: str) -> Mapping[str, type[Any]]:
        """All classes of a kind by name; imports every plug-in."""
        for name in self._points:
            self._load(name)
        return self._offers[kind]

    def _load(self, name: str) -> None:
        point = self._points[name]
        if name in self._loaded:
            return
        self._loaded.add(name)
        try:
            module = importlib.import_module(point.module)
            if not self._manager.is_registered(module):
                self._register(name, module)
        except PluginError as error:
            self._fail(name, str(error), error)
        except (Exception, SystemExit) as error:  # a third-party module may not take others down
            self._fail(name, cause_in(error, point.module) + remedy(error), error)

    def _register(self, name: str, module: ModuleType) -> None:
        try:
            self._manager.register(module, name=module.__name__)
            self._manager.check_pending()
            if not self._manager.get_hookcallers(module):
                raise PluginError(_unmarked(module))
            for kind in KINDS:
                self._collect(name, kind, module)
        except BaseException:
            if self._manager.is_registered(module):  # before pluggy 1.7 also when it was refused
                self._manager.unregister(module)
            raise

    def _collect(self, name: str, kind: str, module: ModuleType) -> None:
        """Collect one kind from one module; pluggy's own call would stop at the first failure."""
        implementations = getattr(self._manager.hook, f"{GROUP}_{kind}").get_hookimpls()
        for implementation in (i for i in implementations if i.plugin is module):
            offer = implementation.function()
            if not isinstance(offer, Mapping):
                raise PluginError(
                    f"contactfusion_{kind}() gives {offer!r}, not a mapping of classes"
                    + _at(implementation.function)
                )
            for key, cls in offer.items():
                if not isinstance(cls, type):
                    raise PluginError(
                        f"contactfusion_{kind}() gives {cls!r} for '{key}', not a class"
                        + _at(implementation.function)
                    )
                owner = self._owner_of(kind, key, module.__name__)
                if owner:
                    self._fail(f"{name}: {key}", f"the name '{key}' is taken by {owner}")
                else:
                    self._offers[kind][key] = cls

    def _owner_of(self, kind: str, key: str, module: str) -> str:
        """The module that owns a name before another; empty when there is none.

        A name belongs to the entry point of that name, whichever module is imported first, and
        also when it cannot be used: a configuration never gets another plug-in than it names.
        """
        point = self._points.get(key)
        if point is not None and point.module != module:
            self._load(key)
            if key in self.failures:
                return point.module
        return self._offers[kind][key].__module__ if key in self._offers[kind] else ""

    def _fail(self, name: str, why: str, cause: BaseException | None = None) -> None:
        self.failures[name] = why
        if self._strict:
            raise PluginError(f"the plug-in '{name}' cannot be used: {why}") from cause


def class_fault(cls: type[Any], contract: type[Any], config: type[Any] | None = None) -> str:
    """Why a class breaks its contract.

    Args:
        cls: the class of a plug-in.
        contract: the abstract class to implement.
        config: the class that its `Config` has to extend; None: it has none.

    Returns:
        The end of a sentence that starts with the name of the class; empty when it keeps it.
    """
    if not (inspect.isclass(cls) and issubclass(cls, contract)):
        return f"is no subclass of {contract.__name__}"
    if missing := sorted(getattr(cls, "__abstractmethods__", ())):
        return f"does not implement `{'`, `'.join(missing)}` of {contract.__name__}"
    if flag := _misspelt_flag(cls, contract):
        return flag
    own = getattr(cls, "Config", None)
    if config is not None and not (inspect.isclass(own) and issubclass(own, config)):
        return f"has a `Config` that is no subclass of {config.__name__}"
    return ""


def _misspelt_flag(cls: type[Any], contract: type[Any]) -> str:
    """A flag of a class that its contract lacks, though it has one of nearly that name."""
    public = [name for name in dir(contract) if not name.startswith("_")]
    flags = [name for name in public if isinstance(getattr(contract, name), bool)]
    for name in dir(cls):
        if not name.startswith("_") and name not in flags and isinstance(getattr(cls, name), bool):
            if near := get_close_matches(name, flags, n=1):
                return f"has a flag `{name}`: did you mean `{near[0]}` of {contract.__name__}?"
    return ""


def refuse(name: str, cls: type[Any], fault: str) -> None:
    """Refuse a plug-in for a fault of its class.

    Raises:
        PluginError: there is a fault; names plug-in, class, file and line.
    """
    if fault:
        raise PluginError(f"the plug-in '{name}' cannot be used: {cls.__name__} {fault}{_at(cls)}")


def configured(name: str, cls: type[Any], options: Mapping[str, Any], path: str) -> Any:
    """The `Config` of a plug-in's class, built from options.

    Args:
        name: of the plug-in.
        cls: its class.
        options: the given fields.
        path: of the options in the configuration.

    Raises:
        ConfigurationError: an option is wrong.
        PluginError: the class refuses its own default, or raises anything else.
    """
    where = f"{path}: " if path else ""
    with Guard(f"{where}`Config` of the plug-in '{name}'", cls.Config):
        try:
            return cls.Config(**options)
        except DefaultError as error:
            refuse(name, cls.Config, f"has a default that it refuses itself: {error}")
        except ConfigurationError as error:
            raise error.under(path) from None


@functools.cache
def installed_plugins() -> Plugins:
    """The installed plug-ins, found once in a process."""
    return Plugins()


def in_order(points: Iterable[EntryPoint]) -> list[EntryPoint]:
    """Entry points in the order of precedence of names: those of contactfusion first."""
    return sorted(points, key=lambda p: (_owner(p) not in HOMES, _owner(p), p.name))


def plugin_of(point: EntryPoint) -> Plugin:
    """The plug-in of an entry point; nothing is imported."""
    return Plugin(point.name, point.module, _distribution(point))


def _owner(point: EntryPoint) -> str:
    return point.dist.name if point.dist else ""


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else NO_DISTRIBUTION


def _at(definition: Any) -> str:
    origin = place_of(definition)
    return f" ({origin})" if origin else ""


def remedy(error: BaseException) -> str:
    """The command that installs the module that a plug-in lacks, when it is one of an extra."""
    lacks = isinstance(error, ModuleNotFoundError) and error.name
    extra = extra_of(lacks) if lacks else None
    return f"; install it with: {installs(extra)}" if extra else ""


def _unmarked(module: ModuleType) -> str:
    """The sentence that a module offers no plug-in, and where the mark of a hook is missing."""
    for kind in KINDS:
        hook = getattr(module, f"{GROUP}_{kind}", None)
        if inspect.isfunction(hook):
            return f"{hook.__name__}() lacks @hookimpl, so that it offers nothing{_at(hook)}"
    hooks_ = ", ".join(f"{GROUP}_{kind}" for kind in KINDS)
    return f"{module.__name__} offers nothing: it has no function with @hookimpl, named {hooks_}"
