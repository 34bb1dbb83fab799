"""A path through points: a smooth curve, at a speed that the car can drive.

Files, columns and units: `cfjax.problem.points`.

The curve is a quintic spline over chord length: its curvature is twice continuously differentiable. The energy E = v²/2
per kg along arc length s makes the limits on speed plain, for dv/dt = dE/ds:

* v is at most the speed asked for, and √(a_lat/|κ|): nothing in a kinematic model bounds speed in bends;
* |dE/ds| is at most the thrust that the car may use. The largest such E comes from one pass forwards and one backwards.

A mean over a window makes dE/ds continuous and keeps |dE/ds|; it keeps the limits on speed because these were replaced
by their minima over the same window before. What polynomials (`cfjax.problem.curves`) miss of that is paid for by
driving the whole profile a little slower: time stretched by c divides speed by c and acceleration by c².
"""

import math
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path as File
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import Akima1DInterpolator, BSpline, CubicHermiteSpline, PPoly, make_interp_spline, splprep
from scipy.ndimage import minimum_filter1d

from cfjax import coerce
from cfjax.coerce import Number
from cfjax.errors import InputError
from cfjax.problem.curves import Curve, path_along
from cfjax.problem.path import Path, Profile, Segment, length_of, speed_of
from cfjax.problem.points import LONGEST, Course, Points, Source, at, course_of, metres, read_points
from cfjax.problem.vehicle import KinematicBicycle, Vehicle


SPEED = 2.0  # m/s, where neither the file nor the caller says
WHEELBASE = 0.34  # m, of the car for which lengths and tolerances are right as they stand; they scale with it
SEGMENT_LENGTH = 10.0  # m, of that car's path where the caller says nothing
SEGMENTS = 256  # at most, where the caller says nothing: all of their pieces stand in one certificate
MOST_SEGMENTS = 10_000
MOST_POINTS = 100_000  # with those that fill gaps
STRAIGHT = 1e-12  # of the extent: points that leave a line by less are on it
LONGEST_GAP = 2.0  # of the median distance between neighbours: where points are farther apart the spline gets more
SAMPLES_PER_POINT = 64  # at which curvature is looked at
SHARPEST = 0.5  # rad between two samples: a cusp, whatever the curvature at the samples is
BACK = 2.2  # rad: the way turns back where it turns by more at a point, and over the points around it too
MOST_SMOOTHED = 20_000  # points for which a smoothing is looked for
SETTLED = 0.7  # a smoothing that takes more than the rest of the largest curvature away has still noise to take
LARGEST_STEP = 200.0  # wheelbases between neighbours, in a file of many points without units
LARGE_STEP, LARGE_RADIUS = 30.0, 60.0  # wheelbases between neighbours, in the tightest bend: from here on it is said
SHORT = 5.0  # wheelbases: a path in all that the car cannot follow may be in another unit
ROUND = 0.1  # of the points' distance from their middle: a larger smoothing takes away the path, not its noise
MANY = 20  # points whose distances say something
RESERVE = 0.2  # where the caller says nothing
GRID = 4096  # cells of the speed profile, at least
CELL = 0.05  # m, at most, for that car
SMOOTHING_TIME = 0.25  # s: over so much at top speed, either way, acceleration is smoothed
THRUST_HEADROOM = 0.02  # relative: for what the polynomials miss, so that the whole need not be slower
BEND_HEADROOM = 5e-3
ROUNDING = 1e-12
ALIKE = 1e-9  # relative: bends that differ by less are equally tight
LEAST_CHANGE = 1e-6  # relative: a speed that varies by less is constant


class _Limits(NamedTuple):
    """What the path keeps."""

    speed: float | None  # m/s
    lateral: float  # m/s²
    thrust: float  # m/s²
    reserve: float
    car: KinematicBicycle | None  # None: one of whose steering nothing is known

    @property
    def bend(self) -> float:
        """1/m."""
        return math.inf if self.car is None else (1 - self.reserve) * self.car.max_tan_steering / self.car.wheelbase

    @property
    def scale(self) -> float:
        """By how much the car is larger than the one of the constants; 1 where its size is not known."""
        return 1.0 if self.car is None else self.car.wheelbase / WHEELBASE


