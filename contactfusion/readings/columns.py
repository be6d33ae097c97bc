"""The columns of a log that make a reading: the base of what each kind of reading takes."""

import math
import re
from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, field_validator

from contactfusion.arrays import FloatArray
from contactfusion.model import Model
from contactfusion.readings.reading import At, Reading

Column = int | str
"""A column by its number, counted from 1, or by its name."""
RANGE = re.compile(r"(.*?)(\d{1,18})\.\.(.*?)(\d{1,18})")
MOST = 10_000
"""The greatest number of columns of a range, and of a reading."""
LONGEST = 500
"""The greatest length of a range, of which every column repeats the name [characters]."""


def _columns(value: Any) -> Any:
    """Take one column or a list of them, and write ranges out."""
    columns: list[Any] = []
    for item in value if isinstance(value, list | tuple) else [value]:
        columns += written_out(item)
        if len(columns) > MOST:
            raise ValueError(f"a reading has more than {MOST} columns")
    return tuple(columns)


def written_out(item: Any) -> list[Any]:
    """Write out ``p0..p14`` or ``7..18``: the names, or the numbers, from the first to the last."""
    if isinstance(item, str) and ".." in item and len(item) > LONGEST:
        raise ValueError(f"'{item[:20]}…' is a range of more than {LONGEST} characters")
    ends = RANGE.fullmatch(item) if isinstance(item, str) else None
    if ends is None:
        return [item]
    before, first, before_last, last = ends.groups()
    if before != before_last or int(last) < int(first):
        raise ValueError(f"'{item}' is no range: write it as p0..p14 or 7..18")
    numbers = range(int(first), int(last) + 1)
    if int(last) - int(first) >= MOST:
        raise ValueError(f"'{item}' is more than {MOST} columns")
    return [f"{before}{number:0{len(first)}}" if before else number for number in numbers]


def _factors(value: Any) -> Any:
    """Take one factor or one for each column; ``deg`` turns degrees into radians."""
    factors = value if isinstance(value, list | tuple) else [value]
    if 0 in factors:
        raise ValueError("a factor of 0 leaves nothing of what is measured")
    return tuple(RADIANS if factor == "deg" else factor for factor in factors)


RADIANS = math.pi / 180.0
"""Of a degree."""
SOME = "not every column is an angle: give a factor for each, such as [1, deg]"


class ColumnsConfig(Model):
    """The columns that make one sensor's readings; a subclass for each kind of reading."""

    type: str
    """The kind of the readings."""
    frame: str = Field(min_length=1)
    """The frame in which the values are given."""
    columns: Annotated[tuple[Column, ...], BeforeValidator(_columns)] = Field(min_length=1)
    """Columns by name or by number from 1; `p0..p14` stands for all from p0 to p14."""
    scale: Annotated[tuple[float, ...], BeforeValidator(_factors)] = (1.0,)
    """What brings the columns to SI units: one factor, or one a column; `deg` for degrees."""
    gaps: ClassVar[bool] = False
    """Whether a value may be missing."""
    angles: ClassVar[Literal["all", "some", "none"]] = "all"
    """Which columns may be angles: `deg` makes sense for all, for some by themselves, or none."""

    @field_validator("scale", mode="before")
    @classmethod
    def _of_angles(cls, value: Any) -> Any:
        factors = value if isinstance(value, list | tuple) else [value]
        if cls.angles == "none" and "deg" in factors:
            raise ValueError("no column is an angle")
        if cls.angles == "some" and value == "deg":
            raise ValueError(SOME)
        return value

    def counts(self) -> tuple[int, ...]:
        """The numbers of values that make a reading; empty: any."""
        return ()

    @abstractmethod
    def reading(self, at: At, row: FloatArray) -> Reading:
        """The reading of one row of a log.

        Args:
            at: its stamp, frame and sensor.
            row: shape (n,), its values in SI units.

        Raises:
            InvalidReadingError: no sensor can have given these values.
        """
