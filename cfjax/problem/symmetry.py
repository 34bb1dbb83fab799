"""Mirror symmetry of a vehicle: turning left is like turning right.

Looked for in samples, for a learner to make use of; a proof looks for itself (`cfcheck.vehicle.structure`).
"""

import itertools
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.coerce import instance
from cfjax.problem.deviation import ReferencePoint, deviation_rate
from cfjax.problem.vehicle import Vehicle


PROBES, TOLERANCE = 16, 1e-9


def mirror_signs(vehicle: Vehicle) -> tuple[int, ...] | None:
    """Signs M of the states with f(Mx, Nu; −ω_r) = M f(x, u; ω_r) for some signs N of inputs with a symmetric range.

    f is the rate of the deviation, ω_r the turning rate of the reference; u0 keeps its sign. None where there are none.
    """
    instance("vehicle", vehicle, Vehicle)
    return _mirror_signs(vehicle)


@lru_cache
def _mirror_signs(vehicle: Vehicle) -> tuple[int, ...] | None:
    rng = np.random.default_rng(0)
    size, count = len(vehicle.state_names), 1 + len(vehicle.input_names)
    x, u, reference = (jnp.asarray(rng.normal(size=(PROBES, k))) for k in (size, count, 4))
    turned = reference * jnp.array([-1.0, 1.0, -1.0, 1.0])[None, :]  # turn rate, speed and their slopes
    rates = np.asarray(_rates(vehicle, x, u, reference))
    may_flip = [(1,), *((1, -1) if box.lower == -box.upper else (1,) for box in vehicle.input_box)]
    for signs in itertools.product((1, -1), repeat=size):
        for inputs in itertools.product(*may_flip):
            flipped = x * jnp.array(signs, float)[None, :], u * jnp.array(inputs, float)[None, :]
            other = np.asarray(_rates(vehicle, *flipped, turned))
            known = np.isfinite(rates).all(axis=1) & np.isfinite(other).all(axis=1)  # not every reference is one of its
            if known.any() and np.allclose(other[known], (rates * signs)[known], rtol=TOLERANCE, atol=TOLERANCE):
                return signs
    return None


@partial(jax.jit, static_argnames="vehicle")
def _rates(
    vehicle: Vehicle, x: Float[Array, "k n"], u: Float[Array, "k m"], reference: Float[Array, "k 4"]
) -> Float[Array, "k n"]:
    rates = deviation_rate(vehicle, tuple(x.T), tuple(u.T), ReferencePoint(*reference.T))
    return jnp.stack([jnp.broadcast_to(rate, (PROBES,)) for rate in rates], axis=-1)
