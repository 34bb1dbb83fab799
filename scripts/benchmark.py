"""How long what users wait for takes, and against an earlier commit: a table, no test.

    .venv/bin/python scripts/benchmark.py [--runs 5] [--against COMMIT] [--only JOB …]

Every run is a process of its own. Its wall time, its processor time and the peak of its memory come from the operating
system, its stages from result.json. Medians over the runs; those of the two commits alternate, so that what else the
machine does hits both. "cold" runs have an empty compilation cache, all others the one that the run before has filled.
With COMMIT, a checkout of it is made and removed again; the same Python and libraries run both.
"""

import argparse
import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table


HERE = Path(__file__).resolve().parents[1]
TRAIN = ("-m", "cfjax.train")
STEERED = (
    "vehicle=custom",
    "vehicle.target=experiments.vehicles.steered_car.SteeredCar",
    "sets.inlet=0.2",
    "sets.goal=0.6",
    "sets.safe=[1,1,1,3,0.7]",
)
TWICE = """
from cfjax.train import prepare_environment
prepare_environment()
import sys, time
from cfjax import synthesize
from cfjax.conf import preset, problem_of
problem = problem_of(preset("circle"))
for _ in range(2):
    begin = time.perf_counter()
    synthesize(problem)
print(time.perf_counter() - begin)
"""


@dataclass(frozen=True)
class Job:
    """Arguments of Python, where FOLDER stands for the run's own folder and CIRCLE for a run of the circle."""

    arguments: tuple[str, ...]
    is_cold: bool = False
    prints: bool = False  # the seconds that count are its output
    codes: tuple[int, ...] = (0,)

    @property
    def is_run(self) -> bool:
        return "hydra.run.dir=FOLDER" in self.arguments


def run_of(*overrides: str, is_cold: bool = False) -> Job:
    return Job((*TRAIN, *overrides, "hydra.run.dir=FOLDER"), is_cold, codes=(0, 1))


PROOF = ("cars=0", "robustness=false")
JOBS = {
    "circle, cold": run_of("+path=circle", is_cold=True),
    "circle": run_of("+path=circle"),
    "help": Job((*TRAIN, "--help")),
    "typo": Job((*TRAIN, "+path=circl"), codes=(2,)),
    "check": Job(("-m", "cfjax.check", "CIRCLE")),
    "second synthesize": Job(("-c", TWICE), prints=True),
    "oval": run_of("+path=oval", "certificate=segment", *PROOF),
    "tube": run_of("+path=tube", *PROOF),
    "steered car, circle": run_of("+path=circle", "method=tt", *STEERED),
    "steered car, ellipse": run_of("+path=ellipse", "method=tt", *STEERED),
}


