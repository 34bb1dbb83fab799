"""What the checker answers."""

import enum
from dataclasses import dataclass, field

from flint import fmpq

from cfjax.check.amounts import Robustness
from cfjax.check.proven import ProvenChain, ProvenFunnels, ProvenTube, Refuted, Shown
from cfjax.check.statement import paragraphs


class Outcome(enum.Enum):
    """Value: the exit code of `python -m cfjax.check`."""

    PROVEN = 0  # the file proves a control funnel function
    BROKEN = 1  # a claim of the file is not proven by it
    UNREADABLE = 2  # no certificate, or none that this checker takes
    REFUTED = 3  # the file proves that a candidate is no control funnel function with its margin


@dataclass(frozen=True)
class Report:
    """The outcome, with what the file shows, or in one line why it shows nothing.

    What funnels absorb stands there where hints for it were beside the certificate. `paragraphs` say all this in
    English (`cfjax.check.statement`): they are written when the report is made, where the checker still refuses what
    it cannot do. The properties are figures of what is proven; where it has none of a kind they are None.
    """

    outcome: Outcome
    refusal: str = ""
    shown: Shown | None = field(default=None, repr=False)
    robustness: Robustness | None = None
    paragraphs: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        said = (self.refusal,) if self.shown is None else paragraphs(self.shown, self.robustness)
        object.__setattr__(self, "paragraphs", said)

    @property
    def message(self) -> str:
        """The paragraphs in one line."""
        return " ".join(self.paragraphs)

    @property
    def margins(self) -> tuple[fmpq, ...]:
        """λ by segment, or by stretch in one tube, 1/s; none where no funnel is proven."""
        return () if self.shown is None or isinstance(self.shown, Refuted) else self.shown.margins

    @property
    def arrival(self) -> tuple[fmpq, fmpq] | None:
        """Earliest and latest, s; None of a tube, which has no end."""
        return self.shown.arrival if isinstance(self.shown, ProvenFunnels | ProvenChain) else None

    @property
    def margin_per_metre(self) -> fmpq | None:
        """Of a tube, 1/m of the reference."""
        return self.shown.margin_per_metre if isinstance(self.shown, ProvenTube) else None

    @property
    def contraction(self) -> fmpq | None:
        """Metres of the reference within which a tube brings a car from V = 1 inside V ≤ β_in."""
        return self.shown.contraction if isinstance(self.shown, ProvenTube) else None
