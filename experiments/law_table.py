"""Laws that people use, each with the largest margin that is proven for it, beside the best inputs of the same box.

    python experiments/law_table.py [--output FOLDER] [--only TEXT] [--rounds N] [--restarts N]

A car at 2.8 m/s (wheelbase 1.75 m, steering angle at most 0.61 rad) on a straight line and on circles, path following,
I with half-axes 0.2 rad, 0.4 m, 0.4 m, G with 0.6 rad, 1.5 m, 1.5 m, S with π/4, 2 m, 3 m. Prints one table and writes
it as law_table.csv and law_table.md. λ in 1/s, `width` is the funnel's largest lateral half-width, m. Cars are lost
that leave the funnel or S, or miss G, under the law itself (without one, under the min-norm law). Seconds are wall time
of learning, proof and check, and of the proof alone.
"""

import argparse
import dataclasses
import math
from pathlib import Path

from cfjax import Options
from cfjax.problem import FeedbackLaw, LinearLaw, Problem, PurePursuitLaw, StanleyLaw, circle, straight
from cfjax.report.lines import AT_LEAST, markdown, write_lines
from cfjax.synthesis import drive, search
from experiments.vehicles.cruiser import Cruiser


CAR = Cruiser()
WAY = 14.0  # m
CURVATURES = (0.0, 0.1)  # 1/m
LAWS: dict[str, FeedbackLaw | None] = {
    "best inputs": None,
    "linear (LQR)": LinearLaw(),
    "stanley, 0.45 1/s": StanleyLaw(gain=0.45, softening=0.0),
    "stanley, 1.5 1/s": StanleyLaw(gain=1.5, softening=0.0),
    "pure pursuit, 1 s": PurePursuitLaw(look_ahead=1.0),
}


@dataclasses.dataclass(frozen=True)
class Line:
    law: str
    curvature: float
    verdict: str
    certified: float | None = dataclasses.field(metadata=AT_LEAST)  # 1/s
    falsified: float | None = dataclasses.field(metadata=AT_LEAST)
    width: float | None
    cars_lost: int | None
    seconds: int
    proof_seconds: int


def run(name: str, curvature: float, options: Options) -> Line:
    path = circle(1 / curvature, CAR.speed, WAY * curvature / (2 * math.pi)) if curvature else straight(WAY, CAR.speed)
    problem = Problem(
        path,
        inlet=(0.2, 0.4, 0.4),
        goal=(0.6, 1.5, 1.5),
        safe=(math.pi / 4, 2.0, 3.0),
        vehicle=CAR,
        law=LAWS[name],
    )
    result = search(problem, options)
    loop = drive(result, options).closed_loop
    widest = max(
        (math.sqrt(max(1.0, s.funnel.end_level)) * s.funnel.half_widths()[1] for s in result.segments), default=0
    )
    return Line(
        law=name,
        curvature=curvature,
        verdict=result.verdict.value,
        certified=result.margin_certified,
        falsified=result.margin_falsified,
        width=round(widest, 3) or None,
        cars_lost=loop.left_funnel + loop.left_safe + loop.missed_goal if loop else None,
        seconds=round(result.seconds["total"]),
        proof_seconds=round(result.seconds.get("certify", 0.0)),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/law_table"))
    parser.add_argument("--only", default="", help="lines that contain this text, as in 'stanley, 0.45 1/s 0.1'")
    parser.add_argument("--rounds", type=int, default=Options.rounds)
    parser.add_argument("--restarts", type=int, default=Options.restarts)
    arguments = parser.parse_args()
    options = Options(robustness=False, cars=2000, rounds=arguments.rounds, restarts=arguments.restarts)
    lines: list[Line] = []
    for curvature in CURVATURES:
        for name in LAWS:
            if arguments.only in f"{name} {curvature}":
                lines.append(run(name, curvature, options))
                write_lines(lines, arguments.output, "law_table")
                print(markdown(lines[-1:], without=()).splitlines()[-1], flush=True)
    print(f"\n{markdown(lines, without=())}\nwritten to {arguments.output}")


if __name__ == "__main__":
    main()
