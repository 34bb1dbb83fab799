"""From a candidate to a certificate: sums of squares as the oracle, exact arithmetic as the judge."""

from cfjax.certificate.certifier import Certification, certify, statement_of
from cfjax.certificate.posed import require_posable
from cfjax.certificate.refuter import refute
from cfjax.certificate.robustness import robustness_of
from cfjax.certificate.writing import dump


__all__ = ["Certification", "certify", "dump", "refute", "require_posable", "robustness_of", "statement_of"]
