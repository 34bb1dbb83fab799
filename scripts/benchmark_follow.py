"""How long `cfjax.follow` takes, and how it grows with the path: a table, no test.

    .venv/bin/python scripts/benchmark_follow.py [--pieces 25 50 100 200] [--paths 21]

Random paths of so many pieces (cubic turning rate, quadratic speed, inside the bounds of the library's tubes), with the
tubes that travel with the package: their own proofs are not replayed here. Medians over the paths; reading the
library and the first call, which prepares the pairs of tubes, stand apart.
"""

import argparse
import itertools
import os
import statistics
import sys
import time

import numpy as np
from rich.console import Console
from rich.table import Table


os.environ.setdefault("JAX_PLATFORMS", "cpu")

from cfjax.problem import Path, Pose, Profile, Segment
from cfjax.tubes import follow, library


def random_path(rng: np.random.Generator, pieces: int) -> Path:
    """Continuous turning rate and speed; curvature within 2 1/m, 1 to 3 m/s, accelerations below 1 m/s²."""
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.3, 1.0, pieces))])
    omega, speed, rate = [0.0], [2.0], []
    for k, length in enumerate(np.diff(breaks)):
        start = speed[-1]
        end = float(np.clip(start + rng.uniform(-0.4, 0.4) * length, 1.0, 3.0))
        bend = 0.2 * (end - start) / length**2
        rate.append((start, (end - start) / length - bend * length, bend))
        speed.append(end)
        omega.append(float(rng.uniform(-1.2, 1.2)) if k % 3 else 0.0)
    turning = []
    for (first, last), length in zip(itertools.pairwise(omega), np.diff(breaks), strict=True):
        turning.append((first, 0.0, 3 * (last - first) / length**2, -2 * (last - first) / length**3))
    at = tuple(float(value) for value in breaks)
    return Path("random", (Segment(Profile(at, tuple(turning)), Profile(at, tuple(rate)), Pose(0.0, 0.0, 0.0)),))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pieces", type=int, nargs="+", default=[25, 50, 100, 200])
    parser.add_argument("--paths", type=int, default=21)
    arguments = parser.parse_args()
    begin = time.perf_counter()
    tubes = library()
    loading = time.perf_counter() - begin
    rng = np.random.default_rng(0)
    begin = time.perf_counter()
    follow(random_path(rng, 10))
    first = time.perf_counter() - begin
    table = Table("pieces", "median", "slowest", "stretches", title=f"follow, {len(tubes)} tubes", box=None)
    for pieces in arguments.pieces:
        times, stretches = [], []
        for _ in range(arguments.paths):
            path = random_path(rng, pieces)
            begin = time.perf_counter()
            found = follow(path)
            times.append(1000 * (time.perf_counter() - begin))
            stretches.append(len(found.tubes))
        median, slowest = statistics.median(times), max(times)
        table.add_row(str(pieces), f"{median:.1f} ms", f"{slowest:.1f} ms", f"{statistics.median(stretches):g}")
    Console().print(table)
    print(f"reading the library {1000 * loading:.0f} ms, the first call {1000 * first:.0f} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())
