"""The coefficients of a funnel, and what conditions (a), (b), (c) ask of them, as half-spaces.

V is linear in C and, for the template `paper`, in c0; for `contracting` it is linear in C at a given rate.

States are counted in half-axes of I, so the unknown is C' = D C D with D = diag(half-axes), and (a) is C' ≺ 1. Where
the rate is given, (b) is C' ≻ Γ = ρ(T) diag((I_i/G_i)²), else Γ = 0. Between the two, an entry off the diagonal is at
most ½ √((1 − Γ_ii)(1 − Γ_jj)) in size: ½ at most. The diagonal lies in (Γ_ii, 1), and S bounds it from below too, by
(I_i/s_i)²: each entry by itself, no matrix, so S says nothing about the others. Off the diagonal √2 C'_ij is the
coefficient, so that lengths are Frobenius norms: the radius δ of a ball of candidates has no unit and means every C'
within δ. `paper` has one more coefficient, c0 T.

The conditions are half-spaces at their worst points: (a) V(0, x) < 1 and (b) V(T, x) > 1 along eigenvectors, (c) V > 1
where a funnel comes farthest through a face of S. They hold for every funnel, whatever the candidate they come from.
"""

import math
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from cfjax.funnel import Funnel, Template
from cfjax.funnel.instance import Chain, Instance
from cfjax.learner.centre import Polytope


GAP = 1e-6  # relative, by which (a)–(c) hold


