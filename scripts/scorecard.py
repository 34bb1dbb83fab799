"""How the whole is doing: seconds that users wait, tests, lines and bytes; a row of docs/scorecard.csv.

    scripts/scorecard [--runs 3] [--tests] [--ci] [--reason TEXT] [--dry-run]

Seconds are medians of `benchmark.py`'s jobs. They are divided by the seconds of a fixed piece of Python and NumPy work,
timed between them, so that rows of different machines compare; the table holds the quotients and that unit. `--tests`
times scripts/test --all and `--ci` .ci/run. A row that is more than 10 % worse in any figure than the last one that has
it is added only with a `--reason`, which stands beside it. With `--dry-run` nothing is added.
"""

import argparse
import csv
import datetime
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from benchmark import HERE, JOBS, Side
from rich.console import Console
from rich.table import Table


TABLE = HERE / "docs" / "scorecard.csv"
WORSE = 1.1  # times what it was: needs a reason
TIMED = {
    "circle_cold": "circle, cold",
    "circle": "circle",
    "help": "help",
    "typo": "typo",
    "check": "check",
    "second_synthesize": "second synthesize",
}
LONG = {"tests": ("scripts/test", "--all"), "ci": ("bash", ".ci/run")}
COUNTED = ("lines", "certificate_kB")
COLUMNS = ("date", "commit", "unit_s", *TIMED, *LONG, *COUNTED, "reason")


def unit() -> float:
    """Seconds of a fixed piece of work: a loop of Python, products and factors of NumPy. The least of three."""
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(300, 300))
    spent = []
    for _ in range(3):
        begin = time.perf_counter()
        table: Counter[int] = Counter()
        for k in range(600_000):
            table[k * k % 997] += k
        for _ in range(30):
            np.linalg.cholesky(matrix @ matrix.T + 300 * np.eye(300))
        spent.append(time.perf_counter() - begin)
    return min(spent)


def lines_by_room() -> dict[str, int]:
    """Lines of Python of each room, of modules beside them as `cfjax`, and outside the package."""
    count: Counter[str] = Counter()
    listed = subprocess.run(["git", "-C", str(HERE), "ls-files", "*.py"], capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        first, *rest = Path(name).parts
        room = rest[0] if first == "cfjax" and len(rest) > 1 else first
        count[room] += len((HERE / name).read_text(encoding="utf-8").splitlines())
    return dict(sorted(count.items()))


def timed(command: Sequence[str]) -> float:
    """Seconds of a command that succeeds."""
    begin = time.perf_counter()
    done = subprocess.run(command, cwd=HERE, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"scorecard: {' '.join(command)} ended with {done.returncode}\n{done.stdout[-2000:]}")
    return time.perf_counter() - begin


def measured(runs: int, long: Sequence[str]) -> dict[str, float]:
    """Seconds by column, the unit among them, and the size of the circle's certificate."""
    seconds: dict[str, list[float]] = {name: [] for name in TIMED}
    units = [unit()]
    with tempfile.TemporaryDirectory() as folder:
        side = Side("scorecard", HERE, Path(folder))
        for column, name in TIMED.items():
            job = JOBS[name]
            for number in range(runs + (not job.is_cold)):
                spent = side.measure(job, number)[""]
                if number or job.is_cold:  # the first one fills the cache
                    seconds[column].append(spent)
            units.append(unit())
        size = (side.scratch / "circle" / "certificate.json").stat().st_size / 1000
    own = statistics.median(units)
    figures = {name: statistics.median(each) / own for name, each in seconds.items()}
    figures |= {name: timed(LONG[name]) / own for name in long}
    return {"unit_s": own, **figures, "certificate_kB": size}


def rows() -> list[dict[str, str]]:
    if not TABLE.exists():
        return []
    with TABLE.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def worse(row: dict[str, str], before: Sequence[dict[str, str]]) -> list[str]:
    """Figures that are more than 10 % above the last row that has them, as text."""
    found = []
    for name in (*TIMED, *LONG, *COUNTED):
        last = next((old[name] for old in reversed(before) if old.get(name)), "")
        if last and row[name] and float(row[name]) > WORSE * float(last):
            found.append(f"{name} {last} -> {row[name]}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="runs of each job (3)")
    parser.add_argument("--tests", action="store_true", help="time scripts/test --all too")
    parser.add_argument("--ci", action="store_true", help="time .ci/run too")
    parser.add_argument("--reason", default="", help="why a figure is more than 10 %% worse than it was")
    parser.add_argument("--dry-run", action="store_true", help="print the row and add nothing")
    arguments = parser.parse_args()
    if arguments.runs < 1:
        parser.error(f"--runs: expected 1 or more, got {arguments.runs}")
    commit = ["git", "-C", str(HERE), "rev-parse", "--short=10", "HEAD"]
    head = subprocess.run(commit, capture_output=True, text=True, check=True).stdout.strip()
    rooms = lines_by_room()
    figures = measured(arguments.runs, [name for name in LONG if getattr(arguments, name)])
    figures["lines"] = sum(rooms.values())
    row = {name: f"{figures[name]:.4g}" if name in figures else "" for name in COLUMNS}
    row["lines"] = str(figures["lines"])
    row |= {"date": f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}", "commit": head, "reason": arguments.reason}
    before = rows()
    console = Console()
    table = Table("", "seconds", "of the unit", "before", title=f"unit {row['unit_s']} s", box=None)
    for name in (*TIMED, *LONG, *COUNTED):
        last = next((old[name] for old in reversed(before) if old.get(name)), "")
        seconds = f"{figures[name] * figures['unit_s']:.2f}" if name in figures and name not in COUNTED else ""
        table.add_row(name, seconds, row[name], last)
    console.print(table)
    console.print(_room_table(rooms))
    if found := worse(row, before):
        print(f"more than 10 % worse: {'; '.join(found)}", file=sys.stderr)
        if not arguments.reason:
            print("nothing was added: say why with --reason", file=sys.stderr)
            return 1
    if not arguments.dry_run:
        with TABLE.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows([*before, row])
    return 0


def _room_table(rooms: dict[str, int]) -> Table:
    table = Table("room", "lines", box=None)
    for room, count in rooms.items():
        table.add_row(room, str(count))
    return table


if __name__ == "__main__":
    sys.exit(main())
