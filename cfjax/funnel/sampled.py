"""What each input of a finite set does to V over a whole hold, looked at from where it begins.

Along an input u that is held from s = 0 on, V(s) ≤ V + s max_j B_j(u) for 0 ≤ s ≤ h as long as V ≤ 1. The B_j are the
Bernstein coefficients of Taylor's polynomial of (V(s) − V)/s, the last one with a bound of what is left out. An input
is **good** at a deviation if on the shell every B_j ≤ −λ', and inside it every B_j ≤ (1 − V)/h. A certificate may show
that one of the set is good wherever V ≤ 1 (`cfcheck.robustness.sampled`).
"""

from collections.abc import Callable
from math import comb, factorial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from cfjax.coerce import array, number, objects, whole
from cfjax.errors import InputError
from cfjax.funnel.funnel import Funnel, require_fit
from cfjax.funnel.template import Template
from cfjax.problem import Problem, ReferencePoint, Vehicle, deviation_rate
from cfjax.problem.vehicle import Scalar


ROUNDING = 2.0**-20  # of λ': what a law that computes in floating point leaves of it


class Holds(NamedTuple):
    """Inputs to choose from, and what is asked of them, as a pytree; `vehicle` and `template` are given beside it."""

    shape: Float[Array | np.ndarray, "n n"]  # C
    rate: Scalar  # of the template, 1/s
    beta_lower: Scalar
    period: Scalar  # h, s
    decrease: Scalar  # λ', 1/s
    choices: Float[Array | np.ndarray, "c m"]  # (u0, *vehicle inputs)
    left_out: Float[Array | np.ndarray, " c"]  # 1/s
    weights: Float[Array | np.ndarray, "j k"]  # of the derivatives of V in each B_j


class Ahead(NamedTuple):
    """V where a hold begins, for each input the largest B_j (1/s), and whether the input is good."""

    value: Scalar
    change: Float[Array, " c"]
    good: Bool[Array, " c"]


def holds(
    problem: Problem,
    funnel: Funnel,
    period: float,
    order: int,
    decrease: float,
    choices: Float[np.ndarray, "c m"],
    bends: Float[np.ndarray, " c"],
) -> Holds:
    """The numbers of holds of up to `period` (s) in a funnel.

    `bends` bounds V's derivative of the next order than `order` while each of the `choices` is held, 1/s^(order+1). On
    the shell V falls at `decrease` (1/s).

    Raises:
        InputError: for numbers of another kind, or a funnel of another problem.
    """
    objects(problem=(problem, Problem), funnel=(funnel, Funnel))
    require_fit(problem, [funnel])
    period, order = number("period", period, "s", above=0), whole("order", order, 1)
    decrease = number("decrease", decrease, "1/s", above=0)
    choices = np.asarray(array("choices", choices, (None, len(problem.inputs))))
    bends = np.asarray(array("bends", bends, (len(choices),)))
    if (bends < 0).any():
        raise InputError(f"bends: expected numbers that are not negative, got {bends.min():g}")
    weights = [
        [period**k * comb(j, k) / comb(order - 1, k) / factorial(k + 1) for k in range(order)] for j in range(order)
    ]
    return Holds(
        shape=np.asarray(funnel.shape, float),
        rate=np.float64(funnel.rate),
        beta_lower=np.float64(funnel.beta_lower),
        period=np.float64(period),
        decrease=np.float64(decrease * (1 - ROUNDING)),
        choices=choices,
        left_out=period**order / factorial(order + 1) * bends,
        weights=np.array(weights),
    )


def value_of(template: Template, numbers: Holds) -> Callable[[Float[Array, " n1"]], Array]:
    """V of (θ in s, deviation), as one vector."""
    return lambda z: jnp.asarray(template.value(numbers.rate, z[0], z[1:] @ numbers.shape @ z[1:]))


def held_motion(
    vehicle: Vehicle, inputs: Float[Array, " m"], reference: ReferencePoint
) -> Callable[[Float[Array, " n1"]], Array]:
    """d/ds of (θ in s, deviation) while inputs (u0 first) are held, beside a reference that stays as it is."""
    return lambda z: jnp.stack([inputs[0], *deviation_rate(vehicle, tuple(z[1:]), tuple(inputs), reference)])


def look_ahead(
    vehicle: Vehicle,
    template: Template,
    numbers: Holds,
    reference: ReferencePoint,
    theta: Scalar,
    x: Float[Array, " n"],
) -> Ahead:
    """What each input does over a hold that begins at (θ in s, deviation x) beside a reference that stays as it is."""
    start, value = jnp.concatenate([jnp.reshape(theta, 1), x]), value_of(template, numbers)

    def bernstein(inputs: Array) -> Array:
        motion = held_motion(vehicle, inputs, reference)
        derivatives, of = [], value
        for _ in range(len(numbers.weights)):
            of = _along(of, motion)
            derivatives.append(of(start))
        return jnp.asarray(numbers.weights) @ jnp.stack(derivatives)

    points = jax.vmap(bernstein)(jnp.asarray(numbers.choices)).at[:, -1].add(numbers.left_out)
    change, here = points.max(axis=1), value(start)
    good = jnp.where(here >= numbers.beta_lower, change <= -numbers.decrease, change * numbers.period <= 1 - here)
    return Ahead(here, change, good & (here <= 1))


def _along(of: Callable[[Array], Array], motion: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """The derivative of a function along a motion."""
    return lambda z: jax.jvp(of, (z,), (motion(z),))[1]
