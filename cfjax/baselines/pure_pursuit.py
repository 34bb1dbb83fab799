"""Pure pursuit: the arc of a circle from the rear axle to a point of the path ahead.

With the target at a distance d and the angle η from the car's axis, tan γ = 2 l sin η / d (R. C. Coulter,
"Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from cfjax.baselines.geometric import Geometric, ahead
from cfjax.plants.plant import number


class PurePursuit(Geometric):
    """The target lies `look_ahead` seconds of the car's speed along the path, and no nearer than `shortest`."""

    look_ahead: Float[Array, ""] = eqx.field(converter=number)  # s
    shortest: Float[Array, ""] = eqx.field(converter=number, default=0.2)  # m

    def steering(self, state: Float[Array, " n"], theta: Float[Array, ""]) -> Float[Array, ""]:
        alpha, position, speed = state[0], state[1:3], state[3]
        target = ahead(self.track, theta, jnp.maximum(self.look_ahead * speed, self.shortest)) - position
        left = -jnp.cos(alpha) * target[0] - jnp.sin(alpha) * target[1]
        forward = jnp.cos(alpha) * target[1] - jnp.sin(alpha) * target[0]
        # behind the car the arc would turn wider and wider: then as tight as it can
        left = jnp.where(forward < 0, jnp.where(left < 0, -1.0, 1.0) * jnp.linalg.norm(target), left)
        return jnp.arctan(2 * self.wheelbase * left / jnp.maximum(target @ target, self.shortest**2))
