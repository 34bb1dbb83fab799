"""How to look for a funnel: apart from the search itself, so that a configuration is checked before it is imported."""

from collections.abc import Callable
from dataclasses import dataclass

from cfjax.errors import InputError
from cfjax.funnel import Objective, template_named


CERTIFICATES = ("auto", "segment", "tube")
LEAST_BETA_LOWER = 0.05  # below, no funnel of the paper's template has room to shrink in

Progress = Callable[[str, int, int], None]  # (stage, done, of): called from the outside of compiled code


@dataclass(frozen=True)
class Options:
    """How to look for a funnel; the problem says for what."""

    template: str = "contracting"  # or "paper"
    certificate: str = "auto"  # "segment": funnels made for the path; "tube": tubes for all paths within its bounds
    learner: str = "gradient"
    objective: Objective = Objective()  # largest margin, or smallest width or largest inlet at a margin
    beta_lower: float = 0.9  # shell [beta_lower, 1] on which V has to decrease
    beta_inner: float | None = None  # V decreases down to here, at λ V / beta_lower; None: no further than beta_lower
    restarts: int = 4
    seed: int = 0
    rounds: int = 3  # of the learn–certify loop, at most
    cars: int = 10_000  # driven through the funnel; 0 for none

    def __post_init__(self) -> None:
        template_named(self.template)
        if self.certificate not in CERTIFICATES:
            raise InputError(f"certificate: expected one of {', '.join(CERTIFICATES)}, got {self.certificate}")
        if self.learner != "gradient":
            raise InputError(f"learner: expected gradient, got {self.learner}")
        if not LEAST_BETA_LOWER <= self.beta_lower < 1:
            raise InputError(
                f"beta_lower: expected a number of at least {LEAST_BETA_LOWER} and below 1, got {self.beta_lower}"
            )
        if self.beta_inner is not None and not 0 < self.beta_inner <= self.beta_lower:
            raise InputError(
                f"beta_inner: expected a number above 0 and at most beta_lower = {self.beta_lower}, "
                f"got {self.beta_inner}"
            )
        for name, least in (("restarts", 1), ("rounds", 1), ("cars", 0), ("seed", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name}: expected a whole number of at least {least}, got {getattr(self, name)}")
