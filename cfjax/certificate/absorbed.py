"""What the checker shows that funnels absorb, as part of a result; and whether it is what was asked."""

import dataclasses

from flint import fmpq

from cfcheck import Report
from cfcheck.exact.rational import float_below, rational
from cfcheck.robustness.amounts import AbsorbedClaim as ProvenAmounts
from cfcheck.robustness.amounts import ProvenRobustness as Proven
from cfcheck.robustness.ranges import SampledClaim
from cfjax.exact import tube_within
from cfjax.result import Absorbed, Result, Robustness, Sampled
from cfjax.rounded import MILLI, margin_text, rounded_down
from cfjax.verdict import Verdict


def with_amounts(result: Result, report: Report) -> Result:
    """The result with what is absorbed, if that is proven, and a law that asks for it within the bounds of each leg."""
    if report.robustness is None:
        return result
    bounds = report.bounds or (None,) * len(result.segments)
    segments = tuple(
        segment if own is None else dataclasses.replace(segment, along=tube_within(own))
        for segment, own in zip(result.segments, bounds, strict=True)
    )
    return result.replace(robustness=_amounts(report.robustness), segments=segments)


def _amounts(proven: Proven) -> Robustness:
    """Rounded down."""

    def absorbed(amounts: ProvenAmounts) -> Absorbed:
        return Absorbed(
            period=float_below(amounts.period),
            disturbance=tuple(map(float_below, amounts.disturbance)),
            pose_error=tuple(map(float_below, amounts.pose_error)),
            delay=float_below(amounts.delay),
        )

    return Robustness(
        alone=absorbed(proven.alone),
        pose_level=float_below(proven.pose_level),
        together=absorbed(proven.together),
        level=float_below(proven.level),
        by_speed=tuple(
            (float(lower), float(upper), absorbed(own))
            for (lower, upper), own in zip(proven.bands, proven.by_speed, strict=True)
        ),
        sampled=None if proven.sampled is None else _sampled(proven.sampled),
    )


def _sampled(claim: SampledClaim) -> Sampled:
    """Rounded so that less is promised; period and delay are the decimals that were asked for, where they are ones."""
    return Sampled(
        period=_shown_amount(claim.period),
        delay=_shown_amount(claim.start_up.delay) if claim.start_up else 0.0,
        level=float_below(claim.start_up.level) if claim.start_up else 1.0,
        order=claim.order,
        decrease=float_below(claim.decrease),
        inputs=tuple(tuple(map(float, choice)) for choice in claim.choices),
        bends=tuple(-float_below(-bend) for bend in claim.bends),
        start=claim.start_up.choice if claim.start_up else 0,
    )


def _shown_amount(value: fmpq) -> float:
    decimal = int(value.p) / int(value.q)
    return decimal if rational(decimal) == value else float_below(value)


def held_to(result: Result, period: float | None, delay: float | None, why: str = "") -> Result:
    """The result, as it is where it proves the period and the delay (s) that are asked of it; else `inconclusive`.

    `why` says in one line what stands in the way.
    """
    if result.verdict is not Verdict.CERTIFIED or period is None or _is_met(result.robustness, period, delay or 0.0):
        return result
    required = f"period={period:g}" + (f" with delay={delay:g}" if delay else "")
    every = result.robustness.alone.period if result.robustness else 0.0
    reached = f"proven of every law: {rounded_down(every, 3, MILLI)} ms" if every else "no control period is proven"
    message = (
        f"the funnel is proven, with margin {margin_text(result.margin_certified)} 1/s, but not {required} "
        f"({why or 'no proof was found'}); {reached}; a shorter period may be proven"
    )
    return result.without_claim(Verdict.INCONCLUSIVE, message).replace(robustness=None, closed_loop=None)


def _is_met(robustness: Robustness | None, period: float, delay: float) -> bool:
    sampled = robustness and robustness.sampled
    return bool(sampled and sampled.period >= period and sampled.delay >= delay)
