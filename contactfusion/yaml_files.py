"""Configurations in YAML: read with errors that name line and column, changed by `--set a.b=c`."""

import copy
from collections.abc import Hashable, Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from contactfusion.errors import ConfigurationError
from contactfusion.files import require_file


def read_yaml(path: str | Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        ConfigurationError: the file is missing, is no YAML, holds a key twice, or holds something
            else than a mapping with text as keys; one sentence, with line and column.
    """
    path = Path(path)
    require_file(path, ConfigurationError)
    try:
        content = _parsed(path.read_text(encoding="utf-8"))
    except yaml.MarkedYAMLError as error:
        raise ConfigurationError(f"{path}{_position(error)}: {_problem(error)}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} is no YAML text: {_one_line(error)}") from None
    except OSError as error:
        raise ConfigurationError(f"{path} can't be read: {error.strerror}") from None
    if not isinstance(content, dict):
        held = "is empty" if content is None else f"holds a {type(content).__name__}"
        raise ConfigurationError(f"{path} {held}, where a mapping of names to values is needed")
    return content


def with_overrides(mapping: Mapping[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """A copy of a configuration in which single values are changed.

    Args:
        mapping: the configuration; it stays as it is.
        overrides: such as ``integrator.voxel_size=0.01``; the value is YAML, so that numbers,
            true and lists may be given; numbers in the path are indices of a list, from 0.

    Raises:
        ConfigurationError: one has no `=`, leads through a value that holds no others, or beyond
            the end of a list.
    """
    changed = copy.deepcopy(dict(mapping))
    for override in overrides:
        path, equals, text = override.partition("=")
        keys = path.strip().split(".")
        if not equals or not all(keys):
            raise ConfigurationError(f"'{override}' is no change; write it as name.name=value")
        try:
            value = _parsed(text)
        except yaml.YAMLError as error:
            raise ConfigurationError(f"the value of '{override}': {_problem(error)}") from None
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
    if not key.isdecimal() or int(key) >= len(items):
        raise ConfigurationError(
            f"'{override}': '{key}' is no place in a list of {len(items)}, counted from 0"
        )
    return int(key)


class _Loader(yaml.SafeLoader):
    """The safe loader; keys are text and stand once, and only true and false are booleans.

    YAML 1.1 would take `on`, `off`, `yes` and `no` for booleans, also as keys.
    """

    yaml_implicit_resolvers = {
        letter: [
            (tag, pattern)
            for tag, pattern in resolvers
            if tag != "tag:yaml.org,2002:bool" or letter in "tTfF"
        ]
        for letter, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


def _mapping(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Hashable, Any]:
    seen = set()
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode):
            if (key.tag, key.value) in seen:
                raise yaml.constructor.ConstructorError(
                    problem=f"the key '{key.value}' stands here twice", problem_mark=key.start_mark
                )
            seen.add((key.tag, key.value))
    loader.flatten_mapping(node)
    mapping = loader.construct_mapping(node, deep=True)
    for key in mapping:
        if not isinstance(key, str):
            raise yaml.constructor.ConstructorError(
                problem=f"the key {key!r} is not text; put it in quotes",
                problem_mark=node.start_mark,
            )
    return mapping


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


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
