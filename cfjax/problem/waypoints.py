"""A path from points in a CSV file: a smooth curve through them, at a speed that the car can drive.

The curve is a quintic spline over chord length: its curvature is twice continuously differentiable. The energy E = v²/2
per kg along arc length s makes the limits on speed plain, for dv/dt = dE/ds:

* v is at most the speed asked for, and √(a_lat/|κ|): nothing in a kinematic model bounds speed in bends;
* |dE/ds| is at most the thrust that the car may use. The largest such E comes from one pass forwards and one backwards.

A mean over a window makes dE/ds continuous and keeps |dE/ds|; it keeps the limits on speed because these were replaced
by their minima over the same window before. What polynomials (`cfjax.problem.curves`) miss of that is paid for by
driving the whole profile a little slower: time stretched by c divides speed by c and acceleration by c².
"""

import csv
import math
import warnings
from os import PathLike
from pathlib import Path as File
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import Akima1DInterpolator, BSpline, CubicHermiteSpline, PPoly, make_interp_spline, splprep
from scipy.ndimage import minimum_filter1d

from cfjax.errors import InputError
from cfjax.problem.curves import Curve, path_along
from cfjax.problem.path import Path, Profile, Segment, _positive
from cfjax.problem.vehicle import KinematicBicycle, Vehicle


SPEED = 2.0  # m/s, where neither the file nor the caller says
SEGMENT_LENGTH = 10.0  # m
MOST_SEGMENTS = 10_000
SHORTEST, LONGEST = 1e-3, 1e5  # m along the points: beyond, a file is in other units, or asks for all of the memory
MOST_POINTS = 100_000  # with those that fill gaps
MERGED = 1e-9  # of the extent of all points: closer ones are one point
STRAIGHT = 1e-12  # of the extent: points that leave a line by less are on it
LONGEST_GAP = 2.0  # of the median distance between neighbours: where points are farther apart the spline gets more
SAMPLES_PER_POINT = 64  # at which curvature is looked at
SHARPEST = 0.5  # rad between two samples: a cusp, whatever the curvature at the samples is
GRID = 4096  # cells of the speed profile, at least
CELL = 0.05  # m, at most
SMOOTHING_TIME = 0.25  # s: over so much at top speed, either way, acceleration is smoothed
THRUST_HEADROOM = 0.02  # relative: for what the polynomials miss, so that the whole need not be slower
BEND_HEADROOM = 5e-3
ROUNDING = 1e-12
LEAST_CHANGE = 1e-6  # relative: a speed that varies by less is constant


