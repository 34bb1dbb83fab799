"""What is proven about a reference: that it is a path, that a tube holds it, and that one tube hands over to the next.

A tube is an ellipsoid {V(x) = xᵀ C x ≤ 1} of deviations that holds along every path whose curvature κ = ω_r/v_r, speed
v_r and acceleration dv_r/dθ stay inside its intervals: V̇ ≤ −μ v_r min(1, V/β̲) for V in [β_in, 1], so that {V ≤ β_in}
holds too. A reference is piecewise polynomial in ω_r(θ) and v_r(θ), and over the rationals:

* speed is continuous because constant terms are set so, pose and heading because they are the integrals;
* a bound such as κ ≤ κ_hi is the polynomial inequality κ_hi v_r − ω_r ≥ 0 on the piece: by Bernstein coefficients,
  which enclose the polynomial, and where they leave it open by the roots of its part without squares;
* the reference moves by ds = u0 v_r dt with u0 ≤ u0_hi, and the run-time law asks for 0.95 of the certified decrease:
  dV/ds ≤ −(0.95 μ/u0_hi) min(1, V/β̲), which is integrated;
* {V₁ ≤ level} ⊂ {V₂ < 1} is the matrix inequality level C₂ ≺ C₁.

Frames and units: θ in s, lengths in m, headings in rad; the body frame has x lateral and y forward, and at heading α
its axes are (cos α, sin α) and (−sin α, cos α).
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import comb
from types import MappingProxyType
from typing import NamedTuple

from flint import acb, acb_series, arb, arb_poly, fmpq, fmpq_mat, fmpq_poly

from cfjax.check.decrease import Matrix
from cfjax.check.rational import about, decimal_text, exp_bounds, is_positive_definite, sqrt_upper, upper_bound
from cfjax.check.tube import TubeClaim


Coefficients = tuple[fmpq, ...]  # ascending powers
Range = tuple[fmpq, fmpq]

STATES = ("alpha", "x", "y", "v")
LARGEST_POSE_GAP = fmpq(1, 10**6)  # rad and m: what rounding a pose to a file may cost, far below any car's precision
LARGEST_SPEED_GAP = fmpq(1, 10**9)  # m/s: rounding of a spline's coefficients
SERIES_ORDER = 9  # of Taylor's remainder; python-flint's series have ten terms unless its global cap is raised
REMAINDER = fmpq(1, 10**10)  # m: a stretch is halved until its Taylor remainder is below; gaps are told to 1e-6 m
MOST_STRETCHES = 2**12  # of one piece: some hundred laps of a spiral take them
MOST_OF_PATH = 2**16  # stretches of all pieces together: some seconds; a thousand pieces of a fit take as many
LAW_SHARE = fmpq(19, 20)  # of the certified decrease: what the run-time law (`cfjax.control`) asks for
TOO_WILD = "the path turns too fast, or is too long, for its pose to be enclosed"
STEEPEST_EXPONENT = fmpq(64)  # levels below e^−64 are not told apart
UNITS = {"curvature": "1/m", "speed": "m/s", "acceleration": "m/s²"}


class Origin(NamedTuple):
    """A tube's certificate, or the file where it lies, and by what its lengths and speeds are multiplied since."""

    source: str | dict
    length: fmpq = fmpq(1)
    speed: fmpq = fmpq(1)


