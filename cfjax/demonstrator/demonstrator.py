"""Demonstrations: what a controller that looks ahead would do, for many deviations at once.

A finite-horizon optimal-control problem by shooting: inputs (u0, *vehicle inputs) constant over intervals, anywhere in
their box; the cost is the distance from the reference and effort. Path following may choose its timing u0, for
trajectory tracking it is 1. Solved by control-limited differential dynamic programming (Y. Tassa, N. Mansard and
E. Todorov, "Control-limited differential dynamic programming", ICRA 2014), with the Gauss–Newton Hessian:

- the box is in the loop: each backward step solves a quadratic program over the box of one interval's inputs, three or
  four numbers, so limits are kept exactly and inputs at a limit leave the feedback. Penalties, squashing or a barrier
  would need their own loop and never quite reach a limit, where best inputs mostly are;
- every iterate is a trajectory, so what has not converged is still a demonstration;
- its work is the same small dense steps for every problem: a batch runs side by side. A sparse interior-point method
  has to factor a system of hundreds of unknowns for each, a projected gradient method needs hundreds of iterations.

In place of a search along the line the step is damped (Levenberg–Marquardt): a step that does not lower the cost by a
fair share of what the model promises is taken back and tried again with more damping, each problem at its own pace.

**Nothing here is trusted.** A demonstration is a local minimum of a discretised problem. What is learned from it is
checked by falsifier and certifier.
"""

from functools import partial
from typing import Final, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike

from cfjax.coerce import array, instance, number, whole
from cfjax.demonstrator.ddp import rollout
from cfjax.demonstrator.pool import Solved, solve_all
from cfjax.demonstrator.task import Task, Weights, piece_of, resting, task_of, weights_of
from cfjax.errors import InputError
from cfjax.problem import Problem, Vehicle


TOLERANCE: Final = 1e-4  # of the cost: a half-width of any one input would change it by no more, to first order
MOST_ITERATIONS: Final = 100
STRIDE: Final = 0.2  # m of the reference's way in one interval
LONGEST: Final = 0.1  # s of one interval
ROUNDED: Final = 1e-9  # of the largest entry, by which weights may be off


class Horizon(NamedTuple):
    """How far ahead: `steps` intervals of `step` s; `horizon_of` has one that fits a problem."""

    steps: int = 20
    step: float = 0.1


def horizon_of(problem: Problem, steps: int = 20) -> Horizon:
    """So long as one Runge–Kutta step per interval sees the motion: no more than `STRIDE` at the path's highest speed.

    No step is longer than `LONGEST`, and the horizon no longer than the path.
    """
    steps = whole("steps", steps, 1)
    path = instance("problem", problem, Problem).path
    fastest = max(segment.top_speed for segment in path.distinct)
    return Horizon(steps, float(min(LONGEST, STRIDE / fastest, path.duration / steps)))


class Demonstration(NamedTuple):
    """What to do at k deviations, and what is expected to come of it."""

    inputs: Float[Array, "k m"]  # the first ones, (u0, *vehicle inputs), inside the box
    plan: Float[Array, "k N m"]  # all inputs, one row per interval
    states: Float[Array, "k N+1 n"]  # deviations at the ends of the intervals
    theta: Float[Array, "k N+1"]  # s along the path
    cost: Float[Array, " k"]
    converged: Bool[Array, " k"]  # the residual is below the tolerance, or the cost is next to nothing (`pool.STILL`)
    residual: Float[Array, " k"]  # to first order: the largest effect of a half-width of any one input, over the cost
    iterations: Int[Array, " k"]

    def next_plan(self) -> Float[Array, "k N m"]:
        """The warm start for one interval later: the plan without its first inputs, the last ones twice."""
        return jnp.concatenate([self.plan[:, 1:], self.plan[:, -1:]], axis=1)


