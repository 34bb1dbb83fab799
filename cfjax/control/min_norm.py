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

    V in [β̲, 1]: V̇ ≤ −λ'. Below β̲ the demand fades linearly, to V̇ ≤ 0 one shell's width further in, and yields to the
    box where it is infeasible. Above 1 the best vertex: nothing is guaranteed there.
    """
    gradient = 2 * law.shape @ x
    q = 0.5 * gradient @ x
    value = template.value(law.rate, theta, q)
    drift, columns = affine_deviation(vehicle, x, law.reference)
    b = gradient @ columns
    b = b.at[0].add(template.timing(law.rate, q))
    fade = jnp.maximum(law.beta_lower - value, 0.0) / (1 - law.beta_lower)
    allowed = -law.decrease * (1 - fade) / template.scale(law.rate, theta)
    excess = gradient @ drift + b @ law.feedforward - allowed
    excess = jnp.where(value > 1, jnp.inf, excess)
    return nearest_in_box(b, excess, law.feedforward, law.lower, law.upper)


def nearest_in_box(
    b: Float[Array, " m"],
    excess: Scalar,
    centre: Float[Array, " m"],
    lower: Float[Array, " m"],
    upper: Float[Array, " m"],
) -> Float[Array, " m"]:
    """The input in the box nearest to `centre` (scaled by half-widths) with b · (v − centre) ≤ −excess.

    Where the box cannot do it, the vertex that comes closest. `centre` lies in the box.
    """
    half = 0.5 * (upper - lower)
    gain = jnp.abs(b) * half  # effect of one half-width
    room = jnp.where(half > 0, jnp.where(b > 0, centre - lower, upper - centre) / jnp.where(half > 0, half, 1.0), 0.0)
    breaks = room / jnp.where(gain > 0, gain, 1.0)  # multiplier at which each input meets its limit
    reached = (gain * jnp.minimum(breaks[:, None] * gain[None, :], room[None, :])).sum(axis=1)
    saturated = reached < excess
    slope = jnp.where(saturated, 0.0, gain**2).sum()
    multiplier = (excess - jnp.where(saturated, gain * room, 0.0).sum()) / jnp.where(slope > 0, slope, 1.0)
    free = jnp.minimum(jnp.maximum(multiplier, 0.0) * gain, room)
    moved = jnp.where(saturated, room, free)
    moved = jnp.where(excess > 0, moved, 0.0)
    return jnp.clip(centre - jnp.sign(b) * moved * half, lower, upper)