@dataclass(frozen=True, eq=False)  # one object is one certificate: compared by identity, so that proofs can be cached
class CertifiedTube:
    """A tube with a checked certificate: the numbers that chains are proven from.

    `parameters` are the vehicle's; `curvature` in 1/m, `speed` in m/s, `acceleration` dv_r/dθ in m/s² are closed
    intervals. `shape` is C in the coordinates (α, x, y, v). `margin` (1/s) and `margin_per_metre` are λ and μ of
    V̇ ≤ −λ min(1, V/beta_lower) and V̇ ≤ −μ v_r min(1, V/beta_lower) for V in [beta_inner, 1]. `inputs` are intervals by
    name, "u0", the rate of θ, first.

    Raises:
        ValueError: for numbers that are none of a tube. That the certificate is true is not asked here.
    """

    name: str
    vehicle: str
    parameters: Mapping[str, fmpq]
    method: str
    curvature: Range
    speed: Range
    acceleration: Range
    shape: Matrix
    beta_lower: fmpq
    beta_inner: fmpq
    margin: fmpq
    margin_per_metre: fmpq
    inputs: Mapping[str, Range]
    origin: Origin | None = None

    def __post_init__(self) -> None:
        for label in ("curvature", "speed", "acceleration"):
            lower, upper = getattr(self, label)
            if not lower <= upper:
                raise ValueError(f"tube {self.name}: expected an interval of {label}, lower end first")
        if not self.speed[0] > 0:
            raise ValueError(f"tube {self.name}: expected speeds above zero, got {about(self.speed[0])}")
        if len(self.shape) != len(STATES) or not is_positive_definite(self.shape):
            raise ValueError(f"tube {self.name}: expected a positive definite C in {', '.join(STATES)}")
        if not 0 < self.beta_inner <= self.beta_lower <= 1 or not self.margin_per_metre > 0:
            raise ValueError(f"tube {self.name}: expected 0 < beta_inner <= beta_lower <= 1 and a positive margin")
        if next(iter(self.inputs), None) != "u0" or not 0 < self.inputs["u0"][0] <= self.inputs["u0"][1]:
            raise ValueError(f"tube {self.name}: expected u0 as first input, in an interval above zero")
        # proofs are cached by the object: nobody may change its numbers afterwards
        object.__setattr__(self, "shape", tuple(tuple(row) for row in self.shape))
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))
        object.__setattr__(self, "inputs", MappingProxyType(dict(self.inputs)))

    @property
    def timing(self) -> Range:
        """The interval of u0, the rate of θ along the clock."""
        return self.inputs["u0"]

    @cached_property
    def inverse(self) -> fmpq_mat:
        """C⁻¹: its diagonal holds the squares of the half-widths."""
        return fmpq_mat([list(row) for row in self.shape]).inv()

    @cached_property
    def metres(self) -> fmpq:
        """u0_hi/(0.95 μ): metres of reference in which the law lowers V by one, as long as it is above beta_lower."""
        return self.timing[1] / (LAW_SHARE * self.margin_per_metre)

    def level_after(self, distance: fmpq) -> fmpq:
        """A rational that V is at most after so many metres of reference, from anywhere in the tube."""
        fallen = distance / self.metres
        if 1 - fallen >= self.beta_lower:
            return max(1 - fallen, self.beta_inner)
        exponent = min((fallen - (1 - self.beta_lower)) / self.beta_lower, STEEPEST_EXPONENT)
        return max(self.beta_lower * exp_bounds(-exponent)[1], self.beta_inner)

    def distance_to(self, level: fmpq) -> fmpq | None:
        """Metres of reference after which V ≤ level is proven, from anywhere in the tube; None where it never is."""
        if level < self.beta_inner:
            return None
        if level >= self.beta_lower:
            return self.metres * max(1 - level, fmpq(0))
        logarithm = upper_bound(arb(self.beta_lower / level).log())
        return self.metres * (1 - self.beta_lower + self.beta_lower * logarithm)


# --- polynomials on an interval


def bernstein(coefficients: Sequence[fmpq], length: fmpq, degree: int = 0) -> list[fmpq]:
    """Bernstein coefficients on [0, length], of at least the degree given: least and largest enclose the polynomial."""
    size = max(len(coefficients), degree + 1)
    result, power = [], fmpq(1)
    for k, coefficient in enumerate(coefficients):
        result.append(coefficient * power / comb(size - 1, k))
        power *= length
    result += [fmpq(0)] * (size - len(coefficients))
    for k in range(1, size):
        for i in range(size - 1, k - 1, -1):
            result[i] += result[i - 1]
    return result


def is_nonnegative(coefficients: Sequence[fmpq], length: fmpq) -> bool:
    """Whether the polynomial is nowhere below zero on [0, length], ends included: decided exactly."""
    control = bernstein(coefficients, length)
    if min(control) >= 0:
        return True
    if control[0] < 0 or control[-1] < 0:
        return False
    unit = fmpq_poly([c * length**k for k, c in enumerate(coefficients)])  # on [0, 1]
    _, factors = unit.factor_squarefree()
    changing = fmpq_poly([1])  # it changes its sign at the roots of odd multiplicity, and nowhere else
    for factor, multiplicity in factors:
        if multiplicity % 2:
            changing *= factor
    if _has_simple_root(bernstein(changing.coeffs(), fmpq(1))):
        return False
    size = unit.degree() + 2  # so many points are not all roots
    return next(value for k in range(1, size + 1) if (value := unit(fmpq(k, size + 1))) != 0) > 0


