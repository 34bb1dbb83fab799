"""How learning and proving grow with a path's length: a table and a picture, no test.

    .venv/bin/python scripts/benchmark_paths.py [--segments 1 2 4 8 16] [--picture FILE]

A chain of 2 m segments, each with a bend of its own (curvature up to 0.8 1/m in turns to the left and to the right, no
two alike), so that nothing is proven once for several of them; path following at 1 m/s from a ball of 0.3 to a ball of
0.5. Beside it the same number of equal segments, and the path held by tubes. One run of each, one after the other.
"""

import argparse
import os
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table


os.environ.setdefault("JAX_PLATFORMS", "cpu")

from cfjax import Options, Problem, Result, ball
from cfjax.problem import Path as Course
from cfjax.problem import Pose, Profile, Segment
from cfjax.synthesis import search


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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--segments", type=int, nargs="+", default=[1, 2, 4, 8, 16])
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
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
                "–" if margin is None else f"{margin:.3f} 1/s",
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
