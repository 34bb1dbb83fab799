"""What all funnels of a certificate absorb together: each along its legs, and every joint between them.

In each funnel V is kept below 1 (`cfcheck.robustness.amounts`, whose letters these are). When a leg begins, inputs of
the one before are in use for another h + τ, while V rises by D' (h + τ) at most: the funnel has to be entered with

    V ≤ 1 − ω − D' (h + τ),

and the leg before has to end low enough for that (`Joint.is_entered`), the last one low enough for G. A funnel that
changes with θ ends with V ≤ 1 − ω at most. In an invariant one V comes down along the leg as well, and an amount is
absorbed if it leaves enough of the decrease for that. With bounds of the path's own curvatures, speeds and
accelerations along the legs, inputs held for h and τ old, let the law reach

    ∇V·f(x, u, r') ≤ −max(λ', μ' v_r) min(1, V̂/β̲)        for V̂ ≥ β_in and all r' within these bounds at once,

where V̂ is what it takes for V, |V̂ − V| ≤ ω. For a level b between β_in and β̲ there are two kinds of holds. If
V ≥ b + ω when it was measured, V falls: for each u0_hi (1 + a u0_hi (h + τ)/v) metres by μ' b/β̲ − spent/v at least, as
the speed v at that time may change meanwhile. If not, V stays below the floor F_b = b + ω + D' (h + τ). So from the
floor of one b on V falls to the floor of a lower one at that one's rate, as far as the leg is long; the metres of the
first h + τ are lost for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR

from flint import fmpq

from cfcheck.claims.document import Certificate, Claims
from cfcheck.claims.proof import MOST_EFFORT, Question, dynamics_of
from cfcheck.exact.enclosure import Budget
from cfcheck.exact.rational import Range, decimal_text, dyadic, rational, sqrt_lower
from cfcheck.kernel.containment import Sets, broken_containments
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.legs import Joint, different, joints_of
from cfcheck.path.bounds import Bounds
from cfcheck.reader import Broken
from cfcheck.robustness.amounts import SHARE, AbsorbedClaim, BoundsOver, LawNumbers, Rates, least_level
from cfcheck.robustness.hold_hints import FunnelHints
from cfcheck.robustness.rate_bounds import bands_of, rates_along, rates_within
from cfcheck.vehicle.structure import is_mirror


FLOORS, STEP = 64, fmpq(15, 16)  # levels b at most, and from one to the next


def law_numbers_of(funnel: FunnelClaim, bounds: Bounds | None) -> LawNumbers:
    """What a run-time law has to know of a funnel, as the numbers are printed."""

    def printed(value: fmpq, rounding: str) -> fmpq:
        return rational(decimal_text(value, rounding))

    per_metre = funnel.margin_per_metre
    return LawNumbers(
        margin=printed(funnel.margin, ROUND_FLOOR),
        margin_per_metre=None if per_metre is None else printed(per_metre, ROUND_FLOOR),
        shell=printed(funnel.beta_lower, ROUND_CEILING),
        inner=printed(funnel.beta_inner, ROUND_CEILING),
        bounds=bounds,
    )


@dataclass(frozen=True)
class HeldFunnel:
    """A funnel with bounds over it, in the path's units.

    `bands` are those of an invariant funnel, m/s, with `rates` for each of them; `fastest` is the largest u0.
    """

    funnel: FunnelClaim
    numbers: LawNumbers
    fastest: fmpq
    bands: tuple[Range, ...]
    rates: tuple[Rates, ...]

    def blurred(self, amounts: AbsorbedClaim) -> fmpq:
        """ω."""
        return max(one.blurred(amounts) for one in self.rates)

    def risen(self, amounts: AbsorbedClaim) -> fmpq:
        """D' (h + τ)."""
        return max(one.risen(amounts) for one in self.rates)

    def entry(self, amounts: AbsorbedClaim) -> fmpq:
        """V at most where a leg with it begins."""
        return 1 - self.blurred(amounts) - self.risen(amounts)

    def descent(self, amounts: AbsorbedClaim) -> "Descent":
        """How V comes down in this funnel under the amounts."""
        late = amounts.period + amounts.delay
        blurred, risen = self.blurred(amounts), self.risen(amounts)
        start, per_metre, bounds = dyadic(1 - blurred, up=True), self.numbers.margin_per_metre, self.numbers.bounds
        if per_metre is None or bounds is None:
            return Descent(start, fmpq(0), ())
        steepest = max(map(abs, bounds.acceleration))
        # by band: what a metre costs, and over how many metres it is counted
        costs = []
        for (slowest, _), rates in zip(self.bands, self.rates, strict=True):
            metres = self.fastest * (1 + steepest * self.fastest * late / slowest)
            costs.append((rates.spent(amounts) / slowest, metres))
        steps, level = [], self.numbers.shell
        for _ in range(FLOORS):
            reached = SHARE * per_metre * level / self.numbers.shell  # by the law, 1/m
            fall = min((reached - spent) / metres for spent, metres in costs)
            steps.append((dyadic(fall, up=False), dyadic(level + blurred + risen, up=True)))
            if level == self.numbers.inner or fall <= 0:
                break
            level = max(dyadic(level * STEP, up=True), self.numbers.inner)
        lost = bounds.speed[1] * self.fastest * late
        return Descent(start, dyadic(lost, up=True), tuple(steps))


