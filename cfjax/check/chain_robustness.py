"""What is absorbed along a path that tubes hold: each of them on its runs, and every link between them.

In each tube V is kept below 1 as anywhere else (`cfjax.check.amounts`, whose letters these are); but it has to come
down as well, to where the next tube begins and to where G is. So an amount is absorbed along the path if it leaves
enough of the decrease for that. With the tube's bounds for the path's own curvatures, speeds and accelerations, inputs
held for h and τ old, let the law reach

    ∇V·f(x, u, r') ≤ −max(λ', μ' v_r) min(1, V̂/β̲)        for V̂ ≥ β_in and all r' within these bounds at once,

where V̂ is what it takes for V, |V̂ − V| ≤ ω. For a level b between β_in and β̲ there are two kinds of holds. If
V ≥ b + ω when it was measured, V falls: for each u0_hi (1 + a u0_hi (h + τ)/v) metres by μ' b/β̲ − spent/v at least, as
the speed v at that time may change meanwhile. If not, V stays below the floor F_b = b + ω + D' (h + τ). So from the
floor of one b on V falls to the floor of a lower one at that one's rate, as far as the run is long.

When a tube takes over, inputs of the one before are in use for another h + τ: it has to be entered with
V ≤ 1 − ω − D' (h + τ), and the metres of that time are lost for it. Where its reference jumps by j in √V, the one
before has to end with V ≤ level (√(1 − ω − D' (h + τ)) − j)², level C₂ ≺ C₁.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR
from typing import NamedTuple

from flint import fmpq

from cfjax.check.amounts import SHARE, Absorbed, BoundsOver, Rates, least_level
from cfjax.check.bounds import Bounds, Range
from cfjax.check.certified import CertifiedTube
from cfjax.check.chain import ChainClaim, broken_goal, prove_runs
from cfjax.check.document import read_claims
from cfjax.check.enclosure import Budget
from cfjax.check.handover import Run
from cfjax.check.held_hints import TubeHints
from cfjax.check.proof import MOST_EFFORT, LegClaim
from cfjax.check.rational import decimal_text, dyadic, rational, sqrt_lower
from cfjax.check.reader import Broken
from cfjax.check.robustness import bands_of, tube_rates
from cfjax.check.symbolic import symbolic
from cfjax.check.vehicle import KNOWN_VEHICLES


FLOORS, STEP = 64, fmpq(15, 16)  # levels b at most, and from one to the next


class Told(NamedTuple):
    """What a law is told of a tube: λ (1/s), μ (1/m), β̲ and β_in as they are printed."""

    margin: fmpq
    margin_per_metre: fmpq
    shell: fmpq
    inner: fmpq

    @classmethod
    def of(cls, tube: CertifiedTube) -> "Told":
        margins = (rational(decimal_text(value, ROUND_FLOOR)) for value in (tube.margin, tube.margin_per_metre))
        levels = (rational(decimal_text(value, ROUND_CEILING)) for value in (tube.beta_lower, tube.beta_inner))
        return cls(*margins, *levels)


@dataclass(frozen=True)
class HeldTube:
    """A tube with bounds over it along the path's runs there, in the path's units."""

    tube: CertifiedTube
    bounds: Bounds  # of the path along its runs
    told: Told
    fastest: fmpq  # u0_hi of the whole path
    bands: tuple[Range, ...]  # speeds, m/s
    rates: tuple[Rates, ...]  # of each band

    def blurred(self, amounts: Absorbed) -> fmpq:
        """ω."""
        return max(one.blurred(amounts) for one in self.rates)

    def risen(self, amounts: Absorbed) -> fmpq:
        """D' (h + τ)."""
        return max(one.risen(amounts) for one in self.rates)

    def entry(self, amounts: Absorbed) -> fmpq:
        """V at most where this tube takes over."""
        return 1 - self.blurred(amounts) - self.risen(amounts)

    def descent(self, amounts: Absorbed) -> "Descent":
        """How V comes down in this tube under the amounts."""
        late = amounts.period + amounts.delay
        blurred, risen = self.blurred(amounts), self.risen(amounts)
        steepest = max(map(abs, self.bounds.acceleration))
        # by band: what a metre costs, and over how many metres it is counted
        costs = []
        for (slowest, _), rates in zip(self.bands, self.rates, strict=True):
            metres = self.fastest * (1 + steepest * self.fastest * late / slowest)
            costs.append((rates.spent(amounts) / slowest, metres))
        steps, level = [], self.told.shell
        for _ in range(FLOORS):
            asked = SHARE * self.told.margin_per_metre * level / self.told.shell
            fall = min((asked - spent) / metres for spent, metres in costs)
            steps.append((dyadic(fall, up=False), dyadic(level + blurred + risen, up=True)))
            if level == self.told.inner or fall <= 0:
                break
            level = max(dyadic(level * STEP, up=True), self.told.inner)
        lost = self.bounds.speed[1] * self.fastest * late
        return Descent(dyadic(1 - blurred, up=True), dyadic(lost, up=True), tuple(steps))


@dataclass(frozen=True)
class Descent:
    """From `start`, after `lost` metres: falls (1/m) with the floors to which each of them leads; rounded."""

    start: fmpq
    lost: fmpq
    steps: tuple[tuple[fmpq, fmpq], ...]

    def end_level(self, way: fmpq) -> fmpq:
        """A level that V is at most after a run of so many metres, where it is kept below the start."""
        level, way = self.start, dyadic(way, up=False) - self.lost
        for fall, floor in self.steps:
            if fall <= 0 or way <= 0 or floor >= level:
                break
            if (level - floor) >= fall * way:
                return dyadic(level - fall * way, up=True)
            way = dyadic(way - (level - floor) / fall, up=False)
            level = floor
        return level


