"""Tubes: why a few extreme references speak for every path within bounds. Decided on the vehicle's graph.

Along a path of curvature κ, speed v and acceleration a = dv/dθ the turning rate is κ v, and the rate of the deviation
x at the inputs u = (u0, …) is asked to have the form

    f(x, u; κ, v, a) = f₀(x, u; v) + u0 (κ v g(x) + a h(x))                                               (*)

with f₀ affine in v, no dependence on the slope of the turning rate, u0 > 0 and v > 0. Then, for any V and any deviation
x, with G = ∇V · g(x) and H = ∇V · h(x):

- at fixed u, V̇ grows with κ G and with a H. Let κ* and a* be the ends at which these are largest; the signs of G and H
  depend on x alone. An input that is good at (κ*, a*) is as good or better for every κ and a of the intervals, at once:
  the law need not even know them;
- at fixed u, κ and a, V̇ is affine in v: if V̇ ≤ −m_v at both ends of v, V̇ ≤ −(m interpolated between them) inside.

So it is enough that for each pair of ends of κ and a and each x there is one input u(x) with V̇ ≤ −m at both ends of v.

A stretch of a path whose curvature does not jump has bounds of κ' = dκ/dθ too (`SmoothTube`). Then it is enough that f
is affine in each of κ, v, a and κ' by itself, ω' being κ' v + κ a: so is V̇ at fixed x and u, and one input u(x) that
does at all vertices of the box does everywhere in it. This is what is left to a vehicle whose states beside the pose
change with curvature, as a steering angle does: that form is no (*). It costs more, as one input has to do for all
references, and the box is to be small: stretches are short.

If moreover dynamics of the form (*) have a mirror symmetry, f(Mx, Nu; −κ, v, a) = M f(x, u; κ, v, a) with diagonal
matrices M and N of signs, and the interval of κ, V and the box of inputs are their own mirror images, the upper end of
κ is enough.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import comb

from flint import fmpq, fmpq_mpoly

from cfjax.check.decrease import Extreme
from cfjax.check.program import Matrix
from cfjax.check.rational import about
from cfjax.check.reader import Broken
from cfjax.check.symbolic import Symbolic


Range = tuple[fmpq, fmpq]
TURN_RATE, SPEED = "reference:turn_rate", "reference:speed"
TURN_RATE_SLOPE, SPEED_SLOPE = "reference:turn_rate_slope", "reference:speed_slope"
PARITY = {"sin": -1, "cos": 1, "tan": -1, "inv": -1}  # the square root is neither even nor odd


@dataclass(frozen=True)
class TubeClaim:
    """Every path within bounds: curvature (1/m), speed (m/s), acceleration dv_r/dθ (m/s²)."""

    curvature: Range
    speed: Range
    acceleration: Range

    @property
    def duration(self) -> fmpq:
        """A tube has no end and its V no rate: θ is nowhere in the proof."""
        return fmpq(0)

    @property
    def is_single(self) -> bool:
        """Whether it holds one reference alone."""
        return all(lower == upper for lower, upper in (self.curvature, self.speed, self.acceleration))

    def lies_in(self, other: "TubeClaim | CertifiedTube") -> bool:
        """Whether the other one's bounds are as wide or wider."""
        pairs = (
            (self.curvature, other.curvature),
            (self.speed, other.speed),
            (self.acceleration, other.acceleration),
        )
        return all(outer[0] <= inner[0] and inner[1] <= outer[1] for inner, outer in pairs)

    def scaled(self, length: fmpq, speed: fmpq) -> "TubeClaim":
        """The bounds of the similar paths: lengths and speeds multiplied by these."""

        def times(factor: fmpq, interval: Range) -> Range:
            return interval[0] * factor, interval[1] * factor

        return TubeClaim(
            times(1 / length, self.curvature),
            times(speed, self.speed),
            times(speed**2 / length, self.acceleration),
        )

    def extremes(self, mirrored: bool = False) -> list[Extreme]:
        """References that speak for all: by curvature, then acceleration, then speed, lower ends first.

        The two speeds of one curvature and acceleration have one nominal reference, and so one sign pattern and vertex:
        the vertex that is best at the highest speed. (At lower ones acceleration may call for another u0, but thrust
        then has room to make up for it, where at the highest speed a wrong u0 would cost most.)
        """
        zero = fmpq(0)

        def profile(kappa: fmpq, v: fmpq, a: fmpq) -> dict[str, fmpq]:
            return {"turn_rate": kappa * v, "speed": v, "turn_rate_slope": zero, "speed_slope": a}

        curvatures = [self.curvature[1]] if mirrored else _ends(self.curvature)
        return [
            Extreme(profile(kappa, self.speed[1], a), profile(kappa, v, a))
            for kappa, a, v in product(curvatures, _ends(self.acceleration), _ends(self.speed))
        ]


