"""What a certified funnel absorbs: a control period, disturbances, errors of the pose, a delay; verified, not sought.

A law that reaches V̇ ≤ −λ' on the shell β̲ ≤ V ≤ 1, λ' a share of the certified λ, has λ' to spend. With bounds over the
whole funnel, every input of the box and the reference along each stretch (`cfcheck.robustness.hold`),

    D ≥ V̇,   M ≥ V̈,   N_i ≥ |∂V̇/∂x_i|,   G_i ≥ |∂V/∂x_i|,   F_i ≥ |ẋ_i|,   L = Σ N_i F_i + k u0_hi max|V̇| ,

let inputs be held for a period h, ẋ be off by |d_i| ≤ δ_i, the pose by |e_i| ≤ ε_i, and let it be τ old. Then, s after
the inputs were chosen, V̇ ≤ −λ' + Σ N_i ε_i + Σ G_i δ_i + (L + Σ N_i δ_i) τ + (M + Σ N_i δ_i) s where the law saw the
shell; elsewhere V ≤ β̲ + ω + (D + Σ G_i δ_i)(h + τ), with ω by which the pose's error changes V. So V ≤ 1 − ω is kept if

    (L + Σ N δ) τ + Σ G δ + Σ N ε + (M + Σ N δ) h/2 ≤ λ',          β̲ + 2 ω + (D + Σ G δ)(h + τ) ≤ 1.

Without error of the pose ω = 0, and V ≤ 1 itself is kept. Where one leg leads into another one there is more to ask
(`cfcheck.robustness.descent`).

A file states amounts, and hints for the bounds. Whether the bounds allow the amounts is decided here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from flint import fmpq

from cfcheck.exact.rational import Range
from cfcheck.kernel.funnel import LAW_SHARE
from cfcheck.path.bounds import Bounds
from cfcheck.reader import Broken
from cfcheck.robustness.ranges import SampledClaim


SHARE = LAW_SHARE - fmpq(1, 2**20)  # λ'/λ: what a law that computes in floating point surely reaches
MOST = fmpq(10**6)


@dataclass(frozen=True)
class Rates:
    """Bounds over one funnel, as above: by state where they are several."""

    rise: fmpq  # D, 1/s
    bend: fmpq  # M, 1/s²
    slopes: tuple[fmpq, ...]  # N, 1/s per unit of the state
    gradient: tuple[fmpq, ...]  # G, per unit of the state
    norms: tuple[fmpq, ...]  # an error ε_i of the pose changes √V (of the paper's template √q) by norms_i ε_i
    widest: fmpq  # the largest √V (√q)
    staleness: fmpq  # L, 1/s²
    decrease: fmpq  # λ' − J, 1/s
    inner: fmpq  # β̲
    horizon: fmpq = MOST  # s from what was measured on in which the bounds hold

    def spent(self, amounts: "AbsorbedClaim") -> fmpq:
        """How much of λ' is used up on average over a period, 1/s."""
        shaken = dot(self.slopes, amounts.disturbance)
        return (
            (self.staleness + shaken) * amounts.delay
            + dot(self.gradient, amounts.disturbance)
            + dot(self.slopes, amounts.pose_error)
            + (self.bend + shaken) * amounts.period / 2
        )

    def blurred(self, amounts: "AbsorbedClaim") -> fmpq:
        """ω: how far V and what the law takes for it are apart at most."""
        norm = dot(self.norms, amounts.pose_error)
        return 2 * self.widest * norm + norm * norm

    def risen(self, amounts: "AbsorbedClaim") -> fmpq:
        """How much V rises from a measurement to the end of what is chosen by it."""
        return (self.rise + dot(self.gradient, amounts.disturbance)) * (amounts.period + amounts.delay)

    def in_units(self, axes: Sequence[fmpq], faster: fmpq) -> "Rates":
        """The bounds of the similar motion: states multiplied by `axes`, and so many times as fast."""
        return Rates(
            rise=self.rise * faster,
            bend=self.bend * faster**2,
            slopes=tuple(value * faster / axis for value, axis in zip(self.slopes, axes, strict=True)),
            gradient=tuple(value / axis for value, axis in zip(self.gradient, axes, strict=True)),
            norms=tuple(value / axis for value, axis in zip(self.norms, axes, strict=True)),
            widest=self.widest,
            staleness=self.staleness * faster**2,
            decrease=self.decrease * faster,
            inner=self.inner,
            horizon=self.horizon if self.horizon == MOST else self.horizon / faster,
        )


@dataclass(frozen=True)
class AbsorbedClaim:
    """What is absorbed together: h (s); δ (units of the states, a second) and ε (units), of all states; τ (s)."""

    period: fmpq
    disturbance: tuple[fmpq, ...]
    pose_error: tuple[fmpq, ...]
    delay: fmpq

    def scaled(self, factor: fmpq) -> "AbsorbedClaim":
        """All of it, so many times."""
        return AbsorbedClaim(
            period=factor * self.period,
            disturbance=tuple(factor * value for value in self.disturbance),
            pose_error=tuple(factor * value for value in self.pose_error),
            delay=factor * self.delay,
        )

    def alone(self, name: str, state: int | None = None) -> "AbsorbedClaim":
        """One of the amounts by itself, in one state where it has several."""
        amount = getattr(self, name)
        if state is not None:
            amount = tuple(value if index == state else fmpq(0) for index, value in enumerate(amount))
        return replace(self.scaled(fmpq(0)), **{name: amount})


