"""What a vehicle's graph has to show for a few extreme references to speak for every path within bounds.

Along a path of curvature κ, speed v and acceleration a = dv/dθ the turning rate is κ v, and the rate of the deviation
x at the inputs u = (u0, …) has to have the form

    f(x, u; κ, v, a) = f₀(x, u; v) + u0 (κ v g(x) + a h(x))                                               (*)

with f₀ affine in v, no dependence on the slope of the turning rate, u0 > 0 and v > 0. Then, for any V and any deviation
x, with G = ∇V · g(x) and H = ∇V · h(x):

- at fixed u, V̇ grows with κ G and with a H. Let κ* and a* be the ends at which these are largest; the signs of G and H
  depend on x alone. An input that is good at (κ*, a*) is as good or better for every κ and a of the intervals, at once:
  the law need not even know them;
- at fixed u, κ and a, V̇ is affine in v: if V̇ ≤ −m_v at both ends of v, V̇ ≤ −(m interpolated between them) inside.

So it is enough that for each pair of ends of κ and a and each x there is one input u(x) with V̇ ≤ −m at both ends of v.

A stretch of a path whose curvature does not jump has bounds of κ' = dκ/dθ too (`Bounds.curvature_rate`). Then it is
enough that f is affine in each of κ, v, a and κ' by itself, ω' being κ' v + κ a: so is V̇ at fixed x and u, and one
input u(x) that does at all vertices of the box does everywhere in it. This is what is left to a vehicle whose states
beside the pose change with curvature, as a steering angle does: that form is no (*). It costs more, as one input has to
do for all references, and the box is to be small: stretches are short.

If moreover dynamics of the form (*) have a mirror symmetry, f(Mx, Nu; −κ, v, a) = M f(x, u; κ, v, a) with diagonal
matrices M and N of signs, and the interval of κ, V and the box of inputs are their own mirror images, the upper end of
κ is enough. A file states the signs (`is_mirror`).
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from math import comb

from flint import fmpq, fmpq_mpoly

from cfcheck.exact.rational import Matrix, Range
from cfcheck.exact.symbolic import Symbolic
from cfcheck.reader import Broken


TURN_RATE, SPEED = "reference:turn_rate", "reference:speed"
TURN_RATE_SLOPE, SPEED_SLOPE = "reference:turn_rate_slope", "reference:speed_slope"
PARITY = {"sin": -1, "cos": 1, "tan": -1, "inv": -1}  # the square root is neither even nor odd


@lru_cache(maxsize=256)  # one for each vehicle of a file; every leg and stretch asks
def require_tube_structure(dynamics: Symbolic) -> None:
    """Raises Broken unless the dynamics have the form (*), with g and h functions of the state alone."""
    states = {name for name in dynamics.names if ":" not in name}
    state_indices = {index for index, name in enumerate(dynamics.names) if name in states}
    for index, (function, argument) in dynamics.functions.items():
        if any(set(support) - state_indices for support, _ in _terms(argument)):
            raise Broken(f"vehicle: a tube needs dynamics whose {function} is of the states alone")
        state_indices.add(index)
    where = {name: index for index, name in enumerate(dynamics.names)}
    timing = where["input:u0"]
    for rate in dynamics.rates:
        for support, _ in _terms(rate):
            outside = {index: power for index, power in support.items() if index not in state_indices}
            if where[TURN_RATE_SLOPE] in outside:
                raise Broken("vehicle: its reference jumps where the curvature of the path does: no tube can hold it")
            if outside.get(where[SPEED], 0) > 1:
                raise Broken("vehicle: a tube needs dynamics that are affine in the reference's speed")
            for name, label in ((TURN_RATE, "turning rate"), (SPEED_SLOPE, "acceleration")):
                if where[name] in outside and outside != {where[name]: 1, timing: 1}:
                    raise Broken(f"vehicle: a tube needs dynamics in which the {label} enters as {label} times u0 g(x)")


def has_tube_structure(dynamics: Symbolic) -> bool:
    """Whether the dynamics have the form (*)."""
    try:
        require_tube_structure(dynamics)
    except Broken:
        return False
    return True


@lru_cache(maxsize=256)
def require_affine_reference(dynamics: Symbolic) -> None:
    """Raises Broken unless the rates are affine in each of κ, v, a and κ' by itself, for ω = κ v and ω' = κ' v + κ a.

    The reference's speed may be divided by, as where a steering angle is that of the curvature ω/v.
    """
    where = {name: index for index, name in enumerate(dynamics.names)}
    reference = [where[name] for name in (TURN_RATE, SPEED, TURN_RATE_SLOPE, SPEED_SLOPE)]
    inverses: dict[int, tuple[int, fmpq]] = {}  # of c times a power of v: the power, and 1/c
    for index, (function, argument) in dynamics.functions.items():
        terms = list(_terms(argument))
        if function == "inv" and len(terms) == 1 and terms[0][0].keys() == {where[SPEED]}:
            ((support, factor),) = terms
            inverses[index] = support[where[SPEED]], 1 / fmpq(factor)
        elif any({*reference, *inverses} & set(support) for support, _ in terms):
            raise Broken(
                f"vehicle: along a path whose curvature changes, its dynamics may apply {function} to states alone, "
                "and divide by the reference's speed"
            )
    for rate in dynamics.rates:
        dynamics.domain.budget.spend(16 * len(rate))
        found: dict[tuple, fmpq] = {}
        for support, coefficient in _terms(rate):
            turn, speed, slope, acceleration = (support.get(index, 0) for index in reference)
            over, value = speed + turn, fmpq(coefficient)
            for index in inverses.keys() & support.keys():
                power, factor = inverses[index]
                over, value = over - power * support[index], value * factor ** support[index]
            others = tuple(item for item in support.items() if item[0] not in {*reference, *inverses})
            for k in range(slope + 1):  # the terms of (κ' v + κ a) to this power
                powers = (turn + k, over + slope - k, acceleration + k, slope - k)
                key = (others, powers)
                found[key] = found.get(key, fmpq(0)) + comb(slope, k) * value
        if any(total != 0 and not all(0 <= power <= 1 for power in powers) for (_, powers), total in found.items()):
            raise Broken(
                "vehicle: along a path whose curvature changes, its dynamics have to be affine in the reference's "
                "curvature, in the rate at which that changes, in speed and in acceleration"
            )


def is_mirror(
    dynamics: Symbolic, states: Sequence[str], inputs: Mapping[str, Range], shape: Matrix, signs: Sequence[int]
) -> bool:
    """Whether f(Mx, Nu; −κ, v, a) = M f(x, u; κ, v, a), V and the box of inputs being their own mirror images too.

    `signs` are the diagonals of M and N; u0 keeps its sign.
    """
    each, flips = range(len(states)), signs[len(states) :]
    same_value = all(signs[i] == signs[j] or shape[i][j] == 0 for i in each for j in each)
    same_box = all(sign > 0 or lower == -upper for sign, (lower, upper) in zip(flips, inputs.values(), strict=True))
    if {*signs} - {1, -1} or flips[0] != 1 or not (same_value and same_box):
        return False
    looked_at = [*dynamics.rates, *(argument for _, argument in dynamics.functions.values())]
    dynamics.domain.budget.spend(sum(map(len, looked_at)))
    parity = {**dict(enumerate(signs)), **{dynamics.names.index(name): 1 for name in (SPEED, SPEED_SLOPE)}}
    parity |= {dynamics.names.index(name): -1 for name in (TURN_RATE, TURN_RATE_SLOPE)}
    return all(_take_parity(parity, index, function) for index, function in dynamics.functions.items()) and all(
        _parity(rate, parity) in (signs[state], 0) for state, rate in enumerate(dynamics.rates)
    )


def _take_parity(signs: dict[int, int], index: int, function: tuple[str, fmpq_mpoly]) -> bool:
    """Note the sign of a function's symbol; False where it is neither even nor odd."""
    name, argument = function
    parity = _parity(argument, signs)
    signs[index] = PARITY.get(name, 0) if parity == -1 else 1
    return parity is not None and signs[index] != 0


def _parity(polynomial: fmpq_mpoly, signs: Mapping[int, int]) -> int | None:
    """1 or −1 where the polynomial keeps or changes its sign with those of the variables; 0 for zero; None: neither."""
    found = set()
    for support, _ in _terms(polynomial):
        sign = 1
        for index, power in support.items():
            sign *= signs[index] ** (power % 2)
        found.add(sign)
    return found.pop() if len(found) == 1 else (None if found else 0)


def _terms(polynomial: fmpq_mpoly) -> Iterator[tuple[dict[int, int], fmpq]]:
    """(powers by generator, coefficient) of each monomial."""
    for exponents, coefficient in polynomial.to_dict().items():
        yield {index: int(power) for index, power in enumerate(exponents) if power}, coefficient
