"""Polytopes of coefficients, and their centres with the ellipsoids around them.

A polytope P = {c : A c ≤ b} is what is left of a box of coefficients after cuts. The next question to ask is at a
centre of it, such that an answer that cuts the centre off takes away a good part of P:

- `mve`: the centre of the maximum-volume ellipsoid E ⊂ P. A half-space that does not hold the centre in its interior
  leaves an ellipsoid of at most 8/9 of the volume, whatever its direction and the dimension r (Tarasov, Khachiyan,
  Erlich, *The method of inscribed ellipsoids*, 1988; at most 0.843 by Khachiyan, *An inequality for the volume of
  inscribed ellipsoids*, 1990). Of P itself it is said to leave at most 1 − 1/r (Boyd, Vandenberghe, *Localization and
  cutting-plane methods*; the articles of `cfjax.learner.localise`): not for r = 2, where a triangle keeps 5/9. A deeper
  cut takes more, one that holds the centre in its interior need not take anything.
- `analytic`: the point that maximises Σ log(b − A c), with the Dikin ellipsoid of that barrier, which lies in P too.
  Cheaper, and it moves with every half-space, redundant ones included; no such share is taken from the volume.
- `chebyshev`: the centre of the largest ball in P, a linear program. Nothing is guaranteed; it depends on units.

Solvers are oracles: whether an ellipsoid lies in P is looked at here, and only its being the largest is the solver's
word.
"""

import math
import warnings
from dataclasses import dataclass

import cvxpy as cp
import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog


SETTINGS = (  # of Clarabel, one after the other: rows have unit length already, and shorter steps are safer
    {"equilibrate_enable": False},
    {"equilibrate_enable": False, "max_step_fraction": 0.9},
    {},
)
SHRINK = 1e-3  # relative, by which an ellipsoid of the solver's may have to shrink to lie in the polytope
REDUNDANT = 1e-9  # by which a half-space has to be away from the rest of the polytope to be left out


class CentreError(Exception):
    """The solver gave no centre of a polytope that has an interior."""


@dataclass(frozen=True)
class Polytope:
    """{c : normals · c ≤ offsets}: m half-spaces in r dimensions."""

    normals: Float[np.ndarray, "m r"]
    offsets: Float[np.ndarray, " m"]

    @classmethod
    def box(cls, lower: Float[np.ndarray, " r"], upper: Float[np.ndarray, " r"]) -> "Polytope":
        """{lower ≤ c ≤ upper}."""
        eye = np.eye(len(lower))
        return cls(np.concatenate([eye, -eye]), np.concatenate([upper, -lower]))

    def __len__(self) -> int:
        return len(self.offsets)

    @property
    def dimension(self) -> int:
        return self.normals.shape[1]

    def cut(self, other: "Polytope") -> "Polytope":
        """The intersection of both."""
        normals = np.concatenate([self.normals, other.normals])
        return Polytope(normals, np.concatenate([self.offsets, other.offsets]))

    def slack(self, c: Float[np.ndarray, " r"]) -> Float[np.ndarray, " m"]:
        """By how much each inequality holds at c, in its own unit."""
        return self.offsets - self.normals @ c

    def with_unit_normals(self) -> "Polytope | None":
        """The same set; rows 0 · c ≤ b are left out, and there is no set where b < 0."""
        size = np.linalg.norm(self.normals, axis=1)
        if (self.offsets[size == 0] < 0).any():
            return None
        nonzero = size > 0
        return Polytope(self.normals[nonzero] / size[nonzero, None], self.offsets[nonzero] / size[nonzero])


@dataclass(frozen=True)
class Inscribed:
    """The ellipsoid {centre + factor u : |u| ≤ 1} in a polytope; `factor` is lower triangular."""

    centre: Float[np.ndarray, " r"]
    factor: Float[np.ndarray, "r r"]

    @property
    def log_volume(self) -> float:
        return log_ball(len(self.centre)) + float(np.log(np.diag(self.factor)).sum())


def log_ball(dimension: int, radius: float = 1.0) -> float:
    """Logarithm of the volume of a ball."""
    return 0.5 * dimension * math.log(math.pi) - math.lgamma(0.5 * dimension + 1) + dimension * math.log(radius)


def largest_ball(polytope: Polytope) -> tuple[Float[np.ndarray, " r"], float]:
    """Centre and radius of the largest ball in a bounded polytope.

    Where there is no interior the radius is not above zero: minus the distance by which every half-space has to
    recede before a point lies in all of them; −∞ where a half-space 0 · c ≤ b < 0 cannot.
    """
    unit = polytope.with_unit_normals()
    if unit is None:
        return np.zeros(polytope.dimension), -math.inf
    matrix = np.concatenate([unit.normals, np.ones((len(unit), 1))], axis=1)
    cost = np.zeros(polytope.dimension + 1)
    cost[-1] = -1.0
    found = linprog(cost, A_ub=matrix, b_ub=unit.offsets, bounds=(None, None), method="highs")
    if found.status != 0:
        raise CentreError(f"largest ball: {found.message}")
    return found.x[:-1], float(found.x[-1])


