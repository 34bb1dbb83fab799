"""What the columns of a table of points mean: which ones are x, y and speed, and in which units.

A column is known by its name (`x`, `pos_x_m`, `position.x [mm]`, `speed_kmh`). Without names a table of two columns is
x, y; a third one is a speed only where it can be one and nothing else. What can be meant in two ways is refused, with
the names between which to choose.
"""

import itertools
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cfjax.errors import InputError


FASTEST = 120.0  # m/s: no car is faster
WINDS = 1e-3  # spread of directions about their mean, 1 − |mean of e^{iψ}|: below, a way is straight
FOLLOWS = 0.1  # of that spread is left between the way and a column that is its heading
BENDS = 0.2  # relative, of half of the points: so near a column is the curvature of the way
SAME = 0.02  # quarters of a turn between a straight way's direction, or an axis from it, and a column that says it
ASK = "name the columns in a header, or by path.columns=[x,y,speed]"

_LENGTHS = {
    1.0: "m meter meters metre metres",
    1e-3: "mm millimeter millimeters millimetre millimetres",
    1e-2: "cm centimeter centimeters centimetre centimetres",
    1e-1: "dm decimeter decimeters decimetre decimetres",
    1e3: "km kilometer kilometers kilometre kilometres",
    1e-6: "um µm μm",
    0.3048: "ft foot feet",
    0.0254: "inch inches",
    0.9144: "yd yard yards",
    1609.344: "mi mile miles",
}
_SPEEDS = {
    1.0: "m/s mps ms-1 ms",
    1 / 3.6: "km/h kmh kph kmph km/hr kmh-1",
    0.44704: "mph mi/h",
    0.3048: "ft/s fps",
    1852 / 3600: "kn kt kts knot knots",
    1e-2: "cm/s cmps cms-1",
    1e-3: "mm/s mmps mms-1",
}
LENGTHS = {unit: factor for factor, units in _LENGTHS.items() for unit in units.split()}
SPEEDS = {unit.replace("/", ""): factor for factor, units in _SPEEDS.items() for unit in units.split()}


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


OTHERS = _words(
    "deg degree degrees ° rad radian radians px pixel pixels pct percent % rpm rads radps degs normalized norm cell "
    "cells grid idx index"
)
_SHOWN = "m, mm, cm, km, ft, inch, yd or mi"
_SHOWN_SPEEDS = "m/s, km/h, mph, ft/s, kn, cm/s or mm/s"
_EAST_NORTH = {"east": "x", "easting": "x", "north": "y", "northing": "y"}
_SPEED_WORDS = _words("speed v vx vel velocity geschwindigkeit")
_NOT_DRIVEN = _words(  # speeds of something else, or numbers that are no speeds
    "y z vy vz lateral lat angular yaw turn rotation wheel engine wind err error std sigma var acc accuracy min factor "
    "ratio scale"
)
_WIDTH_WORDS = _words("w width tr track bound boundary border edge distance dist d")
_NO_PLACES = _words(  # components of something else
    "v vel velocity speed a acc accel acceleration jerk j d dot delta n normal normvec normals t tangent dir direction "
    "q quat quaternion orientation twist angular linear rate w omega force f std sigma cov var err error e grad size "
    "scale g gyro mag o u curvature kappa width height"
)


class Meaning(NamedTuple):
    """Which columns are x, y and speed, and what makes m and m/s of their numbers."""

    columns: tuple[int, int, int | None]
    factors: tuple[float, float, float]
    used: tuple[str, ...]
    unused: tuple[str, ...]
    units: bool  # whether x and y say theirs
    speed_unit: bool  # whether the speed does, if there is one
    named: bool = True
    widths: tuple[int, int] | None = None  # columns of the half-widths to the left and to the right
    width_factors: tuple[float, float] = (1.0, 1.0)
    width_names: tuple[str, ...] = ()


class _Name(NamedTuple):
    text: str
    words: tuple[str, ...]
    unit: str | None  # as LENGTHS, SPEEDS and OTHERS have it, or one that is not known


