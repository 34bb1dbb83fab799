"""What is sought beside a proof: the largest margin, or the narrowest or widest funnel that has a margin asked for.

The margin that can be had is the larger, the wider the funnel may be and the smaller I is. So the two other objectives
are searches along one number, by bisection, each step a `learn` that starts from the best funnel so far.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cfjax.coerce import number, objects, refuse
from cfjax.funnel import LATERAL, Funnel, Objective, Template, lateral_half_width
from cfjax.learner.gradient import Learned, learn
from cfjax.problem import Box, Ellipsoid, Problem


STEPS = 8  # of a bisection
CLOSE = 1.003  # ratio of its ends at which it stops
NO_LIMIT = 1e6  # half-width of a box that bounds nothing
WIDEST_INLET = 16.0  # times the I asked for, at most


def learn_for(
    objective: Objective,
    target: float | None,
    problem: Problem,
    template: Template,
    *,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> tuple[Problem, Learned | None]:
    """The funnels that are best for the objective at a falsified margin of `target` (1/s), and the problem it solves.

    The problem is the one given but for `inlet`, which enlarges I. Where the target is out of reach the funnel of the
    largest margin comes back. `options` are those of `cfjax.learner.gradient.learn`.

    Raises:
        InputError: for a target with an objective that has none.
    """
    objects(objective=(objective, Objective), problem=(problem, Problem), template=(template, Template))
    target = None if target is None else number("target", target, "1/s", above=0)
    if target is not None and objective.kind == "margin":
        refuse("target", "None with objective=margin, which seeks the largest", target)
    report = progress or (lambda done, of: None)
    steps = 0 if target is None else STEPS
    first = learn(problem, template, progress=lambda done, of: report(done, of + steps), **options)
    if target is None or first is None or first.margin < target:
        return problem, first
    options = {name: value for name, value in options.items() if name not in ("warm", "counterexamples")}
    if objective.kind == "width":
        low, high = problem.inlet.half_axes[LATERAL], _lateral(first)
    else:
        low, high = 1.0, _most(problem)
    best = problem, first
    for step in range(STEPS):
        if high / low < CLOSE:
            break
        middle = math.sqrt(low * high)
        posed = _narrowed(problem, middle) if objective.kind == "width" else _widened(problem, middle)
        found = learn(posed, template, warm=best[1].funnels, tracking=False, **options)
        good = found is not None and found.margin >= target
        if found is not None and good:
            best = (problem if objective.kind == "width" else posed), found
        if objective.kind == "width":
            low, high = (low, min(middle, _lateral(best[1]))) if good else (middle, high)
        else:
            low, high = (middle, high) if good else (low, middle)
        report(step + 1, STEPS)
    return best


def rank(objective: Objective, problem: Problem, funnels: Sequence[Funnel], margin: float) -> tuple[float, ...]:
    """Larger is better: for funnels of the problem with that least certified margin (1/s, 0 for none)."""
    if objective.margin is None or margin < objective.margin:
        return 0.0, margin
    width = max(map(lateral_half_width, funnels))
    return 1.0, -width if objective.kind == "width" else problem.inlet.half_axes[0]


def _lateral(learned: Learned) -> float:
    return max(map(lateral_half_width, learned.funnels))


def _narrowed(problem: Problem, half_width: float) -> Problem:
    """The same with a lateral limit; a search's own, which nobody has to prove."""
    limits = list(problem.safe.half_widths if problem.safe else (NO_LIMIT,) * problem.dimension)
    limits[LATERAL] = min(limits[LATERAL], half_width)
    return replace(problem, safe=Box(tuple(limits)))


def _widened(problem: Problem, scale: float) -> Problem:
    return replace(problem, inlet=Ellipsoid(tuple(scale * axis for axis in problem.inlet.half_axes)))


def _most(problem: Problem) -> float:
    """A scale of I at which it is no question any more: I would reach G (of a tube), S or the wrap of the heading."""
    inlet = np.array(problem.inlet.half_axes)
    limits = [np.array(problem.safe.half_widths) / inlet] if problem.safe else []
    if problem.path.tube:
        limits.append(np.array(problem.goal_axes) / inlet)
    limits.append(np.array([math.pi / inlet[0], WIDEST_INLET]))
    return float(min(limit.min() for limit in limits)) * (1 - 1e-6)
