"""What a file shows, in English: the only place where the checker's records become sentences.

A sentence follows from what is proven: a number without a short decimal form is rounded so that the sentence says less,
or is said to be "about" its decimal where it only names what the file speaks of. So I and λ of a proven funnel are
rounded down, G, S, its shell and its inputs' limits outwards; of a refuted one it is the other way round.
"""

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR
from typing import NamedTuple

from flint import fmpq

from cfcheck.claims.assumptions import Assumptions
from cfcheck.claims.document import Claims
from cfcheck.claims.problem import PlacedPath, ProblemClaim
from cfcheck.claims.proven import Bounded, Proven, Refuted, Shown, Violation
from cfcheck.clearance.surroundings import SurroundingsClaim
from cfcheck.exact.rational import Range, about, decimal_text
from cfcheck.kernel.containment import half_widths
from cfcheck.kernel.funnel import LAW_SHARE, FunnelClaim
from cfcheck.path.bounds import Bounds, place_of
from cfcheck.robustness.amounts import LawNumbers, ProvenRobustness
from cfcheck.robustness.ranges import SampledClaim
from cfcheck.vehicle.model import KNOWN_VEHICLES, POSE, POSE_UNITS, VehicleClaim


SHARE_TEXT = decimal_text(LAW_SHARE, ROUND_CEILING)
LAW = f"V' <= -{SHARE_TEXT} lambda in the shell"
LAW_EVERYWHERE = (
    f"{LAW} and V' <= -{SHARE_TEXT} v_r times the margin per metre, for every curvature and acceleration of the bounds "
    "at once"
)
LAW_IN_TURN = (
    f"V' <= -{SHARE_TEXT} times lambda or, if it is larger, v_r times the margin per metre, below the shell times V "
    "over its level, down to the inner one, for every curvature and acceleration of the bounds at once"
)
SHOWN = 4  # funnels whose rates are printed
RATES = {"rad": "rad/s", "m": "m/s", "m/s": "m/s^2", "": "a second"}  # of a state with such a unit
INWARDS, OUTWARDS = (ROUND_CEILING, ROUND_FLOOR), (ROUND_FLOOR, ROUND_CEILING)  # of an interval's lower and upper end
VIOLATED = {
    Violation.INLET: "condition (a) fails: V(0, x) is not below 1 at a deviation of the inlet I",
    Violation.GOAL: "condition (b) fails: V(T, x) is not above 1 at a deviation outside the goal G",
    Violation.SAFE: "condition (c) fails: V is not above 1 at a deviation outside the safe set S",
    Violation.HEADING: (
        "condition (c) fails: V is not above 1 at a deviation whose heading is pi or more, where it wraps"
    ),
    Violation.DECREASE: (
        "condition (d) fails: no input in the box decreases V as fast as claimed at a deviation of the shell"
    ),
    Violation.LAW: (
        "condition (d) fails: under the law no u0 decreases V as fast as claimed at a deviation of the shell"
    ),
}


class Section(NamedTuple):
    """What is said under one heading: a list of clauses, without full stops."""

    heading: str
    clauses: tuple[str, ...]

    @property
    def paragraph(self) -> str:
        """The same in one line of prose."""
        return f"{self.heading}: {'; '.join(self.clauses)}."


def sections(shown: Shown, robustness: ProvenRobustness | None = None) -> tuple[Section, ...]:
    """What is shown, what it speaks of, what it guarantees and, of something proven, what it absorbs."""
    if isinstance(shown, Refuted):
        return _refuted(shown)
    if isinstance(shown, Bounded):
        return _bounded(shown)
    problem, course = shown.claims.problem, shown.claims.problem.course
    if isinstance(course, Bounds):
        title = "one control funnel function for every path within bounds"
        path, guarantee = _every_path(course), _everywhere(shown)
    else:
        title = "a control funnel function along a path"
        path, guarantee = (_path(problem.path, course),), _along(shown)
    said = (
        Section("PROVEN", (title,)),
        _vehicle(problem.vehicle, shown.assumptions),
        Section("path", path),
        _sets(problem, ROUND_FLOOR, ROUND_CEILING),
        Section("guarantee", guarantee),
    )
    return said if robustness is None else (*said, _absorbed(shown, robustness))


