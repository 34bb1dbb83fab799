"""A path held by universal tubes, from I to G: tubes that are there already, or one learned for the path's own bounds.

An invariant tube does not shrink, so that the path's I lies in the first tube and what is left of the last one, after
the metres that it had for contraction, in G. Beside obstacles the body has to be clear of them in every tube, wherever
in it the car is.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from flint import fmpq

from cfcheck import Outcome, check_document
from cfcheck.claims.problem import MOST_PIECES
from cfcheck.exact.rational import float_below
from cfcheck.kernel.containment import Sets, broken_containments
from cfcheck.kernel.legs import Leg
from cfcheck.path.reference import Reference
from cfcheck.vehicle.model import STATES
from cfjax.certificate.bounds import bounds_along, bounds_of_pieces
from cfjax.certificate.certifier import statement_of
from cfjax.certificate.writing import exact_inputs
from cfjax.errors import InputError
from cfjax.exact import exact_course, exact_numbers, tube_within
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Box, Ellipsoid, Interval, Path, Problem, Tube
from cfjax.result import Result, SegmentResult
from cfjax.tubes.certificate import chain_document
from cfjax.tubes.certified import CertifiedTube, Origin, tube_of
from cfjax.tubes.follow import Following, follow
from cfjax.tubes.store import library
from cfjax.verdict import Verdict


INNER_LEVEL = 0.1  # to which a learned tube contracts, or further where G asks for it
LEAST_INNER_LEVEL = 0.01
REACHED = 0.5  # of the level that lies in G: what is left lets inputs be held
ROOM = 0.999  # of the widest tube whose inner level lies in G
MOST_HEADING = 3.1  # rad: a tube stays short of where the heading wraps

Learn = Callable[[Problem, float], Result]  # the funnel of a problem whose path is a tube, down to a level beta_inner


def hold_by_library(problem: Problem) -> Result | None:
    """The path held by tubes that came with the package, proven at once; None where they do not do it."""
    try:
        following = _follow(problem, tubes_for(problem))
    except InputError:  # no tube holds I, S and the path's bounds, or there is none for this kind of vehicle
        return None
    found = _held(problem, following, {})
    return found if found.verdict is Verdict.CERTIFIED else None


def tubes_for(problem: Problem) -> list[CertifiedTube]:
    """The package's tubes that hold the problem's I and lie in its S, within its inputs; whether in G, no path says.

    Raises:
        InputError: as `library`.
    """
    return [tube for tube in library(problem.vehicle) if _serves(problem, tube)]


def hold_by_learning(problem: Problem, learn: Learn) -> Result:
    """The path held by one tube that is learned for its bounds, between its I, S and G.

    Raises:
        InputError: for a path without proven bounds, or what no checker reads.
    """
    reference = exact_course(problem.path)
    if len(reference.pieces) > MOST_PIECES:  # nothing is learned first for what no checker reads
        raise InputError(
            f"path {problem.path.name}: expected at most {MOST_PIECES} polynomial pieces, which a certificate holds, "
            f"got {len(reference.pieces)}; smoother points (path.smoothing) or a part of the path need fewer"
        )
    if problem.obstacles:  # a tube knows none: what no checker reads of them is refused before one is learned
        statement_of(problem)
    ratio = min(goal / start for start, goal in zip(problem.inlet.half_axes, problem.goal_axes, strict=True))
    inner = max(min(INNER_LEVEL, 0.25 * ratio**2), LEAST_INNER_LEVEL)
    # {V ≤ inner} lies in G where the tube lies in G enlarged
    reach = [ROOM * axis / math.sqrt(inner) for axis in problem.goal_axes]
    reach[0] = min(reach[0], MOST_HEADING)
    bounds = Path("tube", (_bounds_of(problem.path, reference),))
    try:
        # a tube has no place: it is made narrow enough to pass the obstacles, and the proof along the path decides
        bounded_problem = replace(
            problem, path=bounds, goal=Ellipsoid(tuple(reach)), safe=_narrow(problem, reach), obstacles=()
        )
    except InputError as error:  # G is too small beside I for what a tube contracts to, or the bounds ask too much
        room = f"; obstacles leave {problem.room:.4g} m beside the path" if problem.obstacles else ""
        message = f"no tube for the path's bounds leads from I to G ({error}{room})"
        return Result(Verdict.INCONCLUSIVE, message, problem)
    made = learn(bounded_problem, REACHED * inner)
    problem = replace(problem, inlet=made.problem.inlet)  # which an objective may have enlarged
    if made.verdict is not Verdict.CERTIFIED or made.document is None:
        return made.replace(
            problem=problem,
            message=f"no tube for the path's bounds: {made.message}",
            segments=(),
            document=None,
            worst_points=(),
        )
    name = "learned"
    try:
        tube = replace(tube_of(made.document, name), origin=Origin(made.document))
        following = _follow(problem, [tube])
    except ValueError as error:
        message = f"the learned tube does not hold along the path: {error}"
        return made.replace(
            problem=problem, message=message, verdict=Verdict.INCONCLUSIVE, segments=(), document=None, worst_points=()
        )
    found = _held(problem, following, {name: made.segments[0].margin_falsified})
    worst = tuple(point for point in made.worst_points if point.condition == "d")  # I and G are others'
    return found.replace(seconds=made.seconds, iterations=made.iterations, history=made.history, worst_points=worst)


def _follow(problem: Problem, tubes: Sequence[CertifiedTube]) -> Following:
    """The problem's path in these tubes, clear of its obstacles.

    Raises:
        InputError: as `follow`.
    """
    return follow(
        problem.path,
        tubes,
        vehicle=problem.vehicle,
        closed=problem.path.closed,
        obstacles=problem.obstacles,
        footprint=problem.footprint,
    )


def _narrow(problem: Problem, reach: Sequence[float]) -> Box | None:
    """S, or of a tube within `reach`: no place further from the path than the body is from the nearest obstacle."""
    if not problem.obstacles:
        return problem.safe
    angle, x, y, *others = problem.safe.half_widths if problem.safe else reach
    return Box((angle, min(x, problem.room), min(y, problem.room), *others))


def bounds_of(path: Path) -> Tube:
    """Proven bounds of curvature, speed and acceleration along a path, rounded outwards to 1e-6.

    Raises:
        InputError: where the speed is not positive, or a segment does not start where the one before ends.
    """
    return _bounds_of(path, exact_course(path))


def _bounds_of(path: Path, reference: Reference) -> Tube:
    try:
        return tube_within(bounds_of_pieces(reference.pieces))
    except ValueError as error:
        raise InputError(f"path {path.name}: {error}") from None


def _serves(problem: Problem, tube: CertifiedTube) -> bool:
    """Whether I lies in the tube and the tube in S, within the problem's inputs and by its method."""
    inlet = exact_numbers(problem.inlet.half_axes)
    safe = exact_numbers(problem.safe.half_widths) if problem.safe else None
    if broken_containments(STATES, tube.shape, tube.claim.level.bounds(fmpq(0)), Sets(inlet, None, safe)):
        return False
    box = exact_inputs(problem)
    return all(box[name][0] <= low and high <= box[name][1] for name, (low, high) in tube.inputs.items())


