"""Exact statements about references, each against an independent oracle or at the very edge of what is true."""

import dataclasses
import itertools
import math
import random

import numpy as np
import pytest
from flint import acb, arb, arb_poly, fmpq, fmpq_poly
from scipy.integrate import solve_ivp

from cfjax.check.rational import rational
from cfjax.check.reference import (
    LAW_SHARE,
    CertifiedTube,
    Gap,
    Piece,
    Run,
    StatedProfile,
    StatedSegment,
    bernstein,
    exact_reference,
    hands_over,
    heading_gap,
    is_closed,
    is_nonnegative,
    needed_distance,
    prove_chain,
)
from cfjax.control import min_norm


ZERO, ONE = fmpq(0), fmpq(1)
TINY = fmpq(1, 10**12)


def tube(name: str = "wide", curvature: fmpq = ONE, scale: fmpq = ONE, **changes: object) -> CertifiedTube:
    """A tube that nobody certified: C is `scale` times a fixed matrix, the law lowers V by 1/2 per metre."""
    diagonal = (6, 5, 4, 7)
    shape = [[scale * (diagonal[i] if i == j else fmpq(1, 2)) for j in range(4)] for i in range(4)]
    entries: dict = {
        "name": name,
        "vehicle": "kinematic_bicycle",
        "parameters": {"wheelbase": fmpq(17, 50)},
        "method": "pf",
        "curvature": (-curvature, curvature),
        "speed": (fmpq(1, 2), fmpq(2)),
        "acceleration": (fmpq(-1), fmpq(1)),
        "shape": shape,
        "beta_lower": fmpq(1, 4),
        "beta_inner": fmpq(1, 100),
        "margin": ONE,
        "margin_per_metre": ONE / LAW_SHARE,
        "inputs": {"u0": (fmpq(1, 2), fmpq(2)), "w": (fmpq(-1), fmpq(1))},
    }
    return CertifiedTube(**(entries | changes))


def piece(turn_rate: tuple, speed: tuple, duration: fmpq = ONE) -> Piece:
    return Piece(0, ZERO, duration, tuple(map(rational, turn_rate)), tuple(map(rational, speed)), ZERO)


def stated(turn_rate: tuple, speed: tuple, start: tuple = (0, 0, 0), breaks: tuple = (0, 1)) -> StatedSegment:
    """Pieces of ascending coefficients, one tuple each."""
    grid = tuple(map(rational, breaks))
    profiles = (StatedProfile(grid, tuple(tuple(map(rational, p)) for p in pieces)) for pieces in (turn_rate, speed))
    alpha, x, y = map(rational, start)
    return StatedSegment(*profiles, (alpha, x, y))


# --- polynomials


def test_bernstein_coefficients_enclose_and_meet_the_ends() -> None:
    rng = random.Random(0)
    for _ in range(50):
        coefficients = [fmpq(rng.randint(-9, 9), rng.randint(1, 9)) for _ in range(rng.randint(1, 6))]
        length = fmpq(rng.randint(1, 9), rng.randint(1, 9))
        for degree in (0, 7):
            control = bernstein(coefficients, length, degree)
            values = [fmpq_poly(coefficients)(length * fmpq(k, 20)) for k in range(21)]
            assert control[0] == values[0] and control[-1] == values[-1]
            assert min(control) <= min(values) and max(values) <= max(control)


@pytest.mark.parametrize(
    "coefficients",
    [
        fmpq_poly([fmpq(-1, 2), 0, 1]) ** 2,  # touches zero at an irrational place
        fmpq_poly([fmpq(-1, 3), 1]) ** 2 * fmpq_poly([fmpq(-2, 3), 1]) ** 2,
        fmpq_poly([0, 1]) * fmpq_poly([1, -1]),  # zero at both ends
        fmpq_poly([0, 0, 1]) * fmpq_poly([fmpq(-1, 3), 1]) ** 4 * fmpq_poly([1, -1]) ** 3,
    ],
)
def test_a_polynomial_that_touches_zero_is_told_from_one_below(coefficients: fmpq_poly) -> None:
    assert is_nonnegative(coefficients.coeffs(), ONE)
    assert not is_nonnegative((coefficients - fmpq(1, 10**40)).coeffs(), ONE)
    assert not is_nonnegative((-coefficients).coeffs(), ONE)
    assert not is_nonnegative((coefficients * fmpq_poly([fmpq(-1, 5), 1])).coeffs(), ONE)


def test_zero_is_nonnegative() -> None:
    assert is_nonnegative([ZERO, ZERO], ONE)
    assert is_nonnegative([ZERO], ONE)