def _along(proven: Proven) -> tuple[str, ...]:
    """What is guaranteed along a path."""
    claims, problem, arrival = proven.claims, proven.claims.problem, proven.arrival
    assert arrival is not None  # of a path that lies somewhere
    started = "every start with V < 1" if problem.inlet is None else "every start in I"
    arrives = f"arrives with V <= {_up(proven.finish)}" if problem.goal is None else "arrives in G"
    again = ", and from there lap after lap for ever" if problem.is_lap else ""
    law = ""
    if proven.falls:
        law = f"this needs a law that enforces {SHARE_TEXT} of the margin per metre"
    parts = len(claims.parts), len(claims.ratios), len(claims.funnels)
    turn = f"legs: {parts[0]}, joints: {parts[1]}, funnels: {parts[2]}" if max(parts) > 1 else ""
    each = "the funnels" if parts[2] > 1 else "the funnel"
    form = f"{each}: {_templates(claims.driven)}, {_shell(claims.driven, ROUND_CEILING)}{_lateral(claims)}"
    per_metre = [funnel.margin_per_metre for funnel in claims.driven if funnel.margin_per_metre is not None]
    everywhere = len(per_metre) == len(claims.driven)
    where = "" if everywhere else " in funnels that do not change with theta"
    falls = f" and{where} {_down(min(per_metre))} per metre of the reference at u0 = 1" if per_metre else ""
    said = (
        f"from {started} at theta = 0, inputs {_inputs(problem, OUTWARDS)} suffice to keep the car in the funnel V <= 1"
        f"{_kept(problem)}, until it {arrives} after {_time(arrival)}{again}",
        law,
        turn,
        form,
        f"V decreases there with margin lambda = {_down(min(proven.margins))} 1/s{falls} or more",
    )
    return tuple(clause for clause in said if clause)


def _lateral(claims: Claims) -> str:
    """How far a car may be beside the path, where its states begin with a pose."""
    if claims.problem.vehicle.states[: len(POSE)] != POSE:
        return ""
    widest = max(half_widths(funnel.shape)[POSE.index("x")] for funnel in claims.driven)
    return f", lateral half-width {_up(widest)} m"


def _everywhere(proven: Proven) -> tuple[str, ...]:
    """What is guaranteed along every path within bounds."""
    problem, (funnel, *_) = proven.claims.problem, proven.claims.driven
    assert proven.contraction is not None and proven.margin_per_metre is not None  # of what is invariant, as is proven
    started = "every start with V < 1" if problem.inlet is None else "every start in I"
    inside = "" if problem.goal is None else ", inside G"
    widths = _numbers(half_widths(funnel.shape), ROUND_CEILING)
    return (
        f"from {started}, anywhere along the path, inputs {_inputs(problem, OUTWARDS)} suffice to keep the car in the "
        f"tube V <= 1{inside}{_kept(problem)}, for ever",
        f"the tube: {_shell((funnel,), ROUND_CEILING)}, half-widths ({widths})",
        f"V decreases there with margin lambda = {_down(funnel.margin)} 1/s and {_down(proven.margin_per_metre)} per "
        "metre of the reference at u0 = 1, or more",
        f"inputs that do so bring a car from V = 1 inside V <= {_up(funnel.beta_inner)} within "
        f"{_up(proven.contraction)} m of the path",
    )


def _refuted(refuted: Refuted) -> tuple[Section, ...]:
    claims, witness = refuted.claims, refuted.witness
    problem, course, funnel = claims.problem, claims.problem.course, claims.driven[0]
    if claims.parts:
        funnel = claims.driven[claims.parts[witness.leg].funnel]
    shell, margin = _shell((funnel,), ROUND_FLOOR), _up(funnel.margin)
    if isinstance(course, Bounds):
        candidate, path = shell, _paths(course)
    else:
        along = f" along leg {witness.leg}" if len(claims.parts) > 1 else ""
        candidate, path = f"{_templates((funnel,))}, {shell}{along}", _path(problem.path, course)
    of_decrease = refuted.violation in (Violation.DECREASE, Violation.LAW)
    place = place_of(refuted.extremes, witness.reference) if of_decrease else ""
    at = ", ".join(f"{name} = {about(value)}" for name, value in zip(problem.vehicle.states, witness.x, strict=True))
    return (
        Section("REFUTED", (f"{candidate} with margin lambda = {margin} 1/s is no control funnel function",)),
        _vehicle(problem.vehicle, refuted.assumptions),
        Section("path", (path,)),
        _sets(problem, ROUND_CEILING, ROUND_FLOOR),
        Section("inputs", (_inputs(problem, INWARDS),)),
        Section("witness", (f"at {place}theta = {about(witness.theta)} s, {at}", VIOLATED[refuted.violation])),
    )


