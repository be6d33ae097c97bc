"""The kinds of reading that there are: those of this project, and those of plug-ins.

A plug-in registers a kind by an entry point of the group `contactfusion_readings`, NAME =
package.module:CODEC_CLASS. It is imported when a kind is asked for that no other before it has.
"""

import dataclasses
import functools
import logging
from collections.abc import Iterable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, final

from contactfusion.errors import Guard, PluginError, cause_in
from contactfusion.plugins import HOME, Plugin, class_fault, in_order, plugin_of, remedy
from contactfusion.readings import BUILT_IN
from contactfusion.readings.codec import Codec, Role
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.messages import define, known_types
from contactfusion.readings.reading import Reading
from contactfusion.readings.values import Values

GROUP = "contactfusion_readings"
log = logging.getLogger(__name__)


@final
class Kinds:
    """The kinds of reading by name.

    Args:
        points: the entry points of plug-ins; those installed by default.
    """

    def __init__(self, points: Iterable[EntryPoint] | None = None) -> None:
        self._codecs: dict[str, Codec[Any]] = {codec.name: codec for codec in BUILT_IN}
        self._of: dict[type[Reading], Codec[Any]] = {codec.kind: codec for codec in BUILT_IN}
        self._points: dict[str, EntryPoint] = {}
        self._asked: set[str] = set()
        self._reported: set[str] = set()
        self._guards: dict[str, Guard] = {}
        self.failures: dict[str, str] = {}
        """Why a kind of a plug-in cannot be used, by what it is called in a sentence; of those that
        were asked for."""
        found = entry_points(group=GROUP) if points is None else points
        for point in in_order(found):
            if owner := self._owner(point.name):
                self.failures[_title(point)] = f"the name '{point.name}' is taken by {owner}"
            else:
                self._points[point.name] = point

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all kinds; nothing is imported."""
        return (*(codec.name for codec in BUILT_IN), *self._points)

    def listing(self) -> tuple[Plugin, ...]:
        """The kinds of plug-ins; modules as MODULE:CLASS; nothing is imported."""
        return tuple(
            dataclasses.replace(plugin_of(point), module=point.value)
            for point in self._points.values()
        )

    def find(self, name: str) -> Codec[Any] | None:
        """The kind of a name; None: there is none.

        Raises:
            PluginError: a plug-in has it, and cannot be used.
        """
        if name in self._points:
            self._load_up_to(name)
            if name not in self._codecs:
                raise PluginError(self._sentence(_title(self._points[name])))
        return self._codecs.get(name)

    def all(self) -> tuple[Codec[Any], ...]:
        """All kinds that can be used; what keeps others from it is logged once."""
        codecs = self.load()
        for title in self.failures:
            if title not in self._reported:
                self._reported.add(title)
                log.warning(self._sentence(title))
        return codecs

    def load(self) -> tuple[Codec[Any], ...]:
        """All kinds that can be used; nothing is logged."""
        if self._points:
            self._load_up_to(next(reversed(self._points)))
        return tuple(self._codecs[name] for name in self.names if name in self._codecs)

    def of(self, kind: type[Reading]) -> Codec[Any] | None:
        """The codec of a class of readings, or of the nearest one above it; None: it has none."""
        found = self._near(kind)
        if found is None and len(self._asked) < len(self._points):
            self.all()
            found = self._near(kind)
        return found

    def among(self, kinds: Iterable[type[Reading]]) -> set[str]:
        """The names of the kinds that some classes of readings are of."""
        return {codec.name for kind in kinds if (codec := self.of(kind))}

    def by_message(self) -> Mapping[str, Codec[Any]]:
        """The kinds by the types of ROS messages that they are read from."""
        return {msgtype: codec for codec in self.all() for msgtype in codec.messages}

    def guard(self, codec: Codec[Any]) -> Guard:
        """A `with` around code of a codec: what it raises becomes a PluginError that names it."""
        if codec.name not in self._guards:
            self._guards[codec.name] = Guard(self.title(codec), type(codec))
        return self._guards[codec.name]

    def _near(self, kind: type[Reading]) -> Codec[Any] | None:
        return next((self._of[base] for base in kind.__mro__ if base in self._of), None)

    def _owner(self, name: str) -> str:
        """The distribution that has a name; empty: none has."""
        if name in self._points:
            return plugin_of(self._points[name]).distribution
        return HOME if name in self._codecs else ""

    def title(self, codec: Codec[Any]) -> str:
        """The name of a kind in a sentence."""
        point = self._points.get(codec.name)
        return _title(point) if point else f"the kind of reading '{codec.name}' of {HOME}"

    def _sentence(self, title: str) -> str:
        return f"{title} cannot be used: {self.failures[title]}"

    def _load_up_to(self, name: str) -> None:
        """Import kinds in their order: which of two has a ROS type hangs on no other order."""
        if name not in self._asked:
            for other, point in self._points.items():
                self._load(other, point)
                if other == name:
                    break

    def _load(self, name: str, point: EntryPoint) -> None:
        if name in self._asked:
            return
        self._asked.add(name)
        try:
            cls = point.load()
            fault = self._fault(name, cls)
            if not fault:
                codec = cls()
                self._codecs[name] = self._of[codec.kind] = codec
        except (Exception, SystemExit) as error:  # no stranger's module may take others down
            fault = cause_in(error, point.module) + remedy(error)
        if fault:
            self.failures[_title(point)] = fault

    def _fault(self, name: str, cls: type[Codec[Any]]) -> str:
        """What keeps a codec from being used, as a sentence; empty: nothing."""
        if fault := class_fault(cls, Codec) or _undeclared(cls):
            return f"{getattr(cls, '__name__', repr(cls))} {fault}"
        if cls.name != name:
            return f"its entry point is '{name}', and the `name` of {cls.__name__} is '{cls.name}'"
        for codec in self._codecs.values():
            owner = self.title(codec)
            if cls.kind.__name__ == codec.kind.__name__:
                return f"the class name {cls.kind.__name__} is taken by {owner}"
            if taken := set(cls.messages) & set(codec.messages):
                return f"the ROS type {min(taken)} is taken by {owner}"
        return _undefined(cls)


def _title(point: EntryPoint) -> str:
    """The name of a plug-in's kind in a sentence."""
    return f"the kind of reading '{point.name}' of {plugin_of(point).distribution}"


