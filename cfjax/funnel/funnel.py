"""A funnel: one member of a template on one segment, with numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cfjax.coerce import array, instance, keep, number, real
from cfjax.errors import InputError
from cfjax.funnel.levels import inner_level
from cfjax.funnel.template import Template
from cfjax.problem import Problem
from cfjax.problem.vehicle import Scalar


LATERAL = 1
"""Index of the state x, the lateral deviation."""


@dataclass(frozen=True)
class Funnel:
    """Candidate or proven control funnel function on one segment: V(θ, x) of `template` with q = xᵀ C x, β = 1.

    >>> from cfjax import Contracting
    >>> funnel = Funnel(Contracting(), np.diag([4.0, 1.0]), rate=0.5, duration=2.0)
    >>> funnel.half_widths().tolist()
    [0.5, 1.0]
    >>> float(funnel.value(0.0, np.array([0.5, 0.0])))
    1.0

    Args:
        template: the family of V.
        shape: C (n, n), symmetric positive definite; units: 1 over those of the states, squared.
        rate: c0 or k, 1/s.
        duration: T, s; infinite for a tube, whose rate is zero.
        beta_lower: the shell on which V decreases at λ is beta_lower ≤ V ≤ 1.
        beta_inner: below, down to here, V decreases at λ V / beta_lower; None: no further.

    Raises:
        InputError: for values that are none of these.
    """

    template: Template
    shape: Float[np.ndarray, "n n"]
    rate: float
    duration: float
    beta_lower: float = 0.9
    beta_inner: float | None = None

    def __post_init__(self) -> None:
        instance("funnel.template", self.template, Template)
        endless = real(self.duration) == math.inf
        keep(
            self,
            shape=array("funnel.shape", self.shape, (None, None)),
            rate=number("funnel.rate", self.rate, "1/s"),
            duration=math.inf if endless else number("funnel.duration", self.duration, "s", above=0),
            beta_lower=number("beta_lower", self.beta_lower, above=0, below=1),
            beta_inner=inner_level(self.beta_inner, self.beta_lower),
        )
        if endless and self.rate:
            raise InputError(f"funnel: expected rate 0 for a tube, which has no end, got {self.rate}")
        if self.shape.shape != self.shape.T.shape or not np.allclose(self.shape, self.shape.T, rtol=0, atol=1e-12):
            raise InputError("funnel: expected a symmetric matrix C")
        if not np.linalg.eigvalsh(self.shape).min() > 0:
            raise InputError("funnel: expected a positive definite matrix C")

    @property
    def dimension(self) -> int:
        return self.shape.shape[0]

    @property
    def inner(self) -> float:
        """β_in: V decreases from 1 down to here."""
        return self.beta_lower if self.beta_inner is None else self.beta_inner

    @property
    def end_level(self) -> float:
        """ρ(T)."""
        return float(self.level(self.duration)) if self.rate else 1.0

    def form(self, x: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch"]:
        """q = xᵀ C x."""
        return np.asarray(np.einsum("...i,ij,...j", x, self.shape, x))

    def level(self, theta: Scalar) -> Scalar:
        """ρ(θ): the funnel at θ is {xᵀ C x ≤ ρ(θ)}."""
        return np.asarray(self.template.level(self.rate, theta))

    def value(self, theta: Scalar, x: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch"]:
        """V(θ, x)."""
        return np.asarray(self.template.value(self.rate, theta, self.form(x)))

    def half_widths(self, theta: float = 0.0) -> Float[np.ndarray, " n"]:
        """Largest deviation in each state inside the funnel at θ."""
        return np.sqrt(self.level(theta) * np.diag(np.linalg.inv(self.shape)))

    def absorbed_disturbance(self, margin: float) -> Float[np.ndarray, " n"]:
        """Largest additive disturbance of each state's rate alone that leaves V̇ ≤ 0 on β̲ ≤ V ≤ 1 (unit of x per s).

        |∂q/∂x_i| ≤ 2 √(C_ii q), and V̇ = σ (q̇ + …) with σ q ≤ σ ρ: at θ = 0, where V = q, λ buys λ / (2 √C_ii).
        """
        return margin / (2 * np.sqrt(np.diag(self.shape)))


def lateral_half_width(funnel: Funnel) -> float:
    """Largest lateral deviation in the funnel at any θ, m."""
    instance("funnel", funnel, Funnel)
    return math.sqrt(max(1.0, funnel.end_level)) * float(funnel.half_widths()[LATERAL])


def require_fit(problem: Problem, funnels: Sequence[Funnel]) -> None:
    """Raises InputError unless the funnels are of the problem's states."""
    for funnel in funnels:
        if funnel.dimension != problem.dimension:
            names = ", ".join(problem.vehicle.state_names)
            raise InputError(
                f"funnel: expected C of {problem.dimension} states ({names}), got one of {funnel.dimension}"
            )
