"""A path within bounds gets a certified chain of tubes: chosen in floating point, proven in exact arithmetic.

Each tube holds along every path within its intervals. So nothing is optimised for a path: it is cut into pieces, each
piece asks which tubes hold it, and a chain is the cheapest way through them, where a tube can only be left for one that
holds all that is left of it after the distance it has had (`cfjax.tubes.choice` chooses, `cfcheck.kernel.legs` proves
each of these claims).
"""

import html
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from flint import fmpq

from cfcheck.clearance.surroundings import ClearanceHints, SurroundingsClaim
from cfcheck.exact.rational import Range, float_below, rational, sqrt_upper
from cfcheck.kernel.legs import Joint, prove_joints
from cfcheck.path.piece import Piece
from cfcheck.path.reference import LARGEST_POSE_GAP, LARGEST_SPEED_GAP, Gap, Reference, is_closed
from cfjax.coerce import Numbers, flag, instance, instances, number, optional, text, whole
from cfjax.errors import InputError
from cfjax.exact import StatedSegment, exact_reference, exact_surroundings, stated
from cfjax.problem import FootprintDisc, KinematicBicycle, Obstacle, Vehicle
from cfjax.problem.corridor import walls_of
from cfjax.problem.obstacles import footprint_of, obstacles_of
from cfjax.problem.path import Path, Pose, Profile, Segment
from cfjax.problem.room import require_clear
from cfjax.rounded import rounded_down, rounded_up
from cfjax.tubes.certified import CertifiedTube, TubeLeg, timing_of
from cfjax.tubes.choice import choose, needed_distance, proven_ratios
from cfjax.tubes.store import library, proven_tubes
from cfjax.tubes.vehicles import parameters_of, why_none
from cfjax.tubes.violation import InTheWay, furthest_out


CUTS = 64  # a piece longer than this part of the path is cut, so that a tube can be left inside it
DIGITS = 6  # that are printed
MOST_LINES = 5  # about tubes, that are printed


class Outside(ValueError):
    """A path that leaves every tube."""


class Stretch(NamedTuple):
    """A part of one segment, θ from start to end (s), and the tube that holds there."""

    segment: int
    start: float
    end: float
    tube: CertifiedTube


class Link(NamedTuple):
    """Where one tube hands over to the next: at θ (s) of a segment, V of the first is at most `level`.

    That takes `needed` metres in the first tube, which has `available`; both are rounded to the safe side.
    """

    segment: int
    theta: float
    first: CertifiedTube
    second: CertifiedTube
    level: float
    needed: float
    available: float


