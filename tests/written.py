"""Files of points as people write them: a path of known length in metres, in any of their forms, from a seed."""

import csv
import io
import math
import random
from dataclasses import dataclass, field

import numpy as np


LENGTH = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3, "ft": 0.3048, "inch": 0.0254, "yd": 0.9144}
SPEED = {"mps": 1.0, "m/s": 1.0, "kmh": 1 / 3.6, "km/h": 1 / 3.6, "km_h": 1 / 3.6, "mph": 0.44704, "kph": 1 / 3.6}
PLACES = (
    *("{x}", "{X}", "pos_{x}", "{x}_pos", "pos{X}", "position.{x}", "{x}_ref", "utm_{x}", "center_{x}", "{x}Coord"),
    *("field.pose.position.{x}", "p{x}", "c{x}", "{x}_path", "map/{x}", "xy_{x}", "{X} position", "pose.{x}"),
)
UNITS = ("{}_{}", "{} [{}]", "{} ({})", "{}[{}]", "{} {}", "{} / {}", "{} in {}", "{}.{}")
FAST = (
    "v",
    "speed",
    "velocity",
    "vx",
    "vel",
    "Speed",
    "target_speed",
    "v_ref",
    "longitudinal_velocity",
    "speed_profile",
)
REMARKS = (
    "# made by a planner",
    "# Rundkurs größer, 4 m breit",
    "#",
    "% exported",
    "// a, b, c",
    "# 0000",
    "# µ = 0.8",
)
ENCODINGS = ("utf-8", "utf-8", "utf-8-sig", "latin-1", "utf-16", "utf-16-le")


@dataclass
class Written:
    """A file's bytes, and what was meant."""

    data: bytes
    length: float  # m, of one lap or of the open path
    lap: bool
    speed: np.ndarray | None  # m/s at the first points; None: the file says nothing of it
    clear: bool  # whether it can be read in one way only; else it may be refused
    forms: list[str] = field(default_factory=list)  # for who looks for the reason of a failure


def written(seed: int) -> Written:
    draw = random.Random(seed)
    lap = draw.random() < 0.6
    place, length = _lap(draw) if lap else _open(draw)
    count = len(place)
    clear, forms = True, []
    if lap:
        place, form = _ended(draw, place, length)
        forms.append(form)

    fast: np.ndarray | None = None
    if draw.random() < 0.5:
        level = draw.uniform(0.3, 9)
        fast = level * (1 + draw.choice([0, 0.3]) * np.sin(np.linspace(0, 6, len(place)) + draw.uniform(0, 6)))
    unit = draw.choice(["", "", "m", *LENGTH])
    head = draw.choice(["header", "header", "comment", "none"])
    speed_unit = draw.choice(["", *SPEED]) if unit in ("", "m") else draw.choice(list(SPEED))
    if head == "none":
        unit, speed_unit = "", ""
    forms += [f"unit {unit}", f"speed unit {speed_unit}", head]

    columns = _named_places(draw, place, unit)
    if fast is not None:
        columns.append((_with_unit(draw, draw.choice(FAST), speed_unit), fast / SPEED.get(speed_unit, 1.0)))
    if head == "none":
        trap = draw.choice(["", "", "time", "yaw", "index", "degrees", "arc"]) if fast is None else ""
        if trap:
            columns.append((trap, _extra(draw, trap, place)))
            forms.append(f"trap {trap}")
        clear = len(columns) == 2  # a third column may always be another thing
        if trap == "index":
            columns = [columns[-1], *columns[:-1]]
    else:
        if draw.random() < 0.06:
            columns = columns[2:]
            for name in draw.choice(["{x}_left {x}_right", "{x}_ref {x}_in", "pos_{x} goal_{x}"]).split():
                columns += [(name.format(x="x"), place.real), (name.format(x="y"), place.imag)]
            clear = False
            forms.append("ambiguous")
        columns = _among_others(draw, columns, place)

    step = np.abs(np.diff(place)).max() / (LENGTH[unit] if unit else 1.0)
    digits = max(4, 5 - math.floor(math.log10(step)))
    text, more, readable = _text(draw, columns, head, digits)
    encoding = draw.choice(ENCODINGS)
    if encoding == "latin-1":
        text = text.encode("latin-1", "replace").decode("latin-1")
    forms += [*more, encoding]
    speed = None if fast is None else fast[:count]
    data = text.encode(encoding)
    return Written(data, length, lap, speed, clear and readable, forms)


