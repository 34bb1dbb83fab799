"""Properties of all laws, and the universal formulas against what their authors prove of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.control import LAWS, Descent, Law, LinSontag, MinNorm, Sontag, descent_at, law_named, law_numbers
from cfjax.errors import InputError
from cfjax.funnel import TEMPLATES, Funnel
from cfjax.problem import Box, Method, Problem, affine_deviation, circle


ROOT = np.random.default_rng(3).normal(size=(4, 4)) * 0.3 + 1.8 * np.eye(4)


def question(method: Method, template: str) -> tuple[Problem, Funnel]:
    problem = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)), method=method)
    return problem, Funnel(TEMPLATES[template], ROOT @ ROOT.T, 0.05, problem.path.segments[0].duration)


def deviations(funnel: Funnel, count: int, values: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Random θ (s), and deviations with V in an interval."""
    rng = np.random.default_rng(0)
    theta, x = rng.uniform(0, funnel.duration, count), rng.normal(size=(count, 4))
    wanted = rng.uniform(*values, count)
    q = np.asarray(funnel.level(theta)) - (1 - wanted) / np.asarray(funnel.template.scale(funnel.rate, theta))
    return theta, x * np.sqrt(q / funnel.form(x))[:, None]


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("template", TEMPLATES)
def test_every_law_stays_in_the_box_and_rests_on_the_reference(law: Law, method: Method, template: str) -> None:
    problem, funnel = question(method, template)
    numbers, point = law_numbers(problem, funnel, 0.4), problem.path.segments[0].point(0.0)

    @jax.jit
    def act(theta: jax.Array, x: jax.Array) -> jax.Array:
        return jnp.stack(law(problem.vehicle, funnel.template, numbers, point, theta, tuple(x)))

    lower, upper = (np.array([getattr(box, end) for box in problem.inputs])[:, None] for end in ("lower", "upper"))
    for values in ((0.4, 0.9), (0.9, 1.0), (1.0, 30.0)):
        theta, x = deviations(funnel, 500, values)
        inputs = np.asarray(act(jnp.asarray(theta), jnp.asarray(x.T)))
        assert np.isfinite(inputs).all() and (inputs >= lower).all() and (inputs <= upper).all()
    rest = np.asarray(act(jnp.array([1.0]), jnp.zeros((4, 1))))[:, 0]
    np.testing.assert_allclose(rest, problem.feedforward(point), atol=1e-12)
    assert law == type(law)() and hash(law) == hash(type(law)())  # a static argument: no recompilation


def test_descent_is_the_rate_of_v() -> None:
    """By finite differences of V along the deviation dynamics, at random inputs."""
    problem, funnel = question(Method.PF, "contracting")
    numbers, point = law_numbers(problem, funnel, 0.4), problem.path.segments[0].point(0.0)
    theta, x = deviations(funnel, 20, (0.9, 1.0))
    rng = np.random.default_rng(1)
    for place, deviation in zip(theta, x, strict=True):
        inputs = np.array([rng.uniform(box.lower, box.upper) for box in problem.inputs])
        drift, columns = affine_deviation(problem.vehicle, jnp.asarray(deviation), point)
        rate = np.asarray(drift + columns @ inputs)
        h = 1e-6
        ahead, behind = (float(funnel.value(place + s * inputs[0], deviation + s * rate)) for s in (h, -h))
        descent = descent_at(problem.vehicle, funnel.template, numbers, point, place, tuple(deviation))
        claimed = descent.rate + sum(
            float(b) * (v - float(c)) for b, v, c in zip(descent.slopes, inputs, descent.centre, strict=True)
        )
        assert float(claimed) == pytest.approx((ahead - behind) / (2 * h), rel=1e-6, abs=1e-6)
        assert float(descent.excess - descent.rate) == pytest.approx(0.95 * 0.4)


def descents(count: int, size: float) -> Descent:
    rng = np.random.default_rng(5)
    lower, upper = jnp.array([0.5, -1.0, -4.0]), jnp.array([2.0, 1.0, 4.0])
    centre = tuple(jnp.asarray(rng.uniform(low + 0.1, up - 0.1, count)) for low, up in ((0.5, 2), (-1, 1), (-4, 4)))
    slopes = tuple(jnp.asarray(size * rng.normal(size=count)) for _ in range(3))
    rate = jnp.asarray(rng.normal(size=count))
    zero = jnp.zeros(count)
    return Descent(slopes, rate, rate, zero, centre, lower, upper)


def test_sontag_reaches_what_the_formula_says_unless_it_is_clipped() -> None:
    descent = descents(2000, 0.3)
    inputs = [np.asarray(v) for v in Sontag().choose(descent)]
    half = np.array([0.75, 1.0, 4.0])
    b = np.stack([np.asarray(slope) * room for slope, room in zip(descent.slopes, half, strict=True)])
    a = np.asarray(descent.rate)
    moved = np.stack([v - np.asarray(c) for v, c in zip(inputs, descent.centre, strict=True)])
    reached = a + (np.stack([np.asarray(slope) for slope in descent.slopes]) * moved).sum(axis=0)
    free = np.array([(v > low) & (v < up) for v, low, up in zip(inputs, (0.5, -1, -4), (2, 1, 4), strict=True)]).all(0)
    assert 100 < free.sum() < 1900
    formula = -np.sqrt(a**2 + (b**2).sum(axis=0) ** 2)
    np.testing.assert_allclose(reached[free], formula[free], rtol=1e-9)
    assert (reached >= formula - 1e-9)[~free].all()


def test_lin_sontag_decreases_wherever_its_ball_can() -> None:
    """And is inside the ball: no input is ever clipped."""
    for size in (0.3, 1.0, 10.0):
        descent = descents(3000, size)
        room = [
            np.minimum(up - np.asarray(c), np.asarray(c) - low)
            for c, low, up in zip(descent.centre, (0.5, -1, -4), (2, 1, 4), strict=True)
        ]
        inputs = LinSontag().choose(descent)
        w = np.stack(
            [(np.asarray(v) - np.asarray(c)) / r for v, c, r in zip(inputs, descent.centre, room, strict=True)]
        )
        b = np.stack([np.asarray(slope) * r for slope, r in zip(descent.slopes, room, strict=True)])
        a = np.asarray(descent.rate)
        can = a < np.linalg.norm(b, axis=0)
        assert can.any()
        assert (np.linalg.norm(w, axis=0)[can] < 1).all()
        assert ((a + (b * w).sum(axis=0))[can] < 0).all()


def test_what_inherits() -> None:
    assert [law.inherits for law in (MinNorm(), Sontag(), LinSontag())] == [True, False, False]
    with pytest.raises(InputError, match="law: expected one of min_norm, sontag, lin_sontag, got lqr"):
        law_named("lqr")