@dataclass(frozen=True)
class Following:
    """A proof that a car which starts inside the first tube stays inside the chain and arrives.

    It speaks of laws that enforce 0.95 of the certified decrease or more, as `cfjax.control.law_numbers` does.

    `path` is the path that is certified, as floating-point numbers: start poses by integration, speeds continuous. The
    proof speaks of `reference`, the same in exact numbers. `arrival` are the proven earliest and latest time (s, by the
    clock) to the end, of a closed path for each lap; `links` of a closed one ends with the link from the end of a lap
    to its start, which is why it goes for ever.
    """

    path: Path
    reference: Reference
    tubes: tuple[Stretch, ...]
    links: tuple[Link, ...]
    closed: bool
    end_level: float  # V of the last tube is at most this at the end
    arrival: tuple[float, float]
    runs: tuple[TubeLeg, ...]  # the same as `tubes` and `links` in exact numbers: pieces of the reference, and ratios
    ratios: tuple[fmpq, ...]
    timing: Range  # of all tubes together
    vehicle: Vehicle | None = None  # that drives, where it is known
    surroundings: SurroundingsClaim = SurroundingsClaim()  # what the body clears in every tube
    clearance: ClearanceHints = ()  # half-planes that prove it, by run

    def __post_init__(self) -> None:
        instance("path", self.path, Path)
        instance("reference", self.reference, Reference)
        for name, kind in (("tubes", Stretch), ("links", Link), ("runs", TubeLeg), ("ratios", fmpq)):
            instances(name, getattr(self, name), kind)

    @property
    def start(self) -> CertifiedTube:
        """Deviations with xᵀ C x < 1 in this tube may start."""
        return self.tubes[0].tube

    @property
    def end(self) -> CertifiedTube:
        """The tube in which a car arrives, with xᵀ C x ≤ end_level."""
        return self.tubes[-1].tube

    def tube_at(self, segment: int, theta: float) -> CertifiedTube:
        """The tube that holds at θ (s) of a segment; the later one where two meet.

        Raises:
            InputError: where the path has no such place.
        """
        segment, theta = whole("segment", segment, 0), number("theta", theta, "s")
        for stretch in reversed(self.tubes):
            if stretch.segment == segment and stretch.start <= theta <= stretch.end:
                return stretch.tube
        raise InputError(
            f"path {self.path.name}: expected a place on it, there is no theta = {theta:g} s in segment {segment}"
        )

    def describe(self) -> str:
        """At most ten lines for people, however long the path is."""
        length = float(self.reference.length)
        ending = "a lap" if self.closed else "the end"
        earliest, latest = self.arrival
        lines = [
            f"path {self.path.name}: {length:.6g} m{', closed' if self.closed else ''}, "
            f"{ending} after {rounded_down(earliest, DIGITS)} to {rounded_up(latest, DIGITS)} s"
        ]
        runs = [list(run) for _, run in itertools.groupby(self.tubes, key=lambda stretch: stretch.tube.name)]
        for run in runs[:MOST_LINES]:
            first, last = run[0], run[-1]
            width = rounded_up(_float_above(sqrt_upper(first.tube.inverse[1, 1])), DIGITS)
            lines.append(
                f"  theta = {first.start:.6g} s of segment {first.segment} to {last.end:.6g} s of segment "
                f"{last.segment}: tube {first.tube.name}, lateral half-width {width} m"
            )
        if len(runs) > MOST_LINES:
            lines.append(f"  and {len(runs) - MOST_LINES} more tubes")
        if self.links:
            least = min(self.links, key=lambda link: link.available - link.needed)
            lines.append(
                f"  {len(self.links)} {'change' if len(self.links) == 1 else 'changes'}, with least to spare "
                f"{least.first.name} -> {least.second.name} at theta = {least.theta:.6g} s of segment {least.segment}: "
                f"V <= {rounded_up(least.level, DIGITS)} after {rounded_up(least.needed, DIGITS)} m, "
                f"has {rounded_down(least.available, DIGITS)} m"
            )
        if not self.surroundings.is_empty:
            lines.append(f"  clear of {self._beside()}, wherever in its tube the car is")
        lines.append("  holds for ever" if self.closed else f"  arrives with V <= {rounded_up(self.end_level, DIGITS)}")
        return "\n".join(lines)

    def _beside(self) -> str:
        counts = (len(self.surroundings.obstacles), "obstacle"), (len(self.surroundings.walls), "wall")
        return " and ".join(f"{count} {name}{'s' if count > 1 else ''}" for count, name in counts if count)

    def __str__(self) -> str:
        return self.describe()

    def __repr__(self) -> str:
        return f"<{self.describe().splitlines()[0]}, {len(self.tubes)} tubes in turn>"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.describe())}</pre>"


