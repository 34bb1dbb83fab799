"""How far the vehicle's body is from obstacles, for many cars at once: the formulas of `cfjax.problem.obstacles`, which
asks a geometry library, once more in arrays.

An obstacle is the hull of its corners grown by a radius; a disc is one corner.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from cfjax.problem import FootprintDisc, Obstacle


class Surroundings(NamedTuple):
    """Obstacles (m, inertial frame) and the discs of the body (m, its own frame) as arrays."""

    corners: Float[Array, "o m 2"]  # counter-clockwise; the last one again, where an obstacle has fewer than others
    round: Float[Array, " o"]
    solid: Bool[Array, " o"]  # the hull has an inside
    radius: Float[Array, " d"]
    offset: Float[Array, " d"]


def surroundings(obstacles: Sequence[Obstacle], footprint: Sequence[FootprintDisc]) -> Surroundings:
    """At least one obstacle and one disc."""
    longest = max(len(obstacle.corners) for obstacle in obstacles)
    corners = []
    for obstacle in obstacles:
        own = np.array(obstacle.corners)
        after = np.roll(own, -1, axis=0)
        if (own[:, 0] * after[:, 1] - own[:, 1] * after[:, 0]).sum() < 0:
            own = own[::-1]
        corners.append(np.concatenate([own, np.repeat(own[-1:], longest - len(own), axis=0)]))
    return Surroundings(
        jnp.asarray(np.stack(corners)),
        jnp.array([float(obstacle.round) for obstacle in obstacles]),
        jnp.array([len(obstacle.corners) > 1 for obstacle in obstacles]),
        jnp.array([float(disc.radius) for disc in footprint]),
        jnp.array([float(disc.offset) for disc in footprint]),
    )


def distance(around: Surroundings, x: Float[Array, " k"], y: Float[Array, " k"]) -> Float[Array, " k"]:
    """Distance (m) of points from the nearest obstacle, below zero inside one."""
    a = around.corners
    edge = jnp.roll(a, -1, axis=1) - a
    along = edge[..., 0] ** 2 + edge[..., 1] ** 2
    dx, dy = x[:, None, None] - a[None, ..., 0], y[:, None, None] - a[None, ..., 1]
    ex, ey = edge[None, ..., 0], edge[None, ..., 1]
    share = jnp.clip((dx * ex + dy * ey) / jnp.where(along > 0, along, 1.0)[None], 0.0, 1.0)
    apart = jnp.sqrt(jnp.min((dx - share * ex) ** 2 + (dy - share * ey) ** 2, axis=2))
    inside = jnp.all(ex * dy - ey * dx >= 0, axis=2) & around.solid[None]
    return jnp.min(jnp.where(inside, -apart, apart) - around.round[None], axis=1)


def clearance(around: Surroundings, pose: Sequence[Array], x: Sequence[Array]) -> Float[Array, " k"]:
    """Distance (m) between the body and the nearest obstacle, below zero where they overlap.

    `pose` is the reference's, heading (rad) and position (m), `x` the deviation from it in its frame: arrays of k.
    """
    alpha, px, py = pose
    c, s = jnp.cos(alpha), jnp.sin(alpha)
    px, py, heading = px + c * x[1] - s * x[2], py + s * x[1] + c * x[2], alpha + x[0]
    ahead = -jnp.sin(heading), jnp.cos(heading)
    gaps = [
        distance(around, px + offset * ahead[0], py + offset * ahead[1]) - radius
        for radius, offset in zip(around.radius, around.offset, strict=True)
    ]
    return jnp.min(jnp.stack(gaps), axis=0)
