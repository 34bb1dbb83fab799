#!/usr/bin/env python
"""Make the library of tubes that travels with the package: learn and prove each, keep those that are there already.

    python scripts/make_tubes.py [--folder cfjax/tubes/library] [--only NAME …]

Run again after an interruption: a file that proves the tube asked for is not made again. Exit 1 if one could not be
made.
"""

import argparse
import itertools
import os
import sys
from pathlib import Path
from typing import NamedTuple


os.environ.setdefault("JAX_PLATFORMS", "cpu")

from cfcheck.exact.rational import rational
from cfjax import InputError, Interval, Options, Problem, Verdict, ball, synthesize, tube
from cfjax.certificate.writing import dump
from cfjax.exact import exact_bounds
from cfjax.progress import progress_on
from cfjax.report.files import write_whole
from cfjax.rounded import margin_text, rounded_up
from cfjax.tubes.certified import CertifiedTube
from cfjax.tubes.store import pack, read_tube


BETA_INNER = 0.08  # contracts from a width to the next narrower one
WIDTHS = {"narrow": (0.05, 0.09), "normal": (0.15, 0.25), "wide": (0.35, 0.6)}  # radii of I and G
CURVATURES = {"gentle": 1.2, "tight": 2.3}  # 1/m; the car's limit is 2.94
SPEEDS = {"slow": ((0.5, 4.0), 1.0), "fast": ((3.0, 32.0), 2.0)}  # m/s, and acceleration in m/s²


class Wish(NamedTuple):
    name: str
    inlet: float
    goal: float
    curvature: float
    speed: tuple[float, float]
    acceleration: float

    def problem(self) -> Problem:
        bounds = tube(self.curvature, Interval(*self.speed), self.acceleration)
        return Problem(bounds, inlet=ball(self.inlet), goal=ball(self.goal))

    def is_met_by(self, found: CertifiedTube) -> bool:
        """Whether the proven tube is at least as good: bounds as wide, and the width of this wish."""
        within = self.problem().path.require_tube()
        reach = max(float(found.inverse[i, i]) for i in range(len(found.shape))) ** 0.5
        return (
            found.bounds == exact_bounds(within)
            and self.inlet < reach < self.goal
            and found.beta_inner == rational(BETA_INNER)
        )


def wishes() -> list[Wish]:
    return [
        Wish(f"{width}-{bend}-{pace}", *WIDTHS[width], CURVATURES[bend], *SPEEDS[pace])
        for width, bend, pace in itertools.product(WIDTHS, CURVATURES, SPEEDS)
    ]


def is_there(path: Path, wish: Wish) -> bool:
    try:
        return path.exists() and wish.is_met_by(read_tube(path))
    except InputError:
        return False


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path(__file__).parents[1] / "cfjax" / "tubes" / "library")
    parser.add_argument("--only", nargs="*", metavar="NAME", help="names of tubes to make, others stay as they are")
    arguments = parser.parse_args()
    unknown = set(arguments.only or ()) - {wish.name for wish in wishes()}
    if unknown:
        print(f"error: expected names among {', '.join(wish.name for wish in wishes())}", file=sys.stderr)
        return 2
    arguments.folder.mkdir(parents=True, exist_ok=True)
    failed = 0
    for wish in wishes():
        path = arguments.folder / f"{wish.name}.json.xz"
        if arguments.only and wish.name not in arguments.only:
            continue
        if is_there(path, wish):
            print(f"{wish.name}: there")
            continue
        with progress_on() as progress:
            result = synthesize(wish.problem(), Options(beta_inner=BETA_INNER, cars=0, rounds=2), progress)
        if result.verdict is not Verdict.CERTIFIED or result.document is None:
            print(f"{wish.name}: {result.verdict.value}, {result.message}")
            failed += 1
            continue
        write_whole(path, pack(dump(result.document)))
        found = read_tube(path)  # as it lies on disk
        print(
            f"{wish.name}: lambda {margin_text(float(found.margin))} 1/s, "
            f"{margin_text(float(found.margin_per_metre))} per metre, "
            f"lateral half-width {rounded_up(float(found.inverse[1, 1]) ** 0.5, 3)} m, {path.stat().st_size >> 10} kB, "
            f"{result.seconds['total']:.0f} s",
            flush=True,
        )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
