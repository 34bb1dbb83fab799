"""Exact objects made by hand: a tube that nobody certified, pieces of a reference, segments as they are stated, and
what the checker would say of a proof.
"""

from collections.abc import Sequence

from flint import acb, fmpq

from cfcheck import Outcome, Report
from cfcheck.claims.document import Claims, LegClaim
from cfcheck.claims.problem import PlacedPath, ProblemClaim
from cfcheck.claims.proven import Proven
from cfcheck.clearance.surroundings import SurroundingsClaim
from cfcheck.exact.graph import Graph
from cfcheck.exact.rational import Range, rational
from cfcheck.kernel.funnel import LAW_SHARE, FunnelClaim
from cfcheck.kernel.level import Contracting
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece
from cfcheck.path.reference import ExactPose, Reference
from cfcheck.robustness.amounts import ProvenRobustness
from cfcheck.vehicle.model import STATES, VehicleClaim
from cfjax.exact import StatedProfile, StatedSegment
from cfjax.tubes.certified import CertifiedTube


ZERO, ONE = fmpq(0), fmpq(1)
TINY = fmpq(1, 10**12)


def bounds(
    curvature: fmpq = ONE, speed: Range = (fmpq(1, 2), fmpq(2)), acceleration: Range = (fmpq(-1), fmpq(1))
) -> Bounds:
    """Those of the tube by hand, for curvatures up to one."""
    return Bounds((-curvature, curvature), speed, acceleration)


def tube(name: str = "wide", within: Bounds | None = None, scale: fmpq = ONE, **changes: object) -> CertifiedTube:
    """A tube that nobody certified: C is `scale` times a fixed matrix, the law lowers V by 1/2 per metre."""
    diagonal = (6, 5, 4, 7)
    shape = [[scale * (diagonal[i] if i == j else fmpq(1, 2)) for j in range(4)] for i in range(4)]
    entries: dict = {
        "name": name,
        "vehicle": "kinematic_bicycle",
        "parameters": {"wheelbase": fmpq(17, 50)},
        "method": "pf",
        "bounds": within or bounds(),
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


def problem_claim(course: PlacedPath | Bounds, **changes: object) -> ProblemClaim:
    """About a car whose dynamics nobody looks at."""
    entries: dict = {
        "vehicle": VehicleClaim("kinematic_bicycle", {"wheelbase": fmpq(17, 50)}, STATES, Graph((), ())),
        "method": "pf",
        "inputs": {"u0": (fmpq(1, 2), fmpq(2)), "w": (-ONE, ONE)},
        "path": "made by hand",
        "course": course,
        "inlet": (fmpq(1, 4),) * 4,
        "goal": (fmpq(1, 2),) * 4,
        "safe": None,
        "surroundings": SurroundingsClaim(),
    }
    return ProblemClaim(**(entries | changes))


def funnel(margin: fmpq = ONE, margin_per_metre: fmpq | None = None, **changes: object) -> FunnelClaim:
    """A funnel of half-widths 1/2 that nobody certified."""
    entries: dict = {
        "level": Contracting(ZERO),
        "shape": [[fmpq(4) if i == j else ZERO for j in range(4)] for i in range(4)],
        "beta_lower": fmpq(9, 10),
        "beta_inner": fmpq(1, 2),
        "margin": margin,
        "margin_per_metre": margin_per_metre,
    }
    return FunnelClaim(**(entries | changes))


def claims(funnels: Sequence[FunnelClaim], closed: bool = False, **changes: object) -> Claims:
    """A straight path with a leg of a second for each funnel; nothing of it is proven."""
    count = len(funnels)
    pieces = tuple(Piece(0, fmpq(k), ONE, (ZERO,), (ONE,), fmpq(k)) for k in range(count))
    problem = problem_claim(PlacedPath(Reference(pieces, ExactPose(ZERO, acb(0))), closed), **changes)
    legs = tuple(LegClaim(k, k + 1, k) for k in range(count))
    return Claims(problem, tuple(funnels), (problem.car,) * count, legs, (ONE,) * (count - 1 + closed))


def everywhere(own: FunnelClaim, **changes: object) -> Claims:
    """A funnel for every path within the bounds above."""
    problem = problem_claim(bounds(), **changes)
    return Claims(problem, (own,), (problem.car,), (), ())


def proven(*margins: fmpq, robustness: ProvenRobustness | None = None) -> Report:
    """What the checker would say of a straight path with so many legs, of a second each."""
    shown = Proven(claims([funnel(margin) for margin in margins]), None)
    return Report(Outcome.PROVEN, shown=shown, robustness=robustness)
