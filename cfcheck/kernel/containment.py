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

from cfcheck.exact.definite import exact_matrix, is_positive_definite
from cfcheck.exact.rational import Matrix, Range, pi_lower, sqrt_upper


HEADING = "alpha"


class Sets(NamedTuple):
    """Half-axes of I and G and half-widths of S, one per state; None where there is no such set.

    Only the first funnel of a path is compared with I, and only the last one with G.
    """

    inlet: Sequence[fmpq] | None
    goal: Sequence[fmpq] | None
    safe: Sequence[fmpq] | None


def broken_containments(states: Sequence[str], shape: Matrix, end: Range, sets: Sets) -> list[str]:
    """What is not proven of (a), (b), (c): one line each, none for a funnel that satisfies them.

    `end` are rationals below and above ρ(T).
    """
    lowest_end, highest_end = end
    form, broken = exact_matrix(shape), []
    if sets.inlet is not None and not is_positive_definite(_ellipsoid(sets.inlet) - form):
        broken.append("condition (a): the inlet I does not lie inside the funnel's start")
    if lowest_end <= 0:
        broken.append("condition (b): the funnel is empty before its end")
    if sets.goal is not None and not is_positive_definite(form - highest_end * _ellipsoid(sets.goal)):
        broken.append("condition (b): the funnel's end does not lie inside the goal G")
    if not is_positive_definite(form):
        return [*broken, "condition (c): C is not positive definite, the funnel is not bounded"]
    inverse, widest = form.inv(), max(fmpq(1), highest_end)
    for i, state in enumerate(states):
        reach_squared = widest * inverse[i, i]
        if sets.safe is not None and not reach_squared < sets.safe[i] ** 2:
            broken.append(f"condition (c): the funnel leaves the safe set S in {state}")
        if state == HEADING and not reach_squared < pi_lower() ** 2:
            broken.append("condition (c): the funnel reaches the heading where it wraps")
    return broken


def half_widths(shape: Matrix) -> list[fmpq]:
    """Rationals that are at least the largest |x_i| with xᵀ C x ≤ 1, in the units of the states."""
    inverse = exact_matrix(shape).inv()
    return [sqrt_upper(inverse[i, i]) for i in range(len(shape))]


def _ellipsoid(half_axes: Sequence[fmpq]) -> fmpq_mat:
    """The diagonal P for which {xᵀ P x ≤ 1} has these half-axes."""
    size = len(half_axes)
    return fmpq_mat(size, size, [1 / axis**2 if i == j else 0 for i, axis in enumerate(half_axes) for j in range(size)])