class _Rough(InputError):
    """The points make no curve that the car can drive; less of their noise might."""


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # what is not finite is refused by name
def waypoints(
    file: Source,
    *,
    columns: Sequence[str] | None = None,
    closed: bool | None = None,
    speed: Number | None = None,
    least_speed: Number | None = None,
    lateral_acceleration: Number = 4.0,
    acceleration: Number | None = 1.0,
    reserve: Number = RESERVE,
    vehicle: Vehicle = KinematicBicycle(),
    segment_length: Number | None = None,
    smoothing: Number = 0.0,
) -> Path:
    """The path through the points of a text file, or of memory, in the order in which they stand there.

    A file has columns x and y (m) and, if wanted, speed (m/s, the most that is driven there). A header names them, in
    any order and beside others, with units if they are not m and m/s: `x, y, speed`, `pos_x_mm, pos_y_mm, v [km/h]`.
    Without one the first columns are these; a third that may be no speed is refused. Separators, decimal sign and
    encoding are recognised; lines that begin with # are skipped; points that repeat the one before are merged.

    In memory they are rows x, y or x, y, speed (an array, a list), complex numbers x + iy, or columns by name (a
    mapping, a data frame).

    How everything was taken stands in one line in the path's `source`, and in `doubt` why another unit may be meant.

    Args:
        file: the file's name, or the points.
        columns: names of all columns, with units, instead of a header: `["x_mm", "y_mm", "time"]`.
        closed: whether it is a lap; None: where its end meets its beginning, or runs over it, or would go on at the
            first point.
        speed: the most that is driven anywhere, m/s; None: what the file says, or 2 m/s.
        least_speed: where the file says less, such as 0 at a stop, this is driven there, m/s; None: a stop is refused.
        lateral_acceleration: largest |κ| v², m/s².
        acceleration: largest |dv/dt|, m/s², beside what thrust allows; None: thrust alone. The package's tubes hold 1
            m/s² at all speeds and 2 m/s² from 3 m/s on.
        reserve: the part of steering and of thrust that is left to feedback, in [0, 1); not of a vehicle of one's own.
        vehicle: what drives; of one of your own nothing is known here but `lateral_acceleration` and `acceleration`,
            and `Problem` says where its inputs do not do it.
        segment_length: m; the path is cut into segments of equal length, as near to this as can be. None: 10 m for a
            car with a wheelbase of 0.34 m, in proportion for others, more where that makes more than 256 of them.
        smoothing: root of the mean square distance, m, by which the curve may pass the points; 0: through them.

    Raises:
        InputError: says what was expected, and in which row or where along the path it is not so.
    """
    closed = None if closed is None else coerce.flag("path.closed", closed)
    speed = None if speed is None else speed_of(speed)
    least_speed = None if least_speed is None else coerce.number("path.least_speed", least_speed, "m/s", above=0)
    lateral_acceleration = coerce.number("path.lateral_acceleration", lateral_acceleration, "m/s²", above=0)
    acceleration = None if acceleration is None else coerce.number("path.acceleration", acceleration, "m/s²", above=0)
    reserve = coerce.number("path.reserve", reserve, least=0, below=1)
    coerce.instance("vehicle", vehicle, Vehicle)
    segment_length = None if segment_length is None else length_of("segment_length", segment_length)
    smoothing = coerce.number("path.smoothing", smoothing, "m", least=0, most=LONGEST)

    if least_speed is not None and least_speed > (speed or math.inf):
        raise InputError(f"path.least_speed: expected at most path.speed, {speed} m/s, got {least_speed}")

    course = course_of(_moving(read_points(file, columns), least_speed), closed)
    car = vehicle if isinstance(vehicle, KinematicBicycle) else None
    if car is None and reserve != RESERVE:
        raise InputError(
            f"path.reserve: expected none for a {vehicle.name}, of whose steering and thrust nothing is known here "
            f"(path.lateral_acceleration and path.acceleration are its limits), got {reserve:g}"
        )
    thrust = math.inf if car is None else (1 - reserve) * car.max_thrust
    if acceleration is not None:
        thrust = min(thrust, acceleration)
    elif car is None:
        raise InputError(f"path.acceleration: expected a number, as the thrust of a {vehicle.name} is not known")
    limits = _Limits(speed, lateral_acceleration, thrust, reserve, car)
    _check_size(course.points, car)
    _check_smoothing(course.points, smoothing)
    try:
        return _path(course, limits, segment_length, smoothing)
    except _Rough as rough:
        _check_back(course)
        way_out = _way_out(course, limits, segment_length, smoothing)
        raise InputError(f"{rough}{way_out or _short(course, car)}") from None


