"""The package's tubes for another car, where it can do what the proven one can or is similar to one that can."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import ROUND_CEILING

from flint import fmpq

from cfcheck.exact.rational import Range, about, decimal_text
from cfcheck.vehicle.model import KNOWN_VEHICLES
from cfjax.certificate.writing import exact_parameters
from cfjax.coerce import objects
from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle, Vehicle
from cfjax.tubes.certified import CertifiedTube


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


def scaled(tube: CertifiedTube, length: fmpq, speed: fmpq) -> CertifiedTube:
    """The tube of the similar car: lengths multiplied by `length`, speeds by `speed` (`cfcheck.kernel.funnel`).

    Raises:
        ValueError: for scales that are not positive, or a vehicle of which no similar one is known.
    """
    if not (length > 0 and speed > 0):
        raise ValueError("similarity: expected positive scales of length and speed")
    if length == speed == 1:
        return tube
    if tube.vehicle not in KNOWN_VEHICLES:
        raise ValueError(f"similarity: expected scales of 1 for a vehicle that is none of {', '.join(KNOWN_VEHICLES)}")
    known = KNOWN_VEHICLES[tube.vehicle]
    axes, origin = known.axes(length, speed), tube.origin
    return replace(
        tube,
        parameters=known.scaled(tube.parameters, length, speed),
        bounds=tube.bounds.scaled(length, speed),
        shape=[[c / (axes[i] * axes[j]) for j, c in enumerate(row)] for i, row in enumerate(tube.shape)],
        margin=tube.margin * speed / length,
        margin_per_metre=tube.margin_per_metre / length,
        inputs=_times(known.units(length, speed), tube.inputs),
        origin=None if origin is None else origin._replace(length=origin.length * length, speed=origin.speed * speed),
    )


def served(tube: CertifiedTube, own: Mapping[str, fmpq]) -> CertifiedTube | None:
    """The tube for a car of the same kind with these parameters; None unless that can do what the proven one does."""
    known = KNOWN_VEHICLES.get(tube.vehicle)
    if known is None:
        return tube if dict(own) == dict(tube.parameters) else None
    inputs = _times(known.factors(own, tube.parameters), tube.inputs)
    if any(max(map(abs, inputs[name])) > own[label] for name, label in known.limits.items()):
        return None
    return replace(tube, parameters=own, inputs=inputs)


def _times(factors: Mapping[str, fmpq], inputs: Mapping[str, Range]) -> dict[str, Range]:
    return {name: (lower * factors[name], upper * factors[name]) for name, (lower, upper) in inputs.items()}


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
    for version in (version for tube in tubes for version in (tube, _similar(tube, own))):
        inputs = _times(known.factors(own, version.parameters), version.inputs)
        least = {label: max(map(abs, inputs[name])) for name, label in known.limits.items()}
        needed.append({label: value for label, value in least.items() if value > own[label]})
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
