"""Columns of numbers from text tables (CSV and the like) and from NumPy files."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.errors import RecordingError, name_hint
from contactfusion.files import BROKEN, require_file
from contactfusion.readings.columns import Column
from contactfusion.unpacking import require_arrays

Columns = dict[Column, NDArray[Any]]
"""By column: its values, shape (n, 1), or (n, k) for an array of several columns in an .npz."""


class TextFormat(NamedTuple):
    """The layout of a text table.

    Attributes:
        delimiter: between cells; None: the first of tab, `;` and `,` in the first line, else white
            space.
        header: whether the first line has names; None: if no cell of it is a number.
    """

    delimiter: str | None = None
    header: bool | None = None


AS_FOUND = TextFormat()
PACKED = (".gz", ".bz2", ".xz", ".lzma")
"""Suffixes of files that NumPy would unpack."""


def read_columns(
    path: Path,
    columns: Sequence[Column],
    dtype: type[np.floating[Any]] = np.float64,
    text: TextFormat = AS_FOUND,
) -> Columns:
    """Some columns of a table.

    In text, `#` starts a comment, empty lines are skipped and an empty cell is NaN. In an
    `.npz` columns are arrays by name, in an `.npy` columns by number, or fields by name.

    Args:
        path: the file; `.npy` and `.npz` are NumPy's, all others are text.
        columns: the wanted columns.
        dtype: the type of the numbers.
        text: the layout of text.

    Raises:
        RecordingError: the file is missing, cut off or empty, a column is unknown, or a cell is
            not a number.
    """
    require_file(path, RecordingError)
    if path.suffix.lower() in (".npy", ".npz"):
        found = _numpy_columns(path, columns, dtype)
    else:
        found = _text_columns(path, columns, dtype, text)
    counts = {column: len(values) for column, values in found.items()}
    if len(set(counts.values())) > 1:
        lengths = ", ".join(f"{_named(column)} {count}" for column, count in counts.items())
        raise RecordingError(f"{path} holds arrays of unequal lengths: {lengths}")
    if 0 in counts.values():
        raise RecordingError(f"{path} holds no rows")
    return found


def column_names(path: Path) -> list[Column]:
    """The columns of a table, in their order: by name, or by number where the name is not unique.

    Raises:
        RecordingError: the file is missing, cut off or empty.
    """
    require_file(path, RecordingError)
    if path.suffix.lower() in (".npy", ".npz"):
        return _numpy_names(path)
    layout = _layout(path, AS_FOUND)
    names = layout.names or [""] * layout.width
    return [
        name if name and len(layout.places[name]) == 1 else number
        for number, name in enumerate(names, 1)
    ]


@dataclass(frozen=True)
class _Layout:
    delimiter: str | None
    skip: int
    names: list[str]
    width: int

    @cached_property
    def places(self) -> Mapping[str, list[int]]:
        """By name: the columns that have it, counted from 0."""
        found: dict[str, list[int]] = {}
        for place, name in enumerate(self.names):
            found.setdefault(name, []).append(place)
        return found

    def cells(self, line: str) -> list[str]:
        if self.delimiter is None:
            cells = line.split()
            quoted = next(csv.reader([" ".join(cells)], delimiter=" ")) if '"' in line else cells
            return quoted if len(quoted) < len(cells) else cells  # names keep their quotes
        return next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True))


def _text_columns(
    path: Path,
    columns: Sequence[Column],
    dtype: type[np.floating[Any]],
    text: TextFormat,
) -> Columns:
    layout = _layout(path, text)
    indices = [_index(path, layout, column) for column in columns]
    read = partial(
        np.loadtxt,
        path,
        dtype,
        delimiter=layout.delimiter,
        skiprows=layout.skip,
        usecols=indices,
        ndmin=2,
        encoding="utf-8-sig",
        quotechar='"',
    )
    try:
        if _require_even(path, columns, indices, layout):
            rows = (layout.cells(line) for _, line in _rows(path, layout))
            cells = (_number(row[index], dtype) for row in rows for index in indices)
            table = np.fromiter(cells, dtype).reshape(-1, len(indices))
        else:
            try:
                table = read()
            except ValueError:  # an empty cell, or a bad one; converting each is five times slower
                table = read(converters=lambda cell: _number(cell, dtype))
    except UnicodeDecodeError:
        raise RecordingError(f"{path} is no text in UTF-8") from None
    except (ValueError, csv.Error) as error:
        found = "" if isinstance(error, csv.Error) else _bad_cell(path, columns, indices, layout)
        raise RecordingError(found or f"{path}: {error}") from None
    return {column: table[:, [index]] for index, column in enumerate(columns)}


def _layout(path: Path, text: TextFormat) -> _Layout:
    if path.suffix in PACKED:
        raise RecordingError(
            f"{path} is compressed by its name: unpack it, or rename it where it is text"
        )
    try:
        return _laid_out(path, text)
    except UnicodeDecodeError:
        raise RecordingError(f"{path} is no text in UTF-8") from None
    except csv.Error as error:
        raise RecordingError(f"{path} is no table: {error}") from None


def _laid_out(path: Path, text: TextFormat) -> _Layout:
    delimiter, header = text
    lines = _lines(path)
    number, line = next(lines, (0, ""))
    if delimiter is None:
        delimiter = next((mark for mark in "\t;," if mark in line), None)
    first = _Layout(delimiter, 0, [], 0).cells(line) if line else []
    if header is None:
        header = not any(_is_number(cell) for cell in first)
    row_number, row = next(lines, (0, "")) if header else (number, line)
    if not row:
        raise RecordingError(f"{path} holds no rows")
    cells = _Layout(delimiter, 0, [], 0).cells(row)
    if header and len(cells) > len(first) and any(cell.strip() for cell in cells[len(first) :]):
        raise RecordingError(
            f"{path}, line {row_number}: {len(cells)} cells under {len(first)} names; "
            "are commas meant as decimal points?"
        )
    names = [cell.strip() for cell in first] if header else []
    return _Layout(delimiter, number if header else 0, names, len(first))


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines with cells, with their numbers from 1."""
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file, 1):
            line = line.partition("#")[0].rstrip("\n")
            if line.strip():
                yield number, line


