"""The base of every configuration, which refuses unknown fields."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from contactfusion.errors import ConfigurationError, DefaultError, name_hint
from contactfusion.files import file_in
from contactfusion.units import unit_of


class Model(BaseModel):
    """A frozen configuration without unknown fields or NaN.

    Raises:
        ConfigurationError: a field is unknown, missing, or has an invalid value; one sentence.
        DefaultError: the class refuses one of its own defaults.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
        validate_default=True,
    )

    def __init__(self, /, **fields: object) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            for detail in error.errors():
                if _is_default(detail, fields):
                    wrong = _wrong(detail, type(self))
                    raise DefaultError(wrong.problem, wrong.path) from None
            raise explained(error, type(self)) from None


M = TypeVar("M", bound=Model)
FILES_WITHIN = "files_within"
"""The field of a configuration that bounds the location of its files."""


def rooted(config: M, folder: Path, within: Path | None = None) -> M:
    """A configuration whose relative file names are rooted at a folder, also in nested models.

    Names in lists and mappings stay as they are, for their holders to root; their bounds are
    checked all the same.

    Args:
        config: any.
        folder: that of relative file names.
        within: the folder that all files have to lie in, which fields `files_within` then hold,
            too; None: no limit.

    Raises:
        ConfigurationError: a file lies elsewhere.
    """
    changes: dict[str, Any] = {}
    for name in type(config).model_fields:
        value = getattr(config, name)
        if name == "folder" and value == Path():  # a default, no name that could lead elsewhere
            changes[name] = folder
        elif name == FILES_WITHIN and within is not None:
            changes[name] = within
        elif isinstance(value, dict):
            found = {key: _rooted(value[key], folder, within, f"{name}.{key}") for key in value}
            changes[name] = {
                key: found[key] if isinstance(item, Model) else item for key, item in value.items()
            }
        elif isinstance(value, list | tuple):
            for number, item in enumerate(value):
                _rooted(item, folder, within, f"{name}.{number}")
        else:
            changes[name] = _rooted(value, folder, within, name)
    return config.model_copy(update=changes)


def _rooted(value: Any, folder: Path, within: Path | None, path: str) -> Any:
    try:
        match value:
            case Path():
                return file_in(folder, value, within)
            case Model():
                return rooted(value, folder, within)
            case _:
                return value
    except ConfigurationError as error:
        raise error.under(path) from None


def explained(error: ValidationError, model: type[BaseModel]) -> ConfigurationError:
    """The sentence on the wrong field, and on the name that was probably meant."""
    details = sorted(error.errors(), key=lambda detail: detail["type"] != "extra_forbidden")
    return ConfigurationError.of([f for d in details for f in _wrong(d, model).faults])


def _is_default(detail: ErrorDetails, given: Mapping[str, object]) -> bool:
    """Whether a field was not given, and its default is invalid."""
    return (
        detail["type"] != "missing" and bool(detail["loc"]) and str(detail["loc"][0]) not in given
    )


def _wrong(detail: ErrorDetails, model: type[BaseModel]) -> ConfigurationError:
    path = ".".join(str(part) for part in detail["loc"])
    match detail["type"]:
        case "extra_forbidden":
            known = _fields_at(model, detail["loc"][:-1])
            hint = name_hint(str(detail["loc"][-1]), known, "fields")
            return ConfigurationError(f"unknown field; {hint}", path)
        case "missing":
            return ConfigurationError("this field is required", path)
        case "value_error":
            cause = detail.get("ctx", {})["error"]
            if isinstance(cause, ConfigurationError):
                return cause.under(path)
            return ConfigurationError(str(cause), path)
        case "path_type":
            return ConfigurationError(f"must be a path, not {detail['input']!r}", path)
        case "less_than_equal" | "greater_than_equal" if problem := _implausible(detail, model):
            return ConfigurationError(problem, path)
        case _:
            message = detail["msg"][0].lower() + detail["msg"][1:]
            return ConfigurationError(f"{message}, not {detail['input']!r}", path)


def _implausible(detail: ErrorDetails, model: type[BaseModel]) -> str:
    """The sentence on the unit of a number beyond its limit; empty where only its sign is wrong."""
    field, limits = model.model_fields.get(str(detail["loc"][0])), detail.get("ctx", {})
    unit = unit_of(field) if field else None
    limit = limits.get("le") or limits.get("ge")
    return unit.implausible(float(detail["input"]), limit) if unit and limit else ""


def _fields_at(model: type[BaseModel], path: tuple[int | str, ...]) -> list[str]:
    """The fields of the model at a path."""
    for part in path:
        field = model.model_fields.get(str(part))
        annotation = field.annotation if field else None
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            model = annotation
    return list(model.model_fields)
