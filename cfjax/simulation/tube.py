"""Closed loop in a tube: every car on a random path of its own, whose curvature, speed and acceleration stay in bounds.

The paths are made while the cars drive. During one step of the integration curvature and acceleration are constant, so
RK4 sees smooth right-hand sides; between two steps both may jump from one end of their interval to the other, and for
part of the cars they do so at every step. Part of the paths are hostile: at each step they turn and accelerate to the
end that is worst for V at the deviation that the car has there.

Half of the cars run the law for the curvature that they are told, half the law for any curvature, and half of these are
not told it.

Steps are steps of way: a car beside a reference of speed v_r takes Δs/v_r by the clock, with Δs such that the
reference's motion and the car's together, at the worst corner of references and inputs, move the deviation by no more
than STEP_SHARE of the tube's half-width. From V = 1 a step leads down by 0.95 max(λ/v_r, μ) Δs at the least, and
RK4 is off by less than a hundredth of 1 − V however the curvature jumps (it is the kinks of the law for any curvature;
the other one comes a hundred times closer): a car that is counted as outside is outside. A test compares with finer
steps.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from cfjax.coerce import number, objects, whole
from cfjax.control import MinNorm, law_numbers, path_point
from cfjax.errors import InputError
from cfjax.funnel import Funnel, Template
from cfjax.funnel.funnel import require_fit
from cfjax.problem import (
    Interval,
    Pose,
    Problem,
    Profile,
    ReferencePoint,
    Segment,
    Tube,
    Vehicle,
    deviation_rate,
)
from cfjax.result import ClosedLoop, Rollouts
from cfjax.simulation.loop import (
    MOST_ROWS,
    RECORDED,
    ROUNDING,
    Cars,
    Loop,
    Reference,
    advance,
    fastest,
    loop_of,
    sample_starts,
    start,
)


STEP_SHARE = 1 / 10  # of the tube's half-width, per step
CONTRACTIONS, LEAST_TIME = 2.0, 10.0  # how far: contraction lengths, and s at the slowest speed
MOST_STEPS = 20_000  # a tube that contracts by less per step is not driven further
ON_TUBE = 3  # every third car starts on the tube's boundary
INSIDE = 1e-12  # relative: by how much such a start lies inside, for rounding
RAREST_JUMP, SLOWEST_CHASE = 3.5, 3.0  # decades below once, below at once, per step


class SignalModel(NamedTuple):
    """How one bounded quantity of a car's path varies; arrays of k."""

    jump: Float[Array, " k"]  # chance that its target changes, per step
    chase: Float[Array, " k"]  # share of the way to the target that it goes, per step
    bang: Bool[Array, " k"]  # targets are ends of the interval only
    hostile: Bool[Array, " k"]  # the target is the end that is worst for V


class Signal(NamedTuple):
    """A bounded quantity and where it is heading; arrays of k."""

    value: Float[Array, " k"]
    target: Float[Array, " k"]


class TubeBounds(NamedTuple):
    """The tube's intervals, lower and upper ends."""

    curvature: tuple[Array, Array]
    speed: tuple[Array, Array]
    acceleration: tuple[Array, Array]


class Paths(NamedTuple):
    """The paths of k cars at where they are."""

    speed: Float[Array, " k"]
    curvature: Signal
    acceleration: Signal


class CarTraits(NamedTuple):
    """What stays the same for each of k cars."""

    curvature: SignalModel
    acceleration: SignalModel
    robust: Bool[Array, " k"]  # held by the law for any curvature
    blind: Bool[Array, " k"]  # of those: not told the curvature


class TubeRecord(NamedTuple):
    """What is kept of a recorded car before each step."""

    clock: Array
    theta: Array
    x: tuple[Array, ...]
    reference: ReferencePoint
    inputs: tuple[Array, ...]


def _along(reference: ReferencePoint, since: Array) -> ReferencePoint:
    """The profile `since` (s of θ) later: it goes on with its slopes."""
    omega, v, omega_slope, v_slope, since = jnp.broadcast_arrays(*reference, since)
    return ReferencePoint(omega + omega_slope * since, v + v_slope * since, omega_slope, v_slope)


