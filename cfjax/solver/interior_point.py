"""Many sums-of-squares programs by one interior-point method, posed by values at points.

With p_i the points of `cfjax.solver.points` and P_k the values of an orthonormal basis there, the identity of
`cfjax.solver.program` is one equation for each point, and its dual is small:

    maximise λ      t − λ δ = Σ_k A_k(Q_k),   λ + s = cap,   Q_k ⪰ 0,  s ≥ 0       A_k(Q)_i = g_k(p_i) P_k[i]ᵀ Q P_k[i]
    minimise t·y + cap w     δ·y + w = 1,   S_k = M_k(y) ⪰ 0,   w ≥ 0               M_k(y) = P_kᵀ diag(g_k y) P_k

(weighted sums of squares in an interpolant basis, Papp & Yıldız 2019). Both are feasible inside whatever the cell is:
on an empty one λ is the cap. Newton's steps are those of HKM (Helmberg et al. 1996) with Mehrotra's corrector: their
Schur complement is the elementwise product Σ_k (g_k g_kᵀ) ∘ (P_k Q_k P_kᵀ) ∘ (P_k S_k⁻¹ P_kᵀ), so that no equation is
larger than the number of points.

Blocks of one degree are stacked, and a redundant block (g = 1, a square that Q₀ could hold as well) fills a stack up to
one of few sizes: programs of nearly equal shapes share a compiled program.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Bool, Float, Int
from threadpoolctl import threadpool_limits

from cfjax.solver.points import Space, space
from cfjax.solver.program import AT_CAP, CAP, NOT_FINITE, Program, Solution, Status


TOLERANCE = 1e-6  # duality gap, of the target's largest value: below, the Schur complement loses its digits
ACCURATE = 1e-4  # gap and error up to which a solution is called optimal
WORTHLESS = 1.0  # gap or error of the size of the target itself
PENALTY = 1e-6  # on the traces of Gram matrices: short ones cost less in rounding; λ is short by some 1e-7
MOST_STEPS = 40
TO_THE_EDGE = 0.95  # of the way to the cone's boundary
STACKS = (1, 2, 3, 5, 8, 12)  # blocks of one degree, filled up to one of these
LANES = {"cpu": 1}  # programs that are solved in lockstep; on a CPU one by one is faster, cores work side by side
LANES_ELSEWHERE = 64
SMALLEST = 1e-300

Blocks = tuple[Float[Array, "_ _ _"], ...]  # (k, m, m): stacks by degree
Bases = tuple[Float[Array, "_ _"], ...]  # (u, m)
Factors = tuple[Float[Array, "_ _"], ...]  # (k, u)


class _State(NamedTuple):
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


def _identity_side(basis: Any, factors: Any, grams: Any) -> Any:
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
    tolerance: float | Float[Array, ""],
) -> _State:
    """The program with these values at the points; ends at the tolerance, or at the last iterate that is finite."""
    count = len(target)
    sizes = [(len(g), basis.shape[1]) for g, basis in zip(factors, bases, strict=True)]
    degree = 1 + sum(blocks * size for blocks, size in sizes)  # of the barrier
    ones = tuple(jnp.broadcast_to(jnp.eye(size), (blocks, size, size)) for blocks, size in sizes)

    def identity_error(margin: Array, grams: Blocks) -> Array:
        return target - margin * drop - sum(map(_identity_side, bases, factors, grams), jnp.zeros(count))

    def improved(state: _State) -> _State:
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
            still = cho_solve(cholesky, sum(map(_identity_side, bases, factors, wanted), -missing))
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
        primal, dual = (jnp.minimum(1.0, TO_THE_EDGE * room) for room in (step.primal, step.dual))
        margin, slack = margin + primal * step.margin, slack + primal * step.slack
        moments, weight = moments + dual * step.moments, weight + dual * step.weight
        grams = tuple(_symmetric(q + primal * d) for q, d in zip(grams, step.grams, strict=True))
        duals = tuple(_symmetric(s + dual * d) for s, d in zip(duals, step.duals, strict=True))
        value = margin - PENALTY * _inner(grams, ones)
        distance = jnp.abs(target @ moments + cap * weight - value)
        gap = jnp.maximum(distance, _inner(grams, duals) + slack * weight)
        error = jnp.abs(identity_error(margin, grams)).max()
        steps = state.steps + 1
        new = _State(margin, slack, moments, weight, grams, duals, steps, gap, error, gap < tolerance)
        is_finite = jnp.isfinite(gap) & jnp.isfinite(error)
        kept = jax.tree.map(lambda after, before: jnp.where(is_finite, after, before), new, state)
        return kept._replace(steps=steps, is_done=kept.is_done | ~is_finite)

    even = jnp.full(count, 1 / count)
    start = _State(
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


_solve_one = jax.jit(solve_one, compiler_options={"xla_cpu_multi_thread_eigen": False})
_solve_many = jax.jit(jax.vmap(solve_one, in_axes=(None, 0, 0, 0, 0, None)))


# --- programs in, solutions out


class _Layout(NamedTuple):
    """Which Gram matrices of a shape are stacked, by degree, the largest first."""

    space: Space
    blocks: tuple[tuple[int, ...], ...]  # numbers of the Gram matrices in each stack
    sizes: tuple[int, ...]  # of the stacks
    bases: Bases
    to_monomials: tuple[Float[np.ndarray, "m m"], ...]  # T with p = Tᵀ z
    squares: Any  # Cholesky factor of (P₀ P₀ᵀ) ∘ (P₀ P₀ᵀ)


@cache
def _layout(variables: int, degrees: tuple[int, ...]) -> _Layout:
    own = space(variables, 2 * max(degrees))
    different = sorted(set(degrees), reverse=True)
    blocks = tuple(tuple(k for k, degree in enumerate(degrees) if degree == each) for each in different)
    sizes = tuple(next((size for size in STACKS if size >= len(each)), len(each)) for each in blocks)
    bases, to_monomials = zip(*map(own.basis, different), strict=True)
    squares = scipy.linalg.cho_factor((bases[0] @ bases[0].T) ** 2)
    return _Layout(own, blocks, sizes, tuple(map(jnp.asarray, bases)), to_monomials, squares)


class _Posed(NamedTuple):
    """A program by values at the points, each scaled to at most 1."""

    factors: tuple[Float[np.ndarray, "k u"], ...]
    target: Float[np.ndarray, " u"]
    drop: Float[np.ndarray, " u"]
    cap: Float[np.ndarray, ""]


class _Scales(NamedTuple):
    target: float
    drop: float
    factors: Float[np.ndarray, " k"]  # of each Gram matrix


def _posed(layout: _Layout, program: Program) -> tuple[_Posed, _Scales]:
    values = layout.space.values
    rows = np.stack([program.target, program.drop]) @ values.T
    factors = np.vstack([np.ones(len(values)), program.constraints @ values.T])
    target, drop = (float(size) or 1.0 for size in np.abs(rows).max(axis=1))
    sizes = np.abs(factors).max(axis=1)
    scales = _Scales(target, drop, np.where(sizes > 0, sizes, 1.0))
    scaled = factors / scales.factors[:, None]
    stacks = tuple(
        np.concatenate([scaled[list(own)], np.ones((size - len(own), len(values)))])
        for own, size in zip(layout.blocks, layout.sizes, strict=True)
    )
    cap = CAP if program.cap is None else program.cap * drop / target
    return _Posed(stacks, rows[0] / target, rows[1] / drop, np.asarray(cap)), scales


def _restored(layout: _Layout, posed: _Posed, state: _State) -> tuple[Any, ...]:
    """The Gram matrices with the least change of Q₀ (Frobenius norm) that makes the identity hold at the points."""
    bases = [np.asarray(basis) for basis in layout.bases]
    sides = map(_identity_side, bases, posed.factors, state.grams)
    missing = posed.target - state.margin * posed.drop - sum(sides, np.zeros(len(posed.target)))
    weights = scipy.linalg.cho_solve(layout.squares, missing)
    first, *others = state.grams
    restored = np.array(first)
    restored[0] += (bases[0].T * weights) @ bases[0]
    return (restored, *others)


def _answered(
    layout: _Layout, program: Program, posed: _Posed, scales: _Scales, state: _State, seconds: float
) -> Solution:
    """The iterate in the program's own numbers."""
    unit = scales.target / scales.drop
    if not max(state.gap, state.error) < WORTHLESS:
        return Solution.failed(InteriorPoint.name, f"gap {float(state.gap):.1g}", seconds)
    grams: list[Any] = [None] * len(program.degrees)
    leading = np.zeros((0, 0))
    for own, stack, change in zip(layout.blocks, _restored(layout, posed, state), layout.to_monomials, strict=True):
        in_monomials = change @ np.asarray(stack) @ change.T
        for index, gram in zip(own, in_monomials, strict=False):
            grams[index] = gram / scales.factors[index]
        if not len(leading):
            leading = grams[own[0]]
        size = len(change)  # monomials are sorted by degree: those of a lower one come first
        leading[:size, :size] += in_monomials[len(own) :].sum(axis=0)
    second = None
    if state.margin < AT_CAP * posed.cap:  # else no point of the cell limits it
        moments = np.asarray(state.moments)
        second = layout.space.points.T @ (moments[:, None] * layout.space.points) / moments.sum()
    is_good = max(state.gap, state.error) < ACCURATE
    return Solution(
        Status.OPTIMAL if is_good else Status.INACCURATE,
        float(state.margin) * unit,
        tuple(0.5 * (gram + gram.T) * scales.target for gram in grams),
        seconds,
        InteriorPoint.name,
        second if second is None or np.isfinite(second).all() else None,
        "" if is_good else f"gap {float(state.gap):.1g}",
    )


