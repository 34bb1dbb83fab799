"""A piece inside bounds, cut, and moved along: at the very edge of what is true, or against an integral in balls."""

import itertools
import math
import random

import pytest
from flint import acb, arb, arb_poly, fmpq, fmpq_poly

from cfcheck.exact.polynomial import bernstein
from cfcheck.exact.rational import rational
from tests.by_hand import ONE, TINY, ZERO, bounds, piece


# --- bounds


def test_a_bound_may_be_touched_and_not_crossed() -> None:
    speed = ("1", "0.3", "-0.2")
    for sign in (1, -1):
        at = tuple(sign * rational(c) for c in speed)
        assert piece(at, speed).inside(bounds())  # κ = ±1 all along
        above = tuple(c * (1 + TINY) for c in at)
        assert not piece(above, speed).inside(bounds())
    assert piece((0,), ("1.5", "0.5")).inside(bounds())  # speed 2 at the end
    assert not piece((0,), (fmpq(3, 2) + TINY, "0.5")).inside(bounds())
    assert not piece((0,), (fmpq(3, 2) - TINY, "-1")).inside(bounds())
    assert piece((0,), ("1.25", "-1", "0.5")).inside(bounds())  # slope −1 at the start
    assert not piece((0,), ("1.25", -1 - TINY, "0.5")).inside(bounds())
    # curvature 1 at the top of a hump inside
    assert piece(("0.75", 1, -1), (1,)).inside(bounds())
    assert not piece((fmpq(3, 4) + TINY, 1, -1), (1,)).inside(bounds())


def test_a_spike_between_the_samples_is_seen() -> None:
    # at 0, 1/2 and 1 exactly on the bound, above it between the first two by 5e-14
    spike = fmpq_poly([0, 1]) * fmpq_poly([fmpq(-1, 2), 1]) * fmpq_poly([-1, 1]) * TINY
    for sign in (1, -1):
        coefficients = tuple((1 + sign * spike).coeffs())
        assert not piece(coefficients, (1,)).inside(bounds())


def test_curvature_is_bounded_where_speed_dips() -> None:
    # Bernstein coefficients of the speed reach below zero, the speed does not: 1/2 at least
    dipping = piece((0,), (fmpq(1, 2) + fmpq(1), -4, 4))
    assert min(bernstein(dipping.speed, ONE)) < 0
    loose = bounds(acceleration=(fmpq(-4), fmpq(4)))
    assert dipping.inside(loose)
    assert not piece((fmpq(1, 2) + TINY,), dipping.speed).inside(loose)
    assert piece((fmpq(1, 2),), dipping.speed).inside(loose)
    assert not piece((0,), (1, -4, 4)).inside(loose)  # stands still in the middle
    assert not piece((0,), (-1,)).inside(loose)


def test_parts_of_a_piece_are_the_piece() -> None:
    whole = piece(("0.1", "0.2", "-0.7", "0.3"), ("1", "0.2", "-0.1"), fmpq(3, 2))
    parts = list(whole.split([fmpq(1, 3), fmpq(1)]))
    assert sum((part.length for part in parts), ZERO) == whole.length
    assert sum((part.turn for part in parts), ZERO) == whole.turn
    for before, after in itertools.pairwise(parts):
        assert after.arc == before.arc + before.length and after.theta == before.theta + before.duration
        assert bernstein(before.speed, before.duration)[-1] == after.speed[0]
        assert bernstein(before.turn_rate, before.duration)[-1] == after.turn_rate[0]


# --- displacement


def test_displacement_encloses_the_integral() -> None:
    rng = random.Random(2)
    for scale in (1, 5, 20):
        for _ in range(5):
            duration = fmpq(rng.randint(1, 30), 20)
            turn_rate = tuple(fmpq(rng.randint(-9 * scale, 9 * scale), 4) for _ in range(4))
            speed = tuple(fmpq(rng.randint(1, 9), 4) for _ in range(3))
            angle, velocity = arb_poly(fmpq_poly([0, *turn_rate]).derivative().integral()), fmpq_poly(list(speed))
            angle = arb_poly(fmpq_poly([ZERO, *(c / (k + 1) for k, c in enumerate(turn_rate))]))

            def integrand(t: acb, _: object, angle: arb_poly = angle, velocity: fmpq_poly = velocity) -> acb:
                phase = sum((acb(c) * t**k for k, c in enumerate(angle.coeffs())), acb(0))
                return sum((acb(c) * t**k for k, c in enumerate(velocity.coeffs())), acb(0)) * (acb(0, 1) * phase).exp()

            reference = acb.integral(integrand, 0, acb(arb(duration)))
            found = piece(turn_rate, speed, duration).displacement
            assert found.contains(reference)
            assert float(abs(found - reference).upper()) < 1e-7


def test_arcs_are_integrated_in_closed_form() -> None:
    turning = piece((3,), (2,), fmpq(7))
    found = turning.displacement
    assert float(found.real) == pytest.approx(2 / 3 * math.sin(21))
    assert float(found.imag) == pytest.approx(2 / 3 * (1 - math.cos(21)))
    general = piece((3,), (2, fmpq(1, 10**30)), fmpq(7)).displacement
    assert float(abs(found - general).upper()) < 1e-7
