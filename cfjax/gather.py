"""`python -m cfjax.gather SWEEP`: table and picture of a sweep, finished or still running.

Writes table.csv, table.parquet and margin.png into SWEEP/gathered, or where --output says. Exit code 2: the folder
holds no sweep; one line on stderr.
"""

import argparse
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m cfjax.gather", description="Table and picture of a sweep.")
    parser.add_argument("sweep", metavar="SWEEP", type=Path, help="a sweep's folder; it may still be running")
    parser.add_argument("--output", metavar="FOLDER", type=Path, help="default: SWEEP/gathered")
    options = parser.parse_args(arguments)

    from cfjax.report.files import holds_sweep

    sweep: Path = options.sweep
    if not holds_sweep(sweep):
        print(f"error: SWEEP: expected the folder of a sweep with at least one job, got {sweep}", file=sys.stderr)
        return 2
    from cfjax.report.sweep_plot import save_sweep_picture
    from cfjax.report.table import frame, gather, print_table, unfinished, write_frame

    output: Path = options.output or sweep / "gathered"
    rows = gather(sweep)
    try:
        output.mkdir(parents=True, exist_ok=True)
        table = frame(rows, sweep)
        written = write_frame(table, output)
        if picture := save_sweep_picture(table, output):
            written.append(picture)
    except OSError as error:
        print(f"error: --output: cannot write to {output} ({error.strerror})", file=sys.stderr)
        return 2
    print_table(rows)
    if open_jobs := unfinished(rows):
        print(f"{open_jobs} of the {len(rows)} jobs that were begun have no verdict")
    for path in written:
        print(path.resolve())
    return 0


if __name__ == "__main__":
    sys.exit(main())
