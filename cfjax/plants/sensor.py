"""Sensors: what the controller measures of where the car is.

At each control instant t a pose that was taken τ = delay + jitter · U seconds ago arrives, with U uniform in [0, 1]:
the car's state at t − τ, with a bias and fresh Gaussian noise. A sample may be lost, and one that is older than the
last is of no use: then the last measurement stands. Before t = 0 the car stood where it started.

States between two control instants are interpolated linearly, which is off by a h²/8 for an acceleration a.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float, PRNGKeyArray

from cfjax.coerce import refuse, whole
from cfjax.errors import InputError
from cfjax.plants.plant import number
from cfjax.problem.sets import MOST_STATES


FEWEST_REMEMBERED, MOST_REMEMBERED = 16, 4096  # control periods of delay


class Measurement(NamedTuple):
    """What a controller gets: a state (α, x, y, ξ…) in the world frame, and when it was taken (s)."""

    state: Float[Array, " n"]
    stamp: Float[Array, ""]


class Memory(NamedTuple):
    """Of a sensor: the last measurement, and where the car was at the last control instants, newest first."""

    last: Measurement
    past: Float[Array, "m n"]


class Sensor(eqx.Module):
    """Numbers are leaves of a pytree, but for how many periods the longest delay takes."""

    sigma: Float[Array, " n"] = eqx.field(converter=number)  # standard deviation per state: rad, m, m, unit of ξ
    bias: Float[Array, " n"] = eqx.field(converter=number)  # the same units; x and y in the world frame
    delay: Float[Array, ""] = eqx.field(converter=number, default=0.0)  # s
    jitter: Float[Array, ""] = eqx.field(converter=number, default=0.0)  # s
    loss: Float[Array, ""] = eqx.field(converter=number, default=0.0)  # share of samples that do not arrive

    def __check_init__(self) -> None:
        if isinstance(self.delay, Tracer):
            return
        for value in (self.delay, self.jitter, self.loss):
            if value.ndim:
                refuse("noise", "one number for delay, jitter and loss each", value)
        lowest = min(float(jnp.min(self.sigma)), float(self.delay), float(self.jitter), float(self.loss))
        if not (lowest >= 0 and float(self.loss) <= 1):
            raise InputError("noise: expected sigma, delay and jitter that are not negative, and a loss from 0 to 1")

    def remembered(self, period: float) -> int:
        """Control instants to remember: a power of two, so that few delays are compiled for anew.

        Raises:
            InputError: for more of them than make sense.
        """
        needed = math.ceil(float(self.delay + self.jitter) / period - 1e-9) + 2
        if not needed <= MOST_REMEMBERED:
            raise InputError(f"noise: expected a delay of at most {MOST_REMEMBERED - 2} periods of {period:g} s")
        return max(FEWEST_REMEMBERED, 2 ** math.ceil(math.log2(needed)))

    def start(self, state: Float[Array, " n"], remembered: int) -> Memory:
        """Before the first sample; until one arrives the controller gets where the car was put."""
        return Memory(Measurement(state, number(0.0)), jnp.tile(state, (remembered, 1)))

    def measure(
        self, key: PRNGKeyArray, truth: Float[Array, " n"], memory: Memory, time: Float[Array, ""], period: Array
    ) -> tuple[Measurement, Memory]:
        """One sample at a control instant (time and period in s)."""
        past = jnp.concatenate([truth[None], memory.past[:-1]])
        key_late, key_loss, key_noise = jax.random.split(key, 3)
        late = self.delay + self.jitter * jax.random.uniform(key_late)
        # a state from before the start is that of the start, of which `past` is full
        back = late / period
        whole = jnp.clip(jnp.floor(back).astype(int), 0, past.shape[0] - 2)
        share = jnp.clip(back - whole, 0.0, 1.0)
        state = (1 - share) * past[whole] + share * past[whole + 1]
        noisy = state + self.bias + self.sigma * jax.random.normal(key_noise, truth.shape)
        fresh = Measurement(noisy, jnp.maximum(time - late, 0.0))
        first = time <= 0.0
        lost = jax.random.uniform(key_loss) < self.loss
        arrives = first | (~lost & (fresh.stamp > memory.last.stamp))
        last = jax.tree.map(lambda new, old: jnp.where(arrives, new, old), fresh, memory.last)
        return last, Memory(last, past)


def perfect(dimension: int) -> Sensor:
    """The true state, at once."""
    size = whole("dimension", dimension, 1, MOST_STATES)
    return Sensor(jnp.zeros(size), jnp.zeros(size))
