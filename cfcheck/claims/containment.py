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

from cfcheck.claims.problem import ProblemClaim
from cfcheck.claims.proven import Violation
from cfcheck.exact.rational import Matrix, Range, is_positive_definite, pi_lower, pi_upper, sqrt_upper
from cfcheck.reader import Broken


HEADING = "alpha"


class Sets(NamedTuple):
    """What one funnel is compared with: half-axes of I and G, half-widths of S, one per state; None where nothing is.

    Of funnels between the first and the last one the joints are proven instead of I and G.
    """

    inlet: Sequence[fmpq] | None
    goal: Sequence[fmpq] | None
    safe: Sequence[fmpq] | None

    @classmethod
    def of(cls, problem: ProblemClaim, is_first: bool, is_last: bool) -> "Sets":
        """Those of a problem for a funnel along its path."""
        return cls(problem.inlet if is_first else None, problem.goal if is_last else None, problem.safe)


def broken_containments(states: Sequence[str], shape: Matrix, end: Range, sets: Sets) -> list[str]:
    """What is not proven of (a), (b), (c): one line each, none for a funnel that keeps them.

    `end` are rationals below and above ρ(T).
    """
    lowest_end, highest_end = end
    inlet, goal, safe = sets
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


def confirm_violation(
    condition: str, states: Sequence[str], sets: Sets, x: Sequence[fmpq], form: fmpq, inside: bool
) -> Violation:
    """What a deviation x violates of (a), (b), (c); `form` is its xᵀ C x, `inside` says that V ≤ 1 there.

    Raises:
        Broken: nothing is asked there, or it is not violated.
    """
    axes = {"a": sets.inlet, "b": sets.goal}.get(condition, ())
    if axes is None:
        raise Broken(f"witness: condition ({condition}) is not asked here")
    if condition == "a":
        if not _form_of_axes(axes, x) <= 1 <= form:
            raise Broken("witness: not a deviation of the inlet I at which V is 1 or more")
        return Violation.INLET
    if condition == "b":
        if not (inside and _form_of_axes(axes, x) >= 1):
            raise Broken("witness: not a deviation outside the goal G at which V(T, x) is 1 or less")
        return Violation.GOAL
    outside = sets.safe is not None and any(abs(xi) > si for xi, si in zip(x, sets.safe, strict=True))
    if not (inside and (outside or heading_of(states, x) >= pi_upper())):
        raise Broken("witness: not a deviation outside the safe set S, or beyond pi, at which V is 1 or less")
    return Violation.SAFE if outside else Violation.HEADING


def heading_of(states: Sequence[str], x: Sequence[fmpq]) -> fmpq:
    """|α|, rad; 0 where no state is one."""
    return abs(x[states.index(HEADING)]) if HEADING in states else fmpq(0)


def _form_of_axes(axes: Sequence[fmpq], x: Sequence[fmpq]) -> fmpq:
    return sum(((xi / axis) ** 2 for xi, axis in zip(x, axes, strict=True)), fmpq(0))


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