def _has_simple_root(control: list[fmpq]) -> bool:
    """Whether a polynomial without double roots has a root in the open interval (0, 1).

    Descartes: the changes of sign among Bernstein coefficients are as many as the roots, or more by an even number;
    halving ends because without double roots they come to none or one.
    """
    open_ = [control]
    while open_:
        control = open_.pop()
        signs = [c > 0 for c in control if c != 0]
        changes = sum(a != b for a, b in itertools.pairwise(signs))
        if changes % 2:
            return True
        if changes:
            left, right = [control[0]], [control[-1]]
            while len(control) > 1:
                control = [(a + b) / 2 for a, b in itertools.pairwise(control)]
                left.append(control[0])
                right.append(control[-1])
            if control[0] == 0:
                return True
            open_ += [left, right[::-1]]
    return False


def _evaluate(coefficients: Sequence[fmpq], at: fmpq) -> fmpq:
    result = fmpq(0)
    for coefficient in reversed(coefficients):
        result = result * at + coefficient
    return result


def _integral(coefficients: Sequence[fmpq]) -> Coefficients:
    return (fmpq(0), *(c / (k + 1) for k, c in enumerate(coefficients)))


def _derivative(coefficients: Sequence[fmpq]) -> Coefficients:
    return tuple(k * c for k, c in enumerate(coefficients))[1:] or (fmpq(0),)


def _shifted(coefficients: Sequence[fmpq], by: fmpq) -> Coefficients:
    """In powers of t − by, without leading zeros."""
    result = fmpq_poly(list(coefficients))
    if by != 0:
        result = result(fmpq_poly([by, 1]))
    return tuple(result.coeffs()) or (fmpq(0),)


# --- the reference


@dataclass(frozen=True)
class StatedProfile:
    """A piecewise polynomial: `coefficients[k]` in ascending powers of θ − breaks[k] (s)."""

    breaks: tuple[fmpq, ...]
    coefficients: tuple[Coefficients, ...]

    def __post_init__(self) -> None:
        ascending = all(a < b for a, b in zip(self.breaks, self.breaks[1:], strict=False))
        if len(self.breaks) != len(self.coefficients) + 1 or not ascending or not all(self.coefficients):
            raise ValueError("a profile needs increasing breaks, one more than pieces, and coefficients in each")


class StatedSegment(NamedTuple):
    """A stretch of path as it is written down: ω_r in rad/s, v_r in m/s, start pose (α in rad, x and y in m)."""

    turn_rate: StatedProfile
    speed: StatedProfile
    start: tuple[fmpq, fmpq, fmpq]


class ExactPose(NamedTuple):
    """A pose in the inertial frame: the heading (rad) exactly, the position x + iy (m) enclosed."""

    heading: fmpq
    position: acb

    def after(self, piece: "Piece") -> "ExactPose":
        """The pose where a piece ends that starts here."""
        forward = acb(0, 1) * acb(0, arb(self.heading)).exp()
        return ExactPose(self.heading + piece.turn, self.position + forward * piece.displacement)


class Violation(NamedTuple):
    """Where a piece leaves a tube by most: value and bound in the quantity's unit.

    θ in s from the segment's start, arc in m from the path's start.
    """

    quantity: str
    value: fmpq
    bound: fmpq
    segment: int
    theta: fmpq
    arc: fmpq

    @property
    def excess(self) -> fmpq:
        return abs(self.value - self.bound)

    def __str__(self) -> str:
        # a value beyond its bound by less than it shows is printed with what it is beyond
        beyond = "above" if self.value > self.bound else "below"
        unit = UNITS[self.quantity]
        return (
            f"{self.quantity} reaches {float(self.value):.6g} {unit} at theta = {float(self.theta):.6g} s of segment "
            f"{self.segment} (after {float(self.arc):.6g} m): {float(self.excess):.3g} {beyond} {float(self.bound):.6g}"
        )


