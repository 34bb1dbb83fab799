"""A funnel's body never touches an obstacle: a half-plane on a piece, proven by second-order Taylor bounds in balls.

The vehicle's deviation x = (α_R, x_R, y_R, …) lies in {xᵀ C x ≤ ρ(θ)}. A disc of its body, offset o along its forward
axis, radius r, has its centre at p_r + R(α_r) (x_R, y_R) + o fwd(α_r + α_R). It is apart from an obstacle, the hull of
corners c grown by a radius R, where a normal n separates the two:

    max over the funnel of n·centre + r |n| < min_c n·c − R |n|                                            (1)

With a = n·lat(α_r), b = n·fwd(α_r), A = (C⁻¹)_αα, so that α_R² ≤ ρ A, a lever l = o (1 − ρ A/8) and κ = −o b,

    o n·fwd(α_r + α_R) = o b cos α_R − o a sin α_R ≤ o b − l a α_R + κ α_R²/2 + ε
    ε = max(0, o b) (ρ A)²/24 + |o a| ((ρ A)^{3/2}/24 + (ρ A)^{5/2}/120)                   for |α_R| ≤ √(ρ A),

for sin α is nearest to (1 − w²/8) α on |α| ≤ w: |α³/6 − w² α/8| ≤ w³/24. On the funnel

* m·x with m = (−l a, a, b, 0, …) reaches √(ρ Q), Q = mᵀ C⁻¹ m;
* m·x + κ α_R²/2 ≤ λ ρ + max_x (m·x + κ α_R²/2 − λ xᵀ C x) for every λ ≥ 0; where λ > κ A/2 this is, with s = (C⁻¹ m)_α,
  λ ρ + Q/(4λ) + κ s²/(8 λ (λ − κ A/2)) = √(ρ Q) + (2 λ √ρ − √Q)²/(4 λ) + κ s²/(8 λ (λ − κ A/2))   (Sherman–Morrison);
* it is at most √(ρ Q) + max(0, κ/2) ρ A as well.

The sum g(θ) of n·p_r + o b + √(ρ Q) is bounded on a stretch of θ by g(t) ≤ g(0) + g'(0) t + t² max g''/2 about its
middle, what is left (millimetres) by its value in balls; a stretch on which (1) does not follow is halved.

Frames and units: θ in s from the segment's start, lengths in m, inertial frame; at heading α the lateral axis is
(cos α, sin α), the forward axis (−sin α, cos α).
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb, arb_series, fmpq, fmpq_mat

from cfcheck.exact.definite import exact_matrix, is_positive_definite
from cfcheck.exact.enclosure import Budget
from cfcheck.exact.polynomial import bernstein
from cfcheck.exact.rational import Matrix, about, bits, decimal_text
from cfcheck.kernel.level import Level
from cfcheck.path.piece import Piece
from cfcheck.path.reference import ExactPose
from cfcheck.vehicle.model import POSE


TERMS = 3  # of a Taylor series of second order
# λ is tried at √(Q/ρ)/2, which is best for κ = 0, and at these shares of κ A/2 above it
MULTIPLIERS = tuple(fmpq(k, 4) for k in range(5))
MOST_HALVINGS = 40  # of a piece
STRETCH_EFFORT = 2**6  # half a millisecond: a proof takes some seconds at most
# the poses of longer stretches are not enclosed: a file must not decide how much work that is
LONGEST_TURN = fmpq(1)  # rad
LONGEST_WAY = fmpq(1024)  # m


@dataclass(frozen=True)
class ObstacleClaim:
    """The hull of `corners` (m, one or more, in any order), grown by `round` ≥ 0 (m)."""

    corners: tuple[tuple[fmpq, fmpq], ...]
    round: fmpq

    def __post_init__(self) -> None:
        if not self.corners or not self.round >= 0:
            raise ValueError("clearance: expected an obstacle with a corner, grown by a length that is not negative")


@dataclass(frozen=True)
class FootprintClaim:
    """A disc of the vehicle's body: radius ≥ 0 and offset of its centre along the forward axis, m."""

    radius: fmpq
    offset: fmpq

    def __post_init__(self) -> None:
        if not self.radius >= 0:
            raise ValueError(f"clearance: expected a disc whose radius is not negative, got {about(self.radius)} m")


