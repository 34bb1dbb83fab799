"""A sums-of-squares program by an interior-point method, posed by values at points; `batched` has many solved.

With p_i the points of `cfjax.solver.points` and P_k the values of an orthonormal basis there, the identity of
`cfjax.solver.program` is one equation for each point, and its dual is small:

    maximise λ      t − λ δ = Σ_k A_k(Q_k),   λ + s = cap,   Q_k ⪰ 0,  s ≥ 0       A_k(Q)_i = g_k(p_i) P_k[i]ᵀ Q P_k[i]
    minimise t·y + cap w     δ·y + w = 1,   S_k = M_k(y) ⪰ 0,   w ≥ 0               M_k(y) = P_kᵀ diag(g_k y) P_k

(weighted sums of squares in an interpolant basis, Papp & Yıldız 2019). Both are feasible inside whatever the cell is:
on an empty one λ is the cap. Newton's steps are those of HKM (Helmberg et al. 1996) with Mehrotra's corrector: their
Schur complement is the elementwise product Σ_k (g_k g_kᵀ) ∘ (P_k Q_k P_kᵀ) ∘ (P_k S_k⁻¹ P_kᵀ), so that no equation is
larger than the number of points.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Bool, Float, Int


TOLERANCE = 1e-6  # duality gap, of the target's largest value: below, the Schur complement loses its digits
PENALTY = 1e-6  # on the traces of Gram matrices: short ones cost less in rounding; λ is short by some 1e-7
MOST_STEPS = 40
TO_THE_EDGE = (0.8, 0.98)  # of the way to the cone's boundary: where no step is possible, and where a whole one is
SMALLEST = 1e-300

Blocks = tuple[Float[Array, "_ _ _"], ...]  # (k, m, m): stacks by degree
Bases = tuple[Float[Array, "_ _"], ...]  # (u, m)
Factors = tuple[Float[Array, "_ _"], ...]  # (k, u)


class State(NamedTuple):
    """An iterate, and how good it is: the gap, and the identity's largest error."""

    margin: Float[Array, ""]
    slack: Float[Array, ""]
    moments: Float[Array, " u"]  # y
    weight: Float[Array, ""]  # w, the slack's dual
    grams: Blocks  # Q
    duals: Blocks  # S
    steps: Int[Array, ""]
    gap: Float[Array, ""]
    error: Float[Array, ""]
    is_done: Bool[Array, ""]


class _Step(NamedTuple):
    margin: Float[Array, ""]
    slack: Float[Array, ""]
    moments: Float[Array, " u"]
    weight: Float[Array, ""]
    grams: Blocks
    duals: Blocks
    primal: Float[Array, ""]  # how far it can be gone: 1 is all of it
    dual: Float[Array, ""]


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + matrix.mT)


def _each(function: Callable, *stacks: Any) -> Any:
    """The function of every block. One after another: LAPACK's routines are called on single matrices, and the
    compiled program is the same size for any number of blocks.
    """
    if len(jax.tree.leaves(stacks)[0]) == 1:
        return jax.tree.map(lambda out: out[None], function(*jax.tree.map(lambda stack: stack[0], stacks)))
    return jax.lax.map(lambda blocks: function(*blocks), stacks)


def identity_side(basis: Any, factors: Any, grams: Any) -> Any:
    """Σ A_k(Q_k) over a stack."""
    return (factors * ((basis[None] @ grams) * basis[None]).sum(axis=-1)).sum(axis=0)


def _moment_matrices(basis: Array, factors: Array, moments: Array) -> Array:
    """M_k(y) of a stack."""
    return _each(lambda g: basis.T @ ((g * moments)[:, None] * basis), factors)


def _schur(basis: Array, factors: Array, grams: Array, inverses: Array) -> Array:
    """The part of a stack in the Schur complement."""

    def part(g: Array, gram: Array, inverse: Array) -> Array:
        weighted = g[:, None] * basis
        return (weighted @ gram @ weighted.T) * (basis @ inverse @ basis.T)

    first = part(factors[0], grams[0], inverses[0])
    if len(factors) == 1:
        return first
    rest = (factors[1:], grams[1:], inverses[1:])
    return jax.lax.scan(lambda total, block: (total + part(*block), None), first, rest)[0]


