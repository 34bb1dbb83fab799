"""Sums of squares through CVXPY and Clarabel, coefficient by coefficient: the reference, one program after another."""

import threading
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from cfcheck.kernel.program import Exponents, monomials
from cfjax.solver.cost import available_memory, cost_of
from cfjax.solver.program import AT_CAP, CAP, NOT_FINITE, Program, Shape, Solution, Status, rows


GB = 1e9
_CVXPY = threading.Lock()  # it numbers its variables by a counter that threads may not share


class Clarabel:
    """`workers` programs side by side."""

    name = "clarabel"

    def __init__(self, workers: int = 1) -> None:
        self.workers = workers

    def prepare(self, shape: Shape) -> None:
        """Nothing: each program is canonicalised by itself."""

    def solve(self, programs: Sequence[Program]) -> list[Solution]:
        """A solution for each program."""
        with ThreadPoolExecutor(self.workers) as pool:
            return list(pool.map(_solve, programs))


def product_matrix(
    factor: dict[Exponents, float], basis: tuple[Exponents, ...], places: dict[Exponents, int]
) -> sp.csr_matrix:
    """The matrix A with A vec(Q) = coefficients of factor · zᵀ Q z; rows in the order of `places`."""
    size = len(basis)
    at, column, value = [], [], []
    for i, first in enumerate(basis):
        for j, second in enumerate(basis):
            for shift, weight in factor.items():
                at.append(places[tuple(a + b + c for a, b, c in zip(first, second, shift, strict=True))])
                column.append(i + size * j)
                value.append(weight)
    return sp.csr_matrix((value, (at, column)), shape=(len(places), size * size))


class Scaled(NamedTuple):
    """A program coefficient by coefficient: target − λ drop = Σ products @ vec(Q), columns of Q one after another.

    All are scaled to a largest number of 1: λ by unit/fall, Q_k by unit/scales[k].
    """

    target: Float[np.ndarray, " r"]
    drop: Float[np.ndarray, " r"]
    products: list[sp.csr_matrix]
    sizes: list[int]  # rows of each Q
    unit: float
    fall: float
    scales: list[float]
    cap: float


def scaled_program(program: Program) -> Scaled:
    """As a general solver for semidefinite programs takes it."""
    places = rows(program.variables, 2 * max(program.degrees))
    names = list(places)
    vectors = [np.eye(1, len(places))[0], *program.constraints]  # of the free square's factor, 1
    scales = [float(np.abs(vector).max()) or 1.0 for vector in vectors]
    factors = [
        {names[k]: vector[k] / scale for k in np.flatnonzero(vector)}
        for vector, scale in zip(vectors, scales, strict=True)
    ]
    unit = float(np.abs(program.target).max()) or 1.0
    fall = float(np.abs(program.drop).max()) or 1.0
    bases = [monomials(program.variables, degree) for degree in program.degrees]
    products = [product_matrix(factor, basis, places) for factor, basis in zip(factors, bases, strict=True)]
    cap = CAP if program.cap is None else program.cap * fall / unit
    sizes = list(map(len, bases))
    return Scaled(program.target / unit, program.drop / fall, products, sizes, unit, fall, scales, cap)


def _solve(program: Program) -> Solution:
    started = time.perf_counter()
    if not program.is_finite:
        return Solution.failed(Clarabel.name, NOT_FINITE)
    needed, free = cost_of(Clarabel.name, program.variables, program.degrees).memory, available_memory()
    if needed > free:  # as the reference it is tried whatever the size is
        message = f"it takes about {needed / GB:.2g} GB of memory, of which {free / GB:.2g} are free"
        return Solution.failed(Clarabel.name, message)
    scaled = scaled_program(program)
    unit, fall, scales, cap = scaled.unit, scaled.fall, scaled.scales, scaled.cap
    with _CVXPY:
        margin = cp.Variable()
        grams = [cp.Variable((size, size), PSD=True) for size in scaled.sizes]
        total = scaled.drop * margin
        for matrix, gram in zip(scaled.products, grams, strict=True):
            total = total + matrix @ cp.vec(gram, order="F")
        identity = total == scaled.target
        problem = cp.Problem(cp.Maximize(margin), [identity, margin <= cap])
        data, chain, inverse = problem.get_problem_data(cp.CLARABEL, solver_opts={})
        assert chain is not None
    try:
        answer = chain.solve_via_data(problem, data)  # Clarabel alone: other threads go on
        with _CVXPY, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # "may be inaccurate": the status says so
            problem.unpack_results(answer, chain, inverse)
    except cp.SolverError as error:
        return Solution.failed(Clarabel.name, str(error), time.perf_counter() - started)
    values = [gram.value for gram in grams if gram.value is not None]
    known = {"optimal": Status.OPTIMAL, "optimal_inaccurate": Status.INACCURATE}
    if margin.value is None or len(values) < len(grams) or problem.status not in known:
        return Solution.failed(Clarabel.name, str(problem.status), time.perf_counter() - started)
    return Solution(
        known[problem.status],
        float(margin.value) * unit / fall,
        tuple(0.5 * (gram + gram.T) * unit / scale for gram, scale in zip(values, scales, strict=True)),
        time.perf_counter() - started,
        Clarabel.name,
        _second_moments(identity.dual_value, program) if margin.value < AT_CAP * cap else None,
    )


def _second_moments(dual: Float[np.ndarray, " rows"] | None, program: Program) -> Float[np.ndarray, "v v"] | None:
    """E[y yᵀ] under the measure that the dual solution stands for: it lives on the points that limit λ."""
    places = rows(program.variables, 2 * max(program.degrees))
    if dual is None or not abs(mass := dual[places[(0,) * program.variables]]) > 0:
        return None
    units = np.eye(program.variables, dtype=int)
    return np.array([[dual[places[tuple(int(k) for k in a + b)]] / mass for b in units] for a in units])
