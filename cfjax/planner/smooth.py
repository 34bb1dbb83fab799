"""A way of lines and arcs becomes one whose curvature is continuous, and that keeps off obstacles.

Unknown are the curvatures at knots, between which they are linear in arc length, and the length of it all. Least
squares (Levenberg–Marquardt) weigh how fast curvature changes, its size, the length, the room beside obstacles, the
bound on curvature, and the end's pose; then the least change of curvatures moves the end to the goal, to rounding.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from cfjax.planner.bends import NODES, WEIGHTS, Bends
from cfjax.planner.dubins import Arcs
from cfjax.planner.field import Field
from cfjax.planner.search import BodyDiscs, Node


KNOT = 0.6  # radii of the tightest bend between knots
FEWEST_PIECES = 6
CHANGE, SIZE, LENGTH, ROOM, LIMIT, GOAL = 0.1, 0.1, 0.3, 30.0, 30.0, 100.0  # weights, of numbers without units
MOST_STEPS = 30
SETTLED = 1e-3  # relative: a step that improves less is the last
DAMPING = 1e-3  # of the normal equations, at first
ON_GOAL = 1e-11  # m and rad
NEWTON_STEPS = 8


def smoothed(
    arcs: Arcs, start: Node, goal: Node, field: Field, body: BodyDiscs, radius: float, spare: float
) -> Bends | None:
    """A smooth way near given arcs, with a radius (m) or more and, beyond what the body needs, `spare` m beside it.

    None where none is found that ends at the goal. Whether it is clear is not asked here.
    """
    length = sum(length for _, length in arcs)
    pieces = max(FEWEST_PIECES, round(length / (KNOT * radius)))
    fit = _Fit(start, goal, field, body, radius, spare, length, pieces)
    return fit.onto_goal(fit.solved(fit.near(arcs)))


@dataclass(frozen=True, eq=False)
class _Fit:
    """The question. An answer is an array: curvatures (1/m) at the knots, then the length (m)."""

    start: Node
    goal: Node
    field: Field
    body: BodyDiscs
    radius: float
    spare: float
    first_length: float
    pieces: int

    def near(self, arcs: Arcs) -> Float[np.ndarray, " unknowns"]:
        """Curvatures that are the arcs' means around the knots."""
        ends = np.concatenate([[0.0], np.cumsum([length for _, length in arcs])])
        turned = np.concatenate([[0.0], np.cumsum([curvature * length for curvature, length in arcs])])
        step = self.first_length / self.pieces
        around = np.clip(step * (np.arange(self.pieces + 2) - 0.5), 0, self.first_length)
        return np.append(np.diff(np.interp(around, ends, turned)) / np.diff(around), self.first_length)

    @cached_property
    def turning(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions at the nodes of each piece, and at its end: by the curvatures, for a length of one."""
        one = np.eye(self.pieces + 1)
        ends = np.cumsum((one[:-1] + one[1:]) / 2, axis=0)
        within = one[:-1, None] * (NODES - NODES**2 / 2)[:, None] + one[1:, None] * (NODES**2 / 2)[:, None]
        inner = within + (ends - (one[:-1] + one[1:]) / 2)[:, None]
        return inner / self.pieces, ends / self.pieces

    def ends(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Places and directions at the ends of the pieces, and their derivatives by all unknowns."""
        curvature, length = x[:-1], x[-1]
        inner, outer = self.turning
        turned = inner @ curvature
        moved = np.exp(1j * (self.start[1] + length * turned)) * (WEIGHTS / self.pieces)
        way = np.cumsum(moved.sum(axis=1))
        swung = 1j * length * moved
        by_curvature = length * np.cumsum(np.einsum("pg,pgk->pk", swung, inner), axis=0)
        by_length = way + np.cumsum((swung * turned).sum(axis=1))
        at_end = outer @ curvature
        return (
            self.start[0] + length * way,
            self.start[1] + length * at_end,
            np.column_stack([by_curvature, by_length]),
            np.column_stack([length * outer, at_end]),
        )

    def residuals(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is squared, and its derivatives."""
        curvature, length, radius = x[:-1], x[-1], self.radius
        place, direction, place_by, direction_by = self.ends(x)
        step = self.first_length / self.pieces / radius
        one = np.eye(len(x))
        ahead = np.exp(1j * direction)[:, None] * self.body.offset  # of each disc
        distance, slope = self.field.at(place[:, None] + ahead)
        short = self.spare - distance + self.body.need
        centre_by = place_by[:, None] + 1j * ahead[..., None] * direction_by[:, None]
        pushed = -np.real(slope.conj()[..., None] * centre_by)
        over = np.abs(curvature) * radius - 1
        off = self.goal_gap(place[-1], direction[-1])
        near, tight = short > 0, over > 0
        values = [
            CHANGE / np.sqrt(step) * radius * np.diff(curvature),
            SIZE * np.sqrt(step) * radius * curvature,
            [LENGTH * np.sqrt(length / radius)],
            ROOM / radius * short[near],
            LIMIT * over[tight],
            GOAL * off,
        ]
        derivatives = [
            CHANGE / np.sqrt(step) * radius * np.diff(one[:-1], axis=0),
            SIZE * np.sqrt(step) * radius * one[:-1],
            [LENGTH / (2 * np.sqrt(length * radius)) * one[-1]],
            ROOM / radius * pushed[near],
            LIMIT * radius * np.sign(curvature[tight])[:, None] * one[:-1][tight],
            GOAL * self.gap_by(place_by[-1], direction_by[-1]),
        ]
        return np.concatenate(values), np.concatenate(derivatives)

    def goal_gap(self, place: complex, direction: float) -> np.ndarray:
        """From the goal to the end: in radii, and rad."""
        gap = (place - self.goal[0]) / self.radius
        turn = np.angle(np.exp(1j * (direction - self.goal[1])))
        return np.array([gap.real, gap.imag, turn])

    def gap_by(self, place_by: np.ndarray, direction_by: np.ndarray) -> np.ndarray:
        return np.stack([np.real(place_by) / self.radius, np.imag(place_by) / self.radius, direction_by])

    def solved(self, x: np.ndarray) -> np.ndarray:
        """The least squares from a first answer on."""
        values, slopes = self.residuals(x)
        cost, damping = values @ values, DAMPING
        for _ in range(MOST_STEPS):
            normal = slopes.T @ slopes
            scale = np.diag(normal) + 1e-12
            found = x - np.linalg.solve(normal + damping * np.diag(scale), slopes.T @ values)
            if found[-1] <= 0.5 * self.first_length:
                damping *= 10
                continue
            values_there, slopes_there = self.residuals(found)
            there = values_there @ values_there
            if there < cost:
                settled = there > (1 - SETTLED) * cost
                x, values, slopes, cost, damping = found, values_there, slopes_there, there, damping / 5
                if settled:
                    break
            else:
                damping *= 5
        return x

    def onto_goal(self, x: np.ndarray) -> Bends | None:
        """The answer nearest to one that ends at the goal."""
        for _ in range(NEWTON_STEPS):
            place, direction, place_by, direction_by = self.ends(x)
            off = self.goal_gap(place[-1], direction[-1])
            if np.abs(off).max() <= ON_GOAL:
                lengths = np.full(self.pieces, x[-1] / self.pieces)
                return Bends(*self.start, lengths, x[:-2], x[1:-1])
            x = x - np.linalg.lstsq(self.gap_by(place_by[-1], direction_by[-1]), off, rcond=None)[0]
        return None