class InteriorPoint:
    """The batched solver, in JAX and double precision; `workers` programs side by side on a CPU."""

    name = "batched"

    def __init__(self, workers: int = 1) -> None:
        self.workers = workers

    def solve(self, programs: Sequence[Program]) -> list[Solution]:
        """A solution for each program; those of one shape are solved together."""
        with threadpool_limits(
            1, user_api="blas"
        ):  # threads of LAPACK for matrices this small only wait for each other
            return self._solved(programs)

    def _solved(self, programs: Sequence[Program]) -> list[Solution]:
        found: dict[int, Solution] = {}
        assert jax.config.jax_enable_x64  # type: ignore[attr-defined]
        by_shape: dict[tuple, list[int]] = {}
        for index, program in enumerate(programs):
            if program.is_finite:
                by_shape.setdefault(program.shape, []).append(index)
            else:
                found[index] = Solution.failed(self.name, NOT_FINITE)
        for shape, members in by_shape.items():
            solutions = self._alike(_layout(*shape), [programs[index] for index in members])
            found |= dict(zip(members, solutions, strict=True))
        return [found[index] for index in range(len(programs))]

    def _alike(self, layout: _Layout, programs: list[Program]) -> list[Solution]:
        lanes = LANES.get(jax.default_backend(), LANES_ELSEWHERE)
        if lanes == 1:
            with ThreadPoolExecutor(self.workers) as pool:
                return list(pool.map(partial(_alone, layout), programs))
        chunks = [programs[begin : begin + lanes] for begin in range(0, len(programs), lanes)]
        return [solution for chunk in chunks for solution in _together(layout, chunk, lanes)]


def _alone(layout: _Layout, program: Program) -> Solution:
    started = time.perf_counter()
    posed, scales = _posed(layout, program)
    state = jax.device_get(_solve_one(layout.bases, *posed, TOLERANCE))
    return _answered(layout, program, posed, scales, state, time.perf_counter() - started)


def _together(layout: _Layout, programs: Sequence[Program], lanes: int) -> list[Solution]:
    """In lockstep, the last one repeated until the lanes are full."""
    started = time.perf_counter()
    posed, scales = zip(*(_posed(layout, program) for program in programs), strict=True)
    full = [*posed, *[posed[-1]] * (lanes - len(posed))]
    stacked = jax.tree.map(lambda *each: np.stack(each), *full)
    states = jax.device_get(_solve_many(layout.bases, *stacked, TOLERANCE))
    seconds = (time.perf_counter() - started) / len(programs)
    return [
        _answered(layout, program, values, own, jax.tree.map(lambda each, k=k: each[k], states), seconds)
        for k, (program, values, own) in enumerate(zip(programs, posed, scales, strict=True))
    ]