def test_signs_agree_with_the_roots() -> None:
    rng = random.Random(1)
    seen = {True: 0, False: 0}
    for _ in range(400):
        length = fmpq(rng.randint(1, 5), rng.randint(1, 5))
        roots = [fmpq(rng.randint(-4, 12), 8) * length for _ in range(rng.randint(0, 3))]
        polynomial = fmpq_poly([rng.choice((-1, 1, 2))]) * fmpq_poly([fmpq(rng.randint(1, 3)), 0, 1])
        for root in roots:
            polynomial *= fmpq_poly([-root, 1]) ** rng.choice((1, 1, 2))
        # between all roots and the ends there is a point
        marks = sorted({ZERO, length, *(root for root in roots if 0 < root < length)})
        probes = [*marks, *((a + b) / 2 for a, b in itertools.pairwise(marks))]
        expected = all(polynomial(probe) >= 0 for probe in probes)
        assert is_nonnegative(polynomial.coeffs(), length) == expected
        seen[expected] += 1
    assert min(seen.values()) > 50


# --- bounds


def test_a_bound_may_be_touched_and_not_crossed() -> None:
    speed = ("1", "0.3", "-0.2")
    for sign in (1, -1):
        at = tuple(sign * rational(c) for c in speed)
        assert piece(at, speed).inside(tube())  # κ = ±1 all along
        above = tuple(c * (1 + TINY) for c in at)
        assert not piece(above, speed).inside(tube())
    assert piece((0,), ("1.5", "0.5")).inside(tube())  # speed 2 at the end
    assert not piece((0,), (fmpq(3, 2) + TINY, "0.5")).inside(tube())
    assert not piece((0,), (fmpq(3, 2) - TINY, "-1")).inside(tube())
    assert piece((0,), ("1.25", "-1", "0.5")).inside(tube())  # slope −1 at the start
    assert not piece((0,), ("1.25", -1 - TINY, "0.5")).inside(tube())
    # curvature 1 at the top of a hump inside
    assert piece(("0.75", 1, -1), (1,)).inside(tube())
    assert not piece((fmpq(3, 4) + TINY, 1, -1), (1,)).inside(tube())


def test_a_spike_between_the_samples_is_seen() -> None:
    # at 0, 1/2 and 1 exactly on the bound, above it between the first two by 5e-14
    spike = fmpq_poly([0, 1]) * fmpq_poly([fmpq(-1, 2), 1]) * fmpq_poly([-1, 1]) * TINY
    for sign in (1, -1):
        coefficients = tuple((1 + sign * spike).coeffs())
        crossing = piece(coefficients, (1,))
        assert not crossing.inside(tube())
        (violation,) = crossing.violations(tube())
        assert violation.quantity == "curvature"
        assert 4 * TINY / 100 < violation.excess < TINY / 10
        assert float(violation.theta) == pytest.approx(0.5 - sign * math.sqrt(1 / 12), abs=1e-9)


def test_curvature_is_bounded_where_speed_dips() -> None:
    # Bernstein coefficients of the speed reach below zero, the speed does not: 1/2 at least
    dipping = piece((0,), (fmpq(1, 2) + fmpq(1), -4, 4))
    assert min(bernstein(dipping.speed, ONE)) < 0
    loose = tube(acceleration=(fmpq(-4), fmpq(4)))
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


# --- poses and jumps


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


def test_headings_are_compared_modulo_full_turns() -> None:
    assert heading_gap(rational(math.pi), rational(-math.pi)) < fmpq(1, 10**15)
    assert float(heading_gap(rational(2000 * math.pi + 0.25), ZERO)) == pytest.approx(0.25)
    assert float(heading_gap(rational(-0.25), rational(4 * math.pi))) == pytest.approx(0.25)
    assert heading_gap(fmpq(1), fmpq(1)) < fmpq(1, 10**30)


LONG_AXES = (fmpq(1, 10**4), ONE, fmpq(1, 100), fmpq(1, 100))  # 10 m forward, little weight on the heading
LONG = [[axis if i == j else ZERO for j in range(4)] for i, axis in enumerate(LONG_AXES)]


