"""Points of a path in metres, from a file or from memory; whether they are a lap: `cfjax.problem.route`."""

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from cfjax.coerce import shown
from cfjax.errors import InputError
from cfjax.problem.columns import (
    ASK,
    Meaning,
    geographic,
    is_unit,
    meaning_by_place,
    meaning_of,
    speed_unit_in,
    too_fast,
    units_in,
)
from cfjax.problem.point_file import Line, Table, number, read_table


SHORTEST, LONGEST = 1e-3, 1e5  # m along the points: beyond, a file is in other units, or asks for all of the memory

Source = str | PathLike[str] | Any


class Points(NamedTuple):
    """n points in the order in which they are driven."""

    source: str  # for messages
    row: Int[np.ndarray, " n"]  # line in the file, from 1; index in memory, from 0
    place: Complex[np.ndarray, " n"]  # x + iy in m
    speed: Float[np.ndarray, " n"] | None  # m/s
    meaning: Meaning
    in_file: bool
    widths: Float[np.ndarray, "n 2"] | None = None  # m, to the left and to the right edge

    def at(self, index: int) -> str:
        """The name of a point, for messages."""
        return f"{self.source}, row {self.row[index]}" if self.in_file else f"{self.source}[{self.row[index]}]"

    def chosen(self, index: np.ndarray) -> "Points":
        speed = None if self.speed is None else self.speed[index]
        widths = None if self.widths is None else self.widths[index]
        return self._replace(row=self.row[index], place=self.place[index], speed=speed, widths=widths)


def read_points(source: Source, columns: Sequence[str] | None = None) -> Points:
    """The points of a file; or of an array, a list of rows, a mapping or a data frame with columns by name.

    `columns` names the columns, instead of a header.

    Raises:
        InputError: says in one line what was expected, and in which row it is not so.
    """
    listed = isinstance(columns, Sequence) and not isinstance(columns, str)
    if columns is not None and not (listed and all(isinstance(name, str) for name in columns)):
        raise InputError(f"path.columns: expected a list of names, as [x,y,speed], got {shown(columns)}")
    if isinstance(source, str | PathLike):
        if not str(source).strip():
            raise InputError("points: expected the name of a file, got an empty text")
        return _of_file(File(source), columns)
    return _of_memory(source, columns)


def at(place: complex) -> str:
    return f"x = {place.real:.6g} m, y = {place.imag:.6g} m"


def metres(length: float) -> str:
    """A length for people, to three digits: 0.92 mm, 0.301 m, 22.0 m, 1800 m."""
    if length < 0.01:
        return f"{1e3 * length:.2g} mm"
    rounded = float(f"{length:.3g}")
    return f"{rounded:.{max(0, 2 - math.floor(math.log10(rounded)))}f} m"


