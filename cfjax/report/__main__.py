"""`python -m cfjax.report FOLDER`: write report.html again for a run, or index.html and the reports of a sweep.

From what is on disk; with `--picture` the picture too. A certified run's certificate is replayed first, and a few cars
are driven again.

Exit code: 0 done; 2 bad input, one line on stderr.
"""

import argparse
import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from cfjax.result import Result


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m cfjax.report",
        description="Write the page of a run again, or the index page of a sweep and the pages of its runs.",
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="a run's folder or a sweep's")
    parser.add_argument("--vehicle", metavar="module.Class", help="of runs of your own vehicle: its class")
    parser.add_argument(
        "--picture", choices=("png", "svg", "pdf"), help="draw each run's picture again, in this format"
    )
    parser.add_argument(
        "--width",
        type=_width,
        help="of the pictures, for a paper: column (8.8 cm), page (18.1 cm), or cm; with --picture",
    )
    options = parser.parse_args(arguments)
    os.environ.setdefault("JAX_PLATFORMS", "cpu")  # before the first array

    from cfjax.errors import InputError
    from cfjax.report import page
    from cfjax.report.files import RESULT, holds_sweep

    folder, width = options.folder, options.width
    try:
        if width is not None and options.picture is None:
            raise InputError("--width: expected --picture png, svg or pdf with it")
        if (folder / RESULT).exists():
            written = _write(folder, options.vehicle, options.picture, width)
        elif holds_sweep(folder):
            runs = sorted(entry for entry in folder.iterdir() if (entry / RESULT).exists())
            written = [path for run in runs for path in _write(run, options.vehicle, options.picture, width)]
            written.append(page.write_index(folder))
        else:
            raise InputError(f"folder: expected a run's folder or a sweep's, got {folder}")
    except InputError as error:
        message = str(error)
    except OSError as error:
        message = f"folder: cannot write to {folder} ({error.strerror or error})"
    else:
        for path in written:
            print(path)
        return 0
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return 2


def _width(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def _write(folder: Path, vehicle: str | None, picture: str | None, width: str | float | None) -> list[Path]:
    """Raises InputError where the folder holds no run, or claims what the checker does not accept."""
    from cfjax.report.files import PICTURE, REPORT, write_beside
    from cfjax.report.page import save_page
    from cfjax.report.plot import save_picture
    from cfjax.report.run_folder import confirmed, read_run

    result = _with_cars(confirmed(read_run(folder, vehicle), folder), folder)
    written = [folder / REPORT]
    write_beside(save_page, result, folder / REPORT)
    if picture is not None:
        written.append((folder / PICTURE).with_suffix(f".{picture}"))
        write_beside(partial(save_picture, width=width), result, written[-1])
    return written


def _with_cars(result: "Result", folder: Path) -> "Result":
    """The result with a few recorded cars, where some were driven; what was counted of all of them stands."""
    from dataclasses import replace

    from cfjax.conf import options_of
    from cfjax.report.run_folder import read_config
    from cfjax.simulation.loop import RECORDED
    from cfjax.synthesis import drive

    if result.closed_loop is None:
        return result
    driven = drive(result, replace(options_of(read_config(folder)), cars=RECORDED))
    return result.replace(rollouts=driven.rollouts)


if __name__ == "__main__":
    sys.exit(main())
