"""The fast falsifier against a slow, obvious one."""

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


def slow_margin(problem: Problem, funnel: Funnel, theta: float, x: np.ndarray) -> float:
    """The bicycle's V̇ of the paper, written out once more, minimised over all vertices of the input box; negated."""
    point = problem.path.segments[0].point(0.0)
    alpha, px, py, v = x
    speed, omega = point.speed, point.turn_rate
    best = np.inf
    for u0 in (problem.inputs[0].lower, problem.inputs[0].upper):
        for w in (-1.0, 1.0):
            for thrust in (-4.0, 4.0):
                rate = np.array(
                    [
                        (v + speed) / 0.34 * w - omega * u0,
                        -(v + speed) * np.sin(alpha) + omega * u0 * py,
                        (v + speed) * np.cos(alpha) - speed * u0 - omega * u0 * px,
                        thrust,
                    ]
                )
                q, form_rate = x @ funnel.shape @ x, 2 * x @ funnel.shape @ rate
                if funnel.template.name == "paper":
                    change = form_rate + funnel.rate * u0
                else:
                    change = np.exp(funnel.rate * theta) * (form_rate + funnel.rate * u0 * q)
                best = min(best, change)
    return -best


def slow_search(problem: Problem, funnel: Funnel, starts: int) -> float:
    """Smallest margin by Nelder–Mead from random points of the shell in (θ, V, direction of x)."""
    duration = problem.path.segments[0].duration
    root = np.linalg.inv(np.linalg.cholesky(funnel.shape).T)
    rng = np.random.default_rng(0)

    def objective(z: np.ndarray) -> float:
        theta = duration * np.clip(z[0], 0, 1)
        value = funnel.beta_lower + (1 - funnel.beta_lower) * np.clip(z[1], 0, 1)
        if funnel.template.name == "paper":
            q = value - funnel.rate * theta
        else:
            q = value * np.exp(-funnel.rate * theta)
        return slow_margin(problem, funnel, theta, root @ z[2:] * np.sqrt(q) / np.linalg.norm(z[2:]))

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
    slow = slow_search(problem, funnel, starts=6)
    scale = max(1.0, abs(slow))
    assert worst.slack <= slow + 1e-4 * scale
    # and what it reports is a real point of the shell with that margin
    x = np.array(worst.x)
    assert funnel.beta_lower - 1e-3 <= funnel.value(worst.theta, x) <= 1 + 1e-3
    assert slow_margin(problem, funnel, worst.theta, x) == pytest.approx(worst.slack, abs=2e-3 * scale)


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
    assert slow_margin(problem, funnel, worst.theta, x) / fading == pytest.approx(worst.slack, abs=1e-2)
