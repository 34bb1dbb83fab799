"""What a file shows, in English: the only place where the checker's records become sentences.

A sentence follows from what is proven: a number without a short decimal form is rounded so that the sentence says less,
or is said to be "about" its decimal where it only names what the file speaks of. So I and λ of a proven funnel are
rounded down, G, S, its shell and its inputs' limits outwards; of a refuted one it is the other way round.
"""

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR
from typing import NamedTuple

from flint import fmpq

from cfjax.check.amounts import Robustness
from cfjax.check.bounds import Bounds, Range, place_of
from cfjax.check.certified import LAW_SHARE
from cfjax.check.chain import ChainClaim
from cfjax.check.chain_robustness import Told
from cfjax.check.containment import half_widths
from cfjax.check.document import Course, FunnelClaim, ProblemClaim, VehicleClaim
from cfjax.check.meaning import Assumptions
from cfjax.check.proven import ProvenChain, ProvenFunnels, ProvenTube, Refuted, Shown, Violation
from cfjax.check.rational import about, decimal_text, sqrt_upper
from cfjax.check.sampled import SampledClaim
from cfjax.check.surroundings import Surroundings
from cfjax.check.vehicle import KNOWN_VEHICLES, POSE_UNITS


SHARE_TEXT = decimal_text(LAW_SHARE, ROUND_CEILING)
LAW = f"V' <= -{SHARE_TEXT} lambda in the shell"
LAW_IN_TUBE = (
    f"{LAW} and V' <= -{SHARE_TEXT} v_r times the margin per metre, for every curvature and acceleration of the tube "
    "at once"
)
SHOWN = 4  # funnels whose rates are printed
RATES = {"rad": "rad/s", "m": "m/s", "m/s": "m/s^2", "": "a second"}  # of a state with such a unit
LATERAL = 1  # of a pose
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
}


class Section(NamedTuple):
    """What is said under one heading: a list of clauses, without full stops."""

    heading: str
    clauses: tuple[str, ...]

    @property
    def paragraph(self) -> str:
        """The same in one line of prose."""
        return f"{self.heading}: {'; '.join(self.clauses)}."


def sections(shown: Shown, robustness: Robustness | None = None) -> tuple[Section, ...]:
    """What is shown, what it speaks of, what it guarantees and, of something proven, what it absorbs."""
    match shown:
        case ProvenFunnels():
            said = _funnels_proven(shown)
        case ProvenTube():
            said = _tube_proven(shown)
        case ProvenChain():
            said = _chain_proven(shown)
        case Refuted():
            return _refuted(shown)
    return said if robustness is None else (*said, _absorbed(shown, robustness))


def _funnels_proven(proven: ProvenFunnels) -> tuple[Section, ...]:
    problem, course = proven.problem, proven.course
    kept = _kept(problem.safe is not None, problem.surroundings)
    again = ", and from there lap after lap for ever" if course.closed else ""
    return (
        Section("PROVEN", ("a control funnel function along a path",)),
        _vehicle(problem.vehicle, proven.assumptions),
        Section("path", (_path(problem.path, course),)),
        _sets(problem, ROUND_FLOOR, ROUND_CEILING),
        Section(
            "guarantee",
            (
                f"from every start in I at theta = 0, inputs {_inputs(problem, OUTWARDS)} suffice to keep the car in "
                f"the funnel V <= 1{kept}, until it arrives in G after {_time(proven.arrival)}{again}",
                f"the funnel: {_templates(proven.funnels)}, {_shell(proven.funnels, ROUND_CEILING)}",
                f"V decreases there with margin lambda = {_down(min(proven.margins))} 1/s or more",
            ),
        ),
    )


def _tube_proven(proven: ProvenTube) -> tuple[Section, ...]:
    problem, funnel, bounds = proven.problem, proven.funnel, proven.bounds
    widths = _numbers(half_widths(funnel.shape), ROUND_CEILING)
    kept = ("" if problem.goal is None else ", inside G") + _kept(problem.safe is not None, problem.surroundings)
    return (
        Section("PROVEN", ("one control funnel function for every path within bounds",)),
        _vehicle(problem.vehicle, proven.assumptions),
        Section(
            "path",
            (
                "every one whose position, heading and speed are continuous",
                f"speed in {_interval(bounds.speed, INWARDS)} m/s",
                f"curvature in {_interval(bounds.curvature, INWARDS)} 1/m, which may jump",
                f"acceleration dv/dtheta in {_interval(bounds.acceleration, INWARDS)} m/s^2",
            ),
        ),
        _sets(problem, ROUND_FLOOR, ROUND_CEILING),
        Section(
            "guarantee",
            (
                f"from every start in I, anywhere along the path, inputs {_inputs(problem, OUTWARDS)} suffice to keep "
                f"the car in the tube V <= 1{kept}, for ever",
                f"the tube: {_shell((funnel,), ROUND_CEILING)}, half-widths ({widths})",
                f"V decreases there with margin lambda = {_down(funnel.margin)} 1/s and "
                f"{_down(proven.margin_per_metre)} per metre of the reference at u0 = 1, or more",
                f"inputs that do so bring a car from V = 1 inside V <= {_up(funnel.beta_inner)} within "
                f"{_up(proven.contraction)} m of the path",
            ),
        ),
    )


