"""The optimal-control problem that is solved, in scalars: reference, dynamics over one interval, cost.

States z = (x, θ): the deviation and, where the reference depends on it, the place along the path; inputs
(u0, *vehicle inputs), constant over an interval. Every scalar may be an array with one entry per problem of a batch.
"""

from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.coerce import number, objects
from cfjax.demonstrator.box import applied, dot, keep
from cfjax.problem import Problem, ReferencePoint, Vehicle, deviation_rate, feedforward
from cfjax.problem.course import Pieces, point_at, profiles_of
from cfjax.problem.input_box import InputBox
from cfjax.problem.runge_kutta import runge_kutta
from cfjax.problem.vehicle import Scalar


class Weights(NamedTuple):
    """Cost Σ h (xᵀQx + (u − u_r)ᵀR(u − u_r)) + x_NᵀQ_N x_N over the horizon, h in s; u_r is the feed-forward.

    Symmetric matrices, positive semidefinite; R positive definite on the inputs that are free.
    """

    state: Float[Array, "n n"]  # Q
    effort: Float[Array, "m m"]  # R, of (u0, *vehicle inputs)
    terminal: Float[Array, "n n"]  # Q_N, s


def weights_of(problem: Problem, effort: float = 0.1, terminal: float = 1.0) -> Weights:
    """Weights without units of their own: deviations count in half-axes of I, inputs in half-widths of their box.

    `effort` is what a half-width of an input costs beside a half-axis of I; `terminal` (s) is how long a deviation at
    the horizon's end counts. An input that has no choice costs nothing.
    """
    effort, terminal = number("effort", effort, least=0), number("terminal", terminal, "s", least=0)
    objects(problem=(problem, Problem))
    half = InputBox.of(problem.inputs).half
    squares = np.divide(effort, half**2, out=np.zeros_like(half), where=half > 0)
    state = jnp.asarray(problem.inlet.shape)
    return Weights(state, jnp.asarray(np.diag(squares)), terminal * state)


class Task(NamedTuple):
    """The numbers of the problem, as a pytree; the vehicle is given beside it."""

    reference: ReferencePoint | Pieces  # one point for all θ, or the profiles along the path
    end: Scalar  # θ from which the reference stays as it is, s
    lower: Float[Array, " m"]
    upper: Float[Array, " m"]
    weights: Weights
    step: Scalar  # h, s

    def stay(self, z: Float[Array, "z k"]) -> Float[Array, " k"]:
        """xᵀQx."""
        return _form(self.weights.state, z)

    def arrive(self, z: Float[Array, "z k"]) -> Float[Array, " k"]:
        """xᵀQ_N x."""
        return _form(self.weights.terminal, z)

    @property
    def moves(self) -> bool:
        """Whether θ is a state."""
        return isinstance(self.reference, Pieces)


def _form(matrix: Array, z: Array) -> Array:
    x = z[: matrix.shape[0]]
    return dot(x, applied(matrix[:, :, None], x))


@lru_cache(maxsize=64)
def reference_of(problem: Problem) -> tuple[ReferencePoint | Pieces, float]:
    """What the deviation is measured from, and where along θ (s) it ends.

    Of a tube its nominal reference: the middle of curvature, speed and acceleration (no path of the tube in
    particular; with an acceleration it lasts no longer than its speeds do, which a horizon is short beside).
    """
    path = problem.path
    points = {segment.middle() for segment in path.segments}
    if len(points) == 1 and all(segment.is_steady for segment in path.segments):
        return ReferencePoint(*(jnp.asarray(number, float) for number in points.pop())), np.inf
    return profiles_of(path), path.duration


def task_of(problem: Problem, weights: Weights, step: float) -> Task:
    """The optimal-control problem of a path's deviations, in intervals of `step` (s)."""
    (reference, end), box = reference_of(problem), InputBox.of(problem.inputs)
    return Task(
        reference,
        jnp.asarray(end, float),
        jnp.asarray(box.lower),
        jnp.asarray(box.upper),
        Weights(*(jnp.asarray(matrix, float) for matrix in weights)),
        jnp.asarray(step, float),
    )


def point_of(task: Task, theta: Scalar, piece: Scalar) -> ReferencePoint:
    """The reference at θ ≥ 0 by the polynomials of the given piece; beyond the end it stays, without slopes."""
    if isinstance(task.reference, ReferencePoint):
        return task.reference
    point = point_at(task.reference, piece, jnp.clip(theta, 0.0, task.end))
    inside = theta < task.end
    return point._replace(
        turn_rate_slope=jnp.where(inside, point.turn_rate_slope, 0.0),
        speed_slope=jnp.where(inside, point.speed_slope, 0.0),
    )


def piece_of(task: Task, z: Float[Array, "z k"]) -> Array | int:
    """Of the path, the piece whose polynomials count over an interval that begins at z."""
    return keep(task.reference.find(z[-1])) if isinstance(task.reference, Pieces) else 0


def resting(vehicle: Vehicle, task: Task, z: Float[Array, "z k"], piece: Array | int) -> Float[Array, " m #k"]:
    """The feed-forward at z, inside the box; the same for all (k = 1) where the reference is one point."""
    inputs = feedforward(vehicle, point_of(task, z[-1], piece))
    return keep(jnp.clip(jnp.stack([jnp.atleast_1d(u) for u in inputs]), task.lower[:, None], task.upper[:, None]))


def advance(
    vehicle: Vehicle, task: Task, z: Float[Array, "z k"], inputs: Float[Array, "m k"], piece: Array | int
) -> Float[Array, "z k"]:
    """z after one interval at constant inputs: one step of classical Runge–Kutta of fourth order."""
    count = len(vehicle.state_names)

    def rate(z: Array) -> Array:
        z = keep(z)
        rates = deviation_rate(vehicle, tuple(z[:count]), tuple(inputs), point_of(task, z[-1], piece))
        return keep(jnp.stack([*rates, inputs[0]] if task.moves else [*rates]))

    return keep(runge_kutta(rate, z, task.step))
