"""Controllers as the sampled loop takes them: pure functions of (measurement, memory, time).

A `Controller` is any such function that says where on the path it thinks the car is. `Follower` makes one of a law
(`cfjax.control`): its memory is θ. Baselines, pure pursuit say, are other controllers.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.control import Law, MinNorm
from cfjax.control.prediction import Sent, nothing_sent, predict
from cfjax.control.sampled import choose_for_hold
from cfjax.funnel.sampled import Holds
from cfjax.plants import Measurement
from cfjax.plants.plant import number
from cfjax.simulation.track import Track


class Controller(eqx.Module):
    """One car's controller; the loop batches it. Numbers that change from run to run belong into array fields.

    The memory is any pytree of arrays. What `theta` says of it decides where the car is looked at (V, S, arrival): of
    the memory before a call of `act` the place at the sample, after it the place where the car is to be when the next
    sample comes. In between θ runs evenly.
    """

    @abc.abstractmethod
    def start(self, state: Float[Array, " n"], theta: Float[Array, ""]) -> Any:
        """The memory of a car that is put down at this state, at θ (s) along the path."""

    @abc.abstractmethod
    def act(self, measurement: Measurement, memory: Any, time: Float[Array, ""]) -> tuple[Float[Array, " m"], Any]:
        """The physical command that is held until the next sample (time in s), and the memory at that sample."""

    @abc.abstractmethod
    def theta(self, memory: Any) -> Float[Array, ""]:
        """Where along the path, s."""


class Follower(Controller):
    """A funnel's law, sampled: it reads the reference at its θ, which moves on by u0 h while inputs are held."""

    track: Track
    period: Float[Array, ""] = eqx.field(converter=number)  # h, s
    law: Law = eqx.field(static=True, default=MinNorm())

    def start(self, state: Float[Array, " n"], theta: Float[Array, ""]) -> Float[Array, ""]:
        return theta

    def act(
        self, measurement: Measurement, memory: Float[Array, ""], time: Float[Array, ""]
    ) -> tuple[Float[Array, " m"], Float[Array, ""]]:
        track, place = self.track, self.track.at(memory)
        x = track.deviation(place, measurement.state)
        pace, *inputs = self.law(track.vehicle, track.template, place.numbers, place.point, place.since, tuple(x))
        command = track.vehicle.command(tuple(inputs))
        return jnp.stack([jnp.asarray(entry, float) for entry in command]), memory + self.period * pace

    def theta(self, memory: Float[Array, ""]) -> Float[Array, ""]:
        return memory


class Sending(NamedTuple):
    """What a car that predicts remembers: θ (s), and the inputs that it has sent."""

    theta: Float[Array, ""]
    sent: Sent


class HoldFollower(Controller):
    """The law that looks one hold ahead (`cfjax.control.sampled`), from poses of any known age that it remembers.

    `period` is that of control, at most the one that `numbers` are for; `remembered` periods are those of a pose's age.
    """

    track: Track
    numbers: Holds
    period: Float[Array, ""] = eqx.field(converter=number)  # s
    remembered: int = eqx.field(static=True)

    def start(self, state: Float[Array, " n"], theta: Float[Array, ""]) -> Sending:
        return Sending(theta, nothing_sent(self.remembered, np.shape(self.numbers.choices)[1]))

    def act(
        self, measurement: Measurement, memory: Sending, time: Float[Array, ""]
    ) -> tuple[Float[Array, " m"], Sending]:
        track, (theta, sent) = self.track, memory
        age = time - measurement.stamp
        now, vehicle = track.at(theta), track.vehicle
        seen = track.deviation(track.at(theta - sent.advance(age)), measurement.state)
        x = predict(vehicle, now.point, sent, age, seen)
        pace, *inputs = choose_for_hold(vehicle, track.template, self.numbers, now.point, now.since, x).inputs
        command = vehicle.command(tuple(inputs))
        commanded = jnp.stack([jnp.asarray(entry, float) for entry in command])
        held = jnp.stack([pace, *inputs])
        return commanded, Sending(theta + self.period * pace, sent.then(held, self.period))

    def theta(self, memory: Sending) -> Float[Array, ""]:
        return memory.theta
