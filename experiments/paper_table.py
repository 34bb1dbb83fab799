"""The paper's rows, both methods and templates: margins found and proven beside its verdict.

    python experiments/paper_table.py [--learners gradient polytope revised] [--output FOLDER] [--only TEXT ...]
                                      [--cars N] [--set KEY=VALUE ...]

Prints one table and writes it as paper_table.csv and paper_table.md (without the times, which no two runs share).
Learners: `gradient`; `polytope`, the paper's own (elimination of coefficients, from counterexamples and the
demonstrations of an MPC); `revised`, the same with demonstrations that are chosen anew for every candidate. Keys that
are `--set` hold for every line, and are printed under the table. "Best before" are the best falsified margins of
the trials that preceded this implementation (shell [0.9, 1], u0 ∈ [0.5, 2]); of the oval, those of one half.
"""

import argparse
import itertools
import math
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cfjax.conf import options_of, preset, problem_of
from cfjax.learner.oracle import PATIENCE
from cfjax.report.lines import AT_LEAST, markdown, write_lines
from cfjax.report.paper_rows import agreement, paper_found
from cfjax.rounded import margin_text
from cfjax.synthesis import synthesize


# preset, speed key or None, best falsified margins before (1/s) as (PF, TT): paper's template, contracting one
STEADY: dict[str, tuple[str, float | None, tuple[float | None, float | None], tuple[float, float]]] = {
    "straight": ("straight", None, (0.20, None), (2.29, 1.50)),
    "straight_long": ("straight_long", None, (0.31, 0.08), (2.54, 2.06)),
    "straight_restricted": ("straight_restricted", None, (0.28, None), (2.62, 0.42)),
    "circle, π/2 m/s": ("circle", math.pi / 2, (0.38, 0.14), (2.54, 1.76)),
    "circle, π m/s": ("circle", math.pi, (0.82, 0.17), (4.82, 2.30)),
    "circle, 10π m/s": ("circle", 10 * math.pi, (8.56, 1.75), (13.7, 10.4)),
}
CURVED: dict[str, tuple[str, float | None, tuple[float | None, float | None], tuple[float, float]]] = {
    "oval, 1 m/s": ("oval", None, (0.24, 0.16), (0.48, 0.43)),
    "obstacle": ("obstacle", None, (1.27, 0.80), (2.65, 2.04)),
    "obstacle_tight": ("obstacle_tight", None, (0.29, None), (2.23, 1.12)),
}
ROWS = STEADY | CURVED
TEMPLATES = ("paper", "contracting")
METHODS = ("pf", "tt")
LEARNERS: dict[str, list[str]] = {
    "gradient": [],
    "polytope": ["learner=polytope"],
    "revised": ["learner=polytope", "polytope.demonstrations=revised"],
}


@dataclass(frozen=True)
class Line:
    """One run; margins in 1/s, empty where there is none."""

    row: str
    template: str
    method: str
    learner: str
    verdict: str
    best_before: float | None
    falsified: float | None = field(metadata=AT_LEAST)
    certified: float | None = field(metadata=AT_LEAST)
    certified_share: float | None = field(metadata=AT_LEAST)  # of the falsified margin
    cars_lost: int | None  # left the funnel or S, or missed G
    paper: str
    agreement: str
    candidates: int  # that the learner looked at: restarts of all rounds, or centres of polytopes
    witnesses: int | None  # of (d), each with a demonstrated input
    searches: str  # by elimination: how they ended, and how many so
    seconds: float


def cases(rows: Iterable[str] = ROWS) -> list[tuple[str, str, str]]:
    """All (row, template, method), in the order of the table."""
    return list(itertools.product(rows, TEMPLATES, METHODS))


def best_before(row: str, template: str, method: str) -> float | None:
    """The best falsified margin known before, 1/s; None where none was found."""
    return ROWS[row][2 if template == "paper" else 3][METHODS.index(method)]


