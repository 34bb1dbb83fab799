"""Revised demonstrations: inputs of all witnesses chosen anew, for the candidate that they leave the most room.

After every candidate, in turns with the centre of the largest ball that is left. At that centre each witness takes the
input, of its present one and a grid of the box with its vertices, whose half-space lies farthest away, so the ball only
grows. (The vertex along which V falls fastest leaves the most slack, but its half-space is steep: less room, not more;
and near a ridge neighbouring witnesses would take opposite vertices.)
"""

import itertools
import math

import numpy as np
from jaxtyping import Float

from cfjax.learner.centre import Polytope, largest_ball
from cfjax.learner.coefficients import Coordinates
from cfjax.learner.witnesses import Witnesses, decrease, with_one
from cfjax.problem import Problem
from cfjax.problem.input_box import InputBox


TURNS, WORTH = 30, 1e-4  # of all inputs in a row, at most; and by how much the ball has to grow each time
LEVELS = (-1.0, -0.5, 0.0, 0.5, 1.0)  # of each input, tried in a revision


def revised(
    problem: Problem, coordinates: Coordinates, witnesses: Witnesses, margin: float, others: Polytope
) -> Witnesses:
    """The witnesses with the inputs that leave the largest ball in the box of coefficients and `others`.

    Raises:
        CentreError: where the solver finds no ball.
    """
    box = Polytope.box(coordinates.lower, coordinates.upper)
    hard, largest = box.cut(coordinates.known()).cut(others), -math.inf
    rows, offsets = decrease(coordinates, witnesses, margin)
    grid = _grid(problem)
    inputs = witnesses.inputs
    for _ in range(TURNS):
        soft = Polytope(np.einsum("kj,kjr->kr", with_one(inputs), rows), offsets)
        point, radius = largest_ball(hard.cut(soft))
        if not radius > largest + WORTH:
            break
        largest, witnesses = radius, witnesses._replace(inputs=inputs)
        inputs = _roomiest(inputs, grid, rows, offsets, point)
    return witnesses


def _grid(problem: Problem) -> Float[np.ndarray, "g m"]:
    box = InputBox.of(problem.inputs)
    levels = (LEVELS if width else (0.0,) for width in box.half)
    return box.middle + box.half * np.array(list(itertools.product(*levels)))


def _roomiest(
    inputs: Float[np.ndarray, "k m"],
    grid: Float[np.ndarray, "g m"],
    rows: Float[np.ndarray, "k p r"],
    offsets: Float[np.ndarray, " k"],
    c: Float[np.ndarray, " r"],
) -> Float[np.ndarray, "k m"]:
    """The input at each witness whose half-space lies farthest from c: of the present one and those of the grid."""
    tried = np.concatenate([inputs[:, None], np.repeat(grid[None], len(inputs), axis=0)], axis=1)
    weights = with_one(tried)
    size = np.einsum("kgi,kir,kjr,kgj->kg", weights, rows, rows, weights, optimize=True)
    slack = offsets[:, None] - np.einsum("kgj,kj->kg", weights, rows @ c)
    best = (slack / np.sqrt(np.maximum(size, 1e-300))).argmax(axis=1)
    return tried[np.arange(len(inputs)), best]
