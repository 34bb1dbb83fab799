"""Inputs that are held for tens of milliseconds: what is proven, what cars do, and what an adversary finds.

    python experiments/sampled_control.py FOLDER … [--cars 100000] [--holds 20]

Each FOLDER is a run with `period=…`, one straight line or circle. A line says what is proven of the law that looks one
hold ahead; how fast V falls in truth, at the worst deviation found with the best of its inputs, held for as long, and
for two, three and four times as long; and the shortest time after which a good input, held on, led out of the funnel.
Then cars are driven, half of them from V = 1: each hold is as long as is proven, or of a random length up to it. Where
a delay is proven the poses that they see are as late as that, or less, and they predict; they start at the level of V
that is proven for it.
"""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from cfjax.control.prediction import Sent, nothing_sent, predict
from cfjax.control.sampled import choose_for_hold
from cfjax.falsifier.sampled import first_escape_of_holds, first_escape_of_start, slowest_fall
from cfjax.funnel import Funnel
from cfjax.funnel.sampled import Holds, held_motion, holds, value_of
from cfjax.problem import Problem, Segment
from cfjax.problem.runge_kutta import runge_kutta
from cfjax.report.run_folder import read_run
from cfjax.rounded import rounded_down


STEPS = 8  # of a hold, by RK4
BATCH = 10_000  # cars
REMEMBERED = 24  # inputs that a car has sent


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--cars", type=int, default=100_000)
    parser.add_argument("--holds", type=int, default=20)
    arguments = parser.parse_args()
    for folder in arguments.folders:
        result = read_run(folder)
        sampled = result.robustness and result.robustness.sampled
        if not sampled:
            parser.error(f"{folder}: expected a run with period=…, in which sampled control is proven")
        problem, funnel = result.problem, result.segments[0].funnel
        (segment,) = problem.path.curve
        inputs, bends = np.array(sampled.inputs), np.array(sampled.bends)
        numbers = holds(problem, funnel, sampled.period, sampled.order, sampled.decrease, inputs, bends)
        told = f"{rounded_down(1e3 * sampled.period, 3)} ms, order {sampled.order}, {len(inputs)} inputs"
        print(f"{folder}: {told}: V falls at {rounded_down(sampled.decrease, 3)} 1/s, proven", flush=True)
        for times in range(1, 5):
            fall = slowest_fall(problem, segment, funnel, numbers, times * sampled.period)
            print(f"  held for {times} periods: {fall:.3g} 1/s at the worst deviation found", flush=True)
        escape = first_escape_of_holds(problem, segment, funnel, numbers, 2 * sampled.period)
        print(f"  first escape found: {1e3 * escape:.4g} ms", flush=True)
        late = Late(sampled.delay, sampled.level, sampled.start)
        if late.delay:
            told = f"{1e3 * late.delay:.4g} ms, from V <= {rounded_down(late.level, 3)}"
            away = first_escape_of_start(
                problem, segment, funnel, numbers, level=late.level, horizon=8 * late.delay, start=late.start
            )
            print(f"  poses late by up to {told}: first escape found without one after {1e3 * away:.4g} ms", flush=True)
        for name, share in (("of the period", np.ones), ("of random lengths", _random)):
            driven = drive(problem, segment, funnel, numbers, arguments.cars, arguments.holds, share, late)
            print(f"  {arguments.cars} cars, {arguments.holds} holds {name}: {driven}", flush=True)
    return 0


def _random(count: int) -> np.ndarray:
    return np.random.default_rng(count).uniform(0.01, 1.0, count)


class Late(NamedTuple):
    """Poses that come late: up to `delay` (s); from V ≤ `level` on a car holds the input number `start` until then."""

    delay: float = 0.0
    level: float = 1.0
    start: int = 0


class Cars(NamedTuple):
    """(θ, x) now; what was sent, newest first, and (θ, x) where each of these inputs began: in truth."""

    z: jax.Array
    sent: Sent
    past: jax.Array


class Driven(NamedTuple):
    """What became of cars: the largest V, the slowest fall on the shell (1/s), choices without a good input."""

    largest: float
    slowest: float
    broken: int

    def __str__(self) -> str:
        return (
            f"largest V {self.largest:.9f}, slowest fall on the shell {self.slowest:.4g} 1/s, "
            f"without a good input {self.broken}"
        )


