"""The learner by elimination (`cfjax.learner.polytope`), with demonstrations by model-predictive control."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cfjax.demonstrator import demonstrate
from cfjax.learner.elimination import Elimination
from cfjax.learner.learner import Found, LearningTask
from cfjax.learner.polytope import learn_polytope
from cfjax.problem import Problem


@dataclass(frozen=True)
class ByElimination:
    """The funnel that elimination leaves. It ends with an answer: there is nothing to start a second round from."""

    how: Elimination = Elimination()
    name: ClassVar[str] = "polytope"
    rounds: ClassVar[int] = 1
    tubes: ClassVar[bool] = False
    chains: ClassVar[bool] = False
    objectives: ClassVar[bool] = False

    def learn(self, task: LearningTask, progress: Callable[[int, int], None] | None = None) -> Found:
        """A funnel of the margin that `how` asks for, or what was shown in looking for it.

        Raises:
            InputError: see `learn_polytope`.
        """
        found = learn_polytope(
            task.problem,
            task.template,
            self.how,
            beta_lower=task.beta_lower,
            beta_inner=task.beta_inner,
            demonstrate=lambda theta, x: self._demonstrated(task.problem, theta, x),
            seed=task.seed,
            progress=progress,
        )
        figures = {"runs": [run.figures() for run in found.runs], "shown": found.message}
        return Found(task.problem, found.learned, found.message, figures)

    def _demonstrated(self, problem: Problem, theta: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Inputs (k, 1 + m) at θ (k,), s, and deviations (k, n), solved in batches of one size."""
        same = np.arange(self.how.batch) % len(x)  # each number of problems would be compiled for itself
        return np.asarray(demonstrate(problem, x[same], theta[same]).inputs)[: len(x)]
