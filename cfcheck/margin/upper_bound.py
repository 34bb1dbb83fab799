"""An upper bound of the margin: no control funnel function of one form reaches λ on a straight line, proven.

The form is the paper's, V = xᵀ C x + c0 θ, with a C that couples α with x and y with the last state (v) alone, as the
mirror symmetry of a straight line suggests. Then with k1, k2 for what α and v are on the ridge V_α = V_v = 0,

    C = [[c, −c k1], [−c k1, p1 + c k1²]] in (α, x)   and   [[c', −c' k2], [−c' k2, p2 + c' k2²]] in (v, y),

and on the ridge (α, v) = (k1 x, k2 y), V = p1 x² + p2 y² + c0 θ. The inputs of the vehicle change α and v alone, so
there they do nothing for V, and V̇ depends on five numbers of the candidate: c0 and, for each block, a = √p and
m = k/√p. **The unknowns are (c0, a1, a2, m1, m2).**

**What every candidate satisfies** (`conditions`). Condition (a), C ≺ diag(i) with i = 1/(half-axis of I)², and (b),
C ≻ ρ diag(g), ρ = 1 − c0 T, hold for a block with some c if and only if, with i_s, g_s of α (or v) and i_p, g_p of x
(or y),

    i_p − p > 0,   A = p − ρ g_p − ρ g_s k² > 0,   i_s (i_p − p) A − ρ g_s (p − ρ g_p) (i_p − p + i_s k²) > 0,

for det(diag(i) − C) > 0 is c < i_s (i_p − p)/(i_p − p + i_s k²), and det(C − ρ diag(g)) > 0 is c > ρ g_s (p − ρ g_p)/A.
By the reciprocals of these two bounds the last one also reads, with k² = m² p,

    1/(ρ g_s) − 1/i_s − m² (1/(1 − ρ g_p/p) + 1/(i_p/p − 1)) > 0,

where each part is largest at an end of a box (`Row.is_empty`).

**What (d) asks at a place** (`value_rate`). A place is a level ℓ, β̲ or 1, an end of the path, θ = 0 or T, and a
direction: (√p1 x, √p2 y) = (X, Y) with X² + Y² = ℓ − c0 θ. It lies in the shell of every candidate, and moves with it.
A candidate with margin λ has V̇ ≤ −λ there for some u0 of its interval, and so for the end of it that makes V̇ smaller:
which one that is has to be clear in the whole box. At a *still* place, Y = c0/(2 a2 v_r), u0 drops out of V̇.

**The tree.** It cuts a box that holds every candidate into smaller ones. A leaf names places and conditions with
weights μ, ν ≥ 0 such that everywhere in its box

    Σ μ (V̇ + λ) − Σ ν (condition) > 0,

which no candidate with margin λ can have there: each V̇ + λ is at most zero, each condition above it. By the mean value
theorem the left side is at least its value in the middle minus Σ half-width · |derivative|. With the right weights the
derivatives nearly cancel, so the boxes may be large.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from flint import arb, fmpq

from cfcheck.claims.problem import ProblemClaim
from cfcheck.claims.refutation import require_affine
from cfcheck.exact.rational import sqrt_lower, sqrt_upper
from cfcheck.exact.symbolic import Symbolic
from cfcheck.margin.dual import Dual, constant, unknowns
from cfcheck.reader import Broken
from cfcheck.vehicle.model import POSE


UNKNOWNS, CONDITIONS = 5, 6

Box = tuple[tuple[fmpq, fmpq], ...]
Lift = Callable[[Any], Any]


class Place(NamedTuple):
    """A point of every candidate's shell.

    `direction` is (cos, sin) of X and Y; or, at a still place, None, and `sign` is that of X.
    """

    level: Any
    theta: Any
    direction: tuple[Any, Any] | None
    sign: Any = 1


class Term(NamedTuple):
    """A place, the end of the interval of u0 (0 or 1) at which V̇ is smaller there, and a weight."""

    place: int
    end: int
    weight: int


@dataclass(frozen=True)
class Leaf:
    """Weights of places and, by their number, of conditions."""

    terms: tuple[Term, ...]
    conditions: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Empty:
    """A box in which one block (0: α and x, 1: v and y) satisfies neither (a) with (b) anywhere."""

    block: int


@dataclass(frozen=True)
class Cut:
    """A box that is cut in the middle of one unknown."""

    axis: int
    below: "Tree"
    above: "Tree"


Tree = Leaf | Empty | Cut


@dataclass(frozen=True)
class Row:
    """The question in numbers: a straight line at one speed, and the shell.

    Raises:
        Broken: it is of another kind.
    """

    problem: ProblemClaim
    dynamics: Symbolic
    beta_lower: fmpq

    def __post_init__(self) -> None:
        problem, vehicle = self.problem, self.problem.vehicle
        if not problem.is_steady or problem.is_lap or len(problem.reference.pieces) != 1 or self.profile["turn_rate"]:
            raise Broken("bound: expected a straight line at constant speed, and no lap")
        if not self.profile["speed"] > 0:
            raise Broken("bound: expected a speed above zero")
        if vehicle.states[:3] != POSE or len(vehicle.states) != 4:
            raise Broken("bound: expected a vehicle with the states alpha, x, y and one more")
        if problem.inlet is None or problem.goal is None:
            raise Broken("bound: expected an inlet I and a goal G")
        if not 0 < self.beta_lower < 1:
            raise Broken("bound: expected beta_lower between 0 and 1")
        require_affine(vehicle.graph, tuple(problem.inputs))
        self._require_ridge()

    def _require_ridge(self) -> None:
        """Raises Broken unless the rates of x and y know no input but u0, and that as a body does beside its path."""
        dynamics, symbols = self.dynamics, self.dynamics.symbols
        looked_at = [self.dynamics.rates[1], self.dynamics.rates[2]]
        looked_at += [argument for _, argument in dynamics.functions.values()]
        for name in self.problem.inputs:
            index = dynamics.names.index(f"input:{name}")
            parts = looked_at if name != "u0" else looked_at[2:]
            if any(len(part) and part.degrees()[index] > 0 for part in parts):
                raise Broken(f"bound: the rates of x and y depend on the input {name}")
        omega, x, y, speed = (symbols[name] for name in ("reference:turn_rate", "x", "y", "reference:speed"))
        u0 = dynamics.names.index("input:u0")
        if looked_at[0].derivative(u0) != omega * y or looked_at[1].derivative(u0) != -speed - omega * x:
            raise Broken("bound: u0 does not stand in the rates of x and y as for a body beside its path")

    @cached_property
    def profile(self) -> dict[str, fmpq]:
        """Of the reference: turn rate and speed, and that neither changes."""
        return dict(self.problem.reference.pieces[0].profile(fmpq(0)))

    @property
    def duration(self) -> fmpq:
        return self.problem.reference.duration

    @property
    def timing(self) -> tuple[fmpq, fmpq]:
        return self.problem.inputs["u0"]

    @cached_property
    def inlet(self) -> tuple[fmpq, ...]:
        """i, by state."""
        return tuple(1 / axis**2 for axis in self.problem.inlet or ())

    @cached_property
    def goal(self) -> tuple[fmpq, ...]:
        """g, by state."""
        return tuple(1 / axis**2 for axis in self.problem.goal or ())

    @cached_property
    def root(self) -> Box:
        """A box that holds every candidate with (a), (b) and, at x = 0, (d).

        (a) and (b) at θ = T leave ρ g < i in each state, and x = 0 must not be in the shell at T: 1 − β̲ < ρ < min i/g.
        So c0 lies between, ρ g_p < p < i_p, and A > 0 says m² = k²/p < 1/(ρ g_s).
        """
        least, widest = 1 - self.beta_lower, min(i / g for i, g in zip(self.inlet, self.goal, strict=True))
        box = [((1 - widest) / self.duration, self.beta_lower / self.duration)]
        box += [(sqrt_lower(least * self.goal[p]), sqrt_upper(self.inlet[p])) for p in (1, 2)]
        tilts = [sqrt_upper(1 / (least * self.goal[s])) for s in (0, 3)]
        return (*box, *((-tilt, tilt) for tilt in tilts))

    def conditions(self, candidate: Sequence[Any], lift: Lift) -> list[Any]:
        """Numbers that are above zero for every candidate: three for each block."""
        c0, *others = candidate
        rho = lift(fmpq(1)) - lift(self.duration) * c0
        found = []
        for (s, p), root, tilt in zip(((0, 1), (3, 2)), others[:2], others[2:], strict=True):
            i_s, i_p, g_s, g_p = map(lift, (self.inlet[s], self.inlet[p], self.goal[s], self.goal[p]))
            square, bend = root.square(), tilt.square()  # p and m²
            outer, low = i_p - square, square - g_p * rho
            inner = low - g_s * rho * bend * square
            apart = i_s * outer * inner - g_s * rho * low * (outer + i_s * bend * square)
            found += [outer, inner, apart]
        return found

    def is_empty(self, box: Box, block: int) -> bool:
        """Whether no number of the box satisfies (a) and (b) in this block, by the reciprocals of both bounds of c."""
        s, p = ((0, 1), (3, 2))[block]
        least, (low, high), (left, right) = 1 - self.duration * box[0][1], box[1 + block], box[3 + block]
        least = max(least, 1 - self.beta_lower)
        tilt = fmpq(0) if left <= 0 <= right else min(left * left, right * right)
        i_s, i_p, g_s, g_p = self.inlet[s], self.inlet[p], self.goal[s], self.goal[p]
        above, below = 1 - least * g_p / high**2, i_p / low**2 - 1
        if above <= 0 or below <= 0:
            return True
        return 1 / (least * g_s) - 1 / i_s - tilt * (1 / above + 1 / below) <= 0

    def value_rate(self, place: Place, end: int, candidate: Sequence[Any], lift: Lift) -> Any:
        """V̇ at a place of the ridge, u0 at this end of its interval."""
        c0, root_x, root_y, tilt_x, tilt_y = candidate
        left, timing = lift(place.level) - lift(place.theta) * c0, lift(self.timing[end])
        if place.direction is None:
            far_y = c0 * (root_y * lift(2 * self.profile["speed"])).inverse()
            far_x = (left - far_y * far_y).sqrt() * lift(place.sign)
        else:
            radius = left.sqrt()
            far_x, far_y = (radius * lift(part) for part in place.direction)
        names = self.problem.vehicle.states
        values = dict(zip(names[:3], (tilt_x * far_x, far_x * root_x.inverse(), far_y * root_y.inverse()), strict=True))
        values[names[3]] = tilt_y * far_y
        values |= {f"input:{name}": lift(fmpq(0)) for name in self.problem.inputs} | {"input:u0": timing}
        values |= {f"reference:{name}": lift(value) for name, value in self.profile.items()}
        _, of_x, of_y, _ = self.problem.vehicle.graph.evaluate(values, lift, _applied)
        twice = lift(fmpq(2))
        return twice * root_x * far_x * of_x + twice * root_y * far_y * of_y + timing * c0


def _applied(_: int, function: str, argument: Any) -> Any:
    if function == "inv":
        return argument.inverse()
    if function not in ("sin", "cos", "sqrt"):
        raise Broken(f"bound: the dynamics apply {function}, of which no derivative is known here")
    return getattr(argument, function)()


@dataclass(frozen=True)
class UpperBound:
    """No candidate of the form has margin λ = `margin` (1/s) or more: places, and the tree that shows it."""

    row: Row
    margin: fmpq
    places: tuple[Place, ...]
    tree: Tree

    def prove(self) -> int:
        """How many leaves there are, all of which are shown.

        Raises:
            Broken: one is not.
        """
        return self._prove(self.tree, self.row.root)

    def _prove(self, tree: Tree, box: Box) -> int:
        if isinstance(tree, Cut):
            below, above = halves(box, tree.axis)
            return self._prove(tree.below, below) + self._prove(tree.above, above)
        if isinstance(tree, Empty):
            holds = self.row.is_empty(box, tree.block)
        else:
            holds = leaf_holds(self.row, self.margin, self.places, tree, box)
        if not holds:
            at = ", ".join(str(float((low + high) / 2)) for low, high in box)
            raise Broken(f"bound: the leaf about {at} does not show that no candidate is there")
        return 1


def halves(box: Box, axis: int) -> tuple[Box, Box]:
    """Those of a box, cut in the middle of one unknown."""
    low, high = box[axis]
    middle = (low + high) / 2
    return tuple((*box[:axis], part, *box[axis + 1 :]) for part in ((low, middle), (middle, high)))  # pyright: ignore[reportReturnType]


def leaf_holds(row: Row, margin: fmpq, places: Sequence[Place], leaf: Leaf, box: Box) -> bool:
    """Whether the weighted sum is above zero in the whole box, and each end of u0 is the better one there."""
    middle = tuple(((low + high) / 2,) * 2 for low, high in box)
    half_widths = [(high - low) / 2 for low, high in box]

    def both(of: Callable[[Sequence[Dual], Lift], Dual]) -> arb:
        """The least value in the box."""
        point = [Dual(arb(low), ()) for low, _ in middle]
        at = of(point, lambda value: constant(value, 0)).value
        return of(unknowns(box), lambda value: constant(value, len(box))).least(half_widths, at)

    def total(candidate: Sequence[Dual], lift: Lift) -> Dual:
        found = lift(fmpq(0))
        for term in leaf.terms:
            rate = row.value_rate(places[term.place], term.end, candidate, lift)
            found += lift(fmpq(term.weight)) * (rate + lift(margin))
        conditions = row.conditions(candidate, lift) if leaf.conditions else []
        for index, weight in leaf.conditions:
            found -= lift(fmpq(weight)) * conditions[index]
        return found

    if not both(total) > 0:
        return False
    for term in leaf.terms:
        place = places[term.place]
        if place.direction is None or row.timing[0] == row.timing[1]:
            continue

        def gain(candidate: Sequence[Dual], lift: Lift, place: Place = place, end: int = term.end) -> Dual:
            """By how much the other end of u0 is worse."""
            return row.value_rate(place, 1 - end, candidate, lift) - row.value_rate(place, end, candidate, lift)

        if not both(gain) >= 0:
            return False
    return True