def run(row: str, template: str, method: str, learner: str, cars: int, more: Sequence[str] = ()) -> Line:
    """Synthesise and prove one line of the table; `more` are keys beside those of the line."""
    name, speed, *_ = ROWS[row]
    overrides = [f"method={method}", f"template={template}", f"cars={cars}", *LEARNERS[learner]]
    overrides += [f"path.speed={speed!r}"] if speed is not None else []
    config, start = preset(name, [*overrides, *more]), time.perf_counter()
    problem = problem_of(config)
    result = synthesize(problem, options_of(config))
    found = paper_found(problem, problem_of(preset(name)))
    search = result.search
    runs = search.get("runs", [])  # of elimination, one for each rate
    endings = Counter(run["ending"] for run in runs)
    certified, falsified, loop = result.margin_certified, result.margin_falsified, result.closed_loop
    return Line(
        row=row,
        template=template,
        method=method,
        learner=learner,
        verdict=result.verdict.value,
        best_before=best_before(row, template, method),
        falsified=falsified,
        certified=certified,
        certified_share=certified / falsified if certified and falsified else None,
        cars_lost=max(loop.left_funnel, loop.left_safe, loop.missed_goal) if loop else None,
        paper={True: "found", False: "not found", None: "–"}[found],
        agreement=agreement(result.verdict, found) if template == "paper" else "",
        candidates=search.get("candidates", 0) + sum(run["candidates"] for run in runs),
        witnesses=sum(run["demonstrations"] for run in runs) if learner != "gradient" else None,
        searches=", ".join(f"{count} {ending}" for ending, count in endings.items()),
        seconds=time.perf_counter() - start,
    )


@dataclass(frozen=True)
class Comparison:
    """One row for all learners: certified margins (1/s), or the verdict, empty where a learner was not run.

    Figures stand in the order of the learners; only elimination has witnesses, and searches that end.
    """

    row: str
    template: str
    method: str
    paper: str
    gradient: str
    polytope: str
    revised: str
    candidates: str
    witnesses: str
    searches: str
    seconds: str


def compared(lines: Sequence[Line]) -> list[Comparison]:
    """The lines side by side, those of the paper's learner and its relatives beside gradients."""
    found: dict[tuple[str, str, str], dict[str, Line]] = {}
    for line in lines:
        found.setdefault((line.row, line.template, line.method), {})[line.learner] = line

    def outcome(line: Line | None) -> str:
        if line is None:
            return ""
        return line.verdict if line.certified is None else margin_text(line.certified)

    def told(of: dict[str, Line], name: str) -> str:
        values = (getattr(of[learner], name) for learner in LEARNERS if learner in of)
        return " / ".join(f"{v:.0f}" if isinstance(v, float) else str(v) for v in values if v not in (None, ""))

    return [
        Comparison(
            *case,
            next(iter(of.values())).paper,
            *(outcome(of.get(learner)) for learner in LEARNERS),
            *(told(of, name) for name in ("candidates", "witnesses", "searches", "seconds")),
        )
        for case, of in found.items()
    ]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("outputs/paper_table"), help="folder of the two files")
    parser.add_argument("--only", nargs="+", default=[""], metavar="TEXT", help="lines that contain one of these texts")
    parser.add_argument("--learners", nargs="+", choices=LEARNERS, default=["gradient"])
    parser.add_argument("--cars", type=int, default=10_000, help="cars driven through each funnel")
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="of every line, e.g. beta_lower=0.99")
    arguments = parser.parse_args()
    lines = []
    for case, learner in itertools.product(cases(), arguments.learners):
        if any(text in " ".join((*case, learner)) for text in arguments.only):
            line = run(*case, learner, arguments.cars, arguments.set)
            lines.append(line)
            print(
                f"{line.row:20} {line.template:12} {line.method}  {line.learner:8}  {line.verdict:12} "
                f"falsified {margin_text(line.falsified):>8}  certified {margin_text(line.certified):>8}  "
                f"candidates {line.candidates}  witnesses {line.witnesses}  {line.searches}  "
                f"lost {line.cars_lost}  {line.seconds:5.1f} s",
                flush=True,
            )
            write_lines(lines, arguments.output, "paper_table")
    print(f"\n{markdown(lines, without=())}")
    if len(arguments.learners) > 1:
        print(markdown(compared(lines), without=()))
    if "revised" in arguments.learners:
        print(f"revised: a search is given up after {PATIENCE} candidates in a row that are no funnel")
    if arguments.set:
        print(f"with {' '.join(arguments.set)}")
    print(f"written to {arguments.output}")


if __name__ == "__main__":
    main()
