"""The checker: replays a proof in exact arithmetic.

Rationals and arb balls (python-flint) only. Nothing here imports JAX, CVXPY, NumPy or `cfjax`, and no floating-point
number takes part in a decision. The certifier uses the same exact objects to build what is replayed here.
`docs/certificate-format.md` says how to write another checker.
"""

from cfcheck.replay import check_document, check_file
from cfcheck.report import Outcome, Report


__all__ = ["Outcome", "Report", "check_document", "check_file"]