def as_rows(place: Complex[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
    """x and y of complex numbers x + iy."""
    return np.stack([np.real(place), np.imag(place)], axis=1)


# --- from a file


def _of_file(file: File, columns: Sequence[str] | None) -> Points:
    table = read_table(file)
    try:
        meaning = _named(table, columns)
        if meaning is None:
            meaning = _unnamed(file, table)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith((str(file), "path.")) else f"{file}: {text}") from None
    points = _points(str(file), np.array(table.numbers), _values(file, table, meaning.columns), meaning, True)
    if meaning.widths is None:
        return points
    widths = _values(file, table, (*meaning.widths, None), ("the left width", "the right width"))
    return points._replace(widths=widths * np.array(meaning.width_factors))


def _named(table: Table, columns: Sequence[str] | None) -> Meaning | None:
    """What the columns mean by their names; None where they have none."""
    if columns is not None:
        if len(columns) < table.width:
            raise InputError(
                f"path.columns: expected a name for each of {table.width} columns, got {', '.join(columns)}"
            )
        return _known(columns)
    units: list[str] | None = None
    shorter: str | None = None
    for line in reversed(table.before):
        for names in table.names_in(line):
            if line.comment and names[:1] == [""] and len(names) == table.width + 1:
                names = names[1:]  # a separator behind the mark of the comment
            if any(number(name, table.decimal) is not None for name in names) or len(names) < 2:
                continue
            if len(names) == table.width and not line.comment and all(map(is_unit, names)):
                units = [name.strip("[]() ") for name in names]
                break  # they belong to the names above
            full = [*names, *[""] * (table.width - len(names))]
            if units and len(names) == len(units):
                full = [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
            if len(names) < table.width and line.comment:
                continue
            if (meaning := meaning_of(full)) is None:
                continue
            if len(names) >= table.width:
                _look_for_units(table, meaning, line)
                return meaning
            shorter = f"row {line.number} names {len(names)} columns, row {table.numbers[0]} has {table.width}"
    if shorter:
        comma = " (a decimal comma needs another separator than a comma)" if table.separator == "," else ""
        raise InputError(f"expected a name for each column, but {shorter}{comma}")
    return None


def _known(columns: Sequence[str]) -> Meaning:
    try:
        meaning = meaning_of(columns)
    except InputError as error:
        raise InputError(f"path.columns: {error}") from None
    if meaning is None:
        raise InputError(f"path.columns: expected a name for x and one for y, got {', '.join(columns)}")
    return meaning


def _unnamed(file: File, table: Table) -> Meaning:
    """What the columns mean by their place."""
    for line in table.before:
        for names in table.names_in(line):
            if problem := geographic(names):
                raise InputError(f"row {line.number}: {problem}")
    titles = [line for line in table.before if not line.comment]
    if titles or table.width > 3:
        line = titles[-1].number if titles else table.numbers[0]
        text = titles[-1].text.strip() if titles else ",".join(table.rows[0])
        raise InputError(
            f"{file}, row {line}: expected the numbers x,y or x,y,speed, or a header that names x and y; got "
            f"{text[:60]}; {ASK}"
        )
    first = [cell for row in table.rows for cell in row[:1]]
    others = [cell for row in table.rows for cell in row[1:]]
    plain = all(cell.isdecimal() for cell in first) and not all(cell.lstrip("+-").isdecimal() for cell in others)
    columns = (0, 1, 2) if table.width == 3 else (0, 1, None)
    meaning = meaning_by_place(_values(file, table, columns), plain)
    _look_for_units(table, meaning)
    return meaning


def _look_for_units(table: Table, meaning: Meaning, header: Line | None = None) -> None:
    """Raises InputError where another line than the header speaks of a unit that the columns do not have."""
    for line in (*table.before, *table.comments):
        if line is header:
            continue
        if not meaning.speed_unit and (unit := speed_unit_in(line.text)):
            raise InputError(
                f"row {line.number} speaks of {unit}: expected the unit in the name of the speed's column, as "
                f"speed_{unit} (or speed_mps, where it is in m/s), in the header or by path.columns=[...]"
            )
        if not meaning.units and (unit := units_in(line.text)):
            raise InputError(
                f"row {line.number} speaks of {unit}: expected the unit in the names of columns, as x_{unit},y_{unit} "
                "(or x_m,y_m, where they are in metres), in the header or by path.columns=[...]"
            )


def _values(
    file: File, table: Table, columns: tuple[int, int, int | None], names: tuple[str, ...] = ("x", "y", "speed")
) -> Float[np.ndarray, "n columns"]:
    """The numbers of x, y and, where there is such a column, speed."""
    labels = [(label, column) for label, column in zip(names, columns, strict=False) if column is not None]
    found = np.empty((len(table.rows), len(labels)))
    for index, (line, row) in enumerate(zip(table.numbers, table.rows, strict=True)):
        for place, (label, column) in enumerate(labels):
            cell = row[column] if column < len(row) else ""
            value = number(cell, table.decimal)
            if value is None:
                raise InputError(f"{file}, row {line}: expected a number for {label}, got {cell[:60]!r}")
            if not math.isfinite(value):
                raise InputError(f"{file}, row {line}: expected a finite number for {label}, got {cell}")
            found[index, place] = value
    return found


# --- from memory


def _of_memory(source: Any, columns: Sequence[str] | None) -> Points:
    """Rows x, y and perhaps speed; what has columns by name is read by them."""
    by_name, wide = _columns_of(source), None
    if by_name is None:
        table = _array(source)
        table = as_rows(table) if np.iscomplexobj(table) and table.ndim == 1 else table
        width = table.shape[-1] if table.ndim == 2 else 0
    else:
        table, width = None, len(by_name)
    if columns is not None and len(columns) != width:
        raise InputError(f"path.columns: expected a name for each of {width} columns, got {', '.join(columns)}")
    names = list(columns if columns is not None else by_name or ())
    meaning = None if all(name.isdecimal() for name in names) else _of_names(names)
    chosen = range(width) if meaning is None else [column for column in meaning.columns if column is not None]
    if meaning is not None and meaning.widths:
        every = list(by_name.values()) if by_name is not None else list(_array(source).T)
        wide = _array([every[column] for column in meaning.widths]).T * np.array(meaning.width_factors)
    if by_name is not None:
        parts = list(by_name.values())
        table = _array([parts[column] for column in chosen]).T
    elif meaning is not None and table is not None:
        table = table[:, list(chosen)]
    assert table is not None
    if table.ndim != 2 or np.iscomplexobj(table) or (table.shape[1] > 3 and table.shape[0] <= 3):
        hint = " (transposed?)" if table.ndim == 2 else ""
        raise InputError(
            f"points: expected the name of a file, rows x, y or x, y, speed, or columns by name; got "
            f"{type(source).__name__} of shape {table.shape}{hint}"
        )
    return _in_memory(table, meaning)._replace(widths=wide)


def _columns_of(source: Any) -> dict[str, Any] | None:
    """The columns of a mapping, a data frame or a structured array by their names; None of what has none."""
    if isinstance(source, np.ndarray):
        return None if source.dtype.names is None else {name: source[name] for name in source.dtype.names}
    names = source if isinstance(source, Mapping) else getattr(source, "columns", None)
    if isinstance(source, type) or names is None or not hasattr(source, "__getitem__"):
        return None
    return {str(name): source[name] for name in names}


def _of_names(names: Sequence[str]) -> Meaning:
    try:
        if meaning := meaning_of(names):
            return meaning
    except InputError as error:
        raise InputError(f"points: {error}") from None
    if problem := geographic(names):
        raise InputError(f"points: {problem}")
    raise InputError(f"points: expected columns that are named x and y, got {', '.join(names)[:100]}")


def _array(values: Any) -> np.ndarray:
    """Real or complex numbers."""
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "iufcOUS":
            raise TypeError
        return array.astype(complex if array.dtype.kind == "c" else float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            "points: expected the name of a file, rows of numbers x, y or x, y, speed, or columns of them by name; got "
            f"{shown(values)}"
        ) from None


def _in_memory(table: Float[np.ndarray, "n columns"], meaning: Meaning | None) -> Points:
    if len(table) < 2:
        raise InputError(f"points: expected at least two points, got {len(table)}")
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise InputError(
            f"points[{row}]: expected a finite number for {('x', 'y', 'speed')[column]}, got {table[row, column]}"
        )
    if meaning is None:
        try:
            meaning = meaning_by_place(table, False)
        except InputError as error:
            raise InputError(f"points: {error}") from None
    return _points("points", np.arange(len(table)), table, meaning, False)


# --- in metres


def _points(
    source: str, row: Int[np.ndarray, " n"], table: Float[np.ndarray, "n columns"], meaning: Meaning, in_file: bool
) -> Points:
    x, y, fast = meaning.factors
    speed = None
    if meaning.columns[2] is not None:
        speed = table[:, 2] * fast
        if problem := too_fast(meaning.used[2], float(speed.max())):
            raise InputError(f"{source}: {problem}")
    return Points(source, row, table[:, 0] * x + 1j * (table[:, 1] * y), speed, meaning, in_file)
