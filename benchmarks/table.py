"""The table of the benchmark: what was measured, what is asked, and whether it is met."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.interleave import Spread
from contactfusion.files import write_whole


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        name: what was measured.
        measured: the median, and the range of the rounds.
        unit: of the numbers.
        asked: the number to reach, or None where nothing is asked.
        at_least: whether the measured number is to be at least, rather than at most, that.
    """

    name: str
    measured: Spread
    unit: str
    asked: float | None = None
    at_least: bool = False

    @property
    def met(self) -> bool | None:
        """Whether the median reaches what is asked."""
        if self.asked is None:
            return None
        if self.at_least:
            return self.measured.median >= self.asked
        return self.measured.median <= self.asked

    def __str__(self) -> str:
        """Give the line."""
        spread, unit = self.measured, self.unit
        wanted = "" if self.asked is None else f"{'≥' if self.at_least else '≤'} {self.asked:g}"
        verdict = {True: "met", False: "NOT MET", None: ""}[self.met]
        value = f"{spread.median:9.3g} {unit:<9} {spread.low:9.3g} - {spread.high:<9.3g}"
        return f"{self.name:<58}{value} {wanted:<8} {verdict}".rstrip()


def write_json(path: Path, rows: Sequence[Row], versions: dict[str, str]) -> None:
    """Write the table, whole or not at all."""
    table = [{**asdict(row), "met": row.met} for row in rows]
    write_whole(path, json.dumps({"versions": versions, "rows": table}, indent=1) + "\n")
