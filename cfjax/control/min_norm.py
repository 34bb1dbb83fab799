"""The box-constrained min-norm law: the run-time law that condition (d) covers.

Among the inputs of the box it takes the one that deviates least from the reference's feed-forward, scaled by the
half-widths of the box, subject to V̇ ≤ −λ' with λ' < λ:

    min Σ ((v_i − v_i^r) / half_i)²   subject to   a + b · v ≤ d,   v in the box.

One half-space and a box: the minimiser is v_i^r − μ b_i half_i² clipped to the box, with one multiplier μ ≥ 0, in
closed form. It is feasible wherever (d) holds, so every V ≤ 1 inherits the certificate. Where the demand is soft it
yields continuously to what the box can do, so that the law does not chatter on ridges where inputs lose authority.
Above V = 1 it is the best vertex.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cfjax.control.law import Descent, Law
from cfjax.problem.vehicle import Scalar


LARGEST = 1e300  # of the multiplier


@dataclass(frozen=True)
class MinNorm(Law):
    """The least deviation from the feed-forward that decreases V as asked."""

    name: ClassVar[str] = "min_norm"
    inherits: ClassVar[bool] = True

    def choose(self, descent: Descent) -> tuple[Scalar, ...]:
        slopes, _, excess, softness, centre, lower, upper = descent
        return nearest_in_box(slopes, excess, centre, lower, upper, softness)


def nearest_in_box(
    b: Sequence[Scalar],
    excess: Scalar,
    centre: Sequence[Scalar] | Array | np.ndarray,
    lower: Sequence[Scalar] | Array | np.ndarray,
    upper: Sequence[Scalar] | Array | np.ndarray,
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
    # at V = 1 a compiler may see V > 1 here and not above: without a bound an input without authority is 0 · ∞
    multiplier = jnp.clip(left / jnp.where(slope > 0, slope, 1.0), 0.0, LARGEST)
    moved = [jnp.where(saturated[i], room[i], jnp.minimum(multiplier * gain[i], room[i])) for i in each]
    return tuple(
        jnp.clip(centre[i] - jnp.sign(b[i]) * jnp.where(excess > 0, moved[i], 0.0) * half[i], lower[i], upper[i])
        for i in each
    )
