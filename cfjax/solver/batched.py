"""Many sums-of-squares programs at once: each posed by values at points, solved, and put back into monomials.

Blocks of one degree are stacked, and a redundant block (g = 1, a square that Q₀ could hold as well) fills a stack up to
one of few sizes: programs of nearly equal shapes share a compiled program.
"""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from cfjax.solver.interior_point import Bases, State, identity_side, solve_many, solve_one
from cfjax.solver.points import Space, space
from cfjax.solver.program import AT_CAP, CAP, NOT_FINITE, Program, Shape, Solution, Status
from cfjax.traced import traced


ACCURATE = 1e-4  # gap and error up to which a solution is called optimal
WORTHLESS = 1.0  # gap or error of the size of the target itself
STACKS = (1, 2, 3, 5, 8, 12)  # blocks of one degree, filled up to one of these
SECOND_STACK = 2  # at least, below the largest degree: bounds of V̇ (one block there) and of V̈ (two) are one program
LANES = {"cpu": 1}  # programs that are solved in lockstep; on a CPU one by one is faster, cores work side by side
LANES_ELSEWHERE = 64

# threads for products this small only wait for each other, and XLA's older emitters compile them in half the time
_OPTIONS = ("xla_cpu_multi_thread_eigen", False), ("xla_cpu_use_fusion_emitters", False)
_solve_one = traced(solve_one, options=_OPTIONS)
_solve_many = traced(solve_many)


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
    least = [1, *[SECOND_STACK] * (len(blocks) - 1)]
    sizes = tuple(
        next((size for size in STACKS if size >= max(len(each), few)), len(each))
        for each, few in zip(blocks, least, strict=True)
    )
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


def _restored(layout: _Layout, posed: _Posed, state: State) -> tuple[Any, ...]:
    """The Gram matrices with the least change of Q₀ (Frobenius norm) that makes the identity hold at the points."""
    bases = [np.asarray(basis) for basis in layout.bases]
    sides = map(identity_side, bases, posed.factors, state.grams)
    missing = posed.target - state.margin * posed.drop - sum(sides, np.zeros(len(posed.target)))
    weights = scipy.linalg.cho_solve(layout.squares, missing)
    first, *others = state.grams
    restored = np.array(first)
    restored[0] += (bases[0].T * weights) @ bases[0]
    return (restored, *others)


def _answered(
    layout: _Layout, program: Program, posed: _Posed, scales: _Scales, state: State, seconds: float
) -> Solution:
    """The iterate in the program's own numbers."""
    unit = scales.target / scales.drop
    if not max(state.gap, state.error) < WORTHLESS:
        return Solution.failed(Batched.name, f"gap {float(state.gap):.1g}", seconds)
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
        Batched.name,
        second if second is None or np.isfinite(second).all() else None,
        "" if is_good else f"gap {float(state.gap):.1g}",
    )


class Batched:
    """The batched solver, in JAX and double precision; `workers` programs side by side on a CPU."""

    name = "batched"

    def __init__(self, workers: int = 1) -> None:
        if not jax.config.read("jax_enable_x64"):
            raise RuntimeError("the batched solver needs double precision: jax_enable_x64 is off")
        self.workers = workers

    def solve(self, programs: Sequence[Program]) -> list[Solution]:
        """A solution for each program; those of one shape are solved together."""
        with _single_threaded():
            return self._solved(programs)

    def prepare(self, shape: Shape) -> None:
        """Compile for programs of this shape, once: whoever solves one meanwhile waits for it."""
        with _single_threaded():
            layout, lanes = _layout(*shape), _lanes()
        count = len(layout.space.values)
        stacks = tuple(np.zeros((size, count)) for size in layout.sizes)
        empty = _Posed(stacks, np.zeros(count), np.zeros(count), np.zeros(()))
        if lanes == 1:
            _solve_one.prepare(layout.bases, *empty)
        else:
            _solve_many.prepare(layout.bases, *jax.tree.map(lambda each: np.stack([each] * lanes), empty))

    def _solved(self, programs: Sequence[Program]) -> list[Solution]:
        found: dict[int, Solution] = {}
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
        lanes = _lanes()
        if lanes == 1:
            with ThreadPoolExecutor(self.workers) as pool:
                return list(pool.map(partial(_alone, layout), programs))
        chunks = [programs[begin : begin + lanes] for begin in range(0, len(programs), lanes)]
        return [solution for chunk in chunks for solution in _together(layout, chunk, lanes)]


def _single_threaded() -> threadpool_limits:
    """Threads of LAPACK for matrices this small only wait for each other."""
    return threadpool_limits(1, user_api="blas")


def _lanes() -> int:
    return LANES.get(jax.default_backend(), LANES_ELSEWHERE)


def _alone(layout: _Layout, program: Program) -> Solution:
    started = time.perf_counter()
    posed, scales = _posed(layout, program)
    state = jax.device_get(_solve_one(layout.bases, *posed))
    return _answered(layout, program, posed, scales, state, time.perf_counter() - started)


def _together(layout: _Layout, programs: Sequence[Program], lanes: int) -> list[Solution]:
    """In lockstep, the last one repeated until the lanes are full."""
    started = time.perf_counter()
    posed, scales = zip(*(_posed(layout, program) for program in programs), strict=True)
    full = [*posed, *[posed[-1]] * (lanes - len(posed))]
    stacked = jax.tree.map(lambda *each: np.stack(each), *full)
    states = jax.device_get(_solve_many(layout.bases, *stacked))
    seconds = (time.perf_counter() - started) / len(programs)
    return [
        _answered(layout, program, values, own, jax.tree.map(lambda each, k=k: each[k], states), seconds)
        for k, (program, values, own) in enumerate(zip(programs, posed, scales, strict=True))
    ]
