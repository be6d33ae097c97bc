"""Ranges from which scenes draw values."""

from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator

Range = tuple[float, float]


def _range(value: Any) -> Any:
    """A range; a number is a range of one value."""
    return (value, value) if isinstance(value, int | float) else value


def _ordered(value: Range) -> Range:
    if value[1] < value[0]:
        raise ValueError("give the least, then the greatest")
    return value


AnyRange = Annotated[Range, BeforeValidator(_range), AfterValidator(_ordered)]