def drive(
    problem: Problem,
    segment: Segment,
    funnel: Funnel,
    numbers: Holds,
    cars: int,
    count: int,
    share: Callable[[int], np.ndarray] = np.ones,
    late: Late = Late(),
) -> Driven:
    """Drive cars for `count` holds, each as long as its share of the period.

    Where poses are late each car sees one that is as old as its share of the delay, and predicts; a first hold is that
    until the first pose. A car that comes to the end of a lap goes on in the next one, of a line it is driven anew.
    """
    rng = np.random.default_rng(0)
    step = jax.jit(jax.vmap(partial(_held, problem, segment, funnel, numbers)))
    begin_hold = jax.jit(jax.vmap(partial(_started, problem, segment, funnel, numbers, late)))
    largest, broken, slowest = 0.0, 0, np.inf
    for begin in range(0, cars, BATCH):
        z = jnp.asarray(_starts(problem, funnel, rng, min(BATCH, cars - begin), late))
        age = jnp.asarray(share(len(z)) * late.delay)
        start, values = begin_hold(z, age)
        largest = max(largest, float(values.max()))
        now = start
        for turn in range(count):
            lengths = jnp.asarray(share(len(z)) * float(numbers.period))
            age = jnp.asarray(share(len(z)) * late.delay) if turn else age
            now, before, values, good = step(now, lengths, age)
            broken += int((~good).sum())
            largest = max(largest, float(values.max()))
            fall = np.asarray((before - values[:, -1]) / lengths)
            slowest = min(slowest, float(fall[np.asarray(before) >= float(numbers.beta_lower)].min(initial=np.inf)))
            over = now.z[:, 0] >= funnel.duration
            if problem.path.closed:
                back = jnp.where(over, funnel.duration, 0.0)
                now = now._replace(z=now.z.at[:, 0].add(-back), past=now.past.at[:, :, 0].add(-back[:, None]))
            else:
                now = jax.tree.map(partial(_where, over), start, now)
    return Driven(largest, slowest, broken)


def _where(which: jax.Array, one: jax.Array, other: jax.Array) -> jax.Array:
    return jnp.where(which.reshape(-1, *[1] * (one.ndim - 1)), one, other)


def _starts(problem: Problem, funnel: Funnel, rng: np.random.Generator, count: int, late: Late) -> np.ndarray:
    """(θ, x), half of them from V = 1 or the level from which cars start whose poses are late."""
    y = rng.normal(size=(count, problem.dimension))
    level = late.level * np.where(rng.uniform(size=count) < 0.5, 1 - 1e-12, rng.uniform(size=count))
    y *= (np.sqrt(level) / np.linalg.norm(y, axis=1))[:, None]
    theta = rng.uniform(0, funnel.duration - late.delay, count)
    size = np.sqrt(np.asarray(funnel.template.level(funnel.rate, theta)))
    return np.column_stack([theta, (y @ np.linalg.inv(np.linalg.cholesky(funnel.shape))) * size[:, None]])


def _started(
    problem: Problem, segment: Segment, funnel: Funnel, numbers: Holds, late: Late, z: jax.Array, length: jax.Array
) -> tuple[Cars, jax.Array]:
    """A car after what it holds until its first pose, and V meanwhile."""
    inputs = jnp.asarray(numbers.choices[late.start])
    after, values = _moved(problem, segment, funnel, numbers, inputs, z, length)
    sent = nothing_sent(REMEMBERED, len(inputs)).then(inputs, length)
    return Cars(after, sent, jnp.tile(z, (REMEMBERED, 1))), values


def _held(
    problem: Problem, segment: Segment, funnel: Funnel, numbers: Holds, car: Cars, length: jax.Array, age: jax.Array
) -> tuple[Cars, jax.Array, jax.Array, jax.Array]:
    """A car after a hold, V before it and after each of its steps, and whether the law found a good input.

    The pose that it sees is that of `age` seconds ago.
    """
    vehicle, point = problem.vehicle, segment.point(0.0)
    ends = jnp.cumsum(car.sent.lengths)
    within = jnp.argmax(ends >= age)
    old, _ = _moved(problem, segment, funnel, numbers, car.sent.inputs[within], car.past[within], ends[within] - age)
    x = predict(vehicle, point, car.sent, age, old[1:])
    chosen = choose_for_hold(vehicle, funnel.template, numbers, point, car.z[0], x)
    after, values = _moved(problem, segment, funnel, numbers, chosen.inputs, car.z, length)
    before = value_of(funnel.template, numbers)(car.z)
    past = jnp.concatenate([car.z[None], car.past[:-1]])
    good = chosen.promised & car.sent.remembers(age)
    return Cars(after, car.sent.then(chosen.inputs, length), past), before, values, good


def _moved(
    problem: Problem,
    segment: Segment,
    funnel: Funnel,
    numbers: Holds,
    inputs: jax.Array,
    z: jax.Array,
    length: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """(θ, x) after inputs were held for so long, and V after each step."""
    motion, value = held_motion(problem.vehicle, inputs, segment.point(0.0)), value_of(funnel.template, numbers)

    def move(z: jax.Array, _: None) -> tuple[jax.Array, jax.Array]:
        z = runge_kutta(motion, z, length / STEPS)
        return z, value(z)

    return jax.lax.scan(move, z, None, length=STEPS)


if __name__ == "__main__":
    raise SystemExit(main())
