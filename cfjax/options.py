"""How to look for a funnel: apart from the search itself, so that a configuration is checked before it is imported."""

from collections.abc import Callable
from dataclasses import dataclass

from cfjax.errors import InputError
from cfjax.funnel import template_named


LEAST_BETA_LOWER = 0.05  # below, no funnel of the paper's template has room to shrink in

Progress = Callable[[str, int, int], None]  # (stage, done, of): called from the outside of compiled code


@dataclass(frozen=True)
class Options:
    """How to look for a funnel; the problem says for what."""

    template: str = "contracting"  # or "paper"
    learner: str = "gradient"
    beta_lower: float = 0.9  # shell [beta_lower, 1] on which V has to decrease
    restarts: int = 4
    seed: int = 0
    rounds: int = 3  # of the learn–certify loop, at most
    cars: int = 10_000  # driven through the funnel; 0 for none

    def __post_init__(self) -> None:
        template_named(self.template)
        if self.learner != "gradient":
            raise InputError(f"learner: expected gradient, got {self.learner}")
        if not LEAST_BETA_LOWER <= self.beta_lower < 1:
            raise InputError(
                f"beta_lower: expected a number of at least {LEAST_BETA_LOWER} and below 1, got {self.beta_lower}"
            )
        for name, least in (("restarts", 1), ("rounds", 1), ("cars", 0), ("seed", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name}: expected a whole number of at least {least}, got {getattr(self, name)}")
