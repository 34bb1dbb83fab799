"""The vehicle of the problem as a plant: its own kinematics, without or with an additive disturbance."""

import math
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from cfjax.coerce import one_of
from cfjax.errors import InputError
from cfjax.plants.plant import Plant, Scene, number, vehicle_of
from cfjax.problem import KinematicBicycle, Vehicle


Kind = Literal["constant", "random", "adversarial"]
KINDS: tuple[Kind, ...] = ("constant", "random", "adversarial")


def inputs_of(vehicle: Vehicle, command: Float[Array, " m"]) -> tuple[Array, ...]:
    """The inputs of a vehicle that is given a physical command.

    Raises:
        InputError: for a vehicle with commands of its own, whose inverse nobody wrote.
    """
    if isinstance(vehicle, KinematicBicycle):
        return jnp.tan(command[0]), command[1]
    if type(vehicle).command is not Vehicle.command:
        raise InputError(f"plant: expected commands that are inputs, the vehicle {vehicle.name} has others")
    return tuple(command)


def world_rate(vehicle: Vehicle, state: Float[Array, " n"], inputs: tuple[Array, ...]) -> Float[Array, " n"]:
    """d/dt of (α, x, y, ξ…) by the body twist: rad/s, m/s, m/s, unit of ξ per second."""
    alpha, internal = state[0], tuple(state[3:])
    twist = vehicle.twist(internal, inputs)
    c, s = jnp.cos(alpha), jnp.sin(alpha)
    velocity = c * twist.lateral - s * twist.forward, s * twist.lateral + c * twist.forward
    return jnp.stack([number(rate) for rate in (twist.turn, *velocity, *vehicle.internal_rate(internal, inputs))])


class Model(Plant):
    """The vehicle itself; one with other numbers than the controller's is a mismatch."""

    vehicle: Vehicle = eqx.field(static=True, converter=vehicle_of)

    @property
    def longest_step(self) -> float:
        return math.inf

    def start(self, state: Float[Array, " n"]) -> Float[Array, " z"]:
        return state

    def draw(self, key: PRNGKeyArray, time: Float[Array, ""]) -> Float[Array, " d"]:
        return jnp.zeros(0)

    def rate(
        self, z: Float[Array, " z"], command: Float[Array, " m"], draw: Float[Array, " d"], scene: Scene
    ) -> Float[Array, " z"]:
        return world_rate(self.vehicle, z, inputs_of(self.vehicle, command))

    def observe(self, z: Float[Array, " z"]) -> Float[Array, " n"]:
        return z


def _kind_number(kind: Kind) -> Array:
    """Its place among KINDS: an array, so that one program drives all of them."""
    return jnp.asarray(KINDS.index(one_of("plant.kind", kind, KINDS)))


class Disturbed(Plant):
    """The vehicle with something added to the rates of its deviation (α_R, x_R, y_R, ξ_R…), |d_i| ≤ bound_i.

    `constant`: d = bound, with the signs that it has. `random`: uniform within ±bound, piecewise constant over `hold`
    seconds. `adversarial`: d_i = |bound_i| sign(∂V/∂x_i) at every instant, which of all within the bounds raises V
    most.
    """

    vehicle: Vehicle = eqx.field(static=True, converter=vehicle_of)
    bound: Float[Array, " n"] = eqx.field(converter=number)  # rad/s, m/s, m/s, unit of ξ per second
    kind: Int[Array, ""] = eqx.field(converter=_kind_number)  # of KINDS
    hold: Float[Array, ""] = eqx.field(converter=number, default=0.1)  # s

    def __check_init__(self) -> None:
        if self.bound.shape != (len(self.vehicle.state_names),):
            raise InputError(f"plant: expected a bound for each of {', '.join(self.vehicle.state_names)}")

    @property
    def longest_step(self) -> float:
        return math.inf

    def start(self, state: Float[Array, " n"]) -> Float[Array, " z"]:
        return state

    def draw(self, key: PRNGKeyArray, time: Float[Array, ""]) -> Float[Array, " d"]:
        # the same all along a stretch of `hold` seconds; periods lie within rounding of its ends
        stretch = jnp.floor(time / self.hold + 1e-6).astype(int)
        chance = self.bound * jax.random.uniform(
            jax.random.fold_in(key, stretch), self.bound.shape, minval=-1.0, maxval=1.0
        )
        steady = jnp.where(self.kind == KINDS.index("constant"), self.bound, jnp.abs(self.bound))
        return jnp.where(self.kind == KINDS.index("random"), chance, steady)

    def rate(
        self, z: Float[Array, " z"], command: Float[Array, " m"], draw: Float[Array, " d"], scene: Scene
    ) -> Float[Array, " z"]:
        d = jnp.where(self.kind == KINDS.index("adversarial"), draw * jnp.sign(scene.gradient), draw)
        # from the reference's frame, in which deviations are measured, to the plane
        c, s = jnp.cos(scene.heading), jnp.sin(scene.heading)
        added = d.at[1].set(c * d[1] - s * d[2]).at[2].set(s * d[1] + c * d[2])
        return world_rate(self.vehicle, z, inputs_of(self.vehicle, command)) + added

    def observe(self, z: Float[Array, " z"]) -> Float[Array, " n"]:
        return z
