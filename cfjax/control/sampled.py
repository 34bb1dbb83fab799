"""The law that looks one hold ahead: of a finite set of inputs the good one that is nearest to the reference's own.

What makes an input good, and for how long it may be held, `cfjax.funnel.sampled` says. Where the funnel's certificate
comes with a proof of sampled control, some input is good wherever V ≤ 1: V stays there, and on the shell it falls from
each choice to the next, however long each hold is, up to the period. Where none is good, outside or without such a
proof, the law takes the one under which V rises least, and says that nothing is promised.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cfjax.funnel import Template
from cfjax.funnel.sampled import Holds, look_ahead
from cfjax.problem import ReferencePoint, Vehicle, feedforward
from cfjax.problem.vehicle import Scalar


class Chosen(NamedTuple):
    """The inputs (u0, *vehicle inputs) for the next hold, and whether they are good."""

    inputs: Float[Array, " m"]
    promised: Bool[Array, ""]


def choose_for_hold(
    vehicle: Vehicle,
    template: Template,
    numbers: Holds,
    reference: ReferencePoint,
    theta: Scalar,
    x: Float[Array, " n"],
) -> Chosen:
    """The inputs to hold from (θ in s, deviation x) on, beside a reference point that stays as it is."""
    ahead = look_ahead(vehicle, template, numbers, reference, theta, x)
    choices = jnp.asarray(numbers.choices)
    room = jnp.ptp(choices, axis=0)
    own = jnp.stack(jnp.broadcast_arrays(*feedforward(vehicle, reference)))
    apart = jax.vmap(lambda choice: (choice - own) / jnp.where(room > 0, room, 1.0))(choices)
    distance = (apart**2).sum(axis=1)
    promised = ahead.good.any()
    cost = jnp.where(promised, jnp.where(ahead.good, distance, jnp.inf), ahead.change)
    return Chosen(choices[jnp.argmin(cost)], promised)
