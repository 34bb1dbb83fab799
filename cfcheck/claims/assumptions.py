"""What may be asked of a vehicle that the checker does not know, and what is taken for granted of it.

The checker knows some vehicles by name (`cfcheck.vehicle.model`). Of any other one it knows the dynamics that stand in
the file, and no more than these is proven: what a pose is, and that a reference's states do not jump where the path's
curvature does, has to follow from them, or is said to be taken for granted.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from cfcheck.claims.problem import ProblemClaim
from cfcheck.clearance.surroundings import SurroundingsClaim
from cfcheck.exact.rational import about
from cfcheck.exact.symbolic import Symbolic
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece, are_steady, jumps_in_turning
from cfcheck.reader import Broken
from cfcheck.vehicle.body import is_a_body, looks_at_one_angle, slopes_by_timing_alone, turns_by_timing_alone
from cfcheck.vehicle.model import KNOWN_VEHICLES, VehicleClaim
from cfcheck.vehicle.structure import TURN_RATE_SLOPE


class Assumptions(NamedTuple):
    """What a reference's states have to do with its path, of a vehicle that the checker does not know.

    Its dynamics are those of a body whose reference looks along the path, or it is assumed that the reference looks
    along the path or at one angle to it. States that are no pose are assumed to depend on the path's speed, and on its
    turning rate where they may follow it.
    """

    is_body: bool
    follows_turning: bool


def follows_turning(dynamics: Symbolic) -> bool:
    """Whether states of the reference that are no pose may change with the turning rate ω, and jump where it does.

    Then the rates read its slope; or ω stands there in another way than as ω u0 g(x), as of a method without timing
    it could for what such a state does.
    """
    return dynamics.depends_on(TURN_RATE_SLOPE) or not turns_by_timing_alone(dynamics)


def jumping(follows: bool, before: Piece, after: Piece) -> str:
    """What of a path jumps between two pieces, and with it states of a vehicle's reference; nothing where none does.

    Of a vehicle that the checker does not know the states that are no pose depend on the speed, and where they may
    follow it on the turning rate.
    """
    if before.end_speed != after.speed[0]:
        return "speed"
    return "turning rate" if follows and jumps_in_turning(before, after) else ""


def closes(dynamics: Symbolic, states: Sequence[str], pieces: Sequence[Piece]) -> bool:
    """Whether at the end of a lap only the pose of a vehicle's reference jumps, by a gap that is known."""
    return is_a_body(dynamics, states) and not jumping(follows_turning(dynamics), pieces[-1], pieces[0])


def require_supported(problem: ProblemClaim, dynamics: Symbolic) -> None:
    """That nothing is asked of a vehicle's states but what its dynamics say, where the checker knows nothing else.

    Raises:
        Broken: says what is asked.
    """
    course, vehicle = problem.course, problem.vehicle
    if isinstance(course, Bounds):
        if vehicle.name not in KNOWN_VEHICLES and not course.is_single:
            _require_one_angle(vehicle, dynamics)
    else:
        require_path(vehicle, dynamics, course.reference.pieces, course.closed)
        require_body(vehicle, dynamics, problem.surroundings)


def require_body(vehicle: VehicleClaim, dynamics: Symbolic, surroundings: SurroundingsClaim) -> None:
    """That where there are obstacles the vehicle's first states are the pose of a body that looks along the path.

    Raises:
        Broken: by an unknown vehicle's dynamics they are not.
    """
    if not surroundings.is_empty and vehicle.name not in KNOWN_VEHICLES and not is_a_body(dynamics, vehicle.states):
        raise Broken("vehicle: obstacles are cleared by bodies that look along the path only")


def require_path(vehicle: VehicleClaim, dynamics: Symbolic, pieces: Sequence[Piece], closed: bool) -> None:
    """That an unknown vehicle's pose means along the path what it means, and nothing else of its reference jumps.

    What a pose, or a gap in it, means is said by the dynamics where they are those of a body (`cfcheck.vehicle.body`).
    Other states of the reference go with speed and turning rate; the rates of these, which may jump at any time, have
    to enter as they do of such states.

    Raises:
        Broken: says what is not so.
    """
    if vehicle.name in KNOWN_VEHICLES:
        return
    if closed and not closes(dynamics, vehicle.states, pieces):
        raise Broken("vehicle: laps are closed for bodies that look along the path, whose other states do not jump")
    if are_steady(pieces):
        return
    _require_one_angle(vehicle, dynamics)
    if not slopes_by_timing_alone(dynamics):
        raise Broken(
            "vehicle: along a path whose speed or curvature changes, the rates at which they do have to enter times "
            "u0; by the dynamics in the file they do not"
        )
    follows = follows_turning(dynamics)
    for one, other in pairwise(pieces):
        if jumps := jumping(follows, one, other):
            raise Broken(
                f"path, at theta = {about(other.theta)} s: the {jumps} jumps, and with it states of a vehicle that is "
                f"none of {', '.join(KNOWN_VEHICLES)}"
            )


def _require_one_angle(vehicle: VehicleClaim, dynamics: Symbolic) -> None:
    if not looks_at_one_angle(dynamics, vehicle.states):
        raise Broken(
            "vehicle: along a path whose speed or curvature changes, its reference has to look along the path or at "
            "one angle to it; by the dynamics in the file it does not"
        )


def assumptions_of(vehicle: VehicleClaim, dynamics: Symbolic, at_rest: bool = False) -> Assumptions | None:
    """None of a vehicle that the checker knows, and where one reference at rest leaves nothing to assume."""
    if at_rest or vehicle.name in KNOWN_VEHICLES:
        return None
    return Assumptions(is_a_body(dynamics, vehicle.states), follows_turning(dynamics))