def meaning_of(names: Sequence[str]) -> Meaning | None:
    """What columns of such names mean; None where none is named x and y.

    Raises:
        InputError: where they can be meant in several ways, or are in units that are not known. The message says
            nothing of where the names stand.
    """
    parsed = [_parsed(name) for name in names]
    pair = _places(parsed)
    if pair is None:
        return None
    x, y = parsed[pair[0]], parsed[pair[1]]
    scales = [_factor(column, LENGTHS, "a length", _SHOWN) for column in (x, y)]
    if (x.unit is None) != (y.unit is None):
        raise InputError(f"expected units of both or of none, got the columns {x.text} and {y.text}")
    speed = _speed(parsed)
    fast = 1.0
    if speed is not None:
        column = parsed[speed]
        fast = _factor(column, SPEEDS, "a speed", _SHOWN_SPEEDS)
        if column.unit is None and set(scales) != {1.0}:
            raise InputError(
                f"expected a unit of the speed beside {x.text}, got {column.text}: write {column.text}_mps"
            )
        if column.unit is None and any("change_flag" in name.text.lower() for name in parsed):
            own = {pair[0]: "x", pair[1]: "y", speed: "speed_kmh"}
            written = ",".join(own.get(index, "_") for index in range(len(names)))
            raise InputError(
                f"expected a unit of {column.text}, got none, and beside change_flag it is usually km/h: "
                f"path.columns=[{written}] says so (speed_mps, where it is m/s)"
            )
    chosen: tuple[int, int, int | None] = (*pair, speed)
    used = tuple(parsed[index].text for index in chosen if index is not None)
    widths = _widths(parsed)
    others = (name for index, name in enumerate(parsed) if index not in (*chosen, *widths))
    unused = tuple(name.text for name in others if name.words)
    says = speed is None or parsed[speed].unit is not None
    wide = tuple(
        scales[0] if parsed[k].unit is None else _factor(parsed[k], LENGTHS, "a length", _SHOWN) for k in widths
    )
    return Meaning(
        chosen,
        (scales[0], scales[1], fast),
        used,
        unused,
        x.unit is not None,
        says,
        widths=(widths[0], widths[1]) if widths else None,
        width_factors=(wide[0], wide[1]) if widths else (1.0, 1.0),
        width_names=tuple(parsed[index].text for index in sorted(widths)),
    )


def meaning_by_place(table: Float[np.ndarray, "n columns"], plain: bool) -> Meaning:
    """What two or three columns without names are: x, y and, where it can be nothing else, a speed.

    `plain`: whether the first column holds whole numbers, and another one does not.

    Raises:
        InputError: where the third column cannot be a speed, or may as well be something else.
    """
    if table.shape[1] not in (2, 3):
        raise InputError(f"expected columns x, y or x, y, speed, or names, got {table.shape[1]} without names; {ASK}")
    if table.shape[1] == 2:
        return Meaning((0, 1, None), (1.0, 1.0, 1.0), ("1 (x)", "2 (y)"), (), False, True, False)
    place, third = table[:, 0] + 1j * table[:, 1], table[:, 2]
    if problem := _no_speed(place, third) or _counted(table, plain):
        raise InputError(f"{problem}; {ASK}, with another name for what is none of these")
    third = "3 (taken for a speed in m/s: path.columns=[x,y,_] where it is none)"
    return Meaning((0, 1, 2), (1.0, 1.0, 1.0), ("1 (x)", "2 (y)", third), (), False, False, False)


def too_fast(name: str, fastest: float) -> str | None:
    """Why that cannot be a speed in m/s."""
    if fastest <= FASTEST:
        return None
    return (
        f"expected at most {FASTEST:g} m/s in the column {name}, got {fastest:.4g}: say its unit, as in speed_kmh, in "
        "the header or by path.columns=[x,y,speed_kmh]"
    )


def geographic(names: Sequence[str]) -> str | None:
    """Why columns of such names are no places in a plane, where they are latitude and longitude."""
    words = {word for name in names for word in _parsed(name).words}
    if words & {"lat", "latitude"} and words & {"lon", "lng", "long", "longitude"}:
        return "expected x and y in m, got latitude and longitude: project them to a plane first (UTM, for one)"
    return None


def units_in(text: str) -> str | None:
    """The unit of length, other than m, of which a comment speaks."""
    found = re.findall(r"[^\W\d_]+", re.sub(r"\w+/\w+", "", text.lower()))  # km/h is none
    return next((word for word in found if LENGTHS.get(word, 1.0) != 1.0), None)


def speed_unit_in(text: str) -> str | None:
    """The unit of speed, other than m/s, of which a comment speaks; written as in a column's name."""
    found = (word.replace("/", "") for word in re.findall(r"[^\W\d_]+(?:/[^\W\d_]+)?", text.lower()))
    return next((word for word in found if SPEEDS.get(word, 1.0) != 1.0), None)


def is_unit(text: str) -> bool:
    """Whether a cell is the unit of the column above or below it."""
    bare = text.strip("[]() ")
    return bare in ("", "-", "1", "s") or _unit(bare) is not None


# --- names


