"""Sums-of-squares programs a second, by size of the stack and of the programs: a table and a picture, no test.

    .venv/bin/python scripts/benchmark_solver.py [--sizes 70 210] [--solvers clarabel batched] [--stacks 1 10 100]
        [--limit 120] [--table FILE] [--picture FILE]

Random polynomials on the unit ball, cut by three random half-spaces: four, five and six variables, whose identity has
U = 70, 210, 462 or 924 coefficients. `batched` and `clarabel` are the solvers of the package. SDPA (through CVXPY, from
the package sdpa-python) and Drake with its Clarabel (drake) are tried where they are installed: they pose the same
program.

Each row of the table is a process of its own, without output, and has `limit` s: a stack that would take longer than
is left, by the rate of the one before, is left out, and what runs then all the same is ended. A row is printed when it
is complete, and appended to the table's file. The picture shows all rows of that file, so that sizes may be measured
one by one. Programs are compiled before the clock of a stack starts. "wrong" counts margins that are off by more than
1e-4 of the target from those of `clarabel`, and programs without an answer, among the first three.
"""

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import jax
import matplotlib.pyplot as plt
import numpy as np

from cfcheck.kernel.program import monomials
from cfjax.report.style import STYLE
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
        posed = MathematicalProgram()
        margin = posed.NewContinuousVariables(1)
        columns, variables = [scaled.drop[:, None]], [margin]
        for matrix, size in zip(scaled.products, scaled.sizes, strict=True):
            gram = posed.NewSymmetricContinuousVariables(size)
            posed.AddPositiveSemidefiniteConstraint(gram)
            lower, upper = np.tril_indices(size)
            whole = matrix.toarray().reshape(-1, size, size)
            both = whole[:, lower, upper] + np.where(lower == upper, 0.0, whole[:, upper, lower])
            columns.append(both)
            variables.append(gram[lower, upper])
        posed.AddLinearEqualityConstraint(np.hstack(columns), scaled.target, np.concatenate(variables))
        posed.AddBoundingBoxConstraint(-np.inf, scaled.cap, margin)
        posed.AddLinearCost(np.array([-1.0]), margin)
        found = ClarabelSolver().Solve(posed)
        return float(found.GetSolution(margin)[0]) * scaled.unit / scaled.fall if found.is_success() else np.nan

    return lambda programs: [one(program) for program in programs]


SOLVERS: dict[str, Callable[[], Solve]] = {
    "clarabel": lambda: own("clarabel"),
    "batched": lambda: own("batched"),
    "SDPA": sdpa,
    "Drake": drake,
}
STYLES = {"batched": "-", "clarabel": "--", "SDPA": ":", "Drake": "-."}


def measure(name: str, size: int, stacks: Sequence[int], deadline: float, report: Connection) -> None:
    """Reports margins of the first programs (NaN: no answer), then pairs of a stack and its rate, then None."""
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    solve = SOLVERS[name]()
    report.send(solve(programs_of(size, COMPARED)))  # compiles, too
    rate = np.inf
    for stack in stacks:
        if time.time() + stack / rate > deadline:
            break
        programs = programs_of(size, stack)
        begin = time.perf_counter()
        solve(programs)
        rate = stack / (time.perf_counter() - begin)
        report.send((stack, rate))
    report.send(None)


class Row(NamedTuple):
    """Of one solver and one U: margins of the first programs, and programs a second by size of the stack."""

    margins: Sequence[float] | None
    rates: dict[int, float]


def row_of(name: str, size: int, stacks: Sequence[int], limit: float) -> Row:
    """What a process reports within so many seconds."""
    deadline = time.time() + limit
    processes = multiprocessing.get_context("spawn")
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = processes.Process(target=measure, args=(name, size, stacks, deadline, theirs), daemon=True)
    process.start()
    theirs.close()
    found = []
    with suppress(EOFError):  # it broke down
        while ours.poll(max(0.0, deadline - time.time())) and (answer := ours.recv()) is not None:
            found.append(answer)
    process.kill()
    process.join()
    return Row(found[0] if found else None, dict(found[1:]))


def wrong(margins: Sequence[float] | None, reference: Sequence[float] | None, size: int) -> str:
    """How many margins are off; "–" where there is nothing to compare."""
    if margins is None or reference is None:
        return "–"
    scale = np.array([np.abs(program.target).max() for program in programs_of(size, COMPARED)])
    return str(int((~(np.abs(np.subtract(margins, reference)) <= AGREE * scale)).sum()))


def cells(line: str) -> list[str]:
    """Of a line of the table."""
    return [cell.strip() for cell in line.strip("| ").split(" | ")]


def draw(lines: Sequence[str], picture: Path) -> None:
    """Programs a second over the stack's size, from the lines of a table: its head, a rule, and rows."""
    stacks = list(map(int, cells(lines[0])[2:-1]))
    plt.rcParams.update(STYLE)
    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    for line in lines[2:]:
        size, name, *rates, _ = cells(line)
        known = [float("nan" if rate == "–" else rate) for rate in rates]
        color, label = f"C{list(SHAPES).index(int(size))}", f"{name}, U = {size}"
        axes.loglog(stacks, known, STYLES[name], marker="o", ms=3, color=color, label=label)
    axes.set(xlabel="programs in a stack", ylabel="programs a second")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="x-small", ncols=2, handlelength=4)
    figure.savefig(picture, dpi=160)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stacks", type=int, nargs="+", default=[1, 10, 100, 1000, 10_000], help="programs at a time")
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SHAPES), choices=SHAPES, help="U")
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=SOLVERS, help="all unless given")
    parser.add_argument("--limit", type=float, default=120.0, help="s, the most for a row (120)")
    parser.add_argument("--table", type=Path, help="a file to which the rows are appended")
    parser.add_argument("--picture", type=Path, help="a file for the picture")
    arguments = parser.parse_args()
    if min(arguments.stacks) < 1 or not arguments.limit > 0:
        parser.error("expected stacks of 1 or more and a limit above 0 s")
    stacks = sorted(set(arguments.stacks))
    head = ["U", "solver", *map(str, stacks), "wrong"]
    lines = arguments.table.read_text().splitlines() if arguments.table and arguments.table.exists() else []
    if lines and cells(lines[0]) != head:
        parser.error(f"--table: expected a file with the columns {', '.join(head)}, got {', '.join(cells(lines[0]))}")

    def print_row(*row: str) -> None:
        line = f"| {' | '.join(row)} |"
        print(line, flush=True)
        if arguments.table:
            with arguments.table.open("a") as file:
                file.write(f"{line}\n")
        lines.append(line)

    if not lines:
        print_row(*head)
        print_row(*["---"] * len(head))
    for size in arguments.sizes:
        reference = None
        for name in arguments.solvers:
            row = row_of(name, size, stacks, arguments.limit)
            if row.margins is None:
                print(f"U = {size}, {name}: no answer within {arguments.limit:g} s, or not installed", file=sys.stderr)
                continue
            reference = row.margins if name == "clarabel" else reference
            rates = [f"{row.rates[stack]:.3g}" if stack in row.rates else "–" for stack in stacks]
            print_row(str(size), name, *rates, wrong(row.margins, reference, size))
    if arguments.picture:
        draw(lines, arguments.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