def going_on(actual: ReferencePoint, seen: ReferencePoint, theta: Array) -> Reference:
    """The reference along one step that begins at θ (s): what it is, and what the law is told of it."""
    return lambda now: (_along(actual, now - theta), _along(seen, now - theta))


def _uniform(key: Array, ends: tuple[Array, Array], count: int, bang: Array) -> Array:
    u = jax.random.uniform(key, (count,))
    return ends[0] + (ends[1] - ends[0]) * jnp.where(bang, (u < 0.5).astype(float), u)


def _habit(key: Array, count: int) -> SignalModel:
    """A third jumps at every step, the others less often; half of them without transition, half between the ends."""
    u = jax.random.uniform(key, (6, count))
    return SignalModel(
        jump=jnp.where(u[0] < 1 / 3, 1.0, 10 ** (-RAREST_JUMP * u[1])),
        chase=jnp.where(u[2] < 1 / 2, 1.0, 10 ** (-SLOWEST_CHASE * u[3])),
        bang=u[4] < 1 / 2,
        hostile=u[5] < 1 / 4,
    )


def _wander(key: Array, habit: SignalModel, ends: tuple[Array, Array], now: Signal, worst: Array) -> Signal:
    """One step on: a mean of where it was and a target, both in the interval, so it never leaves it."""
    key_jump, key_target = jax.random.split(key)
    count = now.value.shape[0]
    jumps = jax.random.uniform(key_jump, (count,)) < habit.jump
    target = jnp.where(jumps, _uniform(key_target, ends, count, habit.bang), now.target)
    target = jnp.where(habit.hostile, worst, target)
    return Signal(jnp.clip(now.value + habit.chase * (target - now.value), *ends), target)


def _worst_ends(
    vehicle: Vehicle, loop: Loop, bounds: TubeBounds, speed: Array, x: tuple[Array, ...]
) -> tuple[Array, Array]:
    """The ends of curvature and acceleration at which V̇ is larger; both act through u0 > 0 alone."""
    each = range(len(x))
    gradient = [sum(loop.numbers.shape[i, j] * x[j] for j in each) for i in each]
    inputs = (1.0, *(0.0,) * len(vehicle.input_names))

    def growth(curvature: Array, acceleration: Array) -> Array:
        rates = deviation_rate(vehicle, x, inputs, path_point(curvature, speed, acceleration))
        return sum((g * rate for g, rate in zip(gradient, rates, strict=True)), jnp.zeros_like(speed))

    (kappa, kappa_upper), (a, a_upper) = bounds.curvature, bounds.acceleration
    still = growth(kappa, a)
    return (
        jnp.where(growth(kappa_upper, a) > still, kappa_upper, kappa),
        jnp.where(growth(kappa, a_upper) > still, a_upper, a),
    )