@dataclass(frozen=True)
class SmoothTube(TubeClaim):
    """Those of a tube's paths whose curvature does not jump, and changes within bounds: dκ/dθ, 1/(m s)."""

    curvature_rate: Range

    @property
    def is_single(self) -> bool:
        """Whether it holds one reference alone."""
        return super().is_single and self.curvature_rate == (0, 0)

    def extremes(self, mirrored: bool = False) -> list[Extreme]:
        """The vertices of its box; signs, and with them the one input of all, are read in its middle."""
        del mirrored  # each is needed: their input is one and the same

        def profile(kappa: fmpq, v: fmpq, a: fmpq, kappa_rate: fmpq) -> dict[str, fmpq]:
            slope = kappa_rate * v + kappa * a
            return {"turn_rate": kappa * v, "speed": v, "turn_rate_slope": slope, "speed_slope": a}

        box = self.curvature, self.speed, self.acceleration, self.curvature_rate
        nominal = profile(*((lower + upper) / 2 for lower, upper in box))
        return [Extreme(nominal, profile(*vertex)) for vertex in product(*map(_ends, box))]


def place_of(extremes: Sequence[Extreme], index: int) -> str:
    """Which reference is spoken of, in words; nothing where there is but one."""
    if len(extremes) == 1:
        return ""
    profile = extremes[index].profile
    curvature = profile["turn_rate"] / profile["speed"]
    changing = (profile["turn_rate_slope"] - curvature * profile["speed_slope"]) / profile["speed"]
    return (
        f"curvature {about(curvature)} 1/m, speed {about(profile['speed'])} m/s, "
        f"acceleration {about(profile['speed_slope'])} m/s^2, "
        + (
            f"curvature rate {about(changing)} 1/(m s), "
            if any(each.profile["turn_rate_slope"] for each in extremes)
            else ""
        )
    )


def _ends(interval: Range) -> list[fmpq]:
    return sorted(set(interval))


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


def is_mirrored(
    dynamics: Symbolic, states: Sequence[str], inputs: Mapping[str, Range], shape: Matrix, tube: TubeClaim
) -> bool:
    """Whether one end of the curvature speaks for both: dynamics, curvature, V and inputs are mirror symmetric."""
    if tube.curvature[0] != -tube.curvature[1]:
        return False
    each = range(len(states))
    for signs in _mirrors(dynamics, len(states), len(inputs)):
        same_value = all(signs[i] == signs[j] or shape[i][j] == 0 for i in each for j in each)
        flipped = (limits for limits, sign in zip(inputs.values(), signs[len(states) :], strict=False) if sign < 0)
        if same_value and all(lower == -upper for lower, upper in flipped):
            return True
    return False


def _mirrors(dynamics: Symbolic, states: int, inputs: int) -> Iterator[tuple[int, ...]]:
    """Signs of states and inputs with f(Mx, Nu; −κ, v, a) = M f(x, u; κ, v, a); u0 keeps its sign."""
    looked_at = [*dynamics.rates, *(argument for _, argument in dynamics.functions.values())]
    dynamics.domain.budget.spend(sum(map(len, looked_at)) * 2 ** (states + inputs))
    for flips in product((1, -1), repeat=states + inputs - 1):
        chosen = (*flips[:states], 1, *flips[states:])
        signs = {**dict(enumerate(chosen)), **{dynamics.names.index(name): 1 for name in (SPEED, SPEED_SLOPE)}}
        signs |= {dynamics.names.index(name): -1 for name in (TURN_RATE, TURN_RATE_SLOPE)}
        if all(_take_parity(signs, index, function) for index, function in dynamics.functions.items()) and all(
            _parity(rate, signs) in (chosen[state], 0) for state, rate in enumerate(dynamics.rates)
        ):
            yield chosen


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