def _parsed(name: str) -> _Name:
    """A column's name as words and a unit: `positionX [mm]`, `speed_km_h`, `x in m`."""
    text = " ".join(name.strip().strip("\"'").split())
    bare, unit = text, None
    if bracket := re.search(r"\s*[\[({<]\s*(.*?)\s*[\])}>]\s*", text):
        bare = (text[: bracket.start()] + " " + text[bracket.end() :]).strip()
        content = re.sub(r"^in\s+", "", bracket.group(1), flags=re.IGNORECASE)  # x (in cm)
        if re.fullmatch(r"\d*", content) or content == "-":
            bare = text[: bracket.start()] + text[bracket.end() :]
        else:
            unit = "inch" if content.lower() in ("in", '"') else _unit(content) or content
    bare = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Za-z])(?=\d)", "_", bare).lower()
    parts = [part for part in re.split(r"[^\w°%µμ]+|_+", bare) if part]
    if unit is None:
        for count in (3, 2, 1):
            tail = parts[-count:]
            if len(parts) > count and (known := _unit("/".join(tail))) and (count == 1 or known in SPEEDS):
                parts, unit = parts[:-count], known
                break
    if unit is None and len(parts) == 1 and (glued := re.fullmatch(r"(x|y|vx|v|speed|velocity|vel)([a-z]+)", parts[0])):
        word, rest = glued.groups()
        if rest in LENGTHS if word in "xy" else rest in SPEEDS:
            parts, unit = [word], rest
    if unit and len(parts) > 1 and parts[-1] == "in":  # x in mm
        parts = parts[:-1]
    return _Name(text, tuple(parts), unit)


def _unit(text: str) -> str | None:
    """A unit's name in the tables, however it is written: `km/h`, `km h^-1`, `Meters`."""
    bare = re.sub(r"\bper\b", "", text.lower().replace("⁻¹", "-1"))
    bare = re.sub(r"[\s/*·^_.]+", "", bare)
    return bare if bare in LENGTHS or bare in SPEEDS or bare in OTHERS else None


def _factor(column: _Name, units: dict[str, float], kind: str, shown: str) -> float:
    if units is SPEEDS and column.unit and any(re.search(r"\d", word) for word in column.words):
        raise InputError(f"expected {kind} in {shown}, got the column {column.text}, whose name has a number")
    if column.unit is None:
        if len(column.words) > 1 and column.words[-1] == "in":
            raise InputError(f"expected inches written out, or another name, got the column {column.text}")
        if hint := _hidden_unit(column, counted=units is SPEEDS):
            ending = "speed_kmh" if units is SPEEDS else "x_cm"
            raise InputError(
                f"expected {kind} whose unit ends its name, as {ending}, got the column {column.text} ({hint}?)"
            )
        return 1.0
    if column.unit not in units:
        raise InputError(f"expected {kind} in {shown}, got the column {column.text}")
    return units[column.unit]


def _hidden_unit(column: _Name, counted: bool) -> str | None:
    """What in a column's name speaks of a unit or a scale that was not understood; of a speed any number does."""
    words = re.findall(r"[^\W_]+", column.text.lower())
    for word in words if len(words) > 1 else []:  # px is no pixel
        letters = re.sub(r"\d+", "", word)
        known = LENGTHS.get(letters) or SPEEDS.get(letters)
        if (known and known != 1.0) or letters in OTHERS or (counted and (letters != word or "per" in letters)):
            return word
    return None


def _places(parsed: list[_Name]) -> tuple[int, int] | None:
    """The columns of x and y: those that are called just so, or the only two that differ in nothing but x and y."""
    found: dict[tuple[str, ...], tuple[list[int], list[int]]] = {}
    for index, name in enumerate(parsed):
        for words in (name.words, tuple(_EAST_NORTH.get(word, word) for word in name.words)):
            axes = [word for word in words if word in ("x", "y")]
            if len(axes) == 1 and not set(words) & _NO_PLACES:
                key = tuple("*" if word == axes[0] else word for word in words)
                found.setdefault(key, ([], []))["xy".index(axes[0])].append(index)
                break
    if not any(xs and ys for xs, ys in found.values()):  # px, py; xs, ys; posx, posy
        for index, name in enumerate(parsed):
            word = "_".join(name.words)
            for at in (i for i, letter in enumerate(word) if letter in "xy"):
                stem = word[:at] + "*" + word[at + 1 :]
                if stem.replace("*", "") not in _NO_PLACES | {"ma", ""} and not set(name.words) & _NO_PLACES:
                    found.setdefault((stem,), ([], []))["xy".index(word[at])].append(index)
    pairs = {words: pair for words, pair in found.items() if all(pair)}
    if ("*",) in pairs:
        pairs = {("*",): pairs["*",]}
    several = [parsed[index].text for pair in pairs.values() for index in sorted(pair[0] + pair[1])]
    if len(several) > 2:
        raise InputError(
            f"expected one column of x and one of y, got {', '.join(several)}: name the two that are meant x and y, in "
            "the header or by path.columns=[...]"
        )
    return next(((xs[0], ys[0]) for xs, ys in pairs.values()), None)


