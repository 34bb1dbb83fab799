"""The car that a funnel is proven for, and what follows for another car that is similar to it.

Multiply lengths by L and speeds by S, so times by L/S and accelerations by S²/L: the kinematic bicycle is then the same
car again. A funnel with C, λ and μ becomes one with D⁻¹ C D⁻¹, D = diag(1, L, L, S), with λ S/L and with μ/L. Two cars
may also reach the same motion by different inputs (`KnownVehicle.factors`). The funnel of one is a funnel of the other
if the other one has the inputs that this takes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from flint import fmpq

from cfcheck.exact.rational import Range
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.law import LawClaim
from cfcheck.path.bounds import Bounds
from cfcheck.reader import Broken
from cfcheck.vehicle.model import KNOWN_VEHICLES, VehicleClaim


Inputs = Mapping[str, Range]  # a box by name, u0 first


@dataclass(frozen=True)
class Model:
    """The car that a funnel is proven for; its lengths and speeds times `length` and `speed` give the car that drives.

    `inputs` is the box with which condition (d) is proven, in the units of this car. A `law`, if there is one, chooses
    the inputs beside u0.
    """

    vehicle: VehicleClaim
    inputs: Inputs
    length: fmpq = fmpq(1)
    speed: fmpq = fmpq(1)
    law: LawClaim | None = None

    @property
    def functions(self) -> dict[int, str]:
        """Functions that nodes apply, by node; those of the law are counted on after the vehicle's."""
        since, own = len(self.vehicle.graph.nodes), self.vehicle.graph.functions()
        return own | ({since + node: name for node, name in self.law.graph.functions().items()} if self.law else {})

    @property
    def faster(self) -> fmpq:
        """How many times faster everything happens for the car that drives."""
        return self.speed / self.length

    @property
    def axes(self) -> tuple[fmpq, ...]:
        """The factors of its states: deviations of this car times these are those of the car that drives."""
        known = KNOWN_VEHICLES.get(self.vehicle.name)
        return known.axes(self.length, self.speed) if known else (fmpq(1),) * len(self.vehicle.states)

    def input_factors(self, driven: VehicleClaim) -> dict[str, fmpq]:
        """The factors of its inputs: with these the car that drives makes the same motion."""
        known = KNOWN_VEHICLES.get(self.vehicle.name)
        if known is None:
            return dict.fromkeys(self.inputs, fmpq(1))
        as_scaled = known.scaled(self.vehicle.parameters, self.length, self.speed)
        units, factors = known.units(self.length, self.speed), known.factors(driven.parameters, as_scaled)
        return {name: units[name] * factors[name] for name in self.inputs}

    def driven(self, funnel: FunnelClaim) -> FunnelClaim:
        """A funnel of this car in the units of the car that drives; a scaled one has to be invariant."""
        if self.length == self.speed == 1:
            return funnel
        axes, per_metre = self.axes, funnel.margin_per_metre
        return replace(
            funnel,
            shape=[[c / (axes[i] * axes[j]) for j, c in enumerate(row)] for i, row in enumerate(funnel.shape)],
            margin=funnel.margin * self.faster,
            margin_per_metre=None if per_metre is None else per_metre / self.length,
        )

    def as_driven(self, bounds: Bounds) -> Bounds:
        """Bounds of this car's paths in the units of the car that drives."""
        return bounds.scaled(self.length, self.speed)

    def as_proven(self, bounds: Bounds) -> Bounds:
        """Bounds of the driving car's paths in the units of this car."""
        return bounds.scaled(1 / self.length, 1 / self.speed)

    def require_similar(self, driven: VehicleClaim, inputs: Inputs) -> None:
        """Raises unless the car that drives, with these inputs, can make every motion that this one makes with its own.

        Raises:
            Broken: it cannot, or the checker does not know the vehicle.
        """
        if self.vehicle.name not in KNOWN_VEHICLES and (self.length, self.speed, self.vehicle) != (1, 1, driven):
            raise Broken(f"it is proven for another vehicle, none of {', '.join(KNOWN_VEHICLES)} by similarity")
        if self.vehicle.name != driven.name or tuple(self.inputs) != tuple(inputs):
            raise Broken("it is proven for another vehicle, or with inputs in another order")
        for name, factor in self.input_factors(driven).items():
            (lower, upper), (least, most) = self.inputs[name], inputs[name]
            if not least <= factor * lower <= factor * upper <= most:
                raise Broken(f"it is proven with more of {name} than the vehicle that drives has")
