"""From floating-point hints to short rationals: funnel, whitening, Gram matrices."""

import math
from dataclasses import dataclass, replace

import numpy as np
from flint import fmpq
from jaxtyping import Float

from cfcheck.exact.rational import Matrix, rational
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.level import LEVELS, Level
from cfcheck.kernel.program import Gram
from cfjax.funnel import Funnel
from cfjax.problem import Segment, Tube


FUNNEL_BITS = 30  # C is rounded to 2^-30 of its smallest eigenvalue, the rate to 2^-30 of itself: 1e-9
WHITENING_BITS = 14  # W is a change of coordinates, any nonsingular one is right; a short one keeps numbers short
GRAM_BITS = 26  # below the largest entry; what rounding leaves over costs some parts in 1e6 of the margin
MANTISSA_BITS = 53


@dataclass(frozen=True)
class RoundedFunnel:
    """A funnel whose numbers are short rationals and floating-point numbers at once."""

    funnel: Funnel
    level: Level
    shape: Matrix
    beta_lower: fmpq
    beta_inner: fmpq

    def claim(self, margin: fmpq = fmpq(0), margin_per_metre: fmpq | None = None) -> FunnelClaim:
        """What a file says of it; with a margin of 0 all but its margin."""
        return FunnelClaim(self.level, self.shape, self.beta_lower, self.beta_inner, margin, margin_per_metre)


def exact(value: float) -> fmpq:
    """The rational that the floating-point number is."""
    return fmpq(*float(value).as_integer_ratio())


def dyadic(value: float, bits: int) -> fmpq:
    """The nearest multiple of 2^-bits (bits may be negative)."""
    return fmpq(round(math.ldexp(float(value), bits))) * fmpq(2) ** -bits


def round_matrix(matrix: Float[np.ndarray, "n n"], bits: int) -> list[list[fmpq]]:
    """Entry by entry, symmetric where the lower triangle says so."""
    size = len(matrix)
    return [[dyadic(matrix[max(i, j), min(i, j)], bits) for j in range(size)] for i in range(size)]


def round_shape(shape: Float[np.ndarray, "n n"]) -> Matrix:
    """C as dyadic rationals that are floating-point numbers too: what the proof is about is what a controller runs."""
    smallest = float(np.linalg.eigvalsh(shape)[0])
    largest = float(np.abs(shape).max())
    bits = min(FUNNEL_BITS - math.floor(math.log2(smallest)), MANTISSA_BITS - 2 - math.floor(math.log2(largest)))
    return round_matrix(shape, bits)


def round_rate(rate: float) -> fmpq:
    """c0 or k likewise."""
    return dyadic(rate, FUNNEL_BITS - math.floor(math.log2(abs(rate)))) if rate else fmpq(0)


def round_funnel(funnel: Funnel, segment: Segment | Tube) -> RoundedFunnel:
    """C and rate moved by about a part in 1e9; the duration is the segment's."""
    shape, rate = round_shape(funnel.shape), round_rate(funnel.rate)
    same = replace(
        funnel,
        shape=np.array([[float(entry) for entry in row] for row in shape]),
        rate=float(rate),
        duration=segment.duration,
    )
    level = LEVELS[funnel.template.name](rate)
    return RoundedFunnel(same, level, shape, rational(float(funnel.beta_lower)), rational(float(funnel.inner)))


def round_whitening(shape: Float[np.ndarray, "n n"]) -> Matrix:
    """W ≈ C^{−1/2}, so that the funnel is nearly a ball in y with x = W y."""
    values, vectors = np.linalg.eigh(shape)
    whitening = (vectors / np.sqrt(values)) @ vectors.T
    return round_matrix(whitening, WHITENING_BITS - math.floor(math.log2(values[-1] ** -0.5)))


def round_gram(gram: Float[np.ndarray, "k k"], padding: float) -> Gram:
    """Q + padding · max|Q| · identity."""
    largest = max(float(np.abs(gram).max()), 1e-30)
    exponent = min(max(GRAM_BITS - math.floor(math.log2(largest)), 0), 200)
    padded = gram + padding * largest * np.eye(len(gram))
    scaled = np.ldexp(padded, exponent)[np.tril_indices(len(gram))]
    return Gram(exponent, tuple(map(round, scaled.tolist())))
