"""Demonstrations against Riccati, against plain NumPy, against what optimality means, and against CasADi with IPOPT."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.demonstrator import Demonstration, Horizon, Weights, demonstrate, horizon_of, weights_of
from cfjax.demonstrator.box import COMPILER, smallest_in_box
from cfjax.demonstrator.demonstrator import TOLERANCE
from cfjax.errors import InputError
from cfjax.problem import (
    Box,
    Interval,
    KinematicBicycle,
    Method,
    Path,
    Problem,
    ReferencePoint,
    affine_deviation,
    ball,
    circle,
    oval,
    straight,
    tube,
)
from tests.demonstrator.by_casadi import solver_of


SAFE = (1.0, 1.0, 1.0, 3.0)
COUNT = 500  # nearly everywhere: each number of problems is compiled for itself
STEPS, STEP = 20, 0.1


def problem_along(path: Path, method: Method = Method.PF) -> Problem:
    return Problem(path, safe=Box(SAFE), method=method)


def drawn(problem: Problem, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    duration = sum(segment.duration for segment in problem.path.curve)
    return rng.uniform(-1, 1, (count, 4)) * np.array(SAFE), rng.uniform(0, duration, count)


@pytest.fixture(scope="module")
def circling() -> tuple[Problem, np.ndarray, Demonstration]:
    problem = problem_along(circle())
    x, _ = drawn(problem, COUNT)
    return problem, x, demonstrate(problem, x)


@pytest.fixture(scope="module")
def lapping() -> tuple[Problem, np.ndarray, np.ndarray, Demonstration]:
    problem = problem_along(oval())
    x, theta = drawn(problem, COUNT)
    return problem, x, theta, demonstrate(problem, x, theta)


class Plain:
    """The bicycle along a path, one sample, by the formulas of the paper; θ is the fifth state."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.since = np.cumsum([0.0, *(s.duration for s in problem.path.curve)])

    def point(self, theta: float, begun: float):
        """At θ, by the polynomials of the piece in which the interval began."""
        theta = min(theta, self.since[-1])
        index = min(int(np.searchsorted(self.since, begun, side="right")) - 1, len(self.problem.path.curve) - 1)
        segment = self.problem.path.curve[index]

        def at(profile) -> tuple[float, float]:
            own = begun - self.since[index]
            piece = min(int(np.searchsorted(profile.breaks, own, side="right")) - 1, len(profile.coefficients) - 1)
            polynomial = np.polynomial.Polynomial(profile.coefficients[piece])
            t = theta - self.since[index] - profile.breaks[piece]
            return polynomial(t), polynomial.deriv()(t)

        return *at(segment.turn_rate), *at(segment.speed)

    def rate(self, z: np.ndarray, u: np.ndarray, begun: float) -> np.ndarray:
        alpha, x, y, v, theta = z
        omega_r, _, v_r, slope = self.point(theta, begun)
        if theta >= self.since[-1]:
            slope = 0.0
        return np.array(
            [
                (v + v_r) / self.problem.vehicle.wheelbase * u[1] - omega_r * u[0],
                -(v + v_r) * np.sin(alpha) + omega_r * u[0] * y,
                (v + v_r) * np.cos(alpha) - v_r * u[0] - omega_r * u[0] * x,
                u[2] - slope * u[0],
                u[0],
            ]
        )

    def drive(self, x: np.ndarray, theta: float, plan: np.ndarray) -> tuple[np.ndarray, float]:
        """States (N + 1, 5) and cost."""
        weights = weights_of(self.problem)
        z, cost, passed = np.append(x, theta), 0.0, []
        for u in plan:
            begun = min(z[4], self.since[-1])
            omega_r, _, v_r, slope = self.point(begun, begun)
            slope = 0.0 if z[4] >= self.since[-1] else slope
            off = u - np.array([1.0, self.problem.vehicle.wheelbase * omega_r / v_r, slope])
            cost += STEP * (z[:4] @ weights.state @ z[:4] + off @ weights.effort @ off)
            passed.append(z)
            a = self.rate(z, u, begun)
            b = self.rate(z + STEP / 2 * a, u, begun)
            c = self.rate(z + STEP / 2 * b, u, begun)
            d = self.rate(z + STEP * c, u, begun)
            z = z + STEP / 6 * (a + 2 * b + 2 * c + d)
        return np.array([*passed, z]), cost + z[:4] @ weights.terminal @ z[:4]


