"""Baselines: what geometry says of them, and the MPC tracker against the demonstrator."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.baselines import PurePursuit, Stanley, mpc
from cfjax.baselines.geometric import ahead, nearest
from cfjax.demonstrator import demonstrate
from cfjax.demonstrator.demonstrator import Horizon
from cfjax.funnel import Funnel, Leg, template_named
from cfjax.plants import Measurement
from cfjax.plants.model import inputs_of, world_rate
from cfjax.problem import Path, Problem, ball, circle, straight, to_state
from cfjax.simulation.controller import Controller
from cfjax.simulation.track import Track, track_of


PERIOD, RADIUS, LENGTH = 0.02, 1.5, 0.34
NOW = jnp.zeros(())


@lru_cache
def course(path: Path) -> tuple[Problem, Track]:
    problem = Problem(path, inlet=ball(0.4), safe=None)
    duration = path.curve[0].duration
    return problem, track_of(
        problem, [Leg(duration, Funnel(template_named("contracting"), np.eye(4), 0.1, duration), 1.0)]
    )


def state_at(track: Track, theta: float, *x: float) -> jax.Array:
    """The state (world frame) at a deviation from the place θ."""
    place = track.at(jnp.asarray(theta))
    return jnp.stack([jnp.asarray(v, float) for v in to_state(track.vehicle, x, place.pose, place.point)])


def drivers(path: Path) -> list[Controller]:
    _, track = course(path)
    return [PurePursuit(track, PERIOD, 2.0, 0.5), Stanley(track, PERIOD, 2.0, 2.0)]


def test_the_nearest_place_is_beside_the_car() -> None:
    _, track = course(circle())
    states = jnp.stack([state_at(track, 2.0, 0.3, lateral, 0.0, -0.2) for lateral in (0.3, -0.5, 0.0)])
    found = jax.jit(jax.vmap(lambda state, guess: nearest(track, state, guess)))(states, jnp.array([2.4, 1.7, 2.2]))
    np.testing.assert_allclose(found, 2.0, atol=1e-6)


def test_beyond_its_end_the_path_goes_straight_on() -> None:
    _, track = course(circle(laps=0.25))
    end = track.end
    alpha, x, y = (float(value) for value in track.at(end).pose)
    beyond = ahead(track, end - 0.1, 0.1 * track.at(end).point.speed + 0.7)
    np.testing.assert_allclose(beyond, [x - 0.7 * np.sin(alpha), y + 0.7 * np.cos(alpha)], atol=1e-7)


def test_pure_pursuit_drives_the_circle_that_it_is_on() -> None:
    """Target and rear axle on the circle, tangent to it: the arc through them is the circle."""
    controller = drivers(circle())[0]
    _, track = course(circle())
    command, _ = controller.act(Measurement(state_at(track, 1.0, 0.0, 0.0, 0.0, 0.0), NOW), jnp.asarray(1.0), NOW)
    np.testing.assert_allclose(command, [np.arctan(LENGTH / RADIUS), 0.0], atol=1e-6)


def test_stanley_by_hand() -> None:
    """On a straight line: γ = −α_R + atan(k e/(k_s + v)) with the front axle's distance e to the right."""
    controller = drivers(straight())[1]
    _, track = course(straight())
    alpha, lateral = 0.2, 0.3
    state = state_at(track, 0.5, alpha, lateral, 0.0, 0.5)
    front = lateral - LENGTH * np.sin(alpha)
    command, theta = controller.act(Measurement(state, NOW), jnp.asarray(0.4), NOW)
    np.testing.assert_allclose(command, [-alpha + np.arctan(2.0 * front / (0.3 + 2.5)), -1.0], atol=1e-7)
    assert float(theta) == pytest.approx(0.5 + PERIOD * 2.5 * np.cos(alpha) / 2.0)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("path", [circle(), straight(8.0)], ids=["circle", "straight"])
def test_geometric_trackers_reach_the_path(path: Path, number: int) -> None:
    """Pure pursuit comes back to it; Stanley leads the front axle along it, and the rear one runs inside the bend."""
    controller, (problem, track) = drivers(path)[number], course(path)

    @jax.jit
    def drive(state: jax.Array) -> tuple[jax.Array, jax.Array]:
        def step(carry: tuple, _: None) -> tuple[tuple, None]:
            state, theta = carry
            command, theta = controller.act(Measurement(state, NOW), theta, jnp.zeros(()))
            rate = world_rate(problem.vehicle, state, inputs_of(problem.vehicle, jnp.clip(command, -0.78, 0.78)))
            return (state + PERIOD * rate, theta), None

        return jax.lax.scan(step, (state, jnp.zeros(())), None, length=180)[0]

    state, theta = drive(state_at(track, 0.0, 0.2, 0.3, -0.2, -0.2))
    x = track.deviation(track.at(theta), state)
    inside = RADIUS - np.sqrt(RADIUS**2 - LENGTH**2) if (path.closed and number == 1) else 0.0
    assert abs(float(x[1]) + inside) < 0.03
    assert float(jnp.abs(x[jnp.array([2, 3])]).max()) < 0.05


@pytest.mark.slow
def test_mpc_is_the_demonstrator() -> None:
    """Iterated long enough the inputs are the demonstrated ones, a batch of cars as a batch of problems."""
    problem, track = course(circle())
    horizon = Horizon(4, 0.1)
    controller = mpc(problem, track, PERIOD, horizon=horizon, iterations=25)
    x = np.array([[0.1, 0.2, -0.1, 0.1], [-0.2, -0.2, 0.1, 0.2], [0.0, 0.0, 0.0, 0.0]])
    states = jnp.stack([state_at(track, 0.0, *row) for row in x])

    def act(state: jax.Array) -> tuple:
        command, memory = controller.act(Measurement(state, NOW), controller.start(state, NOW), NOW)
        return command, controller.theta(memory)

    commands, theta = jax.jit(jax.vmap(act))(states)
    wanted = np.asarray(demonstrate(problem, x, horizon=horizon, tolerance=1e-7).inputs)
    np.testing.assert_allclose(np.tan(commands[:, 0]), wanted[:, 1], atol=1e-3)
    np.testing.assert_allclose(commands[:, 1], wanted[:, 2], atol=4e-3)
    np.testing.assert_allclose(theta, PERIOD * wanted[:, 0], atol=1e-4)
