"""`python -m cfjax.check RUN_OR_CERTIFICATE`, and the checker's public names: a door to `cfcheck`."""

import sys

from cfcheck import Outcome, Report, check_document, check_file
from cfcheck.__main__ import main


__all__ = ["Outcome", "Report", "check_document", "check_file"]


if __name__ == "__main__":
    sys.exit(main())
