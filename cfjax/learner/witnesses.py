"""Witnesses of condition (d), and what they ask of the coefficients: half-spaces of decrease.

A witness is a point (θ, x) at which a candidate failed, at the level ℓ that V had there, with the input that was
demonstrated. From then on V̇ along that input has to fall there:

    ∇V · f(x, u) + ∂V/∂θ u0 ≤ −ε − μ (V − ℓ)     `paper`: linear in C and c0
    ∇V · f(x, u) + ∂V/∂θ u0 ≤ −ε V/β̲             `contracting`: linear in C, for one rate k at a time; and `paper`
                                                 with an inner level

**μ.** (d) asks for nothing where V < β̲. "V ≥ ℓ implies V̇ ≤ −ε" is no half-space of coefficients; the first line is
one, and it implies that (a barrier function's condition, with the slope μ). A candidate that has the witness well
inside may let V grow there, which matters most where the failed candidate was narrow: its shell comes near x = 0, where
a wider V cannot fall as fast as c0 u0 rises. The price: a candidate whose funnel the witness lies far outside of has to
fall faster. With μ = 0 every candidate has to fall by ε at every witness, and `paper` is found on few rows.

The second line asks for ε where V = β̲ and for ε/β̲ where V = 1, the falsifier only for ε: it accepts a little more. So
where no candidate is left, it was the larger demand that left none, and the message says so, of the first line too.
"""

from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from cfjax.learner.centre import Polytope
from cfjax.learner.coefficients import Coordinates
from cfjax.problem import Problem, ReferencePoint, Vehicle, affine_deviation


FADING = 4.0  # μ T, chosen on the paper's rows: 3 and 6 find the same ones, from 12 on there are fewer
BLOCK = 64  # points of one compiled evaluation


class Witnesses(NamedTuple):
    """Points at which candidates failed (d), with what was demonstrated there."""

    theta: Float[np.ndarray, " k"]  # s
    x: Float[np.ndarray, "k n"]  # deviations
    level: Float[np.ndarray, " k"]  # ℓ: V of the candidate that failed there
    inputs: Float[np.ndarray, "k m"]  # (u0, u)
    drift: Float[np.ndarray, "k n"]  # of the deviation: ẋ = drift + columns · inputs
    columns: Float[np.ndarray, "k n m"]

    @classmethod
    def none(cls, problem: Problem) -> "Witnesses":
        n, m = problem.dimension, len(problem.inputs)
        return cls(*(np.zeros(shape) for shape in ((0,), (0, n), (0,), (0, m), (0, n), (0, n, m))))

    def and_(self, other: "Witnesses") -> "Witnesses":
        return Witnesses(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


def decrease(
    found: Coordinates, witnesses: Witnesses, margin: float
) -> tuple[Float[np.ndarray, "k p r"], Float[np.ndarray, " k"]]:
    """That V falls, by `margin` (1/s) at ℓ: half-spaces rows · c ≤ offset, with rows affine in the input.

    Σ rows_j (1, u0, u)_j.
    """
    theta, x, level, _, drift, columns = witnesses
    form = found.form(x)
    rows = np.stack([2 * found.form(x, way) for way in (drift, *np.moveaxis(columns, -1, 0))], axis=1)
    faded = margin / found.beta_lower
    if found.change is not None:
        rows[:, 1] += found.change / found.duration * form
        rows[:, 0] += faded * form
        return rows, np.zeros(len(x))
    rows[:, 1] += found.last(np.full(len(x), 1 / found.duration))
    value = form + found.last(theta / found.duration)
    if found.beta_inner is None:
        rows[:, 0] += steepness(found) * value
        return rows, steepness(found) * level - margin
    rows[:, 0] += faded * value
    return rows, np.zeros(len(x))


def steepness(coordinates: Coordinates) -> float:
    """μ, 1/s."""
    return FADING / coordinates.duration


def falling(coordinates: Coordinates, witnesses: Witnesses, margin: float) -> Polytope:
    """The same along the demonstrated inputs."""
    rows, offsets = decrease(coordinates, witnesses, margin)
    return Polytope(np.einsum("kj,kjr->kr", with_one(witnesses.inputs), rows), offsets)


def with_one(inputs: Float[np.ndarray, "*batch m"]) -> Float[np.ndarray, "*batch p"]:
    """(1, u0, u): what `decrease` is linear in."""
    return np.concatenate([np.ones((*inputs.shape[:-1], 1)), inputs], axis=-1)


def dynamics(
    problem: Problem, theta: Float[np.ndarray, " k"], x: Float[np.ndarray, "k n"]
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, "k n m"]]:
    """Drift and input columns of the deviations x at θ, on the path's first segment."""
    segment = problem.path.curve[0]
    points = np.array(segment.points(theta), float).reshape(-1, 4)
    blocks = max(1, -(-len(x) // BLOCK))
    where = np.minimum(np.arange(blocks * BLOCK), max(len(x) - 1, 0))
    parts = [
        _batched(problem.vehicle)(jnp.asarray(x[i]), ReferencePoint(*jnp.asarray(points[i].T)))
        for i in (np.split(where, blocks) if len(x) else [])
    ]
    size, count = problem.dimension, len(problem.inputs)
    drift = np.concatenate([np.zeros((0, size)), *(np.asarray(part[0]) for part in parts)])
    columns = np.concatenate([np.zeros((0, size, count)), *(np.asarray(part[1]) for part in parts)])
    return drift[: len(x)], columns[: len(x)]


@lru_cache
def _batched(vehicle: Vehicle):
    return jax.jit(jax.vmap(lambda x, reference: affine_deviation(vehicle, x, reference)))
