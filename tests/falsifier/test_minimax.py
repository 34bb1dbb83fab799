"""The minimax search of candidates and particles."""

import numpy as np

from cfjax.falsifier.minimax import MinimaxResult, Particles, Schedule, minimax, spawn
from cfjax.funnel import TEMPLATES
from cfjax.funnel.instance import Unit, chain_of
from cfjax.problem import Box, Problem, circle


def test_candidates_do_not_depend_on_each_other() -> None:
    """However many there are, and in whatever shares they are run."""
    template, problem = TEMPLATES["contracting"], Problem(circle(), safe=Box((1, 1, 1, 3)))
    chain = chain_of(problem, template, 0.9, None, Unit.BALANCED)
    rng = np.random.default_rng(0)
    factor = 0.2 * np.eye(4) + 0.02 * np.tril(rng.normal(size=(4, 1, 4, 4)))
    change = np.full((4, 1), 0.5)
    particles = spawn(rng, (4, 1, 128), np.zeros(4), chain.funnels.begin.shape[1])
    schedule = Schedule(steps=30, learning_rate=(0.05, 0.01), temperature=(0.1, 0.01))

    def of(*which: int) -> MinimaxResult:
        own = list(which)
        some = Particles(*(each[own] for each in particles))
        return minimax(problem.vehicle, template, chain, schedule, np.ones(len(own)), factor[own], change[own], some)

    together, alone = of(0, 1, 2, 3), [of(k) for k in range(4)]
    for field in ("factor", "change", "margins"):
        found = np.concatenate([getattr(each, field) for each in alone])
        np.testing.assert_allclose(getattr(together, field), found, rtol=1e-8, atol=1e-10)
    assert len({float(margin) for margin in together.margins.min(axis=(1, 2))}) == 4