def _path(course: Course, limits: _Limits, segment_length: float | None, smoothing: float) -> Path:
    points, closed = course.points, course.closed
    curve, knots = _curve(points, closed, smoothing)
    _check_bends(course, curve, limits)
    cap = _cap(points, curve, knots, closed, limits.speed)
    profile = _speed(curve, cap, limits, closed)
    if segment_length is None:
        segment_length = max(limits.scale * SEGMENT_LENGTH, curve.length / SEGMENTS)
    if curve.length > MOST_SEGMENTS * segment_length:
        raise InputError(
            f"path.segment_length: expected at least {curve.length / MOST_SEGMENTS:.3g} m for a path of "
            f"{curve.length:.6g} m, got {segment_length}"
        )
    count = max(1, round(curve.length / segment_length))
    try:
        path = path_along("waypoints", curve, profile, segments=count, scale=limits.scale)
    except InputError as error:
        raise _Rough(f"{points.source}: {error}") from None
    path = _slowed(path, cap, limits.lateral, limits.thrust)
    return replace(path, source=_account(course, path, curve, limits, smoothing), doubt=_large(course, curve, limits))


# --- what is said of the points


def _account(course: Course, path: Path, curve: Curve, limits: _Limits, smoothing: float) -> str:
    """How the points were taken, in one line."""
    points, meaning = course.points, course.points.meaning
    polynomials = [segment.speed.polynomial for segment in path.curve]
    speeds = np.concatenate([polynomial(_looked_at(polynomial)) for polynomial in polynomials])
    least, most = float(speeds.min()), float(speeds.max())
    bend = float(np.abs(curve.curvature(_samples(curve))).max())
    said = [
        f"{len(points.place)} points",
        metres(curve.length),
        course.account,
        f"{most:.3g} m/s" if most - least < 1e-3 * most else f"{least:.3g} to {most:.3g} m/s",
        f"smallest radius {metres(1 / bend)}" if bend * curve.length > 1e-6 else "straight",
        *([f"smoothed by {smoothing:g} m"] if smoothing else []),
        f"columns {', '.join(meaning.used)}",
    ]
    if points.speed is None and limits.speed is None:
        said[3] += " (no speed is given)"
    unused = [*meaning.unused[:6], *(["…"] if len(meaning.unused) > 6 else [])]
    name = File(points.source).name if points.in_file else points.source
    return f"{name}: {', '.join(said)}" + (f"; {', '.join(unused)} not used" if unused else "")


def _moving(points: Points, least: float | None) -> Points:
    """The points with speeds above 0.

    Raises:
        InputError: where the car stands, and `least` (m/s) does not say how fast it is instead; or goes back.
    """
    if least is not None and points.speed is None:
        raise InputError(f"path.least_speed: expected points with speeds, got none in {points.source}")
    if points.speed is None:
        return points
    first = int(points.speed.argmin())
    if points.speed[first] < 0:
        raise InputError(
            f"{points.at(first)}: expected a positive speed, got {points.speed[first]:.4g} m/s: driving backwards "
            "is not planned; cut the points there"
        )
    if least is not None:
        return points._replace(speed=np.maximum(points.speed, least))
    if points.speed[first] == 0:
        most = float(points.speed.max())
        if most == 0:
            raise InputError(f"{points.source}: expected a positive speed, got 0 in all rows")
        raise InputError(
            f"{points.at(first)}: expected a positive speed, got 0, where a car cannot be steered; "
            f"path.least_speed={min(1.0, _nice(most / 2)):g} drives no slower than that (m/s)"
            + ("" if points.meaning.named else "; where the third column is no speed, path.columns=[x,y,_]")
        )
    return points


def _check_size(points: Points, car: KinematicBicycle | None) -> None:
    """Raises InputError where the distances of points are none that this car drives, and nobody said their unit."""
    if car is None or points.meaning.units:
        return
    steps = np.abs(np.diff(points.place))
    typical, length = float(np.median(steps)), float(steps.sum())
    large = typical > LARGEST_STEP * car.wheelbase and len(steps) >= MANY
    if large or length < car.wheelbase:
        got = f"{typical:.4g} m between points" if large else f"{length:.4g} m in all"
        unit = "mm" if large else "km"
        raise InputError(
            f"{points.source}: expected points in m that suit a wheelbase of {car.wheelbase:g} m, got {got}: say their "
            f"unit, as in x_{unit},y_{unit} or x_m,y_m, in the header or by path.columns=[x_{unit},y_{unit}]"
        )


def _check_smoothing(points: Points, smoothing: float) -> None:
    """Raises InputError where so much smoothing leaves nothing of the path."""
    size = float(np.sqrt(np.mean(np.abs(points.place - points.place.mean()) ** 2)))
    if smoothing > ROUND * size:
        raise InputError(
            f"path.smoothing: expected at most {ROUND * size:.3g} m for points that lie {size:.3g} m around their "
            f"middle, got {smoothing:g}: more takes away the path, not its noise"
        )


