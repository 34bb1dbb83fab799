"""Distances in arrays are those of the geometry library."""

import jax.numpy as jnp
import numpy as np
import shapely

from cfjax.problem import Disc, FootprintDisc, Polygon
from cfjax.problem.obstacles import disc_centres, distances
from cfjax.simulation.clearance import clearance, distance, surroundings


SQUARE = Polygon(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
KITE = Polygon(((2.0, 0.0), (3.0, 2.0), (2.0, 3.0), (1.5, 2.5), (1.4, 2.0)))
CLOCKWISE = Polygon(((-1.0, -1.0), (-2.0, 1.0), (-1.0, 0.5)))
DISC = Disc(-1.0, 2.0, 0.4)
BODY = (FootprintDisc(0.25, 0.0), FootprintDisc(0.2, 0.35))


def points(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-3.5, 4.0, (count, 2))


def test_distances_from_each_kind() -> None:
    at = points(2000)
    x, y = jnp.asarray(at.T)
    for obstacle in (SQUARE, KITE, CLOCKWISE, DISC):
        for around in (
            (obstacle,),
            (obstacle, Disc(100.0, 0.0, 1.0)),
            (obstacle, Polygon(tuple((100 + a, b) for a, b in KITE.corners))),
        ):
            found = np.asarray(distance(surroundings(around, BODY), x, y))
            wanted, _ = distances(obstacle, at)
            np.testing.assert_allclose(np.maximum(found, 0.0), wanted, atol=1e-12)
            if isinstance(obstacle, Polygon):
                shape = shapely.Polygon(obstacle.corners)
                inside = shapely.contains(shape, shapely.points(at))
                depth = shapely.distance(shape.exterior, shapely.points(at))
                assert inside.any()
                np.testing.assert_allclose(found[inside], -depth[inside], atol=1e-12)


def test_the_body_is_where_the_deviation_puts_it() -> None:
    rng = np.random.default_rng(1)
    reference = np.concatenate([rng.uniform(-7, 7, (500, 1)), points(500)], axis=1)
    x = rng.uniform(-1, 1, (500, 4))
    obstacles = (SQUARE, KITE, CLOCKWISE, DISC)
    found = clearance(surroundings(obstacles, BODY), tuple(jnp.asarray(reference.T)), tuple(jnp.asarray(x.T)))
    c, s = np.cos(reference[:, 0]), np.sin(reference[:, 0])
    place = reference[:, 1:] + np.stack([c * x[:, 1] - s * x[:, 2], s * x[:, 1] + c * x[:, 2]], axis=1)
    poses = np.concatenate([reference[:, :1] + x[:, :1], place], axis=1)
    gaps = [distances(o, centres)[0] - radius for o in obstacles for radius, centres in disc_centres(BODY, poses)]
    wanted = np.min(gaps, axis=0)
    clear = wanted > -0.15  # deeper, the library only says that it is inside
    np.testing.assert_allclose(np.asarray(found)[clear], wanted[clear], atol=1e-12)
    assert (np.asarray(found)[~clear] < 0).all() and (~clear).any()