def _lap(draw: random.Random) -> tuple[np.ndarray, float]:
    """Points of a smooth lap, the first one not repeated, and its length."""
    size, phase = 10 ** draw.uniform(0, 2), draw.uniform(0, 6)
    amplitudes = [draw.uniform(-0.12, 0.12) / k for k in (2, 3)]
    u = 2 * np.pi * np.arange(20_000) / 20_000
    radius = 1 + sum(a * np.cos(k * u + phase) for k, a in zip((2, 3), amplitudes, strict=True))
    dense = size * radius * np.exp(1j * (u if draw.random() < 0.5 else -u) + 1j * phase)
    if draw.random() < 0.2:
        dense = 2 * size * np.cos(u) / (1 - 1j * np.sin(u))  # an eight
        dense = np.roll(dense, draw.randrange(20_000))
    dense = dense + (0 if draw.random() < 0.7 else 100 * size * np.exp(1j * draw.uniform(0, 6)))
    length = float(np.abs(np.diff(np.append(dense, dense[0]))).sum())
    count = draw.randrange(30, 150)
    return _sampled(np.append(dense, dense[0]), count + 1)[:-1], length


def _open(draw: random.Random) -> tuple[np.ndarray, float]:
    """Points of a smooth path whose ends are far apart, and its length."""
    size = 10 ** draw.uniform(0.3, 2)
    u = np.linspace(0, 1, 20_000)
    form = draw.randrange(4)
    if form == 0:
        dense = size * (u + 0.06j * np.sin(draw.uniform(2, 9) * u))
    elif form == 1:
        dense = size * np.exp(1j * draw.uniform(0.5, 4.0) * u)
    elif form == 2:
        dense = size * u * np.exp(0j)
    else:
        dense = size * (0.4 + u) * np.exp(1j * draw.uniform(3, 9) * u)  # a spiral
    dense = dense * np.exp(1j * draw.uniform(0, 6)) + draw.choice([0, size, 30 * size])
    length = float(np.abs(np.diff(dense)).sum())
    return _sampled(dense, draw.randrange(40, 120)), length


def _sampled(dense: np.ndarray, count: int) -> np.ndarray:
    """Points at even distances along a dense line."""
    arc = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(dense)))])
    return np.interp(np.linspace(0, arc[-1], count), arc, dense)