class _Rows(NamedTuple):
    row: np.ndarray  # (n,) line in the file, from 1
    place: np.ndarray  # (n,) x + iy in m
    speed: np.ndarray | None  # (n,) m/s


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # what is not finite is refused by name
def waypoints(
    file: str | PathLike[str],
    *,
    closed: bool | None = None,
    speed: float | None = None,
    lateral_acceleration: float = 4.0,
    acceleration: float | None = 1.0,
    reserve: float = 0.2,
    vehicle: Vehicle = KinematicBicycle(),
    segment_length: float = SEGMENT_LENGTH,
    smoothing: float = 0.0,
) -> Path:
    """The path through the points of a CSV file, in the order in which they stand there.

    The file has columns x and y (m) and, if wanted, speed (m/s, the most that is driven there); a header names them, in
    any order and beside others (x, y, speed; also x_m, v and the like), without one the first columns are these.
    Empty lines and lines that begin with # are skipped; points that repeat the one before are merged.

    Args:
        closed: whether it is a lap; None: where the last point repeats the first.
        speed: the most that is driven anywhere, m/s; None: what the file says, or 2 m/s.
        lateral_acceleration: largest |κ| v², m/s².
        acceleration: largest |dv/dt|, m/s², beside what thrust allows; None: thrust alone. The package's tubes hold 1
            m/s² at all speeds and 2 m/s² from 3 m/s on.
        reserve: the part of steering and of thrust that is left to feedback, in [0, 1).
        vehicle: what drives; of one of your own nothing is known here but `lateral_acceleration` and `acceleration`,
            and `Problem` says where its inputs do not do it.
        segment_length: m; the path is cut into segments of equal length, as near to this as can be.
        smoothing: root of the mean square distance, m, by which the curve may pass the points; 0: through them.

    Raises:
        InputError: says what was expected, and in which row or where along the path it is not so.
    """
    given = {"speed": speed, "acceleration": acceleration}
    _positive("path", lateral_acceleration=lateral_acceleration, segment_length=segment_length)
    _positive("path", **{label: value for label, value in given.items() if value is not None})
    if not 0 <= reserve < 1:
        raise InputError(f"path.reserve: expected a part in [0, 1), got {reserve}")
    if not 0 <= smoothing <= LONGEST:
        raise InputError(f"path.smoothing: expected a distance in m from 0 to {LONGEST:g}, got {smoothing}")

    source = File(file)
    rows, closed = _distinct(source, _read(source), closed)
    curve, knots = _curve(source, rows, closed, smoothing)
    bend, thrust = math.inf, math.inf
    if isinstance(vehicle, KinematicBicycle):
        bend = (1 - reserve) * vehicle.max_tan_steering / vehicle.wheelbase
        thrust = (1 - reserve) * vehicle.max_thrust
    elif acceleration is None:
        raise InputError(f"path.acceleration: expected a number, as the thrust of a {vehicle.name} is not known")
    _check_bends(source, curve, bend, reserve)
    if acceleration is not None:
        thrust = min(thrust, acceleration)
    cap = _cap(rows, curve, knots, closed, speed)
    profile = _speed(curve, cap, lateral_acceleration, thrust, closed)
    if curve.length > MOST_SEGMENTS * segment_length:
        raise InputError(
            f"path.segment_length: expected at least {curve.length / MOST_SEGMENTS:.3g} m for a path of "
            f"{curve.length:.6g} m, got {segment_length}"
        )
    count = max(1, round(curve.length / segment_length))
    path = path_along("waypoints", curve, profile, segments=count)
    return _slowed(path, cap, lateral_acceleration, thrust)


# --- the file


def _read(file: File) -> _Rows:
    try:
        text = file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{file}: expected a CSV file of waypoints, there is no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: expected a CSV file of waypoints, it cannot be read ({error})") from None
    columns: tuple[int, int, int | None] | None = None
    numbers, found = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        comment = line.lstrip().startswith("#")
        cells = [cell.strip() for cell in next(csv.reader([line.lstrip().lstrip("#")]), [])]
        if not any(cells):
            continue
        if columns is None:
            named = _named(cells)
            if comment and named is None:
                continue
            columns = named or _counted(file, number, cells)
            if named:
                continue
        if not comment:
            numbers.append(number)
            found.append(_point(file, number, cells, columns))
    if not found or columns is None:
        raise InputError(f"{file}: expected at least two points, one x,y a row; the file is empty")
    table = np.array(found)
    speed = None if columns[2] is None else table[:, 2]
    return _Rows(np.array(numbers), table[:, 0] + 1j * table[:, 1], speed)


def _named(cells: list[str]) -> tuple[int, int, int | None] | None:
    """Columns of x, y and speed where the cells are their names."""
    names = [cell.lower().strip("\"' ").split("_")[0].split("[")[0].split("(")[0].strip() for cell in cells]
    if "x" not in names or "y" not in names:
        return None
    fast = [names.index(name) for name in ("speed", "v", "vx", "velocity") if name in names]
    return names.index("x"), names.index("y"), fast[0] if fast else None


def _counted(file: File, row: int, cells: list[str]) -> tuple[int, int, int | None]:
    if len(cells) not in (2, 3) or not any(map(_is_number, cells)):
        raise InputError(
            f"{file}, row {row}: expected the numbers x,y or x,y,speed, or a header that names x and y; got "
            f"{','.join(cells)[:60]}"
        )
    return 0, 1, 2 if len(cells) == 3 else None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _point(file: File, row: int, cells: list[str], columns: tuple[int, int, int | None]) -> list[float]:
    result = []
    for label, column in zip(("x", "y", "speed"), columns, strict=True):
        if column is None:
            continue
        cell = cells[column] if column < len(cells) else ""
        if not _is_number(cell):
            raise InputError(f"{file}, row {row}: expected a number for {label}, got {cell!r}")
        value = float(cell)
        if not math.isfinite(value):
            raise InputError(f"{file}, row {row}: expected a finite number for {label}, got {cell}")
        if label == "speed" and value <= 0:
            raise InputError(f"{file}, row {row}: expected a positive speed, got {cell}")
        result.append(value)
    return result


