"""Where a car is now whose pose is old: by the model, from the inputs that it has held since the pose was taken.

A controller knows what it has sent, and for how long; θ is its own and never late. On the model the prediction is
exact but for rounding and the error of Runge and Kutta's steps, so that what is proven of a law at the state that it
sees holds at the one that it predicts (`cfcheck.robustness.sampled`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cfjax.funnel.sampled import held_motion
from cfjax.problem import ReferencePoint, Vehicle
from cfjax.problem.runge_kutta import runge_kutta
from cfjax.problem.vehicle import Scalar


STEPS = 8  # of each held input


class Sent(NamedTuple):
    """A buffer of inputs (u0, *vehicle inputs) that were held one after another, the newest first, each so long (s)."""

    inputs: Float[Array, "k m"]
    lengths: Float[Array, " k"]

    def then(self, inputs: Float[Array, " m"], length: Scalar) -> "Sent":
        """With another input behind them; the oldest is forgotten."""
        newest = jnp.asarray(inputs, float)[None], jnp.reshape(jnp.asarray(length, float), 1)
        return Sent(*(jnp.concatenate([one, all_[:-1]]) for one, all_ in zip(newest, self, strict=True)))

    def since(self, age: Scalar) -> Float[Array, " k"]:
        """How long each was held within the last `age` seconds."""
        before = jnp.cumsum(self.lengths) - self.lengths
        return jnp.clip(age - before, 0.0, self.lengths)

    def remembers(self, age: Scalar) -> Bool[Array, ""]:
        """Whether the buffer reaches back so far."""
        return self.lengths.sum() >= age

    def advance(self, age: Scalar) -> Float[Array, ""]:
        """How far θ has come within the last `age` seconds, s."""
        return self.inputs[:, 0] @ self.since(age)


def nothing_sent(count: int, inputs: int) -> Sent:
    """A buffer for `count` inputs of so many entries."""
    return Sent(jnp.zeros((count, inputs)), jnp.zeros(count))


def predict(
    vehicle: Vehicle, reference: ReferencePoint, sent: Sent, age: Scalar, x: Float[Array, " n"]
) -> Float[Array, " n"]:
    """The deviation now, where it was x so long ago (s), beside a reference that stays as it is."""

    def hold(x: Array, held: tuple[Array, Array]) -> tuple[Array, None]:
        inputs, length = held
        motion = held_motion(vehicle, inputs, reference)
        z = jnp.concatenate([jnp.zeros(1), x])
        z, _ = jax.lax.scan(lambda z, _: (runge_kutta(motion, z, length / STEPS), None), z, None, length=STEPS)
        return z[1:], None

    return jax.lax.scan(hold, x, (sent.inputs, sent.since(age)), reverse=True)[0]
