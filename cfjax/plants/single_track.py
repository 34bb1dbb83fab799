"""The dynamic single-track model: tyre slip, load transfer, a steering servo with lag and rate limit.

With β the slip angle at the centre of mass, r the yaw rate, δ the steering angle and v the speed of the centre of mass:

    β̇ = (F_f + F_r)/(m v) − r        ṙ = (l_f F_f − l_r F_r)/I        v̇ = a        δ̇ = clip((δ_c − δ)/τ, ±rate)

    F_i = μ F_zi C_i α_i        α_f = δ − β − l_f r/v           α_r = −β + l_r r/v
                                F_zf = m (g l_r − a h)/l        F_zr = m (g l_f + a h)/l

as in M. Althoff and G. Würsching, "CommonRoad: Vehicle Models" (2020), section "Single-Track Model", to which it is
held in a test. Two things are added. Slip angles are singular at v = 0, so that below `blend_to` the model turns into
the kinematic one, smoothly, and below `blend_from` it is that. And a tyre gives no more than μ F_z:
F = μ F_z tanh(C α), unless `saturating` is off.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from cfjax import coerce
from cfjax.errors import InputError
from cfjax.plants.plant import Plant, Scene, number


GRAVITY = 9.81  # m/s²
RELAXATION = 0.02  # s: in which β and r follow the kinematic model where that one holds
FULL_SIZE = 1.0  # m of wheelbase, from which on a car is a passenger car


class SingleTrack(Plant):
    """States (α, x, y, v, β, r, δ): heading, centre of mass, its speed, slip angle, yaw rate, steering angle."""

    front: Float[Array, ""] = eqx.field(converter=number)  # l_f, centre of mass to front axle, m
    rear: Float[Array, ""] = eqx.field(converter=number)  # l_r, m
    mass: Float[Array, ""] = eqx.field(converter=number)  # kg
    inertia: Float[Array, ""] = eqx.field(converter=number)  # about the vertical axis, kg m²
    height: Float[Array, ""] = eqx.field(converter=number)  # of the centre of mass, m
    friction: Float[Array, ""] = eqx.field(converter=number)  # μ
    front_stiffness: Float[Array, ""] = eqx.field(converter=number)  # C_f: cornering stiffness over μ F_z, 1/rad
    rear_stiffness: Float[Array, ""] = eqx.field(converter=number)  # C_r, 1/rad
    lag: Float[Array, ""] = eqx.field(converter=number, default=0.05)  # τ of the servo, s
    steering_rate: Float[Array, ""] = eqx.field(converter=number, default=3.2)  # at most, rad/s
    blend_from: Float[Array, ""] = eqx.field(converter=number, default=0.2)  # m/s
    blend_to: Float[Array, ""] = eqx.field(converter=number, default=0.5)  # m/s
    saturating: bool = eqx.field(static=True, default=True)

    @property
    def longest_step(self) -> float:
        # slip decays at μ C g/v: 1000/s for a passenger car at blend_from
        return 2e-3

    def start(self, state: Float[Array, " n"]) -> Float[Array, " z"]:
        alpha, x, y, v = state
        return jnp.stack([alpha, x - self.rear * jnp.sin(alpha), y + self.rear * jnp.cos(alpha), v, *jnp.zeros(3)])

    def draw(self, key: PRNGKeyArray, time: Float[Array, ""]) -> Float[Array, " d"]:
        return jnp.zeros(0)

    def rate(
        self, z: Float[Array, " z"], command: Float[Array, " m"], draw: Float[Array, " d"], scene: Scene
    ) -> Float[Array, " z"]:
        wanted, thrust = command
        servo = jnp.clip((wanted - z[6]) / self.lag, -self.steering_rate, self.steering_rate)
        return self.motion(z, servo, thrust)

    def motion(self, z: Float[Array, " z"], servo: Float[Array, ""], thrust: Float[Array, ""]) -> Float[Array, " z"]:
        """dz/dt at a steering rate (rad/s) and an acceleration (m/s²)."""
        alpha, _, _, v, slip, turn, steering = z
        length, tangent = self.front + self.rear, jnp.tan(steering)
        # kinematic: the rear axle does not slip
        share = self.rear / length * tangent
        slip_k = jnp.arctan(share)
        turn_k = v * jnp.cos(slip_k) * tangent / length
        tangent_rate = servo / jnp.cos(steering) ** 2
        slip_k_rate = self.rear / length * tangent_rate / (1 + share**2)
        turn_k_rate = (
            thrust * jnp.cos(slip_k) * tangent
            - v * jnp.sin(slip_k) * slip_k_rate * tangent
            + v * jnp.cos(slip_k) * tangent_rate
        ) / length
        # dynamic; v as it is where that counts, and away from zero where it does not
        speed = jnp.maximum(v, self.blend_from)
        front = self._force(
            self.front_stiffness,
            (GRAVITY * self.rear - thrust * self.height) / length,
            steering - slip - self.front * turn / speed,
        )
        rear = self._force(
            self.rear_stiffness,
            (GRAVITY * self.front + thrust * self.height) / length,
            self.rear * turn / speed - slip,
        )
        slip_d_rate = (front + rear) / speed - turn
        turn_d_rate = self.mass * (self.front * front - self.rear * rear) / self.inertia
        t = jnp.clip((v - self.blend_from) / (self.blend_to - self.blend_from), 0.0, 1.0)
        dynamic = t**2 * (3 - 2 * t)

        def blended(one: Array, other: Array) -> Array:
            return dynamic * one + (1 - dynamic) * other

        course = alpha + blended(slip, slip_k)
        return jnp.stack(
            [
                blended(turn, turn_k),
                -v * jnp.sin(course),
                v * jnp.cos(course),
                thrust,
                blended(slip_d_rate, slip_k_rate + (slip_k - slip) / RELAXATION),
                blended(turn_d_rate, turn_k_rate + (turn_k - turn) / RELAXATION),
                servo,
            ]
        )

    def _force(self, stiffness: Array, load: Array, slip: Array) -> Array:
        """Lateral force of an axle over the mass, m/s²; `load` is that of its weight."""
        grip = self.friction * load
        return grip * (jnp.tanh(stiffness * slip) if self.saturating else stiffness * slip)

    def observe(self, z: Float[Array, " z"]) -> Float[Array, " n"]:
        alpha, x, y, v, slip = z[:5]
        forward = v * jnp.cos(slip)
        return jnp.stack([alpha, x + self.rear * jnp.sin(alpha), y - self.rear * jnp.cos(alpha), forward])


FIELDS = {field.name for field in dataclasses.fields(SingleTrack)} - {"saturating"}


def single_track(
    wheelbase: float,
    *,
    stiffness: float = 1.0,
    lag: float | None = None,
    rate: float | None = None,
    saturating: bool = True,
    **numbers: float,
) -> SingleTrack:
    """A car of this wheelbase (m): a 1/10-scale racer, or from 1 m on a passenger car, with lengths in proportion.

    `stiffness` multiplies that of both tyres; `lag` (s) and `rate` (rad/s) are the servo's; `numbers` replace fields.

    The racer is the F1TENTH car (parameters of the F1TENTH gym, github.com/f1tenth/f1tenth_gym); the passenger car
    CommonRoad's vehicle 2, a BMW 320i. Lags are assumptions: 0.05 s and 0.1 s.

    Raises:
        InputError: for numbers that are not positive.
    """
    wheelbase, saturating = coerce.number("wheelbase", wheelbase, "m", above=0), coerce.flag("saturating", saturating)
    given = {"lag": lag, "steering_rate": rate, **numbers}
    given = {label: value for label, value in given.items() if value is not None}
    if wheelbase < FULL_SIZE:
        scale = wheelbase / 0.3302
        own: dict[str, float] = {
            "front": 0.15875 * scale,
            "rear": 0.17145 * scale,
            "mass": 3.74,
            "inertia": 0.04712 * scale**2,
        }
        own |= {"height": 0.074 * scale, "friction": 1.0489, "front_stiffness": 4.718, "rear_stiffness": 5.4562}
        own |= {"lag": 0.05, "steering_rate": 3.2}
    else:
        scale = wheelbase / 2.5789128
        own = {"front": 1.1561957064 * scale, "rear": 1.4227170936 * scale, "mass": 1093.2952334674046}
        own |= {"inertia": 1791.5995300122856 * scale**2, "height": 0.61373004 * scale, "friction": 1.0489}
        own |= {"front_stiffness": 20.898, "rear_stiffness": 20.898, "lag": 0.1, "steering_rate": 0.4}
        own |= {"blend_from": 0.5, "blend_to": 1.5}
    stiffness = coerce.number("plant.stiffness", stiffness, above=0)
    own["front_stiffness"] *= stiffness
    own["rear_stiffness"] *= stiffness
    if unknown := set(given) - FIELDS:
        raise InputError(f"plant: expected numbers of {', '.join(sorted(FIELDS))}, got {', '.join(sorted(unknown))}")
    own |= {label: coerce.number(f"plant.{label}", value, above=0) for label, value in given.items()}
    made: dict[str, Any] = {**own, "saturating": saturating}
    return SingleTrack(**made)
