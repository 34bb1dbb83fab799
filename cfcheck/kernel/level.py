"""How far a funnel reaches at each θ: the templates of V, each at one rate, in exact numbers.

With the quadratic form q = xᵀ C x of the deviation and a rate (1/s) the funnel V ≤ 1 is q ≤ ρ(θ), as in
`cfjax.funnel.template`:

    paper        V = q + c0 θ         ρ(θ) = 1 − c0 θ
    contracting  V = e^{kθ} q         ρ(θ) = e^{−kθ}

V̇ = σ (q̇ + timing(q) u0) with σ = 1 and timing = c0, or σ = 1/ρ and timing = k q. That V falls at λ on the shell, and
at λ V/β̲ below it, is −(q̇ + timing u0) ≥ λ weight with weight = min(1, V/β̲)/σ. Where ρ is not rational, rationals below
and above it stand for it.
"""

import abc
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from flint import arb, arb_series, fmpq, fmpq_mpoly

from cfcheck.exact.rational import Range, exp_bounds, sqrt_upper


class Affine(NamedTuple):
    """The function constant + slope · q."""

    constant: fmpq
    slope: fmpq

    def at(self, q: fmpq_mpoly) -> fmpq_mpoly:
        """Its value at a polynomial."""
        return self.constant + self.slope * q

    def least(self, lower: fmpq, upper: fmpq) -> fmpq:
        """Its least value on an interval of q."""
        return self.constant + self.slope * (lower if self.slope > 0 else upper)


ZERO, ONE = fmpq(0), fmpq(1)


@dataclass(frozen=True)
class LevelPiece:
    """A range of q = xᵀ C x and, on it, timing(q) and weight(q)."""

    lower: fmpq
    upper: fmpq
    timing: Affine
    weight: Affine

    @property
    def least_weight(self) -> fmpq:
        """The least value of the weight on the range."""
        return self.weight.least(self.lower, self.upper)


@dataclass(frozen=True)
class Level(abc.ABC):
    """A template of V at one rate (1/s). ρ is monotone and starts at one; below rate zero the funnel grows."""

    name: ClassVar[str]
    rate_name: ClassVar[str]
    rate: fmpq

    @abc.abstractmethod
    def form_bounds(self, value: fmpq, theta: fmpq) -> Range:
        """Rationals below and above the q at which V = value ≥ 0 at θ (s)."""

    def bounds(self, theta: fmpq) -> Range:
        """Rationals below and above ρ(θ)."""
        return self.form_bounds(fmpq(1), theta)

    def extent(self, span: Range) -> Range:
        """The same of all ρ(θ) with θ from one end of the span to the other."""
        (first_low, first_high), (last_low, last_high) = map(self.bounds, span)
        return min(first_low, last_low), max(first_high, last_high)

    @abc.abstractmethod
    def series(self, theta: arb, terms: int) -> arb_series:
        """ρ at θ + u in powers of u, for every θ in the ball."""

    @abc.abstractmethod
    def value_rate(self, theta: fmpq, form: fmpq, form_rate: arb, u0: arb) -> arb:
        """V̇ where q and q̇ are these."""

    @abc.abstractmethod
    def deviation_scale(self, least: fmpq, peak: fmpq) -> tuple[fmpq, fmpq]:
        """Upper bounds of √(s q) on V ≤ 1 and of s, where V is s q and a part of θ alone: s = 1, or s = 1/ρ.

        `peak` is at least every ρ that is spoken of, and `least` at most every 1/σ.
        """

    @abc.abstractmethod
    def inside(self, span: Range) -> list[LevelPiece]:
        """Ranges of q that cover V ≤ 1 on a stretch of θ; `weight` is at most 1/σ, so that V̇ is not underrated."""

    def shell(self, span: Range, beta_lower: fmpq, beta_inner: fmpq) -> list[LevelPiece]:
        """The shell β_in ≤ V ≤ 1 on a stretch of θ, θ itself eliminated: ranges of q that cover it; β_in ≤ β̲.

        `weight` is at least min(1, V/β̲)/σ at every θ of the stretch.

        Raises:
            ValueError: where the shell would hold the reference itself (q = 0).
        """
        pieces = self._shell(span, beta_lower, beta_inner)
        if pieces[0].lower <= 0:
            raise ValueError("the shell reaches the reference: c0 T has to stay below the shell's inner level")
        return pieces

    @abc.abstractmethod
    def _shell(self, span: Range, beta_lower: fmpq, beta_inner: fmpq) -> list[LevelPiece]:
        """The same, wherever it begins."""


