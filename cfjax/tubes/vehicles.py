"""The package's tubes for another car, where it can do what the proven one can or is similar to one that can."""

from flint import fmpq

from cfjax.certificate.writing import exact_parameters
from cfjax.check.certified import CertifiedTube
from cfjax.check.similarity import scaled, served
from cfjax.check.vehicle import KNOWN_VEHICLES
from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle, Vehicle


BITS = 24  # of the speed scale: a square root, rounded down


def parameters_of(vehicle: Vehicle) -> dict[str, fmpq]:
    """The vehicle's parameters in exact numbers, as a certificate has them.

    Raises:
        InputError: for a vehicle that the checker knows by name, but that may be another one: its tubes cannot be told
            from that one's.
    """
    if type(vehicle) is not KinematicBicycle and vehicle.name in KNOWN_VEHICLES:
        raise InputError(f"vehicle: expected a KinematicBicycle to look for its tubes, got {type(vehicle).__name__}")
    return exact_parameters(vehicle)


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
