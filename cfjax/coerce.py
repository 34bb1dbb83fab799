"""What was given, as what is meant: numbers, lists, names and objects, where public constructors and functions begin.

A value that is clearly meant comes back in the form in which it is kept: `np.float32(1)` and 1 as 1.0, a list as a
tuple, "tt" as `Method.TT`. Anything else is an `InputError` of one line: the value's name, what to write, and what was
given.
"""

import enum
import math
import numbers as abstract
import os
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Never, SupportsFloat, TypeVar

import numpy as np

from cfjax.errors import InputError, meant


T = TypeVar("T")
E = TypeVar("E", bound=enum.Enum)

if TYPE_CHECKING:
    Number = SupportsFloat  # an int, a float, or a scalar of NumPy or JAX; no text, no truth value
    Numbers = Sequence[Any] | np.ndarray  # a list, a tuple or an array of them
else:  # looked at here, in words that no checker of annotations has
    Number, Numbers = Annotated[Any, "a number"], Annotated[Any, "a list of numbers"]

Bound = float | int | None

EXAMPLES = {
    "Box": "cfjax.Box((1, 1, 1, 3))",
    "Certification": "what cfjax.certify returns",
    "CertifiedTube": "one of cfjax.tubes.library()",
    "Curve": "cfjax.problem.curves.Curve(position, first, second, knots)",
    "Elimination": "cfjax.learner.Elimination()",
    "Ellipsoid": "cfjax.ball(0.5)",
    "Following": "what cfjax.follow(path) returns",
    "Funnel": "result.segments[0].funnel",
    "Interval": "cfjax.Interval(0.5, 2.0)",
    "Law": "cfjax.control.MinNorm()",
    "Leg": "one of result.legs",
    "Objective": 'cfjax.Objective("width", margin=1.0)',
    "Options": 'cfjax.Options(template="paper")',
    "Path": "cfjax.circle() or cfjax.waypoints(file)",
    "Pose": "cfjax.problem.Pose(0.0, 0.0, 0.0)",
    "Problem": "cfjax.Problem(path)",
    "Profile": "cfjax.problem.Profile.constant(1.0, 2.0)",
    "ReferencePoint": "segment.point(0.0)",
    "Result": "what cfjax.synthesize(problem) returns",
    "Segment": "one of path.segments",
    "Template": "cfjax.Contracting()",
    "Tube": "one of path.segments",
    "Vehicle": "cfjax.KinematicBicycle()",
}
"""What to write for an object of a class: for messages."""

SHOWN = 60  # characters of what was given
LISTED = 8  # entries of a list
EXACT = 10**15  # whole numbers beyond are shown by their size
MOST_WHOLE = 2**32 - 1  # of anything that is counted, and of seeds: all generators of random numbers take it


# --- what was given, for messages


def shown(value: object) -> str:
    """What was given, in a few words of one line; never an error, whatever it is."""
    if isinstance(value, str):
        return _cut(repr(value))
    if value is None or isinstance(value, bool | float | complex):
        return str(value)
    if isinstance(value, int) and not isinstance(value, enum.Enum):
        return (
            str(value)
            if abs(value) < EXACT
            else f"a whole number of about {round(value.bit_length() * 0.30103)} digits"
        )
    if isinstance(value, list | tuple):
        more = ", …" if len(value) > LISTED else ""
        return _cut(f"[{', '.join(map(shown, value[:LISTED]))}{more}]")
    if isinstance(value, Mapping):
        return _cut(
            "{" + ", ".join(f"{shown(key)}: {shown(entry)}" for key, entry in list(value.items())[:LISTED]) + "}"
        )
    if isinstance(value, type):
        return f"the class {value.__name__}"
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple):
        return f"an array of shape {' × '.join(map(str, shape))}" if shape else _cut(str(value))
    if isinstance(value, enum.Enum):
        return str(value)
    named = getattr(value, "__name__", None)
    return f"the function {named}" if isinstance(named, str) else _article(type(value).__name__)


