"""A claim on a funnel that Gram matrices prove: its coordinates, its identity, and what rounding left over.

With x = W y for a rational whitening W ≈ (C/peak)^{−1/2} the funnel {q = xᵀ C x ≤ peak} is nearly the unit ball in y. A
program says, cell by cell, which λ is largest with

    target − λ weight = z₀ᵀ Q₀ z₀ + Σ_k g_k zᵀ Q_k z + r,        every Q positive definite,

for polynomials g_k that are not negative on the cell. r, what rounding left over, is a polynomial too; on a ball that
holds the funnel |r| ≤ bound, so target ≥ λ weight − bound ≥ (λ − bound / least weight) weight on the cell.
"""

import abc
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from itertools import count, product
from math import isqrt
from typing import Any

from flint import fmpq, fmpq_mat, fmpq_mpoly, fmpq_mpoly_ctx

from cfcheck.exact.definite import exact_matrix, is_positive_definite, is_positive_definite_whole, symmetric
from cfcheck.exact.enclosure import Domain
from cfcheck.exact.rational import Matrix


Exponents = tuple[int, ...]
RADIUS_SLACK = fmpq(1, 1024)  # the ball in y is this much larger than the funnel: W is only nearly C^{−1/2}


@dataclass(frozen=True)
class Gram:
    """A symmetric matrix by its lower triangle, row by row: whole numbers over 2^exponent."""

    exponent: int
    lower: tuple[int, ...]

    @property
    def size(self) -> int:
        """How many rows it has."""
        return (isqrt(8 * len(self.lower) + 1) - 1) // 2

    @property
    def whole(self) -> list[list[int]]:
        """2^exponent times the matrix, by rows."""
        return symmetric(self.lower)

    @property
    def longest(self) -> int:
        """Bits of the longest of the whole numbers."""
        return max(map(int.bit_length, self.lower))


@lru_cache(maxsize=1024)  # whoever makes a proof asks, and once more of what the file says
def is_definite(gram: Gram) -> bool:
    """Whether the matrix is positive definite."""
    return is_positive_definite_whole(gram.whole)


@dataclass(frozen=True)
class CellProof:
    """Margin and Gram matrices for one cell: Q₀ first, then one for each of the cell's constraints."""

    cell: Any
    margin: fmpq
    grams: tuple[Gram, ...]


