"""The field's benchmarks: what is proven of each, beside what is published.

    python -m experiments.benchmarks [--output FOLDER] [--only TEXT]

Every region is written to a file, and it is the file that is replayed. `area` (m rad, in the plane of d_e and θ_e) is
rounded down from the exact C of that file. `found_s` and `check_s` are CPU time.
"""

import argparse
import dataclasses
import time
from pathlib import Path

from cfcheck import Outcome, check_file
from cfjax.certificate.writing import dump
from cfjax.report.lines import AT_LEAST, markdown, write_lines
from cfjax.verdict import Verdict
from experiments.benchmarks import path_tracking
from experiments.benchmarks.region import NotShown, area_below, certificate


WANTED = {"0.84": 122.0, "0.5": 82.0}  # m rad, a little more than what is to be shown
PUBLISHED = {"0.84": "19.6; 118–128", "0.5": "11.2; 75–83"}
BETA_LOWER, BETA_INNER = 0.9, 0.01


@dataclasses.dataclass(frozen=True)
class Line:
    benchmark: str
    verdict: str
    area: float | None = dataclasses.field(metadata=AT_LEAST)
    published: str
    found_s: float
    check_s: float


def tracked(limit: str, printed: bool, folder: Path, wanted: float) -> Line:
    """A region of path tracking, found, written and replayed from its file."""
    system = path_tracking.system(limit, printed)
    started, checked, verdict, area = time.process_time(), 0.0, Verdict.INCONCLUSIVE, None
    try:
        shape = path_tracking.candidate(float(limit), printed, wanted)
        document = certificate(system, shape, BETA_LOWER, BETA_INNER)
        found = time.process_time() - started
        file = folder / f"{system.name}_{limit}.json"
        file.write_text(dump(document))
        started = time.process_time()
        if check_file(file).outcome is Outcome.PROVEN:
            verdict, area = Verdict.CERTIFIED, area_below(document)
        checked = time.process_time() - started
    except NotShown as failure:
        print(f"{system.name}, {limit}: {failure}")
        found = time.process_time() - started
    return Line(
        f"path tracking, tan δ ≤ {limit}, {'as printed' if printed else 'beside a circle'}",
        verdict.value,
        area,
        PUBLISHED[limit],
        round(found, 1),
        round(checked, 2),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/benchmarks"))
    parser.add_argument("--only", default="", help="lines that contain this text, as in '0.84 beside a circle'")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    lines: list[Line] = []
    for limit, wanted in WANTED.items():
        for printed in (False, True):
            if arguments.only in f"path tracking {limit} {'as printed' if printed else 'beside a circle'}":
                lines.append(tracked(limit, printed, arguments.output, wanted))
                write_lines(lines, arguments.output, "benchmarks")
                print(markdown(lines[-1:], without=()).splitlines()[-1], flush=True)
    print(f"\n{markdown(lines, without=())}\nwritten to {arguments.output}")


if __name__ == "__main__":
    main()