class Spread(NamedTuple):
    """What a quantity's control values tell of it: it lies in [lower, upper], and both `ends` are among its values."""

    lower: fmpq
    upper: fmpq
    ends_lower: fmpq
    ends_upper: fmpq

    @classmethod
    def of(cls, control: Sequence[fmpq]) -> "Spread":
        first, last = control[0], control[-1]
        return cls(min(control), max(control), min(first, last), max(first, last))


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch on which ω_r and v_r are polynomials of t = θ − theta, 0 ≤ t ≤ duration.

    `theta` (s) counts from the segment's start, `arc` (m) from the path's.
    """

    segment: int
    theta: fmpq
    duration: fmpq
    turn_rate: Coefficients
    speed: Coefficients
    arc: fmpq

    @cached_property
    def length(self) -> fmpq:
        """Metres of reference, where the speed is positive."""
        return _evaluate(_integral(self.speed), self.duration)

    def profile(self, at: fmpq) -> dict[str, fmpq]:
        """What the dynamics see of it at t (s), by the names of a vehicle's graph."""
        return {
            "turn_rate": _evaluate(self.turn_rate, at),
            "speed": _evaluate(self.speed, at),
            "turn_rate_slope": _evaluate(_derivative(self.turn_rate), at),
            "speed_slope": _evaluate(_derivative(self.speed), at),
        }

    @property
    def is_constant(self) -> bool:
        """Whether turning rate and speed are."""
        return len(self.turn_rate) == len(self.speed) == 1

    @property
    def end_speed(self) -> fmpq:
        """v_r where the piece ends, m/s."""
        return _evaluate(self.speed, self.duration)

    @cached_property
    def turn(self) -> fmpq:
        """By how much the heading changes, in rad."""
        return _evaluate(_integral(self.turn_rate), self.duration)

    @cached_property
    def _controls(self) -> tuple[list[fmpq], list[fmpq]]:
        degree = max(len(self.turn_rate), len(self.speed)) - 1
        return bernstein(self.turn_rate, self.duration, degree), bernstein(self.speed, self.duration, degree)

    @cached_property
    def _speeds(self) -> Spread | None:
        return Spread.of(self._controls[1])

    @cached_property
    def _accelerations(self) -> Spread | None:
        return Spread.of(bernstein(_derivative(self.speed), self.duration))

    @cached_property
    def _curvatures(self) -> Spread | None:
        """None where the speed's Bernstein coefficients are not all positive.

        κ = Σ ω_i B_i / Σ v_i B_i is a mean of the ω_i/v_i with weights v_i B_i ≥ 0.
        """
        turns, speeds = self._controls
        if min(speeds) <= 0:
            return None
        return Spread.of([turn / speed for turn, speed in zip(turns, speeds, strict=True)])

    @cached_property
    def _decided(self) -> dict[tuple[str, bool, fmpq], bool]:
        return {}

    def _keeps(self, quantity: str, is_upper: bool, bound: fmpq) -> bool:
        """Whether the quantity stays on its side of the bound, where its range left that open."""
        key = (quantity, is_upper, bound)
        if key not in self._decided:
            above, below = self._fraction(quantity)  # above − bound · below has the sign of quantity − bound
            size = max(len(above), len(below))
            above, below = (c + (fmpq(0),) * (size - len(c)) for c in (above, below))
            sign = -1 if is_upper else 1
            slack = [sign * (a - bound * b) for a, b in zip(above, below, strict=True)]
            self._decided[key] = is_nonnegative(slack, self.duration)
        return self._decided[key]

    def _fraction(self, quantity: str) -> tuple[Coefficients, Coefficients]:
        """The quantity as a quotient of polynomials."""
        if quantity == "curvature":
            return self.turn_rate, self.speed
        return (self.speed if quantity == "speed" else _derivative(self.speed)), (fmpq(1),)

    def inside(self, tube: CertifiedTube | TubeClaim) -> bool:
        """Whether speed, curvature and acceleration stay inside the tube's intervals all along: decided exactly."""
        # speed first: it is positive where the curvature's inequality is used
        return (
            self._inside("speed", self._speeds, tube.speed)
            and self._inside("curvature", self._curvatures, tube.curvature)
            and self._inside("acceleration", self._accelerations, tube.acceleration)
        )

    def _inside(self, quantity: str, spread: Spread | None, interval: Range) -> bool:
        lower, upper = interval
        if spread is None:
            return self._keeps(quantity, False, lower) and self._keeps(quantity, True, upper)
        if spread.ends_lower < lower or spread.ends_upper > upper:
            return False
        return (spread.lower >= lower or self._keeps(quantity, False, lower)) and (
            spread.upper <= upper or self._keeps(quantity, True, upper)
        )

    def violations(self, tube: CertifiedTube) -> list[Violation]:
        """Where each quantity that leaves the tube's interval does so by most: places rounded, values exact."""
        found = []
        for quantity in UNITS:
            places = [at for at in self._extremes(quantity) if quantity != "curvature" or _evaluate(self.speed, at) > 0]
            values = [(self._value(quantity, at), at) for at in places]
            lower, upper = getattr(tube, quantity)
            lowest = min(values, default=None)  # the first place of each
            highest = max(values, default=None, key=lambda found: (found[0], -found[1]))
            for extreme, bound, is_upper in ((lowest, lower, False), (highest, upper, True)):
                if extreme is not None and not self._keeps(quantity, is_upper, bound):
                    value, at = extreme
                    arc = self.arc + _evaluate(_integral(self.speed), at)
                    found.append(Violation(quantity, value, bound, self.segment, self.theta + at, arc))
        return found

    def _value(self, quantity: str, at: fmpq) -> fmpq:
        above, below = self._fraction(quantity)
        return _evaluate(above, at) / _evaluate(below, at)

    def _extremes(self, quantity: str) -> list[fmpq]:
        """Ends of the piece and, nearly, the places between where the quantity's slope vanishes."""
        above, below = (fmpq_poly(list(c)) for c in self._fraction(quantity))
        slope = above.derivative() * below - above * below.derivative()
        inner: list[fmpq] = []
        if slope.degree() > 0:
            roots: list[tuple[acb, int]] = slope.complex_roots()  # pyright: ignore[reportAssignmentType]
            real = (root.real for root, _ in roots if root.imag.contains(0))
            inner = [at for root in real if 0 < (at := upper_bound(root.mid())) < self.duration]
        return [fmpq(0), *inner, self.duration]

    def split(self, inner: Sequence[fmpq]) -> "Iterator[Piece]":
        """The same stretch, cut at these t (s), increasing and inside it."""
        ends = [fmpq(0), *inner, self.duration]
        travelled = _integral(self.speed)
        for begin, end in itertools.pairwise(ends):
            yield Piece(
                self.segment,
                self.theta + begin,
                end - begin,
                _shifted(self.turn_rate, begin),
                _shifted(self.speed, begin),
                self.arc + _evaluate(travelled, begin),
            )

    @cached_property
    def displacement(self) -> acb:
        """∫ v_r e^{iP} dt over the piece, P the turn since its start: metres forward + i metres to the left."""
        return self._displaced[0]

    @cached_property
    def _displaced(self) -> tuple[acb, int]:
        """The displacement, and how many stretches it took to enclose it."""
        if self.is_constant:  # arcs and straight lines, of any number of laps
            rate = self.turn_rate[0]
            if rate == 0:
                return acb(arb(self.length)), 1
            turn = arb(self.turn)
            return arb(self.speed[0] / rate) * acb(turn.sin(), 1 - turn.cos()), 1
        return _displacement(*self._polynomials, self.duration)

    @property
    def effort(self) -> int:
        """Stretches that the enclosure of its displacement takes."""
        return self._displaced[1]

    def motion(self, at: arb, terms: int) -> tuple[acb_series, acb_series]:
        """e^{iP} and v_r e^{iP} at t = at + u in powers of u (s), for every number in the ball `at`; P as above."""
        return _series(*self._polynomials, arb_poly([at, 1]), terms)

    @cached_property
    def _polynomials(self) -> tuple[arb_poly, arb_poly]:
        """P and v_r."""
        turn, speed = (arb_poly(fmpq_poly(list(c))) for c in (_integral(self.turn_rate), self.speed))
        return turn, speed