@dataclass(frozen=True)
class Descent:
    """From `start`, after `lost` metres: falls (1/m) with the floors to which each of them leads; rounded."""

    start: fmpq
    lost: fmpq
    steps: tuple[tuple[fmpq, fmpq], ...]

    def end_level(self, way: fmpq) -> fmpq:
        """A level that V is at most after a leg of so many metres, where it is kept below the start."""
        level, way = self.start, dyadic(way, up=False) - self.lost
        for fall, floor in self.steps:
            if fall <= 0 or way <= 0 or floor >= level:
                break
            if (level - floor) >= fall * way:
                return dyadic(level - fall * way, up=True)
            way = dyadic(way - (level - floor) / fall, up=False)
            level = floor
        return level


def held_question(claims: Claims, index: int, mirror: tuple[int, ...] | None, numbers: LawNumbers) -> Question:
    """Condition (d) while inputs are held: with the margins that a law knows, and all that the car can do.

    `mirror` are the signs of its proof, which need not be those of what the car can do.

    Raises:
        Broken: as the certificate.
    """
    problem, funnel, model = claims.problem, claims.funnels[index], claims.models[index]
    factors = model.input_factors(problem.vehicle)
    box = {name: (low / factors[name], high / factors[name]) for name, (low, high) in problem.inputs.items()}
    assert tuple(box) == tuple(model.inputs)  # as is proven; signs of a mirror are in this order
    able = replace(model, inputs=box)
    dynamics = dynamics_of(model)
    is_kept = mirror is not None and is_mirror(dynamics, able.vehicle.states, box, funnel.shape, mirror)
    per_metre = numbers.margin_per_metre
    known = replace(
        funnel,
        margin=numbers.margin / model.faster,
        margin_per_metre=None if per_metre is None else per_metre * model.length,
        beta_lower=numbers.shell,
    )
    return Question(able, dynamics, known, mirror if is_kept else None)


def held_over(certificate: Certificate, hints: Sequence[FunnelHints]) -> tuple[HeldFunnel, ...]:
    """Bounds over each funnel of a proven certificate.

    Raises:
        Broken, ValueError: says what is not proven.
    """
    effort = Budget(MOST_EFFORT)
    return tuple(_held(certificate, index, own, effort) for index, own in enumerate(hints))


def are_entered(joints: Sequence[Joint], ends: Sequence[fmpq], entries: Sequence[fmpq]) -> bool:
    """Whether every leg leads into the next one: V at the end of each leg, and what it may be where each begins."""
    return all(
        entries[joint.after.index] > 0
        and joint.is_entered(ends[joint.before.index], sqrt_lower(entries[joint.after.index]))
        for joint in joints
    )


