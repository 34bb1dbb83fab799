"""Witnesses of condition (d), and what they ask of the coefficients: half-spaces of decrease.

A witness is a point (θ, x) at which a candidate failed, with the input that was demonstrated there. From then on V̇
along that input has to fall there:

    ∇V · f(x, u) + ∂V/∂θ u0 ≤ −ε                 `paper`: linear in C and c0
    ∇V · f(x, u) + ∂V/∂θ u0 ≤ −ε V/β̲             `contracting`: linear in C, for one rate k at a time; and `paper`
                                                 with an inner level

(The second line asks for ε where V = β̲ and for ε/β̲ where V = 1, the falsifier only for ε: it accepts a little more. So
where no candidate is left, it was the larger demand that left none, and the message says so.)
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


BLOCK = 64  # points of one compiled evaluation


class Witnesses(NamedTuple):
    """Points at which candidates failed (d), with what was demonstrated there."""

    theta: Float[np.ndarray, " k"]  # s
    x: Float[np.ndarray, "k n"]  # deviations
    inputs: Float[np.ndarray, "k m"]  # (u0, u)
    drift: Float[np.ndarray, "k n"]  # of the deviation: ẋ = drift + columns · inputs
    columns: Float[np.ndarray, "k n m"]

    @classmethod
    def none(cls, problem: Problem) -> "Witnesses":
        n, m = problem.dimension, len(problem.inputs)
        return cls(*(np.zeros(shape) for shape in ((0,), (0, n), (0, m), (0, n), (0, n, m))))

    def and_(self, other: "Witnesses") -> "Witnesses":
        return Witnesses(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


def decrease(
    found: Coordinates, witnesses: Witnesses, margin: float
) -> tuple[Float[np.ndarray, "k p r"], Float[np.ndarray, " k"]]:
    """V̇ ≤ −margin (1/s) as half-spaces affine in the input: rows · c ≤ offset, Σ rows_j (1, u0, u)_j."""
    theta, x, _, drift, columns = witnesses
    form = found.form(x)
    rows = np.stack([2 * found.form(x, way) for way in (drift, *np.moveaxis(columns, -1, 0))], axis=1)
    faded = margin / found.beta_lower
    if found.change is not None:
        rows[:, 1] += found.change / found.duration * form
        rows[:, 0] += faded * form
        return rows, np.zeros(len(x))
    rows[:, 1] += found.last(np.full(len(x), 1 / found.duration))
    if found.beta_inner is None:
        return rows, np.full(len(x), -margin)
    rows[:, 0] += faded * (form + found.last(theta / found.duration))
    return rows, np.zeros(len(x))


def falling(coordinates: Coordinates, witnesses: Witnesses, margin: float) -> Polytope:
    """V̇ ≤ −margin (1/s) along the demonstrated inputs."""
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
    points = np.array([segment.point(float(place)) for place in theta], float).reshape(-1, 4)
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