def _number(cell: str, dtype: type[np.floating[Any]] = np.float64) -> np.floating[Any]:
    """The number in a cell; NaN where it is empty.

    Raises:
        ValueError: it is none, or one of Python alone, such as `1_000` and digits of other scripts.
    """
    text = cell.strip() or "nan"
    if "_" in text or not text.isascii():
        raise ValueError
    return dtype(text)


def _is_number(cell: str) -> bool:
    try:
        _number(cell)
    except ValueError:
        return False
    return bool(cell.strip())


def _index(path: Path, layout: _Layout, column: Column) -> int:
    if isinstance(column, int):
        if not 1 <= column <= layout.width:
            raise RecordingError(f"{path} has columns 1 to {layout.width}, not {column}")
        return column - 1
    if not layout.names:
        raise RecordingError(
            f"{path} has no header that names column '{column}': give its number, from 1"
        )
    match layout.places.get(column, []):
        case []:
            hint = name_hint(column, filter(None, layout.names), "columns")
            raise RecordingError(f"{path} has no column '{column}'; {hint}")
        case [place]:
            return place
        case places:
            raise RecordingError(
                f"{path} has {len(places)} columns '{column}': give a number, from 1"
            )


def _require_even(
    path: Path, columns: Sequence[Column], indices: Sequence[int], layout: _Layout
) -> bool:
    """Refuse a row with other columns than the first line.

    Returns:
        Whether NumPy would part cells elsewhere: at double blanks, or at a quote that comes after a
        blank or stays open.

    Raises:
        RecordingError: there is one, or a quote in a table of white space stays open.
    """
    mark, least = layout.delimiter, layout.width
    parts_otherwise = mark == " "
    late = re.compile(f'(?:^|{re.escape(mark or "")}) +"')
    while least and layout.names and not layout.names[least - 1]:
        least -= 1  # names of which the last are empty end with delimiters, rows need not
    for number, line in _rows(path, layout):
        is_quoted = '"' in line
        if mark not in (None, " ") and not is_quoted and line.count(mark) + 1 == layout.width:
            continue
        cells = layout.cells(line)
        while len(cells) > layout.width and not cells[-1].strip():
            cells.pop()
        if is_quoted and mark is None and _stays_open(line):
            raise RecordingError(f"{path}, line {number}: a quote stays open")
        if is_quoted and (line.count('"') % 2 or (' "' in line and late.search(line))):
            parts_otherwise = mark is not None
        if least <= len(cells) <= layout.width and max(indices, default=0) < len(cells):
            continue
        end = _cut_off(path, number)
        for column, index in zip(columns, indices, strict=True):
            if index >= len(cells):
                lacks = f"column {_named(column)} is missing: the line has {len(cells)} cells"
                raise RecordingError(f"{path}, line {number}: {lacks}{end}")
        above = f"{layout.width} names" if layout.names else f"{layout.width} in the first line"
        hint = "; are commas meant as decimal points?" if mark == "," and not end else ""
        raise RecordingError(f"{path}, line {number}: {len(cells)} cells under {above}{end}{hint}")
    return parts_otherwise


