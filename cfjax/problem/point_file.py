"""The text of a file of points: from bytes to rows of cells, whatever its encoding, separators and decimal sign.

Nobody says how a CSV file is written, so every pair of separator and decimal sign is tried on its rows, and the one
that makes most numbers of them is taken. What the columns mean: `cfjax.problem.columns`.
"""

import csv
import itertools
import re
from collections.abc import Sequence
from pathlib import Path as File
from typing import NamedTuple

from cfjax.errors import InputError


SEPARATORS = (",", ";", "\t", "|", " ")  # a blank: any run of blanks and tabs
DECIMALS = (".", ",")
COMMENTS = ("#", "%", "//")
LOOKED_AT = 100  # rows from which separator and decimal sign are read off
LARGEST = 200_000_000  # bytes: more is no list of waypoints

_NUMBER = re.compile(r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.ASCII | re.IGNORECASE)
_PADDED = re.compile(r"[+-]?0\d+", re.ASCII)  # what is left of 4,0589 where the comma is taken for a separator
_MARKS = {b"PK\x03\x04": "a spreadsheet or an archive", b"\x93NUMPY": "an array of NumPy", b"PAR1": "a Parquet file"}


class Line(NamedTuple):
    number: int  # in the file, from 1
    text: str  # without the mark of a comment
    comment: bool


class Table(NamedTuple):
    """Rows of cells, the lines before them, in which their names may stand, and comments anywhere."""

    before: list[Line]
    comments: list[Line]  # below the first row, or behind cells
    numbers: list[int]  # (n,) of lines in the file
    rows: list[list[str]]  # (n,) of cells
    separator: str
    decimal: str

    @property
    def width(self) -> int:
        return max(map(len, self.rows))

    def names_in(self, line: Line) -> list[list[str]]:
        """What a line's cells may be: split as the rows are, and by every other separator."""
        text = re.sub(r"\s+(?=[\[(])", "_", line.text) if self.separator == " " else line.text
        return [_cells(text, separator) for separator in dict.fromkeys((self.separator, *SEPARATORS))]


def read_table(file: File) -> Table:
    """The rows of a text file.

    Raises:
        InputError: in one line, where the file cannot be read or holds no rows of numbers.
    """
    lines = _lines(_text(file))
    separators = SEPARATORS
    if lines and (said := re.fullmatch(r"\"?sep=(.)\"?", lines[0].text.strip(" "))):
        separators, lines = (said.group(1),), lines[1:]
    try:
        return _table(file, lines, separators)
    except csv.Error as error:
        raise InputError(f"{file}: expected a CSV file of waypoints, it cannot be read ({error})") from None


def number(cell: str, decimal: str = ".") -> float | None:
    """The number that a cell is, NaN and infinity included; None where it is none."""
    cell = cell.replace("\u2212", "-")
    if decimal == ",":
        if "." in cell:
            return None
        cell = cell.replace(",", ".")
    if not _NUMBER.fullmatch(cell) or _PADDED.fullmatch(cell):
        return None
    return float(cell)


def _table(file: File, lines: list[Line], separators: Sequence[str]) -> Table:
    rows = [line for line in lines if not line.comment]
    if not rows:
        raise InputError(f"{file}: expected at least two points, one x,y a row; the file is empty")
    sample = "".join(line.text for line in rows[:LOOKED_AT])
    ways = itertools.product(
        [each for each in separators if each in sample] or separators[:1], DECIMALS if "," in sample else DECIMALS[:1]
    )
    separator, decimal = max(ways, key=lambda way: _count_numbers(rows[:LOOKED_AT], *way))
    if not any(_count_numbers(rows[:LOOKED_AT], separator, decimal)):
        line = next((line for line in rows if any(map(str.isdecimal, line.text))), None)
        if line is None:
            text = rows[0].text.strip()[:60]
            raise InputError(f"{file}: expected at least two points, one x,y a row; the file is empty but for {text}")
        both = " (numbers with signs for thousands?)" if re.search(r"\d[.,]\d+[.,]\d", line.text) else ""
        raise InputError(
            f"{file}, row {line.number}: expected the numbers x,y or x,y,speed, or a header that names x and y; got "
            f"{line.text.strip()[:60]}{both}"
        )
    cells = [_cells(line.text, separator) for line in rows]
    first = next(i for i, row in enumerate(cells) if _numbers(row, decimal) >= 2)
    before = [line for line in lines if line.number < rows[first].number]
    comments = [line for line in lines if line.comment and line.number >= rows[first].number]
    kept = [(line.number, row) for line, row in zip(rows[first:], cells[first:], strict=True) if row]
    return Table(before, comments, [number for number, _ in kept], [row for _, row in kept], separator, decimal)


def _count_numbers(rows: list[Line], separator: str, decimal: str) -> tuple[int, float]:
    """How many rows have two numbers at least, and the part of their cells that are numbers."""
    cells = [_cells(line.text, separator) for line in rows]
    counts = [(_numbers(row, decimal), len(row)) for row in cells]
    good = [(found, width) for found, width in counts if found >= 2]
    return len(good), sum(found for found, _ in good) / max(1, sum(width for _, width in good))


def _numbers(row: list[str], decimal: str) -> int:
    return sum(number(cell, decimal) is not None for cell in row)


def _cells(text: str, separator: str) -> list[str]:
    """The cells of a line, without the empty ones at its end."""
    if separator == " ":
        text = re.sub(r"\s+", " ", text.strip())
    cells = [cell.strip() for cell in next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _lines(text: str) -> list[Line]:
    """The lines in which something stands."""
    result = []
    for index, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        bare = line.strip()
        comment = bare.startswith(COMMENTS)
        if comment:
            bare = bare.lstrip("#%/").strip(" ")  # not a tab, behind which an empty name may be the first
        elif (mark := re.search(r"\s#", line)) is not None:  # a comment behind the cells
            result.append(Line(index, line[mark.end() :].strip("# "), True))
            line = line[: mark.start()]
        if bare.strip(',;|\t "'):
            result.append(Line(index, bare if comment else line, comment))
    return result


def _text(file: File) -> str:
    try:
        if file.is_file() and file.stat().st_size > LARGEST:
            raise InputError(f"{file}: expected a CSV file of waypoints, at most {LARGEST / 1e6:g} MB, got more")
        data = file.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{file}: expected a CSV file of waypoints, there is no such file") from None
    except IsADirectoryError:
        raise InputError(f"{file}: expected a CSV file of waypoints, got a folder") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "a file's name has no zero bytes"
        raise InputError(f"{file}: expected a CSV file of waypoints, it cannot be read ({reason})") from None
    for mark, kind in _MARKS.items():
        if data.startswith(mark):
            raise InputError(f"{file}: expected a CSV file of waypoints, got {kind}: save it as CSV")
    text = _decoded(data)
    if text is None or re.search(r"[\x00-\x08\x0e-\x1f]", text):
        raise InputError(f"{file}: expected a CSV file of waypoints, it cannot be read (it is not text)")
    return text


def _decoded(data: bytes) -> str | None:
    """Text as spreadsheets and editors write it; None where it is none of theirs."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif data[1:2] == b"\0" or data[:1] == b"\0":  # UTF-16 without its mark: digits and commas have one empty byte
        encodings = ["utf-16-le" if data[1:2] == b"\0" else "utf-16-be"]
    else:
        encodings = ["utf-8-sig", "cp1252", "latin-1"]
    for encoding in encodings:
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return None
