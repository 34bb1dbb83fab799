"""A refuted candidate: its witness evaluated in ball arithmetic, nothing else believed.

The deviation x at θ violates, for the candidate's V and claimed margin λ,

    (a)  x ∈ I and V(0, x) ≥ 1
    (b)  x outside G = {xᵀ P_G x < 1} and V(T, x) ≤ 1
    (c)  x outside S, or its heading at π or beyond, and V(θ, x) ≤ 1
    (d)  β̲ ≤ V(θ, x) ≤ 1, and V̇ > −λ at every vertex of the input box: V̇ is affine in the inputs, so at every input;
         where a law is part of the question, at both ends of u0 with the law's inputs
"""

from collections.abc import Mapping, Sequence
from itertools import product

from flint import arb, fmpq

from cfcheck.claims.document import Claims, Witness
from cfcheck.claims.problem import ProblemClaim
from cfcheck.claims.proven import Violation
from cfcheck.exact.graph import Graph
from cfcheck.exact.rational import pi_lower, pi_upper
from cfcheck.kernel.containment import HEADING, Sets
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.law import LawClaim
from cfcheck.path.bounds import Bounds, Extreme
from cfcheck.reader import Broken


def references_of(claims: Claims, leg: int, theta: fmpq) -> list[Extreme]:
    """What a funnel has to hold for at θ of a leg: the one reference there, or the extreme ones of every path."""
    course = claims.problem.course
    if isinstance(course, Bounds):
        return course.extremes()
    found = [piece for piece in claims.legs[leg].pieces if piece.theta <= theta][-1]  # where two meet, the later one
    profile = found.profile(theta - found.theta)
    return [Extreme(profile, profile)]


def confirm_witness(claims: Claims, witness: Witness) -> Violation:
    """What the witness violates.

    Raises:
        Broken: the witness does not show a violation.
    """
    problem, x, theta = claims.problem, witness.x, witness.theta
    states, legs, leg = problem.vehicle.states, claims.legs, witness.leg
    funnel = claims.driven[claims.parts[leg].funnel if legs else 0]
    duration = legs[leg].duration if legs else fmpq(0)
    if not 0 <= theta <= duration:
        raise Broken("witness: theta lies outside the leg")
    if witness.condition in "ab" and theta != (0 if witness.condition == "a" else duration):
        raise Broken(f"witness: condition ({witness.condition}) is about one end of the leg, not this theta")
    extremes = references_of(claims, leg, theta)
    if witness.reference >= len(extremes):
        raise Broken("witness: no such reference")
    if not legs and funnel.level.rate != 0:
        raise Broken("witness: the V of a funnel for every path has rate 0")
    if any(model is not problem.car for model in claims.models) or (legs and funnel.margin_per_metre is not None):
        raise Broken("witness: expected a candidate for the vehicle itself, with no margin per metre along a path")
    form = _form(funnel.shape, x)
    inside = form <= funnel.level.bounds(theta)[0]

    if witness.condition != "d":
        sets = problem.sets(is_first=leg == 0, is_last=leg == max(len(legs) - 1, 0))
        return _confirm_containment(witness.condition, states, sets, x, form, inside)
    if _heading(states, x) >= pi_lower():
        raise Broken("witness: its heading lies beyond where it wraps")
    # β̲ ≤ V, where the weight of λ is 1
    if not (inside and form >= funnel.level.form_bounds(funnel.beta_lower, theta)[1]):
        raise Broken("witness: not a deviation in the shell beta_lower <= V <= 1")
    require_affine(problem.vehicle.graph, tuple(problem.inputs))
    profile = extremes[witness.reference].profile  # one of the paths that the funnel is for
    ends = {name: [arb(end) for end in sorted(set(limits))] for name, limits in problem.inputs.items()}
    if problem.law is not None:
        ends |= _law_inputs(problem.law, problem, profile, x)
    for vertex in product(*ends.values()):
        rate = _value_rate(problem, profile, funnel, witness, dict(zip(ends, vertex, strict=True)), form)
        if not rate > -arb(funnel.margin):
            raise Broken("witness: some vertex of the input box may decrease V fast enough")
    return Violation.DECREASE if problem.law is None else Violation.LAW


