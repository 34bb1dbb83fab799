"""How to look for a funnel: apart from the search itself, so that a configuration is checked before it is imported."""

from collections.abc import Callable
from dataclasses import dataclass

import cfjax.learner
from cfjax import funnel
from cfjax.coerce import flag, instance, keep, number, one_of, whole
from cfjax.errors import InputError
from cfjax.funnel import Objective
from cfjax.funnel.levels import inner_level
from cfjax.learner import learner_named, require_learner
from cfjax.learner.elimination import Elimination
from cfjax.solver import DEFAULT, SOLVERS
from cfjax.solver.cost import MOST_MEMORY


CERTIFICATES = ("auto", "segment", "tube")
LONGEST_PERIOD = 1.0  # s
LEAST_BETA_LOWER = 0.05  # below, no funnel of the paper's template has room to shrink in

Progress = Callable[[str, int, int], None]  # (stage, done, of): called from the outside of compiled code


@dataclass(frozen=True)
class ProofLimits:
    """What a proof may take (`cfjax.certificate.size` estimates it): a larger one is refused before learning.

    Args:
        memory: GB, of working memory; None: what is free.
        hours: h, that it takes by estimate.

    Raises:
        InputError: for numbers that are not positive and finite.
    """

    memory: float | None = None
    hours: float = 12.0

    def __post_init__(self) -> None:
        memory = None if self.memory is None else number("proof.memory", self.memory, "GB", above=0, most=MOST_MEMORY)
        keep(self, memory=memory, hours=number("proof.hours", self.hours, "h", above=0))


@dataclass(frozen=True)
class Options:
    """How to look for a funnel; the problem says for what.

    Args:
        template: "contracting", V = e^{kθ} xᵀCx, or "paper", V = xᵀCx + c₀θ.
        certificate: "segment", funnels made for the path; "tube", tubes for all paths within its bounds; "auto", what
            is cheaper.
        learner: "gradient"; or "polytope", the paper's own, by elimination from demonstrations; or a `Learner` itself.
        polytope: how that one looks.
        proof: what a proof may take.
        objective: the largest margin λ, or the smallest width or the largest inlet at a margin.
        beta_lower: level of V where the shell [beta_lower, 1] begins, on which V decreases at λ (1/s).
        beta_inner: level of V down to which V decreases below the shell, at λ V / beta_lower; None: beta_lower.
        restarts: from how many candidates the gradient learner starts.
        seed: of all random numbers.
        rounds: how often funnels are learned and certified, at most.
        solver: of the sums of squares: "batched", our own, or "clarabel", through CVXPY; either gives hints.
        robustness: whether control period, disturbances and delay that a certified funnel absorbs are proven too.
        period: s, for which the law that looks one hold ahead holds its inputs at most: proven too, of a path that is
            one straight line or one circle; None: not asked. A run is certified only if it is proven.
        delay: s, by which the poses that this law sees are old at most; with `period` only. None: they are not late.
        cars: how many are driven through a certified funnel.

    Raises:
        InputError: for values that are none of these.
    """

    template: str = "contracting"
    certificate: str = "auto"
    learner: "str | cfjax.learner.Learner" = cfjax.learner.DEFAULT
    polytope: Elimination = Elimination()
    proof: ProofLimits = ProofLimits()
    objective: Objective = Objective()
    beta_lower: float = 0.9
    beta_inner: float | None = None
    restarts: int = 4
    seed: int = 0
    rounds: int = 3
    solver: str = DEFAULT
    robustness: bool = True
    period: float | None = None
    delay: float | None = None
    cars: int = 10_000

    def __post_init__(self) -> None:
        funnel.template_named(self.template)
        one_of("certificate", self.certificate, CERTIFICATES)
        one_of("solver", self.solver, SOLVERS)
        require_learner(self.learner)
        instance("polytope", self.polytope, Elimination)
        instance("proof", self.proof, ProofLimits)
        instance("objective", self.objective, Objective)
        least = {"restarts": 1, "seed": 0, "rounds": 1, "cars": 0}
        keep(
            self,
            beta_lower=number("beta_lower", self.beta_lower, least=LEAST_BETA_LOWER, below=1),
            beta_inner=inner_level(self.beta_inner, self.beta_lower),
            robustness=flag("robustness", self.robustness),
            period=None if self.period is None else number("period", self.period, "s", above=0, most=LONGEST_PERIOD),
            delay=None if self.delay is None else number("delay", self.delay, "s", above=0, most=LONGEST_PERIOD),
            **{name: whole(name, getattr(self, name), bound) for name, bound in least.items()},
        )
        if self.period is not None and not self.robustness:
            raise InputError("period: expected robustness=true, with which it is proven, got robustness=false")
        if self.delay is not None and self.period is None:
            raise InputError(f"delay: expected a period too, got delay={self.delay:g} alone")
        if self.objective.margin is not None and not self.chosen_learner.objectives:
            name = self.chosen_learner.name
            raise InputError(f"objective: expected margin with learner={name}, got {self.objective.kind}")

    @property
    def chosen_learner(self) -> "cfjax.learner.Learner":
        """The learner itself, with those of the options that are its own."""
        return learner_named(self.learner, vars(self))