@dataclass
class Side:
    """A checkout, with what its runs have left: a compilation cache, and a run of the circle."""

    name: str
    tree: Path
    scratch: Path

    def measure(self, job: Job, number: int) -> dict[str, float]:
        """Seconds of one run, whole and by stages, of processors, and MB: by name."""
        folder = Path(tempfile.mkdtemp(dir=self.scratch)) / "run"
        cache = folder.parent / "cache" if job.is_cold else self.scratch / "cache"
        here = {"FOLDER": str(folder), "CIRCLE": str(self.scratch / "circle")}
        arguments = [argument.replace("FOLDER", here["FOLDER"]) for argument in job.arguments]
        arguments = [here["CIRCLE"] if argument == "CIRCLE" else argument for argument in arguments]
        package = os.pathsep.join([str(self.tree), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": package, "JAX_COMPILATION_CACHE_DIR": str(cache)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # users' Python keeps what it has compiled
        with (folder.parent / "output").open("w+") as output:
            begin = time.perf_counter()
            process = subprocess.Popen(
                [sys.executable, *arguments], cwd=self.tree, env=environment, stdout=output, stderr=output
            )
            _, status, usage = os.wait4(process.pid, 0)
            wall = time.perf_counter() - begin
            process.returncode = os.waitstatus_to_exitcode(status)
            output.seek(0)
            said = output.read()
        if process.returncode not in job.codes:
            raise SystemExit(f"benchmark: {self.name}: {' '.join(arguments)} ended with {process.returncode}\n{said}")
        figures = {"": float(said.split()[-1]) if job.prints else wall}
        if job.is_run:
            stages = json.loads((folder / "result.json").read_text())["seconds"]
            figures |= {name: seconds for name, seconds in stages.items() if name != "total"}
            if job is JOBS["circle"] and number == 0:
                (self.scratch / "circle").symlink_to(folder)
        if not job.prints:
            figures["processors"] = usage.ru_utime + usage.ru_stime
            figures["peak memory"] = usage.ru_maxrss / 1024  # KiB on Linux
        return figures


@contextlib.contextmanager
def checkout(commit: str, folder: Path) -> Iterator[Path]:
    """A work tree of the commit, removed in the end."""
    tree = folder / "tree"
    git = ["git", "-C", str(HERE), "worktree"]
    added = subprocess.run([*git, "add", "--detach", str(tree), commit], capture_output=True, text=True, check=False)
    if added.returncode:
        raise SystemExit(f"benchmark: expected a commit of this repository, got {commit}")
    try:
        yield tree
    finally:
        subprocess.run([*git, "remove", "--force", str(tree)], capture_output=True, check=False)


def measured(sides: list[Side], names: list[str], runs: int) -> dict[tuple[str, str], list[list[float]]]:
    """Figures of each job and stage: a list of runs for each side."""
    found: dict[tuple[str, str], list[list[float]]] = defaultdict(lambda: [[] for _ in sides])
    for name in names:
        job = JOBS[name]
        warming = 0 if job.is_cold else 1  # the first run fills the cache
        for number in range(runs + warming):
            for k, side in enumerate(sides):
                figures = side.measure(job, number)
                print(f"{side.name}: {name}, {figures['']:.2f} s", file=sys.stderr)
                if number >= warming:
                    for stage, value in figures.items():
                        found[name, stage][k].append(value)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="runs of each kind (5)")
    parser.add_argument("--against", metavar="COMMIT", help="compare with this commit")
    parser.add_argument("--only", nargs="+", choices=JOBS, metavar="JOB", help=f"of: {'; '.join(JOBS)}")
    arguments = parser.parse_args()
    if arguments.runs < 1:
        parser.error(f"--runs: expected 1 or more, got {arguments.runs}")
    names = [name for name in JOBS if not arguments.only or name in arguments.only]
    if "check" in names and "circle" not in names:
        names.insert(names.index("check"), "circle")
    with tempfile.TemporaryDirectory() as scratch, contextlib.ExitStack() as stack:
        sides = [Side("now", HERE, Path(scratch, "now"))]
        if arguments.against:
            tree = stack.enter_context(checkout(arguments.against, Path(scratch)))
            sides.append(Side(arguments.against[:12], tree, Path(scratch, "then")))
        for side in sides:
            side.scratch.mkdir()
        found = measured(sides, names, arguments.runs)
    ratio = ["ratio"] if len(sides) > 1 else []
    title = f"medians of {arguments.runs}, {os.cpu_count()} cores"
    table = Table("", *(side.name for side in sides), *ratio, title=title, box=None)
    for (name, stage), values in found.items():
        unit = "MB" if stage == "peak memory" else "s"
        medians = [statistics.median(each) if each else None for each in values]
        cells = ["–" if median is None else f"{median:.2f} {unit}" for median in medians]
        known = [median for median in medians if median is not None]
        share = [f"{known[0] / known[1]:.2f}" if len(known) > 1 and known[1] else ""] if ratio else []
        table.add_row(f"  {stage}" if stage else name, *cells, *share)
    Console().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
