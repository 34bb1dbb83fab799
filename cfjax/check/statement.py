"""What a file shows, in English: the only place where the checker's records become sentences.

A sentence follows from what is proven: a number without a short decimal form is rounded so that the sentence says less,
or is said to be "about" its decimal where it only names what the file speaks of. So I and λ of a proven funnel are
rounded down, G, S, its shell and its inputs' limits outwards; of a refuted one it is the other way round.
"""

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR

from flint import fmpq

from cfjax.check.amounts import Robustness
from cfjax.check.bounds import Bounds, Range, place_of
from cfjax.check.certified import LAW_SHARE
from cfjax.check.chain import SetsClaim
from cfjax.check.chain_robustness import Told
from cfjax.check.containment import half_widths
from cfjax.check.document import Course, FunnelClaim, ProblemClaim, VehicleClaim
from cfjax.check.meaning import Assumptions
from cfjax.check.proven import ProvenChain, ProvenFunnels, ProvenTube, Refuted, Shown, Violation
from cfjax.check.rational import about, decimal_text, sqrt_upper
from cfjax.check.surroundings import Surroundings
from cfjax.check.vehicle import KNOWN_VEHICLES


SHARE_TEXT = decimal_text(LAW_SHARE, ROUND_CEILING)
LAW = f"reach V' <= -{SHARE_TEXT} lambda in the shell"
LAW_IN_TUBE = (
    f"{LAW} and V' <= -{SHARE_TEXT} v_r times the margin per metre, for every curvature and acceleration of the tube "
    "at once,"
)
SHOWN = 4  # funnels whose rates are printed
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


def paragraphs(shown: Shown, robustness: Robustness | None = None) -> tuple[str, ...]:
    """What is shown and, of something proven, what it absorbs; a subject each."""
    match shown:
        case ProvenFunnels():
            said = _funnels_proven(shown)
        case ProvenTube():
            said = _tube_proven(shown)
        case ProvenChain():
            said = _chain_proven(shown)
        case Refuted():
            return _refuted(shown)
    return said if robustness is None else (*said, *_absorbed(shown, robustness))


def _funnels_proven(proven: ProvenFunnels) -> tuple[str, ...]:
    problem, course = proven.problem, proven.course
    again = ", and from there lap after lap for ever" if course.closed else ""
    return (
        f"PROVEN: a control funnel function for {_vehicle(problem.vehicle, proven.assumptions)} along "
        f"{_path(problem.path, course)}.",
        _sets(problem, ROUND_FLOOR, ROUND_CEILING),
        f"From every start in I at theta = 0, inputs {_inputs(problem, OUTWARDS)} suffice to keep the car in the "
        f"funnel V <= 1 ({_templates(proven.funnels)}, {_shell(proven.funnels, ROUND_CEILING)}), inside "
        f"{_safe(problem, ROUND_CEILING)}, until it arrives in G after {_time(proven.arrival)}{again}; V decreases "
        f"there with margin lambda = {_down(min(proven.margins))} 1/s or more.",
    )


def _tube_proven(proven: ProvenTube) -> tuple[str, ...]:
    problem, funnel, bounds = proven.problem, proven.funnel, proven.bounds
    widths = _numbers(half_widths(funnel.shape), ROUND_CEILING)
    kept = "" if problem.goal is None else "inside G and "
    return (
        f"PROVEN: one control funnel function for {_vehicle(problem.vehicle, proven.assumptions)} along every path "
        f"whose pose and heading are continuous, whose speed is continuous in {_interval(bounds.speed, INWARDS)} m/s, "
        f"whose curvature, which may jump, lies in {_interval(bounds.curvature, INWARDS)} 1/m and whose acceleration "
        f"dv/dtheta lies in {_interval(bounds.acceleration, INWARDS)} m/s^2.",
        _sets(problem, ROUND_FLOOR, ROUND_CEILING),
        f"From every start in I, anywhere along the path, inputs {_inputs(problem, OUTWARDS)} suffice to keep the car "
        f"in the tube V <= 1 ({_shell((funnel,), ROUND_CEILING)}, half-widths ({widths})), {kept}inside "
        f"{_safe(problem, ROUND_CEILING)}, for ever; V decreases there with margin lambda = {_down(funnel.margin)} 1/s "
        f"and {_down(proven.margin_per_metre)} per metre of the reference at u0 = 1, or more.",
        f"Inputs that do so bring a car from V = 1 inside V <= {_up(funnel.beta_inner)} within "
        f"{_up(proven.contraction)} m of the path.",
    )