def demonstrate(
    problem: Problem,
    x: ArrayLike,
    theta: ArrayLike | None = None,
    *,
    horizon: Horizon | None = None,
    weights: Weights | None = None,
    warm: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
    most_iterations: int = MOST_ITERATIONS,
) -> Demonstration:
    """The best inputs over the horizon from deviations x at θ, all of them at once.

    Along a path θ moves with u0 and the reference with it; beyond the end of the path it stays as it is there. On a
    steady path, and in a tube (of which the reference is the middle of its bounds), θ has no influence.

    Args:
        problem: the vehicle, its input box, the path. Its sets only scale the default weights, nothing keeps to them.
        x: deviations (k, n): rad, m, m, units of the internal states. Of any size: headings beyond π are not wrapped.
        theta: (k,) s along the whole path, from 0 on; 0 if not given.
        horizon: intervals; `horizon_of(problem)` if not given.
        weights: of the cost; `weights_of(problem)` if not given.
        warm: inputs (k, N, m) to begin with, e.g. `Demonstration.next_plan()` of the interval before; clipped into the
            box. If not given, the feed-forward of the reference at the start.
        tolerance: of the optimality conditions, see `Demonstration.residual`.
        most_iterations: of backward and forward passes; what needs more comes back as it is, not converged.

    Raises:
        InputError: for shapes that do not fit, numbers that are not finite, a θ before the path, and weights that are
            not symmetric and positive semidefinite.
    """
    n, m = instance("problem", problem, Problem).dimension, len(problem.inputs)
    start = array("x", x, (None, n))
    count = start.shape[0]
    along = np.zeros(count) if theta is None else array("theta", theta, (count,))
    if (along < 0).any():
        raise InputError(f"theta: expected no θ before the path's beginning at 0 s, got {along.min():g}")
    horizon = horizon_of(problem) if horizon is None else instance("horizon", horizon, Horizon)
    horizon = Horizon(whole("horizon.steps", horizon.steps, 1), number("horizon.step", horizon.step, "s", above=0))
    tolerance = number("tolerance", tolerance, above=0)
    most_iterations = whole("most_iterations", most_iterations, 1)
    guess = None if warm is None else jnp.asarray(array("warm", warm, (count, horizon.steps, m)))
    weights = weights_of(problem) if weights is None else instance("weights", weights, Weights)
    for name, matrix, size in (
        ("state", weights.state, n),
        ("effort", weights.effort, m),
        ("terminal", weights.terminal, n),
    ):
        _weight(f"weights.{name}", matrix, size)
    task = task_of(problem, weights, horizon.step)
    z = np.concatenate([start, along[:, None]], axis=1) if task.moves else start
    begin, guesses = _prepared(problem.vehicle, task, jnp.asarray(z), guess, horizon.steps)
    solved = solve_all(problem.vehicle, task, begin, guesses, tolerance, most_iterations)
    return _demonstrated(problem.vehicle, task, begin, jnp.asarray(along), solved)


def _weight(name: str, value: ArrayLike, size: int) -> None:
    matrix = array(name, value, (size, size))
    least, largest = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[0], np.abs(matrix).max()
    if np.abs(matrix - matrix.T).max() > ROUNDED * largest:
        raise InputError(f"{name}: expected a symmetric matrix, got entries that differ from their mirror images")
    if least < -ROUNDED * largest:
        raise InputError(f"{name}: expected a positive semidefinite matrix, got the eigenvalue {least:.3g}")


@partial(jax.jit, static_argnames=("vehicle", "steps"))
def _prepared(vehicle: Vehicle, task: Task, z: Array, warm: Array | None, steps: int) -> tuple[Array, Array]:
    """States (z, k) and inputs (N, m, k) to begin with."""
    begin = z.T
    if warm is None:
        rest = resting(vehicle, task, begin, piece_of(task, begin))
        return begin, jnp.broadcast_to(rest[None], (steps, rest.shape[0], begin.shape[1]))
    guess = jnp.moveaxis(warm, 0, -1)
    return begin, jnp.clip(guess, task.lower[None, :, None], task.upper[None, :, None])


@partial(jax.jit, static_argnames="vehicle")
def _demonstrated(vehicle: Vehicle, task: Task, begin: Array, theta: Array, solved: Solved) -> Demonstration:
    n = len(vehicle.state_names)
    plan = rollout(vehicle, task, begin, solved.inputs)
    states = jnp.concatenate([plan.states, plan.last[None]])
    if task.moves:
        along = states[:, n].T
    else:
        ahead = jnp.cumsum(solved.inputs[:, 0], axis=0) * task.step
        along = theta[:, None] + jnp.concatenate([jnp.zeros((1, theta.shape[0])), ahead]).T
    inputs = jnp.moveaxis(plan.inputs, -1, 0)
    return Demonstration(
        inputs[:, 0],
        inputs,
        jnp.moveaxis(states[:, :n], -1, 0),
        along,
        plan.cost,
        solved.converged,
        solved.residual,
        solved.iterations,
    )
