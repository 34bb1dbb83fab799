"""What a program costs a solver in memory and time, from the sizes of its matrices alone; and what memory there is.

Measured on one core of an AMD EPYC (JAX 0.10 on the CPU, CVXPY 1.9 with Clarabel 0.11) with one cell of a circle's
proof: CPU time once all is compiled, and resident memory beyond what was taken before.

    vehicle, order of the Gram matrices      points u  rows Σm    sum of t²   batched: s    MB   clarabel: s    MB
    omnidirectional, 3 states, 3                   84       68       56 400      0.02                 0.10       8
    kinematic bicycle, 4 states, 3                210      110      468 900      0.05                 1.02      36
    steered car, 5 states, 3                      462      161    2 814 021      0.18      10         4.84     225
    steered car with a lag, 6 states, 3           924      224   13 569 080      0.96     120        27.0      825
    car with a square root, 5 states, 4          1287      406   76 751 681      2.6      370      > 150      5200

A step of the batched method costs u² Σm, m the rows of the matrices, and it holds some dozens of u × u matrices.
Clarabel's cones have t = m (m + 1)/2 coordinates each, and it holds and factorises a dense t × t block of each.
"""

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import comb, inf
from pathlib import Path
from typing import NamedTuple


MOST_MEMORY = 1e9  # GB: no machine has so much


class Cost(NamedTuple):
    """Of one program: bytes, and seconds on one core."""

    memory: float
    seconds: float


def _batched(points: int, rows: Sequence[int]) -> Cost:
    return Cost(224.0 * points**2, 5e-9 * points**2 * sum(rows))


def _clarabel(points: int, rows: Sequence[int]) -> Cost:
    del points
    blocks = sum((m * (m + 1) // 2) ** 2 for m in rows)
    return Cost(80.0 * blocks, 2e-6 * blocks)


COSTS: dict[str, Callable[[int, Sequence[int]], Cost]] = {"batched": _batched, "clarabel": _clarabel}


def cost_of(solver: str, variables: int, degrees: Sequence[int]) -> Cost:
    """Of a program of this shape (`cfjax.solver.program`), by the solver of that name; one that was not measured counts
    as the reference.
    """
    rows = [comb(variables + degree, variables) for degree in degrees]
    return COSTS.get(solver, _clarabel)(comb(variables + 2 * max(degrees), variables), rows)


def available_memory() -> float:
    """Bytes that this process may still take: of the machine, and of the container it runs in; infinite if unknown."""
    room = inf
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text("ascii").splitlines()
        room = next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")), room)
    if room == inf and "SC_PHYS_PAGES" in getattr(os, "sysconf_names", {}):
        room = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    with suppress(OSError, ValueError):  # "max" where there is no limit
        limit, used = (int(Path(f"/sys/fs/cgroup/memory.{name}").read_text("ascii")) for name in ("max", "current"))
        room = min(room, float(limit - used))
    return room
