"""A tracker by model predictive control: the demonstrator's problem from every measured state.

The horizon, cost and method are those of `cfjax.demonstrate`: control-limited differential dynamic programming over the
same input box, with the timing u0 among the inputs of path following. The first inputs are applied. The plan of the
sample before is where the next one begins, and it gets a fixed number of iterations ("real-time iteration"). A batch of
cars is one batch of problems.

XLA fuses unrolled small matrices to death unless it is told not to (`demonstrator/box.py`); inside another compiled
program the compiler's options are the process's. `FLAGS` is what belongs into XLA_FLAGS before JAX is loaded; without
it the results are the same and take many times as long.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float

from cfjax.coerce import instance, objects, whole
from cfjax.coerce import number as coerced
from cfjax.demonstrator.box import COMPILER
from cfjax.demonstrator.ddp import rollout
from cfjax.demonstrator.demonstrator import TOLERANCE, Horizon, horizon_of
from cfjax.demonstrator.pool import FIRST_DAMPING, Lanes, improved
from cfjax.demonstrator.task import Task, Weights, task_of, weights_of
from cfjax.plants import Measurement
from cfjax.plants.plant import number
from cfjax.problem import Problem, Vehicle, feedforward
from cfjax.simulation.controller import Controller
from cfjax.simulation.track import Track


FLAGS: Final = " ".join(f"--{name}={value}" for name, value in COMPILER.items())

Solver = Callable[[Task, Float[Array, " z"], Float[Array, "N m"]], Float[Array, "N m"]]


class Memory(NamedTuple):
    """θ at the next sample (s), and the inputs (u0, *vehicle inputs) planned at the last one, a row per interval."""

    theta: Float[Array, ""]
    plan: Float[Array, "N m"]


class Mpc(Controller):
    """One car's tracker; `mpc` makes it for a problem."""

    track: Track
    task: Task
    period: Float[Array, ""] = eqx.field(converter=number)  # h, s
    steps: int = eqx.field(static=True)  # of the horizon
    iterations: int = eqx.field(static=True)  # per sample

    def start(self, state: Float[Array, " n"], theta: Float[Array, ""]) -> Memory:
        rest = jnp.stack([jnp.asarray(u, float) for u in feedforward(self.track.vehicle, self.track.at(theta).point)])
        return Memory(
            theta, jnp.broadcast_to(jnp.clip(rest, self.task.lower, self.task.upper), (self.steps, *rest.shape))
        )

    def act(
        self, measurement: Measurement, memory: Memory, time: Float[Array, ""]
    ) -> tuple[Float[Array, " m"], Memory]:
        track = self.track
        x = track.deviation(track.at(memory.theta), measurement.state)
        z = jnp.concatenate([x, memory.theta[None]]) if self.task.moves else x
        plan = _solver(track.vehicle, self.iterations)(self.task, z, memory.plan)
        pace, *inputs = plan[0]
        command = jnp.stack([jnp.asarray(entry, float) for entry in track.vehicle.command(tuple(inputs))])
        return command, Memory(memory.theta + self.period * pace, plan)

    def theta(self, memory: Memory) -> Float[Array, ""]:
        return memory.theta


def mpc(
    problem: Problem,
    track: Track,
    period: float,
    *,
    horizon: Horizon | None = None,
    weights: Weights | None = None,
    iterations: int = 2,
) -> Mpc:
    """The tracker of a problem for a control period (s); the demonstrator's horizon and weights where not given."""
    objects(problem=(problem, Problem), track=(track, Track))
    period, iterations = coerced("period", period, "s", above=0), whole("iterations", iterations, 1)
    horizon = horizon_of(problem) if horizon is None else instance("horizon", horizon, Horizon)
    weights = weights_of(problem) if weights is None else instance("weights", weights, Weights)
    task = task_of(problem, weights, horizon.step)
    return Mpc(track, task, period, horizon.steps, iterations)


@lru_cache
def _solver(vehicle: Vehicle, iterations: int) -> Solver:
    """The plan after so many iterations, from the plan given; batched as the demonstrator does it, batch last."""

    def many(task: Task, z: Float[Array, "z k"], inputs: Float[Array, "N m k"]) -> Float[Array, "N m k"]:
        none = jnp.zeros(z.shape[1])
        plan = rollout(vehicle, task, z, inputs)
        lanes = Lanes(none.astype(int), plan, none + FIRST_DAMPING, none.astype(int), none, none > 0, none > 0)
        lanes = jax.lax.fori_loop(0, iterations, lambda _, now: improved(vehicle, task, now, TOLERANCE, jnp.inf), lanes)
        return lanes.plan.inputs

    @custom_vmap
    def one(task: Task, z: Array, inputs: Array) -> Array:
        return many(task, z[:, None], inputs[..., None])[..., 0]

    @one.def_vmap
    def _(count: int, batched: Any, task: Task, z: Array, inputs: Array) -> tuple[Array, bool]:
        z, inputs = (
            jnp.moveaxis(value, 0, -1) if own else jnp.broadcast_to(value[..., None], (*value.shape, count))
            for value, own in zip((z, inputs), batched[1:], strict=True)
        )
        return jnp.moveaxis(many(task, z, inputs), -1, 0), True

    return one
