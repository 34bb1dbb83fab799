"""Demonstrations per second against CasADi's IPOPT and fatrop, on the same problems, in one run: a table, no test.

    .venv/bin/python scripts/benchmark_demonstrator.py [--path circle] [--runs 3] [--solved 100]

Deviations are drawn from S = [-1, 1]³ × [-3, 3]; 20 intervals of 0.1 s, every solver at its default tolerance, IPOPT
and fatrop on CasADi's SX expressions, one problem after another. Everything is pinned to one core, so solves per second
are those of a core. Medians of the runs, whose solvers take turns; compiling and building apart. The costs are compared
where both converge.
"""

import argparse
import os
import statistics
import sys
import time
from pathlib import Path


ROOT = Path(__file__).parents[1]
BATCHES = (1, 100, 10_000)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--path", default="circle", choices=("circle", "straight", "oval"))
    parser.add_argument("--runs", type=int, default=3, help="runs of each kind (3)")
    parser.add_argument("--solved", type=int, default=100, help="problems for IPOPT and fatrop a run (100)")
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # before any library starts its threads
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    sys.path.insert(0, str(ROOT))

    import jax
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    import cfjax
    from cfjax.demonstrator import demonstrate
    from cfjax.problem import Box, Problem
    from tests.demonstrator.by_casadi import solver_of

    problem = Problem(getattr(cfjax, arguments.path)(), safe=Box((1.0, 1.0, 1.0, 3.0)))
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (max(BATCHES), 4)) * np.array([1.0, 1.0, 1.0, 3.0])
    theta = rng.uniform(0, sum(s.duration for s in problem.path.curve), max(BATCHES))

    preparing: dict[str, float] = {}
    peers = {}
    for name in ("ipopt", "fatrop"):
        begin = time.perf_counter()
        peers[name] = solver_of(problem, name)
        preparing[name] = time.perf_counter() - begin
    for batch in BATCHES:
        begin = time.perf_counter()
        jax.block_until_ready(demonstrate(problem, x[:batch], theta[:batch]))
        preparing[f"cfjax, {batch}"] = time.perf_counter() - begin

    seconds: dict[str, list[float]] = {}  # per solve
    costs: dict[str, np.ndarray] = {}
    count = arguments.solved
    for run in range(arguments.runs):
        for name, solve in peers.items():
            begin = time.perf_counter()
            found = [solve(x[i], theta[i]) for i in range(count)]
            seconds.setdefault(name, []).append((time.perf_counter() - begin) / count)
            costs[name] = np.array([cost if success else np.nan for cost, _, success in found])
        for batch in BATCHES:
            begin, times = time.perf_counter(), 0
            while times == 0 or times * batch < count:
                some = slice(times * batch, (times + 1) * batch)
                got = jax.block_until_ready(demonstrate(problem, x[some], theta[some]))
                times += 1
                if batch == max(BATCHES):
                    costs["cfjax"] = np.where(got.converged, got.cost, np.nan)[:count]
            seconds.setdefault(f"cfjax, {batch}", []).append((time.perf_counter() - begin) / (times * batch))
        print(f"{run + 1} of {arguments.runs}", file=sys.stderr)

    medians = {name: statistics.median(values) for name, values in seconds.items()}
    title = f"{arguments.path}, one core, medians of {arguments.runs}"
    table = Table("", "a solve", "solves a second", "of IPOPT", "of fatrop", "compiling", title=title, box=None)
    for name, value in medians.items():
        ratios = (f"{medians[peer] / value:.1f}" for peer in peers)
        table.add_row(name, f"{1e3 * value:.3f} ms", f"{1 / value:.0f}", *ratios, f"{preparing[name]:.1f} s")
    Console().print(table)
    for name in peers:
        ratio = costs["cfjax"] / costs[name]
        ratio = ratio[np.isfinite(ratio)]
        print(
            f"costs beside {name}: {np.mean(np.abs(ratio - 1) <= 0.01):.1%} of {len(ratio)} within 1 %, largest ratio "
            f"{ratio.max():.4f}; converged: cfjax {np.mean(np.isfinite(costs['cfjax'])):.1%}, {name} "
            f"{np.mean(np.isfinite(costs[name])):.1%}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
