"""Where polynomials are compared: points of the unit ball that determine a polynomial by its values.

Coordinates of a proof are whitened, so its funnel is nearly the unit ball and the points depend on the number of states
and the degree alone. They are approximate Fekete points: a QR factorisation with pivoting chooses, among many points of
the ball, as many as there are monomials, far from dependent (Sommariva & Vianello 2009). As in weighted sums of squares
by values (Papp & Yıldız 2019), a basis is orthonormal on the points.
"""

from dataclasses import dataclass
from functools import cache, reduce

import numpy as np
from jaxtyping import Float

from cfcheck.kernel.program import monomials


CLOUD = 8  # points to choose from, for each point that is chosen
SEED = 0


def vandermonde(points: Float[np.ndarray, "u n"], degree: int) -> Float[np.ndarray, "u r"]:
    """Values of the monomials up to a degree."""
    powers = points.T[:, None, :] ** np.arange(degree + 1)[:, None]
    factors = zip(powers, np.array(monomials(points.shape[1], degree)).T, strict=True)
    return reduce(np.multiply, (own[exponents] for own, exponents in factors)).T.copy()


@dataclass(frozen=True, eq=False)  # compared as objects: there is one of a kind
class Space:
    """The points for polynomials in `variables` up to `degree`, and how a value there follows from coefficients."""

    points: Float[np.ndarray, "u n"]
    values: Float[np.ndarray, "u u"]  # of the monomials

    def basis(self, degree: int) -> tuple[Float[np.ndarray, "u m"], Float[np.ndarray, "m m"]]:
        """An orthonormal basis p of a lower degree at the points, and T with p = Tᵀ z for the monomials z."""
        return _basis(self, degree)


@cache
def space(variables: int, degree: int) -> Space:
    """Once for all programs with these numbers of variables and this degree."""
    from scipy.linalg import qr  # here: a run does not wait for what it needs while it learns

    rng = np.random.default_rng(SEED)
    count = len(monomials(variables, degree))
    cloud = rng.normal(size=(CLOUD * count, variables))
    cloud *= rng.random((CLOUD * count, 1)) ** (1 / variables) / np.linalg.norm(cloud, axis=1, keepdims=True)
    orthonormal, _ = np.linalg.qr(vandermonde(cloud, degree))
    pivots = qr(orthonormal.T, pivoting=True, mode="economic")[-1]
    points = cloud[pivots[:count]]
    return Space(points, vandermonde(points, degree))


@cache
def _basis(own: Space, degree: int) -> tuple[Float[np.ndarray, "u m"], Float[np.ndarray, "m m"]]:
    from scipy.linalg import solve_triangular

    orthonormal, upper = np.linalg.qr(vandermonde(own.points, degree))
    size = np.sqrt(len(own.points))
    return orthonormal * size, solve_triangular(upper, np.eye(len(upper))) * size
