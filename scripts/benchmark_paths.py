"""How learning and proving grow with a path's length: a table and a picture, no test.

    .venv/bin/python scripts/benchmark_paths.py [--segments 1 2 4 8 16] [--picture FILE]
    .venv/bin/python scripts/benchmark_paths.py --laps 2 7 24

A chain of 2 m segments, each with a bend of its own (curvature up to 0.8 1/m in turns to the left and to the right, no
two alike), so that nothing is proven once for several of them; path following at 1 m/s from a ball of 0.3 to a ball of
0.5. Beside it the same number of equal segments, and the path held by tubes. One run of each, one after the other.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table


os.environ.setdefault("JAX_PLATFORMS", "cpu")

from cfjax import Options, Problem, Result, ball
from cfjax.problem import KinematicBicycle, Pose, Profile, Segment, waypoints
from cfjax.problem import Path as Course
from cfjax.report.page import save_page
from cfjax.report.plot import save_picture
from cfjax.report.run_folder import write_run
from cfjax.report.style import STYLE
from cfjax.rounded import margin_text
from cfjax.synthesis import drive, search


LENGTH, SPEED = 2.0, 1.0  # m of a segment, m/s


def chain(count: int, alike: bool) -> Course:
    """Bends of turning rate k t² (T − t)² 16/T⁴, so that curvature and its slope are zero where segments meet."""
    duration = LENGTH / SPEED
    segments, pose = [], Pose(0.0, 0.0, 0.0)
    for index in range(count):
        peak = 0.6 if alike else (-1.0) ** index * (0.4 + 0.4 * ((0.618 * (index + 1)) % 1.0))
        scale = 16 * peak / duration**4
        bend = Profile((0.0, duration), ((0.0, 0.0, scale * duration**2, -2 * scale * duration, scale),))
        segments.append(Segment(bend, Profile.constant(SPEED, duration), pose))
        pose = Pose(*map(float, segments[-1].poses(np.array([duration]))[0]))
    return Course("bends", tuple(segments))


def run(path: Course, way: str) -> tuple[Result, float]:
    begin = time.perf_counter()
    result = search(Problem(path, inlet=ball(0.3), goal=ball(0.5)), Options(certificate=way))
    return result, time.perf_counter() - begin


def lap(length: float, seed: int = 0) -> np.ndarray:
    """Points (n, 2) of a closed track, m: a circle with waves in its radius, the longer the shorter they are."""
    rng, phi = np.random.default_rng(seed), np.linspace(0.0, 2 * np.pi, 200_000)
    wave = np.arange(2, max(4, int(length / 500)))
    size = rng.uniform(0.3, 1.0, len(wave)) / np.sqrt(len(wave)) * np.minimum(0.15, 0.0025 * length / wave**2)
    phase = rng.uniform(0.0, 2 * np.pi, len(wave))

    def place(angle: np.ndarray) -> np.ndarray:
        return (1 + np.cos(np.outer(angle, wave) + phase) @ size) * np.exp(1j * angle)

    around = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(place(phi))))])
    count = round(length / 5)
    found = length / around[-1] * place(np.interp(np.arange(count) / count * around[-1], around, phi))
    return np.round(np.stack([found.real, found.imag], axis=1), 3)


def laps(kilometres: list[float]) -> None:
    """Processor time of each stage, and of a kilometre."""
    vehicle = KinematicBicycle(wheelbase=2.7, max_tan_steering=0.5463)
    options = Options(cars=50, robustness=False)
    table = Table("km", "segments", "pieces", "verdict", "path", "problem", "search", "cars", "folder", "all", "a km")
    for length in kilometres:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "lap.csv"
            np.savetxt(file, lap(1000 * length), delimiter=",", header="x,y", fmt="%.3f")
            times = [time.process_time()]
            path = waypoints(file, closed=True, speed=20.0, vehicle=vehicle)
            times.append(time.process_time())
            problem = Problem(path, vehicle=vehicle)
            times.append(time.process_time())
            result = search(problem, options)
            times.append(time.process_time())
            result = drive(result, options)
            times.append(time.process_time())
            write_run(result, Path(folder) / "run", "", save_picture, page=save_page)
            times.append(time.process_time())
        pieces = sum(len(segment.turn_rate.coefficients) for segment in path.curve)
        spent = [*np.diff(times), times[-1] - times[0], (times[-1] - times[0]) / length]
        row = (f"{length:g}", str(len(path.curve)), str(pieces), result.verdict.value)
        table.add_row(*row, *(f"{seconds:.1f} s" for seconds in spent))
    Console(width=120).print(table)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--segments", type=int, nargs="+", default=[1, 2, 4, 8, 16])
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--laps", type=float, nargs="+")
    arguments = parser.parse_args()
    if arguments.laps:
        laps(arguments.laps)
        return 0
    run(chain(1, True), "segment")  # compiles, and loads what is loaded once
    console = Console(width=100)
    table = Table("segments", "way", "verdict", "margin", "stretches", "learn", "certify", "total", box=None)
    curves: dict[str, list[tuple[int, float]]] = {}
    for count in arguments.segments:
        for name, alike, way in (
            ("all different", False, "segment"),
            ("all alike", True, "segment"),
            ("tube", False, "tube"),
        ):
            result, total = run(chain(count, alike), way)
            stretches = sum(len(segment.stretches) for segment in result.segments)
            margin = result.margin_certified
            times = [result.seconds.get(stage, 0.0) for stage in ("learn", "certify")]
            table.add_row(
                str(count),
                name,
                result.verdict.value,
                f"{margin_text(margin)} 1/s",
                str(stretches or "–"),
                *(f"{seconds:.1f} s" for seconds in (*times, total)),
            )
            curves.setdefault(f"{name}: certify", []).append((count, times[1]))
            curves.setdefault(f"{name}: total", []).append((count, total))
            console.print(f"{count} {name}: {total:.1f} s")
    console.print(table)
    if arguments.picture:
        draw(curves, arguments.picture)
    return 0


def draw(curves: dict[str, list[tuple[int, float]]], picture: Path) -> None:
    """Total and proof of each way, with a line of slope one beside them."""
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullLocator, ScalarFormatter

    plt.rcParams.update(STYLE)
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for index, way in enumerate(dict.fromkeys(name.split(":")[0] for name in curves)):
        for stage, line in (("total", "o-"), ("certify", "o--")):
            count, seconds = zip(*curves[f"{way}: {stage}"], strict=True)
            if max(seconds) > 0.5:
                axes.loglog(count, seconds, line, color=f"C{index}", label=f"{way}: {stage}")
    (first, seconds), *_, (last, _) = next(iter(curves.values()))
    axes.loglog([first, last], [seconds, seconds * last / first], ":", color="0.5", label="linear")
    axes.set(xlabel="segments of 2 m", ylabel="wall time, s", title="Learning and proving a chain of segments")
    for axis, ticks in ((axes.xaxis, [1, 2, 4, 8, 16]), (axes.yaxis, [1, 10, 100, 1000])):
        axis.set_major_formatter(ScalarFormatter())
        axis.set_ticks(ticks)
        axis.set_minor_locator(NullLocator())
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", frameon=False)
    figure.savefig(picture, dpi=130)


if __name__ == "__main__":
    sys.exit(main())
