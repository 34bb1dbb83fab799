"""The fast falsifier against a slow, obvious one."""

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from scipy.optimize import minimize

from cfjax.falsifier import falsify
from cfjax.funnel import TEMPLATES, Funnel
from cfjax.problem import Box, Method, Problem, circle, straight


CASES = [
    (path, method, template)
    for path in (circle(), circle(speed=np.pi), straight(4.0))
    for method in Method
    for template in TEMPLATES.values()
]


Margin = Callable[[float, np.ndarray], float]


def slow_margin(problem: Problem, funnel: Funnel) -> Margin:
    """The bicycle's V̇ of the paper, written out once more, minimised over all vertices of the input box; negated.

    A function of θ and x. What it needs of the problem is asked for once: it is called half a million times.
    """
    point, timing = problem.path.segments[0].point(0.0), problem.inputs[0]
    speed, omega = point.speed, point.turn_rate
    shape, decay, paper = funnel.shape, funnel.rate, funnel.template.name == "paper"
    u0, w, thrust = (
        np.array(each) for each in zip(*product((timing.lower, timing.upper), (-1, 1), (-4, 4)), strict=True)
    )

    def margin(theta: float, x: np.ndarray) -> float:
        alpha, px, py, v = x
        gradient = 2 * x @ shape
        change = gradient[0] * ((v + speed) / 0.34 * w - omega * u0)
        change += gradient[1] * (-(v + speed) * np.sin(alpha) + omega * u0 * py)
        change += gradient[2] * ((v + speed) * np.cos(alpha) - speed * u0 - omega * u0 * px)
        change += gradient[3] * thrust
        if paper:
            change += decay * u0
        else:
            change = np.exp(decay * theta) * (change + decay * u0 * (x @ shape @ x))
        return -change.min()

    return margin


def slow_search(margin: Margin, funnel: Funnel, starts: int) -> float:
    """Smallest margin by Nelder–Mead from random points of the shell in (θ, V, direction of x)."""
    duration, decay, lower, paper = funnel.duration, funnel.rate, funnel.beta_lower, funnel.template.name == "paper"
    root = np.linalg.inv(np.linalg.cholesky(funnel.shape).T)
    rng = np.random.default_rng(0)

    def objective(z: np.ndarray) -> float:
        theta = duration * min(max(z[0], 0), 1)
        value = lower + (1 - lower) * min(max(z[1], 0), 1)
        q = value - decay * theta if paper else value * np.exp(-decay * theta)
        return margin(theta, root @ z[2:] * np.sqrt(q) / np.linalg.norm(z[2:]))

    pool = [np.concatenate([rng.uniform(size=2), rng.normal(size=4)]) for _ in range(2000)]
    pool.sort(key=objective)
    options = {"maxiter": 4000, "xatol": 1e-9, "fatol": 1e-10, "adaptive": True}
    found = []
    for z in pool[:starts]:
        for _ in range(3):  # restarted: the simplex collapses on the ridges
            z = minimize(objective, z, method="Nelder-Mead", options=options).x
        found.append(objective(z))
    return min(found)


def named(case: tuple) -> str:
    path, method, template = case
    return f"{path.name}-{path.segments[0].point(0.0).speed:.2f}-{method.value}-{template.name}"


@pytest.mark.parametrize(("path", "method", "template"), CASES, ids=map(named, CASES))
def test_fast_falsifier_is_at_least_as_good_as_the_slow_one(path, method, template) -> None:
    problem = Problem(path, safe=Box((1.0, 1.0, 1.0, 3.0)), method=method)
    segment = path.segments[0]
    mix = np.random.default_rng(5).normal(size=(4, 4)) * 0.25 + 1.9 * np.eye(4)
    funnel = Funnel(template, mix @ mix.T, 0.3 / segment.duration, segment.duration)
    worst = {point.condition: point for point in falsify(problem, segment, funnel)}["d"]
    margin = slow_margin(problem, funnel)
    slow = slow_search(margin, funnel, starts=6)
    scale = max(1.0, abs(slow))
    assert worst.slack <= slow + 1e-4 * scale
    # and what it reports is a real point of the shell with that margin
    x = np.array(worst.x)
    assert funnel.beta_lower - 1e-3 <= funnel.value(worst.theta, x) <= 1 + 1e-3
    assert margin(worst.theta, x) == pytest.approx(worst.slack, abs=2e-3 * scale)


def test_closed_form_witnesses_lie_where_they_say() -> None:
    problem = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)))
    segment = problem.path.segments[0]
    mix = np.random.default_rng(6).normal(size=(4, 4)) * 0.2 + 1.9 * np.eye(4)
    for template in TEMPLATES.values():
        funnel = Funnel(template, mix @ mix.T, 0.3 / segment.duration, segment.duration)
        points = {point.condition: point for point in falsify(problem, segment, funnel, rounds=1)}
        a, b, c = (np.array(points[name].x) for name in "abc")
        assert a @ problem.inlet.shape @ a == pytest.approx(1)  # on the boundary of I
        assert 1 - funnel.value(0.0, a) == pytest.approx(points["a"].slack)
        assert b @ problem.goal.shape @ b == pytest.approx(1)  # on the boundary of G
        assert np.sign(funnel.value(segment.duration, b) - 1) == np.sign(points["b"].slack)
        assert np.max(np.abs(c) / problem.safe.half_widths) == pytest.approx(1)  # on a face of S
        assert np.sign(funnel.value(points["c"].theta, c) - 1) == np.sign(points["c"].slack)
        rng = np.random.default_rng(7)
        for _ in range(2000):
            x = rng.normal(size=4)
            on_inlet = x / np.sqrt(x @ problem.inlet.shape @ x)
            assert 1 - funnel.value(0.0, on_inlet) >= points["a"].slack - 1e-12


def test_the_worst_point_is_where_it_says_down_to_an_inner_level() -> None:
    problem = Problem(straight(), safe=Box((1.0, 1.0, 1.0, 3.0)), method=Method.TT)
    segment = problem.path.segments[0]
    mix = np.random.default_rng(5).normal(size=(4, 4)) * 0.25 + 1.9 * np.eye(4)
    funnel = Funnel(TEMPLATES["contracting"], mix @ mix.T, 0.1, segment.duration, beta_inner=0.2)
    worst = {point.condition: point for point in falsify(problem, segment, funnel, rounds=1)}["d"]
    x = np.array(worst.x)
    value = float(funnel.value(worst.theta, x))
    assert 0.2 - 1e-3 <= value <= 1 + 1e-3
    fading = min(1.0, value / funnel.beta_lower)
    assert slow_margin(problem, funnel)(worst.theta, x) / fading == pytest.approx(worst.slack, abs=1e-2)
