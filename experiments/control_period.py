"""How long inputs may be held: the proven control period, by share of the input range and by inner level of the shell.

    python experiments/control_period.py [--path circle] [--input-share 1 0.7 0.5 0.35 0.25] [--beta 0.9 0.8 0.7]
    python experiments/control_period.py --tubes
    python experiments/control_period.py --paths

Inputs that stay closer to what the reference needs change the rate of V less: a smaller share costs margin and buys
time. A shell that begins further inside leaves room for what V rises before the law looks again. Each line is a funnel,
learned and certified; beside the proven period stands the shortest one in which an adversary, who picks the state and
any input that a law may take, left the funnel (found, not proven). The folder gets `table.csv` and `period.png`.
With --tubes the lines are tubes, and the adversary also picks the path. With --paths they are paths that tubes hold, by
a law that asks for all curvatures of the path at once; the adversary goes through them in any order. Neither has a
picture.
"""

import argparse
import csv
import itertools
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import matplotlib.pyplot as plt
from rich.console import Console
from rich.table import Table

import cfjax
from cfcheck.replay import check_document, check_robustness
from cfjax.certificate import robustness_of
from cfjax.conf.build import options_of, preset, problem_of
from cfjax.control.law import LAW_SHARE
from cfjax.falsifier import first_escape
from cfjax.options import Options
from cfjax.problem import Box, Interval, Problem, ball, tube
from cfjax.report.style import SERIES_COLOURS, STYLE
from cfjax.rounded import rounded_down
from cfjax.synthesis import search
from cfjax.verdict import Verdict


AMOUNTS = ("period_ms", "escape_ms", "delay_ms", "disturbance_x", "disturbance_v")
COLUMNS = ("input_share", "beta_lower", "margin", *AMOUNTS)
TUBE_COLUMNS = ("speeds", "curvature", "acceleration", "inlet", "goal", *COLUMNS[1:])
PATH_COLUMNS = ("path", "tubes", "per_metre", *AMOUNTS)
PROVEN = ("per_metre", "margin", "period_ms", "delay_ms", "disturbance_x", "disturbance_v")
HORIZON = 8.0  # periods that the adversary looks ahead


class Bounds(NamedTuple):
    """Of a tube: speeds (m/s), largest curvature (1/m) and acceleration (m/s²), radii of I and G, and β̲."""

    lowest: float
    highest: float
    curvature: float
    acceleration: float
    inlet: float
    goal: float
    beta: float


TUBES = (
    Bounds(1.0, 1.0, 1.0, 0.0, 0.4, 0.6, 0.9),  # the defaults of +path=tube
    Bounds(1.0, 1.0, 1.0, 0.0, 0.4, 0.6, 0.8),
    Bounds(2.0, 2.0, 1.0, 0.0, 0.4, 0.6, 0.8),
    Bounds(1.0, 2.0, 1.0, 0.0, 0.4, 0.6, 0.8),
    Bounds(1.0, 2.0, 1.0, 0.5, 0.4, 0.6, 0.8),
    Bounds(1.0, 2.0, 1.0, 0.5, 0.15, 0.25, 0.8),
)


