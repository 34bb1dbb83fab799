"""A refuted candidate: its witness evaluated in ball arithmetic, nothing else believed.

The deviation x at θ violates, for the candidate's V and claimed margin λ,

    (a)  x ∈ I and V(0, x) ≥ 1
    (b)  x outside G = {xᵀ P_G x < 1} and V(T, x) ≤ 1
    (c)  x outside S, or its heading at π or beyond, and V(θ, x) ≤ 1
    (d)  β̲ ≤ V(θ, x) ≤ 1, and V̇ > −λ at every vertex of the input box: V̇ is affine in the inputs, so at every input
"""

from collections.abc import Mapping, Sequence
from itertools import product

from flint import arb, fmpq

from cfjax.check.bounds import Bounds, Extreme
from cfjax.check.containment import HEADING
from cfjax.check.document import FunnelClaim, ProblemClaim, SegmentClaim, Witness
from cfjax.check.graph import Graph
from cfjax.check.proven import Violation
from cfjax.check.rational import pi_lower, pi_upper
from cfjax.check.reader import Broken


def references_of(segment: SegmentClaim | Bounds, theta: fmpq) -> list[Extreme]:
    """What the funnel has to hold for at θ: a segment's one reference there, a tube's extreme ones."""
    if isinstance(segment, Bounds):
        return segment.extremes()
    profile = segment.profile(theta)
    return [Extreme(profile, profile)]


def confirm_witness(problem: ProblemClaim, funnel: FunnelClaim, witness: Witness) -> Violation:
    """What the witness violates.

    Raises:
        Broken: the witness does not show a violation.
    """
    states, x, theta = problem.vehicle.states, witness.x, witness.theta
    segment = problem.distinct[witness.funnel]
    if not 0 <= theta <= segment.duration:
        raise Broken("witness: theta lies outside the segment")
    if witness.condition in "ab" and theta != (0 if witness.condition == "a" else segment.duration):
        raise Broken(f"witness: condition ({witness.condition}) is about one end of the segment, not this theta")
    asked = {"a": witness.funnel == problem.kinds[0], "b": witness.funnel == problem.kinds[-1]}
    if not asked.get(witness.condition, True):
        raise Broken(f"witness: condition ({witness.condition}) is not asked of this segment")
    extremes = references_of(segment, theta)
    if witness.reference >= len(extremes):
        raise Broken("witness: no such reference")
    if isinstance(segment, Bounds) and funnel.level.rate != 0:
        raise Broken("witness: the V of a tube has rate 0")
    form = _form(funnel.shape, x)
    inside = form <= funnel.level.bounds(theta)[0]

    if witness.condition == "a":
        if not _form_of_axes(problem.inlet, x) <= 1 <= form:
            raise Broken("witness: not a deviation of the inlet I at which V is 1 or more")
        return Violation.INLET
    if witness.condition == "b":
        if problem.goal is None:
            raise Broken("witness: condition (b) is not asked of a tube without G")
        if not (inside and _form_of_axes(problem.goal, x) >= 1):
            raise Broken("witness: not a deviation outside the goal G at which V(T, x) is 1 or less")
        return Violation.GOAL
    heading = abs(x[states.index(HEADING)]) if HEADING in states else fmpq(0)
    if witness.condition == "c":
        outside = problem.safe is not None and any(abs(xi) > si for xi, si in zip(x, problem.safe, strict=True))
        if not (inside and (outside or heading >= pi_upper())):
            raise Broken("witness: not a deviation outside the safe set S, or beyond pi, at which V is 1 or less")
        return Violation.SAFE if outside else Violation.HEADING

    if heading >= pi_lower():
        raise Broken("witness: its heading lies beyond where it wraps")
    # β̲ ≤ V, where λ is asked for in full
    if not (inside and form >= funnel.level.form_bounds(funnel.beta_lower, theta)[1]):
        raise Broken("witness: not a deviation in the shell beta_lower <= V <= 1")
    require_affine(problem.vehicle.graph, tuple(problem.inputs))
    profile = extremes[witness.reference].profile  # one of the paths that the funnel is for
    for vertex in product(*(sorted(set(ends)) for ends in problem.inputs.values())):
        rate = _value_rate(problem, profile, funnel, witness, dict(zip(problem.inputs, vertex, strict=True)), form)
        if not rate > -arb(funnel.margin):
            raise Broken("witness: some vertex of the input box may decrease V fast enough")
    return Violation.DECREASE


def require_affine(graph: Graph, inputs: Sequence[str]) -> None:
    """Raises Broken unless the outputs are affine in the inputs together, seen from the graph's structure."""

    class Degree:
        """Degree in the inputs; `size` is an upper bound."""

        def __init__(self, size: int) -> None:
            self.size = size

        def __add__(self, other: "Degree") -> "Degree":
            return Degree(max(self.size, other.size))

        __sub__ = __add__

        def __neg__(self) -> "Degree":
            return self

        def __mul__(self, other: "Degree") -> "Degree":
            return Degree(min(self.size + other.size, 2))

    names = {f"input:{name}": Degree(1) for name in inputs}
    values = {name: names.get(name, Degree(0)) for name in graph.inputs()}
    outputs = graph.evaluate(values, lambda _: Degree(0), lambda _, __, argument: Degree(2 * argument.size))
    if any(output.size > 1 for output in outputs):
        raise Broken("vehicle: the dynamics are not affine in the inputs, so the vertices do not speak for the box")


def _value_rate(
    problem: ProblemClaim,
    profile: Mapping[str, fmpq],
    funnel: FunnelClaim,
    witness: Witness,
    inputs: dict[str, fmpq],
    form: fmpq,
) -> arb:
    """V̇ at the witness as a ball."""
    values = dict(zip(problem.vehicle.states, map(arb, witness.x), strict=True))
    values |= {f"input:{name}": arb(value) for name, value in inputs.items()}
    values |= {f"reference:{name}": arb(value) for name, value in profile.items()}

    def apply(_: int, function: str, argument: arb) -> arb:
        named = {"sin": arb.sin, "cos": arb.cos, "tan": arb.tan, "sqrt": arb.sqrt, "inv": lambda t: 1 / t}
        return named[function](argument)

    rates = problem.vehicle.graph.evaluate(values, arb, apply)
    gradient = [2 * sum((c * xj for c, xj in zip(row, witness.x, strict=True)), fmpq(0)) for row in funnel.shape]
    rate = sum((arb(g) * r for g, r in zip(gradient, rates, strict=True)), arb(0))
    return funnel.level.value_rate(witness.theta, form, rate, inputs["u0"])


def _form(shape: Sequence[Sequence[fmpq]], x: Sequence[fmpq]) -> fmpq:
    pairs = ((c, xi, xj) for row, xi in zip(shape, x, strict=True) for c, xj in zip(row, x, strict=True))
    return sum((c * xi * xj for c, xi, xj in pairs), fmpq(0))


def _form_of_axes(half_axes: Sequence[fmpq], x: Sequence[fmpq]) -> fmpq:
    return sum(((xi / axis) ** 2 for xi, axis in zip(x, half_axes, strict=True)), fmpq(0))
