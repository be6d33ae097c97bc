"""The report of `identify`: values with standard errors, and what was not identifiable."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from contactfusion.model import Model

DIGITS = 4
"""Significant digits of values in a file."""


@dataclass(eq=False)
class Identification:
    """What is identified of the generators of a configuration.

    Attributes:
        fields: for the field `identified` of a configuration.
        lines: the values, with standard errors.
        kept: a sentence on each value that the motion does not excite, and that stays as it was.
        warnings: a sentence on each cause for doubt.
    """

    fields: dict[str, Any] = field(default_factory=lambda: {"robot": {}, "generators": {}})
    lines: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def report(self) -> Iterator[str]:
        """The report, line by line."""
        yield from self.lines
        yield from (f"stays as configured: {sentence}" for sentence in self.kept)
        yield from (f"warning: {sentence}" for sentence in self.warnings)


def stated(value: float, error: float | None, unit: str) -> str:
    """A value with its standard error; None: it is as configured; NaN: its error is unknown."""
    if error is None:
        return f"({value:.4g} {unit})"
    if error != error:
        return f"{value:.4g} {unit}"
    return f"{value:.4g} ± {error:.2g} {unit}"


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows with aligned columns, each two spaces in."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  " + "  ".join(map(str.ljust, row, widths)).rstrip()  # a row has as many cells
        for row in rows
    ]


def plain(config: Model) -> dict[str, Any]:
    """A configuration as plain values, rounded."""
    return {name: rounded(value) for name, value in config.model_dump().items()}


def rounded(value: Any) -> Any:
    """A value, with the numbers in it rounded to significant digits."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, list | tuple):
        return [rounded(each) for each in value]
    return value
