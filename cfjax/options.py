"""How to look for a funnel: apart from the search itself, so that a configuration is checked before it is imported."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cfjax.errors import InputError
from cfjax.funnel import Objective, template_named
from cfjax.solver import DEFAULT, SOLVERS


if TYPE_CHECKING:
    from cfjax.problem import Problem


CERTIFICATES = ("auto", "segment", "tube")
LEARNERS = ("gradient", "polytope")
CENTRES = ("mve", "analytic", "chebyshev")
DEMONSTRATIONS = ("mpc", "revised")
LEAST_BETA_LOWER = 0.05  # below, no funnel of the paper's template has room to shrink in
LARGEST_SEED = 2**32 - 1  # that all generators of random numbers take

Progress = Callable[[str, int, int], None]  # (stage, done, of): called from the outside of compiled code


@dataclass(frozen=True)
class Elimination:
    """How learner=polytope looks (`cfjax.learner.polytope`)."""

    margin: float = 0.05  # 1/s, that is asked for first
    climb: bool = True  # ask for more from a funnel that was found, until no room is left
    centre: str = "mve"  # of the maximum-volume ellipsoid; or analytic, chebyshev
    batch: int = 8  # counterexamples that answer one candidate, at most
    demonstrations: str = "mpc"  # or "revised": those too, but chosen anew after every candidate
    delta: float = 0.01  # radius of the ball of coefficients that has to be left; C in half-axes of I, Frobenius norm

    def __post_init__(self) -> None:
        if not 0 < self.margin < float("inf"):
            raise InputError(f"polytope.margin: expected a positive finite number (1/s), got {self.margin}")
        if self.centre not in CENTRES:
            raise InputError(f"polytope.centre: expected one of {', '.join(CENTRES)}, got {self.centre}")
        if self.batch < 1:
            raise InputError(f"polytope.batch: expected a whole number of at least 1, got {self.batch}")
        if self.demonstrations not in DEMONSTRATIONS:
            raise InputError(
                f"polytope.demonstrations: expected one of {', '.join(DEMONSTRATIONS)}, got {self.demonstrations}"
            )
        if not 0 < self.delta < 1:
            raise InputError(f"polytope.delta: expected a number between 0 and 1, got {self.delta}")

    @property
    def revise(self) -> bool:
        """Whether demonstrations are chosen anew after every candidate."""
        return self.demonstrations == "revised"


@dataclass(frozen=True)
class ProofLimits:
    """What a proof may take (`cfjax.certificate.size` estimates it): a larger one is refused before learning."""

    memory: float | None = None  # GB; None: what is free
    hours: float = 12.0

    def __post_init__(self) -> None:
        if self.memory is not None and not 0 < self.memory < float("inf"):
            raise InputError(f"proof.memory: expected a positive finite number (GB) or null, got {self.memory}")
        if not 0 < self.hours < float("inf"):
            raise InputError(f"proof.hours: expected a positive finite number (h), got {self.hours}")


@dataclass(frozen=True)
class Options:
    """How to look for a funnel; the problem says for what."""

    template: str = "contracting"  # or "paper"
    certificate: str = "auto"  # "segment": funnels made for the path; "tube": tubes for all paths within its bounds
    learner: str = "gradient"  # or "polytope": the paper's own, by elimination from demonstrations
    polytope: Elimination = Elimination()
    proof: ProofLimits = ProofLimits()
    objective: Objective = Objective()  # largest margin, or smallest width or largest inlet at a margin
    beta_lower: float = 0.9  # shell [beta_lower, 1] on which V has to decrease
    beta_inner: float | None = None  # V decreases down to here, at λ V / beta_lower; None: no further than beta_lower
    restarts: int = 4
    seed: int = 0
    rounds: int = 3  # of the learn–certify loop, at most
    solver: str = DEFAULT  # of the sums of squares: "batched", or "clarabel" (CVXPY)
    robustness: bool = True  # what a certified funnel absorbs is proven too
    cars: int = 10_000  # driven through the funnel; 0 for none

    def __post_init__(self) -> None:
        template_named(self.template)
        if self.certificate not in CERTIFICATES:
            raise InputError(f"certificate: expected one of {', '.join(CERTIFICATES)}, got {self.certificate}")
        if self.solver not in SOLVERS:
            raise InputError(f"solver: expected one of {', '.join(SOLVERS)}, got {self.solver}")
        if self.learner not in LEARNERS:
            raise InputError(f"learner: expected one of {', '.join(LEARNERS)}, got {self.learner}")
        if self.learner == "polytope" and self.objective.margin is not None:
            raise InputError(f"objective: expected margin with learner=polytope, got {self.objective.kind}")
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
        if self.seed > LARGEST_SEED:
            raise InputError(f"seed: expected a whole number of at most {LARGEST_SEED}, got {self.seed}")


def check_question(problem: "Problem", options: Options) -> None:
    """What problem and options are good for by themselves but not together.

    Raises:
        InputError: names the option that does not go with the path.
    """
    path = problem.path
    if options.certificate == "tube" and not path.tube and problem.authority != 1:
        raise InputError(f"authority: expected 1 for a path that tubes hold, got {problem.authority:g}")
    if options.certificate == "tube" and options.template != "contracting":
        raise InputError(f"template: expected contracting with certificate=tube, got {options.template}")
    if options.learner == "polytope":
        if options.certificate == "tube":
            raise InputError("certificate: expected auto or segment with learner=polytope, got tube")
        if path.tube:
            raise InputError("learner=polytope: expected a path, got a tube")
        if len(path.distinct) > 1:
            raise InputError(
                f"learner=polytope: expected one distinct segment, got {len(path.distinct)}: its coefficients are "
                "those of one funnel"
            )
