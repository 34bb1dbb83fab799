"""Where is this car? The place on the path at which V is smallest, and whether the car is in the funnel there.

A car that is put somewhere starts at that θ (and so does a law that has lost its own): the funnel holds a state if it
does so at some θ.
"""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike

from cfjax.coerce import array
from cfjax.control.legs import leg_arrays
from cfjax.funnel import Leg, Template
from cfjax.problem import Path, Problem, Vehicle, to_deviation
from cfjax.problem.course import Pieces, point_at, poses_of, profiles_of


PLACES = 256  # of a leg, at which V is looked at first
REFINEMENTS = 5  # each looks at as many places between the neighbours of the best so far
NEIGHBOURS = 33


class Located(NamedTuple):
    """Where k states are along the path."""

    theta: Float[np.ndarray, " k"]  # s, along the whole path: where V is smallest
    leg: Int[np.ndarray, " k"]
    deviation: Float[np.ndarray, "k n"]  # from the reference there
    value: Float[np.ndarray, " k"]  # V, of the leg's funnel
    inside: Bool[np.ndarray, " k"]  # V ≤ 1: everything that is proven of the funnel holds for the rest of the path


def locate(problem: Problem, legs: Sequence[Leg], states: ArrayLike) -> Located:
    """Find states along the path, rows (α, x, y, ξ…): heading in rad, position in m, inertial frame; internal states.

    θ is the place with the smallest V over all legs, to a millionth of a leg; among places that are as good, as on a
    path that crosses itself, the first. V is looked at in PLACES places of a leg: of two valleys that are narrower
    than these, one may be missed.

    Raises:
        InputError: for states of another shape or that are not finite; as `leg_arrays`.
    """
    arrays = leg_arrays(problem, legs)
    states = jnp.asarray(array("states", states, (None, problem.dimension)))
    profiles, poses = _course(problem.path, problem.side_slip)
    each = zip(arrays.numbers.shape, arrays.numbers.rate, arrays.begin, arrays.end, strict=True)
    found = [_search(problem.vehicle, arrays.template, profiles, poses, *numbers, states) for numbers in each]
    theta, value, deviation = (np.stack([np.asarray(each) for each in every]) for every in zip(*found, strict=True))
    best, each = value.argmin(axis=0), np.arange(len(states))
    smallest = value[best, each]
    return Located(theta[best, each], best, deviation[best, each], smallest, smallest <= 1)


@lru_cache(maxsize=8)
def _course(path: Path, side_slip: float) -> tuple[Pieces, Pieces]:
    return profiles_of(path), poses_of(path, side_slip)


@partial(jax.jit, static_argnames=("vehicle", "template"))
def _search(
    vehicle: Vehicle,
    template: Template,
    profiles: Pieces,
    poses: Pieces,
    shape: Float[Array, "n n"],
    rate: Array,
    begin: Array,
    end: Array,
    states: Float[Array, "k n"],
) -> tuple[Float[Array, " k"], Float[Array, " k"], Float[Array, "k n"]]:
    """θ, V and deviation of the best place of one leg, for each state."""

    def look(state: Array, theta: Array) -> tuple[Array, Array]:
        point = point_at(profiles, profiles.find(theta), theta)
        pose = tuple(value for value, _ in poses.at(poses.find(theta), theta))
        x = jnp.stack(jnp.broadcast_arrays(*to_deviation(vehicle, tuple(state), pose, point)), axis=-1)
        return template.value(rate, theta - begin, jnp.einsum("ti,ij,tj->t", x, shape, x)), x

    def of(state: Array) -> tuple[Array, Array, Array]:
        theta = jnp.linspace(begin, end, PLACES)
        value, x = look(state, theta)
        for _ in range(REFINEMENTS):
            best, step = jnp.argmin(value), theta[1] - theta[0]
            low, high = jnp.maximum(theta[best] - step, begin), jnp.minimum(theta[best] + step, end)
            theta = jnp.linspace(low, high, NEIGHBOURS)
            value, x = look(state, theta)
        best = jnp.argmin(value)
        return theta[best], value[best], x[best]

    return jax.vmap(of)(states)
