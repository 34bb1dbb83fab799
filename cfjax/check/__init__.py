"""The checker: replays a proof in exact arithmetic.

Rationals and arb balls (python-flint) only. Nothing in this room imports JAX, CVXPY, NumPy or any other room of the
package, and no floating-point number takes part in a decision. The certifier uses the same exact objects to build what
is replayed here. `docs/certificate-format.md` says how to write another checker.
"""

from cfjax.check.replay import check_document, check_file
from cfjax.check.report import Outcome, Report


__all__ = ["Outcome", "Report", "check_document", "check_file"]