def _displacement(turn: arb_poly, speed: arb_poly, duration: fmpq) -> tuple[acb, int]:
    """∫ speed e^{i turn} dt from 0 and the number of stretches: Taylor's series about the middle of each.

    They are halved until the remainder is small.
    With t = middle + half·u: the real and the imaginary part of the integrand are each their series up to u^{K−1}, and
    the K-th coefficient at some place between times u^K.
    """
    total, open_ = acb(0), [(fmpq(0), duration)]
    for count in range(1, MOST_STRETCHES + 1):
        begin, end = open_.pop()
        middle, half = (begin + end) / 2, arb((end - begin) / 2)
        _, whole = _series(turn, speed, arb_poly([arb(middle) + half * arb(0, 1), half]), SERIES_ORDER + 1)
        remainder = upper_bound(abs(whole[SERIES_ORDER]) * half * arb(fmpq(2, SERIES_ORDER + 1)))
        if remainder > REMAINDER:
            open_ += [(middle, end), (begin, middle)]
            continue
        _, point = _series(turn, speed, arb_poly([arb(middle), half]), SERIES_ORDER + 1)
        ball = arb(0, upper_bound(arb(remainder)))
        total += sum((point[k] * arb(fmpq(2, k + 1)) for k in range(0, SERIES_ORDER, 2)), acb(0)) * half
        total += acb(ball, ball)
        if not open_:
            return total, count
    raise ValueError(TOO_WILD)


