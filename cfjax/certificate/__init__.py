"""From a candidate to a certificate: sums of squares as the oracle, exact arithmetic as the judge."""

from cfjax.certificate.certifier import Certification, certify, statement_of
from cfjax.certificate.refuter import refute
from cfjax.certificate.robustness import robustness_of
from cfjax.certificate.writing import dump


__all__ = ["Certification", "certify", "dump", "refute", "robustness_of", "statement_of"]
