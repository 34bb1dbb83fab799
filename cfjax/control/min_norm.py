"""The box-constrained min-norm law: the run-time law that condition (d) covers.

Among the inputs of the box it takes the one that deviates least from the reference's feed-forward, scaled by the
half-widths of the box, subject to V̇ ≤ −λ' with λ' < λ:

    min Σ ((v_i − v_i^r) / half_i)²   subject to   a + b · v ≤ d,   v in the box.

One half-space and a box: the minimiser is v_i^r − μ b_i half_i² clipped to the box, with one multiplier μ ≥ 0, in closed
form. It is feasible wherever (d) holds, so every V ≤ 1 inherits the certificate.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cfjax.funnel import Funnel, Template
from cfjax.problem import Problem, ReferencePoint, Segment, Vehicle, affine_deviation
from cfjax.problem.vehicle import Scalar


LAW_SHARE = 0.95  # λ'/λ: strictly below 1, for at λ itself the law may jump


class MinNormLaw(NamedTuple):
    """The law on one steady segment, as a pytree; `vehicle` and `template` are given beside it."""

    reference: ReferencePoint
    feedforward: Float[Array, " m"]  # (1, u_r): u0 first
    lower: Float[Array, " m"]  # of the input box
    upper: Float[Array, " m"]
    shape: Float[Array, "n n"]  # C
    rate: Scalar
    beta_lower: Scalar
    decrease: Scalar  # λ', 1/s


def min_norm_law(problem: Problem, segment: Segment, funnel: Funnel, margin: float) -> MinNormLaw:
    """The law that enforces V̇ ≤ −0.95 λ for the (certified) margin λ in 1/s."""
    return MinNormLaw(
        reference=ReferencePoint(*(jnp.asarray(value, float) for value in segment.point(0.0))),
        feedforward=jnp.asarray(problem.feedforward(segment, 0.0)),
        lower=jnp.array([interval.lower for interval in problem.inputs]),
        upper=jnp.array([interval.upper for interval in problem.inputs]),
        shape=jnp.asarray(funnel.shape),
        rate=jnp.asarray(funnel.rate, float),
        beta_lower=jnp.asarray(funnel.beta_lower, float),
        decrease=jnp.asarray(LAW_SHARE * margin, float),
    )


def min_norm_input(
    vehicle: Vehicle, template: Template, law: MinNormLaw, theta: Scalar, x: Float[Array, " n"]
) -> Float[Array, " m"]:
    """Inputs (u0, …) at (θ in s, deviation x).

    On the shell V ∈ [β̲, 1]: V̇ ≤ −λ'. Inside, the demand fades with q, down to nothing on the reference itself, and is
    soft: it yields continuously where the box cannot meet it, so that the law does not chatter on ridges where inputs
    lose authority. Above 1 the best vertex: nothing is guaranteed there.
    """
    gradient = 2 * law.shape @ x
    q = 0.5 * gradient @ x
    level, scale = template.level(law.rate, theta), template.scale(law.rate, theta)
    inner = level - (1 - law.beta_lower) / scale  # the q at which V = β̲
    demand = jnp.minimum(q / inner, 1.0)
    drift, columns = affine_deviation(vehicle, x, law.reference)
    b = gradient @ columns
    b = b.at[0].add(demand * template.timing(law.rate, q))
    excess = gradient @ drift + b @ law.feedforward + demand * law.decrease / scale
    excess = jnp.where(q > level, jnp.inf, excess)
    softness = (1 - demand) * (law.decrease / scale) ** 2
    return nearest_in_box(b, excess, law.feedforward, law.lower, law.upper, softness)


def nearest_in_box(
    b: Float[Array, " m"],
    excess: Scalar,
    centre: Float[Array, " m"],
    lower: Float[Array, " m"],
    upper: Float[Array, " m"],
    softness: Scalar = 0.0,
) -> Float[Array, " m"]:
    """The input in the box nearest to `centre` (scaled by half-widths) with b · (v − centre) ≤ −excess.

    Where the box cannot do it, the vertex that comes closest. A `softness` > 0 adds a slack to the demand at the cost
    slack²/softness beside Σ ((v − centre)/half)²: one more input of unlimited room. `centre` lies in the box.
    """
    half = 0.5 * (upper - lower)
    gain = jnp.abs(b) * half  # effect of one half-width
    room = jnp.where(half > 0, jnp.where(b > 0, centre - lower, upper - centre) / jnp.where(half > 0, half, 1.0), 0.0)
    breaks = room / jnp.where(gain > 0, gain, 1.0)  # multiplier at which each input meets its limit
    reached = (gain[None, :] * jnp.minimum(breaks[:, None] * gain[None, :], room[None, :])).sum(axis=1)
    reached = reached + softness * breaks
    saturated = reached < excess
    slope = jnp.where(saturated, 0.0, gain**2).sum() + softness
    multiplier = (excess - jnp.where(saturated, gain * room, 0.0).sum()) / jnp.where(slope > 0, slope, 1.0)
    free = jnp.minimum(jnp.maximum(multiplier, 0.0) * gain, room)
    moved = jnp.where(saturated, room, free)
    moved = jnp.where(excess > 0, moved, 0.0)
    return jnp.clip(centre - jnp.sign(b) * moved * half, lower, upper)