def _series(turn: arb_poly, speed: arb_poly, along: arb_poly, terms: int) -> tuple[acb_series, acb_series]:
    """e^{i turn} and speed e^{i turn} at t = along(u) in powers of u."""
    exponent = acb_series([acb(0, c) for c in turn(along).coeffs()] or [acb(0)], prec=terms)
    phase = exponent.exp()
    result = phase * acb_series(speed(along).coeffs() or [acb(0)], prec=terms)
    if result.prec < terms:  # python-flint's global cap: terms that are missing would read as zero
        raise ValueError(f"expected series of {terms} terms, got {result.prec}")
    return phase, result


def between(pieces: Sequence[Piece], begin: fmpq, end: fmpq) -> list[Piece]:
    """What the pieces of one segment have between two θ (s, from the segment's start), cut exactly there."""
    found = []
    for piece in pieces:
        inner = sorted(at for at in {begin - piece.theta, end - piece.theta} if 0 < at < piece.duration)
        found += [part for part in piece.split(inner) if begin <= part.theta < end] if inner else []
        if not inner and begin <= piece.theta < end:
            found.append(piece)
    return found


class Gap(NamedTuple):
    """The jump of the reference from the end of a lap to its start, in the body frame of the start: upper bounds."""

    heading: fmpq  # rad, modulo 2π
    lateral: fmpq  # m
    forward: fmpq  # m
    speed: fmpq  # m/s

    def jump(self, shape: Matrix, inverse: fmpq_mat) -> fmpq:
        """By how much √V of {V = xᵀ C x ≤ 1} changes at most where the reference jumps, for deviations in there.

        The deviation gets (δ, (R(δ) − 1) p + Δp, Δv) added, and |(R(δ) − 1) p| ≤ |δ| |p|; the norm of a sum is at most
        the sum over the axes, on each of which it is √C_ii. `inverse` is C⁻¹.
        """
        swing = self.heading * sqrt_upper(inverse[1, 1] + inverse[2, 2])
        parts = (self.heading, self.lateral + swing, self.forward + swing, self.speed)
        return sum((sqrt_upper(shape[i][i]) * part for i, part in enumerate(parts)), fmpq(0))


@dataclass(frozen=True, eq=False)
class Reference:
    """The path that is certified: integrated from its first start pose, its speed continuous."""

    pieces: tuple[Piece, ...]
    start: ExactPose

    @cached_property
    def duration(self) -> fmpq:
        """T over all segments, s of reference time."""
        return sum((piece.duration for piece in self.pieces), fmpq(0))

    @cached_property
    def length(self) -> fmpq:
        """Metres."""
        return self.pieces[-1].arc + self.pieces[-1].length

    @cached_property
    def poses(self) -> tuple[ExactPose, ...]:
        """Where each segment starts, and where the last one ends."""
        pose = self.start
        found = []
        segment, effort = -1, 0
        for piece in self.pieces:
            effort += piece.effort
            if effort > MOST_OF_PATH:
                raise ValueError(TOO_WILD)
            if piece.segment != segment:
                segment = piece.segment
                found.append(pose)
            pose = pose.after(piece)
        return (*found, pose)

    @cached_property
    def gap(self) -> Gap:
        """How far the end is from the start."""
        end = self.poses[-1]
        speed = abs(_evaluate(self.pieces[-1].speed, self.pieces[-1].duration) - self.pieces[0].speed[0])
        moved = (end.position - self.start.position) * acb(0, -arb(self.start.heading)).exp()
        heading = heading_gap(end.heading, self.start.heading)
        return Gap(heading, upper_bound(abs(moved.real)), upper_bound(abs(moved.imag)), speed)


