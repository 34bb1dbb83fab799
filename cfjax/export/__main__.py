"""`python -m cfjax.export FOLDER`: the C99 controller of a certified run.

Exit code: 0 done; 2 bad input, one line on stderr.
"""

import argparse
import os
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m cfjax.export",
        description="Write the controller of a certified run as one C99 header and source.",
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="a run's folder")
    parser.add_argument("--output", metavar="DIR", type=Path, help="where to write; default: FOLDER/controller")
    parser.add_argument("--vehicle", metavar="module.Class", help="of a run of your own vehicle: its class")
    options = parser.parse_args(arguments)
    os.environ.setdefault("JAX_PLATFORMS", "cpu")  # before the first array

    from cfjax.errors import InputError
    from cfjax.export.controller import write_controller
    from cfjax.report.run_folder import read_run

    output = options.output or options.folder / "controller"
    try:
        written = write_controller(read_run(options.folder, options.vehicle), output)
    except InputError as error:
        message = str(error)
    except OSError as error:
        message = f"--output: cannot write to {output} ({error.strerror or error})"
    else:
        for path in written:
            print(path)
        return 0
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