class Paper(Level):
    """V = xᵀ C x + c0 θ, the paper's own."""

    name = "paper"
    rate_name = "c0"

    def form_bounds(self, value: fmpq, theta: fmpq) -> Range:
        return value - self.rate * theta, value - self.rate * theta

    def series(self, theta: arb, terms: int) -> arb_series:
        return arb_series([1 - self.rate * theta, arb(-self.rate)], prec=terms)

    def value_rate(self, theta: fmpq, form: fmpq, form_rate: arb, u0: arb) -> arb:
        return form_rate + arb(self.rate) * u0

    def deviation_scale(self, least: fmpq, peak: fmpq) -> tuple[fmpq, fmpq]:
        return sqrt_upper(peak), fmpq(1)

    def inside(self, span: Range) -> list[LevelPiece]:
        return [LevelPiece(ZERO, self.extent(span)[1], Affine(self.rate, ZERO), Affine(ONE, ZERO))]

    def _shell(self, span: Range, beta_lower: fmpq, beta_inner: fmpq) -> list[LevelPiece]:
        least, peak = self.extent(span)
        change, timing = 1 - least, Affine(self.rate, ZERO)
        rising, flat = Affine(change / beta_lower, 1 / beta_lower), Affine(ONE, ZERO)
        return _in_two(beta_inner - change, beta_lower - change, peak, timing, rising, flat)


class Contracting(Level):
    """V = e^{kθ} xᵀ C x: the level sets shrink at a relative rate."""

    name = "contracting"
    rate_name = "rate"

    def form_bounds(self, value: fmpq, theta: fmpq) -> Range:
        low, high = exp_bounds(-self.rate * theta)
        return value * low, value * high

    def series(self, theta: arb, terms: int) -> arb_series:
        return arb_series([-self.rate * theta, arb(-self.rate)], prec=terms).exp()

    def value_rate(self, theta: fmpq, form: fmpq, form_rate: arb, u0: arb) -> arb:
        return arb(self.rate * theta).exp() * (form_rate + arb(self.rate * form) * u0)

    def deviation_scale(self, least: fmpq, peak: fmpq) -> tuple[fmpq, fmpq]:
        return fmpq(1), 1 / least

    def inside(self, span: Range) -> list[LevelPiece]:
        least, peak = self.extent(span)
        timing = Affine(ZERO, self.rate)
        inner = LevelPiece(ZERO, least, timing, Affine(least, ZERO))
        return [inner, LevelPiece(least, peak, timing, Affine(ZERO, ONE))] if least < peak else [inner]

    def _shell(self, span: Range, beta_lower: fmpq, beta_inner: fmpq) -> list[LevelPiece]:
        least, peak = self.extent(span)
        rising, flat = Affine(ZERO, 1 / beta_lower), Affine(peak, ZERO)
        return _in_two(beta_inner * least, beta_lower * peak, peak, Affine(ZERO, self.rate), rising, flat)


def _in_two(start: fmpq, kink: fmpq, peak: fmpq, timing: Affine, rising: Affine, flat: Affine) -> list[LevelPiece]:
    """The shell's ranges of q: `rising` weight up to the kink, if it begins below that, a `flat` one from there on."""
    outer = LevelPiece(kink, peak, timing, flat)
    return [LevelPiece(start, kink, timing, rising), outer] if start < kink else [outer]


LEVELS: dict[str, type[Level]] = {level.name: level for level in (Paper, Contracting)}
"""Templates by name."""
