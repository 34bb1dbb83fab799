"""Polynomials for the functions in a vehicle's dynamics: fitted here, proven by the checker's arithmetic."""

import math
from collections.abc import Mapping

import numpy as np
from flint import fmpq
from numpy.polynomial import Polynomial
from numpy.polynomial.chebyshev import Chebyshev

from cfcheck.exact.enclosure import Enclosure, UnaryEnclosure, proven_bound
from cfjax.certificate.rounding import dyadic


# with sin to the third and cos to the fourth power, V̇ is of degree six: what the sums of squares are made for
DEGREES = {"sin": 3, "cos": 4, "tan": 3, "sqrt": 3, "inv": 3}
CLOSE = {"sin": 7, "cos": 8, "tan": 7, "sqrt": 7, "inv": 7}  # of two states, whose Gram matrices stay small
SPARING = DEGREES | {"cos": 2}  # where V' times a denominator is to be of no higher degree than V' was
FUNCTIONS = {"sin": np.sin, "cos": np.cos, "tan": np.tan, "sqrt": np.sqrt, "inv": np.reciprocal}
PARITY = {"sin": 1, "cos": 0, "tan": 1, "inv": 1}
SAMPLES = 64  # Chebyshev nodes
WIDENING = fmpq(1, 1000)  # of the range, so that it stays valid under small changes of the funnel
RANGE_BITS = 16
ROOM = fmpq(1, 2**20)  # relative, of the bound: for a checker that bounds otherwise
COEFFICIENT_BITS = 26


def enclose(function: str, argument: Enclosure, degrees: Mapping[str, int] = DEGREES) -> UnaryEnclosure:
    """A proven enclosure of the function on the range that its argument reaches, by a polynomial of its degree.

    Raises:
        ValueError: where the range holds a pole.
    """
    lower, upper = argument.range()
    spare = (upper - lower) * WIDENING + fmpq(1, 2**RANGE_BITS)
    low = fmpq(math.floor((lower - spare) * 2**RANGE_BITS), 2**RANGE_BITS)
    high = fmpq(math.ceil((upper + spare) * 2**RANGE_BITS), 2**RANGE_BITS)
    coefficients = fit(function, low, high, degrees[function])
    bound = proven_bound(function, coefficients, low, high) * (1 + ROOM)
    return UnaryEnclosure(function, coefficients, low, high, bound)


def fit(function: str, lower: fmpq, upper: fmpq, degree: int | None = None) -> tuple[fmpq, ...]:
    """Coefficients (ascending) of a nearly best polynomial, short dyadic rationals; of DEGREES unless one is given."""
    low, high = float(lower), float(upper)
    if function == "inv" and low <= 0 <= high:
        raise ValueError("inv has a pole in the range of its argument: division by what may be zero in the funnel")
    if function == "sqrt" and low <= 0:
        raise ValueError("sqrt of what may not be positive in the funnel")
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES)
    series = Chebyshev.fit(nodes, FUNCTIONS[function](nodes), degree or DEGREES[function], domain=[low, high])
    fitted = series.convert(kind=Polynomial).coef
    if lower == -upper:
        fitted = [c if k % 2 == PARITY[function] else 0.0 for k, c in enumerate(fitted)]
    return tuple(dyadic(c, COEFFICIENT_BITS) for c in fitted)