def bounds_over(certificate: Certificate, hints: Sequence[FunnelHints]) -> BoundsOver:
    """What is proven over the funnels of a proven certificate.

    Raises:
        Broken, ValueError: says what is not proven.
    """
    claims, held = certificate.claims, held_over(certificate, hints)
    rates = tuple(one for own in held for one in own.rates)
    parts, problem = claims.parts, claims.problem
    if not parts:
        bands = held[0].bands
        if any(rational(decimal_text(end, ROUND_FLOOR)) != end for _, end in bands[:-1]):
            raise Broken("robustness: the bands of speed end at numbers that are not printed exactly")
        return BoundsOver(rates, lambda amounts: least_level(rates, amounts), (held[0].numbers,), bands)
    joints = joints_of(claims.legs, problem.is_lap, claims.ratios)
    ways = [leg.length for leg in claims.legs]

    def keeps(amounts: AbsorbedClaim) -> fmpq | None:
        kept = least_level(rates, amounts)
        if kept is None:
            return None
        descents, levels = [own.descent(amounts) for own in held], [own.entry(amounts) for own in held]
        ends = [descents[part.funnel].end_level(way) for part, way in zip(parts, ways, strict=True)]
        entries = [levels[part.funnel] for part in parts]
        return kept if are_entered(joints, ends, entries) and _arrives(claims, ends[-1]) else None

    return BoundsOver(rates, keeps, tuple(own.numbers for own in held))


def _arrives(claims: Claims, level: fmpq) -> bool:
    """Whether {V ≤ level} of the last leg lies in G, if there is one."""
    problem, last = claims.problem, claims.legs[-1]
    goal = Sets(None, problem.goal, None)
    states = problem.vehicle.states
    return problem.goal is None or not broken_containments(states, last.funnel.shape, last.end_form(level), goal)


def _held(certificate: Certificate, index: int, hints: FunnelHints, effort: Budget) -> HeldFunnel:
    """Bounds over a funnel, proven in the units of the car that it is proven for."""
    claims, own = certificate.claims, certificate.hints[index]
    problem, model, bounds = claims.problem, claims.models[index], hints.bounds
    numbers = law_numbers_of(claims.driven[index], bounds)
    question = held_question(claims, index, own.mirror, numbers)
    if bounds is None:
        rates = [rates_along(question, claims.legs_of(index), hints.stretches, effort)]
        bands: tuple[Range, ...] = ()
    else:
        _require_bounds(certificate, index, bounds, effort)
        as_proven = model.as_proven(bounds)
        narrow = bands_of(as_proven, hints.stretches)
        rates = [
            rates_within(question, as_proven, band, stretch.pieces, effort)
            for band, stretch in zip(narrow, hints.stretches, strict=True)
        ]
        bands = tuple((low * model.speed, high * model.speed) for low, high in narrow)
    in_units = tuple(one.in_units(model.axes, model.faster) for one in rates)
    return HeldFunnel(claims.driven[index], numbers, problem.fastest, bands, in_units)


def _require_bounds(certificate: Certificate, index: int, bounds: Bounds, effort: Budget) -> None:
    """That the path keeps the bounds along a funnel's legs, and the funnel holds within them."""
    claims, model = certificate.claims, certificate.claims.models[index]
    if not all(piece.inside(bounds, effort) for leg in different(claims.legs_of(index)) for piece in leg.pieces):
        raise Broken(f"robustness: the path leaves the bounds that are told of it in funnel {index}")
    if isinstance(claims.problem.course, Bounds) and not claims.problem.course.lies_in(bounds):
        raise Broken("robustness: the bounds that are told are narrower than those of the path")
    if not bounds.lies_in(model.as_driven(certificate.hints[index].stretches[0].bounds)):
        raise Broken(f"robustness: the bounds that are told of the path are wider than funnel {index}")
