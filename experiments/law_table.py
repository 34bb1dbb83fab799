"""Laws that people use, each with the largest margin that is proven for it, beside the best inputs of the same box.

    python -m experiments.law_table [--output FOLDER] [--only TEXT] [--rounds N] [--restarts N] [--cars N]

A car (wheelbase 1.75 m, steering angle at most 0.61 rad) at several speeds: on a straight line, on a circle, and on
every path within a bound of the curvature. Path following, I with half-axes 0.2 rad, 0.4 m, 0.4 m, G with 0.6 rad,
1.5 m, 1.5 m, S with π/4, 2 m, 3 m. Prints one table and writes it as law_table.csv and law_table.md. λ in 1/s, `width`
is the funnel's largest lateral half-width, m; `period` is the longest control period that is proven, ms. Cars are lost
that leave the funnel or S, or miss G, under the law itself (without one, under the min-norm law). Seconds are wall time
of learning, proof and check, and of the proof alone.
"""

import argparse
import dataclasses
import itertools
import math
from pathlib import Path

from cfcheck import check_document
from cfcheck.replay import check_robustness
from cfjax import Options, Verdict
from cfjax.certificate.absorbed import with_amounts
from cfjax.problem import FeedbackLaw, LinearLaw, Problem, PurePursuitLaw, StanleyLaw, circle, straight, tube
from cfjax.problem import Path as Way
from cfjax.report.lines import AT_LEAST, markdown, write_lines
from cfjax.result import Result
from cfjax.synthesis import drive, harden, search
from experiments.vehicles.cruiser import Cruiser


LENGTH = 14.0  # m
SPEEDS = (1.4, 2.8)  # m/s
PATHS = ("straight", "circle, 0.1 1/m", "every path, 0.05 1/m")
LAWS: dict[str, FeedbackLaw | None] = {
    "best inputs": None,
    "linear (LQR)": LinearLaw(),
    "stanley, 0.45 1/s": StanleyLaw(gain=0.45, softening=0.0),
    "stanley, 1.5 1/s": StanleyLaw(gain=1.5, softening=0.0),
    "pure pursuit, 1 s": PurePursuitLaw(look_ahead=1.0),
}


@dataclasses.dataclass(frozen=True)
class Line:
    path: str
    speed: float  # m/s
    law: str
    verdict: str
    certified: float | None = dataclasses.field(metadata=AT_LEAST)  # 1/s
    falsified: float | None = dataclasses.field(metadata=AT_LEAST)
    width: float | None
    period: float | None = dataclasses.field(metadata=AT_LEAST)  # ms
    cars_lost: int | None
    seconds: int
    proof_seconds: int


def way_of(name: str, speed: float) -> Way:
    """The path of that name: one from `PATHS`."""
    kind, _, number = name.removesuffix(" 1/m").partition(", ")
    if kind == "straight":
        return straight(LENGTH, speed)
    curvature = float(number)
    if kind == "circle":
        return circle(1 / curvature, speed, LENGTH * curvature / (2 * math.pi))
    return tube(curvature, speed)


def run(path: str, speed: float, law: str, options: Options) -> Line:
    problem = Problem(
        way_of(path, speed),
        inlet=(0.2, 0.4, 0.4),
        goal=(0.6, 1.5, 1.5),
        safe=(math.pi / 4, 2.0, 3.0),
        vehicle=Cruiser(speed),
        law=LAWS[law],
    )
    result = search(problem, options)
    loop = drive(result, options).closed_loop
    widest = max(
        (math.sqrt(max(1.0, s.funnel.end_level)) * s.funnel.half_widths()[1] for s in result.segments), default=0
    )
    return Line(
        path=path,
        speed=speed,
        law=law,
        verdict=result.verdict.value,
        certified=result.margin_certified,
        falsified=result.margin_falsified,
        width=round(widest, 3) or None,
        period=period_of(result, options),
        cars_lost=loop.left_funnel + loop.left_safe + loop.missed_goal if loop else None,
        seconds=round(result.seconds["total"]),
        proof_seconds=round(result.seconds.get("certify", 0.0)),
    )


def period_of(result: Result, options: Options) -> float | None:
    """For how long inputs may be held at most, ms, as the checker proves it; None where nothing is proven."""
    if result.verdict is not Verdict.CERTIFIED or result.document is None:
        return None
    report = check_robustness(check_document(result.document), result.document, harden(result, options).file)
    robustness = with_amounts(result, report).robustness
    return 1e3 * robustness.alone.period if robustness else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/law_table"))
    parser.add_argument("--only", default="", help="lines that contain this text, as in 'straight 2.8 stanley, 0.45'")
    parser.add_argument("--rounds", type=int, default=Options.rounds)
    parser.add_argument("--restarts", type=int, default=Options.restarts)
    parser.add_argument("--cars", type=int, default=2000)
    given = parser.parse_args()
    options = Options(cars=given.cars, rounds=given.rounds, restarts=given.restarts)
    lines: list[Line] = []
    for path, speed, law in itertools.product(PATHS, SPEEDS, LAWS):
        if given.only in f"{path} {speed} {law}":
            lines.append(run(path, speed, law, options))
            write_lines(lines, given.output, "law_table")
            print(markdown(lines[-1:], without=()).splitlines()[-1], flush=True)
    print(f"\n{markdown(lines, without=())}\nwritten to {given.output}")


if __name__ == "__main__":
    main()
