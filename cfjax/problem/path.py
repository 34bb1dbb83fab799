"""References: a path is its turning rate and speed profile, segment by segment.

Only ω_r(θ), v_r(θ) enter the deviation dynamics, so they are the definition; the pose follows by integration and is
needed for pictures, for files and by a car that knows where it is. θ is the time of the reference, in seconds: it runs
at rate u0 along the clock.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from cfjax.coerce import Number, Numbers, instance, instances, keep, listed, number, numbers, real, refuse, text
from cfjax.errors import InputError
from cfjax.problem.deviation import ReferencePoint
from cfjax.problem.tube import FASTEST, Tube
from cfjax.problem.vehicle import Interval, interval


if TYPE_CHECKING:
    from scipy.interpolate import PPoly

SHORTEST, LONGEST = 1e-6, 1e8  # m: a path's lengths and radii lie between
SLOWEST = 1e-6  # m/s
MEETS = 1e-9  # rad, m and m/s: what is left of them in floating point where one stretch joins another


Edges = tuple[tuple[tuple[float, float], ...], ...]
"""Points (m) of a left and of a right edge."""


class Pose(NamedTuple):
    """Heading in rad (0 looks along +y), position in m, inertial frame."""

    alpha: float
    x: float
    y: float


@dataclass(frozen=True)
class Profile:
    """A scalar function of θ: piecewise polynomial.

    `breaks` has pieces + 1 entries (s), `coefficients[k]` belongs to piece k, ascending powers of θ − breaks[k].
    """

    breaks: tuple[float, ...]
    coefficients: tuple[tuple[float, ...], ...]

    def __init__(self, breaks: Numbers, coefficients: Sequence[Numbers] | np.ndarray) -> None:
        rows = listed(coefficients)
        if rows is None:
            refuse("profile", "a list of coefficients, one list for each piece", coefficients)
        keep(
            self,
            breaks=numbers("profile", breaks, "finite breaks and coefficients"),
            coefficients=tuple(numbers("profile", row, "finite breaks and coefficients") for row in rows),
        )
        if not all(self.coefficients) or not self.coefficients:
            raise InputError("profile: expected at least one piece, and a coefficient in each")
        if len(self.breaks) != len(self.coefficients) + 1 or not all(np.diff(self.breaks) > 0):
            raise InputError(
                f"profile: expected increasing breaks, one more than pieces; got {len(self.breaks)} breaks and "
                f"{len(self.coefficients)} pieces"
            )

    @classmethod
    def constant(cls, value: Number, duration: Number) -> "Profile":
        """One value all along, for a duration (s)."""
        return cls((0.0, number("duration of a profile", duration, "s", above=0)), ((number("profile", value),),))

    @property
    def is_constant(self) -> bool:
        first = self.coefficients[0][0]
        return all(c[0] == first and not any(c[1:]) for c in self.coefficients)

    def values(self, theta: Float[np.ndarray, "*batch"], order: int = 0) -> Float[np.ndarray, "*batch"]:
        """At θ (s), or those of the derivative of that order; at a break of the later piece."""
        table = self._table
        for _ in range(order):
            table = np.arange(1.0, len(table))[:, None] * table[1:] if len(table) > 1 else np.zeros_like(table)
        return self._at(table, theta)

    def integrals(self, theta: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """From 0 to θ (s)."""
        rising = self._table / np.arange(1.0, len(self._table) + 1)[:, None]
        lengths = np.diff(self.breaks)
        whole = np.sum(rising * lengths ** np.arange(1, len(rising) + 1)[:, None], axis=0)
        before = np.concatenate([[0.0], np.cumsum(whole)[:-1]])
        return self._at(np.vstack([before, rising]), theta)

    @cached_property
    def polynomial(self) -> "PPoly":
        """As SciPy has it, for what else one asks of polynomials."""
        from scipy.interpolate import PPoly  # takes longer to load than a steady path to be made

        return PPoly(self._table[::-1], np.array(self.breaks))

    @cached_property
    def _table(self) -> Float[np.ndarray, "powers pieces"]:
        """Coefficients by ascending powers."""
        table = np.zeros((max(map(len, self.coefficients)), len(self.coefficients)))
        for piece, ascending in enumerate(self.coefficients):
            table[: len(ascending), piece] = ascending
        return table

    def _at(self, table: Float[np.ndarray, "powers pieces"], theta: np.ndarray) -> np.ndarray:
        """By Horner's rule; beyond the ends the outer pieces go on."""
        piece = np.clip(np.searchsorted(self.breaks, theta, side="right") - 1, 0, len(self.coefficients) - 1)
        step = theta - np.array(self.breaks)[piece]
        result = np.zeros(np.shape(theta))
        for row in table[::-1]:
            result = result * step + row[piece]
        return result


