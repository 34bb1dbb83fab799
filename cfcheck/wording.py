"""The words for numbers, vehicle, path, sets and inputs of a file.

A number without a short decimal form is rounded, up or down, so that the sentence claims no more than the proof shows.
Where a number only names a thing, "about" stands before its rounded decimal.
"""

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR
from typing import NamedTuple

from flint import fmpq

from cfcheck.claims.assumptions import Assumptions
from cfcheck.claims.problem import PlacedPath, ProblemClaim
from cfcheck.clearance.surroundings import SurroundingsClaim
from cfcheck.exact.rational import Range, about, decimal_text
from cfcheck.path.bounds import Bounds
from cfcheck.vehicle.model import KNOWN_VEHICLES, POSE, POSE_UNITS, VehicleClaim


INWARDS, OUTWARDS = (ROUND_CEILING, ROUND_FLOOR), (ROUND_FLOOR, ROUND_CEILING)  # of an interval's lower and upper end


class Section(NamedTuple):
    """What is said under one heading: a list of clauses, without full stops."""

    heading: str
    clauses: tuple[str, ...]

    @property
    def paragraph(self) -> str:
        """The same in one line of prose."""
        return f"{self.heading}: {'; '.join(self.clauses)}."


def down(value: fmpq) -> str:
    """A decimal that is at most the number."""
    return decimal_text(value, ROUND_FLOOR)


def up(value: fmpq) -> str:
    """A decimal that is at least the number."""
    return decimal_text(value, ROUND_CEILING)


def numbers_text(values: Sequence[fmpq], rounding: str) -> str:
    """The numbers with commas between them, all rounded the same way."""
    return ", ".join(decimal_text(value, rounding) for value in values)


def interval(ends: Range, rounding: tuple[str, str]) -> str:
    """[lower, upper], each end rounded its own way: `INWARDS` or `OUTWARDS`."""
    lower, upper = (decimal_text(end, how) for end, how in zip(ends, rounding, strict=True))
    return f"[{lower}, {upper}]"


def units_of(vehicle: VehicleClaim) -> tuple[str, ...]:
    """The units of its states, where a pose comes first those of a pose; "" for a state whose unit is not known."""
    if vehicle.name in KNOWN_VEHICLES:
        return KNOWN_VEHICLES[vehicle.name].state_units
    known = POSE_UNITS if vehicle.states[: len(POSE)] == POSE else ()
    return (*known, *[""] * (len(vehicle.states) - len(known)))


def vehicle_section(vehicle: VehicleClaim, assumptions: Assumptions | None) -> Section:
    """Its name; if the checker does not know the name, the assumptions about its reference too."""
    values = ", ".join(f"{label} {about(value)}" for label, value in vehicle.parameters.items())
    named = f'"{vehicle.name}" ({values})' if values else f'"{vehicle.name}"'
    if vehicle.name in KNOWN_VEHICLES:
        return Section("vehicle", (named, KNOWN_VEHICLES[vehicle.name].said))
    unknown = "a name unknown to this checker: its dynamics are those of the graph in the file"
    if assumptions is None:
        return Section("vehicle", (named, unknown))
    on = "speed and turning rate" if assumptions.follows_turning else "speed"
    looks = (
        "which are those of a body whose reference looks along the path"
        if assumptions.is_body
        else "its reference looks along the path, or at one angle to it all along"
    )
    states = f"and what else it has of states depends on the path's {on} alone"
    return Section("vehicle", (named, f"{unknown}, {looks}, {states}"))


def path_text(name: str, course: PlacedPath) -> str:
    """The path: its numbers if it is one steady piece, else its length and duration."""
    named, pieces = f'"{name}"', course.reference.pieces
    if len(pieces) == 1 and pieces[0].is_constant:
        turning, moving = (about(coefficients[0]) for coefficients in (pieces[0].turn_rate, pieces[0].speed))
        return (
            f"{named} (turning rate {turning} rad/s, speed {moving} m/s, theta from 0 to {about(pieces[0].duration)} s)"
        )
    return (
        f"{named}, whose {len(pieces)} pieces stand in the file ({about(course.reference.length)} m, theta from 0 to "
        f"{about(course.reference.duration)} s)"
    )


