"""Exact objects made by hand: a tube that nobody certified, pieces of a reference, segments as they are stated, and
what the checker would say of a proof.
"""

from flint import acb, fmpq

from cfjax.check import Outcome, Report
from cfjax.check.amounts import Robustness
from cfjax.check.bounds import Bounds, Range
from cfjax.check.certified import LAW_SHARE, CertifiedTube
from cfjax.check.document import Course, FunnelClaim, ProblemClaim, SegmentClaim, VehicleClaim
from cfjax.check.graph import Graph
from cfjax.check.level import Contracting
from cfjax.check.piece import Piece
from cfjax.check.proven import ProvenFunnels
from cfjax.check.rational import rational
from cfjax.check.reference import ExactPose, Reference
from cfjax.check.surroundings import Surroundings
from cfjax.check.vehicle import STATES
from cfjax.exact import StatedProfile, StatedSegment


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


def problem_claim(course: Course | Bounds, **changes: object) -> ProblemClaim:
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
        "surroundings": Surroundings(),
    }
    return ProblemClaim(**(entries | changes))


def proven(*margins: fmpq, robustness: Robustness | None = None) -> Report:
    """What the checker would say of a straight path with so many segments, of a second each."""
    pieces = tuple(Piece(k, ZERO, ONE, (ZERO,), (ONE,), fmpq(k)) for k in range(len(margins)))
    segments = tuple(SegmentClaim((piece,)) for piece in pieces)
    course = Course(Reference(pieces, ExactPose(ZERO, acb(0))), False, segments, tuple(range(len(margins))))
    funnels = tuple(FunnelClaim(Contracting(ZERO), (), fmpq(9, 10), fmpq(9, 10), margin, None) for margin in margins)
    return Report(
        Outcome.PROVEN, shown=ProvenFunnels(problem_claim(course), course, funnels, None), robustness=robustness
    )
