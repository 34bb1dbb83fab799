"""The box-constrained min-norm law: the run-time law that condition (d) covers.

Among the inputs of the box it takes the one that deviates least from the reference's feed-forward, scaled by the
half-widths of the box, subject to V̇ ≤ −λ' with λ' < λ:

    min Σ ((v_i − v_i^r) / half_i)²   subject to   a + b · v ≤ d,   v in the box.

One half-space and a box: the minimiser is v_i^r − μ b_i half_i² clipped to the box, with one multiplier μ ≥ 0, in
closed form. It is feasible wherever (d) holds, so every V ≤ 1 inherits the certificate.

The reference enters as a point, given at run time: on a steady segment it is always the same one; in a tube it is what
the path ahead does, and the law needs nothing else of the path. A tube's certificate says more than that some input is
good at each point of its references, and so there are two kinds of law:

- **curvature known**: the decrease is imposed at the curvature given. Some input of the certificate is good enough for
  every curvature at once, so there is one for this.
- **any curvature**: the decrease is imposed at the end of the tube's curvatures that is worst for V at this deviation.
  V̇ is affine in κ at fixed inputs, so it then holds for every curvature of the interval: also for one that is not
  known, and for one that jumps while inputs are held. The curvature given only serves the feed-forward.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.funnel import Funnel, Template
from cfjax.problem import Interval, Problem, ReferencePoint, Vehicle, deviation_rate, feedforward
from cfjax.problem.vehicle import Scalar


LAW_SHARE = 0.95  # λ'/λ: strictly below 1, for at λ itself the law may jump


class MinNormLaw(NamedTuple):
    """The law of one funnel, as a pytree; `vehicle` and `template` are given beside it.

    `curvature` is None where the decrease is imposed at the reference's own, else the two ends (1/m) of an interval
    for all of which it is imposed; they may be arrays, one entry per sample.
    """

    lower: Float[Array, " m"]  # of the input box (u0, *vehicle inputs)
    upper: Float[Array, " m"]
    shape: Float[Array, "n n"]  # C
    rate: Scalar
    beta_lower: Scalar
    beta_inner: Scalar  # the demand yields to the box only below this level
    decrease: Scalar  # λ', 1/s
    decrease_per_metre: Scalar  # 1/m of the reference's way; the larger of the two demands counts
    curvature: tuple[Scalar, Scalar] | None


def min_norm_law(
    problem: Problem,
    funnel: Funnel,
    margin: float,
    margin_per_metre: float = 0.0,
    curvature: Interval | None = None,
) -> MinNormLaw:
    """The law that enforces V̇ ≤ −0.95 λ for the (certified) margin λ in 1/s.

    On a tube V̇ ≤ −0.95 max(λ, μ v_r) min(1, V/β̲) on β_in ≤ V ≤ 1, with `margin_per_metre` μ in 1/m as certified: for
    every reference point within the bounds, for between the ends of the speed V̇ is affine in it and so is each of the
    two demands. With the tube's interval of `curvature` one input does it for all of them at once, whatever curvature
    the reference point names: a certificate's input at the worse end is good for all, so that the half-space of that
    end meets the box. Where the path's curvature is not known, the middle does for the feed-forward.
    """
    # below β̲ the demand fades as a tube's certificate does; along a segment the two may differ, so there it only asks
    inner = funnel.inner if np.isinf(funnel.duration) else funnel.beta_lower
    ends = None if curvature is None else (jnp.asarray(curvature.lower, float), jnp.asarray(curvature.upper, float))
    return MinNormLaw(
        lower=jnp.array([interval.lower for interval in problem.inputs]),
        upper=jnp.array([interval.upper for interval in problem.inputs]),
        shape=jnp.asarray(funnel.shape),
        rate=jnp.asarray(funnel.rate, float),
        beta_lower=jnp.asarray(funnel.beta_lower, float),
        beta_inner=jnp.asarray(inner, float),
        decrease=jnp.asarray(LAW_SHARE * margin, float),
        decrease_per_metre=jnp.asarray(LAW_SHARE * margin_per_metre, float),
        curvature=ends,
    )


def path_point(curvature: Scalar, speed: Scalar, acceleration: Scalar = 0.0) -> ReferencePoint:
    """The reference point of a path with curvature κ (1/m), speed v_r (m/s) and acceleration dv_r/dθ (m/s²).

    Scalars, or arrays of equal length. κ counts as constant around the point: no tube depends on its slope.
    """
    kappa, v, a = jnp.broadcast_arrays(*(jnp.asarray(value, float) for value in (curvature, speed, acceleration)))
    return ReferencePoint(kappa * v, v, kappa * a, a)


def min_norm_input(
    vehicle: Vehicle, template: Template, law: MinNormLaw, reference: ReferencePoint, theta: Scalar, x: Sequence[Scalar]
) -> tuple[Scalar, ...]:
    """Inputs (u0, …) at (θ in s, deviation x) beside a reference point: scalars in, scalars out.

    Arrays of equal length pass as scalars, in the reference too, whose fields share one shape. In a tube θ has no
    influence. u0 is the rate of θ: a car carries θ along, and reads its path there.

    On the shell V ∈ [β̲, 1]: V̇ ≤ −λ', the larger of the law's two demands at the reference's speed. Inside, the demand
    fades with q, down to nothing on the reference itself. Below `beta_inner` it is soft as well: it yields continuously
    where the box cannot meet it, so that the law does not chatter on ridges where inputs lose authority. Above 1 the
    best vertex: nothing is guaranteed there.
    """
    states, count = range(len(x)), len(vehicle.input_names) + 1
    gradient = [2 * sum(law.shape[i, j] * x[j] for j in states) for i in states]
    q = 0.5 * sum(gradient[i] * x[i] for i in states)
    level, scale = template.level(law.rate, theta), template.scale(law.rate, theta)
    demand = jnp.minimum(q / (level - (1 - law.beta_lower) / scale), 1.0)  # 1 from V = β̲ on
    hardness = jnp.minimum(q / (level - (1 - law.beta_inner) / scale), 1.0)
    decrease = jnp.maximum(law.decrease, law.decrease_per_metre * reference.speed) / scale

    def form_rate(inputs: tuple[float, ...], at: ReferencePoint = reference) -> Scalar:
        rates = deviation_rate(vehicle, x, inputs, at)
        return sum(g * rate for g, rate in zip(gradient, rates, strict=True))

    drift = form_rate((0.0,) * count)
    units = [tuple(float(i == j) for j in range(count)) for i in range(count)]
    b = [form_rate(unit) - drift for unit in units]
    if law.curvature is not None:
        # κ multiplies u0 > 0 alone: the worse end is the one with the larger coefficient of u0
        ends = [reference._replace(turn_rate=kappa * reference.speed) for kappa in law.curvature]
        b[0] = jnp.maximum(*(form_rate(units[0], end) for end in ends)) - drift
    b[0] = b[0] + demand * template.timing(law.rate, q)
    centre = [jnp.clip(value, law.lower[i], law.upper[i]) for i, value in enumerate(feedforward(vehicle, reference))]
    excess = drift + sum(b[i] * centre[i] for i in range(count)) + demand * decrease
    excess = jnp.where(q > level, jnp.inf, excess)
    return nearest_in_box(b, excess, centre, law.lower, law.upper, (1 - hardness) * decrease**2)


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