def inscribed(polytope: Polytope, kind: str = "mve", frame: Inscribed | None = None) -> Inscribed | None:
    """The centre of that kind with an ellipsoid around it that lies in the polytope; None where it has no interior.

    `frame` is an ellipsoid near the answer, for the solver's sake: the largest ball unless given.

    Raises:
        CentreError: where the solver does not find it.
    """
    centre, radius = largest_ball(polytope)
    unit = polytope.with_unit_normals()
    if radius <= 0 or unit is None:
        return None
    ball = Inscribed(centre, radius * np.eye(polytope.dimension))
    if kind == "chebyshev":
        return ball
    frame = frame or ball
    rows = unit.normals @ frame.factor
    size = np.linalg.norm(rows, axis=1)
    seen = Polytope(rows / size[:, None], unit.slack(frame.centre) / size)
    if kind == "mve":
        own = _largest_ellipsoid(seen)
    elif kind == "analytic":
        own = _dikin(seen)
    else:
        raise ValueError(f"centre: there is none of the name {kind}")
    return Inscribed(frame.centre + frame.factor @ own.centre, frame.factor @ own.factor)


def _largest_ellipsoid(polytope: Polytope) -> Inscribed:
    """Maximise log det L over {d + L u} ⊂ P: |Lᵀa| + aᵀd ≤ b. L lower triangular is every ellipsoid, and log det L a
    sum of logarithms."""
    size = polytope.dimension
    rows, columns = np.tril_indices(size)
    place = np.zeros((size * size, len(rows)))
    place[rows * size + columns, np.arange(len(rows))] = 1.0
    centre, entries = cp.Variable(size), cp.Variable(len(rows))
    factor = cp.reshape(place @ entries, (size, size), order="C")
    reach = cp.norm(polytope.normals @ factor, 2, axis=1) + polytope.normals @ centre
    _solve(cp.Problem(cp.Maximize(cp.sum(cp.log(cp.diag(factor)))), [reach <= polytope.offsets]))
    return _shrunk(polytope, np.asarray(centre.value), (place @ np.asarray(entries.value)).reshape(size, size))


def _dikin(polytope: Polytope) -> Inscribed:
    """The analytic centre, and where the second derivative of the barrier −Σ log(b − A c) is one."""
    centre = cp.Variable(polytope.dimension)
    _solve(cp.Problem(cp.Maximize(cp.sum(cp.log(polytope.offsets - polytope.normals @ centre)))))
    point = np.asarray(centre.value)
    slack = polytope.slack(point)
    if not slack.min() > 0:
        raise CentreError("analytic centre: the solver's point is not in the polytope")
    scaled = polytope.normals / slack[:, None]
    inverse = np.linalg.inv(scaled.T @ scaled)
    return _shrunk(polytope, point, np.linalg.cholesky(0.5 * (inverse + inverse.T)))


def _shrunk(polytope: Polytope, centre: Float[np.ndarray, " r"], factor: Float[np.ndarray, "r r"]) -> Inscribed:
    """The ellipsoid about the same centre that lies in the polytope."""
    room = float((polytope.slack(centre) / np.linalg.norm(polytope.normals @ factor, axis=1)).min())
    if not room > 1 - SHRINK:
        raise CentreError(f"ellipsoid: the solver's reaches out of the polytope by {1 - room:.2g}")
    return Inscribed(centre, factor * min(1.0, room))


def _solve(problem: cp.Problem) -> None:
    for settings in SETTINGS:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # of an inaccurate solution, which is none here
                problem.solve(solver=cp.CLARABEL, **settings)
        except cp.SolverError:
            continue
        if problem.status == cp.OPTIMAL:
            return
    raise CentreError(f"centre: the solver ended with status {problem.status}")


def irredundant(polytope: Polytope) -> Polytope:
    """The same set by fewer half-spaces: those are left out that the others imply, one linear program each.

    Of a set that a half-space 0 · c ≤ b < 0 empties, only such half-spaces remain.
    """
    size = np.linalg.norm(polytope.normals, axis=1)
    empty = (size == 0) & (polytope.offsets < 0)
    if empty.any():
        return Polytope(polytope.normals[empty], polytope.offsets[empty])
    nonzero = Polytope(polytope.normals[size > 0], polytope.offsets[size > 0])
    normals, offsets = nonzero.normals / size[size > 0, None], nonzero.offsets / size[size > 0]
    kept = np.ones(len(nonzero), bool)
    for row in range(len(nonzero)):
        kept[row] = False
        found = linprog(-normals[row], A_ub=normals[kept], b_ub=offsets[kept], bounds=(None, None), method="highs")
        kept[row] = not (found.status == 0 and -found.fun <= offsets[row] - REDUNDANT)
    return Polytope(nonzero.normals[kept], nonzero.offsets[kept])
