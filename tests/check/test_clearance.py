"""Clearance from obstacles: against sampling of what the body sweeps, at the edge of what is true, and attacked."""

import functools
import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from flint import acb, arb, fmpq

from cfcheck.clearance.half_plane import FootprintClaim, ObstacleClaim, Shadow
from cfcheck.clearance.surroundings import ClearStretch, SurroundingsClaim, prove_surroundings
from cfcheck.exact.rational import rational
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.legs import Leg
from cfcheck.kernel.level import LEVELS, Contracting, Level, Paper
from cfcheck.path.piece import Piece, between
from cfcheck.path.reference import ExactPose, Reference
from cfjax.certificate.clearance import NotClear, find_clearance
from cfjax.exact import StatedProfile, StatedSegment, exact_reference
from cfjax.funnel import template_named
from cfjax.problem import Segment, obstacle_path
from cfjax.problem.named_curves import figure_eight
from cfjax.problem.obstacles import Disc, FootprintDisc, Polygon, disc_centres, distances
from cfjax.problem.path import Pose, Profile


ZERO, ONE = fmpq(0), fmpq(1)
NEAR = 0.98  # of the clearance that sampling finds: so much has to be proven


def exactly(numbers: Sequence[float]) -> tuple[fmpq, ...]:
    return tuple(rational(float(number)) for number in numbers)


class Claim(NamedTuple):
    """What `prove_surroundings` is about, of one leg, disc and obstacle."""

    pieces: tuple[Piece, ...]
    start: ExactPose
    shape: list[list[fmpq]]
    level: Level
    obstacle: ObstacleClaim
    disc: FootprintClaim
    stretches: Sequence[ClearStretch] = ()

    def grown(self, by: float) -> "Claim":
        obstacle = replace(self.obstacle, round=self.obstacle.round + rational(by))
        return self._replace(obstacle=obstacle)

    @property
    def leg(self) -> Leg:
        funnel = FunnelClaim(self.level, self.shape, fmpq(1, 2), fmpq(1, 2), ONE, None)
        return Leg(Reference(self.pieces, self.start), 0, len(self.pieces), funnel)

    @property
    def surroundings(self) -> SurroundingsClaim:
        return SurroundingsClaim((self.obstacle,), (self.disc,))

    def solved(self) -> "Claim":
        (stretches,) = find_clearance(self.surroundings, [self.leg])
        return self._replace(stretches=stretches)

    def prove(self) -> None:
        prove_surroundings(self.surroundings, [self.leg], [tuple(self.stretches)])


class Case(NamedTuple):
    """A question in floating point: half-widths of the funnel and a correlation of heading and place."""

    segment: Segment
    widths: tuple[float, float, float, float]
    correlation: float
    template: str
    rate: float
    obstacle: Disc | Polygon
    disc: FootprintDisc

    @property
    def spread(self) -> np.ndarray:
        """C⁻¹."""
        correlations = np.eye(4)
        correlations[0, 1:3] = correlations[1:3, 0] = self.correlation
        return correlations * np.outer(self.widths, self.widths)

    def claim(self) -> Claim:
        profiles = (
            StatedProfile(exactly(profile.breaks), tuple(map(exactly, profile.coefficients)))
            for profile in (self.segment.turn_rate, self.segment.speed)
        )
        turn_rate, speed = profiles
        alpha, x, y = exactly(self.segment.start)
        reference = exact_reference([StatedSegment(turn_rate, speed, (alpha, x, y))])
        (hull,) = self.obstacle.hulls
        corners = tuple((rational(float(x)), rational(float(y))) for x, y in hull.corners)
        lower = np.linalg.inv(self.spread)
        shape = [[rational(float(lower[max(i, j), min(i, j)])) for j in range(4)] for i in range(4)]
        return Claim(
            reference.pieces,
            reference.start,
            shape,
            LEVELS[self.template](rational(self.rate)),
            ObstacleClaim(corners, rational(hull.round)),
            FootprintClaim(*exactly(self.disc)),
        )

    def sampled(self) -> float:
        """Least distance (m) of the disc from the obstacle over cars on the funnel's surface, placed one by one."""
        theta = np.linspace(0.0, self.segment.duration, 81)
        level = np.asarray(template_named(self.template).level(self.rate, theta))
        x = surface(1000) @ np.linalg.cholesky(self.spread[:3, :3]).T
        least = math.inf
        for (alpha, px, py), size in zip(self.segment.poses(theta), np.sqrt(level), strict=True):
            c, s = np.cos(alpha), np.sin(alpha)
            cars = size * x @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) + [alpha, px, py]  # p = R(α_r) p_R + p_r
            ((radius, centres),) = disc_centres([self.disc], cars)
            least = min(least, float(distances(self.obstacle, centres)[0].min()) - radius)
        return least


