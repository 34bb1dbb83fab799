"""Hints for what a certificate absorbs, changed: what the checker says of them."""

import copy
from collections.abc import Callable
from typing import Any

from cfcheck import Outcome, Report
from cfcheck.claims.document import document_hash
from cfcheck.replay import check_robustness


Change = Callable[[dict[str, Any]], object]


def answer_to(change: Change, report: Report, document: dict[str, Any], hints: dict[str, Any]) -> tuple[Outcome, str]:
    """Outcome and message for a changed copy of the hints with a hash of its own; `report` is the certificate's."""
    copied = copy.deepcopy(hints)
    change(copied)
    copied["hash"] = document_hash(copied)
    found = check_robustness(report, document, copied)
    return found.outcome, found.message