def _room(value: Array, step: Array) -> Array:
    """How much of a step keeps a positive number positive."""
    return jnp.where(step < 0, -value / jnp.minimum(step, -SMALLEST), jnp.inf)


def _room_in_cone(lower: Array, step: Array) -> Array:
    """How much of a step keeps L Lᵀ positive definite."""
    half = solve_triangular(lower, step, lower=True)
    both = solve_triangular(lower, half.T, lower=True)
    return _room(jnp.ones(()), jnp.linalg.eigvalsh(_symmetric(both))[0])


def _inner(first: Sequence[Array], second: Sequence[Array]) -> Array:
    return sum((jnp.sum(a * b) for a, b in zip(first, second, strict=True)), jnp.zeros(()))


def solve_one(
    bases: Bases,
    factors: Factors,
    target: Float[Array, " u"],
    drop: Float[Array, " u"],
    cap: Float[Array, ""],
) -> State:
    """The program with these values at the points; ends at the tolerance, or at the last iterate that is finite."""
    count = len(target)
    sizes = [(len(g), basis.shape[1]) for g, basis in zip(factors, bases, strict=True)]
    degree = 1 + sum(blocks * size for blocks, size in sizes)  # of the barrier
    ones = tuple(jnp.broadcast_to(jnp.eye(size), (blocks, size, size)) for blocks, size in sizes)

    def identity_error(margin: Array, grams: Blocks) -> Array:
        return target - margin * drop - sum(map(identity_side, bases, factors, grams), jnp.zeros(count))

    def improved(state: State) -> State:
        margin, slack, moments, weight, grams, duals, *_ = state
        missing = identity_error(margin, grams)
        missing_slack = cap - margin - slack
        missing_duals = [
            _moment_matrices(basis, g, moments) + PENALTY * one - own
            for basis, g, one, own in zip(bases, factors, ones, duals, strict=True)
        ]
        missing_weight = 1 - drop @ moments - weight
        mean = (_inner(grams, duals) + slack * weight) / degree

        def factored(gram: Array, dual: Array) -> tuple[Array, Array, Array]:
            lower = jnp.linalg.cholesky(dual)
            inverse = solve_triangular(lower, jnp.eye(len(lower)), lower=True)
            return jnp.linalg.cholesky(gram), lower, inverse.T @ inverse

        lowers, dual_lowers, inverses = zip(*map(partial(_each, factored), grams, duals), strict=True)
        schur = sum(map(_schur, bases, factors, grams, inverses), jnp.zeros((count, count)))
        cholesky = jnp.linalg.cholesky(schur), True
        by_margin = cho_solve(cholesky, drop)

        def towards(centre: Array, corrections: Blocks, correction: Array) -> _Step:
            """Newton's step to Q S = centre, less what the step before says of second order."""
            wanted = [
                _each(lambda q, r, si, c: centre * si - q - _symmetric(q @ r @ si + c), *blocks)
                for blocks in zip(grams, missing_duals, inverses, corrections, strict=True)
            ]
            still = cho_solve(cholesky, sum(map(identity_side, bases, factors, wanted), -missing))
            pull = slack / weight
            goal = missing_slack - (centre - correction) / weight + slack + pull * (missing_weight - drop @ still)
            d_margin = goal / (1 + pull * (drop @ by_margin))
            d_moments = still + d_margin * by_margin
            d_weight = missing_weight - drop @ d_moments
            d_slack = missing_slack - d_margin
            moved = [_moment_matrices(basis, g, d_moments) for basis, g in zip(bases, factors, strict=True)]
            d_duals = tuple(map(jnp.add, moved, missing_duals))
            d_grams = tuple(
                _each(lambda w, q, m, si: w - _symmetric(q @ m @ si), *blocks)
                for blocks in zip(wanted, grams, moved, inverses, strict=True)
            )
            primal, dual = _room(slack, d_slack), _room(weight, d_weight)
            for blocks in zip(lowers, d_grams, dual_lowers, d_duals, strict=True):
                own = _each(lambda a, da, b, db: (_room_in_cone(a, da), _room_in_cone(b, db)), *blocks)
                primal, dual = jnp.minimum(primal, own[0].min()), jnp.minimum(dual, own[1].min())
            return _Step(d_margin, d_slack, d_moments, d_weight, d_grams, d_duals, primal, dual)

        def predict_and_correct(_: Any, carry: tuple) -> tuple:
            """Once for the predictor, once for the corrector: written as a loop, it is compiled once."""
            step = towards(*carry[:3])
            primal, dual = jnp.minimum(1.0, step.primal), jnp.minimum(1.0, step.dual)
            ahead = [q + primal * d for q, d in zip(grams, step.grams, strict=True)]
            ahead_dual = [s + dual * d for s, d in zip(duals, step.duals, strict=True)]
            left = _inner(ahead, ahead_dual) + (slack + primal * step.slack) * (weight + dual * step.weight)
            centring = jnp.clip((left / degree / mean) ** 2, 1e-4, 1.0)
            second_order = tuple(
                _each(lambda a, b, si: a @ b @ si, *blocks)
                for blocks in zip(step.grams, step.duals, inverses, strict=True)
            )
            return centring * mean, second_order, step.slack * step.weight, step

        zero, nothing = jnp.zeros(()), jax.tree.map(jnp.zeros_like, grams)
        unset = _Step(zero, zero, jnp.zeros_like(moments), zero, nothing, nothing, zero, zero)
        *_, step = jax.lax.fori_loop(0, 2, predict_and_correct, (zero, nothing, zero, unset))
        least, most = TO_THE_EDGE
        edge = least + (most - least) * jnp.minimum(1.0, jnp.minimum(step.primal, step.dual))
        primal, dual = (jnp.minimum(1.0, edge * room) for room in (step.primal, step.dual))
        margin, slack = margin + primal * step.margin, slack + primal * step.slack
        moments, weight = moments + dual * step.moments, weight + dual * step.weight
        grams = tuple(_symmetric(q + primal * d) for q, d in zip(grams, step.grams, strict=True))
        duals = tuple(_symmetric(s + dual * d) for s, d in zip(duals, step.duals, strict=True))
        value = margin - PENALTY * _inner(grams, ones)
        distance = jnp.abs(target @ moments + cap * weight - value)
        gap = jnp.maximum(distance, _inner(grams, duals) + slack * weight)
        error = jnp.abs(identity_error(margin, grams)).max()
        steps = state.steps + 1
        new = State(margin, slack, moments, weight, grams, duals, steps, gap, error, gap < TOLERANCE)
        is_finite = jnp.isfinite(gap) & jnp.isfinite(error)
        kept = jax.tree.map(lambda after, before: jnp.where(is_finite, after, before), new, state)
        return kept._replace(steps=steps, is_done=kept.is_done | ~is_finite)

    even = jnp.full(count, 1 / count)
    start = State(
        margin=jnp.zeros(()),
        slack=jnp.ones(()),
        moments=even / jnp.maximum(drop @ even, 1e-3),
        weight=jnp.full((), 0.1),
        grams=tuple(0.1 * one for one in ones),
        duals=ones,
        steps=jnp.zeros((), int),
        gap=jnp.full((), jnp.inf),
        error=jnp.full((), jnp.inf),
        is_done=jnp.zeros((), bool),
    )
    return jax.lax.while_loop(lambda state: ~state.is_done & (state.steps < MOST_STEPS), improved, start)


def solve_many(bases: Bases, *stacked: Any) -> State:
    """Programs of one shape in lockstep: what `solve_one` is given, everything but the bases along an axis more."""
    return jax.vmap(solve_one, in_axes=(None, 0, 0, 0, 0))(bases, *stacked)