def surface(count: int) -> np.ndarray:
    """Points all over the unit sphere, a spiral from pole to pole."""
    height = np.linspace(-1, 1, count)
    angle = np.pi * (1 + 5**0.5) * np.arange(count)
    around = np.sqrt(1 - height**2)
    return np.stack([around * np.cos(angle), around * np.sin(angle), height], axis=1)


SQUARE = Polygon(((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)))
AROUND = obstacle_path().curve[0]
BEND = Segment(
    Profile((0.0, 0.75, 2.0), ((1.0, -2.0, 1.5), (0.25, 0.5))),
    Profile((0.0, 2.0), ((1.0, 0.25),)),
    Pose(0.5, -1.0, 0.25),
)
ARC = Segment(Profile.constant(-2.0, 4.0), Profile.constant(2.0, 4.0), Pose(1.0, 3.0, -2.0))  # more than a lap
WIDTHS = (0.25, 0.12, 0.12, 0.3)
CASES = {
    "around a square": Case(AROUND, WIDTHS, 0.0, "contracting", 0.5, SQUARE, FootprintDisc(0.25)),
    "around a square, paper": Case(AROUND, (0.25, 0.05, 0.2, 0.3), 0.3, "paper", 0.4, SQUARE, FootprintDisc(0.2, 0.15)),
    "around a disc, growing": Case(
        AROUND, WIDTHS, -0.4, "contracting", -0.3, Disc(0.0, 0.0, 0.2), FootprintDisc(0.1, -0.2)
    ),
    "a triangle ahead of the rear": Case(
        BEND,
        (0.5, 0.2, 0.1, 0.3),
        0.5,
        "paper",
        -0.25,
        Polygon(((-3.5, 1.0), (-4.5, 1.0), (-3.7, 2.2))),
        FootprintDisc(0.1, -0.4),
    ),
    "a disc behind the front": Case(
        BEND, (0.4, 0.1, 0.15, 0.3), 0.6, "contracting", 1.0, Disc(-0.7, -0.2, 0.3), FootprintDisc(0.2, 0.4)
    ),
    "inside of a lap": Case(ARC, WIDTHS, 0.2, "paper", 0.125, Disc(2.5, -2.9, 0.1), FootprintDisc(0.2, 0.25)),
}
every_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())


@functools.cache
def tight(name: str) -> tuple[Claim, float]:
    """A case with its obstacle grown nearly as far as is true, solved; and the clearance that is left."""
    case = CASES[name]
    clearance = case.sampled()
    assert clearance > 0.1
    return case.claim().grown(NEAR * clearance).solved(), (1 - NEAR) * clearance


# --- truth


@pytest.mark.parametrize("name", CASES)
def test_nearly_all_of_the_sampled_clearance_is_proven_and_no_more(name: str) -> None:
    claim, left = tight(name)
    claim.prove()
    beyond = claim.grown(left + 1e-9)  # a car that was placed touches it
    with pytest.raises(ValueError, match="not proven at theta"):
        beyond.prove()
    with pytest.raises(NotClear):
        beyond.solved()


@every_case
def test_a_loose_claim_takes_few_half_planes(case: Case) -> None:
    assert len(case.claim().solved().stretches) <= (10 if case.segment is ARC else 4)


@pytest.mark.parametrize(("offset", "correlation"), [*itertools.product((-0.4, 0.0, 0.3), (-0.6, 0.0, 0.6))])
def test_reach_bounds_the_body_from_above_and_closely(offset: float, correlation: float) -> None:
    """A car that stands, in every direction: bounds of the heading's higher orders have either sign there."""
    case = CASES["a disc behind the front"]._replace(disc=FootprintDisc(0.1, offset), correlation=correlation)
    case = case._replace(widths=WIDTHS)
    claim = case.claim()
    shadow = Shadow(claim.shape, claim.level, claim.disc)
    standing = Piece(0, ZERO, ONE, (ZERO,), (ZERO,), ZERO)
    x = surface(4000) @ np.linalg.cholesky(case.spread[:3, :3]).T
    ((_, centres),) = disc_centres([case.disc], x)  # at heading zero the body's axes are the plane's
    for angle in np.linspace(0, 2 * np.pi, 24, endpoint=False):
        normal = np.array([np.cos(angle), np.sin(angle)])
        terms, bend = shadow.reach(acb(*map(arb, normal)), standing, ZERO, arb(0))
        bound, reached = float((terms[0] + bend).upper()), float((centres @ normal).max())
        assert reached <= bound <= reached + 0.004


