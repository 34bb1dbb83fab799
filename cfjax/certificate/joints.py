"""How much wider the next funnel is: the ratios that joints state (`cfcheck.kernel.legs`), sought here."""

from collections.abc import Sequence

import numpy as np
from flint import fmpq

from cfcheck.exact.rational import Matrix, rational
from cfcheck.kernel.legs import is_wider


SLACKS = (1e-9, 1e-6, 1e-3)  # below the largest ratio, which lies on the edge of what exact arithmetic confirms
DIGITS = 12


def widest_ratio(first: Matrix, second: Matrix) -> fmpq | None:
    """Nearly the largest ratio with C₁ ≻ ratio C₂, which is proven; None where none is."""
    own, other = (_floats(shape) for shape in (first, second))
    largest = 1 / float(np.linalg.eigvals(np.linalg.solve(own, other)).real.max())
    for slack in SLACKS:
        ratio = rational(float(f"{largest * (1 - slack):.{DIGITS}g}"))
        if ratio > 0 and is_wider(first, second, ratio):
            return ratio
    return None


def _floats(shape: Sequence[Sequence[fmpq]]) -> np.ndarray:
    return np.array([[float(entry) for entry in row] for row in shape])
