"""Whether a vehicle's first states are the pose of a body, seen from a reference that looks along its path.

The checker does not know the vehicle. But every body that moves in the plane has rates of the form

    α̇ = Ω − ω u0,      ẋ = c L − s F + ω u0 y,      ẏ = s L + c F − v u0 − ω u0 x,      s = sin α, c = cos α,

with a twist (Ω, L, F) that depends on no pose and not on the timing, beside a reference that turns at ω and moves at v
along its own forward axis. Then (α, x, y) is the body's pose relative to the reference, and statements about places
along the path are statements about the body.

A vehicle's reference may look away from its path by an angle; it then moves at v along an axis of its own that stays.
Where the angle changes with the path, as for a point ahead of a car, the reference turns at another rate than ω, and
jumps where the curvature does: such rates are those of a path at one steady reference only.
"""

from collections.abc import Sequence

from flint import fmpq, fmpq_mpoly

from cfcheck.vehicle.model import POSE
from cfcheck.vehicle.structure import SPEED, SPEED_SLOPE, TURN_RATE, TURN_RATE_SLOPE
from cfcheck.vehicle.symbolic import Symbolic


TIMING = "input:u0"
LARGEST_SPEED_ERROR = fmpq(1, 10**9)  # of a reference, relative: sines and cosines of an angle are rounded


def looks_at_one_angle(dynamics: Symbolic, states: Sequence[str]) -> bool:
    """Whether the reference turns at ω and moves at v along one of its axes, whatever ω and v are, exactly."""
    beside = _beside_the_turning(dynamics, states)
    if beside is None:
        return False
    progress = dynamics.symbols[SPEED] * dynamics.symbols[TIMING]
    ((moment, _),) = progress.to_dict().items()
    turn, *motion = beside
    shares = [fmpq(rate.to_dict().get(moment, 0)) for rate in motion]  # of v u0, along either axis
    left = [dynamics.domain.sum(rate, -share * progress) for rate, share in zip(motion, shares, strict=True)]
    of_timing = _depending(dynamics, {TIMING})
    is_as_fast = abs(sum(share**2 for share in shares) - 1) <= LARGEST_SPEED_ERROR
    return is_as_fast and not any(_holds(rate, of_timing) for rate in (turn, *left))


def turns_by_timing_alone(dynamics: Symbolic) -> bool:
    """Whether ω stands nowhere but in ω u0 g(x), g of states alone."""
    turning, timing = dynamics.names.index(TURN_RATE), dynamics.names.index(TIMING)
    others = _depending(dynamics, {name for name in dynamics.names if ":" in name})
    if any(_holds(argument, {turning}) for _, argument in dynamics.functions.values()):
        return False
    with_it = (powers for rate in dynamics.rates for powers in rate.to_dict() if int(powers[turning]))
    return all(
        {index: int(powers[index]) for index in others if int(powers[index])} == {turning: 1, timing: 1}
        for powers in with_it
    )


def slopes_by_timing_alone(dynamics: Symbolic) -> bool:
    """Whether ω' and v_r' stand nowhere but in products with u0, as in what states of a reference do while θ goes on.

    A state that follows one of these instead, and jumps where it does, shows by a term without u0.
    """
    timing, slopes = dynamics.names.index(TIMING), {TURN_RATE_SLOPE, SPEED_SLOPE}
    if any(_holds(argument, _depending(dynamics, slopes)) for _, argument in dynamics.functions.values()):
        return False
    indices = {dynamics.names.index(name) for name in slopes}
    with_them = (powers for rate in dynamics.rates for powers in rate.to_dict() if any(int(powers[i]) for i in indices))
    of_timing = _depending(dynamics, {TIMING}) - {timing}
    return all(int(powers[timing]) == 1 and not any(int(powers[i]) for i in of_timing) for powers in with_them)


def is_a_body(dynamics: Symbolic, states: Sequence[str]) -> bool:
    """Whether the rates have the form above, exactly."""
    beside = _beside_the_turning(dynamics, states)
    if beside is None:
        return False
    symbols, generators = dynamics.symbols, dynamics.domain.ring.gens()
    of_heading = {name: index for index, (name, argument) in dynamics.functions.items() if argument == symbols["alpha"]}
    if not {"sin", "cos"} <= of_heading.keys():
        return False
    sine, cosine = of_heading["sin"], of_heading["cos"]
    s, c = generators[sine], generators[cosine]
    plus, times, minus = dynamics.domain.sum, dynamics.domain.product, dynamics.domain.negative
    turn, across, along = beside[0], beside[1], plus(beside[2], symbols[SPEED] * symbols[TIMING])
    lateral, forward = across.derivative(cosine), minus(across.derivative(sine))
    return (
        all(_is_of_the_body(dynamics, each, (sine, cosine)) for each in (turn, lateral, forward))
        and across == plus(times(c, lateral), minus(times(s, forward)))
        and along == plus(times(s, lateral), times(c, forward))
    )


def _beside_the_turning(dynamics: Symbolic, states: Sequence[str]) -> tuple[fmpq_mpoly, ...] | None:
    """Rates of the pose without what the reference's turning does to them; None where the states begin with none."""
    if tuple(states[:3]) != POSE:
        return None
    symbols, plus = dynamics.symbols, dynamics.domain.sum
    turning = symbols[TURN_RATE] * symbols[TIMING]
    by_turning = (turning, -turning * symbols["y"], turning * symbols["x"])
    return tuple(plus(rate, part) for rate, part in zip(dynamics.rates, by_turning, strict=False))


def _is_of_the_body(dynamics: Symbolic, polynomial: fmpq_mpoly, of_heading: tuple[int, int]) -> bool:
    """Whether neither pose, timing nor a slope of the reference stands in it, or in a function's argument there."""
    others = {*POSE, TIMING, TURN_RATE_SLOPE, SPEED_SLOPE}
    return not _holds(polynomial, _depending(dynamics, others) | {*of_heading})


def _depending(dynamics: Symbolic, names: set[str]) -> set[int]:
    """Generators that are one of these, or a function of one."""
    found = {index for index, name in enumerate(dynamics.names) if name in names}
    for index, (_, argument) in dynamics.functions.items():  # a function's argument holds none that comes after it
        if _holds(argument, found):
            found.add(index)
    return found


def _holds(polynomial: fmpq_mpoly, indices: set[int]) -> bool:
    return any(int(exponents[index]) for exponents in polynomial.to_dict() for index in indices)
