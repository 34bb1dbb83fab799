"""A million closed loops over the paper's rows: cars under the certified law, half of them from the inlet's boundary.

    python -m experiments.rollouts [--cars 1000000] [--output FOLDER] [--only TEXT ...]

Every row, method and template that is certified is driven, the cars shared evenly. First each is certified and left as
a run folder in the output folder, where the next call finds it: one that is interrupted goes on with the first that is
missing. Then the cars are driven, in chunks that have seeds of their own. A car is lost if V exceeds 1 (by more than
rounding), if it leaves S or meets an obstacle, or if it is not inside G when it arrives; with one lost the exit code
is 1. Prints one table and writes it as rollouts.csv and rollouts.md; times of arrival in s.
"""

import argparse
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cfjax.conf import options_of, preset, problem_of, yaml_of
from cfjax.errors import InputError
from cfjax.report.files import CONFIG, RESULT
from cfjax.report.lines import markdown, write_lines
from cfjax.report.run_folder import read_run, write_run
from cfjax.result import ClosedLoop, Result
from cfjax.simulation import drive_cars
from cfjax.synthesis import search
from cfjax.verdict import Verdict
from experiments.paper_table import ROWS, cases


CHUNK = 10_000  # cars at once, at most


@dataclass(frozen=True)
class Line:
    """Cars of one row and what became of them; arrivals in s."""

    row: str
    template: str
    method: str
    cars: int
    largest_value: str  # to nine digits: what is below 1 has to be seen below it
    left_funnel: int
    left_s: int
    missed_g: int
    first_arrival: float | None
    last_arrival: float | None
    seconds: float

    @property
    def lost(self) -> int:
        return self.left_funnel + self.left_s + self.missed_g


def certified(row: str, template: str, method: str, output: Path) -> Result:
    """The row's result from its run folder, made where there is none.

    Raises:
        InputError: where the folder holds the run of another question.
    """
    name, speed, *_ = ROWS[row]
    config = preset(
        name,
        [f"method={method}", f"template={template}", *([f"path.speed={speed!r}"] if speed is not None else [])],
    )
    folder = output / "_".join([name, *([f"{speed:.4g}"] if speed is not None else []), template, method])
    question = yaml_of(config)
    if not (folder / RESULT).exists():
        write_run(search(problem_of(config), options_of(config)), folder, question)
    elif (folder / CONFIG).read_text(encoding="utf-8") != question:
        raise InputError(f"--output: expected in {folder} the run of {row}, {template}, {method}, got another question")
    return read_run(folder)


def drive_in_chunks(result: Result, cars: int) -> ClosedLoop:
    """At least so many cars from the path's start to its end, in chunks of one size, which is even."""
    chunks = math.ceil(cars / CHUNK)
    size = 2 * math.ceil(cars / chunks / 2)
    return together([drive_cars(result.problem, result.legs, cars=size, seed=seed)[0] for seed in range(chunks)])


def together(parts: Sequence[ClosedLoop]) -> ClosedLoop:
    """Several lots of cars as one."""
    arrivals = [time for part in parts if part.arrival for time in part.arrival]
    values = [part.largest_value for part in parts]
    return ClosedLoop(
        cars=sum(part.cars for part in parts),
        left_funnel=sum(part.left_funnel for part in parts),
        left_safe=sum(part.left_safe for part in parts),
        missed_goal=sum(part.missed_goal for part in parts),
        largest_value=math.nan if any(map(math.isnan, values)) else max(values),
        arrival=(min(arrivals), max(arrivals)) if arrivals else None,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cars", type=int, default=1_000_000, help="of all rows together, at least (1000000)")
    parser.add_argument("--output", type=Path, default=Path("outputs/rollouts"))
    parser.add_argument("--only", nargs="+", default=[""], metavar="TEXT", help="lines that contain one of these texts")
    arguments = parser.parse_args()
    chosen = [case for case in cases() if any(text in " ".join(case) for text in arguments.only)]
    if arguments.cars < 1 or not chosen:
        print(
            f"error: --cars, --only: expected cars and lines, got {arguments.cars} and {len(chosen)}", file=sys.stderr
        )
        return 2
    found: dict[tuple[str, str, str], Result] = {}
    for case in chosen:
        try:
            result = certified(*case, arguments.output)
        except InputError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        print(f"{', '.join(case)}: {result.verdict.value}", file=sys.stderr, flush=True)
        if result.verdict is Verdict.CERTIFIED:
            found[case] = result
    lines: list[Line] = []
    for case, result in found.items():
        begin = time.perf_counter()
        loop = drive_in_chunks(result, math.ceil(arguments.cars / len(found)))
        line = Line(
            *case,
            cars=loop.cars,
            largest_value=f"{loop.largest_value:.9f}",
            left_funnel=loop.left_funnel,
            left_s=loop.left_safe,
            missed_g=loop.missed_goal,
            first_arrival=loop.arrival[0] if loop.arrival else None,
            last_arrival=loop.arrival[1] if loop.arrival else None,
            seconds=time.perf_counter() - begin,
        )
        lines.append(line)
        write_lines(lines, arguments.output, "rollouts")
        print(
            f"{', '.join(case)}: {line.cars} cars, {line.lost} lost, {line.seconds:.1f} s", file=sys.stderr, flush=True
        )
    if not lines:
        print("error: nothing is certified, so nothing was driven", file=sys.stderr)
        return 1
    print(markdown(lines))
    lost = sum(line.lost for line in lines)
    print(f"{sum(line.cars for line in lines):,} cars on {len(lines)} lines of {len(chosen)}, {lost} lost")
    print(f"written to {arguments.output}")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
