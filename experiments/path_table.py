"""Two ways for every path: funnels made for it, and the universal tube; margins, widths and times side by side.

    python experiments/path_table.py [--output FOLDER] [--only TEXT] [--cars N]

Prints one table and writes it as path_table.csv and path_table.md. A funnel shrinks from I to G and its λ pays for
that; an invariant tube does not shrink, so that its λ is larger where it exists at all, and it serves every other path
within its bounds too. Widths are the largest lateral half-width (m); the disturbance is the lateral one (m/s) that λ
absorbs at the start. Beside obstacles a tube has to be as narrow all along as it is where they are nearest. Seconds are
wall time: learning, proof and check, no cars.
"""

import argparse
import dataclasses
from pathlib import Path

from cfjax import InputError, Options, synthesize
from cfjax.conf import preset, problem_of
from cfjax.funnel import LATERAL, lateral_half_width
from cfjax.report.lines import AT_LEAST, AT_MOST, markdown, write_lines


ROWS = (
    ("straight", ()),
    ("circle", ()),
    ("oval", ()),
    ("oval", ("path.speed=1.5707963267948966",)),
    ("ellipse", ("path.a=3", "path.b=2")),
    ("figure_eight", ()),
    ("slalom", ()),
    ("slalom", ("sets.inlet=0.15", "sets.goal=0.25", "sets.safe=null")),
    ("obstacle", ()),
    ("obstacle_tight", ()),
)
WAYS = ("segment", "tube")


@dataclasses.dataclass(frozen=True)
class Line:
    row: str
    method: str
    way: str
    verdict: str
    certified: float | None = dataclasses.field(metadata=AT_LEAST)  # 1/s
    falsified: float | None = dataclasses.field(metadata=AT_LEAST)
    half_width: float | None = dataclasses.field(metadata=AT_MOST)
    disturbance: float | None = dataclasses.field(metadata=AT_LEAST)
    stretches: int | None
    cars_lost: int | None
    seconds: int


def run(path: str, changes: tuple[str, ...], method: str, way: str, cars: int) -> Line:
    name = " ".join((path, *changes))
    try:
        problem = problem_of(preset(path, [*changes, f"method={method}"]))
        result = synthesize(problem, Options(certificate=way, cars=cars))
    except InputError:
        return Line(name, method, way, "not offered", *(None,) * 6, 0)
    found, loop, margin = result.segments, result.closed_loop, result.margin_certified
    absorbed = [
        float(segment.funnel.absorbed_disturbance(segment.margin_certified or 0.0)[LATERAL]) for segment in found
    ]
    return Line(
        row=name,
        method=method,
        way=way,
        verdict=result.verdict.value,
        certified=margin,
        falsified=result.margin_falsified,
        half_width=max((lateral_half_width(segment.funnel) for segment in found), default=None),
        disturbance=min(absorbed, default=None) if margin else None,
        stretches=max((len(segment.stretches) for segment in found), default=0) or None,
        cars_lost=loop.left_funnel + loop.left_safe + loop.missed_goal if loop else None,
        seconds=round(result.seconds["total"] - result.seconds.get("simulate", 0.0)),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/path_table"))
    parser.add_argument("--only", default="", help="rows that contain this text")
    parser.add_argument("--cars", type=int, default=2000)
    arguments = parser.parse_args()
    lines = []
    for path, changes in ROWS:
        for method in ("pf", "tt"):
            for way in WAYS:
                if arguments.only in " ".join((path, *changes)):
                    lines.append(run(path, changes, method, way, arguments.cars))
                    write_lines(lines, arguments.output, "path_table")
                    print(markdown(lines[-1:], without=()).splitlines()[-1], flush=True)
    print(f"\n{markdown(lines, without=())}\nwritten to {arguments.output}")


if __name__ == "__main__":
    main()
