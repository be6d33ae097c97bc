"""Configurations in YAML: read with errors that name line and column, changed by `--set a.b=c`.

All YAML of users and recordings is read here: size, depth and what aliases expand to are bounded,
and values are text, numbers, true, false and null, in lists and mappings.
"""

import copy
from collections.abc import Hashable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from contactfusion.errors import ConfigurationError
from contactfusion.files import require_file

LARGEST: Final = 2**19
"""The greatest size of a text [bytes]."""
DEEPEST: Final = 50
"""The greatest number of lists and mappings within each other."""
MOST: Final = 100_000
"""The greatest number of values, as often as aliases name them."""


def read_yaml(path: str | Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        ConfigurationError: the file is missing, is no YAML, is larger than any, holds a key twice,
            or holds something else than a mapping with text as keys; one sentence, with line and
            column.
    """
    path = Path(path)
    require_file(path, ConfigurationError)
    try:
        if (size := path.stat().st_size) > LARGEST:
            raise ConfigurationError(f"{path} has {size} bytes, more than {LARGEST}")
        content = _parsed(path.read_text(encoding="utf-8"))
    except yaml.MarkedYAMLError as error:
        raise ConfigurationError(f"{path}{_position(error)}: {_problem(error)}") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # such as of an escape \UFFFFFFFF
        raise ConfigurationError(f"{path} is no YAML text: {_one_line(error)}") from None
    except OSError as error:
        raise ConfigurationError(f"{path} can't be read: {error.strerror}") from None
    if not isinstance(content, dict):
        held = "is empty" if content is None else f"holds a {type(content).__name__}"
        raise ConfigurationError(f"{path} {held}, where a mapping of names to values is needed")
    return content


def yaml_value(text: str, whole: str) -> Any:
    """A value in YAML.

    Args:
        text: the value.
        whole: what it stands in, for the sentence.

    Raises:
        ConfigurationError: it is no YAML.
    """
    try:
        return _parsed(text)
    except yaml.YAMLError as error:
        raise ConfigurationError(f"the value of '{whole}': {_problem(error)}") from None
    except (ValueError, OverflowError) as error:  # as above
        raise ConfigurationError(f"the value of '{whole}' is no YAML: {_one_line(error)}") from None


def require_shallow(value: Any) -> None:
    """Refuse a value that is deeper than any in YAML, such as one in JSON.

    Raises:
        ConfigurationError: it is.
    """
    level = [value]
    for _ in range(DEEPEST):
        level = [held for held in level if isinstance(held, dict | list)]
        level = [
            part for held in level for part in (held.values() if isinstance(held, dict) else held)
        ]
    if level:
        raise ConfigurationError(f"lists and mappings are more than {DEEPEST} within each other")


def with_overrides(mapping: Mapping[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """A copy of a configuration in which single values are changed.

    Args:
        mapping: the configuration; it stays as it is.
        overrides: such as ``integrator.voxel_size=0.01``; the value is YAML, so that numbers,
            true and lists may be given; numbers in the path are indices of a list, from 0.

    Raises:
        ConfigurationError: one has no `=`, leads through a value that holds no others, beyond
            the end of a list, or deeper than DEEPEST.
    """
    changed = copy.deepcopy(dict(mapping))
    for override in overrides:
        path, equals, text = override.partition("=")
        keys = path.strip().split(".")
        if not equals or not all(keys):
            raise ConfigurationError(f"'{override}' is no change; write it as name.name=value")
        if len(keys) > DEEPEST:
            raise ConfigurationError(
                f"'{override[:20]}…': mappings are more than {DEEPEST} within each other"
            )
        value = yaml_value(text, override)
        holder: Any = changed
        for depth, key in enumerate(keys):
            if isinstance(holder, list):
                index: Any = _list_index(holder, key, override)
            elif isinstance(holder, dict):
                index = key
            else:
                parent = ".".join(keys[:depth])
                raise ConfigurationError(f"'{override}': '{parent}' is {holder!r}, not a mapping")
            if depth == len(keys) - 1:
                holder[index] = value
            else:
                holder = holder.setdefault(index, {}) if isinstance(holder, dict) else holder[index]
    return changed


def _list_index(items: list[Any], key: str, override: str) -> int:
    if not key.isdecimal() or len(key) > 9 or int(key) >= len(items):
        raise ConfigurationError(
            f"'{override}': '{key}' is no place in a list of {len(items)}, counted from 0"
        )
    return int(key)


TAG: Final = "tag:yaml.org,2002:"
KINDS: Final = ("null", "bool", "int", "float", "str", "seq", "map")
"""The kinds of values that are read."""


class _Loader(yaml.SafeLoader):
    """The safe loader; keys are text and stand once, and only true and false are booleans.

    YAML 1.1 would take `on`, `off`, `yes` and `no` for booleans, also as keys, and days for dates.
    """

    yaml_implicit_resolvers = {
        letter: [
            (tag, pattern)
            for tag, pattern in resolvers
            if tag != f"{TAG}timestamp" and (tag != f"{TAG}bool" or letter in "tTfF")
        ]
        for letter, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    yaml_constructors = {
        tag: yaml.SafeLoader.yaml_constructors[tag]
        for tag in (
            None,
            *(f"{TAG}{kind}" for kind in ("null", "bool", "int", "float", "str", "seq")),
        )
    }

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = self._count = 0
        self._sizes: dict[int, int] = {}
        """By the node's id, when it is whole: number of values in it, as aliases repeat them."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """A node of bounded depth and size."""
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]  # of PyYAML's parser
        mark = event.start_mark
        self._depth += 1
        if self._depth > DEEPEST:
            raise _refused(f"lists and mappings are more than {DEEPEST} within each other", mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if node is None or id(node) in self._sizes:
            return node
        if isinstance(node, yaml.CollectionNode) and node.end_mark is None:
            raise _refused("an alias names what it stands in", mark)
        held: Any = node.value if isinstance(node, yaml.CollectionNode) else ()
        parts = [part for item in held for part in (item if isinstance(item, tuple) else (item,))]
        self._sizes[id(node)] = size = 1 + sum(self._sizes[id(part)] for part in parts)
        self._count += 1
        if max(size, self._count) > MOST:
            raise _refused(f"it holds more than {MOST} values", mark)
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """The value of a node; what has no value, such as a number of 5,000 digits, is refused."""
        try:
            return super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except (ValueError, LookupError, AttributeError, TypeError, ArithmeticError) as error:
            text = str(node.value)[:20]
            problem = f"'{text}' is no {node.tag.split(':')[-1]}: {error}"
            raise _refused(problem, node.start_mark) from None


def _refused(problem: str, mark: Any) -> yaml.constructor.ConstructorError:
    return yaml.constructor.ConstructorError(problem=problem, problem_mark=mark)


def _mapping(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Hashable, Any]:
    seen = set()
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode):
            if (key.tag, key.value) in seen:
                raise _refused(f"the key '{key.value}' stands here twice", key.start_mark)
            seen.add((key.tag, key.value))
    loader.flatten_mapping(node)
    mapping = loader.construct_mapping(node, deep=True)
    for key in mapping:
        if not isinstance(key, str):
            raise _refused(f"the key {key!r} is not text; put it in quotes", node.start_mark)
    return mapping


_Loader.add_constructor(f"{TAG}map", _mapping)


def _parsed(text: str) -> Any:
    return yaml.load(text, _Loader)


def _position(error: yaml.MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    return f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""


def _problem(error: yaml.YAMLError) -> str:
    if not isinstance(error, yaml.MarkedYAMLError):
        return _one_line(error)
    problem = " ".join(filter(None, (error.context, error.problem)))
    return f"{problem}; indent with spaces, not tabs" if "'\\t'" in problem else problem


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
