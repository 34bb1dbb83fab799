"""The package's tubes for another car, where it can do what the proven one can or is similar to one that can."""

from collections.abc import Mapping, Sequence
from decimal import ROUND_CEILING

from flint import fmpq

from cfjax.certificate.writing import exact_parameters
from cfjax.check.certified import CertifiedTube
from cfjax.check.rational import about, decimal_text
from cfjax.check.similarity import scaled, served
from cfjax.check.vehicle import KNOWN_VEHICLES
from cfjax.coerce import objects
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
    objects(tube=(tube, CertifiedTube), vehicle=(vehicle, Vehicle))
    own = parameters_of(vehicle)
    if tube.vehicle != vehicle.name:
        return None
    if found := served(tube, own):
        return found
    return served(_similar(tube, own), own)


def _similar(tube: CertifiedTube, own: Mapping[str, fmpq]) -> CertifiedTube:
    """The tube of the similar car that has the own one's wheelbase, and its thrust as nearly as can be."""
    length = own["wheelbase"] / tube.parameters["wheelbase"]
    square = length * own["max_thrust"] / tube.parameters["max_thrust"]
    return scaled(tube, length, _root_below(square))


def why_none(tubes: Sequence[CertifiedTube], vehicle: Vehicle) -> str:
    """The limit for which no tube is one for the vehicle (`for_vehicle`): what is expected, and what it has."""
    own, kinds = parameters_of(vehicle), sorted({tube.vehicle for tube in tubes})
    known = KNOWN_VEHICLES.get(vehicle.name)
    if vehicle.name not in kinds or known is None:
        return f"vehicle: expected one with tubes ({', '.join(kinds) or 'none'}), got {vehicle.name}"
    needed = []  # each time the limits that are too small, by parameter, and what they would have to be
    for proven in (version.parameters for tube in tubes for version in (tube, _similar(tube, own))):
        reach = known.reach(own, proven)
        factors = {label: proven[label] / reach[name] for name, label in known.limits.items()}
        needed.append({label: own[label] * factor for label, factor in factors.items() if factor > 1})
    least = min(needed, key=lambda limits: max(value / own[label] for label, value in limits.items()))
    rest = ", ".join(f"{label} {about(value)}" for label, value in own.items() if label not in least)
    expected = " and ".join(
        f"{label} of at least {decimal_text(value, ROUND_CEILING)}" for label, value in least.items()
    )
    got = ", ".join(about(own[label]) for label in least)
    return f"vehicle: expected a {expected} beside {rest}, for the tubes are proven with such limits, got {got}"


def _root_below(value: fmpq) -> fmpq:
    """A short rational whose square is at most the value, to about seven digits."""
    return fmpq(((value.p * 4**BITS) // value.q).isqrt(), 2**BITS)
