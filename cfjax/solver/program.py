"""A sums-of-squares program in floating-point numbers, and what a solver answers.

    maximise λ ≤ cap   with   target − λ drop = z₀ᵀ Q₀ z₀ + Σ_k g_k zᵀ Q_k z,   every Q positive semidefinite

for polynomials in y; z are the monomials up to the degree of each Gram matrix. An answer is a hint for the exact replay
(`cfcheck.kernel.program`), never a proof.
"""

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from cfcheck.kernel.program import Exponents, monomials


AT_CAP = 1 - 1e-3  # of the cap: λ is as good as there, and no point of the cell limits it
CAP = 16.0  # of λ where a program names none, in units of the target's largest number over the drop's

Shape = tuple[int, tuple[int, ...]]
"""Of a program: its variables, and the degrees of the monomials in each Gram matrix."""


class Status(enum.Enum):
    """How far a solver came; only the exact replay says whether a margin is proven."""

    OPTIMAL = "optimal"
    INACCURATE = "optimal_inaccurate"  # near the optimum: the exact replay may accept it
    FAILED = "failed"


@dataclass(frozen=True)
class Program:
    """Polynomials as dense vectors of coefficients of `monomials(variables, order)`, order = 2 · the largest degree.

    `degrees` are those of the monomials in each Gram matrix, Q₀'s first and largest.
    """

    variables: int
    degrees: tuple[int, ...]
    target: Float[np.ndarray, " r"]
    drop: Float[np.ndarray, " r"]
    constraints: Float[np.ndarray, "k r"]  # g_k
    cap: float | None = None  # of λ; None: a solver's own, far above what a cell that is not empty has

    @property
    def shape(self) -> Shape:
        """Programs of one shape can be solved together."""
        return self.variables, self.degrees

    @property
    def is_finite(self) -> bool:
        """Whether every coefficient is a number: otherwise there is nothing to solve."""
        return all(np.isfinite(rows).all() for rows in (self.target, self.drop, self.constraints))


@dataclass(frozen=True)
class Solution:
    """Margin λ, Gram matrices in the monomials' basis (None where there are none) and the solver's seconds."""

    status: Status
    margin: float
    grams: tuple[Float[np.ndarray, "_ _"], ...] | None
    seconds: float
    solver: str
    second_moments: Float[np.ndarray, "v v"] | None = None  # E[y yᵀ] of the points that limit λ, from the dual
    message: str = ""  # the solver's own words

    @classmethod
    def failed(cls, solver: str, message: str, seconds: float = 0.0) -> "Solution":
        """No answer, and why."""
        return cls(Status.FAILED, float("nan"), None, seconds, solver, message=message)

    def __str__(self) -> str:
        return f"{self.solver}: {self.status.value}" + (f" ({self.message})" if self.message else "")


@runtime_checkable
class Solver(Protocol):
    """A stack of programs in, a solution for each out, in their order. Never raises for what a program holds."""

    name: str

    def solve(self, programs: Sequence[Program]) -> list[Solution]: ...

    def prepare(self, shape: Shape) -> None:
        """Whatever programs of this shape need before the first of them is solved, compiled code, say."""


NOT_FINITE = "coefficients that are not finite"


@cache
def rows(variables: int, degree: int) -> dict[Exponents, int]:
    """The place of each monomial in a vector of coefficients."""
    return {exponents: k for k, exponents in enumerate(monomials(variables, degree))}


def dense(polynomial: Mapping[Exponents, float], variables: int, degree: int) -> Float[np.ndarray, " r"]:
    """Coefficients by exponents as a vector."""
    places = rows(variables, degree)
    result = np.zeros(len(places))
    for exponents, coefficient in polynomial.items():
        result[places[exponents]] = coefficient
    return result