def _bounded(bounded: Bounded) -> tuple[Section, ...]:
    problem, course = bounded.problem, bounded.problem.course
    assert not isinstance(course, Bounds) and problem.inlet and problem.goal  # of a bound, as is proven
    *_, last = problem.vehicle.states
    return (
        Section(
            "BOUNDED",
            (f"no control funnel function of this form has a margin of lambda = {_up(bounded.margin)} 1/s or more",),
        ),
        _vehicle(problem.vehicle, bounded.assumptions),
        Section("path", (_path(problem.path, course),)),
        Section(
            "sets",
            (
                _deviations(problem.vehicle),
                _half_axes("I", problem.inlet, ROUND_CEILING),
                _half_axes("G", problem.goal, ROUND_FLOOR),
                "S and obstacles are not looked at: they can only make margins smaller",
            ),
        ),
        Section("inputs", (_inputs(problem, INWARDS),)),
        Section(
            "form",
            (
                f"V = x'Cx + c0 theta, where C couples alpha with x and y with {last} alone",
                f"conditions (a) and (b), and (d) on the shell V >= {_down(bounded.beta_lower)}",
            ),
        ),
    )


def _absorbed(shown: Proven, proven: ProvenRobustness) -> Section:
    """What the funnels absorb under which law; every amount rounded down."""
    vehicle = shown.claims.problem.vehicle
    units = units_of(vehicle)
    law, meanwhile = _law(shown, proven)

    def by_state(amounts: Sequence[fmpq], units: Sequence[str]) -> str:
        entries = zip(vehicle.states, amounts, units, strict=True)
        return ", ".join(f"{name} {_down(amount)} {unit}".rstrip() for name, amount, unit in entries)

    def rates(amounts: Sequence[fmpq]) -> str:
        return by_state(amounts, [RATES[unit] for unit in units])

    alone, together = proven.alone, proven.together
    by_speed = tuple(
        f"control period, of inputs chosen at a speed of the path up to {about(upper)} m/s: {_down(own.period)} s"
        for (_, upper), own in zip(proven.bands, proven.by_speed, strict=True)
    )
    return Section(
        "robustness",
        (
            f"under a law whose inputs reach {law[0]}, one of the following; inputs are chosen at every moment, unless "
            "they are held",
            *law[1:],
            f"control period: inputs are held for {_down(alone.period)} s{_frequency(alone.period)}{meanwhile}",
            *by_speed,
            f"delay: inputs answer what was measured {_down(alone.delay)} s ago, theta with it, once it has come",
            f"disturbance: in one state a rate is off by {rates(alone.disturbance)}",
            f"measurement: in one state it is off by {by_state(alone.pose_error, units)}, from starts in V <= "
            f"{_down(proven.pose_level)}",
            f"or all at once, in every state, from starts in V <= {_down(proven.level)}: held for "
            f"{_down(together.period)} s, rates off by {rates(together.disturbance)}, a measurement of "
            f"{_down(together.delay)} s ago off by {by_state(together.pose_error, units)}",
            *_sampled(proven.sampled, tuple(shown.claims.problem.inputs)),
        ),
    )