def _ended(draw: random.Random, lap: np.ndarray, length: float) -> tuple[np.ndarray, str]:
    """The points of a lap, as they end in a file."""
    spacing = length / len(lap)
    form = draw.choice(["repeated", "not repeated", "nearly", "beyond", "beyond between", "twice"])
    if form == "repeated":
        return np.append(lap, lap[0]), form
    if form == "nearly":
        return np.append(lap, lap[0] + draw.uniform(0, 0.045) * spacing * np.exp(1j * draw.uniform(0, 6))), form
    if form == "beyond":
        return np.concatenate([lap, lap[: draw.randrange(2, len(lap) // 2)]]), form
    if form == "beyond between":  # on the same lap, at other places
        again = _sampled(np.append(lap, lap[0]), draw.randrange(len(lap), 2 * len(lap)))
        return np.concatenate([lap, again[1 : draw.randrange(3, len(again) // 2)]]), form
    if form == "twice":
        return np.concatenate([lap, lap, lap[:1]]), form
    return lap, form


def _named_places(draw: random.Random, place: np.ndarray, unit: str) -> list[tuple[str, np.ndarray]]:
    scale = LENGTH[unit] if unit else 1.0
    form = draw.choice(PLACES)
    names = [form.format(x=axis, X=axis.upper()) for axis in "xy"]
    if draw.random() < 0.05:
        names = draw.choice([["easting", "northing"], ["East", "North"]])
    wrote = draw.choice(UNITS)
    names = [wrote.format(name, unit) if unit else name for name in names]
    return list(zip(names, (place.real / scale, place.imag / scale), strict=True))


def _with_unit(draw: random.Random, name: str, unit: str) -> str:
    forms = UNITS[:4] if "/" in unit else (UNITS[0], UNITS[1], UNITS[4])
    return draw.choice(forms).format(name, unit) if unit else name


def _extra(draw: random.Random, name: str, place: np.ndarray) -> np.ndarray:
    steps = np.diff(np.append(place, 2 * place[-1] - place[-2]))
    arc = np.cumsum(np.abs(steps))
    heading = np.unwrap(np.angle(steps))
    return {
        "time": draw.choice([0.0, 1.7e9]) + 0.1 * np.arange(len(place)),
        "arc": arc,
        "yaw": draw.choice([heading, np.angle(steps), np.pi / 2 - heading]),
        "degrees": np.degrees(draw.choice([np.angle(steps), np.mod(heading, 2 * np.pi)])),
        "index": np.arange(len(place)),
    }[name]


def _among_others(
    draw: random.Random, columns: list[tuple[str, np.ndarray]], place: np.ndarray
) -> list[tuple[str, np.ndarray]]:
    """Columns beside those that nobody asks for, in any order."""
    half = np.full(len(place), 0.5)
    others = {
        "w_tr_right_m": half,
        "w_tr_left_m": half,
        "s_m": _extra(draw, "arc", place),
        "psi_rad": _extra(draw, "yaw", place),
        "yaw_deg": _extra(draw, "degrees", place),
        "kappa_radpm": 0 * half,
        "ax_mps2": 0.3 - half,
        "t": _extra(draw, "time", place),
        "z": 3 * half,
        "": np.arange(len(place)),
        "orientation.x": 0 * half,
        "x_normvec_m": half,
        "y_normvec_m": half,
        "angular_velocity.z": 0 * half,
    }
    chosen = draw.sample(list(others), draw.choice([0, 0, 1, 2, 5]))
    columns = [*columns, *((name, others[name]) for name in chosen)]
    if draw.random() < 0.5:
        draw.shuffle(columns)
    if columns[-1][0] == "":  # a name that is missing at the end is a column that is not there
        columns = [columns[-1], *columns[:-1]]
    return columns


def _text(
    draw: random.Random, columns: list[tuple[str, np.ndarray]], head: str, digits: int
) -> tuple[str, list[str], bool]:
    """The lines of the file, the forms that they have, and whether they can be read in one way only."""
    clear = True
    separator = draw.choice([",", ",", ";", "\t", "|", " "])
    decimal = "," if separator != "," and draw.random() < 0.35 else "."
    if separator == "," and draw.random() < 0.05:
        decimal, clear = ",", False
    quotes = separator != " " and draw.random() < 0.15
    clear = clear or quotes
    names = [name for name, _ in columns]
    if separator == " ":
        names = [name.replace(" / ", "_").replace(" in ", "_").replace(" ", "_") or "nr" for name in names]
    exponent = draw.random() < 0.1
    rows = []
    for values in zip(*(column for _, column in columns), strict=True):
        cells = []
        for name, value in zip(names, values, strict=True):
            if float(value).is_integer() and (name in ("", "nr", "index") or abs(value) > 1e8):
                cell = f"{int(value)}"
            elif exponent:
                cell = f"{value:.{digits + 3}e}"
            else:
                cell = f"{value:.{digits}f}"
            cells.append(cell.replace(".", decimal))
        rows.append(cells)
    newline = draw.choice(["\n", "\r\n", "\r"])
    trailing = separator if separator not in " " and draw.random() < 0.15 else ""
    blank = " " if separator in ",;" and draw.random() < 0.3 else ""

    def line(cells: list[str], every: bool) -> str:
        if separator == " ":
            return draw.choice([" ", "  "]).join(cells)
        out = io.StringIO()
        csv.writer(out, delimiter=separator, quoting=csv.QUOTE_ALL if every else csv.QUOTE_MINIMAL).writerow(cells)
        text = out.getvalue().rstrip("\r\n")
        return text if every or '"' in text else text.replace(separator, separator + blank)

    lines = []
    said = separator != " " and draw.random() < 0.1
    if said:
        lines.append(f"sep={separator}")
    lines += draw.sample(REMARKS, draw.choice([0, 0, 1, 2]))
    if head != "none":
        lines.append(
            ("# " if head == "comment" else "") + line(names, quotes) + (trailing if draw.random() < 0.5 else "")
        )
    body = [line(cells, quotes) + trailing for cells in rows]
    if draw.random() < 0.1:
        body.insert(draw.randrange(len(body)), draw.choice(["", "  ", "# half way"]))
    text = newline.join([*lines, *body]) + draw.choice([newline, "", newline + newline])
    forms = [f"separator {separator!r}", f"decimal {decimal!r}", f"quotes {quotes}", f"trailing {trailing!r}"]
    return text, [*forms, f"said {said}", f"exponent {exponent}"], clear
