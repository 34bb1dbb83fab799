"""A funnel: one member of a template on one segment, with numbers."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cfjax.errors import InputError
from cfjax.funnel.template import Template
from cfjax.problem.vehicle import Scalar


@dataclass(frozen=True)
class Funnel:
    """Candidate or proven control funnel function on one segment: V(θ, x) of `template` with q = xᵀ C x, β = 1."""

    template: Template
    shape: Float[np.ndarray, "n n"]  # C, symmetric positive definite; units: 1 over those of the states, squared
    rate: float  # c0 or k, 1/s
    duration: float  # T, s; infinite for a tube, whose rate is zero
    beta_lower: float = 0.9  # the shell on which V decreases at λ is beta_lower ≤ V ≤ 1
    beta_inner: float | None = None  # below, down to here, it decreases at λ V / beta_lower; None: no further

    def __post_init__(self) -> None:
        if not 0 < self.beta_lower < 1:
            raise InputError(f"beta_lower: expected a number between 0 and 1, got {self.beta_lower}")
        if self.beta_inner is not None and not 0 < self.beta_inner <= self.beta_lower:
            raise InputError(
                f"beta_inner: expected a number above 0 and at most beta_lower = {self.beta_lower}, "
                f"got {self.beta_inner}"
            )
        if np.isinf(self.duration) and self.rate:
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
        return 1.0 if np.isinf(self.duration) else float(self.level(self.duration))

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
