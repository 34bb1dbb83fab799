"""Many problems through few lanes: what converges makes room, so that nobody waits for the slowest of a batch.

Problems need between two and a hundred iterations. A batch that iterates until its last one is done does most of its
work for nothing; here a fixed number of lanes iterates, small enough for the processor's cache, and whenever an eighth
of them is done the results are put away and the next problems take their places.
"""

from functools import partial
from typing import Any, Final, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from cfjax.demonstrator.box import COMPILER
from cfjax.demonstrator.ddp import Trajectories, backward, followed, rollout
from cfjax.demonstrator.task import Task
from cfjax.problem import Vehicle
from cfjax.problem.vehicle import Scalar


LANES: Final = 512
STILL: Final = 1e-10  # cost: less is the reference itself, as far as floating point can tell
CHANGED: Final = 1 / 8  # of the lanes, before results are put away
FIRST_DAMPING: Final = 0.1  # of the inputs' half-widths; the weight of the smallest problem's effort is of that size
LEAST_DAMPING: Final = 1e-8  # below it there is nothing left to feel
SOME_DAMPING: Final = 1e-3  # at least, after a step that was taken back
MOST_DAMPING: Final = 1e8  # beyond it no step is left: a plan that cannot be improved in floating point
ACCEPTED: Final = 0.05  # of the promised fall of the cost: a step with less is taken back
TRUSTED: Final = 0.5  # of it: the damping falls
CALMER: Final = 0.1  # the damping then
STRICTER: Final = 8.0  # the damping after a step that was taken back


class Lanes(NamedTuple):
    """The problems in work; arrays end in one entry per lane."""

    number: Int[Array, " w"]  # of the problem; one too many where there is none
    plan: Trajectories
    damping: Float[Array, " w"]
    iterations: Int[Array, " w"]
    residual: Float[Array, " w"]
    converged: Bool[Array, " w"]
    finished: Bool[Array, " w"]


class Solved(NamedTuple):
    """Results, one problem per entry of the last axis."""

    inputs: Float[Array, "N m k"]
    cost: Float[Array, " k"]
    residual: Float[Array, " k"]  # relative to the cost
    converged: Bool[Array, " k"]
    iterations: Int[Array, " k"]


def improved(vehicle: Vehicle, task: Task, lanes: Lanes, tolerance: Scalar, most: Scalar) -> Lanes:
    """Every unfinished lane after one iteration: a step that keeps its promise is taken, else the damping rises."""
    policy = backward(vehicle, task, lanes.plan, lanes.damping)
    converged = policy.residual <= tolerance * jnp.maximum(lanes.plan.cost, STILL)
    trial = followed(vehicle, task, lanes.plan, policy)
    fall = lanes.plan.cost - trial.cost
    open_ = ~(lanes.finished | converged)
    taken = open_ & (fall > ACCEPTED * policy.promise) & (fall > 0)
    calmer = jnp.where(fall > TRUSTED * policy.promise, CALMER, 1.0) * lanes.damping
    stricter = jnp.maximum(STRICTER * lanes.damping, SOME_DAMPING)
    damping = jnp.where(taken, jnp.maximum(calmer, LEAST_DAMPING), stricter)
    iterations = lanes.iterations + open_
    stuck = (damping > MOST_DAMPING) | ~jnp.isfinite(lanes.plan.cost)
    return Lanes(
        lanes.number,
        _chosen(taken, trial, lanes.plan),
        jnp.where(open_, damping, lanes.damping),
        iterations,
        jnp.where(lanes.finished, lanes.residual, policy.residual),
        lanes.converged | (converged & ~lanes.finished),
        ~open_ | (iterations >= most) | stuck,
    )


def _chosen(which: Bool[Array, " w"], new: Any, old: Any) -> Any:
    """Lane by lane one of two pytrees."""
    return jax.tree.map(lambda a, b: jnp.where(which.reshape((1,) * (a.ndim - 1) + (-1,)), a, b), new, old)


@partial(jax.jit, static_argnames=("vehicle", "lanes"), compiler_options=COMPILER)
def solve_all(
    vehicle: Vehicle,
    task: Task,
    starts: Float[Array, "z k"],
    guesses: Float[Array, "N m k"],
    tolerance: Scalar,
    most: Scalar,
    lanes: int = LANES,
) -> Solved:
    """All problems, each from its guess of the inputs."""
    count = starts.shape[1]
    width = min(count, lanes)

    def entering(numbers: Array) -> Lanes:
        at = jnp.minimum(numbers, count - 1)
        idle, none = numbers >= count, jnp.zeros(width)
        plan = rollout(vehicle, task, starts[:, at], guesses[:, :, at])
        return Lanes(numbers, plan, none + FIRST_DAMPING, none.astype(int), none, idle & False, idle)

    def store(solved: Solved, lanes: Lanes) -> Solved:
        at = jnp.where(lanes.finished, lanes.number, count)
        found = Solved(
            lanes.plan.inputs,
            lanes.plan.cost,
            lanes.residual / jnp.where(lanes.plan.cost > 0, lanes.plan.cost, 1.0),
            lanes.converged,
            lanes.iterations,
        )
        return jax.tree.map(lambda all_, new: all_.at[..., at].set(new, mode="drop"), solved, found)

    def work(carry: tuple[Array, Lanes, Solved]) -> tuple[Array, Lanes, Solved]:
        following, lanes, solved = carry
        idle = jnp.sum(lanes.number >= count)
        enough = jnp.where(following < count, max(1, int(CHANGED * width)), width - idle)

        def unfinished(lanes: Lanes) -> Array:
            return jnp.sum(lanes.finished) - idle < enough

        lanes = jax.lax.while_loop(unfinished, lambda now: improved(vehicle, task, now, tolerance, most), lanes)
        solved = store(solved, lanes)
        numbers = following + jnp.cumsum(lanes.finished) - 1
        numbers = jnp.where(lanes.finished, jnp.minimum(numbers, count), lanes.number)
        left = jnp.minimum(following + jnp.sum(lanes.finished), count)
        return left, _chosen(lanes.finished, entering(numbers), lanes), solved

    empty = Solved(
        jnp.zeros_like(guesses), jnp.zeros(count), jnp.zeros(count), jnp.zeros(count, bool), jnp.zeros(count, int)
    )
    first = entering(jnp.arange(width))
    carry = (jnp.asarray(width), first, empty)
    return jax.lax.while_loop(lambda carry: jnp.any(carry[1].number < count), work, carry)[2]
