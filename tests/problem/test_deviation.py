"""The derived deviation dynamics against the inertial model, and what they promise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cfjax.problem import KinematicBicycle, Pose, Profile, Segment, affine_deviation, deviation_rate
from cfjax.problem.path import circle, straight


BENT = Segment(
    turn_rate=Profile((0.0, 1.0, 2.5), ((0.3, -0.4, 0.5), (0.4, 0.6, 0.0, -0.2))),
    speed=Profile((0.0, 2.5), ((1.5, 0.3, -0.1),)),
    start=Pose(0.7, -1.0, 2.0),
)
SEGMENTS = {
    "straight": straight(8.0, 2.0).segments[0],
    "circle": circle(1.5, 2.0).segments[0],
    "bent": BENT,
}


def to_plane(deviation: np.ndarray, pose: np.ndarray, speed: float) -> np.ndarray:
    """The paper's transformation from the body-fixed frame to the inertial one."""
    alpha, x, y, v = deviation
    c, s = np.cos(pose[0]), np.sin(pose[0])
    return np.array([alpha + pose[0], c * x - s * y + pose[1], s * x + c * y + pose[2], v + speed])


@pytest.mark.parametrize("name", SEGMENTS)
def test_deviation_follows_the_inertial_model(name: str) -> None:
    segment, vehicle = SEGMENTS[name], KinematicBicycle()
    dynamics = jax.jit(lambda x, point: affine_deviation(vehicle, x, point))
    end = 1.5  # s; the reference time stays below 2.2 s

    def inputs(t: float) -> tuple[float, float, float]:
        return 1.2 + 0.25 * np.sin(3 * t), 0.6 * np.cos(2 * t), 1.5 * np.sin(5 * t)

    def deviation(t: float, z: np.ndarray) -> np.ndarray:
        theta, x = z[0], z[1:]
        drift, columns = dynamics(x, segment.point(theta))
        v = np.array(inputs(t))
        return np.concatenate([v[:1], np.asarray(drift) + np.asarray(columns) @ v])

    def inertial(t: float, z: np.ndarray) -> np.ndarray:  # eq. (bicycle-model) of the paper, written out
        alpha, _, _, v = z
        _, w, thrust = inputs(t)
        return np.array([v / 0.34 * w, -v * np.sin(alpha), v * np.cos(alpha), thrust])

    start = np.array([0.3, -0.2, 0.4, 0.5])
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "max_step": 0.02}
    moved = solve_ivp(deviation, (0, end), np.concatenate([[0.0], start]), **options).y[:, -1]
    plane_start = to_plane(start, segment.poses(np.array([0.0]))[0], segment.point(0.0).speed)
    expected = solve_ivp(inertial, (0, end), plane_start, **options).y[:, -1]
    theta = moved[0]
    got = to_plane(moved[1:], segment.poses(np.array([theta]))[0], segment.point(theta).speed)
    np.testing.assert_allclose(got, expected, atol=2e-9)


def test_dynamics_are_affine_in_the_inputs() -> None:
    vehicle, point = KinematicBicycle(), BENT.point(0.8)
    rng = np.random.default_rng(0)
    for _ in range(20):
        x, v = jnp.asarray(rng.normal(size=4)), rng.normal(size=3)
        drift, columns = affine_deviation(vehicle, x, point)
        direct = np.array(deviation_rate(vehicle, tuple(x), tuple(v), point))
        np.testing.assert_allclose(drift + columns @ v, direct, atol=1e-12)


def test_poses_of_a_circle_close() -> None:
    path = circle(radius=2.0, speed=3.0)
    segment = path.segments[0]
    first, last = segment.poses(np.array([0.0, segment.duration]))
    np.testing.assert_allclose(last - first, [2 * np.pi, 0, 0], atol=1e-12)


def test_poses_converge_for_a_bent_path() -> None:
    theta = np.linspace(0, BENT.duration, 7)
    fine = solve_ivp(
        lambda t, p: [
            BENT.point(t).turn_rate,
            -BENT.point(t).speed * np.sin(p[0]),
            BENT.point(t).speed * np.cos(p[0]),
        ],
        (0, BENT.duration),
        list(BENT.start),
        t_eval=theta,
        rtol=1e-11,
        atol=1e-12,
        max_step=0.01,
    )
    np.testing.assert_allclose(BENT.poses(theta), fine.y.T, atol=1e-9)
