"""The closed-form law against a quadratic-programming solver, and against what it promises."""

import cvxpy as cp
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.control import MinNorm, law_numbers, nearest_in_box
from cfjax.funnel import TEMPLATES, Funnel
from cfjax.problem import Box, Method, Problem, affine_deviation, circle


def by_solver(b, excess, centre, lower, upper, softness):
    v, slack = cp.Variable(len(b)), cp.Variable()
    half = (upper - lower) / 2
    moved = [(v[i] - centre[i]) / half[i] for i in range(len(b)) if half[i] > 0]
    cost = cp.sum_squares(cp.hstack(moved)) + (cp.square(slack) / softness if softness else 0)
    limits = [v >= lower, v <= upper, b @ (v - centre) + excess <= (slack if softness else 0)]
    problem = cp.Problem(cp.Minimize(cost), limits)
    problem.solve(solver=cp.CLARABEL)
    return v.value if problem.status == "optimal" else None


@pytest.mark.parametrize("softness", [0.0, 0.7])
@pytest.mark.parametrize("fixed_timing", [False, True])
def test_nearest_in_box_is_the_quadratic_program(softness: float, fixed_timing: bool) -> None:
    rng = np.random.default_rng(1)
    solved = infeasible = 0
    nearest = jax.jit(lambda b, *rest: jnp.stack(nearest_in_box(tuple(b), *rest)))
    for _ in range(120):
        lower, upper = np.array([0.5, -1.0, -4.0]), np.array([2.0, 1.0, 4.0])
        if fixed_timing:
            lower[0] = upper[0] = 1.0
        centre = np.array([1.0, rng.uniform(-1, 1), rng.uniform(-4, 4)])
        b = rng.normal(size=3) * rng.choice([0.0, 1.0, 3.0], size=3)
        excess = rng.normal() * 4
        got = np.asarray(nearest(b, excess, centre, lower, upper, softness))
        assert (got >= lower).all() and (got <= upper).all()
        expected = by_solver(b, excess, centre, lower, upper, softness)
        if expected is None:  # nothing in the box does it: then the vertex that comes closest
            infeasible += 1
            best = np.where(b > 0, lower, np.where(b < 0, upper, got))
            np.testing.assert_allclose(b @ got, b @ best, atol=1e-9)
        else:
            solved += 1
            np.testing.assert_allclose(got, expected, atol=2e-4)
            if not softness:
                assert b @ (got - centre) + excess <= 1e-9
    assert solved > 60
    assert infeasible > 5 or softness > 0


@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize("template", TEMPLATES.values(), ids=lambda t: t.name)
def test_law_decreases_wherever_some_input_does(template, method: Method) -> None:
    problem = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)), method=method)
    segment = problem.path.segments[0]
    root = np.random.default_rng(3).normal(size=(4, 4)) * 0.3 + 1.8 * np.eye(4)
    funnel = Funnel(template, root @ root.T, 0.05, segment.duration)
    margin = 0.4  # of no proof: the law has to reach it wherever the box can
    law = law_numbers(problem, funnel, margin)
    point = segment.point(0.0)
    rng = np.random.default_rng(4)
    act = jax.jit(lambda theta, x: jnp.stack(MinNorm()(problem.vehicle, template, law, point, theta, tuple(x))))
    dynamics = jax.jit(lambda x: affine_deviation(problem.vehicle, x, point))
    reached = 0
    for _ in range(300):
        theta = rng.uniform(0, segment.duration)
        x = rng.normal(size=4)
        value = rng.uniform(funnel.beta_lower, 1.0)
        scale, rate = float(template.scale(0.05, theta)), 0.05
        level = float(template.level(rate, theta)) - (1 - value) / scale  # the q at which V = value
        x = x * np.sqrt(level / funnel.form(x))
        drift, columns = dynamics(x)
        gradient = 2 * funnel.shape @ x
        b = gradient @ np.asarray(columns)
        b[0] += float(template.timing(rate, level))
        lower, upper = np.asarray(law.lower), np.asarray(law.upper)
        best = scale * (gradient @ np.asarray(drift) + np.minimum(b * lower, b * upper).sum())
        v = np.asarray(act(theta, jnp.asarray(x)))
        got = scale * (gradient @ np.asarray(drift) + b @ v)
        assert (v >= lower).all() and (v <= upper).all()
        assert got <= max(best, -float(law.decrease)) + 1e-9
        reached += best <= -float(law.decrease)
    assert reached > 100


def test_law_holds_the_reference() -> None:
    problem = Problem(circle())
    segment = problem.path.segments[0]
    for template in TEMPLATES.values():
        funnel = Funnel(template, 3 * np.eye(4), 0.02, segment.duration)
        law = law_numbers(problem, funnel, 0.5)
        v = MinNorm()(problem.vehicle, template, law, segment.point(0.0), 1.0, (0.0,) * 4)
        np.testing.assert_allclose(v, problem.feedforward(segment.point(0.0)), atol=1e-12)
