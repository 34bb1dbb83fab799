"""Closed-loop steps per second, beside the same loop in NumPy and by SciPy, in one run: a table, no test.

    .venv/bin/python scripts/benchmark_simulation.py [FOLDER] [--runs 5] [--solved 3]

FOLDER is a certified run of the bicycle on a straight line or a circle at constant speed; without one the circle is
learned and certified first. One step is the min-norm law four times and
RK4 of the deviation and θ, in float64, all steps of one length. A car that has arrived counts no more steps, though
the arrays are stepped until the last one has. NumPy: law and step written out for this car, on arrays of all cars.
SciPy: `solve_ivp` (RK45), car by car, under NumPy's law, held to steps of the same length by its largest step; the
law is asked six times a step there. On the cores that there are. Medians of the runs, which take turns; compiling
apart. At the end the largest differences of cars' final deviations (rad, m, m, m/s) and times of arrival (s).
"""

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np


os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp

import cfjax
from cfjax.control import MinNorm
from cfjax.errors import InputError
from cfjax.funnel import Leg
from cfjax.options import Options
from cfjax.problem import KinematicBicycle, Problem
from cfjax.problem.course import profiles_of
from cfjax.report.run_folder import read_run
from cfjax.simulation.loop import CROSSING, RECORDED, RK4_NODES, RK4_WEIGHTS, sample_starts
from cfjax.simulation.rollout import Legs, drive, table_of
from cfjax.synthesis import search
from cfjax.traced import traced
from cfjax.verdict import Verdict


BATCHES = (1, 100, 10_000)
State = tuple[np.ndarray, ...]  # θ and the deviation: arrays of all cars


@dataclass(frozen=True)
class Scenario:
    """One steady leg, and what is measured along it."""

    problem: Problem
    leg: Leg
    vehicle: KinematicBicycle
    table: Legs

    @property
    def step(self) -> float:
        return float(self.table.loop.step[0])

    def limit(self) -> int:
        """Steps that the slowest timing takes."""
        return int(np.ceil(self.leg.end / self.step / self.problem.inputs[0].lower)) + 2

    def steps(self, clock: np.ndarray) -> int:
        """Steps that cars have made by these times of arrival, s; the last one of each is a part of a step."""
        return int(np.ceil(clock / self.step * (1 - 1e-9)).sum())


def scenario_of(folder: Path | None) -> Scenario:
    """Raises InputError for a run that is not certified, or of another kind of path or car."""
    if folder is None:
        result = search(Problem(cfjax.circle()), Options(cars=0))
    else:
        result = read_run(folder)
    if result.verdict is not Verdict.CERTIFIED:
        raise InputError(f"expected a certified run, this one is {result.verdict.value}")
    problem, vehicle = result.problem, result.problem.vehicle
    curve = problem.path.curve
    steady = len(curve) == 1 and curve[0].speed.is_constant and curve[0].turn_rate.is_constant
    if not (steady and len(result.legs) == 1 and not problem.obstacles and isinstance(vehicle, KinematicBicycle)):
        raise InputError("expected a run of the kinematic_bicycle on one straight line or circle, at constant speed")
    return Scenario(problem, result.legs[0], vehicle, table_of(problem, result.legs, profiles_of(problem.path)))


# --- the same in NumPy