def _cut(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= SHOWN else f"{line[: SHOWN - 1]}…"


def _article(name: str) -> str:
    return f"{'an' if name[:1].lower() in 'aeiou' else 'a'} {name}"


class Refused(InputError):
    """A value that is not what its name needs, with its parts: commands show a value as one types it there."""

    name: str = ""
    expected: str = ""
    value: object = None


def refuse(name: str, expected: str, value: object) -> Never:
    """Raises InputError: `name: expected WHAT, got WHAT`."""
    error = Refused(f"{name}: expected {expected}, got {shown(value)}")
    error.name, error.expected, error.value = name, expected, value
    raise error


# --- numbers


def number(
    name: str,
    value: object,
    unit: str = "",
    *,
    above: Bound = None,
    least: Bound = None,
    below: Bound = None,
    most: Bound = None,
) -> float:
    """A finite number within the bounds.

    Raises:
        InputError: where it is none, or lies outside them.
    """
    found = real(value)
    if found is None or not _within(found, above, least, below, most):
        refuse(name, f"a {_sort('number', above, least, below, most)}{f' ({unit})' if unit else ''}", value)
    return found


def whole(name: str, value: object, least: int, most: int = MOST_WHOLE) -> int:
    """A whole number within bounds: 3, or 3.0.

    Raises:
        InputError: where it is none.
    """
    found = real(value)
    if found is None or not _within(found, None, least, None, most) or found != math.floor(found):
        high = f"of at most {most}" if found is not None and found > most else f"of at least {least}"
        refuse(name, f"a whole number {high if most == MOST_WHOLE else f'from {least} to {most}'}", value)
    return int(found)


def numbers(
    name: str, value: object, expected: str = "", *, count: int | None = None, above: Bound = None
) -> tuple[float, ...]:
    """Finite numbers, so many if a count is given, from a list, a tuple or an array.

    Raises:
        InputError: where they are none; `expected` says what would be.
    """
    entries = listed(value)
    found = None if entries is None else [real(entry) for entry in entries]
    if (
        found is None
        or len(found) != (count or len(found))
        or not all(n is not None and _within(n, above) for n in found)
    ):
        refuse(name, expected or f"{count or ''} {_sort('number', above)}s".strip(), value)
    return tuple(n for n in found if n is not None)


def listed(value: object) -> Sequence[Any] | None:
    """The entries of a list, a tuple or an array; None where it is none, as text and dictionaries are not."""
    if isinstance(value, tuple | list):  # by far the most, and fast
        return value
    if isinstance(value, Sequence) and not isinstance(value, str | bytes | bytearray):
        return value
    if hasattr(value, "__array__") and not isinstance(value, type):
        try:
            array = np.asarray(value)
        except Exception:  # whatever an object of somebody's own does
            return None
        return array.tolist() if array.ndim else None
    return None


def array(name: str, value: object, shape: tuple[int | None, ...]) -> np.ndarray:
    """A floating-point array of finite numbers; None in the shape is any size but zero.

    Raises:
        InputError: for another shape, or entries that are no finite numbers.
    """
    expected = f"an array of shape {' × '.join('k' if size is None else str(size) for size in shape)}"
    try:
        found = np.asarray(value)
    except Exception:  # rows of different lengths, and objects of somebody's own
        refuse(name, expected, value)
    if found.dtype.kind not in "iuf":
        refuse(name, expected, value)
    if found.ndim != len(shape) or any(s not in (None, a) for s, a in zip(shape, found.shape, strict=True)):
        raise InputError(f"{name}: expected {expected}, got {' × '.join(map(str, found.shape)) or 'a number'}")
    if not np.isfinite(found).all():
        raise InputError(f"{name}: expected finite numbers, got {np.sum(~np.isfinite(found))} that are not")
    if found.shape[0] == 0:
        raise InputError(f"{name}: expected at least one row, got none")
    return found.astype(float)


def real(value: object) -> float | None:
    """The number that the value is, perhaps not a finite one; None where it is none."""
    if type(value) is float:
        return value
    if isinstance(value, bool | np.bool_):
        return None
    if isinstance(value, abstract.Real | Decimal):
        try:
            return float(value)
        except (OverflowError, ValueError):
            return math.inf
    if isinstance(value, SupportsFloat) and scalar_kind(value) in ("i", "u", "f"):
        try:
            return float(value)
        except TypeError:  # traced: it has no value
            return None
    return None


def scalar_kind(value: object) -> str | None:
    """The kind of number of an array without axes, of NumPy or JAX; None where it is none."""
    axes, sort = getattr(value, "ndim", None), getattr(value, "dtype", None)
    return getattr(sort, "kind", None) if isinstance(axes, int) and axes == 0 else None


def _within(
    value: float,
    above: Bound = None,
    least: Bound = None,
    below: Bound = None,
    most: Bound = None,
) -> bool:
    return (
        math.isfinite(value)
        and (above is None or value > above)
        and (least is None or value >= least)
        and (below is None or value < below)
        and (most is None or value <= most)
    )


def _sort(
    noun: str,
    above: Bound = None,
    least: Bound = None,
    below: Bound = None,
    most: Bound = None,
) -> str:
    """What numbers are expected, in words."""
    if below is None and most is None:
        if above == 0:
            return f"positive finite {noun}"
        noun = f"finite {noun}"
    if above is not None and below is not None:
        return f"{noun} between {above:g} and {below:g}"
    ends = (("above", above), ("of at least", least), ("below", below), ("at most", most))
    return " ".join([noun, " and ".join(f"{word} {end:g}" for word, end in ends if end is not None)]).strip()


# --- names, truth values, files


def choice(name: str, value: object, kinds: type[E]) -> E:
    """A member of the enumeration, or its value as text.

    Raises:
        InputError: for anything else; the message lists the values.
    """
    if isinstance(value, kinds):
        return value
    known = {str(kind.value): kind for kind in kinds}
    return known[one_of(name, value, known)]


def one_of(name: str, value: object, names: Sequence[str] | Mapping[str, Any]) -> str:
    """One of some names.

    Raises:
        InputError: for anything else; the message lists them.
    """
    if isinstance(value, str) and value in names:
        return value
    if isinstance(value, str) and value.strip():
        given = _cut(value) + meant(value, names)
    else:
        given = shown(value)
    raise InputError(f"{name}: expected one of {', '.join(names)}, got {given}")


def text(name: str, value: object) -> str:
    """Text.

    Raises:
        InputError: for anything else.
    """
    return value if isinstance(value, str) else refuse(name, "text", value)


def flag(name: str, value: object) -> bool:
    """True or False.

    Raises:
        InputError: for anything else, 0 and 1 too.
    """
    return bool(value) if isinstance(value, bool | np.bool_) else refuse(name, "True or False", value)


def file(name: str, value: object) -> Path:
    """The place of a file or folder.

    Raises:
        InputError: for anything else.
    """
    place = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if isinstance(place, str) and place and "\0" not in place:
        return Path(place)
    refuse(name, "the name of a file", value)


# --- objects


def instance(name: str, value: object, kind: type[T]) -> T:
    """An object of the class.

    Raises:
        InputError: for anything else; says what to write instead.
    """
    return value if isinstance(value, kind) else refuse(name, _such_as(kind), value)


def optional(name: str, value: object, kind: type[T]) -> T | None:
    """An object of the class, or None; raises InputError as `instance`."""
    return None if value is None else instance(name, value, kind)


def instances(name: str, value: object, *kinds: type) -> tuple[Any, ...]:
    """Objects of one of the classes, from a list or a tuple.

    Raises:
        InputError: for anything else, one object alone too.
    """
    sort = " or ".join(map(_such_as, kinds))
    if not isinstance(value, list | tuple) or isinstance(value, kinds):
        refuse(name, f"a list, each entry {sort}", value)
    for entry in value:
        if not isinstance(entry, kinds):
            refuse(name, f"a list, each entry {sort}", entry)
    return tuple(value)


def _such_as(kind: type) -> str:
    """A class in words: what to write for an object of it."""
    example = EXAMPLES.get(kind.__name__)
    return f"{_article(kind.__name__)}{f', such as {example}' if example else ''}"


def function(name: str, value: object) -> Callable[..., Any] | None:
    """Something to call, or None; raises InputError."""
    return value if value is None or callable(value) else refuse(name, "a function, or None", value)


def objects(**given: tuple[object, type]) -> None:
    """Each value has to be an object of its class: name=(value, class); raises InputError as `instance`."""
    for name, (value, kind) in given.items():
        instance(name, value, kind)


def keep(owner: object, **values: object) -> None:
    """Write fields of a frozen dataclass, while it is constructed."""
    for label, value in values.items():
        object.__setattr__(owner, label, value)
