"""What geometric path trackers share: the nearest place of the path, a point ahead of it, and a speed controller.

Their θ is no clock: it is the place whose reference lies beside the car, y_R = 0, found anew at every sample by
Newton's method from where it was expected. They are given the whole reference, speed included, and so follow what a
funnel's law follows; only how they steer and how they time themselves is their own.
"""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cfjax.errors import InputError
from cfjax.plants import Measurement
from cfjax.plants.plant import number
from cfjax.problem import KinematicBicycle, ReferencePoint
from cfjax.simulation.controller import Controller
from cfjax.simulation.track import Track


NEWTON = 6  # steps to the nearest place
LARGEST_STEP = 0.25  # s of θ, of one of them
LEAST_SHARE = 0.2  # of the reference's speed: the nearest place runs away at the centre of a bend
FASTEST = 4.0  # dθ/dt


class Geometric(Controller):
    """A car with a steering angle and a thrust; the memory is θ, where the nearest place is expected.

    On a path that closes the track should have a lap more than are driven: trackers look ahead.
    """

    track: Track
    period: Float[Array, ""] = eqx.field(converter=number)  # h, s
    speed_gain: Float[Array, ""] = eqx.field(converter=number)  # thrust per speed error, 1/s

    def __check_init__(self) -> None:
        if not isinstance(self.track.vehicle, KinematicBicycle):
            raise InputError(f"baseline: expected a kinematic_bicycle, got {self.track.vehicle.name}")

    @property
    def wheelbase(self) -> float:
        """l, m: as the controller knows it."""
        vehicle = self.track.vehicle
        assert isinstance(vehicle, KinematicBicycle)
        return vehicle.wheelbase

    @abc.abstractmethod
    def steering(self, state: Float[Array, " n"], theta: Float[Array, ""]) -> Float[Array, ""]:
        """The steering angle (rad, left positive) at a state (world frame), θ (s) being the nearest place."""

    def start(self, state: Float[Array, " n"], theta: Float[Array, ""]) -> Float[Array, ""]:
        return theta

    def act(
        self, measurement: Measurement, memory: Float[Array, ""], time: Float[Array, ""]
    ) -> tuple[Float[Array, " m"], Float[Array, ""]]:
        state = measurement.state
        theta = nearest(self.track, state, memory)
        place = self.track.at(theta)
        x = self.track.deviation(place, state)
        pace = jnp.clip(state[3] * jnp.cos(x[0]) / _closing(place.point, x[1]), 0.0, FASTEST)
        thrust = place.point.speed_slope * pace - self.speed_gain * x[3]
        return jnp.stack([self.steering(state, theta), jnp.asarray(thrust, float)]), theta + self.period * pace

    def theta(self, memory: Float[Array, ""]) -> Float[Array, ""]:
        return memory


def nearest(track: Track, state: Float[Array, " n"], guess: Float[Array, ""]) -> Float[Array, ""]:
    """θ (s) near the guess at which the reference lies beside the state, y_R = 0."""

    def closer(_: Any, theta: Array) -> Array:
        place = track.at(theta)
        x = track.deviation(place, state)
        return theta + jnp.clip(x[2] / _closing(place.point, x[1]), -LARGEST_STEP, LARGEST_STEP)

    return jax.lax.fori_loop(0, NEWTON, closer, jnp.asarray(guess, float))


def ahead(track: Track, theta: Float[Array, ""], length: Float[Array, ""]) -> Float[Array, " 2"]:
    """The point (m, world frame) so far along the path; beyond the end of the track it goes straight on."""
    speed = track.at(theta).point.speed
    wanted = theta + length / speed
    last = jnp.minimum(wanted, track.end)
    place = track.at(last)
    alpha, px, py = place.pose
    rest = (wanted - last) * place.point.speed
    return jnp.stack([px - jnp.sin(alpha) * rest, py + jnp.cos(alpha) * rest])


def _closing(point: ReferencePoint, lateral: Array) -> Array:
    """−∂y_R/∂θ, m/s: v_r + ω_r x_R, kept away from zero."""
    return jnp.maximum(point.speed + point.turn_rate * lateral, LEAST_SHARE * point.speed)