def _large(course: Course, curve: Curve, limits: _Limits) -> str:
    """Why the points may be in a smaller unit than m, where nobody said it; empty where nothing speaks for it."""
    car, points = limits.car, course.points
    if car is None or points.meaning.units:
        return ""
    steps = np.abs(np.diff(points.place)) / car.wheelbase
    u = _samples(curve)
    headings = np.unwrap(np.angle(curve.first(u)))
    radius = 1 / max(float(np.abs(curve.curvature(u)).max()), 1e-300) / car.wheelbase
    found = []
    if np.ptp(headings) > math.pi / 2 and radius > LARGE_RADIUS:
        found.append(f"its tightest bend has a radius of {radius:.3g}")
    if len(steps) >= MANY and np.median(steps) > LARGE_STEP:
        found.append(f"its points are {np.median(steps):.3g} apart")
    if not found:
        return ""
    return (
        f"{points.source}: {metres(curve.length)} are {curve.length / car.wheelbase:.3g} wheelbases ({car.wheelbase:g} "
        f"m), {' and '.join(found)}: where the points are not in m, say their unit, as x_cm,y_cm, in the header or by "
        "'path.columns=[x_cm,y_cm]'; x_m,y_m where they are"
    )


def _short(course: Course, car: KinematicBicycle | None) -> str:
    """For the message about a path that the car cannot follow: that it may be in a larger unit than m."""
    if car is None or course.points.meaning.units:
        return ""
    length = float(np.abs(np.diff(course.points.place)).sum())
    if length > SHORT * car.wheelbase:
        return ""
    return f"; {metres(length)} in all are {length / car.wheelbase:.3g} wheelbases: are the points in m?"


def _check_back(course: Course) -> None:
    """Raises InputError where the way through the points turns back at one of them, and over those around it."""
    place = course.points.place
    if course.closed:
        place = place[np.arange(-4, len(place) + 5) % len(place)]
    chords = np.diff(place)
    turns = np.abs(np.angle(chords[1:] * np.conj(chords[:-1])))
    for vertex in np.flatnonzero(turns > BACK) + 1:
        around = [
            np.angle((place[min(vertex + n, len(place) - 1)] - place[vertex]) * np.conj(place[vertex] - place[before]))
            for n in (2, 3, 4)
            if (before := max(vertex - n, 0)) < vertex
        ]
        if all(abs(turn) > BACK for turn in around):
            index = (int(vertex) - 4) % len(course.points.place) if course.closed else int(vertex)
            raise InputError(
                f"{course.points.at(index)}: the path turns back on itself at {at(place[vertex])} (a cusp); expected a "
                "way that is driven forwards: driving backwards is not planned; cut the points there"
            )


def _way_out(course: Course, limits: _Limits, segment_length: float | None, smoothing: float) -> str:
    """The least smoothing with which these very points make a path, for the message; empty where none does."""
    spacing = float(np.median(np.abs(np.diff(course.points.place))))
    if len(course.points.place) > MOST_SMOOTHED:
        return ""
    exponents = range(math.floor(math.log10(spacing)), math.floor(math.log10(spacing)) - 3, -1)
    values = [float(f"{digit}e{exponent}") for exponent in exponents for digit in (5, 2, 1)]
    bends: list[tuple[float, float]] = []
    for value in (value for value in values if smoothing < value <= spacing):  # large ones take the least time
        try:
            curve = _curve(course.points, course.closed, value)[0]
            _check_bends(course, curve, limits)
            bends.insert(0, (value, float(np.abs(curve.curvature(_samples(curve))).max())))
        except InputError:
            if bends:
                break
    for index, (value, bend) in enumerate(bends):
        if index + 1 < len(bends) and bends[index + 1][1] <= SETTLED * bend:  # there is noise left in it
            continue
        with suppress(InputError):
            _path(course, limits, segment_length, value)
            return f"; for points with noise, or rounded ones, path.smoothing={value:g} (m, past the points) does it"
    return ""


def _nice(value: float) -> float:
    """A number of one digit, not above this one."""
    unit = 10.0 ** math.floor(math.log10(value))
    return math.floor(value / unit) * unit


# --- the curve


def _curve(rows: Points, closed: bool, smoothing: float) -> tuple[Curve, np.ndarray]:
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
        spline = _smooth(rows.source, chords, _columns(place), closed, smoothing)
    else:
        place, own = _filled(rows.source, place, chords, closed)
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