class Stated(NamedTuple):
    """What a file states: amounts each by itself (of δ and ε one state's alone), and amounts that come together.

    `by_speed` has for each band of speeds what is absorbed by itself at these; its errors of the pose are those of all
    bands.
    """

    alone: AbsorbedClaim
    together: AbsorbedClaim
    by_speed: tuple[AbsorbedClaim, ...]


Keeps = Callable[[AbsorbedClaim], fmpq | None]  # the level that is kept under some amounts, where one is


class LawNumbers(NamedTuple):
    """What a run-time law has to know of a funnel: λ (1/s), μ (1/m), β̲, β_in, and bounds of references.

    The law has to reach its decrease for all references within these bounds at once.
    """

    margin: fmpq
    margin_per_metre: fmpq | None
    shell: fmpq
    inner: fmpq
    bounds: Bounds | None


@dataclass(frozen=True)
class BoundsOver:
    """What is proven over the funnels of a certificate, and what follows for amounts.

    `rates` are those of every funnel, of an invariant one for each band of speeds; `law_numbers` are by funnel.
    `bands` (m/s) are those of a funnel for every path within bounds, of which amounts are stated band by band.
    `sampled` is what is proven of a law that looks one hold ahead.
    """

    rates: tuple[Rates, ...]
    keeps: Keeps
    law_numbers: tuple[LawNumbers, ...]
    bands: tuple[Range, ...] = ()
    sampled: SampledClaim | None = None


@dataclass(frozen=True)
class ProvenRobustness:
    """Amounts that are absorbed: V stays below 1.

    From starts with V ≤ `pose_level` under an error of the pose alone, and with V ≤ `level` under all amounts together;
    both are 1 where the pose has no errors.
    """

    alone: AbsorbedClaim
    pose_level: fmpq
    together: AbsorbedClaim
    level: fmpq
    rates: tuple[Rates, ...]
    law_numbers: tuple[LawNumbers, ...] = ()  # by funnel
    bands: tuple[Range, ...] = ()
    by_speed: tuple[AbsorbedClaim, ...] = ()
    sampled: SampledClaim | None = None


def verified(stated: Stated, bounds: BoundsOver) -> ProvenRobustness:
    """The amounts that a file states, with the levels that are kept under them.

    Raises:
        Broken: names the first amount that the bounds do not allow.
    """
    alone, together, by_speed = stated

    def level(name: str, amounts: AbsorbedClaim, keeps: Keeps = bounds.keeps) -> fmpq:
        kept = keeps(amounts)
        if kept is None:
            raise Broken(f"robustness: the bounds do not allow the {name} that is claimed")
        return kept

    def each_alone(own: AbsorbedClaim, keeps: Keeps, where: str) -> fmpq:
        """The least level under one state's error of the pose."""
        level(f"period{where}", own.alone("period"), keeps)
        level(f"delay{where}", own.alone("delay"), keeps)
        states = range(len(own.disturbance))
        for state in states:
            level(f"disturbance of state {state}{where}", own.alone("disturbance", state), keeps)
        return min(level(f"error of state {state}{where}", own.alone("pose_error", state), keeps) for state in states)

    if len(by_speed) != len(bounds.bands):
        raise Broken(f"robustness: expected amounts for {len(bounds.bands)} bands of speed, got {len(by_speed)}")
    for band, own in enumerate(by_speed):
        each_alone(own, partial(least_level, bounds.rates[band : band + 1]), f" in band {band}")
    return ProvenRobustness(
        alone=alone,
        pose_level=each_alone(alone, bounds.keeps, ""),
        together=together,
        level=level("amounts together", together),
        rates=bounds.rates,
        law_numbers=bounds.law_numbers,
        bands=bounds.bands,
        by_speed=by_speed,
        sampled=bounds.sampled,
    )


def least_level(rates: Sequence[Rates], amounts: AbsorbedClaim) -> fmpq | None:
    """The least of the levels that are kept; None where one is not."""
    levels = [kept_level(one, amounts) for one in rates]
    return None if None in levels else min(level for level in levels if level is not None)


def kept_level(rates: Rates, amounts: AbsorbedClaim) -> fmpq | None:
    """1 − ω where the inequalities above hold for one funnel, else None."""
    blurred = rates.blurred(amounts)
    inside = rates.inner + 2 * blurred + rates.risen(amounts)
    prompt = amounts.period + amounts.delay <= rates.horizon
    return 1 - blurred if rates.spent(amounts) <= rates.decrease and inside <= 1 and prompt else None


def dot(first: Sequence[fmpq], second: Sequence[fmpq]) -> fmpq:
    return sum((a * b for a, b in zip(first, second, strict=True)), fmpq(0))