def heading_gap(first: fmpq, second: fmpq) -> fmpq:
    """A rational that is at least the difference of two headings (rad) modulo 2π, in absolute value."""
    turn = 2 * arb.pi()
    laps = (arb(first - second) / turn).mid() + arb(fmpq(1, 2))
    whole = laps.floor().unique_fmpz()  # any whole number is right, the nearest one gives the least
    if whole is None:
        raise ValueError("a heading is too large a number for this checker")
    return upper_bound(abs(arb(first - second) - turn * arb(whole)))


def exact_reference(segments: Sequence[StatedSegment]) -> Reference:
    """The reference that a chain of segments states.

    Speed is made continuous by the constant terms of later pieces, poses by integrating from the first one.

    Raises:
        ValueError: where the speed jumps by more than 1e-9 m/s, or a later segment does not start (1e-6 rad, 1e-6 m)
            where the one before ends.
    """
    pieces: list[Piece] = []
    arc = fmpq(0)
    for index, segment in enumerate(segments):
        breaks = segment.turn_rate.breaks, segment.speed.breaks
        if breaks[0][0] != 0 or breaks[1][0] != 0 or breaks[0][-1] != breaks[1][-1]:
            raise ValueError(f"segment {index}: turn rate and speed need the same range of theta, from 0")
        speed = _continuous(index, segment.speed, pieces[-1] if pieces else None)
        ends = breaks[0] if breaks[0] == breaks[1] else sorted({*breaks[0], *breaks[1]})
        turning = moving = 0
        for begin, end in itertools.pairwise(ends):
            turning += breaks[0][turning + 1] <= begin
            moving += breaks[1][moving + 1] <= begin
            turn_rate = _shifted(segment.turn_rate.coefficients[turning], begin - breaks[0][turning])
            piece = Piece(index, begin, end - begin, turn_rate, _shifted(speed[moving], begin - breaks[1][moving]), arc)
            pieces.append(piece)
            arc += piece.length
    heading, x, y = segments[0].start
    reference = Reference(tuple(pieces), ExactPose(heading, acb(arb(x), arb(y))))
    if len(segments) > 1:
        for index, segment in enumerate(segments[1:], start=1):
            check_start(index, segment.start, reference.poses[index])
    return reference


def _continuous(index: int, profile: StatedProfile, before: Piece | None) -> list[Coefficients]:
    """The speed's coefficients with constant terms that continue the piece before, exactly."""
    value = _evaluate(before.speed, before.duration) if before else profile.coefficients[0][0]
    result = []
    for begin, end, (stated, *higher) in zip(profile.breaks, profile.breaks[1:], profile.coefficients, strict=False):
        if abs(stated - value) > LARGEST_SPEED_GAP:
            raise ValueError(
                f"speed jumps by {float(stated - value):.6g} m/s at theta = {float(begin):.6g} s of segment {index}, "
                f"from {float(value):.6g} to {float(stated):.6g} m/s: expected a continuous speed"
            )
        result.append((value, *higher))
        value = _evaluate(result[-1], end - begin)
    return result


def check_start(index: int, stated: tuple[fmpq, fmpq, fmpq], pose: ExactPose) -> None:
    """Raises ValueError where a segment does not start where the one before ends."""
    heading, x, y = stated
    turn = heading_gap(heading, pose.heading)
    if turn > LARGEST_POSE_GAP:
        raise ValueError(
            f"heading jumps by {decimal_text(turn)} rad between segments {index - 1} and {index}: no car follows a "
            f"corner, expected the segments to meet with one heading"
        )
    apart = upper_bound(abs(acb(arb(x), arb(y)) - pose.position))
    if apart > LARGEST_POSE_GAP:
        raise ValueError(
            f"segment {index} starts {decimal_text(apart)} m away from where segment {index - 1} ends: expected the "
            f"same place"
        )