def rate_of(scenario: Scenario) -> Callable[[State], State]:
    """d/dt of (θ, deviation) under the min-norm law: `cfjax.control` and the deviation dynamics, for this car."""
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf)[0], scenario.table.loop.numbers)
    point, shape, lower, upper = scenario.problem.path.curve[0].point(0.0), numbers.shape, numbers.lower, numbers.upper
    omega, speed, length = float(point.turn_rate), float(point.speed), scenario.vehicle.wheelbase
    k, paper = float(numbers.rate), scenario.leg.funnel.template.name == "paper"
    decrease = max(float(numbers.decrease), float(numbers.decrease_per_metre) * speed)
    centre = np.clip([1.0, omega * length / speed, 0.0], lower, upper)  # the reference's feed-forward
    half, inputs = 0.5 * (upper - lower), range(3)

    def law(theta: np.ndarray, q: np.ndarray, drift: np.ndarray, slopes: list[np.ndarray]) -> list[np.ndarray]:
        """The inputs, where V̇ = scale (drift + slopes · inputs) without the template's part."""
        level = 1 - k * theta if paper else np.exp(-k * theta)
        scale = np.ones_like(theta) if paper else np.exp(k * theta)
        demand = np.minimum(q / (level - (1 - numbers.beta_lower) / scale), 1.0)
        hardness = np.minimum(q / (level - (1 - numbers.beta_inner) / scale), 1.0)
        b = [scale * slope for slope in slopes]
        b[0] = b[0] + demand * scale * (k if paper else k * q)
        rate = scale * drift + sum(b[i] * centre[i] for i in inputs)
        excess = np.where(q > level, np.inf, rate + demand * decrease)
        softness = (1 - hardness) * decrease**2
        gain = [np.abs(b[i]) * half[i] for i in inputs]
        room = [
            np.where(b[i] > 0, centre[i] - lower[i], upper[i] - centre[i]) / half[i] if half[i] > 0 else 0.0 * b[i]
            for i in inputs
        ]
        breaks = [room[i] / np.where(gain[i] > 0, gain[i], 1.0) for i in inputs]
        saturated = [
            sum(gain[j] * np.minimum(breaks[i] * gain[j], room[j]) for j in inputs) + softness * breaks[i] < excess
            for i in inputs
        ]
        slope = sum(np.where(saturated[i], 0.0, gain[i] ** 2) for i in inputs) + softness
        left = excess - sum(np.where(saturated[i], gain[i] * room[i], 0.0) for i in inputs)
        multiplier = np.clip(left / np.where(slope > 0, slope, 1.0), 0.0, 1e300)
        moved = [np.where(saturated[i], room[i], np.minimum(multiplier * gain[i], room[i])) for i in inputs]
        return [
            np.clip(centre[i] - np.sign(b[i]) * np.where(excess > 0, moved[i], 0.0) * half[i], lower[i], upper[i])
            for i in inputs
        ]

    def rate(z: State) -> State:
        theta, alpha, across, along, faster = z
        v, c, s = faster + speed, np.cos(alpha), np.sin(alpha)
        g = [sum(shape[i, j] * z[1 + j] for j in range(4)) for i in range(4)]
        q = sum((g[i] * z[1 + i] for i in range(4)), np.zeros_like(theta))
        timing = np.full_like(theta, -omega), omega * along, -speed - omega * across  # what u0 adds to the pose's rates
        slopes = [2 * sum(g[i] * timing[i] for i in range(3)), 2 * g[0] * v / length, 2 * g[3]]
        u0, w, thrust = law(theta, q, 2 * v * (c * g[2] - s * g[1]), slopes)
        return u0, v / length * w + timing[0] * u0, timing[1] * u0 - s * v, timing[2] * u0 + c * v, thrust

    return rate


