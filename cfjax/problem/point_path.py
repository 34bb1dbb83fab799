"""A path through points: a smooth curve, at a speed that the car can drive.

Files, columns and units: `cfjax.problem.points`.

The curve: `cfjax.problem.point_curve`; the speed along it: `cfjax.problem.point_speed`.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path as File

import numpy as np

from cfjax import coerce
from cfjax.coerce import Number
from cfjax.errors import InputError
from cfjax.problem.curves import Curve, path_along
from cfjax.problem.path import Edges, Path, length_of, speed_of
from cfjax.problem.point_curve import PathLimits, Rough, check_bends, curve_through, samples
from cfjax.problem.point_speed import looked_at, slowed, speed_along, speed_cap
from cfjax.problem.points import LONGEST, Points, Source, at, metres, read_points
from cfjax.problem.route import Route, route_of
from cfjax.problem.vehicle import KinematicBicycle, Vehicle


SEGMENT_LENGTH = 10.0  # m, of that car's path where the caller says nothing
SEGMENTS = 256  # at most, where the caller says nothing: all of their pieces stand in one certificate
MOST_SEGMENTS = 10_000
BACK = 2.2  # rad: the way turns back where it turns by more at a point, and over the points around it too
MOST_SMOOTHED = 20_000  # points for which a smoothing is looked for
SETTLED = 0.7  # a smoothing that takes more than the rest of the largest curvature away has still noise to take
LARGEST_STEP = 200.0  # wheelbases between neighbours, in a file of many points without units
LARGE_STEP, LARGE_RADIUS = 30.0, 60.0  # wheelbases between neighbours, in the tightest bend: from here on it is said
SHORT = 5.0  # wheelbases: a path in all that the car cannot follow may be in another unit
ROUND = 0.1  # of the points' distance from their middle: a larger smoothing takes away the path, not its noise
MANY = 20  # points whose distances say something
RESERVE = 0.2  # where the caller says nothing


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

    >>> path = waypoints([(0.0, 0.0), (4.0, 0.0), (8.0, 1.0), (12.0, 1.0)], speed=2.0)
    >>> path.source
    'points: 4 points, 12.2 m, open (ends 12.0 m apart), 2 m/s, smallest radius 9.52 m, columns 1 (x), 2 (y)'

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

    route = route_of(_moving(read_points(file, columns), least_speed), closed)
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
    limits = PathLimits(speed, lateral_acceleration, thrust, reserve, car)
    _check_size(route.points, car)
    _check_smoothing(route.points, smoothing)
    try:
        return _path(route, limits, segment_length, smoothing)
    except Rough as rough:
        _check_back(route)
        way_out = _way_out(route, limits, segment_length, smoothing)
        raise InputError(f"{rough}{way_out or _short(route, car)}") from None


def _path(route: Route, limits: PathLimits, segment_length: float | None, smoothing: float) -> Path:
    points, closed = route.points, route.closed
    curve, knots = curve_through(points, closed, smoothing)
    check_bends(route, curve, limits)
    cap = speed_cap(points, curve, knots, closed, limits.speed)
    profile = speed_along(curve, cap, limits, closed)
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
        raise Rough(f"{points.source}: {error}") from None
    path = slowed(path, cap, limits.lateral, limits.thrust)
    source, doubt = _account(route, path, curve, limits, smoothing), _large(route, curve, limits)
    return replace(path, source=source, doubt=doubt, edges=_edges(points, curve, knots))


def _edges(points: Points, curve: Curve, knots: np.ndarray) -> Edges | None:
    """The points of the edges beside the points, where these have widths."""
    if points.widths is None:
        return None
    direction = curve.first(knots[: len(points.place)])
    left = 1j * direction / np.abs(direction)
    beside = (points.place + left * points.widths[:, 0], points.place - left * points.widths[:, 1])
    return tuple(tuple((x, y) for x, y in np.stack([edge.real, edge.imag], axis=1).tolist()) for edge in beside)


# --- what is said of the points


def _account(route: Route, path: Path, curve: Curve, limits: PathLimits, smoothing: float) -> str:
    """How the points were taken, in one line."""
    points, meaning = route.points, route.points.meaning
    polynomials = [segment.speed.polynomial for segment in path.curve]
    speeds = np.concatenate([polynomial(looked_at(polynomial)) for polynomial in polynomials])
    least, most = float(speeds.min()), float(speeds.max())
    bend = float(np.abs(curve.curvature(samples(curve))).max())
    said = [
        f"{len(points.place)} points",
        metres(curve.length),
        route.account,
        f"{most:.3g} m/s" if most - least < 1e-3 * most else f"{least:.3g} to {most:.3g} m/s",
        f"smallest radius {metres(1 / bend)}" if bend * curve.length > 1e-6 else "straight",
        *([f"smoothed by {smoothing:g} m"] if smoothing else []),
        f"columns {', '.join(meaning.used)}",
    ]
    if points.speed is None and limits.speed is None:
        said[3] += " (no speed is given)"
    unused = [*meaning.unused[:6], *(["…"] if len(meaning.unused) > 6 else [])]
    name = File(points.source).name if points.in_file else points.source
    account = f"{name}: {', '.join(said)}"
    if wide := points.meaning.width_names:
        account += f"; {', '.join(wide)} used with sets.corridor=file only"
    return account + (f"; {', '.join(unused)} not used" if unused else "")


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


def _large(route: Route, curve: Curve, limits: PathLimits) -> str:
    """Why the points may be in a smaller unit than m, where nobody said it; empty where nothing speaks for it."""
    car, points = limits.car, route.points
    if car is None or points.meaning.units:
        return ""
    steps = np.abs(np.diff(points.place)) / car.wheelbase
    u = samples(curve)
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


def _short(route: Route, car: KinematicBicycle | None) -> str:
    """For the message about a path that the car cannot follow: that it may be in a larger unit than m."""
    if car is None or route.points.meaning.units:
        return ""
    length = float(np.abs(np.diff(route.points.place)).sum())
    if length > SHORT * car.wheelbase:
        return ""
    return f"; {metres(length)} in all are {length / car.wheelbase:.3g} wheelbases: are the points in m?"


def _check_back(route: Route) -> None:
    """Raises InputError where the way through the points turns back at one of them, and over those around it."""
    place = route.points.place
    if route.closed:
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
            index = (int(vertex) - 4) % len(route.points.place) if route.closed else int(vertex)
            raise InputError(
                f"{route.points.at(index)}: the path turns back on itself at {at(place[vertex])} (a cusp); expected a "
                "way that is driven forwards: driving backwards is not planned; cut the points there"
            )


def _way_out(route: Route, limits: PathLimits, segment_length: float | None, smoothing: float) -> str:
    """The least smoothing with which these very points make a path, for the message; empty where none does."""
    spacing = float(np.median(np.abs(np.diff(route.points.place))))
    if len(route.points.place) > MOST_SMOOTHED:
        return ""
    exponents = range(math.floor(math.log10(spacing)), math.floor(math.log10(spacing)) - 3, -1)
    values = [float(f"{digit}e{exponent}") for exponent in exponents for digit in (5, 2, 1)]
    bends: list[tuple[float, float]] = []
    for value in (value for value in values if smoothing < value <= spacing):  # large ones take the least time
        try:
            curve = curve_through(route.points, route.closed, value)[0]
            check_bends(route, curve, limits)
            bends.insert(0, (value, float(np.abs(curve.curvature(samples(curve))).max())))
        except InputError:
            if bends:
                break
    for index, (value, bend) in enumerate(bends):
        if index + 1 < len(bends) and bends[index + 1][1] <= SETTLED * bend:  # there is noise left in it
            continue
        with suppress(InputError):
            _path(route, limits, segment_length, value)
            return f"; for points with noise, or rounded ones, path.smoothing={value:g} (m, past the points) does it"
    return ""


def _nice(value: float) -> float:
    """A number of one digit, not above this one."""
    unit = 10.0 ** math.floor(math.log10(value))
    return math.floor(value / unit) * unit