def proven_paths(bounds: Bounds) -> tuple[str, ...]:
    """The paths for which a funnel is proven: intervals rounded so that fewer paths are in them."""
    return (
        "every one whose position, heading and speed are continuous",
        f"speed in {interval(bounds.speed, INWARDS)} m/s",
        f"curvature in {interval(bounds.curvature, INWARDS)} 1/m, which may jump",
        f"acceleration dv/dtheta in {interval(bounds.acceleration, INWARDS)} m/s^2",
    )


def refuted_paths(bounds: Bounds) -> str:
    """The paths of a refuted funnel: intervals rounded so that more paths are in them."""
    return (
        f"every one with speed in {interval(bounds.speed, OUTWARDS)} m/s, curvature in "
        f"{interval(bounds.curvature, OUTWARDS)} 1/m, acceleration in {interval(bounds.acceleration, OUTWARDS)} m/s^2"
    )


def sets_section(problem: ProblemClaim, inlet: str, goal: str) -> Section:
    """I, G, S and obstacles: I rounded by `inlet`, G and S by `goal`."""
    safe = "no S: the whole plane is safe" if problem.safe is None else _safe_box(problem.safe, goal)
    return Section(
        "sets",
        (
            deviations_text(problem.vehicle),
            "no I is asked" if problem.inlet is None else half_axes_text("I", problem.inlet, inlet),
            "no G is asked" if problem.goal is None else half_axes_text("G", problem.goal, goal),
            safe,
            *_obstacles(problem.surroundings),
        ),
    )


def deviations_text(vehicle: VehicleClaim) -> str:
    """The states of which deviations consist, with their units."""
    entries = zip(vehicle.states, units_of(vehicle), strict=True)
    return f"of deviations {', '.join(f'{name} ({unit})' if unit else name for name, unit in entries)}"


def half_axes_text(name: str, values: Sequence[fmpq], rounding: str) -> str:
    """An ellipsoid by its half-axes."""
    return f"{name} with half-axes ({numbers_text(values, rounding)})"


def _safe_box(values: Sequence[fmpq], rounding: str) -> str:
    return f"S with half-widths ({numbers_text(values, rounding)})"


def _obstacles(surroundings: SurroundingsClaim) -> tuple[str, ...]:
    """A clause, where there are any."""
    if surroundings.is_empty:
        return ()
    discs = " and ".join(
        f"radius {down(disc.radius)} m at offset {about(disc.offset)} m" for disc in surroundings.footprint
    )
    obstacles, walls = len(surroundings.obstacles), surroundings.walls
    named = [] if not obstacles else ["one obstacle" if obstacles == 1 else f"{obstacles} obstacles"]
    if walls:
        points = sum(len(wall.points) for wall in walls)
        named.append(f"{'one wall' if len(walls) == 1 else f'{len(walls)} walls'} through {points} points")
    verb = "stands" if obstacles + len(walls) == 1 else "stand"
    return (f"clear of {' and '.join(named)} that {verb} in the file, by a footprint of {discs}",)


def kept_text(problem: ProblemClaim) -> str:
    """Where the car stays besides the funnel: in S, its footprint clear of obstacles and walls."""
    around = problem.surroundings
    named = [name for name, some in (("obstacles", around.obstacles), ("walls", around.walls)) if some]
    clear = f", clear of the {' and '.join(named)}" if named else ""
    return ("" if problem.safe is None else ", inside S") + clear


def inputs_text(problem: ProblemClaim, rounding: tuple[str, str]) -> str:
    """The box of inputs, and the law that chooses them if the problem has one."""
    box = ", ".join(f"{name} in {interval(ends, rounding)}" for name, ends in problem.inputs.items())
    if problem.law is None:
        return box
    return f'{box}, all but u0 as the law "{problem.law.name}", a graph in the file, has them, or the nearer limit,'
