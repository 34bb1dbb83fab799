"""Curves as references: polynomial profiles whose integrated poses stay close to a parametrised curve.

A reference is its profile (`cfjax.problem.path`), so what is made here is a curve of its own, near the one asked for:
on pieces of arc length, halved where needed, v_r(θ) is a cubic (or constant) and ω_r(θ) a cubic that

* takes the curve's own turning rate κ v_r at both ends of the piece: ω_r is continuous;
* turns by the curve's own angle over the piece, and has its mean heading too, so that neither heading nor lateral
  position drift from piece to piece.

What is left at the end of a segment (the shortening of a chord, of second order) is taken out by the least change of
the cubics that moves the end to its place: segments join, and laps close, to rounding.

Points of the plane are complex numbers x + iy in m; at heading α the forward axis is i e^{iα}.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PPoly

from cfjax.errors import InputError
from cfjax.problem.path import Path, Pose, Profile, Segment, speed_of


TOLERANCE = 1e-4  # m between reference and curve at the same arc length: far below any car's precision
CURVATURE_TOLERANCE = 5e-3  # 1/m: a curve can be close and yet wind
SPEED_TOLERANCE = 2e-3  # relative
ACCELERATION_TOLERANCE = 0.02  # of the largest along the path
JOIN = 1e-11  # m and rad: where a segment has to end; a lap of hundreds of them still closes to 1e-9
DIGITS = 1e-14  # relative: what is left of that far from the origin
LEAST_TURN = 1e-11  # rad: a curve whose turning differs by less from a straight line or an arc is one
MOST_HALVINGS = 24
MOST_PIECES = 2**14  # per segment: a curve whose numbers overflow is bad everywhere
MOST_CELLS = 2**10  # per smooth stretch, of the quadrature of arc length

_nodes, _weights = np.polynomial.legendre.leggauss(12)
NODES, WEIGHTS = 0.5 * (1 + _nodes), 0.5 * _weights  # on [0, 1]

Points = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Curve:
    """A plane curve u ↦ x + iy (m), and its first and second derivative by u: each maps (n,) to complex (n,).

    `knots` run from the curve's beginning to its end; between two of them it is smooth, across them curvature is
    continuous. The first derivative vanishes nowhere.
    """

    position: Points
    first: Points
    second: Points
    knots: tuple[float, ...]

    def curvature(self, u: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """1/m, positive to the left."""
        first = self.first(u)
        return np.imag(np.conj(first) * self.second(u)) / np.abs(first) ** 3

    def heading(self, u: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """α in (−π, π], rad: forward is (−sin α, cos α)."""
        return np.angle(-1j * self.first(u))

    @property
    def length(self) -> float:
        """m."""
        return float(self._cells[1][-1])

    @cached_property
    def _cells(self) -> tuple[np.ndarray, np.ndarray]:
        """u and arc length at the ends of cells in which Gauss–Legendre quadrature is as good as exact."""
        count, before = 8, math.inf
        while True:
            ends = [np.linspace(a, b, count, endpoint=False) for a, b in itertools.pairwise(self.knots)]
            u = np.concatenate([*ends, self.knots[-1:]])
            arc = np.concatenate([[0.0], np.cumsum(self._between(u[:-1], u[1:]))])
            if abs(arc[-1] - before) <= 1e-14 * arc[-1] or count >= MOST_CELLS:
                return u, arc
            count, before = 2 * count, float(arc[-1])

    def _between(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        at = begin[..., None] + (end - begin)[..., None] * NODES
        return (end - begin) * (np.abs(self.first(at)) @ WEIGHTS)

    def arc_length(self, u: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """m from the curve's beginning to u."""
        begin, length = self._cells
        cell = np.clip(np.searchsorted(begin, u, side="right") - 1, 0, len(begin) - 2)
        return length[cell] + self._between(begin[cell], u)

    def at(self, arc: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """The parameter u after so many metres: Newton's method."""
        u, length = self._cells
        cell = np.clip(np.searchsorted(length, arc, side="right") - 1, 0, len(u) - 2)
        found = np.interp(arc, length, u)
        for _ in range(6):
            excess = length[cell] + self._between(u[cell], found) - arc
            found = np.clip(found - excess / np.abs(self.first(found)), u[0], u[-1])
            if np.abs(excess).max(initial=0.0) <= 1e-14 * length[-1]:
                break
        return found


class _Pieces(NamedTuple):
    """Cubics on m pieces: coefficients ascending, of t in [0, duration]; what they miss of the curve."""

    duration: np.ndarray  # (m,) s
    speed: np.ndarray  # (m, 4)
    turn_rate: np.ndarray  # (m, 4)
    turn: np.ndarray  # (m,) rad, of the curve
    apart: np.ndarray  # (m,) m
    misses: np.ndarray  # (m,) largest error in curvature, speed or acceleration, each by its tolerance


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # what is not finite keeps no tolerance
def path_along(name: str, curve: Curve, speed: float | PPoly, *, segments: int = 1, scale: float = 1.0) -> Path:
    """The path along a curve, in segments of equal arc length.

    `speed` in m/s is a number, or piecewise polynomial in arc length (m), continuously differentiable and positive.
    Each segment ends on the curve to 1e-11 m and rad; in between the integrated position is within 1e-4 m of the
    curve's at the same arc length, for a car of a model's size: `scale` is by how much what drives is larger. ω_r is
    continuous, v_r continuously differentiable, both at most cubic.

    Raises:
        InputError: for a speed that is not positive, or a curve that cannot be followed so closely.
    """
    if not isinstance(speed, PPoly):
        speed = speed_of(speed)
    cuts = np.linspace(0.0, curve.length, segments + 1)
    heading = float(curve.heading(np.array(curve.knots[:1]))[0])
    built = []
    for begin, end in itertools.pairwise(cuts):
        place = curve.position(curve.at(np.array([begin])))[0]
        segment, turn = _segment(name, curve, speed, (float(begin), float(end)), scale, heading, place)
        built.append(segment)
        heading += turn
    return Path(name, tuple(built))


def _segment(
    name: str,
    curve: Curve,
    speed: float | PPoly,
    span: tuple[float, float],
    scale: float,
    heading: float,
    place: complex,
) -> tuple[Segment, float]:
    """A segment over a span of arc length, and by how much the curve turns there."""
    start = Pose(heading, float(place.real), float(place.imag))
    tolerance = scale * TOLERANCE
    target, apart, missed = tolerance / 4, math.inf, math.inf
    for _ in range(6):
        ends, pieces = _halved(name, curve, speed, span, target, CURVATURE_TOLERANCE / scale)
        segment, missed = _aimed(curve, speed, ends, pieces, start)
        apart = _apart(curve, segment, span[0])
        if apart <= tolerance and missed <= max(JOIN, DIGITS * abs(place)):
            return segment, float(pieces.turn.sum())
        target /= 8
    raise InputError(
        f"path {name}: no polynomial reference within {tolerance:g} m of the curve between {span[0]:.6g} and "
        f"{span[1]:.6g} m; it is {apart:.3g} m away and misses its end by {missed:.3g}"
    )


def _halved(
    name: str, curve: Curve, speed: float | PPoly, span: tuple[float, float], target: float, bend: float
) -> tuple[np.ndarray, _Pieces]:
    """Pieces of arc length, halved until each keeps the tolerances: their ends (m), and the cubics."""
    ends = np.linspace(*span, 3)  # two at least, to have the freedom to end where the curve ends
    bad = np.zeros(2, bool)
    for _ in range(MOST_HALVINGS):
        pieces = _fitted(curve, speed, ends, bend)
        bad = ~((pieces.apart <= target) & (pieces.misses <= 1))
        if not bad.any():
            return ends, pieces
        if len(ends) > MOST_PIECES:
            break
        middle = 0.5 * (ends[:-1] + ends[1:])
        ends = np.sort(np.concatenate([ends, middle[bad]]))
    where = float(ends[np.flatnonzero(bad)[0]])
    raise InputError(f"path {name}: the curve or its speed is not smooth enough at {where:.6g} m")


def _fitted(curve: Curve, speed: float | PPoly, ends: np.ndarray, bend: float) -> _Pieces:
    """The cubics between given arc lengths (m)."""
    first, last = ends[:-1], ends[1:]
    duration, moving = _speeds(speed, first, last)
    h = duration[:, None]
    t = h * NODES
    v = _value(moving, t)
    arc = first[:, None] + _value(_integrals(moving), t)
    u = curve.at(np.concatenate([first[:, None], arc, last[:, None]], axis=1))
    angle = np.unwrap(curve.heading(u), axis=1)
    angle = angle - angle[:, :1]
    turn, angle = angle[:, -1], angle[:, 1:-1]
    kappa = curve.curvature(u)
    omega = kappa[:, 1:-1] * v
    begin, end = kappa[:, 0] * moving[:, 0], kappa[:, -1] * _value(moving, h)[:, 0]

    # ω_r is the chord between its ends, plus an even bubble t(h − t) for the turn, plus an odd one for the mean heading
    even = (turn - duration * (begin + end) / 2) * 6 / duration**3
    turned = begin[:, None] * t + (end - begin)[:, None] * t**2 / (2 * h) + even[:, None] * (h * t**2 / 2 - t**3 / 3)
    bubble = -(t**2) * (h - t) ** 2 / (2 * h)
    odd = ((angle - turned) * v) @ WEIGHTS / ((bubble * v) @ WEIGHTS)
    turning = np.stack(
        [begin, (end - begin) / duration + (even - odd) * duration, 3 * odd - even, -2 * odd / duration], axis=1
    )
    angle_error = _value(_integrals(turning), t) - angle
    misses = np.abs(_value(turning, t) - omega) / v / bend
    if isinstance(speed, PPoly):
        wanted = speed(arc)
        largest = np.abs(speed(speed.x, 1) * speed(speed.x)).max()
        misses = np.maximum(misses, np.abs(v / wanted - 1) / SPEED_TOLERANCE)
        slope_error = np.abs(_value(_derivatives(moving), t) - wanted * speed(arc, 1))
        misses = np.maximum(misses, slope_error / (ACCELERATION_TOLERANCE * largest + 1e-9))
    misses[np.abs(turn) > 1] = math.inf  # few nodes say nothing of a piece that winds
    apart = duration * ((np.abs(angle_error) * v) @ WEIGHTS)
    return _Pieces(duration, moving, turning, turn, apart, misses.max(axis=1))


def _speeds(speed: float | PPoly, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Durations (s) and cubics of v_r over stretches of arc length: values and slopes of both ends, and the length."""
    if not isinstance(speed, PPoly):
        return (last - first) / speed, np.tile([speed, 0.0, 0.0, 0.0], (len(first), 1))
    v0, v1 = speed(first), speed(last)
    a0, a1 = v0 * speed(first, 1), v1 * speed(last, 1)
    mean, bend = (v0 + v1) / 2, (a0 - a1) / 12  # the length of Hermite's cubic is h mean + h² bend
    root = np.sqrt(np.maximum(mean**2 + 4 * bend * (last - first), 0.0))
    h = 2 * (last - first) / (mean + root)
    slope = (v1 - v0) / h
    return h, np.stack([v0, a0, (3 * slope - 2 * a0 - a1) / h, (a0 + a1 - 2 * slope) / h**2], axis=1)


def _aimed(curve: Curve, speed: float | PPoly, ends: np.ndarray, pieces: _Pieces, start: Pose) -> tuple[Segment, float]:
    """The segment whose end is where the curve's is, and by how much it is not (rad or m): a quasi-Newton method.

    The freedom are both bubbles of every piece. A change δω(τ) moves the end by ∫ i (p(T) − p(τ)) δω(τ) dτ.
    """
    h = pieces.duration[:, None]
    breaks = tuple(float(b) for b in np.concatenate([[0.0], np.cumsum(pieces.duration)]))
    if isinstance(speed, PPoly):
        moving = Profile(breaks, _table(pieces.speed))
    else:
        moving = Profile.constant(speed, breaks[-1])
    if np.abs(pieces.turn).sum() < LEAST_TURN:
        return Segment(Profile.constant(0.0, breaks[-1]), moving, start), 0.0
    bends = np.ptp(pieces.turn_rate[:, 0]) + np.abs(pieces.turn_rate[:, 1:] * h ** np.arange(1, 4)).max()
    if not isinstance(speed, PPoly) and bends * breaks[-1] < LEAST_TURN:
        return Segment(Profile.constant(float(pieces.turn.sum()) / breaks[-1], breaks[-1]), moving, start), 0.0

    t = h * NODES
    places = curve.position(curve.at(ends[:-1, None] + _value(_integrals(pieces.speed), t)))
    goal = curve.position(curve.at(ends[-1:]))[0]
    bubbles = np.stack([NODES * (1 - NODES), NODES * (1 - NODES) * (2 * NODES - 1)])  # (2, nodes)
    weights = (h * WEIGHTS)[:, None, :] * bubbles
    moved = (1j * (goal - places))[:, None, :] * weights
    jacobian = np.stack([weights.sum(2).ravel(), moved.real.sum(2).ravel(), moved.imag.sum(2).ravel()])
    heading = start.alpha + float(pieces.turn.sum())
    turning = pieces.turn_rate
    best: tuple[Segment, float] | None = None
    for _ in range(6):
        segment = Segment(Profile(breaks, _table(turning)), moving, start)
        alpha, x, y = segment.poses(np.array(breaks[-1:]))[0]
        error = np.array([heading - alpha, goal.real - x, goal.imag - y])
        missed = float(np.abs(error).max())
        if best is not None and missed >= best[1]:
            break
        best = (segment, missed)
        # where the curve is nearly straight no small change moves its end forwards: that direction is left alone
        even, odd = np.linalg.lstsq(jacobian, error, rcond=1e-4)[0].reshape(-1, 2).T
        x1 = h[:, 0]
        change = [np.zeros_like(even), (even - odd) / x1, (3 * odd - even) / x1**2, -2 * odd / x1**3]
        turning = turning + np.stack(change, axis=1)
    assert best is not None
    return best


def _apart(curve: Curve, segment: Segment, begin: float) -> float:
    """The largest distance (m) between the integrated reference and the curve at the same arc length."""
    breaks = np.array(segment.turn_rate.breaks)
    theta = np.unique(np.concatenate([breaks[:-1, None] + np.diff(breaks)[:, None] * NODES, breaks[1:, None]], axis=1))
    _, x, y = segment.poses(theta).T
    arc = begin + segment.speed.polynomial.antiderivative()(theta)
    return float(np.abs(x + 1j * y - curve.position(curve.at(np.minimum(arc, curve.length)))).max())


def _value(coefficients: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Polynomials (m, degree + 1) at times (m, n)."""
    result = np.zeros_like(t)
    for c in coefficients.T[::-1]:
        result = result * t + c[:, None]
    return result


def _integrals(coefficients: np.ndarray) -> np.ndarray:
    return np.pad(coefficients / np.arange(1, coefficients.shape[1] + 1), ((0, 0), (1, 0)))


def _derivatives(coefficients: np.ndarray) -> np.ndarray:
    return (coefficients * np.arange(coefficients.shape[1]))[:, 1:]


def _table(coefficients: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(c) for c in row) for row in coefficients)