def follow(
    path: Path,
    tubes: Sequence[CertifiedTube] | None = None,
    *,
    vehicle: Vehicle | None = None,
    closed: bool = False,
    pinned: str | None = None,
    obstacles: Sequence[Obstacle | Mapping] | Numbers = (),
    footprint: Sequence[FootprintDisc] | Numbers = (FootprintDisc(),),
    corridor: object = None,
) -> Following:
    """The chain of tubes with the least lateral width, by length, that is proven to hold along the path.

    `tubes` are those of the package for the vehicle, the Parkour car unless given. Given tubes have to be certified for
    the vehicle that drives, which is checked where it is given too. A closed path is one lap that is driven again and
    again; `pinned` is the name of the one tube to use. Beside `obstacles` (m, in the frame of the path) only tubes are
    used in which the `footprint`, discs [radius, offset along the forward axis] in m, touches none of them. A
    `corridor` is two walls beside the path that it may not touch either, in the forms that `Problem` takes.

    >>> from cfjax import circle
    >>> following = follow(circle(radius=2.0, speed=2.0))
    >>> [run.tube.name for run in following.runs]
    ['narrow-tight-slow']

    Raises:
        InputError: where the path has a jump (pose: 1e-6 rad or m; speed: 1e-9 m/s), leaves every tube, comes too near
            to an obstacle, or where no chain is proven; the message says where and by how much.
    """
    instance("path", path, Path)
    optional("vehicle", vehicle, Vehicle)
    closed, pinned = flag("closed", closed), None if pinned is None else text("pinned", pinned)
    around, body = (*obstacles_of(obstacles), *walls_of(corridor, path, closed)), footprint_of(footprint)
    surroundings = exact_surroundings(around, body)
    car = KinematicBicycle() if vehicle is None else vehicle
    offered = library(car) if tubes is None else instances("tubes", tubes, CertifiedTube)
    if not offered and tubes is None:
        reason = why_none(proven_tubes(), car)
        raise InputError(
            f"{reason}; cfjax.synthesize(cfjax.Problem(path, vehicle=vehicle)) learns and proves what holds this one, "
            "as the command cfjax.train does"
        )
    chosen = tuple(tube for tube in offered if pinned in (None, tube.name))
    if not chosen:
        raise InputError(
            f"path {path.name}: expected one of the tubes {', '.join(tube.name for tube in offered) or '(none)'}, "
            f"got {pinned or 'none'}"
        )
    if vehicle is not None:
        own = parameters_of(vehicle)
        for tube in chosen:
            if (tube.vehicle, dict(tube.parameters)) != (vehicle.name, own):
                raise InputError(
                    f"path {path.name}: tube {tube.name} is certified for another vehicle than the one given"
                )
    try:
        found = _follow(path, chosen, closed, surroundings)
        return replace(found, vehicle=car if tubes is None or vehicle is not None else None)
    except InputError:
        raise
    except InTheWay as error:
        require_clear(path, around, body)  # the reference itself, which is worse
        raise InputError(f"path {path.name}: {error}") from None
    except Outside as error:
        own = "" if vehicle is None else ", vehicle=vehicle"
        more = (
            f"; cfjax.synthesize(cfjax.Problem(path{own})) looks for a proof of the path's own" if tubes is None else ""
        )
        raise InputError(f"path {path.name}: {error}{more}") from None
    except (ValueError, OverflowError) as error:  # of the exact statements, which know no other rooms
        raise InputError(f"path {path.name}: {error}") from None


def _follow(path: Path, tubes: tuple[CertifiedTube, ...], closed: bool, surroundings: SurroundingsClaim) -> Following:
    statements = [stated(segment) for segment in path.require_course()]
    reference = _cut(exact_reference(statements))
    pieces = reference.pieces
    # tubes of several widths share their bounds
    inside = {bounds: [piece.inside(bounds) for piece in pieces] for bounds in {tube.bounds for tube in tubes}}
    holds = np.array([inside[tube.bounds] for tube in tubes])
    outside = np.flatnonzero(~holds.any(axis=0))
    if outside.size:
        raise Outside(furthest_out([pieces[index] for index in outside], tubes))
    gap = _gap(reference) if closed else None
    if not surroundings.is_empty:
        from cfjax.tubes.clear import choose_clear  # here, for the solvers come with it

        chain, clearance = choose_clear(
            reference, tubes, holds, surroundings, lambda clear: choose(reference, tubes, clear, gap)
        )
    else:
        chain, clearance = choose(reference, tubes, holds, gap), ()
    runs = [TubeLeg(begin, end, tubes[index]) for begin, end, index in chain]
    if any((run.tube.vehicle, run.tube.parameters) != (runs[0].tube.vehicle, runs[0].tube.parameters) for run in runs):
        raise ValueError("expected tubes that are certified for one vehicle")
    order = [index for _, _, index in chain] + ([chain[0][2]] if closed else [])
    ratios = [proven_ratios(tubes)[i][j] for i, j in itertools.pairwise(order)]
    legs = [run.leg(reference, index) for index, run in enumerate(runs)]
    slowest, fastest = timing_of([run.tube for run in runs])
    joints = prove_joints(legs, closed, ratios, fastest)
    return Following(
        path=_certified_path(path.name, path.curve, statements, reference),
        reference=reference,
        tubes=_stretches(pieces, runs),
        links=tuple(_link(joint, runs, fastest) for joint in joints),
        closed=closed,
        end_level=_float_above(legs[-1].end_level(fastest)),
        arrival=(float_below(reference.duration / fastest), _float_above(reference.duration / slowest)),
        runs=tuple(runs),
        ratios=tuple(ratios),
        timing=(slowest, fastest),
        surroundings=surroundings,
        clearance=clearance,
    )


