"""The learner by gradients (`cfjax.learner.gradient`), for every path, tube and objective."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from cfjax.learner.learner import Found, LearningTask
from cfjax.learner.objective import learn_for


@dataclass(frozen=True)
class ByGradient:
    """Candidates with the largest margin, by gradients.

    Args:
        candidates: that each round starts from.
        rounds: of the learn–certify loop, at most: a later one starts from the points that stood in the way of a proof.
    """

    candidates: int = 4
    rounds: int = 3
    name: ClassVar[str] = "gradient"
    tubes: ClassVar[bool] = True
    chains: ClassVar[bool] = True
    objectives: ClassVar[bool] = True

    def learn(self, task: LearningTask, progress: Callable[[int, int], None] | None = None) -> Found:
        """The best funnels for the objective; None where no candidate satisfies (a), (b) and (c)."""
        problem, learned = learn_for(
            task.objective,
            task.target,
            task.problem,
            task.template,
            beta_lower=task.beta_lower,
            beta_inner=task.beta_inner,
            candidates=self.candidates,
            seed=task.seed,
            warm=task.warm,
            counterexamples=task.counterexamples,
            progress=progress,
        )
        figures = {"candidates": self.candidates, "steps": learned.steps if learned else 0}
        return Found(problem, learned, "no candidate was found that satisfies (a), (b) and (c)", figures)
