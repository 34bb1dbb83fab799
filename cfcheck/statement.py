"""What a file proves, refutes or bounds, in English; the words for vehicle, path and sets are in `cfcheck.wording`.

Here the checker's records become sentences, and nowhere else. A sentence follows from what is proven. So I and λ of a
proven funnel are rounded down, G, S, its shell and its inputs' limits outwards; in a refutation it is the other way
round.
"""

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR

from flint import fmpq

from cfcheck.claims.document import Claims
from cfcheck.claims.proven import Bounded, Proven, Refuted, Shown, Violation, half_widths
from cfcheck.claims.references import place_of
from cfcheck.clearance.corridor import SIDES, are_closed
from cfcheck.clearance.surroundings import SurroundingsClaim
from cfcheck.exact.rational import Range, about, decimal_text
from cfcheck.kernel.funnel import LAW_SHARE, FunnelClaim
from cfcheck.path.bounds import Bounds
from cfcheck.robustness.amounts import LawNumbers, ProvenRobustness
from cfcheck.robustness.ranges import SampledClaim
from cfcheck.vehicle.model import POSE
from cfcheck.wording import (
    INWARDS,
    OUTWARDS,
    Section,
    deviations_text,
    down,
    half_axes_text,
    inputs_text,
    interval,
    kept_text,
    numbers_text,
    path_text,
    proven_paths,
    refuted_paths,
    sets_section,
    units_of,
    up,
    vehicle_section,
)


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


def sections(shown: Shown, robustness: ProvenRobustness | None = None) -> tuple[Section, ...]:
    """The result, its vehicle, path and sets, the guarantee, and for a proven funnel the amounts that it absorbs."""
    if isinstance(shown, Refuted):
        return _refuted(shown)
    if isinstance(shown, Bounded):
        return _bounded(shown)
    problem, course = shown.claims.problem, shown.claims.problem.course
    if isinstance(course, Bounds):
        title = "one control funnel function for every path within bounds"
        path, guarantee = proven_paths(course), _everywhere(shown)
    else:
        title = "a control funnel function along a path"
        path, guarantee = (path_text(problem.path, course),), _along(shown)
    said = (
        Section("PROVEN", (title,)),
        vehicle_section(problem.vehicle, shown.assumptions),
        Section("path", path),
        sets_section(problem, ROUND_FLOOR, ROUND_CEILING),
        Section("guarantee", guarantee),
    )
    return said if robustness is None else (*said, _absorbed(shown, robustness))


def _along(proven: Proven) -> tuple[str, ...]:
    """What is guaranteed along a path."""
    claims, problem, arrival = proven.claims, proven.claims.problem, proven.arrival
    assert arrival is not None  # of a path that lies somewhere
    started = "every start with V < 1" if problem.inlet is None else "every start in I"
    arrives = f"arrives with V <= {up(proven.finish)}" if problem.goal is None else "arrives in G"
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
    falls = f" and{where} {down(min(per_metre))} per metre of the reference at u0 = 1" if per_metre else ""
    said = (
        f"from {started} at theta = 0, inputs {inputs_text(problem, OUTWARDS)} suffice to keep the car in the funnel "
        f"V <= 1{kept_text(problem)}, until it {arrives} after {_time(arrival)}{again}",
        _between(problem.surroundings),
        law,
        turn,
        form,
        f"V decreases there with margin lambda = {down(min(proven.margins))} 1/s{falls} or more",
    )
    return tuple(clause for clause in said if clause)


def _between(surroundings: SurroundingsClaim) -> str:
    """Where a corridor is, and that the car is in it."""
    if not surroundings.corridor:
        return ""
    left, right = (next(index for index, wall in enumerate(surroundings.walls) if wall.side == side) for side in SIDES)
    stays = "; inside one of these laps and outside the other, as the body stays"
    return (
        f"the path begins between wall {left}, to its left, and wall {right}, to its right, which the body does not "
        f"cross{stays if are_closed(surroundings.corridor) else ''}"
    )


def _lateral(claims: Claims) -> str:
    """How far a car may be beside the path, where its states begin with a pose."""
    if claims.problem.vehicle.states[: len(POSE)] != POSE:
        return ""
    widest = max(half_widths(funnel.shape)[POSE.index("x")] for funnel in claims.driven)
    return f", lateral half-width {up(widest)} m"


def _everywhere(proven: Proven) -> tuple[str, ...]:
    """What is guaranteed along every path within bounds."""
    problem, (funnel, *_) = proven.claims.problem, proven.claims.driven
    assert proven.contraction is not None and proven.margin_per_metre is not None  # of what is invariant, as is proven
    started = "every start with V < 1" if problem.inlet is None else "every start in I"
    inside = "" if problem.goal is None else ", inside G"
    widths = numbers_text(half_widths(funnel.shape), ROUND_CEILING)
    return (
        f"from {started}, anywhere along the path, inputs {inputs_text(problem, OUTWARDS)} suffice to keep the car in "
        f"the tube V <= 1{inside}{kept_text(problem)}, for ever",
        f"the tube: {_shell((funnel,), ROUND_CEILING)}, half-widths ({widths})",
        f"V decreases there with margin lambda = {down(funnel.margin)} 1/s and {down(proven.margin_per_metre)} per "
        "metre of the reference at u0 = 1, or more",
        f"inputs that do so bring a car from V = 1 inside V <= {up(funnel.beta_inner)} within "
        f"{up(proven.contraction)} m of the path",
    )


