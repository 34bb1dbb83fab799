"""Distances from a map's obstacles on a grid, for a search and a fit that ask for very many of them.

Exact at the nodes, linear between them; negative inside obstacles. Only what is nearer than `reach` is told apart.
Places are complex numbers x + iy, m.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from cfjax.planner.convex import Solid
from cfjax.problem import Disc


@dataclass(frozen=True, eq=False)
class Field:
    """Distances (m) at places origin + step (column + i row)."""

    origin: complex
    step: float
    distance: Float[np.ndarray, "rows columns"]

    def at(self, places: Complex[np.ndarray, "*n"]) -> tuple[np.ndarray, np.ndarray]:
        """Distances, and their gradients as complex numbers; beyond the grid those of its edge."""
        rows, columns = self.distance.shape
        at = (places - self.origin) / self.step
        x, y = np.clip(at.real, 0, columns - 1.001), np.clip(at.imag, 0, rows - 1.001)
        column, row = x.astype(int), y.astype(int)
        x, y = x - column, y - row
        flat, index = self.distance.ravel(), row * columns + column
        a, b, c, d = flat[index], flat[index + 1], flat[index + columns], flat[index + columns + 1]
        low, high = a + x * (b - a), c + x * (d - c)
        slope = (b - a) * (1 - y) + (d - c) * y + 1j * (high - low)
        return low + y * (high - low), slope / self.step


def field_of(
    obstacles: Sequence[Solid],
    grown: Float[np.ndarray, " obstacles"],
    rectangle: tuple[float, float, float, float],
    step: float,
    reach: float,
) -> Field:
    """The field of obstacles, each grown by a length (m), over a rectangle,
    whose edge is an obstacle too."""
    left, bottom, right, top = rectangle
    columns, rows = math.ceil((right - left) / step) + 1, math.ceil((top - bottom) / step) + 1
    x, y = left + step * np.arange(columns), bottom + step * np.arange(rows)
    edges = np.minimum.outer(np.minimum(y - bottom, top - y), np.minimum(x - left, right - x))
    distance = np.minimum(edges, reach)
    for obstacle, growth in zip(obstacles, grown, strict=True):
        low, high = _box(obstacle, reach + growth)
        columns_near = slice(*np.searchsorted(x, (low.real, high.real)))
        own = slice(*np.searchsorted(y, (low.imag, high.imag))), columns_near
        places = x[own[1]] + 1j * y[own[0], None]
        if places.size:
            np.minimum(distance[own], signed_distance(obstacle, places) - growth, out=distance[own])
    return Field(complex(left, bottom), step, distance)


def _box(obstacle: Solid, margin: float) -> tuple[complex, complex]:
    """Lower and upper corner of a rectangle around an obstacle."""
    if isinstance(obstacle, Disc):
        middle, size = complex(obstacle.x, obstacle.y), (obstacle.radius + margin) * (1 + 1j)
        return middle - size, middle + size
    corners = np.array(obstacle.corners)
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    return complex(*low), complex(*high)


def signed_distance(obstacle: Solid, places: Complex[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Distances (m) of places from a disc or convex polygon; inside it minus those from its edge."""
    if isinstance(obstacle, Disc):
        return np.abs(places - complex(obstacle.x, obstacle.y)) - obstacle.radius
    corners = np.array([complex(*corner) for corner in obstacle.corners])
    if np.imag(np.conj(corners) @ np.roll(corners, -1)) < 0:
        corners = corners[::-1]
    deepest, nearest = np.full(places.shape, -np.inf), np.full(places.shape, np.inf)
    for corner, edge in zip(corners, np.roll(corners, -1) - corners, strict=True):
        length = abs(edge)
        turned = (places - corner) * (np.conj(edge) / length)  # along the edge, and to its left, which is inside
        np.maximum(deepest, -turned.imag, out=deepest)
        beyond = np.maximum(np.maximum(-turned.real, turned.real - length), 0.0)
        np.minimum(nearest, beyond**2 + turned.imag**2, out=nearest)
    return np.where(deepest < 0, deepest, np.sqrt(nearest))