@pytest.mark.parametrize(
    ("changes", "gap", "tightness"),
    [
        ({}, Gap(fmpq(3, 100), fmpq(1, 100), fmpq(2, 100), fmpq(1, 100)), 0.3),
        ({"shape": LONG}, Gap(fmpq(1, 100), ZERO, ZERO, ZERO), 0.03),  # what is far away swings far
    ],
)
def test_no_deviation_jumps_further_than_the_bound(changes: dict, gap: Gap, tightness: float) -> None:
    rng = np.random.default_rng(0)
    own = tube(**changes)
    shape = np.array([[float(entry) for entry in row] for row in own.shape])
    root = np.linalg.inv(np.linalg.cholesky(shape)).T
    bound, worst = float(gap.jump(own.shape, own.inverse)), 0.0
    for _ in range(2000):
        x = root @ (lambda d: d / np.linalg.norm(d))(rng.normal(size=4))
        delta, lateral, forward, speed = rng.choice([-1, 1], 4) * np.array([float(part) for part in gap])
        turn = np.array([[math.cos(delta), -math.sin(delta)], [math.sin(delta), math.cos(delta)]])
        after = np.array([x[0] + delta, *(turn @ x[1:3] + [lateral, forward]), x[3] + speed])
        worst = max(worst, abs(math.sqrt(after @ shape @ after) - 1))
    assert tightness * bound < worst <= bound


def test_a_lap_is_closed_by_pose_and_speed() -> None:
    limits = Gap(fmpq(1, 10**6), fmpq(1, 10**6), fmpq(1, 10**6), fmpq(1, 10**9))
    assert is_closed(limits)
    for k in range(4):
        assert not is_closed(Gap(*(part * (1 + TINY * (i == k)) for i, part in enumerate(limits))))


def test_lap_gap_is_in_the_body_frame_of_the_start() -> None:
    for heading in (0.3, math.pi / 2):  # one metre forward
        gap = exact_reference([stated(((0,),), ((1,),), start=(heading, 5, 6))]).gap
        assert gap.lateral < fmpq(1, 10**15) and float(gap.forward) == pytest.approx(1)
    reference = exact_reference([stated(((0,),), ((1,),), start=(math.pi / 2, 5, 6))])
    end = reference.poses[-1].position
    assert float(end.real) == pytest.approx(4) and float(end.imag) == pytest.approx(6)


# --- what a path states


def test_speeds_are_continued_exactly() -> None:
    segment = stated(((0,), (0,)), ((1, "0.1"), ("1.1000000001", "0.1")), breaks=(0, 1, 2))
    reference = exact_reference([segment])
    assert reference.pieces[1].speed == (fmpq(11, 10), fmpq(1, 10))
    assert reference.length == fmpq(11, 5)
    jump = stated(((0,), (0,)), ((1, "0.1"), ("1.100000002", "0.1")), breaks=(0, 1, 2))
    with pytest.raises(ValueError, match=r"speed jumps by 2e-09 m/s at theta = 1 s of segment 0"):
        exact_reference([jump])
    with pytest.raises(ValueError, match=r"speed jumps by 1 m/s at theta = 0 s of segment 1, from 1 to 2"):
        exact_reference([stated(((0,),), ((1,),)), stated(((0,),), ((2,),), start=(0, 0, 1))])


def test_segments_have_to_meet() -> None:
    first = stated(((0,),), ((1,),))
    exact_reference([first, stated(((0,),), ((1,),), start=("5e-7", "5e-7", 1))])
    exact_reference([first, stated(((0,),), ((1,),), start=(2 * math.pi, 0, 1))])
    with pytest.raises(ValueError, match=r"heading jumps by .* rad between segments 0 and 1"):
        exact_reference([first, stated(((0,),), ((1,),), start=("2e-6", 0, 1))])
    with pytest.raises(ValueError, match=r"segment 1 starts 0.00000200\d* m away from where segment 0 ends"):
        exact_reference([first, stated(((0,),), ((1,),), start=(0, "2e-6", 1))])


def test_profiles_with_different_breaks_are_merged() -> None:
    turn_rate = StatedProfile((ZERO, fmpq(1, 3), fmpq(2)), ((fmpq(1), fmpq(2)), (fmpq(5), fmpq(-1))))
    speed = StatedProfile((ZERO, fmpq(1), fmpq(2)), ((fmpq(1), fmpq(1, 2)), (fmpq(3, 2), ZERO, fmpq(1))))
    reference = exact_reference([StatedSegment(turn_rate, speed, (ZERO, ZERO, ZERO))])
    assert [p.theta for p in reference.pieces] == [ZERO, fmpq(1, 3), fmpq(1)]
    assert reference.pieces[1].turn_rate == (fmpq(5), fmpq(-1))
    assert reference.pieces[2].turn_rate == (fmpq(13, 3), fmpq(-1))
    assert reference.pieces[1].speed == (fmpq(7, 6), fmpq(1, 2))
    assert reference.pieces[2].speed == (fmpq(3, 2), ZERO, ONE)
    assert reference.length == fmpq(5, 4) + fmpq(3, 2) + fmpq(1, 3)


# --- contraction and links


