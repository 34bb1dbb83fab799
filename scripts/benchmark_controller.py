"""How long a step of the exported controller takes, beside the law in JAX for a whole batch: a table, no test.

    .venv/bin/python scripts/benchmark_controller.py FOLDER [--runs 21] [--batch 100000]

FOLDER is a certified run. The C is compiled with -O2 and steps cars along the path, with random deviations inside the
funnel: state in, command out, look-up of the reference included. Medians over the runs, with the fastest and slowest.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np


os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
import jax.numpy as jnp

from cfjax.control import MinNorm, leg_numbers
from cfjax.errors import InputError
from cfjax.export import write_controller
from cfjax.export.compiled import compile_controller
from cfjax.problem import to_state
from cfjax.problem.course import point_at, poses_of, profiles_of
from cfjax.report.run_folder import read_run
from cfjax.result import Result


STEPS, ROUNDS = 4096, 50
MAIN = """
#include "cfjax_controller.h"
#include <stdio.h>
#include <time.h>
static double table[%(steps)d][CF_STATES + 2];
int main(int count, char **names)
{
    static cf_controller controller;
    double command[CF_COMMANDS], sum = 0.0;
    int run, round, i;
    FILE *file = count > 1 ? fopen(names[1], "rb") : 0;
    if (!file || fread(table, sizeof table, 1, file) != 1)
        return 1;
    fclose(file);
    for (run = 0; run < %(runs)d; run++) {
        clock_t begin = clock();
        for (round = 0; round < %(rounds)d; round++)
            for (i = 0; i < %(steps)d; i++) {
                controller.theta = table[i][0];
                controller.leg = (int)table[i][1];
                cf_step(&controller, table[i] + 2, 1e-3, command);
                sum += command[0];
            }
        printf("%%.17g\\n", (double)(clock() - begin) / CLOCKS_PER_SEC * 1e9 / %(steps)d / %(rounds)d);
    }
    return sum != sum;
}
"""


def places(result: Result, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """θ, increasing, the leg there, and random deviations with V of at most about 1."""
    rng = np.random.default_rng(0)
    ends = np.array([leg.end for leg in result.legs])
    theta = np.sort(rng.uniform(0, ends[-1], count))
    own = np.minimum(np.searchsorted(ends, theta, side="right"), len(ends) - 1)
    x = rng.normal(size=(count, result.problem.dimension))
    for i, leg in enumerate(result.legs):
        x[own == i] *= np.sqrt(leg.funnel.end_level / leg.funnel.form(x[own == i]))[:, None]
    return theta, own, x * rng.uniform(0, 1, count)[:, None]


def in_c(result: Result, runs: int) -> list[float]:
    """Nanoseconds a step, for each run."""
    problem = result.problem
    theta, own, x = places(result, STEPS)
    profiles, poses, at = profiles_of(problem.path), poses_of(problem.path, problem.side_slip), jnp.asarray(theta)
    point, pose = point_at(profiles, profiles.find(at), at), tuple(p for p, _ in poses.at(poses.find(at), at))
    states = [np.broadcast_to(np.asarray(s), STEPS) for s in to_state(problem.vehicle, tuple(x.T), pose, point)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_controller(result, folder)
        (folder / "clocked.c").write_text(MAIN % {"steps": STEPS, "rounds": ROUNDS, "runs": runs})
        program = compile_controller(folder, main=folder / "clocked.c")
        np.stack([theta, own, *states], axis=1).astype(float).tofile(folder / "states")
        done = subprocess.run([program, folder / "states"], capture_output=True, text=True, check=True)
    return [float(line) for line in done.stdout.split()]


def in_jax(result: Result, batch: int, runs: int) -> list[float]:
    """Nanoseconds for one of a batch in the first leg: the law alone, without the way from the inertial frame."""
    problem, leg = result.problem, result.legs[0]
    theta, _, x = places(result, batch)
    theta = theta * leg.end / result.legs[-1].end
    numbers = leg_numbers(problem, leg)
    profiles, vehicle, template = profiles_of(problem.path), problem.vehicle, leg.funnel.template

    @jax.jit
    def law(theta: jax.Array, x: tuple[jax.Array, ...]) -> tuple:
        point = point_at(profiles, profiles.find(theta), theta)
        return MinNorm()(vehicle, template, numbers, point, theta, x)

    arguments = jnp.asarray(theta), tuple(jnp.asarray(column) for column in x.T)
    jax.block_until_ready(law(*arguments))
    times = []
    for _ in range(runs):
        begin = time.perf_counter()
        jax.block_until_ready(law(*arguments))
        times.append((time.perf_counter() - begin) * 1e9 / batch)
    return times


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", metavar="FOLDER", type=Path)
    parser.add_argument("--runs", type=int, default=21)
    parser.add_argument("--batch", type=int, default=100_000)
    options = parser.parse_args()
    try:
        result = read_run(options.folder)
        rows = {
            "C, one step, state to command": in_c(result, options.runs),
            f"JAX, one of {options.batch}, the law alone": in_jax(result, options.batch, options.runs),
        }
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{'ns':36}{'median':>9}{'fastest':>9}{'slowest':>9}")
    for name, times in rows.items():
        print(f"{name:36}{statistics.median(times):9.1f}{min(times):9.1f}{max(times):9.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
