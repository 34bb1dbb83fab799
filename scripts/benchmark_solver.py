"""Sums-of-squares programs a second, by size of the stack and of the programs: a table and a picture, no test.

    .venv/bin/python scripts/benchmark_solver.py [--stacks 1 10 100] [--budget 60] [--picture FILE]

Random polynomials on the unit ball, cut by three random half-spaces: four, five and six variables, whose identity has
U = 70, 210, 462 or 924 coefficients. `batched` and `clarabel` are the solvers of the package. SDPA (through CVXPY, from
the package sdpa-python) and Drake with its Clarabel (drake) are tried where they are installed: they pose the same
program. A stack that would take longer than the budget (s), by the rate of the one before, is left out.
Programs are compiled before the clock starts. "wrong" counts margins that are off by more than 1e-4 of the target from
those of `clarabel`, and programs without an answer, among the first three.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np
from rich.console import Console
from rich.table import Table

from cfjax.check.program import monomials
from cfjax.solver import Program, solver_named
from cfjax.solver.clarabel import scaled_program
from cfjax.solver.program import dense


jax.config.update("jax_enable_x64", True)

SHAPES = {70: (4, 2), 210: (4, 3), 462: (5, 3), 924: (6, 3)}  # U: variables, degree of the largest Gram matrix
CUTS = 3
AGREE, COMPARED = 1e-4, 3
Solve = Callable[[Sequence[Program]], list[float]]  # margins, NaN where there is no answer


def programs_of(size: int, count: int) -> list[Program]:
    """Of U = `size` coefficients."""
    variables, degree = SHAPES[size]
    rng = np.random.default_rng(size)
    order = 2 * degree
    names, zero = monomials(variables, order), (0,) * variables
    first, second = ([tuple(k * (i == j) for j in range(variables)) for i in range(variables)] for k in (1, 2))
    ball = dense({zero: 1.0} | dict.fromkeys(second, -1.0), variables, order)
    drop = dense({zero: 1.0}, variables, order)
    found = []
    for _ in range(count):
        cuts = [
            dense(dict(zip(first, map(float, normal), strict=True)), variables, order)
            for normal in rng.normal(size=(CUTS, variables))
        ]
        target = rng.normal(size=len(names)) / np.sqrt(len(names))
        degrees = (degree, *[degree - 1] * (1 + CUTS))
        found.append(Program(variables, degrees, target, drop, np.array([ball, *cuts])))
    return found


def own(name: str) -> Solve:
    solver = solver_named(name, os.cpu_count() or 1)
    return lambda programs: [solution.margin for solution in solver.solve(programs)]


def sdpa() -> Solve:
    """Raises ImportError or CVXPY's SolverError where it is not installed."""
    import cvxpy as cp

    if "SDPA" not in cp.installed_solvers():
        raise ImportError("sdpa-python")

    def one(program: Program) -> float:
        scaled = scaled_program(program)
        margin = cp.Variable()
        grams = [cp.Variable((size, size), PSD=True) for size in scaled.sizes]
        total = scaled.drop * margin
        for matrix, gram in zip(scaled.products, grams, strict=True):
            total = total + matrix @ cp.vec(gram, order="F")
        problem = cp.Problem(cp.Maximize(margin), [total == scaled.target, margin <= scaled.cap])
        try:
            problem.solve(solver="SDPA")
        except cp.SolverError:
            return np.nan
        return np.nan if margin.value is None else float(margin.value) * scaled.unit / scaled.fall

    return lambda programs: [one(program) for program in programs]


def drake() -> Solve:
    """Raises ImportError where it is not installed."""
    from pydrake.solvers import ClarabelSolver, MathematicalProgram  # pyright: ignore[reportMissingImports]

    def one(program: Program) -> float:
        scaled = scaled_program(program)
        asked = MathematicalProgram()
        margin = asked.NewContinuousVariables(1)
        columns, variables = [scaled.drop[:, None]], [margin]
        for matrix, size in zip(scaled.products, scaled.sizes, strict=True):
            gram = asked.NewSymmetricContinuousVariables(size)
            asked.AddPositiveSemidefiniteConstraint(gram)
            lower, upper = np.tril_indices(size)
            whole = matrix.toarray().reshape(-1, size, size)
            both = whole[:, lower, upper] + np.where(lower == upper, 0.0, whole[:, upper, lower])
            columns.append(both)
            variables.append(gram[lower, upper])
        asked.AddLinearEqualityConstraint(np.hstack(columns), scaled.target, np.concatenate(variables))
        asked.AddBoundingBoxConstraint(-np.inf, scaled.cap, margin)
        asked.AddLinearCost(np.array([-1.0]), margin)
        found = ClarabelSolver().Solve(asked)
        return float(found.GetSolution(margin)[0]) * scaled.unit / scaled.fall if found.is_success() else np.nan

    return lambda programs: [one(program) for program in programs]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stacks", type=int, nargs="+", default=[1, 10, 100, 1000, 10_000], help="programs at a time")
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SHAPES), choices=SHAPES, help="U")
    parser.add_argument("--budget", type=float, default=60.0, help="s, the most for a stack (60)")
    parser.add_argument("--picture", type=Path, help="a file for the picture")
    arguments = parser.parse_args()
    if min(arguments.stacks) < 1 or not arguments.budget > 0:
        parser.error("expected stacks of 1 or more and a budget above 0 s")
    solvers: dict[str, Solve] = {}
    makers = {"batched": lambda: own("batched"), "clarabel": lambda: own("clarabel"), "SDPA": sdpa, "Drake": drake}
    for name, make in makers.items():
        try:
            solvers[name] = make()
        except ImportError as error:
            print(f"{name} is left out: {error}", file=sys.stderr)
    stacks = sorted(set(arguments.stacks))
    table = Table("U", "solver", *map(str, stacks), "wrong", title="programs a second", box=None)
    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    for size in arguments.sizes:
        programs = programs_of(size, max(COMPARED, stacks[-1]))
        reference = np.array(solvers["clarabel"](programs[:COMPARED]))
        for name, solve in solvers.items():
            few = np.array(solve(programs[:COMPARED]))  # compiles, too
            scale = np.array([np.abs(program.target).max() for program in programs[:COMPARED]])
            wrong = int((~(np.abs(few - reference) <= AGREE * scale)).sum())
            rates: dict[int, float] = {}
            for stack in stacks:
                if rates and stack / rates[max(rates)] > arguments.budget:
                    break
                begin = time.perf_counter()
                solve(programs[:stack])
                rates[stack] = stack / (time.perf_counter() - begin)
                print(f"U = {size}, {name}: {stack} at {rates[stack]:.3g} a second", file=sys.stderr)
            cells = [f"{rates[stack]:.3g}" if stack in rates else "–" for stack in stacks]
            table.add_row(str(size), name, *cells, str(wrong))
            style = {"batched": "-", "clarabel": "--", "SDPA": ":", "Drake": "-."}[name]
            color = f"C{list(SHAPES).index(size)}"
            axes.loglog(
                list(rates), list(rates.values()), style, marker="o", ms=3, color=color, label=f"{name}, U={size}"
            )
    Console().print(table)
    if arguments.picture:
        axes.set(xlabel="programs in a stack", ylabel="programs a second")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="x-small", ncols=2)
        figure.savefig(arguments.picture, dpi=160)
    return 0


if __name__ == "__main__":
    sys.exit(main())