@partial(jax.jit, static_argnames=("vehicle", "template", "steps", "stride"))
def drive_tube(
    vehicle: Vehicle,
    template: Template,
    loop: Loop,
    bounds: TubeBounds,
    goal: Float[Array, " n"],
    starts: Float[Array, "k n"],
    key: Array,
    steps: int,
    stride: int,
) -> tuple[Cars, Array, TubeRecord]:
    """All cars for a number of steps of `loop.step` metres each at u0 = 1; `goal` are the half-axes of G.

    Returns their final states, the largest Σ (x_i/goal_i)² of each, and the states of every `stride`-th car before each
    step (leading axis time).
    """
    count = starts.shape[0]
    key_crew, key_path, key_steps = jax.random.split(key, 3)
    keys = jax.random.split(key_crew, 4)
    role = jax.random.uniform(keys[2], (count,))
    crew = CarTraits(_habit(keys[0], count), _habit(keys[1], count), robust=role < 1 / 2, blind=role < 1 / 4)
    keys = jax.random.split(key_path, 5)
    mixed = jax.random.uniform(keys[3], (count,)) < 1 / 2
    curvature = _uniform(keys[0], bounds.curvature, count, crew.curvature.bang)
    acceleration = _uniform(keys[1], bounds.acceleration, count, crew.acceleration.bang)
    paths = Paths(
        speed=_uniform(keys[2], bounds.speed, count, mixed),
        curvature=Signal(curvature, curvature),
        acceleration=Signal(acceleration, acceleration),
    )

    def goal_share(x: tuple[Array, ...]) -> Array:
        return sum(((x[i] / goal[i]) ** 2 for i in range(len(x))), jnp.zeros(count))

    def step(carry: tuple[Cars, Paths, Array], number: Array) -> tuple[tuple[Cars, Paths, Array], TubeRecord]:
        cars, paths, worst_goal = carry
        key_curvature, key_acceleration = jax.random.split(jax.random.fold_in(key_steps, number))
        worst_curvature, worst_acceleration = _worst_ends(vehicle, loop, bounds, paths.speed, cars.x)
        kappa = _wander(key_curvature, crew.curvature, bounds.curvature, paths.curvature, worst_curvature)
        a = _wander(key_acceleration, crew.acceleration, bounds.acceleration, paths.acceleration, worst_acceleration)
        lower, upper = bounds.speed
        clock = loop.step / paths.speed
        reach = clock * loop.numbers.upper[0]  # θ may advance by this much in the step, at a speed in its interval
        held = jnp.clip(a.value, (lower - paths.speed) / reach, (upper - paths.speed) / reach)
        actual = path_point(kappa.value, paths.speed, held)
        middle = 0.5 * (bounds.curvature[0] + bounds.curvature[1])
        seen = path_point(jnp.where(crew.blind, middle, kappa.value), paths.speed, held)
        imposed = tuple(jnp.where(crew.robust, end, kappa.value) for end in bounds.curvature)
        moving = loop._replace(numbers=loop.numbers._replace(curvature=imposed), step=clock)
        after, inputs = advance(vehicle, template, MinNorm(), moving, going_on(actual, seen, cars.theta), cars)
        speed = jnp.clip(paths.speed + held * (after.theta - cars.theta), lower, upper)
        record = jax.tree.map(lambda now: now[::stride], TubeRecord(cars.clock, cars.theta, cars.x, actual, inputs))
        return (after, Paths(speed, kappa, a), jnp.maximum(worst_goal, goal_share(after.x))), record

    cars = start(template, loop, starts)
    (cars, _, worst_goal), history = jax.lax.scan(step, (cars, paths, goal_share(cars.x)), jnp.arange(steps))
    return cars, worst_goal, history


def step_length(problem: Problem, tube: Tube, funnel: Funnel) -> float:
    """Δs in m: STEP_SHARE over the largest |ẋ|/v_r at x = 0, over the corners of references and of the input box."""
    points = np.array([point for group in tube.references() for point in group], float)
    return STEP_SHARE / float((fastest(problem, funnel, points) / points[:, 1]).max())


def _contraction_length(problem: Problem, funnel: Funnel, margin_per_metre: float) -> float:
    """Way of the reference, m, after which V has come from 1 down to β_in at the latest."""
    beta, inner = funnel.beta_lower, funnel.inner
    return problem.inputs[0].upper * (1 - beta + beta * math.log(beta / inner)) / margin_per_metre


def _starts(key: Array, problem: Problem, funnel: Funnel, count: int) -> Float[Array, "count n"]:
    """Every third car on the boundary of the tube, inside by rounding only; the others in I as `sample_starts` does."""
    key_tube, key_inlet = jax.random.split(key)
    direction = np.asarray(jax.random.normal(key_tube, (count, problem.dimension)))
    on_tube = direction * ((1 - INSIDE) / np.sqrt(funnel.form(direction)))[:, None]
    in_inlet = sample_starts(key_inlet, problem.inlet, count)
    return jnp.where(jnp.arange(count)[:, None] % ON_TUBE == 0, jnp.asarray(on_tube), in_inlet)


def _reference_poses(
    history: TubeRecord, end_theta: Float[np.ndarray, " k"], side_slip: float
) -> Float[np.ndarray, "t k 3"]:
    """Poses of each recorded car's reference, whose path starts in the origin: its stretches make a segment of it.

    The reference looks away from its path by the side slip (rad).
    """
    theta = np.asarray(history.theta)
    omega, v, omega_slope, v_slope = (np.asarray(values) for values in history.reference)
    poses = []
    for car in range(theta.shape[1]):
        breaks = (*theta[:, car].tolist(), float(end_theta[car]))

        def profile(start: np.ndarray, slope: np.ndarray, breaks: tuple[float, ...] = breaks, k: int = car) -> Profile:
            return Profile(breaks, tuple(zip(start[:, k].tolist(), slope[:, k].tolist(), strict=True)))

        path = Segment(profile(omega, omega_slope), profile(v, v_slope), Pose(0.0, 0.0, 0.0))
        poses.append(path.poses(theta[:, car]) + np.array([side_slip, 0.0, 0.0]))
    return np.stack(poses, axis=1)