def by_ipopt(problem: Problem, x: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Costs that IPOPT finds; infinite where it fails."""
    solve = solver_of(problem)
    found = [solve(a, b) for a, b in zip(x, theta, strict=True)]
    return np.array([cost if success else np.inf for cost, _, success in found])


@pytest.mark.slow
def test_costs_are_those_of_ipopt_on_a_steady_path(circling) -> None:
    problem, x, got = circling
    ratio = np.asarray(got.cost) / by_ipopt(problem, x, np.zeros(len(x)))
    assert np.mean(np.abs(ratio - 1) <= 0.01) >= 0.95
    assert ratio.max() <= 1.1


@pytest.mark.slow
def test_costs_are_those_of_ipopt_along_the_oval(lapping) -> None:
    problem, x, theta, got = lapping
    ratio = np.asarray(got.cost) / by_ipopt(problem, x, theta)
    assert np.mean(np.abs(ratio - 1) <= 0.01) >= 0.95
    assert ratio.max() <= 1.1


def test_small_deviations_get_the_riccati_solution() -> None:
    """Close to a straight reference nothing is limited and nothing bends: the linear-quadratic regulator."""
    problem = problem_along(straight())
    drift, columns = affine_deviation(problem.vehicle, jnp.zeros(4), problem.path.segments[0].point(0.0))
    rest = problem.feedforward(problem.path.segments[0].point(0.0))

    def rate(x: jax.Array) -> jax.Array:
        f, g = affine_deviation(problem.vehicle, x, problem.path.segments[0].point(0.0))
        return f + g @ rest

    a = np.asarray(jax.jacfwd(rate)(jnp.zeros(4)))
    b = np.asarray(columns)
    assert np.abs(drift + columns @ rest).max() < 1e-12
    powers = [np.linalg.matrix_power(a * STEP, i) for i in range(5)]
    ad = powers[0] + powers[1] + powers[2] / 2 + powers[3] / 6 + powers[4] / 24
    bd = STEP * (powers[0] + powers[1] / 2 + powers[2] / 6 + powers[3] / 24) @ b
    weights = weights_of(problem)
    value = np.asarray(weights.terminal)
    for _ in range(STEPS):
        gain = np.linalg.solve(STEP * weights.effort + bd.T @ value @ bd, bd.T @ value @ ad)
        value = STEP * weights.state + ad.T @ value @ (ad - bd @ gain)
    x = 1e-5 * np.random.default_rng(1).normal(size=(COUNT, 4))
    got = demonstrate(problem, x, tolerance=1e-8)
    np.testing.assert_allclose(np.asarray(got.inputs) - rest, -x @ gain.T, atol=1e-8)
    np.testing.assert_allclose(got.cost, np.einsum("ki,ij,kj->k", x, value, x), rtol=1e-3)


def test_plans_are_what_plain_numpy_drives(circling, lapping) -> None:
    problem, x, got = circling
    plain = Plain(problem)
    for i in range(10):
        states, cost = plain.drive(x[i], 0.0, np.asarray(got.plan[i]))
        np.testing.assert_allclose(got.states[i], states[:, :4], atol=1e-10)
        np.testing.assert_allclose(got.cost[i], cost, rtol=1e-10)
    problem, x, theta, got = lapping
    plain = Plain(problem)
    for i in [*range(10), *np.argsort(theta)[-3:]]:
        states, cost = plain.drive(x[i], theta[i], np.asarray(got.plan[i]))
        np.testing.assert_allclose(got.states[i], states[:, :4], atol=1e-9)
        np.testing.assert_allclose(got.theta[i], states[:, 4], atol=1e-10)
        np.testing.assert_allclose(got.cost[i], cost, rtol=1e-9)


def test_converged_plans_are_stationary_in_the_box(circling) -> None:
    """By differences of the NumPy cost, for every input of some plans."""
    problem, x, got = circling
    plain, small = Plain(problem), 1e-5
    assert np.mean(got.converged) >= 0.99
    lower, upper = (np.array([getattr(i, side) for i in problem.inputs]) for side in ("lower", "upper"))
    half = (upper - lower) / 2
    for i in np.flatnonzero(got.converged)[:4]:
        plan = np.asarray(got.plan[i])
        for step, which in np.ndindex(plan.shape):
            change = np.zeros_like(plan)
            change[step, which] = small * half[which]
            slope = plain.drive(x[i], 0.0, plan + change)[1] - plain.drive(x[i], 0.0, plan - change)[1]
            slope /= 2 * small * float(got.cost[i])
            held = (slope > 0 and plan[step, which] == lower[which]) or (
                slope < 0 and plan[step, which] == upper[which]
            )
            assert held or abs(slope) <= TOLERANCE + 1e-6


@pytest.mark.parametrize("method", list(Method))
def test_inputs_keep_to_the_box_exactly(method: Method) -> None:
    """From anywhere: headings near pi, cars that go backwards, far away."""
    problem = problem_along(circle(), method)
    rng = np.random.default_rng(5)
    x = rng.uniform(-1, 1, (COUNT, 4)) * np.array([np.pi, 3.0, 3.0, 6.0])
    got = demonstrate(problem, x)
    lower, upper = (np.array([getattr(i, side) for i in problem.inputs]) for side in ("lower", "upper"))
    plan = np.asarray(got.plan)
    assert (plan >= lower).all() and (plan <= upper).all()
    assert (plan == lower).any() and (plan == upper).any()
    assert np.isfinite(got.cost).all()
    assert np.mean(got.converged) >= (0.9 if method is Method.PF else 0.75)
    np.testing.assert_array_equal(got.inputs, plan[:, 0])
    if method is Method.TT:
        assert (plan[..., 0] == 1.0).all()


def test_freedom_of_timing_never_costs(circling) -> None:
    _, x, free = circling
    tied = demonstrate(problem_along(circle(), Method.TT), x)
    assert np.mean(tied.converged) >= 0.99
    both = np.asarray(free.converged & tied.converged)
    better = np.asarray(free.cost <= tied.cost * 1.001)[both]
    assert better.mean() >= 0.99  # local minima: nothing says that both end in the same valley
    assert np.median(np.asarray(free.cost / tied.cost)[both]) < 0.99


def test_warm_starts_need_fewer_iterations(circling) -> None:
    problem, _, cold = circling
    moved, plan = np.asarray(cold.states[:, 1]), cold.next_plan()
    warm, again = demonstrate(problem, moved, warm=plan), demonstrate(problem, moved)
    assert np.mean(warm.converged) >= 0.99
    assert np.mean(warm.iterations) < 0.6 * np.mean(again.iterations)
    assert np.max(warm.cost / again.cost) < 1.1


def test_results_do_not_depend_on_their_neighbours(circling) -> None:
    """More problems than lanes, others beside them: the same plans."""
    problem, x, got = circling
    many = demonstrate(problem, np.concatenate([x, x[::-1], x]))
    np.testing.assert_allclose(many.cost[:500], got.cost, rtol=1e-8)
    np.testing.assert_allclose(many.cost[500:1000][::-1], got.cost, rtol=1e-8)


@pytest.mark.parametrize("path", [circle(), oval(), tube(curvature=Interval(0.0, 1.0))], ids=lambda path: path.name)
def test_on_the_reference_the_feedforward_does(path: Path) -> None:
    problem = problem_along(path) if path.curve else Problem(path, inlet=ball(0.4), goal=ball(0.6))
    got = demonstrate(problem, np.zeros((COUNT, 4)), np.full(COUNT, 0.5))
    assert np.all(got.converged)
    turn_rate = 0.5 if path.tube else path.curve[0].point(0.5).turn_rate
    speed = 1.0 if path.tube else path.curve[0].point(0.5).speed
    np.testing.assert_allclose(
        got.inputs[0, 1], KinematicBicycle().wheelbase * turn_rate / speed, atol=0.04
    )  # it bends within an interval
    assert float(got.cost[0]) < 0.01


def test_beyond_the_end_the_reference_stays() -> None:
    problem = problem_along(oval())
    end = sum(segment.duration for segment in problem.path.curve)
    x, _ = drawn(problem, COUNT)
    here, later = (demonstrate(problem, x, np.full(COUNT, theta)) for theta in (end, end + 3.0))
    np.testing.assert_allclose(here.cost, later.cost, rtol=1e-9)


def test_box_programs_are_solved() -> None:
    """By their optimality conditions, for three and four inputs, one of them tied."""
    solve = jax.jit(smallest_in_box, compiler_options=COMPILER)
    rng = np.random.default_rng(3)
    for m in (3, 4):
        root = rng.normal(size=(m, m, 400))
        h = np.einsum("ipk,jpk->ijk", root, root) + 0.05 * np.eye(m)[:, :, None]
        q = 3 * rng.normal(size=(m, 400))
        lower, upper = -rng.uniform(0, 1, (m, 400)), rng.uniform(0, 1, (m, 400))
        lower[0, :100] = upper[0, :100] = 0.0
        d, _ = (np.asarray(part) for part in solve(h, q, lower, upper))
        assert (d >= lower).all() and (d <= upper).all()
        slope = q + np.einsum("ijk,jk->ik", h, d)
        left = np.abs(d - np.clip(d - slope, lower, upper)).max(axis=0)
        assert np.mean(left < 1e-9) >= 0.9  # the rest goes on in the next iteration


def test_what_is_stored_once_stays_so_and_changes_nothing() -> None:
    """The compiler's option keeps the barriers, without which it takes many times as long; results are the same.

    An unknown pass is passed over: an XLA that renames it is slow, and fails here, but works.
    """
    rng = np.random.default_rng(4)
    root = rng.normal(size=(3, 3, 400))
    h = np.einsum("ipk,jpk->ijk", root, root) + 0.05 * np.eye(3)[:, :, None]
    q = rng.normal(size=(3, 400))
    told = {}
    for name, options in (("with", COMPILER), ("renamed", dict.fromkeys(COMPILER, "no_such_pass"))):
        program = jax.jit(smallest_in_box, compiler_options=options).lower(h, q, -0.3 + 0 * q, 0.3 + 0 * q).compile()
        told[name] = program.as_text().count("opt-barrier"), np.asarray(program(h, q, -0.3 + 0 * q, 0.3 + 0 * q)[0])
    assert told["with"][0] > 0 and told["renamed"][0] == 0
    np.testing.assert_allclose(told["with"][1], told["renamed"][1], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("speed", [np.pi / 2, 10 * np.pi])
def test_plans_are_what_the_car_would_do_at_any_speed(speed: float) -> None:
    """One Runge–Kutta step per interval against two hundred: the horizon knows the speed."""
    problem = problem_along(circle(speed=speed))
    horizon = horizon_of(problem)
    assert horizon.step * speed <= 0.2 + 1e-12 and horizon.step <= 0.1
    assert horizon.steps * horizon.step <= problem.path.curve[0].duration
    x = np.random.default_rng(6).uniform(-0.5, 0.5, (COUNT, 4)) * problem.inlet.half_axes
    got = demonstrate(problem, x)
    assert np.mean(got.converged) >= 0.95
    point = problem.path.curve[0].point(0.0)
    fine = np.asarray(x)
    worst = []
    for k in range(horizon.steps):
        fine = _driven(problem, point, fine, np.asarray(got.plan[:, k]), horizon.step)
        worst.append(np.abs((np.asarray(got.states[:, k + 1]) - fine) / problem.inlet.half_axes).max())
    assert max(worst) < 0.02
    coarse = Horizon().step
    if coarse * speed > 1:  # what a horizon of two seconds would be there
        far = demonstrate(problem, x, horizon=Horizon())
        there = _driven(problem, point, np.asarray(x), np.asarray(far.plan[:, 0]), coarse)
        assert np.abs((np.asarray(far.states[:, 1]) - there) / problem.inlet.half_axes).max() > 0.1


def _driven(problem: Problem, point: ReferencePoint, x: np.ndarray, u: np.ndarray, duration: float) -> np.ndarray:
    """Deviations (k, 4) after so many seconds at constant inputs, by many small steps."""
    h, z = duration / 200, tuple(x.T)

    def rate(z: tuple) -> np.ndarray:
        return np.array(_rates(problem, z, tuple(u.T), point))

    state = np.array(z)
    for _ in range(200):
        a = rate(tuple(state))
        b = rate(tuple(state + h / 2 * a))
        c = rate(tuple(state + h / 2 * b))
        state = state + h / 6 * (a + 2 * b + 2 * c + rate(tuple(state + h * c)))
    return state.T


def _rates(problem: Problem, z: tuple, u: tuple, point: ReferencePoint) -> list[np.ndarray]:
    """The bicycle's deviation on a circle, by the formulas of the paper."""
    alpha, x, y, v = z
    omega_r, v_r = point.turn_rate, point.speed
    return [
        (v + v_r) / problem.vehicle.wheelbase * u[1] - omega_r * u[0],
        -(v + v_r) * np.sin(alpha) + omega_r * u[0] * y,
        (v + v_r) * np.cos(alpha) - v_r * u[0] - omega_r * u[0] * x,
        u[2],
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"x": np.zeros((3, 5))}, "x: expected an array of shape k × 4, got 3 × 5"),
        ({"x": np.full((2, 4), np.nan)}, "x: expected finite numbers, got 8 that are not"),
        ({"x": np.zeros((0, 4))}, "x: expected at least one row, got none"),
        ({"x": np.zeros((2, 4)), "theta": np.zeros(3)}, "theta: expected an array of shape 2, got 3"),
        ({"x": np.zeros((2, 4)), "warm": np.zeros((2, 4, 3))}, "warm: expected an array of shape 2 × 20 × 3"),
        ({"x": np.zeros((2, 4)), "horizon": Horizon(0)}, "horizon.steps: expected a whole number of at least 1"),
        (
            {"x": np.zeros((2, 4)), "weights": Weights(jnp.eye(3), jnp.eye(3), jnp.eye(4))},
            "weights.state: expected an array of shape 4 × 4, got 3 × 3",
        ),
        ({"x": np.zeros((2, 4)), "theta": np.array([0.0, -0.1])}, "theta: expected no θ before the path's beginning"),
        (
            {"x": np.zeros((2, 4)), "weights": Weights(jnp.eye(4), jnp.eye(3), -jnp.eye(4))},
            "weights.terminal: expected a positive semidefinite matrix, got the eigenvalue -1",
        ),
        (
            {"x": np.zeros((2, 4)), "weights": Weights(jnp.triu(jnp.ones((4, 4))), jnp.eye(3), jnp.eye(4))},
            "weights.state: expected a symmetric matrix",
        ),
    ],
)
def test_bad_input_is_refused(arguments: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        demonstrate(problem_along(circle()), **arguments)
