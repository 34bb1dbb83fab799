"""The package's tubes for another car, where it can do what the proven one can or is similar to one that can."""

from flint import fmpq

from cfjax.check.certified import CertifiedTube
from cfjax.check.rational import rational
from cfjax.check.similarity import scaled, served
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


def for_vehicle(tube: CertifiedTube, vehicle: Vehicle) -> CertifiedTube | None:
    """The tube for another car, unchanged if that can do what the proven one can, else by similarity; None if neither.

    By similarity lengths scale with the wheelbase, and speeds with the root of wheelbase times thrust.
    """
    own = parameters_of(vehicle)
    if tube.vehicle != vehicle.name:
        return None
    if found := served(tube, own):
        return found
    length = own["wheelbase"] / tube.parameters["wheelbase"]
    square = length * own["max_thrust"] / tube.parameters["max_thrust"]
    return served(scaled(tube, length, _root_below(square)), own)


def _root_below(value: fmpq) -> fmpq:
    """A short rational whose square is at most the value, to about seven digits."""
    return fmpq(((value.p * 4**BITS) // value.q).isqrt(), 2**BITS)
