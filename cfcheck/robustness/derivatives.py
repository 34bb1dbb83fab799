"""Derivatives of V along the motion of a car that holds its inputs beside a reference of one turning rate and speed.

For V = e^{kθ} q they are e^{kθ} P_n with P_0 = q and P_{n+1} = ∇P_n · f + k u0 P_n: exact polynomials in states, inputs
and the sines of states. `control_points` makes of them the Bernstein coefficients of Taylor's polynomial of
(V(s) − V)/s (`cfcheck.robustness.sampled`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from math import comb, factorial

from flint import fmpq, fmpq_mpoly

from cfcheck.claims.proof import Question
from cfcheck.exact.rational import Range
from cfcheck.exact.symbolic import Symbolic
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.path.reference import Gap
from cfcheck.reader import Broken
from cfcheck.robustness.hold import TIMING
from cfcheck.robustness.term_bounds import slopes_of


@dataclass(frozen=True)
class SteadyLeg:
    """A leg of one turning rate and speed (`profile`, by the graph's names), and condition (d) of its funnel.

    `duration` in s; `gap` is the jump of the reference where the leg closes a lap.
    """

    question: Question
    profile: Mapping[str, fmpq]
    duration: fmpq
    gap: Gap | None

    @property
    def dynamics(self) -> Symbolic:
        """In symbols."""
        return self.question.dynamics

    @property
    def funnel(self) -> FunnelClaim:
        """V."""
        return self.question.funnel

    @property
    def states(self) -> tuple[str, ...]:
        """Their names."""
        return self.question.model.vehicle.states

    @property
    def inputs(self) -> Mapping[str, Range]:
        """The box by name, u0 first."""
        return self.question.model.inputs


def derivatives(leg: SteadyLeg, order: int) -> list[fmpq_mpoly]:
    """P_1 … P_order: derivatives of V/σ, in the symbols of the dynamics with the numbers of the reference put in.

    Raises:
        Broken: the dynamics apply a function to something else than states.
        ValueError: a polynomial is larger than the checker takes, or a derivative of it is not known.
    """
    dynamics, funnel = leg.dynamics, leg.funnel
    states, domain = leg.states, leg.dynamics.domain
    _require_functions_of_states(dynamics, states)
    symbols, zero = dynamics.symbols, domain.ring.constant(0)
    profile = {f"reference:{name}": value for name, value in leg.profile.items()}
    generators = domain.ring.names()
    numbers: dict[str | int, fmpq | int] = {
        generators[dynamics.names.index(name)]: value for name, value in profile.items()
    }
    rates = [rate.subs(numbers) for rate in dynamics.rates]
    circles, slopes = _circles(dynamics), slopes_of(dynamics)
    pairs = ((i, j) for i in range(len(states)) for j in range(len(states)))
    value = sum((funnel.shape[i][j] * symbols[states[i]] * symbols[states[j]] for i, j in pairs), zero)
    found = []
    for _ in range(order):
        along = (
            domain.product(slopes.derivative(value, state), rate) for state, rate in zip(states, rates, strict=True)
        )
        turned = domain.product(value, funnel.level.rate * symbols[TIMING])
        value = reduce(domain.sum, along, turned)
        for circle in circles:
            value = domain.rest(value, circle)
        found.append(value)
    return found


def _require_functions_of_states(dynamics: Symbolic, states: Sequence[str]) -> None:
    known = {dynamics.names.index(state) for state in states}
    for index, (function, argument) in dynamics.functions.items():
        if any(power and k not in known for e in argument.to_dict() for k, power in enumerate(map(int, e))):
            raise Broken(f"vehicle: sampled control is proven for dynamics whose {function} is of the states alone")
        known.add(index)


def _circles(dynamics: Symbolic) -> list[fmpq_mpoly]:
    """sin² + cos² − 1, which is zero, for each argument that both are applied to."""
    found, ring = [], dynamics.domain.ring
    for index, (function, argument) in dynamics.functions.items():
        for other, (cofunction, same) in dynamics.functions.items():
            if (function, cofunction) == ("sin", "cos") and argument == same:
                found.append(ring.gens()[index] ** 2 + ring.gens()[other] ** 2 - 1)
    return found


def control_points(each: Sequence[fmpq_mpoly], period: fmpq) -> list[fmpq_mpoly]:
    """B_0 … B_{m−1} from P_1 … P_m."""
    size = len(each)
    found = []
    for j in range(size):
        weights = (period**k * fmpq(comb(j, k), comb(size - 1, k) * factorial(k + 1)) for k in range(j + 1))
        found.append(sum((weight * value for weight, value in zip(weights, each, strict=False)), 0 * each[0]))
    return found
