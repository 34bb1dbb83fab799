"""Inputs that are held for tens of milliseconds: what is proven, what cars do, and what an adversary finds.

    python experiments/sampled_control.py FOLDER … [--cars 100000] [--holds 20]

Each FOLDER is a run with `period=…`, one straight line or circle. A line says what is proven of the law that looks one
hold ahead; how fast V falls in truth, at the worst deviation found with the best of its inputs, held for as long, and
for two, three and four times as long; and the shortest time after which a good input, held on, led out of the funnel.
Then cars are driven, half of them from V = 1: each hold is as long as is proven, or of a random length up to it.
"""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from cfjax.control.sampled import choose_for_hold
from cfjax.falsifier.sampled import first_escape_of_holds, slowest_fall
from cfjax.funnel import Funnel
from cfjax.funnel.sampled import Holds, holds
from cfjax.problem import Problem, Segment, deviation_rate
from cfjax.problem.runge_kutta import runge_kutta
from cfjax.report.run_folder import read_run
from cfjax.rounded import rounded_down


STEPS = 8  # of a hold, by RK4
BATCH = 10_000  # cars


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
        for name, share in (("holds of the period", np.ones), ("holds of random lengths", _random)):
            driven = _drive(problem, segment, funnel, numbers, arguments.cars, arguments.holds, share)
            print(f"  {arguments.cars} cars, {arguments.holds} {name}: {driven}", flush=True)
    return 0


def _random(count: int) -> np.ndarray:
    return np.random.default_rng(count).uniform(0.01, 1.0, count)


def _drive(
    problem: Problem,
    segment: Segment,
    funnel: Funnel,
    numbers: Holds,
    cars: int,
    count: int,
    share: Callable[[int], np.ndarray],
) -> str:
    """What became of the cars. One that comes to the end of a lap goes on in the next, of a line it is driven anew."""
    rng = np.random.default_rng(0)
    step = jax.jit(jax.vmap(partial(_held, problem, segment, funnel, numbers)))
    largest, broken, slowest = 0.0, 0, np.inf
    for begin in range(0, cars, BATCH):
        start = z = _starts(problem, funnel, rng, min(BATCH, cars - begin))
        for _ in range(count):
            lengths = share(len(z)) * float(numbers.period)
            after, before, values, promised = map(np.asarray, step(jnp.asarray(z), jnp.asarray(lengths)))
            broken += int((~promised).sum())
            largest = max(largest, float(values.max()))
            on_shell = before >= float(numbers.beta_lower)
            fall = (before - values[:, -1]) / lengths
            slowest = min(slowest, float(fall[on_shell].min(initial=np.inf)))
            over = after[:, :1] >= funnel.duration
            lap = after - np.eye(1, z.shape[1]) * funnel.duration
            z = np.where(over, lap if problem.path.closed else start, after)
    return f"largest V {largest:.9f}, slowest fall on the shell {slowest:.4g} 1/s, without a good input {broken}"


def _starts(problem: Problem, funnel: Funnel, rng: np.random.Generator, count: int) -> np.ndarray:
    """(θ, x), half of them from V = 1."""
    y = rng.normal(size=(count, problem.dimension))
    level = np.where(rng.uniform(size=count) < 0.5, 1 - 1e-12, rng.uniform(size=count))
    y *= (np.sqrt(level) / np.linalg.norm(y, axis=1))[:, None]
    theta = rng.uniform(0, funnel.duration, count)
    size = np.sqrt(np.asarray(funnel.template.level(funnel.rate, theta)))
    return np.column_stack([theta, (y @ np.linalg.inv(np.linalg.cholesky(funnel.shape))) * size[:, None]])


def _held(
    problem: Problem, segment: Segment, funnel: Funnel, numbers: Holds, z: jax.Array, length: jax.Array
) -> tuple[Any, ...]:
    """(θ, x) after a hold, V before it and after each of its steps, and whether the law found a good input."""
    vehicle, point = problem.vehicle, segment.point(0.0)
    chosen = choose_for_hold(vehicle, funnel.template, numbers, point, z[0], z[1:])

    def value(z: jax.Array) -> jax.Array:
        return jnp.asarray(funnel.template.value(funnel.rate, z[0], z[1:] @ numbers.shape @ z[1:]))

    def motion(z: jax.Array) -> jax.Array:
        return jnp.stack([chosen.inputs[0], *deviation_rate(vehicle, tuple(z[1:]), tuple(chosen.inputs), point)])

    def move(z: jax.Array, _: None) -> tuple[jax.Array, jax.Array]:
        z = runge_kutta(motion, z, length / STEPS)
        return z, value(z)

    after, values = jax.lax.scan(move, z, None, length=STEPS)
    return after, value(z), values, chosen.promised


if __name__ == "__main__":
    raise SystemExit(main())