def _undeclared(cls: type[Codec[Any]]) -> str:
    """What a codec does not declare, or wrongly, as the end of a sentence that names it."""
    name, kind = getattr(cls, "name", None), getattr(cls, "kind", None)
    if not (isinstance(name, str) and name):
        return "does not declare its `name`"
    if not (isinstance(kind, type) and issubclass(kind, Reading) and kind is not Reading):
        return "does not declare its `kind`, a subclass of Reading"
    if not dataclasses.is_dataclass(kind) or "__dataclass_fields__" not in vars(kind):
        return f"has a `kind` that is no dataclass: {kind.__name__}"
    for member, expected in (("role", Role), ("values", Values)):
        if not isinstance(getattr(cls, member), expected):
            return f"has `{member}` that are no {expected.__name__}"
    columns = cls.Columns
    if columns is not None and not (
        isinstance(columns, type) and issubclass(columns, ColumnsConfig)
    ):
        return "has `Columns` that are no subclass of ColumnsConfig"
    return _unread(cls)


def _unread(cls: type[Codec[Any]]) -> str:
    """What a codec's messages lack, as the end of a sentence that names it."""
    if isinstance(cls.messages, str) or not all(
        isinstance(msgtype, str) and msgtype.count("/msg/") == 1 for msgtype in cls.messages
    ):
        return f"has `messages` {cls.messages!r} that are no tuple of types such as 'a_msgs/msg/B'"
    for method in ("from_message", "to_message"):
        if cls.messages and getattr(cls, method) is getattr(Codec, method):
            return f"has `messages`, and does not implement `{method}`"
    if cls.definition and not cls.messages:
        return "has a `definition`, and no `messages` that it is of"
    return ""


def _undefined(cls: type[Codec[Any]]) -> str:
    """What is wrong with the types of a codec's messages, as a sentence; empty: nothing.

    Where rosbags is missing nothing is read or written, so that nothing is checked.
    """
    try:
        types = known_types().fielddefs if cls.messages else {}
        if cls.definition:
            define(cls.messages[0], cls.definition)
    except ImportError:
        return ""
    except Exception as error:  # rosbags meets what is wrong with errors of many kinds
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        return f"the definition of {cls.messages[0]} can't be used: {reason}"
    for msgtype in cls.messages:
        if msgtype not in types:
            return f"nothing defines the type {msgtype}: {cls.__name__} needs its `definition`"
        if "header" not in (name for name, _ in types[msgtype][1]):
            return f"{msgtype} has no std_msgs/Header `header`, which holds stamp and frame"
    return ""


@functools.cache
def installed_kinds() -> Kinds:
    """The kinds of reading that are installed; found once in a process."""
    return Kinds()
