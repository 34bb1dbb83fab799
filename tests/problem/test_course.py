"""The reference as arrays is the path itself."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.problem import (
    Path,
    Pose,
    Profile,
    Segment,
    circle,
    ellipse,
    figure_eight,
    obstacle_path,
    oval,
    slalom,
    straight,
)
from cfjax.problem.course import point_at, poses_of, profiles_of


TWO_BREAKS = Path(  # turn rate and speed have breaks of their own, and both jump
    "jumps",
    (
        Segment(
            Profile((0.0, 0.7, 2.0), ((0.0, 0.5), (-3.0, 0.2, 0.3, -0.1, 0.02))),
            Profile((0.0, 1.1, 2.0), ((1.0, 0.0, 0.4), (0.5, 0.2))),
            Pose(0.3, 1.0, -2.0),
        ),
        Segment(Profile.constant(2.0, 1.0), Profile.constant(1.0, 1.0), Pose(7.0, 0.0, 5.0)),
    ),
)
PATHS = [straight(), circle(), oval(), figure_eight(), slalom(), obstacle_path(), ellipse(laps=3), TWO_BREAKS]


def along(path: Path, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random θ along the whole path, each with its segment and the θ in it."""
    ends = list(itertools.accumulate((s.duration for s in path.curve), initial=0.0))
    theta = np.sort(np.random.default_rng(0).uniform(0.0, ends[-1], count))
    own = np.clip(np.searchsorted(ends, theta, side="right") - 1, 0, len(path.curve) - 1)
    return theta, own, theta - np.array(ends)[own]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.name)
def test_points_are_those_of_the_segment(path: Path) -> None:
    theta, own, local = along(path, 300)
    profiles = profiles_of(path)
    at = jnp.asarray(theta)
    found = np.stack([np.broadcast_to(f, theta.shape) for f in point_at(profiles, profiles.find(at), at)], axis=1)
    wanted = np.array([path.curve[i].point(t) for i, t in zip(own, local, strict=True)])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.name)
def test_poses_are_the_integral(path: Path) -> None:
    theta, own, local = along(path, 3000)
    poses, at = poses_of(path, 0.0), jnp.asarray(theta)
    found = np.stack([place for place, _ in poses.at(poses.find(at), at)], axis=1)
    for index, segment in enumerate(path.curve):
        np.testing.assert_allclose(found[own == index], segment.poses(local[own == index]), rtol=0, atol=3e-8)


def test_cells_grow_with_the_path() -> None:
    short, long = (poses_of(ellipse(laps=laps), 0.0).begin.shape[0] for laps in (1, 4))
    assert long == 4 * short < 4000
