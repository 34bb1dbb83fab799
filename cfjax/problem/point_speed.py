"""How fast a car drives along a curve: what is asked for, and what its grip and its thrust allow.

The energy E = v²/2 per kg along arc length s makes the limits on speed plain, for dv/dt = dE/ds:

* v is at most the speed asked for, and √(a_lat/|κ|): nothing in a kinematic model bounds speed in bends;
* |dE/ds| is at most the thrust that the car may use. The largest such E comes from one pass forwards and one backwards.

A mean over a window makes dE/ds continuous and keeps |dE/ds|; it keeps the limits on speed because these were replaced
by their minima over the same window before. What polynomials (`cfjax.problem.curves`) miss of that is paid for by
driving the whole profile a little slower: time stretched by c divides speed by c and acceleration by c².
"""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline, PPoly
from scipy.ndimage import minimum_filter1d

from cfjax.errors import InputError
from cfjax.problem.curves import Curve
from cfjax.problem.path import Path, Profile, Segment
from cfjax.problem.point_curve import PathLimits
from cfjax.problem.points import Points


SPEED = 2.0  # m/s, where neither the file nor the caller says
GRID = 4096  # cells of the speed profile, at least
CELL = 0.05  # m, at most, for that car
SMOOTHING_TIME = 0.25  # s: over so much at top speed, either way, acceleration is smoothed
THRUST_HEADROOM = 0.02  # relative: for what the polynomials miss, so that the whole need not be slower
BEND_HEADROOM = 5e-3
ROUNDING = 1e-12
LEAST_CHANGE = 1e-6  # relative: a speed that varies by less is constant


def speed_cap(rows: Points, curve: Curve, knots: np.ndarray, closed: bool, speed: float | None) -> PPoly:
    """The speed asked for (m/s), by arc length (m): linear between points."""
    if rows.speed is None:
        level = SPEED if speed is None else speed
        return PPoly(np.array([[0.0], [level]]), np.array([0.0, curve.length]))
    wanted = np.minimum(np.append(rows.speed, rows.speed[0]) if closed else rows.speed, speed or math.inf)
    at = curve.arc_length(knots)
    return PPoly(np.stack([np.diff(wanted) / np.diff(at), wanted[:-1]]), at)


def speed_along(curve: Curve, cap: PPoly, limits: PathLimits, closed: bool) -> float | PPoly:
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


def slowed(path: Path, cap: PPoly, lateral: float, thrust: float) -> Path:
    """The path at the largest part of its speed, at most 1, with which every limit is kept."""
    excess, passed = 1.0, 0.0
    for segment in path.curve:
        speed, turn_rate = segment.speed.polynomial, segment.turn_rate.polynomial
        theta = looked_at(speed, speed.derivative(), _product(speed, turn_rate))
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


def looked_at(*polynomials: PPoly) -> np.ndarray:
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
