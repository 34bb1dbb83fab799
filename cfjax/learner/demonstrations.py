"""Demonstrations: the input at a witness, by a demonstrator or as the best vertex of a candidate.

A demonstrator is a function of points; nothing is known of it but that its inputs lie in the problem's box, and that
is looked at. Without one a witness begins with the vertex along which the candidate itself falls fastest.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from cfjax.errors import InputError
from cfjax.funnel import Template
from cfjax.learner.witnesses import dynamics
from cfjax.problem import Problem
from cfjax.problem.input_box import InputBox


ZERO = 1e-9  # authority, relative to the largest, below which an input has none
OUTSIDE = 1e-9  # relative, by which a demonstrated input may leave its interval: rounding, taken back

Demonstrate = Callable[[Float[np.ndarray, " k"], Float[np.ndarray, "k n"]], Float[np.ndarray, "k m"]]


def demonstrated(
    problem: Problem, demonstrate: Demonstrate, theta: Float[np.ndarray, " k"], x: Float[np.ndarray, "k n"]
) -> Float[np.ndarray, "k m"]:
    """What the demonstrator says, inside the box.

    Raises:
        InputError: for demonstrations that are no inputs.
    """
    box = InputBox.of(problem.inputs)
    middle, half = box.middle, box.half
    inputs, shape = np.asarray(demonstrate(theta, x), float), (len(theta), len(middle))
    if not np.isfinite(inputs).all():
        raise InputError(f"demonstrator: expected finite inputs, got {np.sum(~np.isfinite(inputs))} that are not")
    if inputs.shape != shape or not (np.abs(inputs - middle) <= half * (1 + OUTSIDE)).all():
        raise InputError(
            f"demonstrator: expected inputs within the problem's box, of shape {shape}, got shape {inputs.shape}"
        )
    return np.clip(inputs, middle - half, middle + half)


def best_vertices(
    problem: Problem,
    template: Template,
    rate: float,
    shape: Float[np.ndarray, "n n"],
    theta: Float[np.ndarray, " k"],
    x: Float[np.ndarray, "k n"],
) -> Float[np.ndarray, "k m"]:
    """The vertices of the input box (u0, u) along which V = `template` with C = shape falls fastest, in closed form.

    An input without authority stays in the middle of its interval.
    """
    return vertices(problem, template, rate, shape, x, dynamics(problem, theta, x)[1])


def vertices(
    problem: Problem,
    template: Template,
    rate: float,
    shape: Float[np.ndarray, "n n"],
    x: Float[np.ndarray, "k n"],
    columns: Float[np.ndarray, "k n m"],
) -> Float[np.ndarray, "k m"]:
    """As `best_vertices`, where the columns of the inputs at x are known."""
    slopes = 2 * x @ shape
    authority = np.einsum("ki,kij->kj", slopes, columns)
    authority[:, 0] += np.asarray(template.timing(rate, np.einsum("ki,ij,kj->k", x, shape, x)))
    largest = np.einsum("ki,kij->kj", np.abs(slopes), np.abs(columns)) + 1e-300
    downwards = np.where(np.abs(authority) > ZERO * largest, -authority, 0.0)
    return InputBox.of(problem.inputs).extreme_point(downwards)
