"""The largest amounts that proven bounds allow (`cfcheck.robustness.amounts`); the checker verifies them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from flint import fmpq

from cfcheck.exact.rational import float_below
from cfcheck.robustness.amounts import MOST, AbsorbedClaim, BoundsOver, Keeps, Rates, Stated, least_level


PERIOD, DISTURBANCE, POSE, DELAY = (fmpq(part, 10) for part in (4, 2, 2, 2))  # of λ', where all come together
HALVINGS = 16


def largest_amounts(bounds: BoundsOver) -> Stated:
    """Each by itself, then all together in the shares above.

    Raises:
        ValueError: nothing can be absorbed.
    """
    if any(one.decrease <= 0 for one in bounds.rates):
        raise ValueError("robustness: the reference jumps by more than the margin makes up for")
    alone = _each_alone(bounds.rates, bounds.keeps)
    if not alone.period:
        raise ValueError("robustness: V has no room to rise while inputs are held")
    count = len(alone.disturbance)
    wanted = AbsorbedClaim(
        period=PERIOD * alone.period,
        disturbance=tuple(DISTURBANCE * value / count for value in alone.disturbance),
        pose_error=tuple(POSE * value / count for value in alone.pose_error),
        delay=DELAY * alone.delay,
    )
    by_band = (_each_alone((one,), partial(least_level, (one,))) for one in bounds.rates if bounds.bands)
    # errors of the pose are those of all bands, whose level is told
    by_speed = tuple(replace(own, pose_error=alone.pose_error) for own in by_band)
    return Stated(alone, _largest(bounds.keeps, wanted), by_speed)


def _each_alone(rates: Sequence[Rates], keeps: Keeps) -> AbsorbedClaim:
    states = range(len(rates[0].slopes))
    rising = [min(_quotient(1 - one.inner, one.rise), one.horizon) for one in rates]
    wanted = AbsorbedClaim(
        period=min(*rising, *(_quotient(2 * one.decrease, one.bend) for one in rates)),
        disturbance=tuple(min(_quotient(one.decrease, one.gradient[i]) for one in rates) for i in states),
        pose_error=tuple(min(_quotient(one.decrease, one.slopes[i]) for one in rates) for i in states),
        delay=min(*rising, *(_quotient(one.decrease, one.staleness) for one in rates)),
    )

    def by_state(name: str) -> tuple[fmpq, ...]:
        return tuple(getattr(_largest(keeps, wanted.alone(name, i)), name)[i] for i in states)

    return AbsorbedClaim(
        period=_largest(keeps, wanted.alone("period")).period,
        disturbance=by_state("disturbance"),
        pose_error=by_state("pose_error"),
        delay=_largest(keeps, wanted.alone("delay")).delay,
    )


def _quotient(amount: fmpq, bound: fmpq) -> fmpq:
    """Never more than a number without meaning: what has no bound is never used up."""
    return min(amount / bound, MOST) if bound else MOST


def _largest(keeps: Keeps, wanted: AbsorbedClaim) -> AbsorbedClaim:
    """The wanted amounts, or a large part of them that is absorbed; floating-point numbers."""
    best, factor, step = wanted.scaled(fmpq(0)), fmpq(1), fmpq(1)
    for _ in range(HALVINGS):
        tried = _rounded(wanted.scaled(factor))
        is_kept = keeps(tried) is not None
        if is_kept:
            best = tried
            if factor == 1:
                break
        step /= 2
        factor += step if is_kept else -step
    return best


def _rounded(amounts: AbsorbedClaim) -> AbsorbedClaim:
    def down(value: fmpq) -> fmpq:
        return fmpq(*float_below(value).as_integer_ratio())  # its decimal may be above it

    return AbsorbedClaim(
        down(amounts.period),
        tuple(map(down, amounts.disturbance)),
        tuple(map(down, amounts.pose_error)),
        down(amounts.delay),
    )


def write_amounts(stated: Stated) -> dict[str, Any]:
    """As the checker reads them."""
    return {
        "alone": _written(stated.alone),
        "together": _written(stated.together),
        "by_speed": [_written(own) for own in stated.by_speed],
    }


def _written(amounts: AbsorbedClaim) -> dict[str, Any]:
    return {
        "period": str(amounts.period),
        "disturbance": [str(value) for value in amounts.disturbance],
        "pose_error": [str(value) for value in amounts.pose_error],
        "delay": str(amounts.delay),
    }