def _chain_proven(proven: ProvenChain) -> tuple[str, ...]:
    claim, tubes = proven.claim, [run.tube for run in proven.runs]
    inputs = ", ".join(
        f"{name} in {_interval((min(lower), max(upper)), OUTWARDS)}"
        for name in tubes[0].inputs
        for lower, upper in [zip(*(tube.inputs[name] for tube in tubes), strict=True)]
    )
    started, inside = "Started with V < 1 in the first tube", ""
    if claim.sets:
        started = (
            f"Deviations ({', '.join(tubes[-1].states)}): started in I with half-axes "
            f"({_numbers(claim.sets.inlet, ROUND_FLOOR)})"
        )
        inside = _ends_inside(claim.sets)
    ending = (
        f"for ever, lap after lap of {_time(proven.arrival)}"
        if claim.closed
        else f"until it arrives after {_time(proven.arrival)} with V <= {_up(proven.finish)}"
    )
    if claim.surroundings.obstacles:
        inside += f". It stays {_clear(claim.surroundings)}"
    widths = _numbers([sqrt_upper(tube.inverse[LATERAL, LATERAL]) for tube in tubes], ROUND_CEILING)
    return (
        f"PROVEN: {_vehicle(proven.vehicle, proven.assumptions)} can be held in tubes along the path "
        f'"{claim.name}", whose {len(claim.reference.pieces)} pieces of {about(claim.reference.length)} m stand in the '
        f"file, by inputs {inputs}.",
        f"{started}, under any law that enforces {about(LAW_SHARE)} of the tubes' margins, the car stays in them "
        f"{ending}{inside}.",
        f"Tubes in turn, by lateral half-width: {widths} m. Proven certificates: {len(claim.tubes)}, links: "
        f"{proven.links}.",
    )


def _ends_inside(sets: SetsClaim) -> str:
    safe = "" if sets.safe is None else f". It stays in S with half-widths ({_numbers(sets.safe, ROUND_CEILING)})"
    return f", at the end inside G with half-axes ({_numbers(sets.goal, ROUND_CEILING)}){safe}"


def _refuted(refuted: Refuted) -> tuple[str, ...]:
    problem, witness = refuted.problem, refuted.witness
    course, vehicle = problem.course, _vehicle(problem.vehicle, refuted.assumptions)
    margin = _up(refuted.funnels[witness.funnel].margin)
    shell = _shell(refuted.funnels, ROUND_FLOOR)
    if isinstance(course, Bounds):
        candidate, path = shell, _paths(course)
    else:
        candidate, path = f"{_templates(refuted.funnels)}, {shell}", _path(problem.path, course)
    place = place_of(refuted.extremes, witness.reference) if refuted.violation is Violation.DECREASE else ""
    at = ", ".join(f"{name} = {about(value)}" for name, value in zip(problem.vehicle.states, witness.x, strict=True))
    return (
        f"REFUTED: {candidate} with margin lambda = {margin} 1/s is no control funnel function for {vehicle} along "
        f"{path}.",
        f"{_sets(problem, ROUND_CEILING, ROUND_FLOOR)} Safe is {_safe(problem, ROUND_FLOOR)}. Inputs "
        f"{_inputs(problem, INWARDS)}.",
        f"At {place}theta = {about(witness.theta)} s, {at}: {VIOLATED[refuted.violation]}.",
    )


def _absorbed(shown: ProvenFunnels | ProvenTube | ProvenChain, proven: Robustness) -> tuple[str, ...]:
    """What the funnels absorb under which law; every amount rounded down."""
    match shown:
        case ProvenFunnels():
            states, law, meanwhile = shown.problem.vehicle.states, LAW, ""
        case ProvenTube():
            states, law, meanwhile = shown.problem.vehicle.states, LAW_IN_TUBE, _at_speeds(proven)
        case ProvenChain():
            states, law, meanwhile = shown.vehicle.states, _law_in_tubes(shown, proven), _in_tubes(shown)

    def each(amounts: Sequence[fmpq]) -> str:
        return ", ".join(f"{name} {_down(amount)}" for name, amount in zip(states, amounts, strict=True))

    alone, together = proven.alone, proven.together
    return (
        f"A law whose inputs {law} may hold them for {_down(alone.period)} s{meanwhile}; or, chosen at every moment, "
        f"they absorb in one state a rate that is off by ({each(alone.disturbance)}) a second; or a measured one that "
        f"is off by ({each(alone.pose_error)}), from starts in V <= {_down(proven.pose_level)}; or, once it has come, "
        f"what was measured {_down(alone.delay)} s ago, theta with it.",
        f"All at once, in every state: held for {_down(together.period)} s, ({each(together.disturbance)}) a second, "
        f"({each(together.pose_error)}), {_down(together.delay)} s ago, from starts in V <= {_down(proven.level)}.",
    )


