"""A learner: from a problem to candidate funnels with a falsified margin. Nothing that it says is proven.

What differs between learners are attributes of theirs. Nobody asks for a learner's name to know what it can do.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from cfjax.falsifier.falsifier import Counterexample
from cfjax.funnel import Funnel, Objective, Template
from cfjax.learner.gradient import Learned
from cfjax.problem import Problem


@dataclass(frozen=True)
class LearningTask:
    """What a learner is asked for in one round of the learn–certify loop.

    Args:
        problem: whose funnels are looked for.
        template: the family of V.
        beta_lower: V decreases at λ (1/s) on the shell [beta_lower, 1]; a level of V.
        beta_inner: the level down to which V decreases in proportion; None: no further than beta_lower.
        objective: what is best.
        target: falsified margin (1/s) that an objective with a margin needs; None for the largest margin.
        seed: of everything that is drawn.
        warm: the last round's funnels, one for each distinct segment, to start from.
        counterexamples: deviations at which the last round's proof fell short.
    """

    problem: Problem
    template: Template
    beta_lower: float = 0.9
    beta_inner: float | None = None
    objective: Objective = Objective()
    target: float | None = None
    seed: int = 0
    warm: tuple[Funnel, ...] | None = None
    counterexamples: tuple[Counterexample, ...] = ()


@dataclass(frozen=True)
class Found:
    """What a learner found: candidates, or None with a reason (one line).

    `problem` is the one that the candidates solve: objective=inlet enlarges I. `figures` go into result.json; those of
    several rounds are added up where they are whole numbers.
    """

    problem: Problem
    learned: Learned | None
    reason: str
    figures: dict[str, Any]


@runtime_checkable
class Learner(Protocol):
    """From a task to candidate funnels.

    `rounds` of the learn–certify loop are worth their time, at most. `tubes`: it learns a funnel for every path within
    bounds. `chains`: it learns paths of several distinct segments. `objectives`: it serves those that have a margin.
    """

    @property
    def name(self) -> str: ...

    @property
    def rounds(self) -> int: ...

    @property
    def tubes(self) -> bool: ...

    @property
    def chains(self) -> bool: ...

    @property
    def objectives(self) -> bool: ...

    def learn(self, task: LearningTask, progress: Callable[[int, int], None] | None = None) -> Found:
        """Candidates for the task; `progress(done, of)` hears how far it is.

        Raises:
            InputError: the problem is none for this learner.
        """
        ...
