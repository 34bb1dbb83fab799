"""Reading a file that may be anything: JSON with exact numbers only, every shape and size checked before it is used.

Rationals are strings, "p/q" in lowest terms or "p"; a file with a floating-point number, NaN, a key that stands twice
or nesting without end is refused. Nothing here trusts the file; what it lets through is small enough to compute with.
"""

import json
import lzma
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from flint import fmpq


LARGEST_FILE = 32 * 2**20  # bytes; a circle's certificate takes about 0.2 MB, each stretch of a curve 0.3 MB
UNPACKING_MEMORY = 80 << 20  # of an .xz file: its strongest preset asks for 65 MB
LONGEST_NUMBER = 400  # decimal digits of a numerator or denominator
LONGEST_TEXT = 64
RATIONAL = re.compile(r"-?[0-9]+(/[0-9]+)?")
LABEL = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
TEXT = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_. :-]*[A-Za-z0-9_.])?")


class Unreadable(ValueError):
    """The file is no certificate that this checker can read: one line that says where and why."""


class Broken(ValueError):
    """A claim of the file is not true, or its proof does not prove it: one line that says which."""


@dataclass(frozen=True)
class Item:
    """A value of the file and the place where it stands."""

    value: object
    where: str

    def refuse(self, expected: str) -> NoReturn:
        given = type(self.value).__name__
        if isinstance(self.value, (str, int)):
            text = self.value if isinstance(self.value, str) else str(self.value)
            given = ascii(text[:40]) + ("..." if len(text) > 40 else "")
        raise Unreadable(f"{self.where}: expected {expected}, got {given}")

    def record(self, *names: str) -> list["Item"]:
        """The fields of an object that has exactly these."""
        if not isinstance(self.value, dict):
            self.refuse(f"an object with {', '.join(names)}")
        if self.value.keys() != set(names):
            odd = sorted(self.value.keys() ^ set(names))[0]
            what = "missing" if odd in names else "unknown"
            place = f"{self.where}: " if self.where else ""
            raise Unreadable(f"{place}field {odd[:LONGEST_TEXT]!a} is {what}")
        return [Item(self.value[name], f"{self.where}.{name}" if self.where else name) for name in names]

    def optional(self, name: str) -> tuple[str, ...]:
        """The name of a field that may be missing, where it is there."""
        return (name,) if isinstance(self.value, dict) and name in self.value else ()

    def entries(self, most: int, least: int = 1) -> list[tuple[str, "Item"]]:
        """Names and values of an object with names of its own."""
        if not isinstance(self.value, dict) or not least <= len(self.value) <= most:
            self.refuse(f"an object with {least} to {most} fields")
        return [(Item(k, self.where).label(), Item(v, f"{self.where}.{k}")) for k, v in self.value.items()]

    def items(self, most: int, least: int = 1) -> list["Item"]:
        if not isinstance(self.value, list) or not least <= len(self.value) <= most:
            size = f" (it has {len(self.value)})" if isinstance(self.value, list) else ""
            self.refuse(f"a list of {most if least == most else f'{least} to {most}'} entries{size}")
        return [Item(value, f"{self.where}[{k}]") for k, value in enumerate(self.value)]

    def integer(self, least: int, most: int) -> int:
        if not isinstance(self.value, int) or isinstance(self.value, bool) or not least <= self.value <= most:
            self.refuse(f"a whole number between {least} and {most}" if most < 10**9 else "a whole number")
        return self.value

    def integers(self, count: int, least: int, most: int) -> tuple[int, ...]:
        """So many whole numbers: the one kind of list that is long."""
        values = self.value
        if isinstance(values, list) and len(values) == count and set(map(type, values)) == {int}:
            found = tuple(values)
            if least <= min(found) and max(found) <= most:
                return found
        return tuple(entry.integer(least, most) for entry in self.items(count, count))

    def text(self) -> str:
        if not isinstance(self.value, str) or len(self.value) > LONGEST_TEXT or not TEXT.fullmatch(self.value):
            self.refuse(f"a name of at most {LONGEST_TEXT} plain characters")
        return self.value

    def label(self) -> str:
        """A name that stands in a sentence without quotes."""
        if not isinstance(self.value, str) or len(self.value) > LONGEST_TEXT or not LABEL.fullmatch(self.value):
            self.refuse(f"a name of at most {LONGEST_TEXT} letters, digits and _ . -")
        return self.value

    def choice(self, *allowed: str) -> str:
        if not isinstance(self.value, str) or self.value not in allowed:
            self.refuse(f"one of {', '.join(allowed)}")
        return self.value

    def rational(self) -> fmpq:
        written = self.value if isinstance(self.value, str) and len(self.value) <= 2 * LONGEST_NUMBER + 2 else ""
        if not RATIONAL.fullmatch(written):
            self.refuse('a rational as a string "p" or "p/q"')
        above, _, below = written.partition("/")
        if max(len(above), len(below)) > LONGEST_NUMBER or (below and not int(below)):
            self.refuse("a rational of moderate length with a denominator that is not zero")
        number = fmpq(int(above), int(below or 1))
        if str(number) != written:
            self.refuse("a rational in lowest terms")
        return number

    def positive(self) -> fmpq:
        number = self.rational()
        if not number > 0:
            self.refuse("a positive rational")
        return number


def read_json(path: Path) -> object:
    """The file's JSON value; a name that ends in .xz is unpacked.

    Raises:
        Unreadable: no such file, too large, not UTF-8, not JSON, or JSON of a kind that is refused here.
    """
    try:
        if not path.is_file():
            raise Unreadable(f"no such file: {path}")
        if path.stat().st_size > LARGEST_FILE:
            raise Unreadable(f"the file has more than {LARGEST_FILE >> 20} MB")
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
        if path.suffix == ".xz":
            content = lzma.LZMADecompressor(memlimit=UNPACKING_MEMORY).decompress(content, LARGEST_FILE + 1)
        return parse_json(content)
    except (lzma.LZMAError, EOFError):
        raise Unreadable(f"cannot unpack {path}") from None
    except MemoryError:
        raise Unreadable(f"{path} asks for more memory than there is") from None
    except OSError as error:
        raise Unreadable(f"cannot read {path}: {error.strerror or type(error).__name__}") from None


def parse_json(content: bytes) -> object:
    """As `read_json`, for the content of a file."""
    if len(content) > LARGEST_FILE:
        raise Unreadable(f"the file has more than {LARGEST_FILE >> 20} MB")
    try:
        return json.loads(
            content.decode("utf-8"),
            parse_float=_refuse_number,
            parse_constant=_refuse_number,
            object_pairs_hook=_object,
        )
    except UnicodeDecodeError:
        raise Unreadable("not a text file in UTF-8") from None
    except json.JSONDecodeError as error:
        raise Unreadable(f"not JSON: {error.msg} at line {error.lineno}, column {error.colno}") from None
    except RecursionError:
        raise Unreadable("not a certificate: nested too deeply") from None
    except Unreadable:
        raise
    except ValueError:  # of Python's own limit on the digits of a whole number
        raise Unreadable("a whole number has too many digits") from None


def _refuse_number(token: str) -> NoReturn:
    raise Unreadable(f"expected exact numbers only, got {token[:LONGEST_TEXT]}")


def _object(pairs: list[tuple[str, object]]) -> dict[str, object]:
    result = dict(pairs)
    if len(result) != len(pairs):
        seen: set[str] = set()
        twice = next(name for name, _ in pairs if name in seen or seen.add(name))
        raise Unreadable(f"the field {twice[:LONGEST_TEXT]!a} stands twice in one object")
    return result
