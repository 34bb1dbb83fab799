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
    duration: float  # T, s
    beta_lower: float = 0.9  # the shell on which V decreases is beta_lower ≤ V ≤ 1

    def __post_init__(self) -> None:
        if not 0 < self.beta_lower < 1:
            raise InputError(f"beta_lower: expected a number between 0 and 1, got {self.beta_lower}")
        if self.shape.shape != self.shape.T.shape or not np.allclose(self.shape, self.shape.T, rtol=0, atol=1e-12):
            raise InputError("funnel: expected a symmetric matrix C")
        if not np.linalg.eigvalsh(self.shape).min() > 0:
            raise InputError("funnel: expected a positive definite matrix C")

    @property
    def dimension(self) -> int:
        return self.shape.shape[0]

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