def _link(joint: Joint, runs: Sequence[TubeLeg], fastest: fmpq) -> Link:
    """A proven joint in floating-point numbers."""
    first, second = runs[joint.before.index].tube, runs[joint.after.index].tube
    found = needed_distance(first, second, joint.ratio, joint.jump, fastest)
    assert found is not None  # it is proven
    place, (level, needed) = joint.after.reference.pieces[joint.after.begin], found
    available = float_below(joint.before.length)
    return Link(place.segment, float(place.theta), first, second, _float_above(level), _float_above(needed), available)


def _float_above(value: fmpq) -> float:
    return 0.0 - float_below(-value)  # not −0.0


# --- the path, cut, and back to floating-point numbers


def _cut(reference: Reference) -> Reference:
    """Long pieces in several, at floating-point θ."""
    longest = float(sum((abs(piece.length) for piece in reference.pieces), fmpq(0))) / CUTS  # a path may run backwards
    pieces: list[Piece] = []
    for piece in reference.pieces:
        count = math.ceil(float(piece.length) / longest - 1e-6) if longest > 0 else 1
        begin, end = float(piece.theta), float(piece.theta + piece.duration)
        grid = {rational(begin + (end - begin) * k / count) - piece.theta for k in range(1, count)}
        inner = sorted(at for at in grid if 0 < at < piece.duration)
        pieces += piece.split(inner) if inner else [piece]
    return Reference(tuple(pieces), reference.start)


def _certified_path(
    name: str, segments: Sequence[Segment], statements: Sequence[StatedSegment], reference: Reference
) -> Path:
    """The path with integrated start poses and continuous speeds, rounded to floating-point numbers."""
    constants = {(piece.segment, piece.theta): piece.speed[0] for piece in reference.pieces}
    result = []
    for index, (segment, exact) in enumerate(zip(segments, statements, strict=True)):
        speed, coefficients = segment.speed, []
        for own, at, (meant, *_) in zip(
            speed.coefficients, exact.speed.breaks[:-1], exact.speed.coefficients, strict=True
        ):
            value = constants[index, at]
            coefficients.append(own if value == meant else (float(value), *own[1:]))
        start = segment.start
        if index:
            heading, position = reference.poses[index]
            start = Pose(float(heading), float(position.real.mid()), float(position.imag.mid()))
        result.append(Segment(segment.turn_rate, Profile(speed.breaks, tuple(coefficients)), start))
    return Path(name, tuple(result))


def _stretches(pieces: Sequence[Piece], runs: Sequence[TubeLeg]) -> tuple[Stretch, ...]:
    found: list[Stretch] = []
    for run in runs:
        fresh = True
        for piece in pieces[run.begin : run.end]:
            start, end = float(piece.theta), float(piece.theta + piece.duration)
            if fresh or found[-1].segment != piece.segment:
                found.append(Stretch(piece.segment, start, end, run.tube))
            else:
                found[-1] = found[-1]._replace(end=end)
            fresh = False
    return tuple(found)


# --- refusals


def _gap(reference: Reference) -> Gap:
    gap = reference.gap
    if not is_closed(gap):
        heading, lateral, forward, speed = map(float, gap)
        raise ValueError(
            f"the end of the lap is not its start: {math.hypot(lateral, forward):.3g} m, {heading:.3g} rad and "
            f"{speed:.3g} m/s apart, expected at most {float(LARGEST_POSE_GAP):g} m and rad and "
            f"{float(LARGEST_SPEED_GAP):g} m/s"
        )
    return gap