class FunnelProgram(abc.ABC):
    """Coordinates on a funnel, and claims about polynomials there; all numbers are rational."""

    states: tuple[str, ...]
    shape: Matrix  # C
    whitening: Matrix  # W
    degrees: tuple[int, ...]  # of the monomials in the Gram matrices, in their order

    @property
    @abc.abstractmethod
    def peak(self) -> fmpq:
        """The largest level of the funnel."""

    @abc.abstractmethod
    def cells(self) -> Iterator[Any]:
        """What has to be proven one by one."""

    @abc.abstractmethod
    def target(self, cell: Any) -> fmpq_mpoly:
        """What is to be at least λ weight on the cell."""

    @abc.abstractmethod
    def weight(self, cell: Any) -> fmpq_mpoly:
        """What λ is counted in."""

    @abc.abstractmethod
    def least_weight(self, cell: Any) -> fmpq:
        """A positive number that weight nowhere falls below on the cell."""

    @abc.abstractmethod
    def constraints(self, cell: Any) -> list[fmpq_mpoly]:
        """Polynomials that are not negative on the cell."""

    @cached_property
    def ring(self) -> fmpq_mpoly_ctx:
        return fmpq_mpoly_ctx.get([f"y{k}" for k in range(len(self.states))], "degrevlex")

    def degrees_of(self, cell: Any) -> tuple[int, ...]:
        """Of the monomials in the Gram matrices of one cell; the same of all where all have as many constraints."""
        return self.degrees

    def bases_of(self, cell: Any) -> list[tuple[Exponents, ...]]:
        """Exponents of the monomials z of each Gram matrix."""
        return [monomials(len(self.states), degree) for degree in self.degrees_of(cell)]

    @cached_property
    def deviations(self) -> list[fmpq_mpoly]:
        """x = W y."""
        y = self.ring.gens()
        return [sum((w * yk for w, yk in zip(row, y, strict=True)), self.ring.constant(0)) for row in self.whitening]

    @cached_property
    def covector(self) -> list[fmpq_mpoly]:
        """∇q = 2 C x."""
        return [
            sum((2 * c * x for c, x in zip(row, self.deviations, strict=True)), self.ring.constant(0))
            for row in self.shape
        ]

    @cached_property
    def form(self) -> fmpq_mpoly:
        """q = xᵀ C x as a polynomial in y."""
        half = fmpq(1, 2)
        pairs = zip(self.deviations, self.covector, strict=True)
        return sum((half * x * g for x, g in pairs), self.ring.constant(0))

    @cached_property
    def norm_squared(self) -> fmpq_mpoly:
        """|y|²."""
        return sum((y * y for y in self.ring.gens()), self.ring.constant(0))

    def edges(self, lower: fmpq, upper: fmpq) -> list[fmpq_mpoly]:
        """q − lower and upper − q, for constraints; the first says nothing where the lower end is 0."""
        above = [self.form - lower] if lower > 0 else []
        return [*above, upper - self.form]

    @cached_property
    def domain(self) -> Domain:
        """The ball |y|² ≤ 1 + slack, which holds {q ≤ peak}: proven, for W is only nearly (C/peak)^{−1/2}."""
        radius_squared, size = 1 + RADIUS_SLACK, len(self.states)
        whitening = exact_matrix(self.whitening)
        form = whitening.transpose() * exact_matrix(self.shape) * whitening  # q = yᵀ form y
        least = fmpq_mat(size, size, [self.peak if i == j else 0 for i in range(size) for j in range(size)])
        if not is_positive_definite(form * radius_squared - least):
            raise ValueError("the whitening is not close enough to (C/peak)^{-1/2}, or C is not positive definite")
        return Domain(self.ring, radius_squared)

    def proven_margin(self, proof: CellProof) -> fmpq:
        """The λ that the proof shows on its cell: its margin less what the leftover r costs.

        Raises:
            ValueError: names what is not as it has to be.
        """
        cell = proof.cell
        factors = [self.ring.constant(1), *self.constraints(cell)]
        bases = self.bases_of(cell)
        if len(proof.grams) != len(factors) or len(bases) != len(factors):
            raise ValueError(f"expected {len(factors)} Gram matrices, got {len(proof.grams)}")
        squares = self.ring.constant(0)
        for index, (factor, gram, basis) in enumerate(zip(factors, proof.grams, bases, strict=True)):
            if len(gram.lower) != len(basis) * (len(basis) + 1) // 2:
                raise ValueError(f"Gram matrix {index} has {gram.size} rows, expected {len(basis)}")
            # the elimination's numbers grow row by row
            self.domain.budget.spend(len(basis) ** 3 * (1 + len(basis) * gram.longest // 2048))
            if not is_definite(gram):
                raise ValueError(f"Gram matrix {index} is not positive definite")
            square = quadratic_form(self.ring, gram, basis)
            squares += square if index == 0 else self.domain.product(factor, square)
        claimed = self.domain.sum(self.target(cell), -proof.margin * self.weight(cell))
        left = self.domain.sum(claimed, self.domain.negative(squares))
        return proof.margin - self.domain.bound(left) / self.least_weight(cell)


@cache
def monomials(variables: int, degree: int) -> tuple[Exponents, ...]:
    """Exponents of all monomials up to the degree: by degree, then descending in the first variable, and so on."""
    every = (e for e in product(range(degree + 1), repeat=variables) if sum(e) <= degree)
    return tuple(sorted(every, key=lambda e: (sum(e), tuple(-k for k in e))))


def quadratic_form(ring: fmpq_mpoly_ctx, gram: Gram, basis: tuple[Exponents, ...]) -> fmpq_mpoly:
    """zᵀ Q z for the monomials z with the exponents in `basis`."""
    lower, denominator = gram.lower, 2**gram.exponent
    terms = {
        exponents: fmpq(2 * sum([lower[place] for place in beside]) + sum([lower[place] for place in on]), denominator)
        for exponents, beside, on in _products(basis)
    }
    return ring.from_dict(terms)


@cache
def _products(basis: tuple[Exponents, ...]) -> list[tuple[Exponents, list[int], list[int]]]:
    """Each monomial of z zᵀ with its places in the lower triangle, row by row: beside the diagonal, and on it."""
    found: dict[Exponents, tuple[list[int], list[int]]] = {}
    places = count()
    for i, first in enumerate(basis):
        for j in range(i + 1):
            exponents = tuple(a + b for a, b in zip(first, basis[j], strict=True))
            found.setdefault(exponents, ([], []))[i == j].append(next(places))
    return [(exponents, *own) for exponents, own in found.items()]
