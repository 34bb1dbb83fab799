"""From a candidate to a certificate: sums of squares as the oracle, exact arithmetic as the judge."""

from cfjax.certificate.certifier import Certification, Statement, certify, statement_of
from cfjax.certificate.posed import require_posable
from cfjax.certificate.refuter import refute
from cfjax.certificate.robustness import robustness_of
from cfjax.certificate.size import proof_size, require_room
from cfjax.certificate.writing import dump


__all__ = [
    "Certification",
    "Statement",
    "certify",
    "dump",
    "proof_size",
    "refute",
    "require_posable",
    "require_room",
    "robustness_of",
    "statement_of",
]
