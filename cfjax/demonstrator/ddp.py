"""One iteration of control-limited differential dynamic programming, for a batch side by side."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cfjax.demonstrator.box import applied, dot, factor, keep, product, smallest_in_box, solve, transposed, without
from cfjax.demonstrator.task import Task, advance, piece_of, resting
from cfjax.problem import Vehicle


class Trajectories(NamedTuple):
    """Trajectories of k problems over N intervals, batch last."""

    states: Float[Array, "N z k"]  # at the beginning of each interval
    last: Float[Array, "z k"]  # at the end
    inputs: Float[Array, "N m k"]
    cost: Float[Array, " k"]


class Policy(NamedTuple):
    """What a backward pass says: how to change the inputs, and how good the plan is already."""

    change: Float[Array, "N m k"]  # of the inputs, at full length
    gain: Float[Array, "N m z k"]  # inputs per deviation from the plan's states; 0 for inputs held by the box
    promise: Float[Array, " k"]  # by how much the cost falls, says the quadratic model
    residual: Float[Array, " k"]  # of the optimality conditions, in units of the cost; see `backward`


def rollout(vehicle: Vehicle, task: Task, start: Float[Array, "z k"], inputs: Float[Array, "N m k"]) -> Trajectories:
    """The plan of given inputs, clipped into the box."""

    def interval(carry: tuple[Array, Array], u: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return _driven(vehicle, task, carry, u)

    (last, cost), (states, inputs) = jax.lax.scan(interval, (start, jnp.zeros(start.shape[1:])), inputs)
    return Trajectories(states, last, inputs, cost + task.arrive(last))


def followed(vehicle: Vehicle, task: Task, plan: Trajectories, policy: Policy) -> Trajectories:
    """The plan that follows a policy around another plan, from the same start."""

    def interval(carry: tuple[Array, Array], knot: tuple) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        old, u, change, gain = knot
        return _driven(vehicle, task, carry, u + change + applied(gain, carry[0] - old))

    along = (plan.states, plan.inputs, policy.change, policy.gain)
    (last, cost), (states, inputs) = jax.lax.scan(interval, (plan.states[0], jnp.zeros_like(plan.cost)), along)
    return Trajectories(states, last, inputs, cost + task.arrive(last))


def _driven(
    vehicle: Vehicle, task: Task, carry: tuple[Array, Array], u: Array
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """State and cost after an interval, from those before it; and what was passed."""
    z, cost = carry
    u = keep(jnp.clip(u, task.lower[:, None], task.upper[:, None]))
    piece = piece_of(task, z)
    off = u - resting(vehicle, task, z, piece)
    cost = cost + task.step * (task.stay(z) + dot(off, applied(task.weights.effort[:, :, None], off)))
    return (advance(vehicle, task, z, u, piece), keep(cost)), (z, u)


def backward(vehicle: Vehicle, task: Task, plan: Trajectories, damping: Float[Array, " k"]) -> Policy:
    """The policy that is best for the quadratic model of the cost along the plan, inside the box.

    The model: dynamics to first order, cost to second, so its Hessian is positive semidefinite (Gauss–Newton);
    `damping` adds to it for each input, in half-widths. Value and policy of Tassa, Mansard and Todorov (2014), eqs. (5)
    to (11), here with V = ½ zᵀ V_zz z + V_zᵀ z.

    The residual is of the exact problem, by its costates: the largest effect on the cost, to first order, of a
    half-width of any one input, those that the box holds against it apart.
    """
    n, m = len(vehicle.state_names), 1 + len(vehicle.input_names)
    nz = n + task.moves
    h = task.step
    half = 0.5 * (task.upper - task.lower)
    scale = jnp.where(half > 0, 1.0 / jnp.where(half > 0, half, 1.0), 1.0)
    q_state, q_terminal = (
        jnp.zeros((nz, nz)).at[:n, :n].set(w)[:, :, None] for w in (task.weights.state, task.weights.terminal)
    )
    r = task.weights.effort[:, :, None]
    zu = jnp.eye(nz + m)[:, :, None] * jnp.ones((1, 1, plan.cost.shape[0]))

    def interval(carry: tuple, knot: tuple) -> tuple[tuple, tuple]:
        vz, vzz, costate, promise, residual = carry
        z, u = knot
        piece = piece_of(task, z)

        def step(z: Array, u: Array) -> Array:
            return advance(vehicle, task, z, u, piece)

        slopes = jax.vmap(lambda t: jax.jvp(step, (z, u), (t[:nz], t[nz:]))[1])(zu)  # (nz + m, nz, k)
        bt = keep(slopes[nz:])
        at = keep(slopes[:nz])
        a, b = transposed(at), transposed(bt)
        if task.moves:
            rest, drest = jax.jvp(
                lambda theta: resting(vehicle, task, z.at[-1].set(theta), piece), (z[-1],), (jnp.ones_like(z[-1]),)
            )
        else:
            rest, drest = resting(vehicle, task, z, piece), None
        ru = keep(2 * h * applied(r, u - rest))
        lz = 2 * h * applied(q_state, z)
        lzz = 2 * h * q_state
        luz = 0.0
        if drest is not None:
            rd = keep(2 * h * applied(r, drest))
            lz = lz.at[-1].add(-dot(drest, ru))
            lzz = (lzz * jnp.ones((1, 1, z.shape[1]))).at[-1, -1].add(dot(drest, rd))
            luz = jnp.zeros((m, nz, z.shape[1])).at[:, -1].set(-rd)
        lz, lzz = keep((lz, lzz))
        va, vb = keep((product(vzz, a), product(vzz, b)))
        qz, qu = keep((lz + applied(at, vz), ru + applied(bt, vz)))
        qzz, quz, quu = keep((lzz + product(at, va), luz + product(bt, va), 2 * h * r + product(bt, vb)))
        damped = keep(quu + jnp.diag(h * scale**2)[:, :, None] * damping[None, None])
        low, high = keep((task.lower[:, None] - u, task.upper[:, None] - u))
        change, held = smallest_in_box(damped, qu, low, high)
        gain = solve(factor(without(damped, held)), list(jnp.where(held[:, None], 0.0, -quz)))
        gain = keep(jnp.stack(gain))
        uk, ug = keep((applied(quu, change), product(quu, gain)))
        gt = transposed(gain)
        promise = promise - dot(change, qu + 0.5 * uk)
        vz = qz + applied(gt, qu + uk) + applied(transposed(quz), change)
        vzz = keep(qzz + product(gt, ug + quz) + product(transposed(quz), gain))
        vzz = 0.5 * (vzz + transposed(vzz))
        slope = keep(ru + applied(bt, costate))
        costate = lz + applied(at, costate)
        outward = ((slope > 0) & (low >= 0)) | ((slope < 0) & (high <= 0))
        left = jnp.where(outward, 0.0, jnp.abs(slope) * half[:, None])
        return keep((vz, vzz, costate, promise, jnp.maximum(residual, jnp.max(left, axis=0)))), (change, gain)

    zero = jnp.zeros_like(plan.cost)
    slope = 2 * applied(q_terminal, plan.last)
    carry = (slope, 2 * q_terminal * jnp.ones((1, 1, zero.shape[0])), slope, zero, zero)
    (_, _, _, promise, residual), (change, gain) = jax.lax.scan(
        interval, carry, (plan.states, plan.inputs), reverse=True
    )
    return Policy(change, gain, promise, residual)
