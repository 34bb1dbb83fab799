"""Every vehicle of the documents on every path that it can follow: what is proven, and for how long inputs may be held.

    python experiments/vehicle_table.py [--output FOLDER] [--only TEXT] [--cars N]

Prints one table and writes it as vehicle_table.csv and vehicle_table.md. λ in 1/s; the control period in ms, rounded
down, of a law that inherits the certificate. Cars are lost that leave the funnel or S, or miss G. Seconds are wall time
of learning, proof and check, without control periods and cars. A vehicle that cannot follow a path has no line there.
"""

import argparse
import dataclasses
from pathlib import Path

from cfcheck.exact.rational import float_below
from cfcheck.reader import Broken
from cfcheck.replay import check_document, check_robustness
from cfjax import InputError, Options, Vehicle
from cfjax.certificate import robustness_of
from cfjax.certificate.prover import NotProven
from cfjax.conf import preset, problem_of
from cfjax.problem import Box, Ellipsoid, KinematicBicycle, ball
from cfjax.report.lines import AT_LEAST, markdown, write_lines
from cfjax.result import Result
from cfjax.rounded import MILLI, NOTHING, rounded_down
from cfjax.synthesis import drive, search
from experiments.vehicles.dynamic_single_track import DynamicSingleTrack
from experiments.vehicles.front_axle import FrontAxleCar
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle


VEHICLES: tuple[Vehicle, ...] = (KinematicBicycle(), Unicycle(), FrontAxleCar(), SteeredCar(), DynamicSingleTrack())
PATHS = ("straight", "circle", "ellipse")
# of those that have more states than a path's preset
SETS = {
    "steered_car": {"inlet": ball(0.2, 5), "goal": ball(0.6, 5), "safe": Box((1.0, 1.0, 1.0, 3.0, 0.7))},
    "dynamic_single_track": {
        "inlet": Ellipsoid((0.2, 0.2, 0.2, 0.2, 0.1, 0.5)),
        "goal": Ellipsoid((0.5, 0.5, 0.5, 0.5, 0.5, 2.0)),
        "safe": Box((1.0, 1.0, 1.0, 1.0, 0.5, 3.0)),
    },
}


@dataclasses.dataclass(frozen=True)
class Line:
    vehicle: str
    path: str
    method: str
    verdict: str
    certified: float | None = dataclasses.field(metadata=AT_LEAST)  # 1/s
    falsified: float | None = dataclasses.field(metadata=AT_LEAST)
    period_ms: str
    cars_lost: int | None
    seconds: int


def run(vehicle: Vehicle, path: str, method: str, cars: int) -> Line | None:
    asked = problem_of(preset(path, [f"method={method}"]))
    try:
        problem = dataclasses.replace(asked, vehicle=vehicle, **SETS.get(vehicle.name, {}))
        result = search(problem, Options(cars=cars))
    except (InputError, Broken) as error:
        print(f"{vehicle.name}, {path}: {error}", flush=True)
        return None
    loop = drive(result, Options(cars=cars)).closed_loop
    return Line(
        vehicle=vehicle.name,
        path=path,
        method=method,
        verdict=result.verdict.value,
        certified=result.margin_certified,
        falsified=result.margin_falsified,
        period_ms=period(result),
        cars_lost=loop.left_funnel + loop.left_safe + loop.missed_goal if loop else None,
        seconds=round(result.seconds["total"]),
    )


def period(result: Result) -> str:
    """For how long inputs may be held, ms, rounded down to three digits; a dash where nothing is proven of it."""
    if result.document is None or result.margin_certified is None:
        return NOTHING
    try:
        hints = robustness_of(result)
    except (NotProven, Broken, ValueError):
        return NOTHING
    proven = check_robustness(check_document(result.document), result.document, hints).robustness
    return NOTHING if proven is None else rounded_down(float_below(proven.alone.period), 3, MILLI)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/vehicle_table"))
    parser.add_argument("--only", default="", help="lines that contain this text, as in 'unicycle circle'")
    parser.add_argument("--cars", type=int, default=2000)
    arguments = parser.parse_args()
    lines: list[Line] = []
    for vehicle in VEHICLES:
        for path in PATHS:
            for method in ("pf", "tt"):
                wanted = arguments.only in f"{vehicle.name} {path} {method}"
                line = run(vehicle, path, method, arguments.cars) if wanted else None
                if line is not None:
                    lines.append(line)
                    write_lines(lines, arguments.output, "vehicle_table")
                    print(markdown([line], without=()).splitlines()[-1], flush=True)
    print(f"\n{markdown(lines, without=())}\nwritten to {arguments.output}")


if __name__ == "__main__":
    main()
