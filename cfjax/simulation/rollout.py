"""Cars along a path: through one funnel after another, beside obstacles.

A path is driven in legs: stretches of θ that have a funnel each. Where a car reaches the end of its leg it is put there
and goes on in the next funnel, so that no step takes one funnel's law into another's. The same is done where turning
rate, speed or acceleration of the path jump, or such a step would be off by O(h). Where the path's polynomials only
have a kink no car is stopped: a step across it is off by O(h²).
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import export
from jaxtyping import Array, Float, Int

from cfjax.coerce import instances, objects, whole
from cfjax.control import Given, Law, MinNorm
from cfjax.control.legs import MEETS, leg_arrays
from cfjax.errors import InputError
from cfjax.funnel import Funnel, Leg, Template
from cfjax.problem import Problem, Vehicle
from cfjax.problem.course import Pieces, point_at, poses_of, profiles_of
from cfjax.problem.traced_vehicle import traced_vehicle
from cfjax.result import ClosedLoop, Rollouts
from cfjax.simulation.clearance import ObstacleArrays, clearance, surroundings
from cfjax.simulation.loop import (
    MOST_ROWS,
    RECORDED,
    ROUNDING,
    Cars,
    Loop,
    advance,
    enter,
    fastest,
    loop_of,
    sample_starts,
    start,
)
from cfjax.simulation.tube import drive_tube_cars
from cfjax.traced import Traced, traced


STEPS = 400  # of reference time for a whole path, at least; u0 ≥ 1/2 takes at most twice as many
STEP_SHARE = 1 / 5  # of the funnel scaled to a half-width of 1 rad in heading: per step at full inputs, at most
JUMP = 1e-6  # relative to the largest along the path: less is rounding
SHARED = 1000  # cars, from which on they are driven in two shares
OPTIONS = (("xla_cpu_prefer_vector_width", 512),)  # a quarter less time where a processor has such vectors


class Legs(NamedTuple):
    """The legs, cut where the path jumps, as arrays: every leaf has a leading axis of legs."""

    loop: Loop
    first: Array | np.ndarray  # of the path's pieces
    last: Array | np.ndarray

    def of(self, leg: Array) -> "Legs":
        """What each car needs in its leg, cars on the last axis; the same for all where there is but one leg."""
        if self.first.shape[0] == 1:
            return jax.tree.map(lambda leaf: leaf[0], self)
        return jax.tree.map(lambda leaf: jnp.moveaxis(leaf[leg], 0, -1), self)


class Driven(NamedTuple):
    """Cars on their way: arrays of k."""

    cars: Cars
    leg: Array
    clearance: Array  # m to the nearest obstacle, the least so far; inf where there are none


class CarRecord(NamedTuple):
    """What is kept of a recorded car before a step."""

    clock: Array
    theta: Array
    x: tuple[Array, ...]
    value: Array
    inputs: tuple[Array, ...]


for _kind in (Cars, Driven, CarRecord):
    export.register_namedtuple_serialization(_kind, serialized_name=f"{_kind.__module__}.{_kind.__name__}")


def drive(
    vehicle: Vehicle,
    template: Template,
    law: Law,
    rows: int,
    stride: int,
    legs: Legs,
    profiles: Pieces,
    obstacles: tuple[Pieces, ObstacleArrays] | None,
    starts: Float[Array, "k n"],
    limit: Int[Array, ""],
    every: Int[Array, ""],
) -> tuple[Driven, CarRecord]:
    """All cars, driven until each has arrived, at most `limit` steps; `obstacles` come with the poses along the path.

    Returns their final states, and a record of each `stride`-th car before each `every`-th step: leading axis time, so
    many rows; those after the last arrival repeat it. A last step, in which no car moves any more, tells the inputs
    there. One compiled program serves ways of every length.
    """
    final = legs.first.shape[0] - 1
    finish = legs.loop.end[final]

    def apart(cars: Cars) -> Array:
        if obstacles is None:
            return jnp.full_like(cars.theta, jnp.inf)
        poses, around = obstacles
        pose = tuple(place for place, _ in poses.at(poses.find(cars.theta), cars.theta))
        return clearance(around, pose, cars.x)

    def entered(driven: Driven, own: Legs) -> tuple[Driven, Legs]:
        """Cars at the end of their leg go on in the next: their V is that of its funnel from now on."""
        if not final:
            return driven, own
        leg = jnp.minimum(driven.leg + (driven.cars.theta >= own.loop.end), final)
        # few steps take a car into another leg: looking up all of a law costs as much as the rest of a step
        own = jax.lax.cond(jnp.any(leg != driven.leg), lambda: legs.of(leg), lambda: own)
        return driven._replace(cars=enter(template, own.loop, driven.cars), leg=leg), own

    def running(carry: tuple[Array, Array, Driven, Legs, CarRecord, CarRecord]) -> Array:
        count, is_moving, *_ = carry
        return (count < limit) & is_moving

    def recorded(cars: Cars, inputs: tuple[Array, ...]) -> CarRecord:
        return jax.tree.map(lambda now: now[::stride], CarRecord(cars.clock, cars.theta, cars.x, cars.value, inputs))

    def step(carry: tuple[Array, Array, Driven, Legs, CarRecord, CarRecord]) -> tuple:
        count, _, driven, own, history, _ = carry
        driven, own = entered(driven, own)

        def reference(theta: Array) -> tuple:
            # the leg's own pieces go on beyond its ends: a step that passes one does not see what follows
            point = point_at(profiles, jnp.clip(profiles.find(theta), own.first, own.last), theta)
            return point, point

        cars, inputs = advance(vehicle, template, law, own.loop, reference, driven.cars)
        before = recorded(driven.cars, inputs)
        row = jnp.where(count % every == 0, count // every, rows)  # beyond the last: dropped
        history = jax.tree.map(lambda past, now: past.at[row].set(now, mode="drop"), history, before)
        is_moving = jnp.any(driven.cars.theta < finish)
        driven = Driven(cars, driven.leg, jnp.minimum(driven.clearance, apart(cars)))
        return count + 1, is_moving, driven, own, history, before

    none = jnp.zeros(starts.shape[0], int)
    own = legs.of(none)
    cars = start(template, own.loop, starts)
    driven = Driven(cars, none, apart(cars))
    nothing = recorded(cars, (jnp.zeros_like(cars.theta),) * (1 + len(vehicle.input_names)))
    empty = jax.tree.map(lambda now: jnp.zeros((rows, *now.shape)), nothing)
    begin = (jnp.zeros((), int), jnp.ones((), bool), driven, own, empty, nothing)
    count, _, driven, _, history, last = jax.lax.while_loop(running, step, begin)
    after = jnp.arange(rows)[:, None] * every >= count
    history = jax.tree.map(lambda past, now: jnp.where(after, now[None], past), history, last)
    return driven, history


def _jumps(profiles: Pieces) -> Float[np.ndarray, " j"]:
    """θ (s) at which turning rate, speed or acceleration of the path jump."""
    begin = np.asarray(profiles.begin)
    before, after = np.arange(len(begin) - 1), np.arange(1, len(begin))
    sides = [point_at(profiles, piece, begin[1:]) for piece in (before, after)]
    jumps = np.zeros(len(before), bool)
    for name in ("turn_rate", "speed", "speed_slope") if len(before) else ():
        left, right = (np.asarray(getattr(side, name)) for side in sides)
        jumps |= np.abs(right - left) > JUMP * np.abs([left, right]).max()
    return begin[1:][jumps]


def table_of(problem: Problem, legs: Sequence[Leg], profiles: Pieces) -> Legs:
    """The legs as arrays, cut where the path jumps, with the step of each.

    Raises:
        InputError: as `leg_arrays`.
    """
    arrays = leg_arrays(problem, legs)
    whole = arrays.end[-1]
    margin = MEETS * whole  # an end and the break that it stands for may be computed in two ways
    pieces, jumps = np.asarray(profiles.begin), _jumps(profiles)
    loops, firsts, lasts = [], [], []
    for index, (leg, begin, end) in enumerate(zip(legs, arrays.begin, arrays.end, strict=True)):
        cuts = [begin, *jumps[(jumps > begin + margin) & (jumps < end - margin)], end]
        for since, until in itertools.pairwise(cuts):
            first = int(np.searchsorted(pieces, since + margin, side="right")) - 1
            last = int(np.searchsorted(pieces, until - margin, side="left")) - 1
            theta = np.array([since, *pieces[first + 1 : last + 1], until])
            step = min(whole / STEPS, _step(problem, leg.funnel, profiles, np.arange(first, last + 1), theta))
            # V counts from the leg's begin
            loops.append(loop_of(problem, arrays.of(index), step, float(begin), float(until)))
            firsts.append(first)
            lasts.append(last)
    return Legs(jax.tree.map(lambda *leaves: np.stack(leaves), *loops), np.array(firsts), np.array(lasts))


def _step(
    problem: Problem, funnel: Funnel, profiles: Pieces, piece: Int[np.ndarray, " m"], ends: Float[np.ndarray, " m+1"]
) -> float:
    """The step (s) in which full inputs move a car on the reference by STEP_SHARE of a funnel of this shape.

    Of the shape, not of the size: near the reference the law is as steep in a narrow funnel as in a wide one, and so
    are errors relative to it. Vehicles that are similar take as many steps, and their number grows with the path's
    length. Looked at in the middle and at both ends of the path's pieces, which lie between `ends`.
    """
    rows = [
        np.stack([np.broadcast_to(field, piece.shape) for field in point_at(profiles, piece, at)], axis=1)
        for at in (ends[:-1], 0.5 * (ends[1:] + ends[:-1]), ends[1:])
    ]
    points = np.unique(np.concatenate(rows), axis=0)
    heading = float(np.sqrt(np.linalg.inv(funnel.shape)[0, 0]))
    return STEP_SHARE / (heading * float(fastest(problem, funnel, points).max()))


class _Launch(NamedTuple):
    """A question to `drive`: the compiled program, and what it is given for each share of the cars."""

    program: Traced
    arguments: list[tuple[Legs, Pieces, tuple[Pieces, ObstacleArrays] | None, Float[np.ndarray, "k n"], int, int]]

    @property
    def end(self) -> float:
        """θ (s) of the path's end."""
        return float(np.asarray(self.arguments[0][0].loop.end)[-1])

    def answer(self) -> tuple[Driven, CarRecord]:
        """The cars of all shares, which are driven at the same time."""
        return jax.tree.map(lambda *shares: np.concatenate(shares, axis=-1), *self.program.side_by_side(self.arguments))


