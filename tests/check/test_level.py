"""The exact templates of V against those in floating point: levels, derivatives, and what stays between them."""

import math
from itertools import product

import numpy as np
import pytest
from flint import arb, fmpq

from cfcheck.exact.rational import rational
from cfcheck.kernel.level import LEVELS
from cfjax.funnel import TEMPLATES, Template


CASES = list(product(LEVELS, ("1/5", "0", "-1/4"), ("0", "1/3", "2")))


def test_there_are_as_many_as_in_floating_point() -> None:
    assert LEVELS.keys() == TEMPLATES.keys()
    assert {name: level.rate_name for name, level in LEVELS.items()} == {
        name: template.rate_name for name, template in TEMPLATES.items()
    }


@pytest.mark.parametrize(("name", "rate", "theta"), CASES)
def test_levels_are_those_of_the_template(name: str, rate: str, theta: str) -> None:
    level, template, at = LEVELS[name](rational(rate)), TEMPLATES[name], rational(theta)
    k, t = float(level.rate), float(at)
    low, high = map(float, level.bounds(at))
    assert low == pytest.approx(float(template.level(k, t)), abs=1e-12) and low <= high <= low + 1e-12
    for value in (0.3, 1.0):  # V = value at the q between
        for form in map(float, level.form_bounds(rational(value), at)):
            assert float(template.value(k, t, form)) == pytest.approx(value, abs=1e-12)
    constant, slope = (float(level.series(arb(at), 2)[i].mid()) for i in range(2))
    step = 1e-6
    assert constant == pytest.approx(low, abs=1e-12)
    assert slope == pytest.approx(
        (float(template.level(k, t + step)) - float(template.level(k, t - step))) / (2 * step), abs=1e-8
    )


@pytest.mark.parametrize(("name", "rate", "theta"), CASES)
def test_the_rate_of_v_is_the_chain_rule(name: str, rate: str, theta: str) -> None:
    level, template = LEVELS[name](rational(rate)), TEMPLATES[name]
    k, t, q, form_rate, u0 = float(level.rate), float(rational(theta)), 0.7, -0.4, 1.25
    found = level.value_rate(rational(theta), rational(q), arb(rational(form_rate)), rational(u0))
    step = 1e-6
    ahead, behind = (float(template.value(k, t + h * u0, q + h * form_rate)) for h in (step, -step))
    assert float(found.mid()) == pytest.approx((ahead - behind) / (2 * step), abs=1e-8)


@pytest.mark.parametrize("name", LEVELS)
def test_a_deviation_changes_v_by_no_more_than_its_scale_says(name: str) -> None:
    """√(q or q/ρ) is a norm of x: the root of the scale times that of C bounds what a step does to it."""
    span = fmpq(0), fmpq(3)
    level, template = LEVELS[name](fmpq(1, 5)), TEMPLATES[name]
    root, scale = map(float, level.deviation_scale(*level.extent(span)))
    for t in np.linspace(0.0, 3.0, 31):
        largest = float(template.level(0.2, t))
        # V − V(0) is what the deviation makes of it
        part = float(template.value(0.2, t, largest)) - float(template.value(0.2, t, 0.0))
        assert math.sqrt(part) <= root + 1e-9
        assert part <= scale * largest + 1e-9


def _at(template: Template, k: float, t: float, q: float) -> tuple[float, float, float]:
    """V, σ = ∂V/∂q and ∂V/∂θ by differences."""
    step = 1e-6
    value = [
        float(template.value(k, a, b)) for a, b in ((t, q), (t, q + step), (t, q - step), (t + step, q), (t - step, q))
    ]
    return value[0], (value[1] - value[2]) / (2 * step), (value[3] - value[4]) / (2 * step)


@pytest.mark.parametrize(("name", "rate"), list(product(LEVELS, ("1/20", "0", "-1/20"))))
def test_ranges_of_q_cover_the_funnel_and_ask_for_enough_at_every_theta(name: str, rate: str) -> None:
    """On the shell at least min(1, V/β̲)/σ is asked, wherever in the stretch; inside no more than 1/σ is counted on."""
    level, template, span = LEVELS[name](rational(rate)), TEMPLATES[name], (fmpq(0), fmpq(3))
    beta_lower, beta_inner = 0.8, 0.5
    shell, inside = level.shell(span, rational(beta_lower), rational(beta_inner)), level.inside(span)
    k, seen = float(level.rate), 0
    for t in np.linspace(0.0, 3.0, 13):
        for q in np.linspace(1e-3, 1.3, 131):
            value, sigma, by_theta = _at(template, k, t, q)
            if value > 1:
                continue
            own = [piece for piece in inside if piece.lower <= rational(q) <= piece.upper]
            asked = [piece for piece in shell if piece.lower <= rational(q) <= piece.upper]
            assert own and (asked or value < beta_inner)
            seen += 1
            for piece in [*own, *asked]:
                constant, slope = map(float, piece.timing)
                assert sigma * (constant + slope * q) == pytest.approx(by_theta, abs=1e-6)
            for piece in own:
                constant, slope = map(float, piece.weight)
                assert constant + slope * q <= 1 / sigma + 1e-6
            for piece in asked:
                constant, slope = map(float, piece.weight)
                assert constant + slope * q >= min(1.0, value / beta_lower) / sigma - 1e-6
    assert seen > 1000
