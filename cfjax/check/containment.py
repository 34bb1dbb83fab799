"""Conditions (a), (b), (c) in exact arithmetic: matrix inequalities over the rationals.

With the funnel {xᵀ C x ≤ ρ(θ)}, I = {xᵀ P_I x ≤ 1}, G = {xᵀ P_G x < 1} and the box S = {|x_i| ≤ s_i}:

    (a)  C ≺ P_I                     V(0, x) < 1 on I
    (b)  C ≻ ρ(T) P_G, ρ(T) > 0      V(T, x) > 1 outside G
    (c)  ρ(θ) (C⁻¹)_ii < s_i²        V > 1 outside S;  with s = π for the heading, where it wraps

Where ρ is not rational, a rational above it stands for it.
"""

from collections.abc import Sequence
from typing import NamedTuple

from flint import fmpq, fmpq_mat

from cfjax.check.bounds import Range
from cfjax.check.program import Matrix
from cfjax.check.rational import is_positive_definite, pi_lower, sqrt_upper


HEADING = "alpha"


class Asked(NamedTuple):
    """The sets that one funnel is asked about: half-axes of I and G, half-widths of S, one per state.

    None where nothing is asked: of funnels between the first and the last one the joints are proven instead.
    """

    inlet: Sequence[fmpq] | None
    goal: Sequence[fmpq] | None
    safe: Sequence[fmpq] | None


def broken_containments(states: Sequence[str], shape: Matrix, end: Range, asked: Asked) -> list[str]:
    """What is not proven of (a), (b), (c): one line each, none for a funnel that keeps them.

    `end` are rationals below and above ρ(T).
    """
    lowest_end, highest_end = end
    inlet, goal, safe = asked
    broken = []
    if inlet is not None and not is_positive_definite(_difference(_diagonal(inlet), shape, fmpq(1))):
        broken.append("condition (a): the inlet I does not lie inside the funnel's start")
    if lowest_end <= 0:
        broken.append("condition (b): the funnel is empty before its end")
    if goal is not None and not is_positive_definite(_difference(shape, _diagonal(goal), highest_end)):
        broken.append("condition (b): the funnel's end does not lie inside the goal G")
    if not is_positive_definite(shape):
        return [*broken, "condition (c): C is not positive definite, the funnel is not bounded"]
    inverse = fmpq_mat([list(row) for row in shape]).inv()
    widest = max(fmpq(1), highest_end)
    for i, state in enumerate(states):
        reach_squared = widest * inverse[i, i]
        if safe is not None and not reach_squared < safe[i] ** 2:
            broken.append(f"condition (c): the funnel leaves the safe set S in {state}")
        if state == HEADING and not reach_squared < pi_lower() ** 2:
            broken.append("condition (c): the funnel reaches the heading where it wraps")
    return broken


def half_widths(shape: Matrix) -> list[fmpq]:
    """Rationals that are at least the largest |x_i| with xᵀ C x ≤ 1, in the units of the states."""
    inverse = fmpq_mat([list(row) for row in shape]).inv()
    return [sqrt_upper(inverse[i, i]) for i in range(len(shape))]


def _diagonal(half_axes: Sequence[fmpq]) -> list[list[fmpq]]:
    """P with {xᵀ P x ≤ 1}."""
    size = len(half_axes)
    return [[1 / half_axes[i] ** 2 if i == j else fmpq(0) for j in range(size)] for i in range(size)]


def _difference(first: Matrix, second: Matrix, factor: fmpq) -> list[list[fmpq]]:
    """first − factor · second."""
    return [
        [a - factor * b for a, b in zip(upper, lower, strict=True)] for upper, lower in zip(first, second, strict=True)
    ]