def _chain_proven(proven: ProvenChain) -> tuple[Section, ...]:
    claim, tubes = proven.claim, [run.tube for run in proven.runs]
    inputs = ", ".join(
        f"{name} in {_interval((min(lower), max(upper)), OUTWARDS)}"
        for name in tubes[0].inputs
        for lower, upper in [zip(*(tube.inputs[name] for tube in tubes), strict=True)]
    )
    ending = (
        f"for ever, lap after lap of {_time(proven.arrival)}"
        if claim.closed
        else f"until it arrives after {_time(proven.arrival)} with V <= {_up(proven.finish)}"
    )
    started = "in I" if claim.sets else "with V < 1 in the first tube"
    kept = _kept(claim.sets is not None and claim.sets.safe is not None, claim.surroundings)
    arrives = ", at the end inside G" if claim.sets else ""
    widest = _up(max(sqrt_upper(tube.inverse[LATERAL, LATERAL]) for tube in tubes))
    return (
        Section("PROVEN", ("a path that is held by tubes in turn",)),
        _vehicle(proven.vehicle, proven.assumptions),
        Section(
            "path",
            (
                f'"{claim.name}", whose {len(claim.reference.pieces)} pieces of {about(claim.reference.length)} m '
                "stand in the file",
            ),
        ),
        *_sets_of_chain(proven.vehicle, claim),
        Section(
            "guarantee",
            (
                f"started {started}, under any law that enforces {about(LAW_SHARE)} of the tubes' margins, the car "
                f"stays in the tubes{kept}, {ending}{arrives}",
                f"inputs: {inputs}",
                f"tubes in turn: {len(tubes)}, of lateral half-width {widest} m or less; proven certificates: "
                f"{len(claim.tubes)}, links: {proven.links}",
            ),
        ),
    )


def _sets_of_chain(vehicle: VehicleClaim, claim: ChainClaim) -> tuple[Section, ...]:
    sets, said = claim.sets, _obstacles(claim.surroundings)
    if sets is not None:
        safe = () if sets.safe is None else (_safe_box(sets.safe, ROUND_CEILING),)
        ends = (_half_axes("I", sets.inlet, ROUND_FLOOR), _half_axes("G", sets.goal, ROUND_CEILING))
        said = (_deviations(vehicle), *ends, *safe, *said)
    return (Section("sets", said),) if said else ()


def _refuted(refuted: Refuted) -> tuple[Section, ...]:
    problem, witness = refuted.problem, refuted.witness
    course, margin = problem.course, _up(refuted.funnels[witness.funnel].margin)
    shell = _shell(refuted.funnels, ROUND_FLOOR)
    if isinstance(course, Bounds):
        candidate, path = shell, _paths(course)
    else:
        candidate, path = f"{_templates(refuted.funnels)}, {shell}", _path(problem.path, course)
    place = place_of(refuted.extremes, witness.reference) if refuted.violation is Violation.DECREASE else ""
    at = ", ".join(f"{name} = {about(value)}" for name, value in zip(problem.vehicle.states, witness.x, strict=True))
    return (
        Section("REFUTED", (f"{candidate} with margin lambda = {margin} 1/s is no control funnel function",)),
        _vehicle(problem.vehicle, refuted.assumptions),
        Section("path", (path,)),
        _sets(problem, ROUND_CEILING, ROUND_FLOOR),
        Section("inputs", (_inputs(problem, INWARDS),)),
        Section("witness", (f"at {place}theta = {about(witness.theta)} s, {at}", VIOLATED[refuted.violation])),
    )


