"""The box-constrained min-norm law: the run-time law that condition (d) covers.

Among the inputs of the box it takes the one that deviates least from the reference's feed-forward, scaled by the
half-widths of the box, subject to V̇ ≤ −λ' with λ' < λ:

    min Σ ((v_i − v_i^r) / half_i)²   subject to   a + b · v ≤ d,   v in the box.

One half-space and a box: the minimiser is v_i^r − μ b_i half_i² clipped to the box, with one multiplier μ ≥ 0, in
closed form. It is feasible wherever (d) holds, so every V ≤ 1 inherits the certificate.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cfjax.funnel import Funnel, Template
from cfjax.problem import Problem, ReferencePoint, Segment, Vehicle, deviation_rate
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
    vehicle: Vehicle, template: Template, law: MinNormLaw, theta: Scalar, x: Sequence[Scalar]
) -> tuple[Scalar, ...]:
    """Inputs (u0, …) at (θ in s, deviation x): scalars in, scalars out; arrays of equal length pass as scalars.

    On the shell V ∈ [β̲, 1]: V̇ ≤ −λ'. Inside, the demand fades with q, down to nothing on the reference itself, and is
    soft: it yields continuously where the box cannot meet it, so that the law does not chatter on ridges where inputs
    lose authority. Above 1 the best vertex: nothing is guaranteed there.
    """
    states, count = range(len(x)), len(vehicle.input_names) + 1
    gradient = [2 * sum(law.shape[i, j] * x[j] for j in states) for i in states]
    q = 0.5 * sum(gradient[i] * x[i] for i in states)
    level, scale = template.level(law.rate, theta), template.scale(law.rate, theta)
    inner = level - (1 - law.beta_lower) / scale  # the q at which V = β̲
    demand = jnp.minimum(q / inner, 1.0)

    def form_rate(inputs: tuple[float, ...]) -> Scalar:
        rates = deviation_rate(vehicle, x, inputs, law.reference)
        return sum(g * rate for g, rate in zip(gradient, rates, strict=True))

    drift = form_rate((0.0,) * count)
    b = [form_rate(tuple(float(i == j) for j in range(count))) - drift for i in range(count)]
    b[0] = b[0] + demand * template.timing(law.rate, q)
    excess = drift + sum(b[i] * law.feedforward[i] for i in range(count)) + demand * law.decrease / scale
    excess = jnp.where(q > level, jnp.inf, excess)
    softness = (1 - demand) * (law.decrease / scale) ** 2
    return nearest_in_box(b, excess, law.feedforward, law.lower, law.upper, softness)


def nearest_in_box(
    b: Sequence[Scalar],
    excess: Scalar,
    centre: Sequence[Scalar] | Array,
    lower: Sequence[Scalar] | Array,
    upper: Sequence[Scalar] | Array,
    softness: Scalar = 0.0,
) -> tuple[Scalar, ...]:
    """The input in the box nearest to `centre` (scaled by half-widths) with b · (v − centre) ≤ −excess.

    Where the box cannot do it, the vertex that comes closest. A `softness` > 0 adds a slack to the demand at the cost
    slack²/softness beside Σ ((v − centre)/half)²: one more input of unlimited room. `centre` lies in the box.
    """
    each = range(len(b))
    half = [0.5 * (upper[i] - lower[i]) for i in each]
    gain = [jnp.abs(b[i]) * half[i] for i in each]  # effect of one half-width
    room = [
        jnp.where(
            half[i] > 0,
            jnp.where(b[i] > 0, centre[i] - lower[i], upper[i] - centre[i]) / jnp.where(half[i] > 0, half[i], 1.0),
            0.0,
        )
        for i in each
    ]
    # with one multiplier for all, input i meets its limit at breaks[i]; it is saturated if the demand is larger than
    # what all of them reach by then
    breaks = [room[i] / jnp.where(gain[i] > 0, gain[i], 1.0) for i in each]
    saturated = [
        sum(gain[j] * jnp.minimum(breaks[i] * gain[j], room[j]) for j in each) + softness * breaks[i] < excess
        for i in each
    ]
    slope = sum(jnp.where(saturated[i], 0.0, gain[i] ** 2) for i in each) + softness
    left = excess - sum(jnp.where(saturated[i], gain[i] * room[i], 0.0) for i in each)
    multiplier = jnp.maximum(left / jnp.where(slope > 0, slope, 1.0), 0.0)
    moved = [jnp.where(saturated[i], room[i], jnp.minimum(multiplier * gain[i], room[i])) for i in each]
    return tuple(
        jnp.clip(centre[i] - jnp.sign(b[i]) * jnp.where(excess > 0, moved[i], 0.0) * half[i], lower[i], upper[i])
        for i in each
    )
