"""Certified margins beside proven upper bounds: `python -m experiments.margin_bounds [--output FOLDER]`.

On a straight line of 4 m at 2 m/s, with the paper's template, I and G being balls of 0.5. The bound is the smallest one
that is proven when a step is added to the falsified margin, from large to small. Prints one table and writes it as
margin_bounds.csv and margin_bounds.md, and a picture of it as margin_bounds.png.
"""

import argparse
import dataclasses
import itertools
import json
import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cfjax
from cfcheck import Outcome, check_document
from cfjax.bracket import upper_bound
from cfjax.certificate import dump
from cfjax.report.lines import AT_LEAST, AT_MOST, markdown, write_lines
from experiments.figures.figure import COLOURS


STEPS = (0.2, 0.1, 0.05, 0.025, 0.0125)  # 1/s, above the falsified margin, tried in turn
METHODS = {"tt": "trajectory tracking", "pf": "path following"}


@dataclasses.dataclass(frozen=True)
class Line:
    method: str
    beta_lower: float
    certified: float | None = dataclasses.field(metadata=AT_LEAST)  # 1/s
    falsified: float | None = dataclasses.field(metadata=AT_LEAST)
    bound: float | None = dataclasses.field(metadata=AT_MOST)  # 1/s; None: no proof was found
    leaves: int | None = None
    kilobytes: int | None = None
    search_seconds: int | None = None  # of the processor, of the search that succeeded
    replay_seconds: float | None = None  # of the processor


def run(method: str, beta: float, boxes: int) -> Line:
    problem = cfjax.Problem(cfjax.straight(), method=method)
    options = cfjax.Options(template="paper", beta_lower=beta, cars=0, robustness=False)
    result = cfjax.synthesize(problem, options)
    line = Line(method, beta, result.margin_certified, result.margin_falsified, None)
    for step in STEPS:
        begin = time.process_time()
        wanted = float(f"{max(0.0, result.margin_falsified or 0.0) + step:.4f}")
        found = upper_bound(problem, wanted, beta_lower=beta, most_boxes=boxes)
        if found is None:
            break
        searched, text = time.process_time() - begin, dump(found.document)
        begin = time.process_time()
        report = check_document(json.loads(text))
        if report.outcome is not Outcome.BOUNDED:
            raise RuntimeError(f"the checker refuses a bound: {report.message}")
        line = dataclasses.replace(
            line,
            bound=found.margin,
            leaves=found.leaves,
            kilobytes=round(len(text) / 1000),
            search_seconds=round(searched),
            replay_seconds=round(time.process_time() - begin, 1),
        )
    return line


def draw(lines: Sequence[Line], file: Path) -> None:
    """λ over the thickness of the shell: certified below, proven bound above, what is between is not known.

    A funnel is one for every thinner shell, and a bound holds for every thicker one: so the lines are steps.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for method, name in METHODS.items():
        colour = COLOURS[method]
        own = sorted((line for line in lines if line.method == method), key=lambda line: -line.beta_lower)
        proven = [(1 - line.beta_lower, line.certified) for line in own if line.certified is not None]
        if proven:
            axes.plot(
                *zip(*proven, strict=True),
                "o-",
                color=colour,
                drawstyle="steps-pre",
                label=f"{name}, certified",
            )
        bounded = [(1 - line.beta_lower, line.bound) for line in own if line.bound is not None]
        if bounded:
            least = itertools.accumulate((bound for _, bound in bounded), min)
            steps = [thickness for thickness, _ in bounded], [*least]
            axes.plot(*steps, "v--", color=colour, drawstyle="steps-post", label=f"{name}, none above")
    axes.set_xlabel("thickness of the shell, 1 − β̲")
    axes.set_ylabel("margin λ, 1/s")
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beta-lower", type=float, nargs="+", default=[0.6, 0.8, 0.9, 0.95])
    parser.add_argument("--method", choices=tuple(METHODS), nargs="+", default=["tt", "pf"])
    parser.add_argument("--boxes", type=int, default=20_000, help="the most of one search")
    parser.add_argument("--workers", type=int, default=1, help="rows that are worked on at once")
    parser.add_argument("--output", type=Path, default=Path("outputs/margin_bounds"))
    given = parser.parse_args()
    rows = [*itertools.product(given.method, given.beta_lower, [given.boxes])]
    lines: list[Line] = []
    with ProcessPoolExecutor(given.workers, multiprocessing.get_context("spawn")) as pool:
        for line in pool.map(run, *zip(*rows, strict=True)):
            lines.append(line)
            write_lines(lines, given.output, "margin_bounds")
            draw(lines, given.output / "margin_bounds.png")
            print(markdown(lines[-1:], without=()).splitlines()[-1], flush=True)
    print(f"\n{markdown(lines, without=())}\nwritten to {given.output}")


if __name__ == "__main__":
    main()
