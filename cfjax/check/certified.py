"""A tube with a checked certificate, and what it says of a car along its reference: how fast the level V falls.

A tube is an ellipsoid {V(x) = xᵀ C x ≤ 1} of deviations that holds along every path whose curvature κ = ω_r/v_r, speed
v_r and acceleration dv_r/dθ stay inside its bounds: V̇ ≤ −μ v_r min(1, V/β̲) for V in [β_in, 1], so that {V ≤ β_in}
holds too. The reference moves by ds = u0 v_r dt with u0 ≤ u0_hi, and the run-time law asks for 0.95 of the certified
decrease: dV/ds ≤ −(0.95 μ/u0_hi) min(1, V/β̲), which is integrated.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

from flint import arb, fmpq, fmpq_mat

from cfjax.check.bounds import Bounds, Range
from cfjax.check.program import Matrix
from cfjax.check.rational import about, exp_bounds, is_positive_definite, upper_bound
from cfjax.check.vehicle import STATES


LAW_SHARE = fmpq(19, 20)  # of the certified decrease: what the run-time law (`cfjax.control`) asks for
STEEPEST_EXPONENT = fmpq(64)  # levels below e^−64 are not told apart


class Origin(NamedTuple):
    """A tube's certificate, or the file where it lies, and by what its lengths and speeds are multiplied since.

    Nothing is proven from it: similarity carries it along for whoever writes the tube to a file.
    """

    source: str | dict
    length: fmpq = fmpq(1)
    speed: fmpq = fmpq(1)


@dataclass(frozen=True, eq=False)  # one object is one certificate: compared by identity, so that proofs can be cached
class CertifiedTube:
    """A tube with a checked certificate: the numbers that chains are proven from.

    `parameters` are the vehicle's; `bounds` those of the paths along which it holds, whose curvature may jump. `shape`
    is C in the coordinates `states`. `margin` (1/s) and `margin_per_metre` are λ and μ of V̇ ≤ −λ min(1, V/beta_lower)
    and V̇ ≤ −μ v_r min(1, V/beta_lower) for V in [beta_inner, 1]. `inputs` are intervals by name, "u0", the rate of θ,
    first.

    Raises:
        ValueError: for numbers that are none of a tube. That the certificate is true is not asked here.
    """

    name: str
    vehicle: str
    parameters: Mapping[str, fmpq]
    method: str
    bounds: Bounds
    shape: Matrix
    beta_lower: fmpq
    beta_inner: fmpq
    margin: fmpq
    margin_per_metre: fmpq
    inputs: Mapping[str, Range]
    origin: Origin | None = None
    states: tuple[str, ...] = STATES

    def __post_init__(self) -> None:
        for label, (lower, upper) in self.bounds.intervals.items():
            if not lower <= upper:
                raise ValueError(f"tube {self.name}: expected an interval of {label}, lower end first")
        if self.bounds.curvature_rate is not None:  # of pieces, not of joints, could anybody say that they keep it
            raise ValueError(f"tube {self.name}: expected a curvature that may jump, got bounds of its rate")
        if not self.bounds.speed[0] > 0:
            raise ValueError(f"tube {self.name}: expected speeds above zero, got {about(self.bounds.speed[0])}")
        if len(self.shape) != len(self.states) or not is_positive_definite(self.shape):
            raise ValueError(f"tube {self.name}: expected a positive definite C in {', '.join(self.states)}")
        if not 0 < self.beta_inner <= self.beta_lower <= 1 or not self.margin_per_metre > 0:
            raise ValueError(f"tube {self.name}: expected 0 < beta_inner <= beta_lower <= 1 and a positive margin")
        if next(iter(self.inputs), None) != "u0" or not 0 < self.inputs["u0"][0] <= self.inputs["u0"][1]:
            raise ValueError(f"tube {self.name}: expected u0 as first input, in an interval above zero")
        # proofs are cached by the object: nobody may change its numbers afterwards
        object.__setattr__(self, "shape", tuple(tuple(row) for row in self.shape))
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))
        object.__setattr__(self, "inputs", MappingProxyType(dict(self.inputs)))

    @property
    def timing(self) -> Range:
        """The interval of u0, the rate of θ along the clock."""
        return self.inputs["u0"]

    @cached_property
    def inverse(self) -> fmpq_mat:
        """C⁻¹: its diagonal holds the squares of the half-widths."""
        return fmpq_mat([list(row) for row in self.shape]).inv()

    @cached_property
    def metres(self) -> fmpq:
        """u0_hi/(0.95 μ): metres of reference in which the law lowers V by one, as long as it is above beta_lower."""
        return self.timing[1] / (LAW_SHARE * self.margin_per_metre)

    def level_after(self, distance: fmpq) -> fmpq:
        """A rational that V is at most after so many metres of reference, from anywhere in the tube."""
        fallen = distance / self.metres
        if 1 - fallen >= self.beta_lower:
            return max(1 - fallen, self.beta_inner)
        exponent = min((fallen - (1 - self.beta_lower)) / self.beta_lower, STEEPEST_EXPONENT)
        return max(self.beta_lower * exp_bounds(-exponent)[1], self.beta_inner)

    def distance_to(self, level: fmpq) -> fmpq | None:
        """Metres of reference after which V ≤ level is proven, from anywhere in the tube; None where it never is."""
        if level < self.beta_inner:
            return None
        if level >= self.beta_lower:
            return self.metres * max(1 - level, fmpq(0))
        logarithm = upper_bound(arb(self.beta_lower / level).log())
        return self.metres * (1 - self.beta_lower + self.beta_lower * logarithm)