def test_what_happens_inside_a_piece_is_seen() -> None:
    """Pieces that touch at their ends only: by a bend of the path, and by a funnel that grows around a car at rest."""
    narrow = [[fmpq(10**8) if i == j else ZERO for j in range(4)] for i in range(4)]
    start, disc = ExactPose(fmpq(-9, 20), acb(0)), FootprintClaim(ZERO, ZERO)
    bend = Piece(0, ZERO, fmpq(9, 10), (ONE,), (ONE,), ZERO)  # from the line x = 0 and back to it
    rest = Piece(0, ZERO, ONE, (ZERO,), (ZERO,), ZERO)
    unit = [[fmpq(1 if i == j else 0) for j in range(4)] for i in range(4)]
    for piece, shape, rate, edge in ((bend, narrow, ZERO, fmpq(1, 10**4)), (rest, unit, fmpq(-3), fmpq(2))):
        for share, is_clear in ((fmpq(101, 100), True), (fmpq(99, 100), False)):
            obstacle = ObstacleClaim(((-share * edge, ZERO),), ZERO)
            claim = Claim((piece,), start, shape, Paper(rate), obstacle, disc)
            claim = claim._replace(stretches=[ClearStretch(piece.duration, ((-1, 0),))])
            if is_clear:
                claim.prove()
            else:
                with pytest.raises(ValueError, match="not proven"):
                    claim.prove()


def test_inner_poses_are_the_path_s() -> None:
    segment = figure_eight().curve[0]
    claim = CASES["around a disc, growing"]._replace(segment=segment).claim()
    ends = [ZERO, *(fmpq(k, 7) * rational(segment.duration) for k in range(1, 7))]
    pose = claim.start
    for begin, end in itertools.pairwise(ends):
        stretch = between(claim.pieces, begin, end)
        assert stretch[0].theta == begin and sum((piece.duration for piece in stretch), ZERO) == end - begin
        for piece in stretch:
            pose = pose.after(piece)
        alpha, x, y = segment.poses(np.array([float(end)]))[0]
        assert (float(pose.heading), float(pose.position.real), float(pose.position.imag)) == pytest.approx(
            (alpha, x, y)
        )


# --- the finder


def test_obstacle_path_takes_few_half_planes_and_little_time() -> None:
    for rate in (0.5, 2.0):
        case = CASES["around a square"]._replace(rate=rate)
        claim = case.claim().solved()
        assert len(claim.stretches) <= 3
        began = time.perf_counter()
        claim.prove()
        assert time.perf_counter() - began < 1.0  # about 0.01 s without run-time types


def test_states_that_are_no_pose_are_seen_through_its_inverse_alone() -> None:
    """A fourth and a fifth one that nothing ties to the pose: the body reaches as far as without them."""
    rows = [[ONE * 30, -ONE * 9, ZERO], [-ONE * 9, ONE * 40, ONE * 2], [ZERO, ONE * 2, ONE * 25]]

    def reach(extra: int) -> list[arb]:
        others = [[ONE * (i == j) for j in range(3 + extra)] for i in range(3, 3 + extra)]
        shape = [*([*row, *[ZERO] * extra] for row in rows), *others]
        shadow = Shadow(shape, Contracting(ONE), FootprintClaim(fmpq(1, 5), fmpq(1, 4)))
        piece = Piece(0, ZERO, ONE, (fmpq(1, 2),), (ONE,), ZERO)
        coefficients, rest = shadow.reach(acb(1, 2), piece, fmpq(1, 3), arb(fmpq(1, 2)))
        return [*coefficients, rest]

    for extra in (1, 2):
        assert all(one.overlaps(other) for one, other in zip(reach(0), reach(extra), strict=True))


def test_a_body_with_five_states_clears_an_obstacle() -> None:
    shape = [[fmpq(30) * (i == j) for j in range(5)] for i in range(5)]
    straight = Piece(0, ZERO, ONE * 10, (ZERO,), (ONE,), ZERO)
    beside, disc = ObstacleClaim(((fmpq(6, 5), fmpq(5)),), fmpq(3, 10)), FootprintClaim(fmpq(1, 5), fmpq(1, 4))
    claim = Claim((straight,), ExactPose(ZERO, acb(0)), shape, Contracting(ZERO), beside, disc).solved()
    claim.prove()
    with pytest.raises(ValueError, match="not proven"):
        claim._replace(shape=[[entry / 20 for entry in row] for row in shape]).prove()


