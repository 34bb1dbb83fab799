"""How long the main job takes, and on what: a table, no test.

    .venv/bin/python scripts/benchmark.py [--runs 3] [key=value …]

Every run is a process of its own, by default of +path=circle: cold with an empty compilation cache, warm with a full
one. Medians; "compiling" is what JAX reports as tracing, lowering and compiling (or loading from the cache), wherever
it happens; the stages are those of result.json and hold their share of it. Memory is the peak of the resident set.
"""

import argparse
import contextlib
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table


REPORT = "CFJAX_BENCHMARK_REPORT"  # where a child writes its figures
COMPILING = ("jaxpr_trace_duration", "jaxpr_to_mlir_module_duration", "backend_compile_duration")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="runs of each kind (3)")
    parser.add_argument("overrides", nargs="*", help="of cfjax.train (+path=circle)")
    arguments = parser.parse_args()
    overrides = arguments.overrides or ["+path=circle"]
    cold: list[dict[str, float]] = []
    warm: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        for run in range(arguments.runs):
            cache = Path(folder, f"cache{run}")
            for kind, figures in (("cold", cold), ("warm", warm)):
                figures.append(measure(overrides, cache, Path(folder, f"{kind}{run}")))
                print(f"{kind} {run + 1} of {arguments.runs}: {figures[-1]['total']:.1f} s", file=sys.stderr)
    table = Table("", "cold", "warm", title=f"{' '.join(overrides)}, medians of {arguments.runs}", box=None)
    for name in dict.fromkeys([name for figures in cold + warm for name in figures]):
        unit = "MB" if name == "peak memory" else "s"
        values = [statistics.median(figures.get(name, 0.0) for figures in kind) for kind in (cold, warm)]
        table.add_row(name, *(f"{value:.1f} {unit}" for value in values))
    Console().print(table)
    return 0


def measure(overrides: list[str], cache: Path, folder: Path) -> dict[str, float]:
    """Seconds per stage and MB of one run in a new process."""
    report = folder.with_suffix(".json")
    package = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": package, "JAX_COMPILATION_CACHE_DIR": str(cache), REPORT: str(report)}
    command = [sys.executable, __file__, *overrides, f"hydra.run.dir={folder}"]
    begin = time.perf_counter()
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    total = time.perf_counter() - begin
    if done.returncode not in (0, 1) or not report.exists():
        raise SystemExit(f"benchmark: the run failed with {done.returncode}\n{done.stderr}")
    child = json.loads(report.read_text())
    stages = json.loads((folder / "result.json").read_text())["seconds"]
    stages.pop("total", None)
    return {
        "imports": child["imports"],
        "compiling": child["compiling"],
        **stages,
        "total": total,
        "peak memory": child["peak"],
    }


def child(report: Path) -> int:
    """One run of the command in this process, with the figures that only it knows."""
    begin = time.perf_counter()
    import cfjax.train

    cfjax.train.prepare_environment()
    with contextlib.suppress(ImportError):  # everything that a run imports, but for what it computes
        import cfjax.conf
        import cfjax.report.plot
        import cfjax.synthesis
    import jax

    imports = time.perf_counter() - begin
    spent: list[float] = []

    def listen(event: str, duration_secs: float, **kwargs: str | int) -> None:
        if event.rpartition("/")[2] in COMPILING:
            spent.append(duration_secs)

    jax.monitoring.register_event_duration_secs_listener(listen)
    code = cfjax.train.main()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # KiB on Linux
    report.write_text(json.dumps({"imports": imports, "compiling": sum(spent), "peak": peak}))
    return code


if __name__ == "__main__":
    sys.exit(child(Path(os.environ.pop(REPORT))) if REPORT in os.environ else main())