@dataclass(frozen=True)
class Segment:
    """One stretch of reference, θ ∈ [0, duration].

    Raises:
        InputError: where turning rate and speed are no profiles of one duration, or the start is no pose.
    """

    turn_rate: Profile  # ω_r = dα_r/dθ, rad/s
    speed: Profile  # v_r, m/s
    start: Pose

    def __post_init__(self) -> None:
        instance("segment.turn_rate", self.turn_rate, Profile)
        instance("segment.speed", self.speed, Profile)
        keep(self, start=Pose(*numbers("segment.start", self.start, "a pose (heading in rad, x and y in m)", count=3)))
        omega, speed = self.turn_rate.breaks, self.speed.breaks
        if omega[-1] != speed[-1] or omega[0] != 0 or speed[0] != 0:
            raise InputError("segment: turn rate and speed need the same range of theta, from 0 to the duration")

    @property
    def duration(self) -> float:
        """T, in seconds of reference time."""
        return self.speed.breaks[-1]

    @property
    def is_steady(self) -> bool:
        """True when nothing depends on θ: the deviation dynamics are the same all along."""
        return self.turn_rate.is_constant and self.speed.is_constant

    @property
    def profiles(self) -> tuple[Profile, ...]:
        """What the dynamics see of it, wherever it lies."""
        return self.turn_rate, self.speed

    @property
    def last_theta(self) -> float:
        """Where a funnel along it ends, s."""
        return self.duration

    @property
    def has_mirror_images(self) -> bool:
        """Whether with each reference its mirror image is meant too."""
        return False

    @cached_property
    def top_speed(self) -> float:
        """m/s: at one of the profile's breaks, or where its slope vanishes; samples would miss it by a little."""
        if self.speed.is_constant:
            return self.speed.coefficients[0][0]
        profile = self.speed.polynomial
        still = profile.derivative().roots(discontinuity=False, extrapolate=False)  # NaN where it vanishes all along
        candidates = np.concatenate([profile.x, still[np.isfinite(still)]])
        # at a break profile(x) is of the later piece: both sides count
        right = [
            np.polynomial.Polynomial(c)(h) for c, h in zip(self.speed.coefficients, np.diff(profile.x), strict=True)
        ]
        return float(max(*right, *profile(candidates)))

    def references(self) -> list[list[ReferencePoint]]:
        """The extreme references (`cfjax.problem.tube`) of a steady segment: there is but one."""
        return [[self.point(0.0)]]

    def nominal(self) -> list[ReferencePoint]:
        """For each group of extreme references the one at which the signs of the inputs' authorities are read."""
        return [self.point(0.0)]

    def middle(self) -> ReferencePoint:
        """The reference that stands for all of them: of a steady segment the only one."""
        return self.point(0.0)

    def samples(self, count: int) -> list[ReferencePoint]:
        """References to look at: at `count` places, or at one where all are alike."""
        return self.points(self.places(count))

    def places(self, count: int) -> Float[np.ndarray, " n"]:
        """θ (s) of `samples`."""
        return np.zeros(1) if self.is_steady else np.linspace(0.0, self.duration, count)

    def point(self, theta: float) -> ReferencePoint:
        """Profile at θ (s): turn rate, speed and their slopes."""
        return self.points(np.array([number("theta", theta, "s")]))[0]

    def points(self, theta: Float[np.ndarray, " n"]) -> list[ReferencePoint]:
        """`point` at each θ (s)."""
        omega, v = self.turn_rate, self.speed
        columns = (omega.values(theta), v.values(theta), omega.values(theta, 1), v.values(theta, 1))
        return [ReferencePoint(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]

    def poses(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Reference poses (α_r in rad, x_r, y_r in m) at increasing θ (s), by Gauss–Legendre quadrature."""
        heading = self.turn_rate.integrals
        grid = np.unique(np.concatenate([[0.0], theta, self.turn_rate.breaks, self.speed.breaks]))
        nodes, weights = _quadrature()
        half = 0.5 * np.diff(grid)[:, None]
        at = grid[:-1, None] + half * (1 + nodes)
        alpha = self.start.alpha + heading(at)
        step = half * weights * self.speed.values(at)
        dx, dy = -(step * np.sin(alpha)).sum(1), (step * np.cos(alpha)).sum(1)
        x = self.start.x + np.concatenate([[0.0], np.cumsum(dx)])
        y = self.start.y + np.concatenate([[0.0], np.cumsum(dy)])
        index = np.searchsorted(grid, theta)
        return np.stack([self.start.alpha + heading(theta), x[index], y[index]], axis=-1)


@cache
def _quadrature() -> tuple[Float[np.ndarray, " 12"], Float[np.ndarray, " 12"]]:
    """Nodes in [−1, 1], and weights."""
    return np.polynomial.legendre.leggauss(12)


@dataclass(frozen=True)
class Path:
    """A named chain of segments, or a tube alone: every path within its bounds.

    Args:
        name: for messages and files.
        segments: in the order in which they are driven; each begins at the pose where the one before ends.
        source: how the points that it was made of were taken, in one line.
        doubt: why they may be in another unit, in one line; empty where nothing speaks for it.
        edges: points (m) of the left and of the right edge beside it, where its file has widths; None: it has none.

    Raises:
        InputError: for what are no segments, and for none.
    """

    name: str
    segments: tuple[Segment | Tube, ...]
    source: str = field(compare=False)
    doubt: str = field(compare=False)
    edges: Edges | None = field(compare=False)

    def __init__(
        self,
        name: str,
        segments: Sequence[Segment | Tube],
        source: str = "",
        doubt: str = "",
        edges: Edges | None = None,
    ) -> None:
        keep(
            self,
            name=text("name of a path", name),
            segments=instances("segments of a path", segments, Segment, Tube),
            source=text("source of a path", source),
            doubt=text("doubt about a path", doubt),
            edges=edges,
        )
        if not self.segments:
            raise InputError(f"path {self.name}: expected at least one segment, got none")
        if len(self.segments) > 1 and not math.isfinite(self.duration):
            raise InputError(f"path {self.name}: expected a tube alone, it has no end to which another could join")

    def __str__(self) -> str:
        """One line: what it is, how long, and how fast; as the command says it of a file of points."""
        if self.source:
            return self.source
        if (tube := self.tube) is not None:
            bounds = (
                ("curvature", tube.curvature, "1/m"),
                ("speed", tube.speed, "m/s"),
                ("dv/dt", tube.acceleration, "m/s²"),
            )
            within = ", ".join(f"{name} {own.lower:g} to {own.upper:g} {unit}" for name, own, unit in bounds)
            return f"{self.name}: every path within {within}"
        places = [np.linspace(0.0, segment.duration, 201) for segment in self.curve]
        speeds = [segment.speed.values(own) for segment, own in zip(self.curve, places, strict=True)]
        length = sum(float(np.trapezoid(own, at)) for own, at in zip(speeds, places, strict=True))
        least, most = (f"{end:.3g}" for end in (np.concatenate(speeds).min(), np.concatenate(speeds).max()))
        count = f"{len(self.curve)} segment{'s' if len(self.curve) > 1 else ''}"
        fast = f"{least} to {most}" if least != most else least
        return f"{self.name}: {count}, {length:.3g} m, {'closed' if self.closed else 'open'}, {fast} m/s"

    @property
    def curve(self) -> tuple[Segment, ...]:
        """The segments of a path that has a course; none for a tube."""
        return tuple(segment for segment in self.segments if isinstance(segment, Segment))

    def require_course(self) -> tuple[Segment, ...]:
        """The same, for whoever cannot do without.

        Raises:
            InputError: for a tube.
        """
        if not self.curve:
            raise InputError(f"path {self.name}: expected segments, got a tube, which has no course to follow")
        return self.curve

    def require_tube(self) -> Tube:
        """The tube, for whoever cannot do without.

        Raises:
            InputError: for a path that has a course.
        """
        if self.tube is None:
            raise InputError(f"path: expected a tube, got {self.name}")
        return self.tube

    @property
    def duration(self) -> float:
        """T of all segments together, s; infinite for a tube."""
        return float(sum(segment.duration for segment in self.segments))

    @cached_property
    def kinds(self) -> tuple[int, ...]:
        """For each segment, which of the `distinct` ones it repeats: in the body frame that is the same problem."""
        found: dict[object, int] = {}
        return tuple(found.setdefault(segment.profiles, len(found)) for segment in self.segments)

    @cached_property
    def distinct(self) -> tuple[Segment | Tube, ...]:
        """The segments that no earlier one equals in turning rate and speed."""
        first = dict(zip(reversed(self.kinds), reversed(self.segments), strict=True))
        return tuple(first[kind] for kind in sorted(first))

    @property
    def steady_reference(self) -> ReferencePoint | None:
        """The one reference of a straight line or a circle at constant speed, or the middle of a tube's bounds; None of
        another path.
        """
        if self.tube:
            return self.tube.middle()
        steady = [segment for segment in self.curve if segment.is_steady and len(self.distinct) == 1]
        return steady[0].point(0.0) if steady else None

    @cached_property
    def closed(self) -> bool:
        """Whether its end meets its start, in pose and speed: the same lap can be driven again."""
        curve = self.curve
        if not curve:
            return False
        first, last = curve[0], curve[-1]
        alpha, x, y = last.poses(np.array([last.duration]))[0]
        turn = alpha - first.start.alpha
        apart = (turn - 2 * np.pi * round(turn / (2 * np.pi)), x - first.start.x, y - first.start.y)
        speed = last.point(last.duration).speed - first.point(0.0).speed
        return bool(max(map(abs, apart)) <= MEETS and abs(speed) <= MEETS)

    @property
    def tube(self) -> Tube | None:
        """The tube, where the path is one: every path within its bounds."""
        first = self.segments[0]
        return first if isinstance(first, Tube) else None


def length_of(label: str, value: object) -> float:
    """A length of a path's, m; raises InputError unless it is one on Earth."""
    return _within(f"path.{label}", number(f"path.{label}", value, "m", above=0), "m", SHORTEST, LONGEST)


def speed_of(value: object) -> float:
    """A path's constant speed, m/s; raises InputError unless it is one of a vehicle."""
    return _within("path.speed", number("path.speed", value, "m/s", above=0), "m/s", SLOWEST, FASTEST)


def _within(name: str, value: float, unit: str, least: float, most: float) -> float:
    if not least <= value <= most:
        end = f"at least {least:g}" if value < least else f"at most {most:g}"
        raise InputError(f"{name}: expected {unit}, {end}, got {value:g}")
    return value


def straight(length: Number = 4.0, speed: Number = 2.0) -> Path:
    """Straight line along +x through the origin, from −length/2 to length/2 (m), at constant speed (m/s).

    >>> straight(length=4.0, speed=2.0).duration
    2.0

    Raises:
        InputError: for numbers that are not positive.
    """
    length, speed = length_of("length", length), speed_of(speed)
    duration = length / speed
    start = Pose(-np.pi / 2, -length / 2, 0.0)
    return Path("straight", (Segment(Profile.constant(0.0, duration), Profile.constant(speed, duration), start),))


def circle(radius: Number = 1.5, speed: Number = np.pi / 2, laps: Number = 1.0) -> Path:
    """Circle about the origin, counter-clockwise from (radius, 0), at constant speed (m/s); radius in m.

    The paper prints the heading as π t/3 beside a position that turns at 1 rad/s; both turn at speed/radius here.

    >>> path = circle(radius=1.5, speed=1.0)
    >>> round(path.duration, 3), path.closed
    (9.425, True)

    Raises:
        InputError: for numbers that are not positive.
    """
    radius, speed, laps = length_of("radius", radius), speed_of(speed), number("path.laps", laps, above=0)
    omega = speed / radius
    if not omega:
        raise InputError(
            f"path: expected a speed and a radius by which a circle turns, got {speed:g} m/s and {radius:g} m"
        )
    duration = laps * 2 * np.pi / omega
    start = Pose(0.0, radius, 0.0)
    return Path("circle", (Segment(Profile.constant(omega, duration), Profile.constant(speed, duration), start),))


def tube(
    curvature: Number | Interval | Numbers = 1.0,
    speed: Number | Interval | Numbers = 1.0,
    acceleration: Number | Interval | Numbers = 0.0,
) -> Path:
    """Every path within bounds: curvature (1/m), speed (m/s) and acceleration dv_r/dθ (m/s²) in intervals.

    An interval is an `Interval` or its two ends. A number stands for ± itself in curvature and acceleration, and for
    one constant speed.

    >>> tube(curvature=1.8, speed=(1.0, 5.0), acceleration=1.0).require_tube().curvature
    Interval(lower=-1.8, upper=1.8)

    Raises:
        InputError: for other values, and where a path could stand still or run backwards.
    """

    def bounds(label: str, value: object, lower: float, unit: str) -> Interval:
        name = f"path.{label}"
        given = listed(value)
        if given is not None and len(given) == 1:
            (value,), given = given, None
        if real(value) is not None:
            size = number(name, value, unit, least=0)
            return Interval(lower * size + 0.0, size)  # no minus zero in files
        if isinstance(value, Interval) or (given is not None and len(given) == 2):
            return interval(name, value, unit)
        return refuse(name, f"a number or an interval [lower, upper] ({unit})", value)

    within = Tube(
        bounds("curvature", curvature, -1.0, "1/m"),
        bounds("speed", speed, 1.0, "m/s"),
        bounds("acceleration", acceleration, -1.0, "m/s²"),
    )
    return Path("tube", (within,))