def _sampled(claim: SampledClaim | None, inputs: Sequence[str]) -> tuple[str, ...]:
    """What is proven of a law that looks one hold ahead."""
    if claim is None:
        return ()
    held = (
        f"or, under a law that looks one hold ahead and takes one of {len(claim.choices)} inputs: each is held for any "
        f"time up to {_down(claim.period)} s{_frequency(claim.period)}, and on the shell V falls at "
        f"{_down(claim.decrease)} 1/s or more from one choice to the next"
    )
    late = claim.start_up
    if late is None:
        return (held,)
    first = ", ".join(f"{name} {about(value)}" for name, value in zip(inputs, claim.choices[late.choice], strict=True))
    return (
        held,
        f"that law may see poses up to {_down(late.delay)} s late, if it knows their age and the inputs held since: it "
        f"predicts; a car that holds {first} until it acts on its first pose, within that delay, has to start in "
        f"V <= {_down(late.level)}, and so early that theta is before the end of the path, or of the lap, by then",
    )


def _law(shown: Proven, proven: ProvenRobustness) -> tuple[tuple[str, ...], str]:
    """What a law has to reach, with what it is told of each funnel where that is not said yet; and what it bears."""
    claims = shown.claims
    if not claims.parts:
        return (LAW_EVERYWHERE,), ", whatever curvature and acceleration do meanwhile"
    numbers = proven.law_numbers if len(proven.law_numbers) > 1 or shown.falls else ()
    each = tuple(_law_numbers(index, one) for index, one in enumerate(numbers))
    if not shown.falls:
        return (LAW, *each), ""
    problem = claims.problem
    end = " and ends in G" if problem.goal else "" if problem.is_lap else ", V at the end being another than above"
    return (LAW_IN_TURN, *each), f", whatever the path does meanwhile, and the car stays in the funnels{end}"


def _law_numbers(index: int, own: LawNumbers) -> str:
    per_metre, bounds = own.margin_per_metre, own.bounds
    said = f"funnel {index}: lambda = {_down(own.margin)} 1/s, shell from {_up(own.shell)}"
    if per_metre is None or bounds is None:
        return said
    return (
        f"{said}, inner {_up(own.inner)}, {_down(per_metre)} per metre, curvature in "
        f"{_interval(bounds.curvature, OUTWARDS)} 1/m, acceleration in {_interval(bounds.acceleration, OUTWARDS)} m/s^2"
    )


def units_of(vehicle: VehicleClaim) -> tuple[str, ...]:
    """Of its states: those of a pose, which come first, and what is known of the others; "" where nothing is."""
    if vehicle.name in KNOWN_VEHICLES:
        return KNOWN_VEHICLES[vehicle.name].state_units
    known = POSE_UNITS if vehicle.states[: len(POSE)] == POSE else ()
    return (*known, *[""] * (len(vehicle.states) - len(known)))


def _frequency(period: fmpq) -> str:
    return f" (control at {_up(1 / period)} Hz or faster)" if period else ""


def _vehicle(vehicle: VehicleClaim, assumptions: Assumptions | None) -> Section:
    """Its name; of one that the checker does not know, what is taken for granted too."""
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


def _path(name: str, course: PlacedPath) -> str:
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


def _every_path(bounds: Bounds) -> tuple[str, ...]:
    """Those that something is proven for."""
    return (
        "every one whose position, heading and speed are continuous",
        f"speed in {_interval(bounds.speed, INWARDS)} m/s",
        f"curvature in {_interval(bounds.curvature, INWARDS)} 1/m, which may jump",
        f"acceleration dv/dtheta in {_interval(bounds.acceleration, INWARDS)} m/s^2",
    )


def _paths(bounds: Bounds) -> str:
    """Those that a refuted tube speaks of."""
    return (
        f"every one with speed in {_interval(bounds.speed, OUTWARDS)} m/s, curvature in "
        f"{_interval(bounds.curvature, OUTWARDS)} 1/m, acceleration in {_interval(bounds.acceleration, OUTWARDS)} m/s^2"
    )


def _sets(problem: ProblemClaim, inlet: str, goal: str) -> Section:
    """I, G, S and obstacles, the half-axes rounded as told; S as G."""
    safe = "no S: the whole plane is safe" if problem.safe is None else _safe_box(problem.safe, goal)
    return Section(
        "sets",
        (
            _deviations(problem.vehicle),
            "no I is asked" if problem.inlet is None else _half_axes("I", problem.inlet, inlet),
            "no G is asked" if problem.goal is None else _half_axes("G", problem.goal, goal),
            safe,
            *_obstacles(problem.surroundings),
        ),
    )