# --- chains of tubes


@lru_cache(maxsize=4096)
def hands_over(first: CertifiedTube, second: CertifiedTube, level: fmpq) -> bool:
    """Whether {V₁ ≤ level} ⊂ {V₂ < 1}, and still level · V₂ < V₁: level C₂ ≺ C₁."""
    rows = zip(first.shape, second.shape, strict=True)
    return is_positive_definite([[a - level * b for a, b in zip(upper, lower, strict=True)] for upper, lower in rows])


def needed_distance(
    first: CertifiedTube, second: CertifiedTube, level: fmpq, gap: Gap | None = None
) -> tuple[fmpq, fmpq] | None:
    """The level of the first tube at which every deviation is inside the second, and metres of reference to get there.

    `level` is one with level C₂ ≺ C₁ (proven here), as large as can be. With a gap the reference jumps in between:
    V₁ ≤ level (1 − jump)² makes √V₂ < 1 − jump before, and below 1 after. None where it is not proven.
    """
    jump = gap.jump(second.shape, second.inverse) if gap else fmpq(0)
    if jump >= 1 or not level > 0 or not hands_over(first, second, level):
        return None
    # the jump is bounded for deviations inside the second tube, where they are: √V₂ < 1 − jump
    reached = min(level * (1 - jump) ** 2, fmpq(1))
    distance = first.distance_to(reached)
    return None if distance is None else (reached, distance)


class Run(NamedTuple):
    """Pieces begin, …, end − 1 in one tube."""

    begin: int
    end: int
    tube: CertifiedTube


class ProvenLink(NamedTuple):
    """One tube hands over to the next at the start of a piece: V of the first is at most `level` after `needed` metres,
    of which it has `available`."""

    piece: int
    first: CertifiedTube
    second: CertifiedTube
    level: fmpq
    needed: fmpq
    available: fmpq


def prove_chain(
    reference: Reference, runs: Sequence[Run], levels: Sequence[fmpq], closed: bool
) -> tuple[ProvenLink, ...]:
    """Proves that deviations which start inside the first tube are inside each one along its run.

    `levels[k]` is proposed for the link after run k (`needed_distance`); a closed chain has one more than an open one,
    from the last run to the first, over the gap of the lap: it then holds for ever.

    Raises:
        ValueError: says what is not proven.
    """
    pieces = reference.pieces
    ends = [0, *(run.end for run in runs)]
    if ends[-1] != len(pieces) or any(run.begin != end or run.end <= end for run, end in zip(runs, ends, strict=False)):
        raise ValueError("the runs of a chain have to follow each other from the first piece to the last")
    cars = [(run.tube.vehicle, dict(run.tube.parameters)) for run in runs]
    if any(car != cars[0] for car in cars):
        raise ValueError("the tubes of a chain have to be certified for one vehicle")
    for run in runs:
        for piece in pieces[run.begin : run.end]:
            if not piece.inside(run.tube):
                raise ValueError(
                    f"segment {piece.segment} at theta = {float(piece.theta):.6g} s leaves tube {run.tube.name}"
                )
    followers = [*runs[1:], *([runs[0]] if closed else [])]
    if len(levels) != len(followers):
        raise ValueError(f"expected {len(followers)} levels of links, got {len(levels)}")
    links = []
    for index, (run, following, level) in enumerate(zip(runs, followers, levels, strict=False)):
        last = pieces[run.end - 1]
        available = last.arc + last.length - pieces[run.begin].arc
        around = reference.gap if index == len(runs) - 1 else None
        proven = needed_distance(run.tube, following.tube, level, around)
        if proven is None or proven[1] > available:
            raise ValueError(f"tube {run.tube.name} does not hand over to tube {following.tube.name}")
        links.append(ProvenLink(following.begin, run.tube, following.tube, *proven, available))
    return tuple(links)


def is_closed(gap: Gap) -> bool:
    """Whether the end of a lap meets its start as well as segments have to meet."""
    return max(gap[:3]) <= LARGEST_POSE_GAP and gap.speed <= LARGEST_SPEED_GAP