def _refuted(refuted: Refuted) -> tuple[Section, ...]:
    claims, witness = refuted.claims, refuted.witness
    problem, course, funnel = claims.problem, claims.problem.course, claims.driven[0]
    if claims.parts:
        funnel = claims.driven[claims.parts[witness.leg].funnel]
    shell, margin = _shell((funnel,), ROUND_FLOOR), up(funnel.margin)
    if isinstance(course, Bounds):
        candidate, path = shell, refuted_paths(course)
    else:
        along = f" along leg {witness.leg}" if len(claims.parts) > 1 else ""
        candidate, path = f"{_templates((funnel,))}, {shell}{along}", path_text(problem.path, course)
    of_decrease = refuted.violation in (Violation.DECREASE, Violation.LAW)
    place = place_of(refuted.extremes, witness.reference) if of_decrease else ""
    at = ", ".join(f"{name} = {about(value)}" for name, value in zip(problem.vehicle.states, witness.x, strict=True))
    return (
        Section("REFUTED", (f"{candidate} with margin lambda = {margin} 1/s is no control funnel function",)),
        vehicle_section(problem.vehicle, refuted.assumptions),
        Section("path", (path,)),
        sets_section(problem, ROUND_CEILING, ROUND_FLOOR),
        Section("inputs", (inputs_text(problem, INWARDS),)),
        Section("witness", (f"at {place}theta = {about(witness.theta)} s, {at}", VIOLATED[refuted.violation])),
    )


def _bounded(bounded: Bounded) -> tuple[Section, ...]:
    problem, course = bounded.problem, bounded.problem.course
    assert not isinstance(course, Bounds) and problem.inlet and problem.goal  # of a bound, as is proven
    *_, last = problem.vehicle.states
    return (
        Section(
            "BOUNDED",
            (f"no control funnel function of this form has a margin of lambda = {up(bounded.margin)} 1/s or more",),
        ),
        vehicle_section(problem.vehicle, bounded.assumptions),
        Section("path", (path_text(problem.path, course),)),
        Section(
            "sets",
            (
                deviations_text(problem.vehicle),
                half_axes_text("I", problem.inlet, ROUND_CEILING),
                half_axes_text("G", problem.goal, ROUND_FLOOR),
                "S and obstacles are not looked at: they can only make margins smaller",
            ),
        ),
        Section("inputs", (inputs_text(problem, INWARDS),)),
        Section(
            "form",
            (
                f"V = x'Cx + c0 theta, where C couples alpha with x and y with {last} alone",
                f"conditions (a) and (b), and (d) on the shell V >= {down(bounded.beta_lower)}",
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
        return ", ".join(f"{name} {down(amount)} {unit}".rstrip() for name, amount, unit in entries)

    def rates(amounts: Sequence[fmpq]) -> str:
        return by_state(amounts, [RATES[unit] for unit in units])

    alone, together = proven.alone, proven.together
    by_speed = tuple(
        f"control period, of inputs chosen at a speed of the path up to {about(upper)} m/s: {down(own.period)} s"
        for (_, upper), own in zip(proven.bands, proven.by_speed, strict=True)
    )
    return Section(
        "robustness",
        (
            f"under a law whose inputs reach {law[0]}, one of the following; inputs are chosen at every moment, unless "
            "they are held",
            *law[1:],
            f"control period: inputs are held for {down(alone.period)} s{_frequency(alone.period)}{meanwhile}",
            *by_speed,
            f"delay: inputs answer what was measured {down(alone.delay)} s ago, theta with it, once it has come",
            f"disturbance: in one state a rate is off by {rates(alone.disturbance)}",
            f"measurement: in one state it is off by {by_state(alone.pose_error, units)}, from starts in V <= "
            f"{down(proven.pose_level)}",
            f"or all at once, in every state, from starts in V <= {down(proven.level)}: held for "
            f"{down(together.period)} s, rates off by {rates(together.disturbance)}, a measurement of "
            f"{down(together.delay)} s ago off by {by_state(together.pose_error, units)}",
            *_sampled(proven.sampled, tuple(shown.claims.problem.inputs)),
        ),
    )


def _sampled(claim: SampledClaim | None, inputs: Sequence[str]) -> tuple[str, ...]:
    """What is proven of a law that looks one hold ahead."""
    if claim is None:
        return ()
    held = (
        f"or, under a law that looks one hold ahead and takes one of {len(claim.choices)} inputs: each is held for any "
        f"time up to {down(claim.period)} s{_frequency(claim.period)}, and on the shell V falls at "
        f"{down(claim.decrease)} 1/s or more from one choice to the next"
    )
    late = claim.start_up
    if late is None:
        return (held,)
    first = ", ".join(f"{name} {about(value)}" for name, value in zip(inputs, claim.choices[late.choice], strict=True))
    return (
        held,
        f"that law may see poses up to {down(late.delay)} s late, if it knows their age and the inputs held since: it "
        f"predicts; a car that holds {first} until it acts on its first pose, within that delay, has to start in "
        f"V <= {down(late.level)}, and so early that theta is before the end of the path, or of the lap, by then",
    )


def _law(shown: Proven, proven: ProvenRobustness) -> tuple[tuple[str, ...], str]:
    """The decrease that a law has to reach, its numbers for each funnel, and what may change while inputs are held."""
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
    said = f"funnel {index}: lambda = {down(own.margin)} 1/s, shell from {up(own.shell)}"
    if per_metre is None or bounds is None:
        return said
    return (
        f"{said}, inner {up(own.inner)}, {down(per_metre)} per metre, curvature in "
        f"{interval(bounds.curvature, OUTWARDS)} 1/m, acceleration in {interval(bounds.acceleration, OUTWARDS)} m/s^2"
    )


def _frequency(period: fmpq) -> str:
    return f" (control at {up(1 / period)} Hz or faster)" if period else ""


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
    return f"{down(arrival[0])} to {up(arrival[1])} s"
