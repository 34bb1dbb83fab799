"""Stanley: the front axle's heading error and its distance from the path.

γ = −α_R + atan(k x_R/(k_s + v)), both taken at the path's place beside the front axle (G. M. Hoffmann, C. J. Tomlin,
M. Montemerlo and S. Thrun, "Autonomous Automobile Trajectory Tracking for Off-Road Driving", ACC 2007, its kinematic
part); x_R is positive to the right of the path, γ to the left. In a bend the rear axle runs inside the path, for it is
the front axle that is led.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from cfjax.baselines.geometric import Geometric, nearest
from cfjax.plants.plant import number


class Stanley(Geometric):
    """Gain k (1/s) and softening k_s (m/s)."""

    gain: Float[Array, ""] = eqx.field(converter=number)
    softening: Float[Array, ""] = eqx.field(converter=number, default=0.3)

    def steering(self, state: Float[Array, " n"], theta: Float[Array, ""]) -> Float[Array, ""]:
        alpha, length = state[0], self.wheelbase
        front = state.at[1].add(-length * jnp.sin(alpha)).at[2].add(length * jnp.cos(alpha))
        place = self.track.at(nearest(self.track, front, theta + length / self.track.at(theta).point.speed))
        x = self.track.deviation(place, front)
        return -x[0] + jnp.arctan(self.gain * x[1] / (self.softening + jnp.abs(state[3])))
