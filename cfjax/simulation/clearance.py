"""How far the vehicle's body is from obstacles, for many cars at once: the formulas of `cfjax.problem.obstacles`, which
asks a geometry library, once more in arrays.

Obstacles are taken apart into hulls: corners grown by a radius.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cfjax.problem import FootprintDisc, Obstacle


class ObstacleArrays(NamedTuple):
    """Obstacles (m, inertial frame) and the discs of the body (m, its own frame) as arrays."""

    corners: Float[Array, "o m 2"]  # counter-clockwise; the last one again, where an obstacle has fewer than others
    round: Float[Array, " o"]
    solid: Bool[Array, " o"]  # the hull has an inside
    radius: Float[Array, " d"]
    offset: Float[Array, " d"]


def surroundings(obstacles: Sequence[Obstacle], footprint: Sequence[FootprintDisc]) -> ObstacleArrays:
    """At least one obstacle and one disc."""
    hulls = [hull for obstacle in obstacles for hull in obstacle.hulls]
    longest = max(len(hull.corners) for hull in hulls)
    corners = ([*hull.corners, *hull.corners[-1:] * (longest - len(hull.corners))] for hull in hulls)
    return ObstacleArrays(
        jnp.array(list(corners), float),
        jnp.array([float(hull.round) for hull in hulls]),
        jnp.array([len(hull.corners) > 2 for hull in hulls]),
        jnp.array([float(disc.radius) for disc in footprint]),
        jnp.array([float(disc.offset) for disc in footprint]),
    )


def distance(around: ObstacleArrays, x: Float[Array, " k"], y: Float[Array, " k"]) -> Float[Array, " k"]:
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


def clearance(around: ObstacleArrays, pose: Sequence[Array], x: Sequence[Array]) -> Float[Array, " k"]:
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