def drive_tube_cars(
    problem: Problem,
    funnel: Funnel,
    margin: float,
    margin_per_metre: float,
    *,
    cars: int,
    seed: int = 0,
    way: float | None = None,
) -> tuple[ClosedLoop, Rollouts]:
    """Drive `cars` cars along random paths of the problem's tube, under the laws of the margins λ (1/s) and μ (1/m).

    A third of them starts on the boundary of {V ≤ 1}, a third on that of I, a third inside I. `way` is how far (m) the
    references go at u0 = 1; where nobody says, CONTRACTIONS times the way that contracts V from 1 to β_in at the latest
    (by the margin per metre, at the fastest timing), and at least LEAST_TIME seconds at the slowest speed; at most
    MOST_STEPS steps.

    Returns what went wrong, and the recorded way of a few of them. A car has left if V ever exceeds 1, or if it is ever
    outside S or G.

    Raises:
        InputError: where the problem is not about a tube, or no path of the tube goes on for ever: its acceleration is
            never zero.
    """
    objects(problem=(problem, Problem), funnel=(funnel, Funnel))
    require_fit(problem, [funnel])
    margin, margin_per_metre = number("margin", margin, "1/s"), number("margin_per_metre", margin_per_metre, "1/m")
    cars, seed = whole("cars", cars, 1), whole("seed", seed, 0)
    way = None if way is None else number("way", way, "m", above=0)
    tube = problem.path.require_tube()
    if 0.0 not in tube.acceleration:
        ends = f"[{tube.acceleration.lower:g}, {tube.acceleration.upper:g}]"
        raise InputError(f"path.acceleration: expected an interval around zero, for cars to drive on, got {ends}")
    length = step_length(problem, tube, funnel)
    if way is None:
        contraction = _contraction_length(problem, funnel, margin_per_metre)
        way = max(CONTRACTIONS * contraction, LEAST_TIME * tube.speed.lower)
    steps = min(math.ceil(way / length), MOST_STEPS)
    key_starts, key_drive = jax.random.split(jax.random.key(seed))
    numbers = law_numbers(problem, funnel, margin, margin_per_metre, tube.curvature)

    def as_pair(interval: Interval) -> tuple[Array, Array]:
        return jnp.asarray(interval.lower, float), jnp.asarray(interval.upper, float)

    stride = max(1, cars // RECORDED)
    driven = drive_tube(
        problem.vehicle,
        funnel.template,
        loop_of(problem, numbers, length),
        TubeBounds(as_pair(tube.curvature), as_pair(tube.speed), as_pair(tube.acceleration)),
        jnp.array(problem.goal_axes),
        _starts(key_starts, problem, funnel, cars),
        key_drive,
        steps,
        stride,
    )
    end, worst_goal, history = jax.block_until_ready(driven)
    largest = np.asarray(end.largest_value)
    summary = ClosedLoop(
        cars=cars,
        left_funnel=int((~(largest <= 1 + ROUNDING)).sum()),
        left_safe=int((~(np.asarray(end.worst_safe) <= 1 + ROUNDING)).sum()),
        missed_goal=int((~(np.asarray(worst_goal) <= 1 + ROUNDING)).sum()),
        largest_value=float(largest.max()),
        arrival=None,
    )
    shown = slice(None, None, math.ceil(steps / MOST_ROWS))
    poses = _reference_poses(history, np.asarray(end.theta[::stride]), problem.side_slip)
    x = np.stack(history.x, axis=-1)[shown]
    theta, clock = np.asarray(history.theta)[shown], np.asarray(history.clock)[shown]
    inputs = np.stack(history.inputs, axis=-1)[shown]
    return summary, Rollouts(clock, theta, x, funnel.value(theta, x), inputs, poses[shown])
