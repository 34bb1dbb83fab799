"""Chains of funnels: what links and obstacles ask, against sampling, and a chain that is learned as a whole."""

import jax.numpy as jnp
import numpy as np
import pytest
import shapely

from cfjax.falsifier import falsify
from cfjax.funnel import TEMPLATES
from cfjax.funnel.conditions import CLEAR, containment_excess, link_excess
from cfjax.funnel.instance import PLACES, chain_of, instance_of, links_of
from cfjax.learner import learn
from cfjax.problem import (
    Box,
    Disc,
    FootprintDisc,
    Method,
    Polygon,
    Problem,
    ball,
    circle,
    ellipse,
    figure_eight,
    obstacle_path,
    oval,
    slalom,
    straight,
)


CONTRACTING = TEMPLATES["contracting"]
SQUARE = Polygon(((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)))


def random_shapes(rng: np.random.Generator, count: int, size: float) -> np.ndarray:
    root = rng.normal(size=(count, 4, 4)) * 0.3 + np.eye(4) / size
    return root @ root.transpose(0, 2, 1)


def on_boundary(rng: np.random.Generator, shape: np.ndarray, level: float, count: int) -> np.ndarray:
    direction = rng.normal(size=(count, 4))
    return direction * np.sqrt(level / np.einsum("ki,ij,kj->k", direction, shape, direction))[:, None]


def test_equal_segments_are_one_kind_and_follow_each_other() -> None:
    assert oval().kinds == (0, 0) and links_of(oval()) == []
    assert figure_eight().kinds == (0, 1) and links_of(figure_eight()) == [(0, 1), (1, 0)]
    assert slalom().kinds == (0, 1) * 3 and links_of(slalom()) == [(0, 1), (1, 0)]
    assert ellipse(segments=4).kinds == (0, 1, 0, 1)
    assert [path.closed for path in (oval(), circle(), figure_eight(), slalom(), straight())] == [True] * 3 + [
        False
    ] * 2


@pytest.mark.parametrize("template", TEMPLATES.values(), ids=lambda t: t.name)
def test_a_link_is_kept_where_no_end_point_leaves_the_next_start(template) -> None:
    problem = Problem(figure_eight())
    chain = chain_of(problem, template, 0.9)
    duration = np.asarray(chain.funnels.duration)
    rng = np.random.default_rng(0)
    signs = set()
    for _ in range(40):
        shapes = random_shapes(rng, 2, rng.uniform(0.6, 0.8))
        rates = rng.uniform(0.05, 0.15, 2)
        factors = np.linalg.cholesky(np.linalg.inv(shapes))
        excess = np.asarray(link_excess(template, chain, jnp.asarray(factors), jnp.asarray(rates))).reshape(2, 4)
        for (first, second), own in zip(chain.links, excess, strict=True):
            end = float(template.level(rates[first], duration[first]))
            x = on_boundary(rng, shapes[first], end, 4000)
            worst = np.einsum("ki,ij,kj->k", x, shapes[second], x).max()
            assert worst <= 1 + own.max() + 1e-9  # sampled points are no worse than the worst
            assert worst >= 0.8 * (1 + own.max())
            signs.add(bool(own.max() < 0))
    assert signs == {True, False}


@pytest.mark.parametrize("obstacles", [(SQUARE,), (Disc(0.1, 0.0, 0.2), Disc(-1.0, 1.2, 0.3))], ids=["square", "discs"])
@pytest.mark.parametrize("footprint", [(FootprintDisc(),), (FootprintDisc(0.15, 0.15), FootprintDisc(0.15, -0.1))])
def test_obstacles_are_cleared_where_no_sampled_body_touches_them(obstacles, footprint) -> None:
    problem = Problem(obstacle_path(), ball(0.05), ball(0.5), obstacles=obstacles, footprint=footprint)
    (segment,) = problem.path.curve
    instance = instance_of(problem, segment, CONTRACTING, 0.9)
    shapes = [
        shapely.Point(o.x, o.y).buffer(o.radius, quad_segs=64) if isinstance(o, Disc) else shapely.Polygon(o.corners)
        for o in obstacles
    ]
    rng = np.random.default_rng(1)
    theta = np.linspace(0, segment.duration, PLACES)
    poses = segment.poses(theta)
    decided = set()
    for size in (0.05, 0.13, 0.3, 0.6):
        shape, rate = random_shapes(rng, 1, size)[0], 0.4
        factor = np.linalg.cholesky(np.linalg.inv(shape))
        excess = np.asarray(containment_excess(CONTRACTING, instance, jnp.asarray(factor), rate))[12:]
        x = on_boundary(rng, shape, 1.0, 500)[None] * np.exp(-0.5 * rate * theta)[:, None, None]
        lateral = np.stack([np.cos(poses[:, 0]), np.sin(poses[:, 0])], axis=1)[:, None]
        forward = np.stack([-np.sin(poses[:, 0]), np.cos(poses[:, 0])], axis=1)[:, None]
        heading = poses[:, None, 0] + x[..., 0]
        apart = []
        for disc in footprint:
            facing = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
            centre = poses[:, None, 1:] + x[..., 1:2] * lateral + x[..., 2:3] * forward + disc.offset * facing
            points = shapely.points(centre.reshape(-1, 2))
            apart.append(min(shapely.distance(points, shape).min() for shape in shapes) - disc.radius)
        clearance = -excess.max() * problem.inlet.half_axes[1] + CLEAR  # m
        if clearance > 0:
            assert min(apart) >= clearance - 2e-3
        # half-planes lose little, and a disc ahead of the axle what turning takes to second order
        turning = 0.5 * max(abs(disc.offset) for disc in footprint) * np.linalg.inv(shape)[0, 0]
        assert clearance >= min(apart) - 0.03 - turning or min(apart) <= 0.0
        decided.add(bool(clearance > 0))
    assert decided == {True, False}


@pytest.mark.slow
def test_the_figure_eight_is_learned_as_a_chain_that_closes() -> None:
    problem = Problem(figure_eight(), safe=Box((1.0, 1.0, 1.0, 3.0)), method=Method.TT)
    found = learn(problem, CONTRACTING)
    assert found is not None and found.excess < 0 < found.margin
    first, second = found.funnels
    assert not np.allclose(first.shape, second.shape, atol=1e-2)  # one bends to the left, one to the right
    rng = np.random.default_rng(2)
    for one, other in ((first, second), (second, first)):
        x = on_boundary(rng, one.shape, one.end_level, 5000)
        assert other.value(0.0, x).max() < 1
    assert np.linalg.eigvalsh(problem.inlet.shape - first.shape).min() > 0  # (a) of the first alone
    assert np.linalg.eigvalsh(second.shape - second.end_level * problem.goal.shape).min() > 0  # (b) of the last alone
    for segment, funnel in zip(problem.path.distinct, found.funnels, strict=True):
        worst = {point.condition: point for point in falsify(problem, segment, funnel, seed=4)}
        assert worst["d"].slack >= found.margin * (1 - 0.02)
        assert ("a" in worst, "b" in worst) == (funnel is first, funnel is second)