def test_far_away_one_stretch_does() -> None:
    for name in ("around a square", "inside of a lap"):
        case = CASES[name]._replace(obstacle=Disc(20.0, 30.0, 1.0))
        (stretch,) = case.claim().solved().stretches
        assert len(stretch.normals) <= 1 and all(abs(entry) <= 4096 for normal in stretch.normals for entry in normal)


def test_the_finder_says_where_the_body_touches() -> None:
    case = CASES["around a square"]
    theta = 0.4 * case.segment.duration
    _, x, y = case.segment.poses(np.array([theta]))[0]
    with pytest.raises(NotClear, match="m into it") as caught:
        case._replace(obstacle=Disc(x, y, 0.01)).claim().solved()
    assert caught.value.theta == pytest.approx(theta, abs=0.1)
    with pytest.raises(ValueError, match="empty before its end"):
        case._replace(template="paper", rate=1.0).claim().solved()


# --- attacks


def moved(claim: Claim, by: float) -> Claim:
    return claim._replace(start=claim.start._replace(position=claim.start.position + acb(0, -by)))


def cut(claim: Claim) -> tuple[Piece, ...]:
    """Its pieces, the first of them in two."""
    first, *rest = claim.pieces
    return (*first.split([first.duration / 3]), *rest)


def spoiled(claim: Claim, change: Callable[[list[ClearStretch]], Sequence[ClearStretch]]) -> Claim:
    return claim._replace(stretches=change(list(claim.stretches)))


def end_at(stretch: ClearStretch, end: fmpq) -> ClearStretch:
    return stretch._replace(end=end)


def against(stretch: ClearStretch) -> ClearStretch:
    return stretch._replace(normals=tuple((-x, -y) for x, y in stretch.normals))


ATTACKS: dict[str, tuple[str, Callable[[Claim], Claim]]] = {
    "grown": ("not proven", lambda c: c.grown(0.02)),
    "corner moved": (
        "not proven",
        lambda c: c._replace(obstacle=replace(c.obstacle, corners=(*c.obstacle.corners, (fmpq(-6, 25), fmpq(6, 25))))),
    ),
    "wider disc": ("not proven", lambda c: c._replace(disc=FootprintClaim(c.disc.radius + fmpq(1, 50), c.disc.offset))),
    "disc elsewhere": ("not proven", lambda c: c._replace(disc=FootprintClaim(c.disc.radius, fmpq(1, 2)))),
    "wider funnel": ("not proven", lambda c: c._replace(shape=[[e * fmpq(3, 5) for e in row] for row in c.shape])),
    "no funnel": ("positive definite", lambda c: c._replace(shape=[[-e for e in row] for row in c.shape])),
    "singular funnel": ("positive definite", lambda c: c._replace(shape=[[e * 0 for e in row] for row in c.shape])),
    "no pose": ("positive definite", lambda c: c._replace(shape=[row[:2] for row in c.shape[:2]])),
    "growing": ("not proven", lambda c: c._replace(level=replace(c.level, rate=-c.level.rate))),
    "other template": ("empty before its end", lambda c: c._replace(level=Paper(ONE))),
    "start moved": ("not proven", lambda c: moved(c, 0.02)),
    "start nowhere": (
        "place of the reference is not known",
        lambda c: c._replace(start=ExactPose(c.start.heading, acb("nan"))),
    ),
    "start anywhere": ("not proven", lambda c: c._replace(start=ExactPose(c.start.heading, acb(arb(0, 9), arb(0, 9))))),
    "start turned": ("not proven", lambda c: c._replace(start=c.start._replace(heading=c.start.heading - fmpq(1, 20)))),
    "first piece left out": ("ends increase", lambda c: c._replace(pieces=c.pieces[1:])),
    "last piece left out": ("ends increase", lambda c: c._replace(pieces=c.pieces[:-1])),
    "inner piece left out": ("ends increase", lambda c: c._replace(pieces=(*c.pieces[:3], *c.pieces[4:]))),
    "pieces exchanged": ("not proven", lambda c: c._replace(pieces=(c.pieces[1], c.pieces[0], *c.pieces[2:]))),
    "a piece twice": ("ends increase", lambda c: c._replace(pieces=(c.pieces[0], *c.pieces))),
    "no stretches": ("ends increase", lambda c: spoiled(c, lambda p: [])),
    "too short": (
        "ends increase",
        lambda c: spoiled(c, lambda p: [*p[:-1], end_at(p[-1], p[-1].end - fmpq(1, 10**9))]),
    ),
    "too long": ("ends increase", lambda c: spoiled(c, lambda p: [*p[:-1], end_at(p[-1], p[-1].end + fmpq(1, 10**9))])),
    "backwards": ("ends increase", lambda c: spoiled(c, lambda p: [p[1], p[0], *p[2:]])),
    "from below zero": ("ends increase", lambda c: spoiled(c, lambda p: [end_at(p[0], fmpq(-1)), *p])),
    "one twice": ("ends increase", lambda c: spoiled(c, lambda p: [p[0], *p])),
    "first ones left out": ("not proven", lambda c: spoiled(c, lambda p: p[4:])),
    "middle left out": ("not proven", lambda c: spoiled(c, lambda p: [p[0], p[-1]])),
    "other side": ("not proven", lambda c: spoiled(c, lambda p: [*map(against, p)])),
    "no normals": ("no half-plane is stated", lambda c: spoiled(c, lambda p: [q._replace(normals=()) for q in p])),
    "held too long": (
        "not proven",
        lambda c: spoiled(c, lambda p: [end_at(p[0], (p[0].end + p[-1].end) / 2), end_at(p[-1], p[-1].end)]),
    ),
}