def by_numpy(scenario: Scenario, rate: Callable[[State], State], starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times of arrival (s) and final deviations."""
    h, end, count = scenario.step, scenario.leg.end, len(starts)
    z, clock = (np.zeros(count), *starts.T.copy()), np.zeros(count)
    while (z[0] < end).any():
        stages: list[State] = []
        slope: State = tuple(np.zeros(count) for _ in z)
        for node in RK4_NODES:
            slope = rate(tuple(a + node * h * b for a, b in zip(z, slope, strict=True)))
            stages.append(slope)
        # up to a share s of the step the mean slope is m0 + m1 s + m2 s²
        mean = [[sum(w * k[i] for w, k in zip(row, stages, strict=True)) for row in RK4_WEIGHTS] for i in range(len(z))]
        m0, m1, m2 = mean[0]
        after = z[0] + h * (m0 + m1 + m2)
        passes, goal = after >= end, np.minimum(end, after)
        share = (goal - z[0]) / (after - z[0])
        for _ in range(CROSSING):
            there = z[0] + h * share * (m0 + share * (m1 + share * m2))
            share = share - (there - goal) / (h * (m0 + share * (2 * m1 + 3 * share * m2)))
        share = np.where(passes, np.clip(share, 0.0, 1.0), 1.0)
        x = [a + h * share * (m[0] + share * (m[1] + share * m[2])) for a, m in zip(z[1:], mean[1:], strict=True)]
        z, clock = (np.where(passes, end, after), *x), clock + share * h
    return clock, np.stack(z[1:], axis=1)


@dataclass(frozen=True)
class Arrival:
    """The event that ends a drive, as SciPy takes it: θ at the end."""

    end: float
    terminal: ClassVar[bool] = True

    def __call__(self, _: float, z: np.ndarray) -> float:
        return z[0] - self.end


def by_scipy(
    scenario: Scenario, rate: Callable[[State], State], starts: np.ndarray
) -> tuple[int, np.ndarray, np.ndarray]:
    """Steps made, times of arrival (s) and final deviations."""

    steps, clock, last = 0, [], []
    for start in starts:
        found = solve_ivp(
            lambda _, z: np.concatenate(rate(tuple(z[:, None]))),
            (0.0, scenario.limit() * scenario.step),
            np.array([0.0, *start]),
            method="RK45",
            events=Arrival(scenario.leg.end),
            first_step=scenario.step,
            max_step=scenario.step,
            rtol=1.0,  # no step is refused: all are of the largest length
            atol=1.0,
        )
        steps += len(found.t) - 1
        clock.append(found.t[-1])
        last.append(found.y[1:, -1])
    return steps, np.array(clock), np.array(last)


# --- all in turn


def measure(scenario: Scenario, runs: int, solved: int) -> tuple[Table, list[str]]:
    """The table, and what the ways differ by."""
    problem = scenario.problem
    profiles, rate = profiles_of(problem.path), rate_of(scenario)
    starts = np.asarray(sample_starts(jax.random.key(0), problem.inlet, max(BATCHES)))
    starts = starts[np.random.default_rng(0).permutation(len(starts))]  # else the first half is of the boundary
    ends: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # times of arrival, final deviations

    def by_jax(batch: int) -> int:
        stride = max(1, batch // RECORDED)
        program = traced(drive, scenario.vehicle, scenario.leg.funnel.template, MinNorm(), scenario.limit() + 1, stride)
        driven, _ = jax.block_until_ready(program(scenario.table, profiles, None, starts[:batch], scenario.limit(), 1))
        clock = np.asarray(driven.cars.clock)
        ends[f"cfjax, {batch}"] = clock, np.stack(driven.cars.x, axis=1)
        return scenario.steps(clock)

    def in_numpy(batch: int) -> int:
        ends[f"NumPy, {batch}"] = found = by_numpy(scenario, rate, starts[:batch])
        return scenario.steps(found[0])

    def in_scipy() -> int:
        steps, clock, last = by_scipy(scenario, rate, starts[:solved])
        ends["SciPy"] = clock, last
        return steps

    ways: dict[str, Callable[[], int]] = {}
    for batch in BATCHES:
        ways[f"cfjax, {batch}"] = lambda batch=batch: by_jax(batch)
    for batch in BATCHES:
        ways[f"NumPy, {batch}"] = lambda batch=batch: in_numpy(batch)
    ways["SciPy"] = in_scipy
    compiling = {}
    for name in ways:
        if name.startswith("cfjax"):
            begin = time.perf_counter()
            ways[name]()
            compiling[name] = time.perf_counter() - begin
    speeds: dict[str, list[float]] = {name: [] for name in ways}
    counts: dict[str, int] = {}
    for run in range(runs):
        for name, way in ways.items():
            begin = time.perf_counter()
            counts[name] = way()
            speeds[name].append(counts[name] / (time.perf_counter() - begin))
        print(f"{run + 1} of {runs}", file=sys.stderr)
    return tabulated(scenario, speeds, counts, compiling), compared(ends)


def tabulated(
    scenario: Scenario, speeds: dict[str, list[float]], counts: dict[str, int], compiling: dict[str, float]
) -> Table:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    runs = len(speeds["SciPy"])
    title = f"{scenario.problem.path.name}, {1e3 * scenario.step:.3g} ms a step, {cores} cores, medians of {runs}"
    table = Table("", "steps", "steps a second", "slowest", "fastest", "of NumPy", "of SciPy", "compiling", title=title)
    table.box = None
    medians = {name: statistics.median(values) for name, values in speeds.items()}
    for name, values in speeds.items():
        batch = name.partition(", ")[2]
        ratios = [medians[name] / medians[peer] if peer in medians else None for peer in (f"NumPy, {batch}", "SciPy")]
        table.add_row(
            name,
            f"{counts[name]:,}",
            *(f"{value:,.0f}" for value in (medians[name], min(values), max(values))),
            *("" if ratio is None else f"{ratio:,.1f}" for ratio in ratios),
            f"{compiling[name]:.1f} s" if name in compiling else "",
        )
    return table


def compared(ends: dict[str, tuple[np.ndarray, np.ndarray]]) -> list[str]:
    """What the others' cars differ by from those of the largest batch."""
    clock, last = ends[f"cfjax, {max(BATCHES)}"]
    said = []
    for name, (own_clock, own_last) in ends.items():
        count = len(own_clock)
        apart = np.abs(own_last - last[:count]).max(), np.abs(own_clock - clock[:count]).max()
        said.append(f"{name}: final deviations within {apart[0]:.2g}, arrivals within {apart[1]:.2g} s")
    return [f"beside cfjax, {max(BATCHES)}:", *said]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", metavar="FOLDER", type=Path, nargs="?")
    parser.add_argument("--runs", type=int, default=5, help="runs of each kind (5)")
    parser.add_argument("--solved", type=int, default=3, help="cars for SciPy a run (3)")
    options = parser.parse_args(arguments)
    try:
        if min(options.runs, options.solved) < 1:
            raise InputError(f"--runs, --solved: expected at least 1, got {options.runs} and {options.solved}")
        scenario = scenario_of(options.folder)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    table, differences = measure(scenario, options.runs, options.solved)
    Console(width=120).print(table)
    print(*differences, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