def _absorbed(shown: ProvenFunnels | ProvenTube | ProvenChain, proven: Robustness) -> Section:
    """What the funnels absorb under which law; every amount rounded down."""
    match shown:
        case ProvenFunnels():
            vehicle, law, meanwhile = shown.problem.vehicle, (LAW,), ""
        case ProvenTube():
            vehicle, law = shown.problem.vehicle, (LAW_IN_TUBE,)
            meanwhile = ", whatever curvature and acceleration do meanwhile"
        case ProvenChain():
            vehicle, law, meanwhile = shown.vehicle, _law_in_tubes(shown, proven), _in_tubes(shown)
    units = units_of(vehicle)

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
            *_sampled(proven.sampled),
        ),
    )


def _sampled(claim: SampledClaim | None) -> tuple[str, ...]:
    """What is proven of a law that looks one hold ahead."""
    if claim is None:
        return ()
    return (
        f"or, under a law that looks one hold ahead and takes one of {len(claim.choices)} inputs: each is held for any "
        f"time up to {_down(claim.period)} s{_frequency(claim.period)}, and on the shell V falls at "
        f"{_down(claim.decrease)} 1/s or more from one choice to the next",
    )


def units_of(vehicle: VehicleClaim) -> tuple[str, ...]:
    """Of its states: those of a pose, which come first, and what is known of the others; "" where nothing is."""
    if vehicle.name in KNOWN_VEHICLES:
        return KNOWN_VEHICLES[vehicle.name].state_units
    return (*POSE_UNITS, *[""] * (len(vehicle.states) - len(POSE_UNITS)))


def _frequency(period: fmpq) -> str:
    return f" (control at {_up(1 / period)} Hz or faster)" if period else ""


def _law_in_tubes(shown: ProvenChain, proven: Robustness) -> tuple[str, ...]:
    """With what the law is told of each tube, in the order in which the file has them."""
    told: dict[int, str] = {}
    for run, bounds, (_, _, index) in zip(shown.runs, proven.along, shown.claim.runs, strict=True):
        margin, per_metre, shell, inner = Told.of(run.tube)
        told[index] = (
            f"tube {index}: lambda = {_down(margin)} 1/s, {_down(per_metre)} per metre, shell from {_up(shell)}, inner "
            f"{_up(inner)}, curvature in {_interval(bounds.curvature, OUTWARDS)} 1/m, acceleration in "
            f"{_interval(bounds.acceleration, OUTWARDS)} m/s^2"
        )
    return (
        f"V' <= -{SHARE_TEXT} times the larger of lambda and v_r times the margin per metre, below the shell times V "
        "over its level, down to the inner one, for every curvature and acceleration of the bounds at once",
        *(text for _, text in sorted(told.items())),
    )


def _in_tubes(shown: ProvenChain) -> str:
    claim = shown.claim
    end = " and ends in G" if claim.sets else "" if claim.closed else ", V at the end being another than above"
    return f", whatever the path does meanwhile, and the car stays in the tubes{end}"


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


def _path(name: str, course: Course) -> str:
    named, pieces = f'"{name}"', course.reference.pieces
    if len(pieces) == 1 and pieces[0].is_constant:
        turning, moving = (about(coefficients[0]) for coefficients in (pieces[0].turn_rate, pieces[0].speed))
        return (
            f"{named} (turning rate {turning} rad/s, speed {moving} m/s, theta from 0 to {about(pieces[0].duration)} s)"
        )
    count = len(course.segments)
    segments = f"{count} segments, " if count > 1 else ""
    return (
        f"{named}, whose {len(pieces)} pieces stand in the file ({segments}{about(course.reference.length)} m, theta "
        f"from 0 to {about(course.reference.duration)} s)"
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
            _half_axes("I", problem.inlet, inlet),
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


def _obstacles(surroundings: Surroundings) -> tuple[str, ...]:
    """A clause, where there are any."""
    obstacles, footprint = surroundings
    discs = " and ".join(f"radius {_down(disc.radius)} m at offset {about(disc.offset)} m" for disc in footprint)
    count = "one obstacle that stands" if len(obstacles) == 1 else f"{len(obstacles)} obstacles that stand"
    told = f"clear of {count} in the file, by a footprint of {discs}"
    return (told,) if obstacles else ()


def _kept(has_safe: bool, surroundings: Surroundings) -> str:
    """Where the car is said to stay, beside the funnel: in S, and its footprint clear of the obstacles."""
    return (", inside S" if has_safe else "") + (", clear of the obstacles" if surroundings.obstacles else "")


def _inputs(problem: ProblemClaim, rounding: tuple[str, str]) -> str:
    return ", ".join(f"{name} in {_interval(ends, rounding)}" for name, ends in problem.inputs.items())


def _templates(funnels: Sequence[FunnelClaim]) -> str:
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