def _confirm_containment(
    condition: str, states: Sequence[str], sets: Sets, x: Sequence[fmpq], form: fmpq, inside: bool
) -> Violation:
    """What x violates of (a), (b), (c); `form` is xᵀ C x, and `inside` says that V ≤ 1 at x.

    Raises:
        Broken: the problem has no such condition there, or x satisfies it.
    """
    axes = {"a": sets.inlet, "b": sets.goal}.get(condition, ())
    if axes is None:
        raise Broken(f"witness: condition ({condition}) is not asked here")
    distance = sum(((xi / axis) ** 2 for xi, axis in zip(x, axes, strict=True)), fmpq(0)) if axes else fmpq(0)
    if condition == "a":
        if not distance <= 1 <= form:
            raise Broken("witness: not a deviation of the inlet I at which V is 1 or more")
        return Violation.INLET
    if condition == "b":
        if not (inside and distance >= 1):
            raise Broken("witness: not a deviation outside the goal G at which V(T, x) is 1 or less")
        return Violation.GOAL
    outside = sets.safe is not None and any(abs(xi) > si for xi, si in zip(x, sets.safe, strict=True))
    if not (inside and (outside or _heading(states, x) >= pi_upper())):
        raise Broken("witness: not a deviation outside the safe set S, or beyond pi, at which V is 1 or less")
    return Violation.SAFE if outside else Violation.HEADING


def _heading(states: Sequence[str], x: Sequence[fmpq]) -> fmpq:
    """|α|, rad; 0 where no state is a heading."""
    return abs(x[states.index(HEADING)]) if HEADING in states else fmpq(0)


def _law_inputs(
    law: LawClaim, problem: ProblemClaim, profile: Mapping[str, fmpq], x: Sequence[fmpq]
) -> dict[str, list[arb]]:
    """The one value of each input that a law gives at a deviation, as a ball."""
    values = dict(zip(problem.vehicle.states, map(arb, x), strict=True))
    values |= {f"reference:{name}": arb(value) for name, value in profile.items()}
    names, outputs = list(problem.inputs)[1:], law.graph.evaluate(values, arb, _applied)
    return {
        name: [output.max(arb(problem.inputs[name][0])).min(arb(problem.inputs[name][1]))]
        for name, output in zip(names, outputs, strict=True)
    }


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
    inputs: dict[str, arb],
    form: fmpq,
) -> arb:
    """V̇ at the witness as a ball."""
    values = dict(zip(problem.vehicle.states, map(arb, witness.x), strict=True))
    values |= {f"input:{name}": value for name, value in inputs.items()}
    values |= {f"reference:{name}": arb(value) for name, value in profile.items()}

    rates = problem.vehicle.graph.evaluate(values, arb, _applied)
    gradient = [2 * sum((c * xj for c, xj in zip(row, witness.x, strict=True)), fmpq(0)) for row in funnel.shape]
    rate = sum((arb(g) * r for g, r in zip(gradient, rates, strict=True)), arb(0))
    return funnel.level.value_rate(witness.theta, form, rate, inputs["u0"])


def _applied(_: int, function: str, argument: arb) -> arb:
    named = {"sin": arb.sin, "cos": arb.cos, "tan": arb.tan, "sqrt": arb.sqrt, "inv": lambda t: 1 / t}
    return named[function](argument)


def _form(shape: Sequence[Sequence[fmpq]], x: Sequence[fmpq]) -> fmpq:
    pairs = ((c, xi, xj) for row, xi in zip(shape, x, strict=True) for c, xj in zip(row, x, strict=True))
    return sum((c * xi * xj for c, xi, xj in pairs), fmpq(0))