def timing_of(runs: Sequence[Run]) -> Range:
    """Of all tubes together: inputs are held from one into the next."""
    return min(run.tube.timing[0] for run in runs), max(run.tube.timing[1] for run in runs)


def leg_of(claim: ChainClaim, index: int, tube: CertifiedTube, bounds: Bounds, timing: Range) -> LegClaim[Bounds]:
    """What is asked of a tube along its runs, in its certificate's units, with margins as they are told.

    `tube` is the one with that index in the path's units, `bounds` are those of the path along its runs there; its
    inputs do all that the path's car can do.

    Raises:
        Unreadable, Broken: as the tube's certificate.
    """
    certificate, length, speed = claim.tubes[index]
    problem, (funnel, *_) = read_claims(certificate)
    inputs = dict(problem.inputs) | {"u0": timing}
    if known := KNOWN_VEHICLES.get(claim.vehicle):
        as_scaled = known.reach(claim.parameters, known.scaled(problem.vehicle.parameters, length, speed))
        units = known.units(length, speed)
        inputs |= {name: (-limit / units[name], limit / units[name]) for name, limit in as_scaled.items()}
    margin, per_metre, *_ = Told.of(tube)
    return LegClaim(
        problem=replace(problem, inputs=inputs),
        dynamics=symbolic(problem.vehicle.graph, problem.vehicle.states, tuple(inputs)),
        along=bounds.scaled(1 / length, 1 / speed),
        funnel=replace(funnel, margin=margin * length / speed, margin_per_metre=per_metre * length),
    )


def bounds_along(claim: ChainClaim, hints: Sequence[TubeHints]) -> tuple[BoundsOver, tuple[HeldTube, ...]]:
    """What is proven over the tubes of a proven chain along its path, and the same by tube.

    Raises:
        Unreadable, Broken, ValueError: says what is not proven.
    """
    runs, _ = prove_runs(claim)
    effort, timing, pieces = Budget(MOST_EFFORT), timing_of(runs), claim.reference.pieces
    held = []
    for index, own in enumerate(hints):
        mine = [run for run, (_, _, tube) in zip(runs, claim.runs, strict=True) if tube == index]
        if not mine:
            raise Broken(f"tube {index}: it holds nowhere along the path")
        if not all(piece.inside(own.bounds) for run in mine for piece in pieces[run.begin : run.end]):
            raise Broken(f"robustness: the path leaves the bounds that are told of it in tube {index}")
        if not own.bounds.lies_in(mine[0].tube.bounds):
            raise Broken(f"robustness: the bounds that are told of the path are wider than tube {index}")
        leg = leg_of(claim, index, mine[0].tube, own.bounds, timing)
        held.append(_held(mine[0].tube, leg, timing, own, claim.tubes[index][1:], effort))
    by_run = [held[tube] for _, _, tube in claim.runs]
    ways = [run.length(claim.reference) for run in runs]
    rates = tuple(each for own in held for each in own.rates)

    def keeps(amounts: Absorbed) -> fmpq | None:
        kept = least_level(rates, amounts)
        if kept is None:
            return None
        descents = [own.descent(amounts) for own in held]
        ends = [descents[tube].end_level(way) for (_, _, tube), way in zip(claim.runs, ways, strict=True)]
        return kept if _handed_over(claim, by_run, ends, amounts) else None

    return BoundsOver(rates, keeps, along=tuple(own.bounds for own in by_run)), tuple(held)


def _handed_over(claim: ChainClaim, tubes: Sequence[HeldTube], ends: Sequence[fmpq], amounts: Absorbed) -> bool:
    """Whether each tube ends low enough for the next one, and the last one for G."""
    followers = [*tubes[1:], *tubes[:1]]
    for index, (link, level, following) in enumerate(zip(claim.levels, ends, followers, strict=False)):
        entry = following.entry(amounts)
        if entry <= 0:
            return False
        last = index == len(tubes) - 1
        jump = claim.reference.gap.jump(following.tube.shape, following.tube.inverse) if last else fmpq(0)
        room = sqrt_lower(entry) - jump
        if room <= 0 or level > link * room**2:
            return False
    return claim.sets is None or not broken_goal(claim.sets, tubes[-1].tube, ends[-1])


def _held(
    tube: CertifiedTube,
    leg: LegClaim[Bounds],
    timing: Range,
    hints: TubeHints,
    scale: tuple[fmpq, fmpq],
    effort: Budget,
) -> HeldTube:
    """Bounds over a tube, proven in the units of its certificate."""
    length, speed = scale
    told = Told.of(tube)
    bands = bands_of(leg.along, hints.bands)
    rates = [
        tube_rates(leg, band, told.shell, stretch.pieces, effort)
        for band, stretch in zip(bands, hints.bands, strict=True)
    ]
    known = KNOWN_VEHICLES.get(tube.vehicle)  # of others the scales are 1
    axes = known.axes(length, speed) if known else (fmpq(1),) * len(tube.states)
    return HeldTube(
        tube=tube,
        bounds=hints.bounds,
        told=told,
        fastest=timing[1],
        bands=tuple((low * speed, high * speed) for low, high in bands),
        rates=tuple(one.in_units(axes, speed / length) for one in rates),
    )