def _at_speeds(proven: Robustness) -> str:
    by_speed = ", ".join(
        f"{_down(own.period)} s up to {about(upper)} m/s"
        for (_, upper), own in zip(proven.bands, proven.by_speed, strict=True)
    )
    return f" (chosen at a speed of the path: {by_speed}), whatever curvature and acceleration do meanwhile"


def _law_in_tubes(shown: ProvenChain, proven: Robustness) -> str:
    """With what the law is told of each tube, in the order in which the file has them."""
    told: dict[int, str] = {}
    for run, bounds, (_, _, index) in zip(shown.runs, proven.along, shown.claim.runs, strict=True):
        margin, per_metre, shell, inner = Told.of(run.tube)
        told[index] = (
            f"tube {index}: lambda = {_down(margin)} 1/s, {_down(per_metre)} per metre, shell from {_up(shell)}, inner "
            f"{_up(inner)}, curvature in {_interval(bounds.curvature, OUTWARDS)} 1/m, acceleration in "
            f"{_interval(bounds.acceleration, OUTWARDS)} m/s^2"
        )
    each = "; ".join(text for _, text in sorted(told.items()))
    return (
        f"reach V' <= -{SHARE_TEXT} times the larger of lambda and v_r times the margin per metre, below the shell "
        "times V over its level, down to the inner one, for every curvature and acceleration of the bounds at once "
        f"({each}),"
    )


def _in_tubes(shown: ProvenChain) -> str:
    claim = shown.claim
    end = " and end in G" if claim.sets else "" if claim.closed else ", V at the end being another than above"
    return f", whatever the path does meanwhile, and stay in the tubes{end}"


def _vehicle(vehicle: VehicleClaim, assumptions: Assumptions | None) -> str:
    """Its name; of one that the checker does not know, what is taken for granted too."""
    values = ", ".join(f"{label} {about(value)}" for label, value in vehicle.parameters.items())
    named = f'the vehicle "{vehicle.name}" ({values})' if values else f'the vehicle "{vehicle.name}"'
    if vehicle.name in KNOWN_VEHICLES:
        return named
    unknown = f"{named}, a name unknown to this checker: its dynamics are those of the graph in the file,"
    if assumptions is None:
        return unknown
    on = "speed and turning rate" if assumptions.follows_turning else "speed"
    looks = (
        "which are those of a body whose reference looks along the path"
        if assumptions.is_body
        else "its reference looks along the path, or at one angle to it all along"
    )
    return f"{unknown} {looks}, and what else it has of states depends on the path's {on} alone,"


def _path(name: str, course: Course) -> str:
    named, pieces = f'the path "{name}"', course.reference.pieces
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
        f"every path with speed in {_interval(bounds.speed, OUTWARDS)} m/s, curvature in "
        f"{_interval(bounds.curvature, OUTWARDS)} 1/m, acceleration in {_interval(bounds.acceleration, OUTWARDS)} m/s^2"
    )


def _sets(problem: ProblemClaim, inlet: str, goal: str) -> str:
    """The half-axes, rounded as told."""
    ends = "no G is asked" if problem.goal is None else f"G ({_numbers(problem.goal, goal)})"
    return (
        f"Deviations ({', '.join(problem.vehicle.states)}): I has half-axes ({_numbers(problem.inlet, inlet)}), {ends}."
    )


def _safe(problem: ProblemClaim, rounding: str) -> str:
    whole = "the whole plane (no S)"
    box = whole if problem.safe is None else f"S with half-widths ({_numbers(problem.safe, rounding)})"
    if not problem.surroundings.obstacles:
        return box
    clear = _clear(problem.surroundings)
    return clear if problem.safe is None else f"{box}, {clear}"


def _clear(surroundings: Surroundings) -> str:
    obstacles, footprint = surroundings
    discs = " and ".join(f"radius {_down(disc.radius)} m at offset {about(disc.offset)} m" for disc in footprint)
    count = "one obstacle that stands" if len(obstacles) == 1 else f"{len(obstacles)} obstacles that stand"
    return f"clear of {count} in the file, by a footprint of {discs}"


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
