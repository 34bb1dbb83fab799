"""What the checker answers."""

import enum
import textwrap
from dataclasses import dataclass, field

from flint import fmpq

from cfcheck.claims.proven import Proven, Shown
from cfcheck.path.bounds import Bounds
from cfcheck.robustness.amounts import ProvenRobustness
from cfcheck.statement import Section, sections


class Outcome(enum.Enum):
    """Value: the exit code of `python -m cfjax.check`."""

    PROVEN = 0  # the file proves a control funnel function
    BROKEN = 1  # a claim of the file is not proven by it
    UNREADABLE = 2  # no certificate, or none that this checker takes
    REFUTED = 3  # the file proves that a candidate is no control funnel function with its margin
    BOUNDED = 4  # the file proves that no control funnel function of a form has a margin


WIDTH, COLUMN = 110, 12  # characters: of a line, and of what stands before its text


def _wrapped(text: str, first: str, others: str) -> list[str]:
    return textwrap.wrap(
        text, WIDTH, initial_indent=first, subsequent_indent=others, break_long_words=False, break_on_hyphens=False
    )


@dataclass(frozen=True)
class Report:
    """The outcome, with what the file shows, or in one line why it shows nothing.

    What funnels absorb stands there where hints for it were beside the certificate. `sections` say all this in
    English (`cfcheck.statement`): they are written when the report is made, where the checker still refuses what
    it cannot do. The properties are figures of what is proven; where it has none of a kind they are None.
    """

    outcome: Outcome
    refusal: str = ""
    shown: Shown | None = field(default=None, repr=False)
    robustness: ProvenRobustness | None = None
    sections: tuple[Section, ...] = field(init=False)

    def __post_init__(self) -> None:
        said = () if self.shown is None else sections(self.shown, self.robustness)
        object.__setattr__(self, "sections", said)

    @property
    def paragraphs(self) -> tuple[str, ...]:
        """The sections in prose, one in a line; or why there are none."""
        return tuple(section.paragraph for section in self.sections) or (self.refusal,)

    @property
    def message(self) -> str:
        """The paragraphs in one line."""
        return " ".join(self.paragraphs)

    @property
    def text(self) -> str:
        """The same for a terminal: headings, each with a list of what is said, and lines that are not longer than one
        reads.
        """
        if not self.sections:
            return f"{self.outcome.name}: {self.refusal}"
        title, *others = self.sections
        lines = _wrapped(title.paragraph.removesuffix("."), "", "  ")
        for heading, clauses in others:
            for index, clause in enumerate(clauses):
                lines += _wrapped(clause, f"{'' if index else heading:<{COLUMN}}- ", " " * (COLUMN + 2))
        return "\n".join(lines)

    @property
    def proven(self) -> Proven | None:
        """What is proven, if anything is."""
        return self.shown if isinstance(self.shown, Proven) else None

    @property
    def margins(self) -> tuple[fmpq, ...]:
        """λ by leg, 1/s; none where no funnel is proven."""
        return self.proven.margins if self.proven else ()

    @property
    def bounds(self) -> tuple[Bounds | None, ...]:
        """Of the path along each leg, for all of which the law has to ask; None where the funnel changes with θ."""
        if self.proven is None or self.robustness is None:
            return ()
        return tuple(self.robustness.law_numbers[part.funnel].bounds for part in self.proven.claims.parts)

    @property
    def arrival(self) -> tuple[fmpq, fmpq] | None:
        """Earliest and latest, s; None where there is no end."""
        return self.proven.arrival if self.proven else None

    @property
    def margin_per_metre(self) -> fmpq | None:
        """Of a funnel for every path within bounds, 1/m of the reference."""
        return self.proven.margin_per_metre if self.proven else None

    @property
    def contraction(self) -> fmpq | None:
        """Metres of the reference within which such a funnel brings a car from V = 1 inside V ≤ β_in."""
        return self.proven.contraction if self.proven else None