def _launch(problem: Problem, legs: Sequence[Leg], cars: int, seed: int, law: Law | None) -> _Launch:
    """Cars from random places in I.

    Raises:
        InputError: as `drive_cars`.
    """
    template = leg_arrays(problem, legs).template
    cars, seed = whole("cars", cars, 1), whole("seed", seed, 0)
    law = (MinNorm() if problem.law is None else Given()) if law is None else law
    objects(law=(law, Law))
    profiles = profiles_of(problem.path)
    table = table_of(problem, legs, profiles)
    around = None
    if problem.obstacles:
        around = (poses_of(problem.path, problem.side_slip), surroundings(problem.obstacles, problem.footprint))
    end, step = np.asarray(table.loop.end), np.asarray(table.loop.step)
    # at the slowest timing; each leg ends within a step of its own
    limit = int(np.ceil(np.diff(end, prepend=0.0) / step / problem.inputs[0].lower + 1).sum()) + 1
    every = math.ceil(limit / MOST_ROWS)
    # an array that did not fit says so here; NumPy would end the process
    starts = jax.block_until_ready(sample_starts(jax.random.key(seed), problem.inlet, cars))
    numbers = MOST_ROWS + 1, max(1, cars // RECORDED)
    program = traced(drive, traced_vehicle(problem.driven), template, law, *numbers, options=OPTIONS)
    shares = 2 if cars >= SHARED and cars % 2 == 0 else 1
    return _Launch(
        program, [(table, profiles, around, own, limit, every) for own in np.split(np.asarray(starts), shares)]
    )


def prepare_cars(problem: Problem, template: Template, *, cars: int, law: Law | None = None) -> None:
    """Compile what `drive_cars` asks for once all segments have funnels; any will do for that."""
    shape = np.diag(1 / np.array(problem.inlet.half_axes) ** 2)
    course = problem.path.require_course()
    ends = np.cumsum([segment.duration for segment in course])
    legs = [
        Leg(float(end), Funnel(template, shape, 0.0, segment.duration), 1.0)
        for segment, end in zip(course, ends, strict=True)
    ]
    launch = _launch(problem, legs, cars, 0, law)
    launch.program.prepare(*launch.arguments[0])


def drive_cars(
    problem: Problem, legs: Sequence[Leg], *, cars: int, seed: int = 0, law: Law | None = None
) -> tuple[ClosedLoop, Rollouts]:
    """Drive `cars` cars from random deviations of I at θ = 0 to the path's end, each leg under the law of its margins.

    In a tube, one leg without end, each car has a path of its own (`drive_tube_cars`), under the min-norm law.
    The law is the problem's own where it has one and none is given, else the min-norm law.

    The cars know where they are on the path: the law reads the reference at their θ. What is counted is looked at after
    each step, and V at the end of a leg in both funnels. A car has left S if it leaves the box or if its footprint
    overlaps an obstacle; one that is lost (not a number) has failed in everything.

    Returns what went wrong and when they arrived, and the recorded way of a few of them: θ along the whole path, V in
    the funnel of the leg in which the car is. Of a long way not every step is recorded.

    Raises:
        InputError: where the legs do not lead along the path, or their funnels have several templates.
    """
    objects(problem=(problem, Problem))
    if problem.path.tube:
        (leg,) = instances("legs", legs, Leg)
        if leg.margin_per_metre <= 0:
            raise InputError("legs: expected one with a margin per metre, as tubes have, got one without")
        return drive_tube_cars(problem, leg.funnel, leg.margin, leg.margin_per_metre, cars=cars, seed=seed)
    launch = _launch(problem, legs, cars, seed, law)
    (last, _, clear), history = launch.answer()
    rows = 1 + int((history.clock < history.clock[-1]).any(axis=1).sum())
    goal = np.stack(last.x, axis=-1) / np.array(problem.goal_axes)
    arrived = last.theta >= launch.end
    largest, clock = last.largest_value, last.clock[arrived]
    inside = (last.worst_safe <= 1 + ROUNDING) & (clear >= -ROUNDING)
    summary = ClosedLoop(
        cars=cars,
        left_funnel=int((~(largest <= 1 + ROUNDING)).sum()),
        left_safe=int((~inside).sum()),
        missed_goal=int((~(arrived & ((goal**2).sum(axis=1) < 1))).sum()),
        largest_value=float(largest.max()),
        arrival=(float(clock.min()), float(clock.max())) if clock.size else None,
    )
    clock, theta, value = (np.asarray(kept)[:rows] for kept in (history.clock, history.theta, history.value))
    x, inputs = (np.stack(kept, axis=-1)[:rows] for kept in (history.x, history.inputs))
    return summary, Rollouts(clock, theta, x, value, inputs)