def _distinct(file: File, rows: _Rows, closed: bool | None) -> tuple[_Rows, bool]:
    """Points that differ from the one before, of a lap without the repeated first one; whether it is a lap."""
    place = rows.place
    if len(place) == 1:
        raise InputError(f"{file}, row {rows.row[0]}: expected at least two points, got one")
    same = MERGED * float(np.abs(place - place[0]).max())
    if same == 0:
        raise InputError(f"{file}: expected points that differ, all {len(place)} are {_at(place[0])}")
    length = float(np.abs(np.diff(place)).sum())
    if not SHORTEST <= length <= LONGEST:
        raise InputError(
            f"{file}: expected points in m, between {SHORTEST:g} and {LONGEST:g} m along them, got {length:.4g} m"
        )
    keep = [0]
    for index in range(1, len(place)):
        if abs(place[index] - place[keep[-1]]) > same:
            keep.append(index)
    returns = bool(abs(place[keep[-1]] - place[0]) <= same)
    closed = returns if closed is None else closed
    if closed and returns:
        keep.pop()
    if closed and len(keep) < 3:
        raise InputError(f"{file}: expected at least three different points of a closed path, got {len(keep)}")
    chosen = np.array(keep)
    return _Rows(rows.row[chosen], place[chosen], None if rows.speed is None else rows.speed[chosen]), closed


def _at(place: complex) -> str:
    return f"x = {place.real:.6g} m, y = {place.imag:.6g} m"


# --- the curve


def _curve(file: File, rows: _Rows, closed: bool, smoothing: float) -> tuple[Curve, np.ndarray]:
    """The spline, and the parameters (chord length, m) of the points; of a lap with the first one at the end again."""
    origin = rows.place[0]  # maps count from far away: there the differences of coordinates have few digits
    place = (np.append(rows.place, origin) if closed else rows.place) - origin
    chords = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(place)))])
    points = chords
    along = place * np.conj(place[-1])
    forwards = np.all(np.diff(along.real) > 0)
    if not closed and forwards and np.abs(along.imag).max() <= STRAIGHT * abs(place[-1]) ** 2:
        direction = place[-1] / abs(place[-1])
        line = Curve(
            lambda u: origin + direction * u, lambda u: direction + 0 * u, lambda u: 0j * u, (0.0, float(chords[-1]))
        )
        return line, points
    if smoothing:
        spline = _smooth(file, chords, _columns(place), closed, smoothing)
    else:
        place, own = _filled(file, place, chords, closed)
        chords = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(place)))])
        if closed:
            # a periodic spline needs more points than its degree; a cubic one has continuous curvature too
            spline = make_interp_spline(chords, _columns(place), 5 if len(place) > 6 else 3, bc_type="periodic")
        else:
            ends = [(3, np.zeros(2)), (4, np.zeros(2))]  # natural: as if nothing pulled beyond the ends
            spline = make_interp_spline(chords, _columns(place), 5, bc_type=(ends, ends))
        points = chords[own]

    def derivative(order: int):
        own = spline.derivative(order) if order else spline
        offset = 0.0 if order else origin

        def at(u: np.ndarray) -> np.ndarray:
            value = own(u)
            return offset + value[..., 0] + 1j * value[..., 1]

        return at

    inner = np.unique(spline.t[(spline.t > 0) & (spline.t < chords[-1])])
    knots = tuple(float(u) for u in [0.0, *inner, chords[-1]])
    return Curve(derivative(0), derivative(1), derivative(2), knots), points


def _filled(file: File, place: np.ndarray, chords: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """The points, with more of them in long gaps, and where the own ones are among them.

    A quintic spline that comes from dense points into a long gap swings far out; Akima's curve, which looks at the
    nearest neighbours alone, does not, and says where it should go.
    """
    gaps = np.diff(chords)
    count = np.maximum(1, np.ceil(gaps / (LONGEST_GAP * np.median(gaps)) - 1e-9)).astype(int)
    if count.sum() > MOST_POINTS:
        raise InputError(
            f"{file}: expected points at more even distances, or at most {MOST_POINTS}: at the median distance, "
            f"{np.median(gaps):.3g} m, the whole way would need {count.sum()}"
        )
    own = np.concatenate([[0], np.cumsum(count)])
    if count.max() == 1:
        return place, own
    around, begin = (np.concatenate([place[-4:-1], place, place[1:4]]), 3) if closed else (place, 0)
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(around)))])
    at = along[begin : begin + len(place)]
    fine = np.interp(np.arange(own[-1] + 1), own, at)
    table = Akima1DInterpolator(along, _columns(around), method="makima")(fine)
    result = table[:, 0] + 1j * table[:, 1]
    result[own] = place
    return result, own