def _speed(parsed: list[_Name]) -> int | None:
    """The column of the speed: the one that is called just so, or the only one whose name says it."""
    named = [i for i, name in enumerate(parsed) if set(name.words) & _SPEED_WORDS and not set(name.words) & _NOT_DRIVEN]
    plain = [i for i in named if len(parsed[i].words) == 1]
    found = plain or named
    if len(found) > 1:
        raise InputError(
            f"expected one column of the speed, got {', '.join(parsed[i].text for i in found)}: name the one that is "
            "meant speed, in the header or by path.columns=[...]"
        )
    if not found:
        return None
    along = parsed[found[0]]
    across = tuple({"vx": "vy", "x": "y"}.get(word, word) for word in along.words)
    if across != along.words and (other := next((name for name in parsed if name.words == across), None)):
        raise InputError(
            f"expected one column of the speed, got {along.text} and {other.text}, components along the body or "
            "along the map: name the one along the body speed, or take both out"
        )
    return found[0]


def _widths(parsed: list[_Name]) -> tuple[int, ...]:
    """The columns of half-widths, left and right: `w_tr_left_m`, `width_right`; none where not both are there."""
    found = []
    for side in ("left", "right"):
        named = [i for i, name in enumerate(parsed) if side in name.words and set(name.words) & _WIDTH_WORDS]
        if len(named) != 1:
            return ()
        found += named
    return tuple(found)


# --- columns without names


def _no_speed(place: np.ndarray, third: np.ndarray) -> str | None:
    """Why the third column is no speed, or is as likely something else."""
    least, most = float(third.min()), float(third.max())
    said = f"expected a speed in m/s in the third column, which has no name, got {least:.6g} to {most:.6g}"
    steps = np.diff(third)
    if most > FASTEST:
        return f"{said}, " + ("time stamps?" if (steps > 0).all() else "no speed of a car")
    if len(third) > 2 and ((steps > 0).all() or (steps < 0).all()):
        return f"{said}, which never turns back: time, or the way driven?"
    if least < 0 or most == 0:
        return f"{said}: a heading, a curvature or a height?"
    if _is_heading(place, third):
        return f"{said}, which turns with the path: a heading?"
    if _is_curvature(place, third):
        return f"{said}, as the path bends (1/m): its curvature?"
    return None


def _is_heading(place: np.ndarray, third: np.ndarray) -> bool:
    """Whether the column turns as the way through the points does: in rad or degrees, from any axis, either way."""
    chords = np.diff(place)
    moving = np.abs(chords) > 0
    if moving.sum() < 2:
        return False
    way, column = chords[moving] / np.abs(chords[moving]), third[:-1][moving]
    spread = 1 - abs(way.mean())
    for unit, each in itertools.product((1.0, np.pi / 180), (way, np.conj(way))):
        between = (np.exp(1j * unit * column) * np.conj(each)).mean()  # of length 1 where the angle between is constant
        left = 1 - abs(between)
        quarters = float(np.angle(between)) / (np.pi / 2)
        if (spread > WINDS and left < FOLLOWS * spread) or (left < WINDS and abs(quarters - round(quarters)) < SAME):
            return True
    return False


def _is_curvature(place: np.ndarray, third: np.ndarray) -> bool:
    """Whether the column is as large as the way's curvature, 1/m: that of the circle through neighbours."""
    before, after = place[1:-1] - place[:-2], place[2:] - place[1:-1]
    sides = np.abs(before) * np.abs(after) * np.abs(before + after)
    if not (sides > 0).any():
        return False
    found = 2 * np.abs(np.imag(after * np.conj(before)))[sides > 0] / sides[sides > 0]
    column = third[1:-1][sides > 0]
    bent = column > 0
    return bool(bent.sum() > 3 and np.median(np.abs(column - found)[bent] / column[bent]) <= BENDS)


def _counted(table: np.ndarray, plain: bool) -> str | None:
    """Why the first column counts or times the points, rather than being x."""
    first, steps = table[:, 0], np.diff(table[:, 0])
    if len(first) < 4:
        return None
    even = bool((steps > 0).all() and np.ptp(steps) <= 1e-6 * abs(steps[0]))
    if not even:
        return None
    if plain and first[0] in (0, 1) and steps[0] == 1:
        return "expected x in the first column, which has no name, got the numbers of the points"
    way = np.diff(table[:, 1] + 1j * table[:, 2])
    onwards = np.abs(way).min() > 0 and np.abs(np.angle(way[1:] * np.conj(way[:-1]))).max() < np.pi / 2
    if onwards and (np.diff(table[:, 2]) == 0).mean() < 0.5:
        return "expected x, y and speed in three columns without names, got time, x and y as likely"
    return None