def _stays_open(line: str) -> bool:
    """Whether the last cell of a line, parted at white space, goes on in the next line."""
    *_, last = next(csv.reader([" ".join(line.split()) + "\n"], delimiter=" "))
    return last.endswith("\n")


def _bad_cell(
    path: Path, columns: Sequence[Column], indices: Sequence[int], layout: _Layout
) -> str | None:
    """The sentence on the first cell that is no number."""
    for number, line in _rows(path, layout):
        cells = layout.cells(line)
        for column, index in zip(columns, indices, strict=True):
            if cells[index].strip() and not _is_number(cells[index]):
                end = _cut_off(path, number)
                where = f"{path}, line {number}: column {_named(column)}"
                is_decimal = _is_number(cells[index].replace(",", ".", 1))
                hint = "; is its comma meant as a decimal point?" if is_decimal else ""
                return f"{where} holds '{cells[index]}', not a number{hint}{end}"
    return None


def _rows(path: Path, layout: _Layout) -> Iterator[tuple[int, str]]:
    """The lines with cells below the header, with their numbers from 1."""
    return (line for line in _lines(path) if line[0] > layout.skip)


def _cut_off(path: Path, number: int) -> str:
    """The clause that the file is cut off, when the bad line is its last and does not end."""
    lines = path.read_text(encoding="utf-8-sig").split("\n")
    return "; the file is cut off there: remove that line" if number == len(lines) else ""


def _numpy_names(path: Path) -> list[Column]:
    try:
        require_arrays(path)
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            if not isinstance(loaded, np.ndarray):
                return list(loaded.files)
            width = loaded.shape[1] if loaded.ndim == 2 else loaded[:1].size
            return list(loaded.dtype.names or range(1, width + 1))
    except BROKEN as error:
        raise _broken(path, error) from None


def _broken(path: Path, error: Exception) -> RecordingError:
    return RecordingError(f"{path} is cut off, or holds no NumPy arrays: {error}")


def _numpy_columns(path: Path, columns: Sequence[Column], dtype: type[np.floating[Any]]) -> Columns:
    try:
        require_arrays(path)
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                return {column: _array_column(path, loaded, column, dtype) for column in columns}
            for column in columns:
                if column not in loaded.files:
                    hint = name_hint(str(column), loaded.files, "arrays")
                    raise RecordingError(f"{path} has no array {_named(column)}; {hint}")
            return {column: _numbers(path, loaded[column], column, dtype) for column in columns}
    except BROKEN as error:
        raise _broken(path, error) from None


def _array_column(
    path: Path, array: NDArray[Any], column: Column, dtype: type[np.floating[Any]]
) -> NDArray[Any]:
    if isinstance(column, str):
        names = array.dtype.names or ()
        if column not in names:
            hint = name_hint(column, names, "fields")
            raise RecordingError(f"{path} has no field '{column}'; {hint}")
        return _numbers(path, array[column], column, dtype)
    table = array if array.ndim == 2 else array.reshape(len(array) if array.ndim else 1, -1)
    if not 1 <= column <= table.shape[1]:
        raise RecordingError(f"{path} has columns 1 to {table.shape[1]}, not {column}")
    return _numbers(path, table[:, column - 1], column, dtype)


def _numbers(
    path: Path, array: NDArray[Any], column: Column, dtype: type[np.floating[Any]]
) -> NDArray[Any]:
    if array.ndim == 0 or array.dtype.kind not in "biuf":
        raise RecordingError(
            f"{path}: {_named(column)} is no array of numbers, one row a sample, "
            f"but of {array.dtype} and shape {array.shape}"
        )
    return array.reshape(len(array), -1 if array.size else 1).astype(dtype)


def _named(column: Column) -> str:
    return str(column) if isinstance(column, int) else f"'{column}'"