def _filled(file: str, place: np.ndarray, chords: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
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


def _smooth(file: str, chords: np.ndarray, table: np.ndarray, closed: bool, smoothing: float) -> BSpline:
    degree = min(5, len(chords) - 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            (t, c, k), _ = splprep(table.T, u=chords, k=degree, s=len(chords) * smoothing**2, per=closed)
    except (RuntimeWarning, ValueError, TypeError) as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(f"{file}: no curve of this kind passes the points by {smoothing:g} m ({reason})") from None
    return BSpline(t, np.array(c).T, k)


def _samples(curve: Curve) -> Float[np.ndarray, " n"]:
    """Parameters at which curvature is looked at."""
    knots = np.array(curve.knots)
    return np.unique(np.linspace(knots[:-1], knots[1:], SAMPLES_PER_POINT + 1))


def _check_bends(course: Course, curve: Curve, limits: _Limits) -> None:
    """Raises _Rough where the curve bends more than the steering allows, or turns on the spot."""
    points, u = course.points, _samples(curve)
    first = curve.first(u)
    with np.errstate(divide="ignore", invalid="ignore"):
        kappa = np.nan_to_num(np.abs(curve.curvature(u)), nan=math.inf)
    turns = np.abs(np.angle(first[1:] * np.conj(first[:-1])))
    kappa[:-1][turns > SHARPEST] = math.inf
    worst = int((kappa >= (1 - ALIKE) * kappa.max()).argmax())  # the first of those that differ by rounding alone
    if kappa[worst] <= limits.bend and math.isfinite(kappa[worst]):
        return
    place = curve.position(u)
    arc = float(np.abs(np.diff(place[: worst + 1])).sum())
    near = int(np.abs(points.place - place[worst]).argmin())
    joint = " (where the lap closes)" if course.closed and near in (0, len(points.place) - 1) else ""
    where = f"{points.at(near)}: after {arc:.4g} m, at {at(place[worst])}{joint}, the path through the points"
    car = limits.car
    if car is None:
        raise _Rough(f"{where} turns on the spot; expected points of a smooth curve")
    bend = f"with a radius of {1 / kappa[worst]:.3g} m" if math.isfinite(kappa[worst]) else "on the spot"
    angles = [math.degrees(math.atan(w)) for w in (kappa[worst] * car.wheelbase, limits.bend * car.wheelbase)]
    raise _Rough(
        f"{where} turns {bend}, which takes a steering angle of {angles[0]:.3g}°; expected a radius of at least "
        f"{1 / limits.bend:.4g} m, {angles[1]:.3g}°, which is what path.reserve={limits.reserve:g} leaves of the car's "
        f"{math.degrees(math.atan(car.max_tan_steering)):.3g}°"
    )


# --- the speed


def _cap(rows: Points, curve: Curve, knots: np.ndarray, closed: bool, speed: float | None) -> PPoly:
    """The speed asked for (m/s), by arc length (m): linear between points."""
    if rows.speed is None:
        level = SPEED if speed is None else speed
        return PPoly(np.array([[0.0], [level]]), np.array([0.0, curve.length]))
    wanted = np.minimum(np.append(rows.speed, rows.speed[0]) if closed else rows.speed, speed or math.inf)
    at = curve.arc_length(knots)
    return PPoly(np.stack([np.diff(wanted) / np.diff(at), wanted[:-1]]), at)


def _speed(curve: Curve, cap: PPoly, limits: _Limits, closed: bool) -> float | PPoly:
    """v (m/s) by arc length (m), once continuously differentiable, or the one constant speed."""
    length = curve.length
    count = max(GRID, math.ceil(length / (limits.scale * CELL)))
    s = np.linspace(0.0, length, count + 1)
    step = length / count
    kappa = np.abs(curve.curvature(curve.at(s)))
    sideways = (1 - BEND_HEADROOM) * limits.lateral
    limit = np.minimum(cap(s) ** 2, sideways / np.maximum(kappa, sideways / cap(s) ** 2)) / 2
    if np.ptp(limit) <= LEAST_CHANGE * limit.min():
        wanted, allowed = float(cap(0.0)), math.sqrt(2 * limit.min())
        return wanted if abs(wanted - allowed) <= ROUNDING * wanted else allowed
    mode, period = ("wrap", limit[:-1]) if closed else ("edge", limit)
    top = math.sqrt(2 * _passed(limit, step, limits.thrust, closed).max())
    cells = min(max(1, round(SMOOTHING_TIME * top / step)), count // 8)
    # of a lap the neighbours of a window are those across its joint; an open path goes on as it ends
    around = np.pad(period, count if closed else cells, mode=mode)
    least = minimum_filter1d(around, 2 * cells + 3, mode="nearest")
    energy = _ramps(least, step, (1 - THRUST_HEADROOM) * limits.thrust)
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
    return replace(path, segments=tuple(slower))


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
