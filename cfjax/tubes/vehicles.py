"""Tubes for other cars: by what a car can do, and by similarity. Both are exact.

A car that can do whatever the proven one can is held by the proven one's tube. And with lengths multiplied by L, speeds
by S (so times by L/S, accelerations by S²/L) the kinematic bicycle is the same car again: a tube with C, λ and μ
becomes D⁻¹ C D⁻¹ with D = diag(1, L, L, S), λ S/L and μ/L.
"""

from dataclasses import replace

from flint import fmpq

from cfjax.check.rational import rational
from cfjax.check.reference import CertifiedTube, Range
from cfjax.check.vehicle import KNOWN_VEHICLES
from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle, Vehicle


BITS = 24  # of the speed scale: a square root, rounded down


def parameters_of(vehicle: Vehicle) -> dict[str, fmpq]:
    """The vehicle's parameters in exact numbers, of those that the checker knows by name.

    Raises:
        InputError: for a vehicle that it does not know: its tubes cannot be told from another's.
    """
    if type(vehicle) is not KinematicBicycle:  # a subclass has the name, and may have other dynamics
        raise InputError(f"vehicle: expected a KinematicBicycle to look for its tubes, got {type(vehicle).__name__}")
    return {name: rational(float(getattr(vehicle, name))) for name in KNOWN_VEHICLES[vehicle.name].parameters}


def scaled(tube: CertifiedTube, length: fmpq, speed: fmpq) -> CertifiedTube:
    """The tube of the similar car: lengths multiplied by `length`, speeds by `speed`.

    Raises:
        InputError: for scales that are not positive.
    """
    if not (length > 0 and speed > 0):
        raise InputError("similarity: expected positive scales of length and speed")
    known = KNOWN_VEHICLES[tube.vehicle]
    acceleration = speed**2 / length
    axes = (fmpq(1), length, length, speed)

    def times(factor: fmpq, bounds: Range) -> Range:
        return bounds[0] * factor, bounds[1] * factor

    units = {"u0": fmpq(1), "w": fmpq(1), "thrust": acceleration}
    return replace(
        tube,
        parameters=known.scaled(tube.parameters, length, speed),
        curvature=times(1 / length, tube.curvature),
        speed=times(speed, tube.speed),
        acceleration=times(acceleration, tube.acceleration),
        shape=[[c / (axes[i] * axes[j]) for j, c in enumerate(row)] for i, row in enumerate(tube.shape)],
        margin=tube.margin * speed / length,
        margin_per_metre=tube.margin_per_metre / length,
        inputs={name: times(units[name], bounds) for name, bounds in tube.inputs.items()},
    )


def for_vehicle(tube: CertifiedTube, vehicle: Vehicle) -> CertifiedTube | None:
    """The tube for another car, unchanged if that can do what the proven one can, else by similarity; None if neither.

    By similarity lengths scale with the wheelbase, and speeds with the root of wheelbase times thrust.
    """
    own = parameters_of(vehicle)
    if tube.vehicle != vehicle.name:
        return None
    covers = KNOWN_VEHICLES[tube.vehicle].covers
    if not covers(own, tube.parameters):
        length = own["wheelbase"] / tube.parameters["wheelbase"]
        square = length * own["max_thrust"] / tube.parameters["max_thrust"]
        tube = scaled(tube, length, _root_below(square))
        if not covers(own, tube.parameters):
            return None
    limits = {name: own[parameter] for name, parameter in KNOWN_VEHICLES[tube.vehicle].limits.items()}
    box = {name: (-limits[name], limits[name]) if name in limits else ends for name, ends in tube.inputs.items()}
    return replace(tube, parameters=own, inputs=box)


def _root_below(value: fmpq) -> fmpq:
    """A short rational whose square is at most the value, to about seven digits."""
    return fmpq(((value.p * 4**BITS) // value.q).isqrt(), 2**BITS)
