"""What the checker answers."""

import enum
from dataclasses import dataclass

from flint import fmpq

from cfjax.check.robustness import Robustness


class Outcome(enum.Enum):
    """Value: the exit code of `python -m cfjax.check`."""

    PROVEN = 0  # the file proves a control funnel function
    BROKEN = 1  # a claim of the file is not proven by it
    UNREADABLE = 2  # no certificate, or none that this checker takes
    REFUTED = 3  # the file proves that a candidate is no control funnel function with its margin


@dataclass(frozen=True)
class Report:
    """Outcome and message (one paragraph); for a proven funnel λ per segment (1/s) and when the car arrives (s).

    A tube has no arrival, but a margin per metre of the reference (1/m) and a way of the reference (m) within which
    inputs that reach it bring a car from V = 1 inside V ≤ β_in. What funnels absorb is told where hints for it were
    beside the certificate.
    """

    outcome: Outcome
    message: str
    margins: tuple[fmpq, ...] = ()
    arrival: tuple[fmpq, fmpq] | None = None  # earliest, latest
    margin_per_metre: fmpq | None = None
    contraction: fmpq | None = None
    robustness: Robustness | None = None