PATHS = ("slalom", "figure_eight", "oval", "waypoints")
TRACK = Path(__file__).parent / "track.csv"  # bends to both sides, closed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--path", default="circle", choices=("circle", "straight"))
    parser.add_argument("--input-share", type=float, nargs="+", default=[1.0, 0.7, 0.5, 0.35, 0.25])
    parser.add_argument("--beta", type=float, nargs="+", default=[0.9, 0.8, 0.7])
    parser.add_argument("--tubes", action="store_true", help="of tubes instead of a path")
    parser.add_argument("--paths", action="store_true", help="of paths that tubes hold")
    parser.add_argument("--output", type=Path, default=Path("outputs/control_period"))
    arguments = parser.parse_args()
    if arguments.tubes:
        jobs, columns, title = map(of_tube, TUBES), TUBE_COLUMNS, "tubes"
    elif arguments.paths:
        jobs, columns, title = map(in_tubes, PATHS), PATH_COLUMNS, "paths in tubes"
    else:
        jobs = product_of(arguments.path, arguments.input_share, arguments.beta)
        columns, title = COLUMNS, arguments.path
    rows = []
    for row in jobs:
        rows.append(row)
        print(", ".join(f"{name} {shown(name, value)}" for name, value in row.items()), file=sys.stderr, flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    with (arguments.output / "table.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    table = Table(*columns, title=f"{title}: proven control periods")
    for row in rows:
        table.add_row(*(shown(name, row[name]) for name in columns))
    Console(width=140).print(table)
    if columns is COLUMNS:
        draw(rows, arguments.output / "period.png")
    print(f"folder: {arguments.output}")
    return 0


def shown(name: str, value: float | str) -> str:
    """Three digits; what is proven is rounded down."""
    if isinstance(value, str):
        return value
    if value == math.inf:  # the adversary has not got out as far as it looked
        return f"> {HORIZON:g} periods"
    return rounded_down(value, 3) if name in PROVEN else f"{value:.3g}"


def product_of(path: str, shares: list[float], betas: list[float]) -> Iterator[dict[str, Any]]:
    for share, beta in itertools.product(shares, betas):
        problem = Problem(getattr(cfjax, path)(), safe=Box((1.0, 1.0, 1.0, 3.0)), input_share=share)
        yield {"input_share": share} | line(problem, beta)


def of_tube(bounds: Bounds) -> dict[str, Any]:
    path = tube(bounds.curvature, Interval(bounds.lowest, bounds.highest), bounds.acceleration)
    problem = Problem(path, inlet=ball(bounds.inlet), goal=ball(bounds.goal))
    speeds = f"{bounds.lowest:g} to {bounds.highest:g}"
    asked = {name: getattr(bounds, name) for name in ("curvature", "acceleration", "inlet", "goal")}
    return {"speeds": speeds} | asked | line(problem, bounds.beta)


def in_tubes(name: str) -> dict[str, Any]:
    """A path of the package held by one tube of its own, or a track by tubes that came with the package."""
    overrides = [f"path.file={TRACK}", "path.closed=true"] if name == "waypoints" else []
    config = preset(name, ["certificate=tube", "cars=0", *overrides])
    result = search(problem_of(config), options_of(config))
    nothing: dict[str, Any] = {"path": name} | dict.fromkeys(PATH_COLUMNS[1:], float("nan"))
    if result.verdict is not Verdict.CERTIFIED or result.document is None:
        return nothing
    proven = check_robustness(check_document(result.document), result.document, robustness_of(result)).robustness
    if proven is None:
        return nothing
    alone = proven.alone
    escapes = [
        first_escape(
            result.problem,
            found.along,
            found.funnel,
            LAW_SHARE * (found.margin_certified or 0.0),
            HORIZON * float(alone.period),
            decrease_per_metre=LAW_SHARE * (found.margin_per_metre or 0.0),
        )
        for found in result.segments
        if found.along
    ]
    return {
        "path": name,
        "tubes": str(len(result.document["tubes"])),
        "per_metre": min(found.margin_per_metre or 0.0 for found in result.segments),
        "period_ms": 1e3 * float(alone.period),
        "escape_ms": 1e3 * min(escapes),
        "delay_ms": 1e3 * float(alone.delay),
        "disturbance_x": float(alone.disturbance[1]),
        "disturbance_v": float(alone.disturbance[3]),
    }


def line(problem: Problem, beta: float) -> dict[str, float]:
    """One funnel's figures; periods in ms, margin in 1/s, disturbances in m/s and m/s²."""
    result = search(problem, Options(beta_lower=beta, cars=0))
    nothing = dict.fromkeys(COLUMNS[1:], float("nan")) | {"beta_lower": beta}
    if result.verdict is not Verdict.CERTIFIED or result.margin_certified is None or result.document is None:
        return nothing
    hints = robustness_of(result)
    proven = check_robustness(check_document(result.document), result.document, hints).robustness
    if proven is None:
        return nothing | {"margin": result.margin_certified}
    period, funnel = float(proven.alone.period), result.segments[0].funnel
    decrease = LAW_SHARE * result.margin_certified
    per_metre = LAW_SHARE * (result.segments[0].margin_per_metre or 0.0)
    segment = problem.path.segments[0]
    escape = first_escape(problem, segment, funnel, decrease, HORIZON * period, decrease_per_metre=per_metre)
    return {
        "beta_lower": beta,
        "margin": result.margin_certified,
        "period_ms": 1e3 * period,
        "escape_ms": 1e3 * escape,
        "delay_ms": 1e3 * float(proven.alone.delay),
        "disturbance_x": float(proven.alone.disturbance[1]),
        "disturbance_v": float(proven.alone.disturbance[3]),
    }


def draw(rows: list[dict[str, float]], path: Path) -> None:
    """Proven period and the adversary's over the margin: a line for each inner level."""
    matplotlib.use("Agg")
    plt.rcParams.update(STYLE)
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    for index, beta in enumerate(sorted({row["beta_lower"] for row in rows}, reverse=True)):
        own = sorted((row for row in rows if row["beta_lower"] == beta), key=lambda row: row["margin"])
        margins, colour = [row["margin"] for row in own], SERIES_COLOURS[index % len(SERIES_COLOURS)]
        axes.plot(margins, [row["period_ms"] for row in own], "o-", color=colour, label=f"shell from {beta:g}")
        axes.plot(margins, [row["escape_ms"] for row in own], "x", color=colour)
    axes.plot([], [], "x", color="0.4", label="shortest escape found")
    axes.set(xlabel="certified margin λ, 1/s", ylabel="control period, ms", ylim=(0, None))
    axes.legend()
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