@pytest.mark.parametrize(("reason", "attack"), ATTACKS.values(), ids=ATTACKS.keys())
def test_what_is_spoiled_is_refused(reason: str, attack: Callable[[Claim], Claim]) -> None:
    claim, _ = tight("around a square")
    with pytest.raises(ValueError, match=reason):
        attack(claim).prove()


def test_nothing_is_claimed_of_no_obstacle_and_no_disc() -> None:
    for nonsense in (
        lambda: ObstacleClaim((), ZERO),
        lambda: ObstacleClaim(((ZERO, ZERO),), fmpq(-1)),
        lambda: FootprintClaim(fmpq(-1), ZERO),
    ):
        with pytest.raises(ValueError, match="clearance: expected"):
            nonsense()


def test_pieces_may_be_cut_and_normals_of_any_length() -> None:
    claim, _ = tight("around a square")
    claim._replace(pieces=cut(claim)).prove()
    scaled = [p._replace(normals=tuple((x * 10**90, y * 10**90) for x, y in p.normals)) for p in claim.stretches]
    claim._replace(stretches=scaled).prove()


HUGE = fmpq(10) ** 300


def steady(turn_rate: fmpq, speed: fmpq, duration: fmpq = ONE, slope: fmpq = ZERO) -> Callable[[Claim], Claim]:
    """The claim along a path of one piece, with one half-plane and its obstacle at the origin."""

    def change(claim: Claim) -> Claim:
        piece = Piece(0, ZERO, duration, (turn_rate,), (speed, slope), ZERO)
        start = ExactPose(ZERO, acb(0, -30))
        return claim._replace(
            pieces=(piece,),
            start=start,
            level=replace(claim.level, rate=ZERO),
            stretches=[ClearStretch(duration, ((0, 1),))],
            disc=claim.disc,
        )

    return change


def test_a_way_that_leads_far_away_takes_little() -> None:
    """Straight away from the obstacle, at a speed for which no pose is asked: what is far is not looked at closely."""
    claim, _ = tight("around a square")
    steady(ZERO, fmpq(-(10**9)))(claim).prove()
    with pytest.raises(ValueError, match="clearance is not proven"):
        steady(ZERO, fmpq(10**9))(claim).prove()


@pytest.mark.parametrize(
    "attack",
    [
        steady(fmpq(10**9), ONE),
        steady(HUGE, ONE),
        steady(ONE, ONE, HUGE),
        steady(ONE, ONE, fmpq(10**6)),
        steady(ONE, ONE, fmpq(10**6), fmpq(1, 10**20)),  # no closed form
        steady(ONE, HUGE, ONE, -HUGE),
        lambda c: c._replace(level=replace(c.level, rate=HUGE)),
        lambda c: c._replace(shape=[[e / HUGE for e in row] for row in c.shape]),
        lambda c: c._replace(obstacle=ObstacleClaim(((HUGE, ZERO), (-HUGE, ZERO)), HUGE)),
        lambda c: c._replace(disc=FootprintClaim(ZERO, HUGE)),
        lambda c: spoiled(c, lambda p: [ClearStretch(fmpq(k, 2000) * p[-1].end, p[0].normals) for k in range(1, 2001)]),
    ],
)
def test_hostile_numbers_are_refused_quickly(attack: Callable[[Claim], Claim]) -> None:
    claim, _ = tight("around a square")
    began = time.perf_counter()
    with pytest.raises(ValueError, match=r"^[^\n]{10,160}$"):
        attack(claim).prove()
    assert time.perf_counter() - began < 3.0  # about 0.3 s with a sixteenth of the effort that is allowed