def _columns(place: np.ndarray) -> np.ndarray:
    return np.stack([np.real(place), np.imag(place)], axis=1)


def _smooth(file: File, chords: np.ndarray, table: np.ndarray, closed: bool, smoothing: float) -> BSpline:
    degree = min(5, len(chords) - 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            (t, c, k), _ = splprep(table.T, u=chords, k=degree, s=len(chords) * smoothing**2, per=closed)
    except (RuntimeWarning, ValueError, TypeError) as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(f"{file}: no curve of this kind passes the points by {smoothing:g} m ({reason})") from None
    return BSpline(t, np.array(c).T, k)


def _check_bends(file: File, curve: Curve, largest: float, reserve: float) -> None:
    """Raises InputError where the curve bends more than the steering allows, or turns back on itself."""
    knots = np.array(curve.knots)
    u = np.unique(np.linspace(knots[:-1], knots[1:], SAMPLES_PER_POINT + 1))
    first = curve.first(u)
    with np.errstate(divide="ignore", invalid="ignore"):
        kappa = np.nan_to_num(np.abs(curve.curvature(u)), nan=math.inf)
    turns = np.abs(np.angle(first[1:] * np.conj(first[:-1])))
    kappa[:-1][turns > SHARPEST] = math.inf
    worst = int(kappa.argmax())
    if kappa[worst] <= largest and math.isfinite(kappa[worst]):
        return
    place = curve.position(u)
    arc = float(np.abs(np.diff(place[: worst + 1])).sum())
    bend = f"a radius of {1 / kappa[worst]:.4g} m" if math.isfinite(kappa[worst]) else "a cusp"
    if math.isinf(largest):
        raise InputError(
            f"{file}: after {arc:.4g} m, at {_at(place[worst])}, the path through the points turns back on itself; "
            "expected points of a smooth curve"
        )
    raise InputError(
        f"{file}: after {arc:.4g} m, at {_at(place[worst])}, the path through the points has a curvature of "
        f"{kappa[worst]:.4g} 1/m ({bend}); expected at most {largest:.4g} 1/m, which the steering allows with a "
        f"reserve of {reserve:g}"
    )


# --- the speed


def _cap(rows: _Rows, curve: Curve, knots: np.ndarray, closed: bool, speed: float | None) -> PPoly:
    """The speed asked for (m/s), by arc length (m): linear between points."""
    if rows.speed is None:
        level = SPEED if speed is None else speed
        return PPoly(np.array([[0.0], [level]]), np.array([0.0, curve.length]))
    wanted = np.minimum(np.append(rows.speed, rows.speed[0]) if closed else rows.speed, speed or math.inf)
    at = curve.arc_length(knots)
    return PPoly(np.stack([np.diff(wanted) / np.diff(at), wanted[:-1]]), at)


def _speed(curve: Curve, cap: PPoly, lateral: float, thrust: float, closed: bool) -> float | PPoly:
    """v (m/s) by arc length (m), once continuously differentiable, or the one constant speed."""
    length = curve.length
    count = max(GRID, math.ceil(length / CELL))
    s = np.linspace(0.0, length, count + 1)
    step = length / count
    kappa = np.abs(curve.curvature(curve.at(s)))
    sideways = (1 - BEND_HEADROOM) * lateral
    limit = np.minimum(cap(s) ** 2, sideways / np.maximum(kappa, sideways / cap(s) ** 2)) / 2
    if np.ptp(limit) <= LEAST_CHANGE * limit.min():
        wanted, allowed = float(cap(0.0)), math.sqrt(2 * limit.min())
        return wanted if abs(wanted - allowed) <= ROUNDING * wanted else allowed
    mode, period = ("wrap", limit[:-1]) if closed else ("edge", limit)
    top = math.sqrt(2 * _passed(limit, step, thrust, closed).max())
    cells = min(max(1, round(SMOOTHING_TIME * top / step)), count // 8)
    # of a lap the neighbours of a window are those across its joint; an open path goes on as it ends
    around = np.pad(period, count if closed else cells, mode=mode)
    least = minimum_filter1d(around, 2 * cells + 3, mode="nearest")
    energy = _ramps(least, step, (1 - THRUST_HEADROOM) * thrust)
    total = np.concatenate([[0.0], np.cumsum(step * (energy[1:] + energy[:-1]) / 2)])
    index = np.arange(count + 1) + (count if closed else cells)
    mean = (total[index + cells] - total[index - cells]) / (2 * cells * step)
    slope = (energy[index + cells] - energy[index - cells]) / (2 * cells * step)
    if closed:
        mean[-1], slope[-1] = mean[0], slope[0]
    v = np.sqrt(2 * mean)
    if not (v.min() > 0 and np.isfinite(slope / v).all()):
        raise InputError(
            f"path.speed: expected speeds and limits that can be computed with, got {v.min():.3g} to {v.max():.3g} m/s"
        )
    return CubicHermiteSpline(s, v, slope / v)


def _passed(limit: np.ndarray, step: float, thrust: float, closed: bool) -> np.ndarray:
    around = np.tile(limit, 3) if closed else limit
    return _ramps(around, step, thrust)


def _ramps(limit: Float[np.ndarray, " n"], step: float, thrust: float) -> Float[np.ndarray, " n"]:
    """The largest energy below the limit whose slope is at most the thrust: one pass forwards, one backwards."""
    ramp = thrust * step * np.arange(len(limit))
    forwards = np.minimum.accumulate(limit - ramp) + ramp
    return (np.minimum.accumulate(forwards[::-1] - ramp) + ramp)[::-1]


def _slowed(path: Path, cap: PPoly, lateral: float, thrust: float) -> Path:
    """The path at the largest part of its speed, at most 1, with which every limit is kept."""
    excess, passed = 1.0, 0.0
    for segment in path.curve:
        speed, turn_rate = segment.speed.polynomial, segment.turn_rate.polynomial
        theta = _looked_at(speed, speed.derivative(), _product(speed, turn_rate))
        v = speed(theta)
        arc = passed + speed.antiderivative()(theta)
        passed = float(arc[-1])
        excess = max(
            excess,
            float((v / cap(np.clip(arc, 0.0, cap.x[-1]))).max()) ** 2,
            float(np.abs(turn_rate(theta) * v).max()) / lateral,
            float(np.abs(speed(theta, 1)).max()) / thrust,
        )
    if excess <= 1 + ROUNDING:
        return path
    part = 1 / math.sqrt(excess * (1 + ROUNDING))
    slower = (Segment(_stretched(s.turn_rate, part), _stretched(s.speed, part), s.start) for s in path.curve)
    return Path(path.name, tuple(slower))


def _product(first: PPoly, second: PPoly) -> PPoly:
    """Of two piecewise polynomials: one of them is constant, or their breaks are the same."""
    for one, other in ((first, second), (second, first)):
        if one.c.shape == (1, 1):
            return PPoly(one.c[0, 0] * other.c, other.x)
    columns = zip(first.c.T, second.c.T, strict=True)
    return PPoly(np.stack([np.convolve(a, b) for a, b in columns], axis=1), second.x)


def _looked_at(*polynomials: PPoly) -> np.ndarray:
    """θ between the ends of pieces, and where one of the polynomials has an extreme value."""
    breaks = np.unique(np.concatenate([p.x for p in polynomials]))
    at = [np.linspace(breaks[:-1], breaks[1:], 17).ravel()]
    for polynomial in polynomials:
        slope = polynomial.derivative()
        roots = slope.roots(discontinuity=False, extrapolate=False)  # nan where a piece is constant
        at.append(roots[np.isfinite(roots)])
    return np.unique(np.concatenate(at))


def _stretched(rate: Profile, part: float) -> Profile:
    """A rate of motion at a part of the speed: part · rate(part · θ)."""
    return Profile(
        tuple(b / part for b in rate.breaks),
        tuple(tuple(c * part ** (k + 1) for k, c in enumerate(piece)) for piece in rate.coefficients),
    )
