"""Condition (c) beside obstacles, as half-spaces of the coefficients.

Any separating half-plane of the plane will do, and at a place where a candidate reaches over all of a fan, it is the
one that is best for this candidate by which all others are judged from then on: a choice like a demonstrated input,
and counted as one (`cfjax.learner.run.EliminationRun.half_planes`).
"""

import numpy as np
from jaxtyping import Float

from cfjax.funnel.conditions import CLEAR
from cfjax.funnel.instance import Clearance
from cfjax.learner.centre import Polytope
from cfjax.learner.coefficients import GAP, Coordinates


def clearance_cuts(coordinates: Coordinates, clearance: Clearance, c: Float[np.ndarray, " r"], most: int) -> Polytope:
    """Where the funnel c reaches over all half-planes of an obstacle's fan: it has to keep to the best of them.

    At the `most` worst places. Along n the footprint's disc comes as far as reach(M) = √(mᵀM⁻¹m) + swing (M⁻¹)_αα with
    M = C/ρ(θ), convex in M: reach(M) ≤ gap implies reach(M_c) + ∇reach(M_c) · (M − M_c) ≤ gap, a half-space of (C, ρ)
    that every funnel which keeps to this half-plane at this place satisfies. At c it is broken by as much as c reaches
    too far.
    """
    theta, gap, reach, swing = map(np.asarray, clearance)
    if not len(theta):
        return Polytope(np.zeros((0, len(c))), np.zeros(0))
    level = np.asarray(coordinates.template.level(coordinates.change_of(c) / coordinates.duration, theta))
    inverse = np.linalg.inv(coordinates.shape(c))
    wide = np.sqrt(level[:, None] * np.einsum("pdi,ij,pdj->pd", reach, inverse, reach))
    turned = swing * level * inverse[0, 0]
    free = gap - CLEAR * (1 + GAP)
    left = free - wide - turned[:, None]
    normal = left.argmax(axis=1)
    rows = np.arange(len(theta))
    worst = np.array([p for p in np.argsort(left[rows, normal]) if left[p, normal[p]] <= 0][:most], int)
    chosen = normal[worst]
    wide, turned = wide[worst, chosen], turned[worst]
    # ∇√(mᵀM⁻¹m) = −y yᵀ / 2√(mᵀM⁻¹m) with y = M⁻¹m, and ∇(M⁻¹)_αα = −z zᵀ with z = M⁻¹e_α
    y = level[worst, None] * (reach[worst, chosen] @ inverse)
    z = level[worst, None] * inverse[:1]
    falls = coordinates.form(y) / (2 * wide[:, None]) + swing[worst, None] * coordinates.form(z)
    return coordinates.cone(falls, 1.5 * wide + 2 * turned - free[worst, chosen], theta[worst])
