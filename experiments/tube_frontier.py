"""How narrow can a tube be? The proven margin against the lateral half-width, over curvature and speed, PF and TT.

    python experiments/tube_frontier.py [--output FOLDER] [--speeds 1 2 5] [--curvatures 0.5 1.8]

Each point is the largest margin found for tubes whose lateral half-width is at most the given one, exactly certified; I
is a ball of 0.1, G has half-axes of 1.5 rad, 0.6 m, 0.6 m and 1.5 m/s. Writes tube_frontier.csv, .md and .png.
Points that stand in the CSV already are not computed again.
"""

import argparse
import csv
import itertools
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from cfjax import Box, Ellipsoid, Method, Options, Problem, ball, synthesize, tube
from cfjax.report.lines import AT_LEAST, AT_MOST, markdown, write_lines
from cfjax.report.style import SERIES_COLOURS, STYLE


WIDTHS = (0.102, 0.108, 0.12, 0.14, 0.17, 0.22, 0.3)  # m
INLET = 0.1
GOAL = Ellipsoid((1.5, 0.6, 0.6, 1.5))
RESTARTS = 8  # close to I there are poor local optima
NO_LIMIT = 100.0


@dataclass(frozen=True)
class Point:
    method: str
    speed: float  # m/s
    curvature: float  # 1/m
    width: float  # m, the largest half-width allowed
    lateral: float | None = field(metadata=AT_MOST)  # m, that of the tube
    falsified: float | None = field(metadata=AT_LEAST)  # 1/s
    certified: float | None = field(metadata=AT_LEAST)


def measure(method: str, speed: float, curvature: float, width: float) -> Point:
    problem = Problem(
        tube(curvature, speed),
        inlet=ball(INLET),
        goal=GOAL,
        safe=Box((3.1, width, NO_LIMIT, NO_LIMIT)),
        method=Method(method),
    )
    result = synthesize(problem, Options(cars=0, rounds=1, restarts=RESTARTS))
    found = result.segments[0].funnel if result.segments else None
    return Point(
        method=method,
        speed=speed,
        curvature=curvature,
        width=width,
        lateral=float(found.half_widths()[1]) if found else None,
        falsified=result.margin_falsified,
        certified=result.margin_certified,
    )


def read(path: Path) -> list[Point]:
    if not path.exists():
        return []

    def number(text: str) -> float | None:
        return float(text) if text else None

    with path.open(newline="") as file:
        return [
            Point(
                row["method"],
                *(float(row[name]) for name in ("speed", "curvature", "width")),
                *(number(row[name]) for name in ("lateral", "falsified", "certified")),
            )
            for row in csv.DictReader(file)
        ]


def draw(points: list[Point], path: Path) -> None:
    """One panel per curvature: margin per metre of the way, on which path following does not depend on speed."""
    curvatures = sorted({point.curvature for point in points})
    speeds = sorted({point.speed for point in points})
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.3 * len(curvatures), 3.6), layout="constrained", dpi=160)
        panels = figure.subplots(1, len(curvatures), sharey=True, squeeze=False)[0]
        for axes, curvature in zip(panels, curvatures, strict=True):
            for (k, speed), (method, line) in itertools.product(enumerate(speeds), (("pf", "-o"), ("tt", "--s"))):
                chosen = [
                    point
                    for point in points
                    if (point.method, point.speed, point.curvature) == (method, speed, curvature) and point.certified
                ]
                axes.plot(
                    [(point.certified or 0.0) / speed for point in chosen],
                    [point.lateral for point in chosen],
                    line,
                    color=SERIES_COLOURS[k],
                    ms=3,
                    lw=1.0,
                    label=f"{method.upper()}, {speed:g} m/s",
                )
            axes.set(
                title=rf"$|\kappa| \leq {curvature:g}$ 1/m",
                xlabel=r"proven margin per metre, $\lambda / v_r$ (1/m)",
            )
        panels[0].set_ylabel("lateral half-width of the tube (m)")
        panels[-1].legend(fontsize=8)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Software": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/tube_frontier"))
    parser.add_argument("--speeds", type=float, nargs="+", default=[1.0, 2.0, 5.0])
    parser.add_argument("--curvatures", type=float, nargs="+", default=[0.5, 1.8])
    arguments = parser.parse_args()
    points = read(arguments.output / "tube_frontier.csv")
    done = {(point.method, point.speed, point.curvature, point.width) for point in points}
    for case in itertools.product(("pf", "tt"), arguments.speeds, arguments.curvatures, WIDTHS):
        if case not in done:
            points.append(measure(*case))
            write_lines(points, arguments.output, "tube_frontier")
            print(markdown(points[-1:]).splitlines()[-1], flush=True)
    draw(points, arguments.output / "tube_frontier.png")
    print(f"written to {arguments.output}")


if __name__ == "__main__":
    main()
