"""A course made by hand, its funnels those of a tube that holds it: two kinds of segments, lap after lap, obstacles.

A straight of 0.8 s and half a turn in two pieces: at 1.49 m/s the curvature grows from 0.4 to 1.2 1/m, then at 1.2 1/m
the speed grows to the straight's. Two of both are a lap. Where the bend starts the reference gets slower by 0.011 m/s.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from flint import fmpq

from cfcheck.claims.hints import MOST_GRAM_ENTRIES
from cfcheck.exact.rational import rational
from cfcheck.path.bounds import Bounds
from cfjax.certificate.certifier import _prove_sets, statement_of
from cfjax.certificate.prover import Means, Prover
from cfjax.certificate.rounding import RoundedFunnel, round_funnel
from cfjax.certificate.stretches import ThetaInterval
from cfjax.certificate.writing import seal, write_decrease, write_funnel
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Box, Method, Path, Pose, Problem, Profile, Segment, ball
from cfjax.problem.obstacles import Disc, FootprintDisc, Polygon
from cfjax.solver import DEFAULT, solver_named


SHAPE = np.array([[23.16, -11.77, 0, 0], [-11.77, 36.3, 0, 0], [0, 0, 36.96, 12.5], [0, 0, 12.5, 23.47]])
SLOW, GROWTH = 1.49, 0.01  # m/s, m/s²
LOWEST, HIGHEST, ENTRY = 0.4, 1.2, 1.0  # curvatures, 1/m; s
REST = (
    math.pi - SLOW * (LOWEST + HIGHEST) / 2 * ENTRY
) / HIGHEST  # metres of the bend's second piece: of π what is left
LAST = (-SLOW + math.sqrt(SLOW**2 + 2 * GROWTH * REST)) / GROWTH  # its seconds
FAST = SLOW + GROWTH * LAST  # m/s
RATE = 0.25  # of the straight's funnel, 1/s: it gets narrower, the bend's is as wide all along
ENDS = (fmpq(1, 2), fmpq(1))  # of the bend's stretches; the last one ends with it


def straight_part() -> Segment:
    return Segment(Profile.constant(0.0, 0.8), Profile.constant(FAST, 0.8), Pose(0.0, 0.0, 0.0))


def bend(start: Pose = Pose(0.0, 0.0, 0.0)) -> Segment:
    """Half a turn."""
    breaks = (0.0, ENTRY, ENTRY + LAST)
    first = (SLOW * LOWEST, SLOW * (HIGHEST - LOWEST) / ENTRY)
    omega = Profile(breaks, (first, (HIGHEST * SLOW, HIGHEST * GROWTH)))
    return Segment(omega, Profile(breaks, ((SLOW,), (SLOW, GROWTH))), start)


def lap() -> Path:
    """Straight, bend, straight, bend; every segment starts where the one before ends."""
    pose, found = Pose(0.0, 0.0, 0.0), []
    for part in (straight_part(), bend(), straight_part(), bend()):
        found.append(Segment(part.turn_rate, part.speed, pose))
        pose = Pose(*map(float, found[-1].poses(np.array([part.duration]))[0]))
    return Path("lap", tuple(found))


def lap_problem() -> Problem:
    return Problem(
        lap(),
        inlet=ball(0.14),
        goal=ball(0.26),
        safe=Box((1.0, 1.0, 1.0, 1.0)),
        obstacles=(Disc(-0.9, 0.6, 0.1), Polygon(((1.0, 0.0), (1.3, 0.0), (1.2, 1.0)))),
        footprint=(FootprintDisc(0.2, 0.0), FootprintDisc(0.15, 0.2)),
        method=Method.TT,
    )


def lap_document() -> dict[str, Any]:
    """Its certificate: one stretch of the straight, three of the bend with the bounds that they need and no wider."""
    problem = lap_problem()
    straight, curve = problem.path.distinct
    duration, half = straight.duration, rational(curve.duration)
    zero, slow, highest = fmpq(0), fmpq(149, 100), fmpq(12, 10)
    middle = fmpq(8, 10)
    last = slow + fmpq(1, 100) * (half - 1)  # the reference's own speed at the end, in exact numbers

    def steady(value: fmpq) -> tuple[fmpq, fmpq]:
        return value, value

    stretches = (
        [ThetaInterval(zero, rational(duration), Bounds(steady(zero), steady(rational(FAST)), steady(zero)))],
        [
            ThetaInterval(zero, ENDS[0], Bounds((fmpq(4, 10), middle), steady(slow), steady(zero))),
            ThetaInterval(ENDS[0], ENDS[1], Bounds((middle, highest), steady(slow), steady(zero))),
            ThetaInterval(ENDS[1], half, Bounds(steady(highest), (slow, last), steady(fmpq(1, 100)))),
        ],
    )
    template = template_named("contracting")
    funnels = [
        round_funnel(Funnel(template, SHAPE, RATE, straight.duration), straight),
        round_funnel(Funnel(template, 1.02 * SHAPE, 0.0, curve.duration), curve),
    ]
    return assembled(problem, funnels, stretches)


def kink_document() -> dict[str, Any]:
    """A straight and an arc in one segment, a stretch for each: of one reference both."""
    breaks = (0.0, 0.25, 0.5)
    segment = Segment(Profile(breaks, ((0.0,), (1.5,))), Profile(breaks, ((1.5,), (1.5,))), Pose(0.0, 0.0, 0.0))
    problem = Problem(Path("kink", (segment,)), inlet=ball(0.14), goal=ball(0.26), method=Method.TT)
    funnel = round_funnel(Funnel(template_named("contracting"), SHAPE, 0.0, segment.duration), segment)
    zero, speed = fmpq(0), fmpq(3, 2)
    bounds = (Bounds((kappa, kappa), (speed, speed), (zero, zero)) for kappa in (zero, fmpq(1)))
    ends = (zero, fmpq(1, 4), fmpq(1, 2))
    stretches = [ThetaInterval(begin, end, own) for begin, end, own in zip(ends, ends[1:], bounds, strict=False)]
    return assembled(problem, [funnel], [stretches])


def assembled(
    problem: Problem, funnels: Sequence[RoundedFunnel], stretches: Sequence[Sequence[ThetaInterval]]
) -> dict[str, Any]:
    """The certificate with these stretches, one list for each kind of segment."""
    statement = statement_of(problem)
    ratios, clearance = _prove_sets(problem, statement, funnels)
    found, means = [], Means(solver_named(DEFAULT, 2), {"sos": 0.0, "exact": 0.0})
    for kind, (funnel, own) in enumerate(zip(funnels, stretches, strict=True)):
        prover = Prover(problem, funnel, statement.claim, kind, MOST_GRAM_ENTRIES, means)
        found.append([prover.prove(stretch, 0.0) for stretch in own])
    written = [
        write_funnel(funnel.claim(min(proof.margin for proof in own)))
        for funnel, own in zip(funnels, found, strict=True)
    ]
    decrease = [write_decrease(own[0].degrees, None, [proof.hints for proof in own]) for own in found]
    hints = {"decrease": decrease, "clearance": clearance}
    return seal("funnel", statement.written, written, hints, statement.legs, ratios)
