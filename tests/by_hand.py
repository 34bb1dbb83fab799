"""Exact objects made by hand: a tube that nobody certified, pieces of a reference, segments as they are stated."""

from flint import fmpq

from cfjax.check.bounds import Bounds, Range
from cfjax.check.certified import LAW_SHARE, CertifiedTube
from cfjax.check.piece import Piece
from cfjax.check.rational import rational
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