@dataclass(frozen=True, eq=False)
class Shadow:
    """What a disc of the body sweeps in the plane while the deviation is anywhere in {xᵀ C x ≤ ρ(θ)}.

    `shape` is C in the pose (α, x, y) and any other states.

    Raises:
        ValueError: for a shape that is not positive definite.
    """

    shape: Matrix
    level: Level
    disc: FootprintClaim

    def __post_init__(self) -> None:
        if len(self.shape) < len(POSE) or not is_positive_definite(self.shape):
            raise ValueError(f"clearance: expected a positive definite C in {', '.join(POSE)} and other states")

    @cached_property
    def inverse(self) -> fmpq_mat:
        """C⁻¹."""
        return exact_matrix(self.shape).inv()

    @cached_property
    def longest(self) -> int:
        """Bits of the longest number in C⁻¹."""
        return max(bits(entry) for entry in self.inverse.entries())

    def around(self, level: fmpq) -> arb:
        """How far (m) the disc's centre is from the reference at most, where ρ is at most `level`.

        x_R² ≤ ρ (C⁻¹)_xx and y_R² ≤ ρ (C⁻¹)_yy, whatever the headings are.
        """
        return arb(level * (self.inverse[1, 1] + self.inverse[2, 2])).sqrt() + abs(self.disc.offset)

    def check_end(self, duration: fmpq) -> None:
        """Raises ValueError for a funnel that is empty before θ = duration (s): ρ is monotone and starts at one."""
        if not self.level.series(arb(duration), TERMS)[0] > 0:
            raise ValueError("clearance: the funnel is empty before its end")

    def reach(self, normal: acb, piece: Piece, heading: fmpq, at: arb) -> tuple[list[arb], arb]:
        """How far the disc's centre gets along the normal (n as a complex number) from where the piece starts.

        `heading` (rad) is the reference's there. Returns the Taylor coefficients of n·(p_r − start) + o b + √(ρ Q)
        about every t in the ball `at` (s, from the piece's start), the first one without n·(p_r − start), and a bound
        of the rest: of the terms with κ and ε.
        """
        phase, velocity = piece.motion(at, TERMS)
        facing = normal.conjugate() * acb(0, arb(heading)).exp()  # its real part is n·lat, its imaginary part −n·fwd
        turned, moved = phase * facing, velocity * facing
        a = arb_series([turned[k].real for k in range(TERMS)], prec=TERMS)
        b = arb_series([-turned[k].imag for k in range(TERMS)], prec=TERMS)
        level = self.level.series(piece.theta + at, TERMS)
        o, inverse = self.disc.offset, self.inverse
        m = (a * level * (o * inverse[0, 0] / 8) - a * o, a, b)
        swing, *others = (sum((inverse[i, j] * m[j] for j in range(1, 3)), inverse[i, 0] * m[0]) for i in range(3))
        form = sum((m[i] * other for i, other in enumerate(others, start=1)), m[0] * swing)  # Q
        total = o * b + (level * form).sqrt()
        terms = [total[0], *(total[k] - moved[k - 1].imag / k for k in range(1, TERMS))]

        return terms, self._bend(a[0], b[0], level[0], form[0], swing[0])

    def _bend(self, a: arb, b: arb, level: arb, form: arb, swing: arb) -> arb:
        """The terms with κ and ε: what is added to √(ρ Q)."""
        zero, square = arb(0), level * self.inverse[0, 0]  # α_R² ≤ square
        kappa = -self.disc.offset * b
        second = kappa.max(zero) / 2 * square
        lowest = kappa * self.inverse[0, 0] / 2  # that λ has to be above
        for share in MULTIPLIERS:
            multiplier = ((form / level).sqrt() / 2 + share * lowest).mid()
            if multiplier > 0 and multiplier > lowest:
                apart = 2 * multiplier * level.sqrt() - form.sqrt()
                tilted = kappa * swing * swing / (multiplier - lowest)  # a power of a ball around zero is no number
                second = second.min((apart * apart + tilted / 2) / (4 * multiplier))
        odd = square * square.sqrt() * (1 + square / 5) / 24
        return second + (-kappa).max(zero) * square * square / 24 + abs(self.disc.offset * a) * odd