@dataclass(frozen=True)
class Coordinates:
    """Coefficients of V and the funnels that they stand for.

    c holds the upper triangle of C' = D C D row by row, √2 times what is off the diagonal, and c0 T for `paper`.
    """

    template: Template
    inlet: Float[np.ndarray, " n"]  # D, half-axes of I
    goal: Float[np.ndarray, " n"]
    safe: Float[np.ndarray, " n"]
    duration: float
    beta_lower: float
    beta_inner: float | None
    change: float | None  # rate · duration, where it is no coefficient
    lower: Float[np.ndarray, " r"]
    upper: Float[np.ndarray, " r"]

    @classmethod
    def of(
        cls,
        template: Template,
        chain: Chain,
        beta_lower: float,
        beta_inner: float | None,
        change: float | None,
    ) -> "Coordinates | None":
        """With the box that (a), (b), (c) leave the coefficients; None where it is empty."""
        numbers: Instance = jax.tree.map(lambda values: values[0], chain.funnels)
        inlet, goal, safe = (np.asarray(values, float) for values in (numbers.inlet, numbers.goal, numbers.safe))
        size = len(inlet)
        rows, columns = np.triu_indices(size)
        diagonal = rows == columns
        bounds = tuple(float(bound) for bound in numbers.change_bounds)
        ends = np.zeros(size) if change is None else math.exp(-change) * (inlet / goal) ** 2
        least = np.maximum((inlet / safe) ** 2, ends)  # 1/C_ii ≤ (C⁻¹)_ii < s_i²
        if not least.max() < 1:
            return None
        room = 1 - ends  # of C' between diag(ends) and 1; S is no bound on matrices
        half = np.sqrt(0.5 * room[rows] * room[columns])
        lower = np.where(diagonal, least[rows], -half)
        upper = np.where(diagonal, 1.0, half)
        if change is None:
            inner = beta_lower if beta_inner is None else beta_inner
            highest = min(bounds[1], bounds[1] - beta_lower + inner)
            if not highest > bounds[0]:
                return None
            lower, upper = np.append(lower, bounds[0]), np.append(upper, highest)
        duration = float(numbers.duration)
        return cls(template, inlet, goal, safe, duration, beta_lower, beta_inner, change, lower, upper)

    @property
    def free_rate(self) -> bool:
        return self.change is None

    def form(self, x: Float[np.ndarray, "k n"], y: Float[np.ndarray, "k n"] | None = None) -> Float[np.ndarray, "k r"]:
        """Rows with row · c = xᵀ C y (xᵀ C x unless y is given)."""
        z, t = x / self.inlet, (x if y is None else y) / self.inlet
        rows, columns = np.triu_indices(len(self.inlet))
        both = z[:, rows] * t[:, columns] + z[:, columns] * t[:, rows]
        entries = np.where(rows == columns, 0.5, math.sqrt(0.5)) * both
        return np.concatenate([entries, np.zeros((len(z), int(self.free_rate)))], axis=1)

    def last(self, values: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k r"]:
        """Rows with row · c = value · c0 T; zero where c0 is none of the coefficients."""
        found = np.zeros((len(values), len(self.lower)))
        if self.free_rate:
            found[:, -1] = values
        return found

    def shape(self, c: Float[np.ndarray, " r"]) -> Float[np.ndarray, "n n"]:
        """C."""
        size = len(self.inlet)
        rows, columns = np.triu_indices(size)
        scaled = np.zeros((size, size))
        scaled[rows, columns] = c[: len(rows)] * np.where(rows == columns, 1.0, math.sqrt(0.5))
        scaled = scaled + np.triu(scaled, 1).T
        return scaled / np.outer(self.inlet, self.inlet)

    def change_of(self, c: Float[np.ndarray, " r"]) -> float:
        """Rate · duration."""
        return float(c[-1]) if self.change is None else self.change

    def cone(
        self, forms: Float[np.ndarray, "k r"], least: Float[np.ndarray, " k"], theta: Float[np.ndarray, " k"]
    ) -> Polytope:
        """forms · C ≥ least ρ(θ), which is linear in c0 too: half-spaces of M = C/ρ(θ), whatever the rate."""
        if self.change is None:
            return Polytope(-forms - self.last(least * theta / self.duration), -least)
        return Polytope(-forms, -least * np.exp(-self.change * theta / self.duration))

    def level(self, c: Float[np.ndarray, " r"], theta: float) -> float:
        """ρ(θ)."""
        return float(self.template.level(self.change_of(c) / self.duration, theta))

    def funnel(self, c: Float[np.ndarray, " r"]) -> Funnel:
        shape, rate = self.shape(c), self.change_of(c) / self.duration
        return Funnel(self.template, 0.5 * (shape + shape.T), rate, self.duration, self.beta_lower, self.beta_inner)

    def above(self, x: Float[np.ndarray, "k n"], theta: Float[np.ndarray, " k"]) -> Polytope:
        """V(θ, x) > 1 at points (θ, x) that no funnel may hold: −q − c0 θ ≤ −1, or −q ≤ −ρ(θ)."""
        return self.cone(self.form(x), np.full(len(x), 1 + GAP), theta)

    def below(self, x: Float[np.ndarray, "k n"]) -> Polytope:
        """V(0, x) < 1 at points that the start has to hold."""
        return Polytope(self.form(x), np.full(len(x), 1 - GAP))

    def known(self) -> Polytope:
        """(a) and (b) along the axes and between any two of them: what a box of entries does not say."""
        size = len(self.inlet)
        pairs = [np.eye(size)[i] + s * np.eye(size)[j] for i in range(size) for j in range(i) for s in (1.0, -1.0)]
        way = np.concatenate([np.eye(size), np.array(pairs) / math.sqrt(2)])
        return self.below(way * self.inlet).cut(self.above(way * self.goal, np.full(len(way), self.duration)))

    def broken(self, c: Float[np.ndarray, " r"]) -> Polytope:
        """(a), (b) and the box S: half-spaces at the worst points, of those that c breaks."""
        shape = self.shape(c)
        values, vectors = np.linalg.eigh(shape * np.outer(self.inlet, self.inlet))
        outside = values > 1 - 0.5 * GAP
        cuts = self.below((self.inlet[:, None] * vectors[:, outside]).T)
        values, vectors = np.linalg.eigh(shape * np.outer(self.goal, self.goal))
        outside = values < (1 + 0.5 * GAP) * self.level(c, self.duration)
        ends = (self.goal[:, None] * vectors[:, outside]).T
        cuts = cuts.cut(self.above(ends, np.full(len(ends), self.duration)))
        if len(cuts):  # C may not be positive definite
            return cuts
        inverse = np.linalg.inv(shape)
        widest_at = self.duration if self.level(c, self.duration) > 1 else 0.0
        square = np.square(self.safe) / np.diag(inverse)
        met = (inverse / np.diag(inverse) * self.safe).T  # row i: the funnel's way to face i
        faces = square < (1 + 0.5 * GAP) * self.level(c, widest_at)
        return self.above(met[faces], np.full(int(faces.sum()), widest_at))