def _deviations(vehicle: VehicleClaim) -> str:
    entries = zip(vehicle.states, units_of(vehicle), strict=True)
    return f"of deviations {', '.join(f'{name} ({unit})' if unit else name for name, unit in entries)}"


def _half_axes(name: str, values: Sequence[fmpq], rounding: str) -> str:
    return f"{name} with half-axes ({_numbers(values, rounding)})"


def _safe_box(values: Sequence[fmpq], rounding: str) -> str:
    return f"S with half-widths ({_numbers(values, rounding)})"


def _obstacles(surroundings: SurroundingsClaim) -> tuple[str, ...]:
    """A clause, where there are any."""
    if surroundings.is_empty:
        return ()
    discs = " and ".join(
        f"radius {_down(disc.radius)} m at offset {about(disc.offset)} m" for disc in surroundings.footprint
    )
    obstacles, walls = len(surroundings.obstacles), surroundings.walls
    named = [] if not obstacles else ["one obstacle" if obstacles == 1 else f"{obstacles} obstacles"]
    if walls:
        points = sum(len(wall.points) for wall in walls)
        named.append(f"{'one wall' if len(walls) == 1 else f'{len(walls)} walls'} through {points} points")
    verb = "stands" if obstacles + len(walls) == 1 else "stand"
    return (f"clear of {' and '.join(named)} that {verb} in the file, by a footprint of {discs}",)


def _kept(problem: ProblemClaim) -> str:
    """Where the car is said to stay, beside the funnel: in S, and its footprint clear of obstacles and walls."""
    around = problem.surroundings
    named = [name for name, some in (("obstacles", around.obstacles), ("walls", around.walls)) if some]
    clear = f", clear of the {' and '.join(named)}" if named else ""
    return ("" if problem.safe is None else ", inside S") + clear


def _inputs(problem: ProblemClaim, rounding: tuple[str, str]) -> str:
    box = ", ".join(f"{name} in {_interval(ends, rounding)}" for name, ends in problem.inputs.items())
    if problem.law is None:
        return box
    return f'{box}, all but u0 as the law "{problem.law.name}", a graph in the file, has them, or the nearer limit,'


def _templates(funnels: Sequence[FunnelClaim]) -> str:
    """Templates with their rates, each for the funnels that have it."""
    return "; ".join(_rates(own) for own in _by_template(funnels))


def _by_template(funnels: Sequence[FunnelClaim]) -> list[list[FunnelClaim]]:
    """Funnels that change with θ by their templates, and those that do not."""
    found: dict[str, list[FunnelClaim]] = {}
    for funnel in funnels:
        found.setdefault(funnel.level.name if funnel.margin_per_metre is None else "", []).append(funnel)
    return list(found.values())


def _rates(funnels: Sequence[FunnelClaim]) -> str:
    if funnels[0].margin_per_metre is not None:
        return "V does not change with theta"
    level = funnels[0].level
    rates = ", ".join(about(funnel.level.rate) for funnel in funnels[:SHOWN])
    more = ", ..." if len(funnels) > SHOWN else ""
    return f"template {level.name}, {level.rate_name} {rates}{more} 1/s"


def _shell(funnels: Sequence[FunnelClaim], rounding: str) -> str:
    return f"shell from {decimal_text(max(funnel.beta_lower for funnel in funnels), rounding)}"


def _time(arrival: Range) -> str:
    return f"{_down(arrival[0])} to {_up(arrival[1])} s"


def _interval(ends: Range, rounding: tuple[str, str]) -> str:
    lower, upper = (decimal_text(end, how) for end, how in zip(ends, rounding, strict=True))
    return f"[{lower}, {upper}]"


def _down(value: fmpq) -> str:
    return decimal_text(value, ROUND_FLOOR)


def _up(value: fmpq) -> str:
    return decimal_text(value, ROUND_CEILING)


def _numbers(values: Sequence[fmpq], rounding: str) -> str:
    return ", ".join(decimal_text(value, rounding) for value in values)
