"""Which fields of a configuration are varied, and what they are set to."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.model import Model
from contactfusion.pipeline import Pipeline
from contactfusion.units import LengthScale

LADDER = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0)
"""By default a field is set to so many times what is configured."""
JUDGES = {"modes": "condensation.existence", "cluster_mass": "condensation.mass_threshold"}
"""The field of the integrator that decides whether there is a contact, by condensation."""


@dataclass(frozen=True, slots=True)
class Varied:
    """A field that is varied.

    Attributes:
        path: e.g. "integrator.threshold".
        configured: what it is without change.
        values: all that is tried, what is configured among them.
    """

    path: str
    configured: Any
    values: tuple[Any, ...]


def override(path: str, value: Any) -> str:
    """Write a change as `--set` takes it."""
    return f"{path}={yaml.safe_dump(value).splitlines()[0]}"


def fields_to_vary(pipeline: Pipeline, vary: Sequence[str]) -> list[Varied]:
    """Give what is varied.

    Args:
        pipeline: as configured.
        vary: such as "integrator.threshold=0.1,0.2"; empty: threshold (or what stands for it),
            tolerance, timeouts and the length scales of generators, on ladders around what is
            configured.

    Raises:
        ConfigurationError: a field is unknown or named twice, or may not hold a value.
    """
    holders = _holders(pipeline)
    if not vary:
        paths = _default_paths(pipeline)
        return [one for one in (_ladder(holders, path) for path in paths) if len(one.values) > 1]
    fields = [_asked(holders, text) for text in vary]
    for number, one in enumerate(fields):
        if one.path in [other.path for other in fields[:number]]:
            raise ConfigurationError(f"'{one.path}' is to be varied twice")
    return fields


def _holders(pipeline: Pipeline) -> dict[str, Model]:
    """Give what holds fields, by the path that leads there."""
    generators = {f"generators.{name}": one.config for name, one in pipeline.generators.items()}
    integrator = {
        "integrator": pipeline.config.integrator,
        "integrator.rule": pipeline.integrator.rule.config,
        "integrator.condensation": pipeline.integrator.condensation.config,
    }
    return integrator | generators


def _default_paths(pipeline: Pipeline) -> list[str]:
    integrator = pipeline.config.integrator
    paths = [f"integrator.{JUDGES.get(integrator.condensation, 'threshold')}"]
    if integrator.condensation in ("cluster_centroid", "cluster_mass"):
        paths.append("integrator.tolerance")
    own = [name for name, one in pipeline.generators.items() if one.config.timeout is not None]
    if len(own) < len(pipeline.generators) or integrator.expiry == "voxel":
        paths.append("integrator.timeout")
    if integrator.expiry == "source":
        paths += [f"generators.{name}.timeout" for name in own]
    for name, generator in pipeline.generators.items():
        known = type(generator.config).model_fields.items()
        scales = [
            field for field, info in known if any(isinstance(m, LengthScale) for m in info.metadata)
        ]
        paths += [f"generators.{name}.{one}" for one in scales]
    return paths


def _ladder(holders: dict[str, Model], path: str) -> Varied:
    """Give the steps of a ladder that the field may hold."""
    configured = _configured(holders, path)
    values = []
    for factor in LADDER:
        value = configured if factor == 1.0 else float(f"{configured * factor:.3g}")
        try:
            _require_valid(holders, path, value)
        except ConfigurationError:
            continue
        values.append(value)
    return Varied(path, configured, tuple(values))


def _asked(holders: dict[str, Model], text: str) -> Varied:
    """Read "field=value,value"."""
    path, equals, listing = text.partition("=")
    path = path.strip()
    if not equals or not listing.strip():
        raise ConfigurationError(f"'{text}' varies nothing; write it as FIELD=value,value")
    configured = _configured(holders, path)
    values = [_value(one, text) for one in listing.split(",")]
    for value in values:
        _require_valid(holders, path, value)
    every = list(dict.fromkeys([*values, configured]))
    if all(isinstance(one, int | float) for one in every):
        every.sort()
    return Varied(path, configured, tuple(every))


def _value(text: str, whole: str) -> Any:
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        value = None
    if value is None:
        raise ConfigurationError(f"'{whole}': '{text.strip()}' is no value")
    if isinstance(value, str) and _is_number(value):
        value = float(value)  # YAML 1.1 takes 1e-3 for text
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigurationError(f"'{whole}': {text.strip()} is not a finite number")
    return value


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _configured(holders: dict[str, Model], path: str) -> Any:
    """Give what a field holds; a tolerance that is left to the integrator is two voxels.

    Raises:
        ConfigurationError: there is no such field.
    """
    holder, _, name = path.rpartition(".")
    if holder not in holders:
        hint = name_hint(holder, holders, "parts with fields")
        raise ConfigurationError(f"unknown field '{path}'; {hint}")
    model = holders[holder]
    if name not in type(model).model_fields:
        hint = name_hint(name, type(model).model_fields, "fields")
        raise ConfigurationError(f"unknown field '{path}'; {hint}")
    value = getattr(model, name)
    if path == "integrator.tolerance" and value is None and isinstance(model, IntegratorConfig):
        return model.linking_distance
    return value


def _require_valid(holders: dict[str, Model], path: str, value: Any) -> None:
    holder, _, name = path.rpartition(".")
    model = holders[holder]
    held = {field: getattr(model, field) for field in model.model_fields_set}
    try:
        type(model)(**{**held, name: value})
    except ConfigurationError as error:
        raise error.under(holder) from None
