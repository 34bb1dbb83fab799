"""`python -m cfjax.check RUN_OR_CERTIFICATE`: replay a certificate.

Exit code 0: it proves a funnel; 3: it proves a refutation; 4: it proves an upper bound of the margin; 1: a claim is
broken; 2: it cannot be read.
"""

import argparse
import os
import sys

from cfcheck.replay import check_file


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m cfjax.check", description="Replay a certificate exactly.")
    parser.add_argument("path", metavar="RUN_OR_CERTIFICATE", help="a run's folder or a certificate.json")
    parser.add_argument("--skip-hash", action="store_true", help="replay a file whose hash does not fit its content")
    options = parser.parse_args(arguments)
    report = check_file(options.path, options.skip_hash)
    try:
        print(report.text.encode("ascii", "backslashreplace").decode(), flush=True)
    except BrokenPipeError:  # whoever read it has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return report.outcome.value


if __name__ == "__main__":
    sys.exit(main())