def test_level_is_what_the_slowest_descent_leaves() -> None:
    own = tube(margin_per_metre=fmpq(3, 2))
    beta, rate = 0.25, min_norm.LAW_SHARE * 1.5 / 2  # what the run-time law enforces, at the fastest timing
    flow = solve_ivp(
        lambda _, v: -rate * np.minimum(1, v / beta), (0, 3), [1.0], rtol=1e-10, atol=1e-12, dense_output=True
    )
    for distance in np.linspace(0, 2, 21):
        level = own.level_after(rational(float(distance)))
        assert float(level) == pytest.approx(float(flow.sol(distance)[0]), rel=1e-6)
        back = own.distance_to(level)
        assert back is not None and float(back) == pytest.approx(float(distance), abs=1e-12)
    assert own.level_after(fmpq(10**9)) == own.beta_inner
    assert own.distance_to(fmpq(1)) == own.distance_to(fmpq(3)) == 0
    assert own.distance_to(own.beta_inner) is not None
    assert own.distance_to(own.beta_inner - TINY) is None


def test_handing_over_is_decided_exactly() -> None:
    wide, narrow = tube(), tube("narrow", scale=fmpq(2))
    assert hands_over(wide, narrow, fmpq(1, 2) - TINY)
    assert not hands_over(wide, narrow, fmpq(1, 2))
    assert hands_over(narrow, wide, fmpq(2) - TINY)
    found = needed_distance(wide, narrow, fmpq(1, 2) - TINY)
    assert found is not None and found[0] == fmpq(1, 2) - TINY and found[1] == 2 * (fmpq(1, 2) + TINY)
    assert needed_distance(narrow, wide, fmpq(3, 2)) == (ONE, ZERO)
    assert needed_distance(wide, narrow, fmpq(1, 2)) is None
    assert needed_distance(wide, tube(scale=fmpq(101)), fmpq(1, 102)) is None  # below beta_inner
    # over a jump the level shrinks with (1 − jump)²
    gap = Gap(ZERO, ZERO, ZERO, fmpq(1, 10))
    over = needed_distance(wide, narrow, fmpq(1, 3), gap)
    assert over is not None and over[0] == fmpq(1, 3) * (1 - gap.jump(narrow.shape, narrow.inverse)) ** 2
    assert needed_distance(wide, narrow, fmpq(1, 3), Gap(ZERO, ZERO, ZERO, ONE)) is None


def test_a_chain_is_proven_link_by_link() -> None:
    wide, narrow = tube(), tube("narrow", scale=fmpq(2), curvature=fmpq(1, 2))
    level = fmpq(1, 2) - TINY
    needed = 1 + 2 * TINY

    def reference(length: fmpq) -> object:
        return exact_reference([stated(((1,), (0,)), ((1,), (1,)), breaks=(0, length, 3))])

    runs = [Run(0, 1, wide), Run(1, 2, narrow)]
    (link,) = prove_chain(reference(needed), runs, [level], False)
    assert link.available == link.needed == needed
    with pytest.raises(ValueError, match="tube wide does not hand over to tube narrow"):
        prove_chain(reference(needed - TINY), runs, [level], False)
    with pytest.raises(ValueError, match="does not hand over"):
        prove_chain(reference(needed), runs, [fmpq(1, 2)], False)
    with pytest.raises(ValueError, match=r"segment 0 at theta = 0 s leaves tube narrow"):
        prove_chain(reference(needed), [Run(0, 2, narrow)], [], False)
    for broken in ([Run(0, 1, wide)], [Run(1, 2, wide)], [Run(0, 1, wide), Run(0, 2, wide)]):
        with pytest.raises(ValueError, match="follow each other"):
            prove_chain(reference(needed), broken, [level] * (len(broken) - 1), False)
    with pytest.raises(ValueError, match="expected 1 levels"):
        prove_chain(reference(needed), runs, [], False)
    with pytest.raises(ValueError, match="does not hand over"):  # the end is nowhere near the start
        prove_chain(reference(needed), runs, [level, ONE], True)
    other = dataclasses.replace(narrow, parameters={"wheelbase": ONE})
    with pytest.raises(ValueError, match="one vehicle"):
        prove_chain(reference(needed), [Run(0, 1, wide), Run(1, 2, other)], [level], False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"acceleration": (ONE, -ONE)}, "interval of acceleration"),
        ({"speed": (ZERO, ONE)}, "speeds above zero"),
        ({"shape": [[ONE] * 4] * 4}, "positive definite"),
        ({"shape": [[ONE]]}, "positive definite"),
        ({"beta_inner": fmpq(1, 2)}, "beta_inner"),
        ({"margin_per_metre": ZERO}, "positive margin"),
        ({"inputs": {"w": (ONE, ONE)}}, "u0"),
        ({"inputs": {"u0": (ZERO, ONE)}}, "u0"),
    ],
)
def test_numbers_of_no_tube_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        tube(**changes)
