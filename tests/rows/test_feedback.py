"""What goes back from the certifier to the learner."""

import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.certificate import certify
from cfjax.conf import preset, problem_of
from cfjax.falsifier import falsify
from cfjax.falsifier.minimax import ridge_coordinates, spawn
from cfjax.funnel import TEMPLATES
from cfjax.funnel.conditions import decrease_margins, dual_coordinates
from cfjax.funnel.instance import chain_of, instance_of
from cfjax.learner import learn
from cfjax.learner.gradient import _include


def test_suspects_are_the_worst_points_and_reach_the_learner() -> None:
    problem = problem_of(preset("circle", ["method=tt"]))
    (segment,) = problem.path.segments
    template = TEMPLATES["paper"]
    learned = learn(problem, template)
    assert learned is not None
    found = certify(problem, [learned.funnel])
    (funnel,) = found.funnels
    counterexamples = np.array([counterexample.x for counterexample in found.counterexamples])
    instance, station = instance_of(problem, segment, template, funnel.beta_lower), np.zeros(len(counterexamples), int)
    w, s = dual_coordinates(instance, funnel, counterexamples, station)
    factor = jnp.linalg.cholesky(jnp.asarray(np.linalg.inv(funnel.shape)))
    rate = jnp.asarray(funnel.rate)
    points = map(jnp.asarray, (w, s, station))
    margins = decrease_margins(problem.vehicle, template, instance, factor, rate, *points)
    worst = {point.condition: point for point in falsify(problem, segment, funnel)}["d"]
    # the duals of the proof find without any search what the falsifier finds by searching
    assert float(margins.min()) == pytest.approx(worst.slack, rel=1e-3)

    chain = chain_of(problem, template, funnel.beta_lower)
    particles = spawn(np.random.default_rng(0), (2, 1, 128), ridge_coordinates(problem.vehicle, chain), 1)
    with_counterexamples = _include(particles, chain, (funnel,), found.counterexamples)
    np.testing.assert_allclose(with_counterexamples.points[1, 0, : len(w), :-1], w)
    assert (with_counterexamples.free[:, 0, : len(w)] == 1).all()
    np.testing.assert_array_equal(with_counterexamples.points[:, 0, len(w) :], particles.points[:, 0, len(w) :])
    again = learn(problem, template, warm=(funnel,), counterexamples=found.counterexamples)
    assert again is not None
    assert again.margin >= 0.99 * learned.margin
