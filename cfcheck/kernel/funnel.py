"""A funnel as a file claims it, and the car that it is proven for; by similarity a funnel of other cars too.

A funnel is V of a template (`cfcheck.kernel.level`) with margins. λ (1/s) says V̇ ≤ −λ min(1, V/β̲) on β_in ≤ V ≤ 1. One
that does not change with θ holds wherever its bounds do, along any path, and has a margin μ for each metre too:
V̇ ≤ −μ v_r min(1, V/β̲). The reference moves by ds = u0 v_r dt with u0 ≤ u0_hi, and the run-time law is supposed to
enforce 0.95 of what is certified: dV/ds ≤ −(0.95 μ/u0_hi) min(1, V/β̲), which is integrated.

With lengths multiplied by L and speeds by S (so times by L/S, accelerations by S²/L) the kinematic bicycle is the same
car again: a funnel with C, λ and μ becomes D⁻¹ C D⁻¹ with D = diag(1, L, L, S), λ S/L and μ/L. And what one car does
with its inputs, another one does with its own (`KnownVehicle.factors`): it has the funnel where it has these inputs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from flint import arb, fmpq, fmpq_mat

from cfcheck.exact.definite import exact_matrix
from cfcheck.exact.rational import Matrix, Range, exp_bounds, upper_bound
from cfcheck.kernel.law import LawClaim
from cfcheck.kernel.level import Level
from cfcheck.path.bounds import Bounds
from cfcheck.reader import Broken
from cfcheck.vehicle.model import KNOWN_VEHICLES, VehicleClaim


LAW_SHARE = fmpq(19, 20)  # of the certified decrease: what the run-time law (`cfjax.control`) asks for
STEEPEST_EXPONENT = fmpq(64)  # all levels below e^−64 count as e^−64
Inputs = Mapping[str, Range]  # a box by name, u0 first


@dataclass(frozen=True)
class FunnelClaim:
    """V of a template, β = 1, with the margins λ (1/s) and, if it holds along any path, μ (1/m) that are claimed."""

    level: Level
    shape: Matrix
    beta_lower: fmpq
    beta_inner: fmpq
    margin: fmpq
    margin_per_metre: fmpq | None

    @cached_property
    def inverse(self) -> fmpq_mat:
        """C⁻¹: its diagonal holds the squares of the half-widths."""
        return exact_matrix(self.shape).inv()

    def level_after(self, distance: fmpq, fastest: fmpq) -> fmpq:
        """A rational that V is at most after so many metres of reference with u0 ≤ `fastest`, from V ≤ 1.

        1 where no margin per metre is claimed.
        """
        if self.margin_per_metre is None:
            return fmpq(1)
        return fallen_level(distance / metres(self.margin_per_metre, fastest), self.beta_lower, self.beta_inner)


def metres(margin_per_metre: fmpq, fastest: fmpq) -> fmpq:
    """u0_hi/(0.95 μ): metres of reference in which the law lowers V by one, as long as it is above β̲."""
    return fastest / (LAW_SHARE * margin_per_metre)


def contraction_way(beta_lower: fmpq, level: fmpq) -> fmpq:
    """A rational that is at least ∫ dV / min(1, V/β̲) from the level to 1: 1 − β̲ + β̲ ln(β̲/level) below β̲."""
    if level >= beta_lower:
        return max(1 - level, fmpq(0))
    return 1 - beta_lower + beta_lower * upper_bound(arb(beta_lower / level).log())


def fallen_level(fallen: fmpq, beta_lower: fmpq, beta_inner: fmpq) -> fmpq:
    """The level to which V comes down from 1 where it falls by min(1, V/β̲) in each unit of `fallen`; β_in at least."""
    if 1 - fallen >= beta_lower:
        return max(1 - fallen, beta_inner)
    exponent = min((fallen - (1 - beta_lower)) / beta_lower, STEEPEST_EXPONENT)
    return max(beta_lower * exp_bounds(-exponent)[1], beta_inner)


@dataclass(frozen=True)
class Model:
    """The car that a funnel is proven for, and by what its lengths and speeds are multiplied to be the one that drives.

    `inputs` is the box with which condition (d) is proven, in the units of this car; a `law`, where there is one, gives
    them.
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
        """So many times as fast things happen for the car that drives."""
        return self.speed / self.length

    @property
    def axes(self) -> tuple[fmpq, ...]:
        """By what its states are multiplied."""
        known = KNOWN_VEHICLES.get(self.vehicle.name)
        return known.axes(self.length, self.speed) if known else (fmpq(1),) * len(self.vehicle.states)

    def input_factors(self, driven: VehicleClaim) -> dict[str, fmpq]:
        """By what its inputs are multiplied where the car that drives does the same."""
        known = KNOWN_VEHICLES.get(self.vehicle.name)
        if known is None:
            return dict.fromkeys(self.inputs, fmpq(1))
        as_scaled = known.scaled(self.vehicle.parameters, self.length, self.speed)
        units, factors = known.units(self.length, self.speed), known.factors(driven.parameters, as_scaled)
        return {name: units[name] * factors[name] for name in self.inputs}

    def driven(self, funnel: FunnelClaim) -> FunnelClaim:
        """A funnel that is proven for this car as the one that drives has it; of a scaled car an invariant one."""
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
        """Bounds of this car's paths as the one that drives has them."""
        return bounds.scaled(self.length, self.speed)

    def as_proven(self, bounds: Bounds) -> Bounds:
        """The other way round."""
        return bounds.scaled(1 / self.length, 1 / self.speed)

    def require_similar(self, driven: VehicleClaim, inputs: Inputs) -> None:
        """That the car that drives, with these inputs, can do whatever this one does with its own.

        Raises:
            Broken: it cannot, or nobody knows.
        """
        if self.vehicle.name not in KNOWN_VEHICLES and (self.length, self.speed, self.vehicle) != (1, 1, driven):
            raise Broken(f"it is proven for another vehicle, none of {', '.join(KNOWN_VEHICLES)} by similarity")
        if self.vehicle.name != driven.name or tuple(self.inputs) != tuple(inputs):
            raise Broken("it is proven for another vehicle, or with inputs in another order")
        for name, factor in self.input_factors(driven).items():
            (lower, upper), (least, most) = self.inputs[name], inputs[name]
            if not least <= factor * lower <= factor * upper <= most:
                raise Broken(f"it is proven with more of {name} than the vehicle that drives has")
