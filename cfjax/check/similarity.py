"""Tubes for other cars: by what a car can do, and by similarity. Both are exact.

A car that can do whatever the proven one can is held by the proven one's tube. And with lengths multiplied by L, speeds
by S (so times by L/S, accelerations by S²/L) the kinematic bicycle is the same car again: a tube with C, λ and μ
becomes D⁻¹ C D⁻¹ with D = diag(1, L, L, S), λ S/L and μ/L.
"""

from collections.abc import Mapping
from dataclasses import replace

from flint import fmpq

from cfjax.check.bounds import Range
from cfjax.check.certified import CertifiedTube
from cfjax.check.vehicle import KNOWN_VEHICLES


def scaled(tube: CertifiedTube, length: fmpq, speed: fmpq) -> CertifiedTube:
    """The tube of the similar car: lengths multiplied by `length`, speeds by `speed`.

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
    axes, units = known.axes(length, speed), known.units(length, speed)

    def times(factor: fmpq, limits: Range) -> Range:
        return limits[0] * factor, limits[1] * factor

    origin = tube.origin
    return replace(
        tube,
        parameters=known.scaled(tube.parameters, length, speed),
        bounds=tube.bounds.scaled(length, speed),
        shape=[[c / (axes[i] * axes[j]) for j, c in enumerate(row)] for i, row in enumerate(tube.shape)],
        margin=tube.margin * speed / length,
        margin_per_metre=tube.margin_per_metre / length,
        inputs={name: times(units[name], limits) for name, limits in tube.inputs.items()},
        origin=None if origin is None else origin._replace(length=origin.length * length, speed=origin.speed * speed),
    )


def served(tube: CertifiedTube, own: Mapping[str, fmpq]) -> CertifiedTube | None:
    """The tube for a car of the same kind with these parameters; None unless that can do what the proven one can."""
    known = KNOWN_VEHICLES.get(tube.vehicle)
    if known is None:
        return tube if dict(own) == dict(tube.parameters) else None
    if not known.covers(own, tube.parameters):
        return None
    limits = {name: own[parameter] for name, parameter in known.limits.items()}
    box = {name: (-limits[name], limits[name]) if name in limits else ends for name, ends in tube.inputs.items()}
    return replace(tube, parameters=own, inputs=box)
