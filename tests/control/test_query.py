"""Where a car is: found against dense sampling, on curves, chains and laps."""

import numpy as np
import pytest

from cfjax.control import locate
from cfjax.errors import InputError
from cfjax.funnel import TEMPLATES, Funnel, Leg
from cfjax.problem import (
    KinematicBicycle,
    Method,
    Path,
    Problem,
    ReferencePoint,
    ball,
    circle,
    figure_eight,
    oval,
    straight,
    to_deviation,
    to_state,
    tube,
)


SHAPE = np.array([[6.0, -2.0, 0.1, 0.0], [-2.0, 5.0, 0.0, 0.2], [0.1, 0.0, 4.5, 0.3], [0.0, 0.2, 0.3, 3.0]])


def legs_of(path: Path, template: str, rate: float) -> list[Leg]:
    ends = np.cumsum([segment.duration for segment in path.curve])
    funnels = [Funnel(TEMPLATES[template], SHAPE, rate, segment.duration) for segment in path.curve]
    return [Leg(float(end), funnel, 0.3) for end, funnel in zip(ends, funnels, strict=True)]


def in_the_plane(path: Path, leg: int, theta: float, x: np.ndarray) -> np.ndarray:
    """The state at a deviation from the reference at θ of one leg."""
    segment = path.curve[leg]
    pose = segment.poses(np.array([theta]))[0]
    return np.array([float(v) for v in to_state(KinematicBicycle(), tuple(x), pose, segment.point(theta))])


def test_frames_are_inverse_and_wrap() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        pose, x = rng.normal(size=3) * 3, rng.uniform(-1, 1, 4) * [3.1, 2, 2, 3]
        point = ReferencePoint(0.4, 1.5)
        state = to_state(KinematicBicycle(), tuple(x), pose, point)
        laps = (float(state[0]) + 2 * np.pi * rng.integers(-3, 4), *map(float, state[1:]))
        np.testing.assert_allclose(to_deviation(KinematicBicycle(), laps, pose, point), x, atol=1e-12)


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.parametrize("path", [straight(4.0), circle(), oval(), figure_eight()], ids=lambda path: path.name)
def test_the_smallest_v_along_the_path(path: Path, template: str) -> None:
    problem, legs = Problem(path), legs_of(path, template, 0.04)
    rng = np.random.default_rng(1)
    count = 12
    places = [(int(leg), rng.uniform(0, path.curve[leg].duration)) for leg in rng.integers(0, len(legs), count)]
    states = np.array([in_the_plane(path, leg, at, rng.normal(size=4) * 0.15) for leg, at in places])
    found = locate(problem, legs, states)
    dense = np.full(count, np.inf)
    since = 0.0
    for segment, leg in zip(path.curve, legs, strict=True):
        theta = np.linspace(0.0, segment.duration, 20_001)
        poses = segment.poses(theta).T
        point = ReferencePoint(segment.turn_rate.polynomial(theta), segment.speed.polynomial(theta))
        for k, state in enumerate(states):
            x = np.stack(np.broadcast_arrays(*to_deviation(problem.vehicle, tuple(state), poses, point)), axis=1)
            dense[k] = min(dense[k], float(leg.funnel.value(theta, x).min()))
        since += segment.duration
    assert (found.value <= dense + 1e-9).all()
    np.testing.assert_allclose(found.value, dense, atol=1e-5)
    begins = np.array([0.0, *(leg.end for leg in legs)])
    for k, leg in enumerate(found.leg):
        local = found.theta[k] - begins[leg]
        assert found.value[k] == pytest.approx(float(legs[leg].funnel.value(local, found.deviation[k])), abs=1e-9)
        back = in_the_plane(path, int(leg), float(local), found.deviation[k])
        np.testing.assert_allclose(back[1:], states[k][1:], atol=1e-6)
    np.testing.assert_array_equal(found.inside, found.value <= 1)


def test_on_the_reference_v_is_nothing_and_far_away_nobody_is_inside() -> None:
    path = oval()
    legs = legs_of(path, "contracting", 0.04)
    on = in_the_plane(path, 1, 1.234, np.zeros(4))
    turned = on + np.array([2 * np.pi, 0, 0, 0])  # a heading that has gone round once
    found = locate(Problem(path), legs, np.stack([on, turned, on + np.array([0, 5.0, 0, 0])]))
    np.testing.assert_allclose(found.theta[:2], path.curve[0].duration + 1.234, atol=1e-5)
    np.testing.assert_allclose(found.value[:2], 0.0, atol=1e-9)
    assert found.inside.tolist() == [True, True, False] and found.leg[0] == 1


def test_bad_questions_get_one_line() -> None:
    problem = Problem(straight(4.0), method=Method.TT)
    legs = legs_of(problem.path, "contracting", 0.04)
    for states, message in (
        (np.zeros(4), "states: expected an array of shape k × 4, got 4"),
        (np.zeros((1, 3)), "states: expected an array of shape k × 4, got 1 × 3"),
        (np.full((1, 4), np.nan), "states: expected finite numbers"),
    ):
        with pytest.raises(InputError, match=message):
            locate(problem, legs, states)
    with pytest.raises(InputError, match="got a tube, which has no course"):
        locate(Problem(tube(0.5), goal=ball(0.6)), legs, np.zeros((1, 4)))
