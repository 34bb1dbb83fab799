"""Tubes: one funnel for every path within bounds, proven; the trials' rows, the headline, and how far tracking goes.

    python experiments/tube_table.py [--output FOLDER] [--only TEXT] [--cars N]

Prints one table and writes it as tube_table.csv and tube_table.md. "Before" are the margins that were certified
numerically in the trials that preceded this implementation. Their tubes were wider than G in heading and speed, so each
of their rows stands here twice: with G as a ball in all four states, and with G asked of the position only.
"""

import argparse
import dataclasses
import math
from pathlib import Path

from cfjax import Ellipsoid, Interval, Method, Options, Problem, ball, synthesize, tube
from cfjax.report.lines import AT_LEAST, AT_MOST, markdown, write_lines


FREE = (3.0, 20.0)  # half-axes of G in heading and speed that ask for nothing


@dataclasses.dataclass(frozen=True)
class Case:
    row: str
    curvature: float  # 1/m
    speed: tuple[float, float]  # m/s
    acceleration: float  # m/s²
    inlet: float
    goal: float
    everywhere: bool  # G in all states, or in the position only
    method: str
    before: float | None  # 1/s

    def problem(self) -> Problem:
        heading, speed = (self.goal, self.goal) if self.everywhere else FREE
        return Problem(
            tube(self.curvature, Interval(*self.speed), self.acceleration),
            inlet=ball(self.inlet),
            goal=Ellipsoid((heading, self.goal, self.goal, speed)),
            method=Method(self.method),
        )


@dataclasses.dataclass(frozen=True)
class Line:
    """Margins in 1/s and 1/m, widths in rad, m, m, m/s; empty where there is none."""

    row: str
    method: str
    goal: str
    verdict: str
    before: float | None
    falsified: float | None = dataclasses.field(metadata=AT_LEAST)
    certified: float | None = dataclasses.field(metadata=AT_LEAST)
    per_metre: float | None = dataclasses.field(metadata=AT_LEAST)
    alpha: float | None = dataclasses.field(metadata=AT_MOST)
    lateral: float | None = dataclasses.field(metadata=AT_MOST)
    longitudinal: float | None = dataclasses.field(metadata=AT_MOST)
    speed: float | None = dataclasses.field(metadata=AT_MOST)
    cars_lost: int | None
    seconds: float


TRIALS = (  # speed, curvature, I, G, certified before: PF, TT
    (1.0, 2.0, 0.4, 0.6, 0.82, 0.60),
    (1.0, 2.0, 0.10, 0.15, 1.10, 0.66),
    (2.0, 1.8, 0.15, 0.25, 3.9, 0.98),
    (2.0, 1.0, 0.4, 0.6, 3.4, 2.4),
    (2.0, 2.0, 0.4, 0.6, 1.7, None),
    (3.0, 2.5, 0.2, 0.3, 1.7, 0.79),
    (5.0, 0.5, 0.3, 0.5, 12.9, 0.77),
)
FASTEST = (1.0, 2.0, 4.0, 8.0, 16.0, 10 * math.pi)  # m/s, from 1 m/s


def cases() -> list[Case]:
    found = []
    headline = "every speed from 1 to 10π m/s"
    for method, before in (("pf", 0.87), ("tt", None)):
        found.append(Case(headline, 1.8, (1.0, 10 * math.pi), 1.0, 0.15, 0.25, True, method, before))
    for v, kappa, inlet, goal, *before in TRIALS:
        for everywhere in (True, False):
            for method, margin in zip(("pf", "tt"), before, strict=True):
                name = f"{v:g} m/s, {kappa:g} 1/m, {inlet:g}, {goal:g}"
                found.append(Case(name, kappa, (v, v), 0.0, inlet, goal, everywhere, method, margin))
    for fastest in FASTEST:
        for method in ("pf", "tt"):
            found.append(
                Case(f"1 to {fastest:.4g} m/s, narrow", 1.8, (1.0, fastest), 1.0, 0.05, 0.09, True, method, None)
            )
    return found


def run(case: Case, cars: int) -> Line:
    result = synthesize(case.problem(), Options(cars=cars))
    loop, found = result.closed_loop, result.segments[0] if result.segments else None
    widths = [float(width) for width in found.funnel.half_widths()] if found else [None] * 4
    return Line(
        row=case.row,
        method=case.method,
        goal="all states" if case.everywhere else "position",
        verdict=result.verdict.value,
        before=case.before,
        falsified=result.margin_falsified,
        certified=result.margin_certified,
        per_metre=found.margin_per_metre if found else None,
        alpha=widths[0],
        lateral=widths[1],
        longitudinal=widths[2],
        speed=widths[3],
        cars_lost=loop.left_funnel + loop.left_safe + loop.missed_goal if loop else None,
        seconds=result.seconds["total"],
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/tube_table"))
    parser.add_argument("--only", default="", help="cases whose row contains this text")
    parser.add_argument("--cars", type=int, default=2000)
    arguments = parser.parse_args()
    lines = []
    for case in cases():
        if arguments.only in case.row:
            lines.append(run(case, arguments.cars))
            write_lines(lines, arguments.output, "tube_table")
            print(markdown(lines[-1:]).splitlines()[-1], flush=True)
    print(f"\n{markdown(lines)}\nwritten to {arguments.output}")


if __name__ == "__main__":
    main()