def _held(problem: Problem, following: Following, falsified: dict[str, float]) -> Result:
    """The result whose segments are the runs, proven from their document, or not."""
    document = chain_document(following, problem)
    report = check_document(document)
    pieces = following.reference.pieces
    ends = np.cumsum([float(piece.duration) for piece in pieces])
    legs: dict[CertifiedTube, list[Leg]] = {}
    for run in following.runs:
        legs.setdefault(run.tube, []).append(run.leg(following.reference))
    along = {tube: bounds_along(own, tube.bounds) for tube, own in legs.items()}
    segments = []
    for run in following.runs:
        tube = run.tube
        shape = np.array([[float(entry) for entry in row] for row in tube.shape])
        levels = float(tube.beta_lower), float(tube.beta_inner)
        segments.append(
            SegmentResult(
                funnel=Funnel(template_named("contracting"), shape, 0.0, math.inf, *levels),
                margin_falsified=falsified.get(tube.name, math.nan),
                margin_certified=float_below(tube.margin),
                margin_per_metre=float_below(tube.margin_per_metre),
                reference=tube_within(tube.bounds),
                along=tube_within(along[tube]),
                span=(0.0 if run.begin == 0 else float(ends[run.begin - 1]), float(ends[run.end - 1])),
            )
        )
    proven = report.outcome is Outcome.PROVEN
    lower, upper = following.timing
    # what is driven and written down is what the proof speaks of: poses integrated, speeds continuous
    return Result(
        Verdict.CERTIFIED if proven else Verdict.INCONCLUSIVE,
        report.message if proven else f"the path is not held by the tube between I, S and G: {report.message}",
        replace(problem, path=following.path, timing=Interval(float(lower), float(upper))),
        tuple(segments),
        document=document if proven else None,
    )
