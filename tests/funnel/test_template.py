"""Each template against brute force over θ: level sets, V, V̇, and the elimination of θ on steady segments."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.errors import InputError
from cfjax.funnel import TEMPLATES, Funnel, Template, template_named
from cfjax.funnel.conditions import dual_coordinates, shell_points
from cfjax.funnel.instance import instance_of
from cfjax.problem import Box, Path, Problem, ball, circle, straight


TABLE = [(template, rate) for template in TEMPLATES.values() for rate in (-0.15, 0.0, 0.1, 0.3)]
DURATION, BETA_LOWER = 2.0, 0.9


@pytest.mark.parametrize(("template", "rate"), TABLE, ids=lambda v: getattr(v, "name", v))
def test_level_is_where_the_value_is_one(template: Template, rate: float) -> None:
    theta = np.linspace(0, DURATION, 7)
    np.testing.assert_allclose(template.value(rate, theta, template.level(rate, theta)), 1.0, atol=1e-12)


@pytest.mark.parametrize(("template", "rate"), TABLE, ids=lambda v: getattr(v, "name", v))
def test_rate_of_the_value_is_scale_times_form_rate_and_timing(template: Template, rate: float) -> None:
    theta, q, q_rate, u0 = 0.7, 0.4, -1.3, 1.7
    _, change = jax.jvp(lambda th, form: template.value(rate, th, form) * 1.0, (theta, q), (u0, q_rate))
    expected = template.scale(rate, theta) * (q_rate + template.timing(rate, q) * u0)
    np.testing.assert_allclose(change, expected, atol=1e-12)


@pytest.mark.parametrize(("begin", "end"), [(0.0, DURATION), (0.4, 1.1), (0.7, 0.7)])
@pytest.mark.parametrize(("template", "rate"), TABLE, ids=lambda v: getattr(v, "name", v))
def test_theta_is_eliminated_exactly(template: Template, rate: float, begin: float, end: float) -> None:
    """The shell's range of q on a stretch, and the largest demand at each q, by a dense grid over (θ, V)."""
    theta = np.linspace(begin, end, 4001)
    level, scale = np.asarray(template.level(rate, theta)), np.asarray(template.scale(rate, theta)) + 0 * theta
    inner = level - (1 - BETA_LOWER) / scale  # q at which V = β̲
    low, high = (float(q) for q in template.shell(rate, begin, end, BETA_LOWER))
    assert low == pytest.approx(inner.min(), abs=1e-9)
    assert high == pytest.approx(level.max(), abs=1e-9)
    for q in np.linspace(low + 1e-6, high - 1e-6, 23):
        inside = (q >= inner) & (q <= level)
        if inside.any():
            demand = (1 / scale[inside]).max()
            assert float(template.drop(rate, begin, end, BETA_LOWER, q)) == pytest.approx(demand, rel=2e-3)
            assert float(template.drop(rate, begin, end, BETA_LOWER, q)) >= demand - 1e-12


@pytest.mark.parametrize("template", TEMPLATES.values(), ids=lambda t: t.name)
def test_dual_coordinates_cover_the_shell_and_come_back(template: Template) -> None:
    problem = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)))
    segment = problem.path.segments[0]
    root = np.random.default_rng(0).normal(size=(4, 4)) * 0.2 + 1.8 * np.eye(4)
    funnel = Funnel(template, root @ root.T, 0.05, segment.duration)
    instance = instance_of(problem, segment, template, funnel.beta_lower)
    rng = np.random.default_rng(1)
    w = rng.normal(size=(50, 4))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    s, station = rng.uniform(size=50), np.zeros(50, int)
    factor = np.linalg.cholesky(np.linalg.inv(funnel.shape))
    x, q, gradient = map(
        np.asarray,
        shell_points(template, instance, *map(jnp.asarray, (factor, funnel.rate, w, s, station))),
    )
    np.testing.assert_allclose(funnel.form(x), q, rtol=1e-9)
    np.testing.assert_allclose(gradient, 2 * x @ funnel.shape, rtol=1e-9, atol=1e-12)
    low, high = template.shell(funnel.rate, 0.0, segment.duration, funnel.beta_lower)
    assert (q >= low - 1e-12).all() and (q <= high + 1e-12).all()
    w_back, s_back = dual_coordinates(instance, funnel, x, station)
    np.testing.assert_allclose(w_back, w, atol=1e-9)
    np.testing.assert_allclose(s_back, s, atol=1e-9)


@pytest.mark.parametrize(
    ("shape", "beta_lower", "words"),
    [
        (-np.eye(4), 0.9, "positive definite"),
        (np.triu(np.ones((4, 4))), 0.9, "symmetric"),
        (np.eye(4), 1.0, "beta_lower: expected a number between 0 and 1"),
    ],
)
def test_bad_funnels_are_refused(shape: np.ndarray, beta_lower: float, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Funnel(TEMPLATES["paper"], shape, 0.1, 1.0, beta_lower)


def test_unknown_template_is_refused() -> None:
    with pytest.raises(InputError, match="expected one of contracting, paper, got cubic"):
        template_named("cubic")


def test_bigger_goal_may_grow() -> None:
    def least_change(path: Path) -> float:
        problem = Problem(path, inlet=ball(0.3), goal=ball(0.5))
        return float(instance_of(problem, path.segments[0], TEMPLATES["contracting"], 0.9).change_bounds[0])

    assert least_change(straight()) < 0
    assert least_change(circle()) > 0  # closed: where a lap ends the next one begins
