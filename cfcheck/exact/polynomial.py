"""Polynomials over the rationals: whether one is nowhere below zero on an interval, decided exactly.

By Bernstein coefficients, which enclose the polynomial on the interval, and where they leave it open by the roots of
its part without squares.
"""

import itertools
from collections.abc import Sequence
from math import comb

from flint import fmpq, fmpq_poly


Coefficients = tuple[fmpq, ...]  # ascending powers


def bernstein(coefficients: Sequence[fmpq], length: fmpq) -> list[fmpq]:
    """Bernstein coefficients on [0, length]: least and largest enclose the polynomial."""
    size = len(coefficients)
    result, power = [], fmpq(1)
    for k, coefficient in enumerate(coefficients):
        result.append(coefficient * power / comb(size - 1, k))
        power *= length
    for k in range(1, size):
        for i in range(size - 1, k - 1, -1):
            result[i] += result[i - 1]
    return result


def is_nonnegative(coefficients: Sequence[fmpq], length: fmpq) -> bool:
    """Whether the polynomial is nowhere below zero on [0, length], ends included: decided exactly."""
    control = bernstein(coefficients, length)
    if min(control) >= 0:
        return True
    if control[0] < 0 or control[-1] < 0:
        return False
    unit = fmpq_poly([c * length**k for k, c in enumerate(coefficients)])  # on [0, 1]
    _, factors = unit.factor_squarefree()
    changing = fmpq_poly([1])  # it changes its sign at the roots of odd multiplicity, and nowhere else
    for factor, multiplicity in factors:
        if multiplicity % 2:
            changing *= factor
    if _has_simple_root(bernstein(changing.coeffs(), fmpq(1))):
        return False
    size = unit.degree() + 2  # so many points are not all roots
    return next(value for k in range(1, size + 1) if (value := unit(fmpq(k, size + 1))) != 0) > 0


def _has_simple_root(control: list[fmpq]) -> bool:
    """Whether a polynomial without double roots has a root in the open interval (0, 1).

    Descartes: the changes of sign among Bernstein coefficients are as many as the roots, or more by an even number;
    halving ends because without double roots they come to none or one.
    """
    open_ = [control]
    while open_:
        control = open_.pop()
        signs = [c > 0 for c in control if c != 0]
        changes = sum(a != b for a, b in itertools.pairwise(signs))
        if changes % 2:
            return True
        if changes:
            left, right = [control[0]], [control[-1]]
            while len(control) > 1:
                control = [(a + b) / 2 for a, b in itertools.pairwise(control)]
                left.append(control[0])
                right.append(control[-1])
            if control[0] == 0:
                return True
            open_ += [left, right[::-1]]
    return False


def evaluate(coefficients: Sequence[fmpq], at: fmpq) -> fmpq:
    """Its value there."""
    result = fmpq(0)
    for coefficient in reversed(coefficients):
        result = result * at + coefficient
    return result


def integral(coefficients: Sequence[fmpq]) -> Coefficients:
    """The one that is zero at zero."""
    return (fmpq(0), *(c / (k + 1) for k, c in enumerate(coefficients)))


def derivative(coefficients: Sequence[fmpq]) -> Coefficients:
    """Of a constant, the constant zero."""
    return tuple(k * c for k, c in enumerate(coefficients))[1:] or (fmpq(0),)


def shifted(coefficients: Sequence[fmpq], by: fmpq) -> Coefficients:
    """In powers of t − by, without leading zeros."""
    result = fmpq_poly(list(coefficients))
    if by != 0:
        result = result(fmpq_poly([by, 1]))
    return tuple(result.coeffs()) or (fmpq(0),)