def prove_half_plane(
    piece: Piece,
    start: ExactPose,
    shadow: Shadow,
    obstacles: Sequence[ObstacleClaim],
    normal: tuple[int, int],
    budget: Budget,
) -> None:
    """Proves (1) for all of the obstacles with one normal, all along a piece that starts at the pose.

    Its numbers have to be moderately long, and the funnel not empty.

    Raises:
        ValueError: says at which θ it is not proven.
    """
    x, y = map(fmpq, normal)
    length = arb(x * x + y * y).sqrt()
    limits = (
        min(x * cx + y * cy for cx, cy in each.corners) - (each.round + shadow.disc.radius) * length
        for each in obstacles
    )
    limit = functools.reduce(arb.min, limits)
    _Separation(shadow, acb(arb(x), arb(y)), limit, budget).after(piece, start, MOST_HALVINGS)


@dataclass(frozen=True)
class _Separation:
    """The claim that a disc's centre gets along a normal nowhere as far as `limit`."""

    shadow: Shadow
    normal: acb
    limit: arb
    budget: Budget

    def after(self, piece: Piece, pose: ExactPose, halvings: int) -> ExactPose:
        """The pose where the piece ends that starts at `pose`; all along it the claim is proven."""
        self.budget.spend(len(piece.turn_rate) ** 2 + len(piece.speed) ** 2)
        if self._is_far(piece, pose):
            return pose.after(piece)
        self.budget.spend(STRETCH_EFFORT)
        half = piece.duration / 2
        first, second = piece.halves
        if _is_short(piece):
            middle = pose.after(first)
            (value, slope, _), bend = self.shadow.reach(self.normal, piece, pose.heading, arb(half))
            gap = value + (self.normal.conjugate() * middle.position).real - self.limit
            if not gap + bend < 0:  # the middle is nearly a point: halving would not help
                raise ValueError(_unproven(first.theta + half))
            around = arb(half) + half * arb(0, 1)
            (_, _, curvature), bend = self.shadow.reach(self.normal, piece, pose.heading, around)
            if gap + _peak(slope, curvature, arb(half)) + bend < 0:
                return middle.after(second)
        if not halvings:
            raise ValueError(_unproven(piece.theta))
        return self.after(second, self.after(first, pose, halvings - 1), halvings - 1)

    def _is_far(self, piece: Piece, pose: ExactPose) -> bool:
        """Whether the claim holds wherever the piece leads, for the disc gets no further than this from its start."""
        way = max(map(abs, bernstein(piece.speed, piece.duration))) * piece.duration
        level = self.shadow.level.extent((piece.theta, piece.theta + piece.duration))[1]
        reach = abs(self.normal) * (way + self.shadow.around(level))
        return (self.normal.conjugate() * pose.position).real + reach < self.limit


def _unproven(theta: fmpq) -> str:
    return f"clearance is not proven at theta = {decimal_text(theta)} s: the body may reach the obstacle"


def _is_short(piece: Piece) -> bool:
    """Whether turn and way are short enough for poses to be enclosed."""
    limits = ((piece.turn_rate, LONGEST_TURN), (piece.speed, LONGEST_WAY))
    return all(max(map(abs, bernstein(c, piece.duration))) * piece.duration <= most for c, most in limits)


def _peak(slope: arb, curvature: arb, half: arb) -> arb:
    """At least slope·t + curvature·t² for every |t| ≤ half and every pair of numbers in the balls."""
    steepest, most = abs(slope).upper(), curvature.upper()
    # the vertex of a parabola that opens downwards is above it everywhere: where its place is open, that is right too
    if most < 0 and not steepest >= -2 * most * half:
        return steepest * steepest / (-4 * most)
    return (steepest + most * half) * half
