"""A smooth curve through points, and whether the car's steering can follow it.

A quintic spline over chord length: its curvature is twice continuously differentiable.
"""

import math
import warnings
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import Akima1DInterpolator, BSpline, make_interp_spline, splprep

from cfjax.errors import InputError
from cfjax.problem.curves import Curve
from cfjax.problem.points import Points, as_rows, at
from cfjax.problem.route import Route
from cfjax.problem.vehicle import KinematicBicycle


WHEELBASE = 0.34  # m, of the car for which lengths and tolerances are right as they stand; they scale with it
MOST_POINTS = 100_000  # with those that fill gaps
STRAIGHT = 1e-12  # of the extent: points that leave a line by less are on it
LONGEST_GAP = 2.0  # of the median distance between neighbours: where points are farther apart the spline gets more
SAMPLES_PER_POINT = 64  # at which curvature is looked at
SHARPEST = 0.5  # rad between two samples: a cusp, whatever the curvature at the samples is
ALIKE = 1e-9  # relative: bends that differ by less are equally tight


class PathLimits(NamedTuple):
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


class Rough(InputError):
    """The points make no curve that the car can drive; less of their noise might."""


def curve_through(rows: Points, closed: bool, smoothing: float) -> tuple[Curve, np.ndarray]:
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
        spline = _smooth(rows.source, chords, as_rows(place), closed, smoothing)
    else:
        place, own = _filled(rows.source, place, chords, closed)
        chords = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(place)))])
        if closed:
            # a periodic spline needs more points than its degree; a cubic one has continuous curvature too
            spline = make_interp_spline(chords, as_rows(place), 5 if len(place) > 6 else 3, bc_type="periodic")
        else:
            ends = [(3, np.zeros(2)), (4, np.zeros(2))]  # natural: as if nothing pulled beyond the ends
            spline = make_interp_spline(chords, as_rows(place), 5, bc_type=(ends, ends))
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
    table = Akima1DInterpolator(along, as_rows(around), method="makima")(fine)
    result = table[:, 0] + 1j * table[:, 1]
    result[own] = place
    return result, own


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


def samples(curve: Curve) -> Float[np.ndarray, " n"]:
    """Parameters at which curvature is looked at."""
    knots = np.array(curve.knots)
    return np.unique(np.linspace(knots[:-1], knots[1:], SAMPLES_PER_POINT + 1))


def check_bends(route: Route, curve: Curve, limits: PathLimits) -> None:
    """Raises Rough where the curve bends more than the steering allows, or turns on the spot."""
    points, u = route.points, samples(curve)
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
    joint = " (where the lap closes)" if route.closed and near in (0, len(points.place) - 1) else ""
    where = f"{points.at(near)}: after {arc:.4g} m, at {at(place[worst])}{joint}, the path through the points"
    car = limits.car
    if car is None:
        raise Rough(f"{where} turns on the spot; expected points of a smooth curve")
    bend = f"with a radius of {1 / kappa[worst]:.3g} m" if math.isfinite(kappa[worst]) else "on the spot"
    angles = [math.degrees(math.atan(w)) for w in (kappa[worst] * car.wheelbase, limits.bend * car.wheelbase)]
    raise Rough(
        f"{where} turns {bend}, which takes a steering angle of {angles[0]:.3g}°; expected a radius of at least "
        f"{1 / limits.bend:.4g} m, {angles[1]:.3g}°, which is what path.reserve={limits.reserve:g} leaves of the car's "
        f"{math.degrees(math.atan(car.max_tan_steering)):.3g}°"
    )
