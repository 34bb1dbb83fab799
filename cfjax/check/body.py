"""Whether a vehicle's first states are the pose of a body, seen from a reference that looks along its path.

The checker does not know the vehicle; but whatever moves as a body in the plane does has rates of the form

    α̇ = Ω − ω u0,      ẋ = c L − s F + ω u0 y,      ẏ = s L + c F − v u0 − ω u0 x,      s = sin α, c = cos α,

with a twist (Ω, L, F) that depends on no pose and not on the timing, beside a reference that turns at ω and moves at v
along its own forward axis. Then (α, x, y) is where that body is from the reference: what is said of places along the
path is said of it.
"""

from collections.abc import Sequence

from flint import fmpq_mpoly

from cfjax.check.symbolic import Symbolic
from cfjax.check.tube import SPEED, SPEED_SLOPE, TURN_RATE, TURN_RATE_SLOPE


POSE = ("alpha", "x", "y")
TIMING = "input:u0"


def is_a_body(dynamics: Symbolic, states: Sequence[str]) -> bool:
    """Whether the rates have the form above, exactly."""
    if tuple(states[:3]) != POSE:
        return False
    symbols, generators = dynamics.symbols, dynamics.domain.ring.gens()
    of_heading = {name: index for index, (name, argument) in dynamics.functions.items() if argument == symbols["alpha"]}
    if not {"sin", "cos"} <= of_heading.keys():
        return False
    sine, cosine = of_heading["sin"], of_heading["cos"]
    s, c = generators[sine], generators[cosine]
    turning = symbols[TURN_RATE] * symbols[TIMING]
    plus, times, minus = dynamics.domain.sum, dynamics.domain.product, dynamics.domain.negative
    turn = plus(dynamics.rates[0], turning)
    across = plus(dynamics.rates[1], -turning * symbols["y"])
    along = plus(dynamics.rates[2], symbols[SPEED] * symbols[TIMING] + turning * symbols["x"])
    lateral, forward = across.derivative(cosine), minus(across.derivative(sine))
    return (
        all(_is_of_the_body(dynamics, each, (sine, cosine)) for each in (turn, lateral, forward))
        and across == plus(times(c, lateral), minus(times(s, forward)))
        and along == plus(times(s, lateral), times(c, forward))
    )


def _is_of_the_body(dynamics: Symbolic, polynomial: fmpq_mpoly, of_heading: tuple[int, int]) -> bool:
    """Whether neither pose, timing nor a slope of the reference stands in it, or in a function's argument there."""
    others = {*POSE, TIMING, TURN_RATE_SLOPE, SPEED_SLOPE}
    barred = {index for index, name in enumerate(dynamics.names) if name in others} | {*of_heading}
    for index, (_, argument) in dynamics.functions.items():  # a function's argument holds none that comes after it
        if _holds(argument, barred):
            barred.add(index)
    return not _holds(polynomial, barred)


def _holds(polynomial: fmpq_mpoly, indices: set[int]) -> bool:
    return any(int(exponents[index]) for exponents in polynomial.to_dict() for index in indices)
