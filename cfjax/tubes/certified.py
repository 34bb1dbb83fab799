"""A tube with a certificate, as a car that drives has it: what a path is held by, and in what order.

A tube is an invariant funnel {V(x) = xᵀ C x ≤ 1} that holds along every path whose curvature κ = ω_r/v_r, speed v_r and
acceleration dv_r/dθ stay inside its bounds. Numbers are exact, and what is chosen with them is proven by
`cfcheck.kernel.legs`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

from flint import fmpq, fmpq_mat

from cfcheck.claims.document import read_claims
from cfcheck.exact.definite import is_positive_definite
from cfcheck.exact.rational import Matrix, Range, about
from cfcheck.kernel.funnel import FunnelClaim, contraction_way, metres
from cfcheck.kernel.legs import Leg
from cfcheck.kernel.level import Contracting
from cfcheck.path.bounds import Bounds
from cfcheck.path.reference import Reference
from cfcheck.reader import Unreadable
from cfcheck.vehicle.model import STATES


class Origin(NamedTuple):
    """A tube's certificate, or the file where it lies, and by what its lengths and speeds are multiplied since.

    Nothing is proven from it: similarity carries it along for whoever writes the tube to a file.
    """

    source: str | dict
    length: fmpq = fmpq(1)
    speed: fmpq = fmpq(1)


@dataclass(frozen=True, eq=False)  # one object is one certificate: compared by identity, so that proofs can be cached
class CertifiedTube:
    """A tube with a checked certificate.

    `parameters` are the vehicle's; `bounds` those of the paths along which it holds, whose curvature may jump. `shape`
    is C in the coordinates `states`. `margin` (1/s) and `margin_per_metre` are λ and μ of V̇ ≤ −λ min(1, V/beta_lower)
    and V̇ ≤ −μ v_r min(1, V/beta_lower) for V in [beta_inner, 1]. `inputs` are intervals by name, "u0", the rate of θ,
    first: what it is proven with.

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
    def claim(self) -> FunnelClaim:
        """It as the checker has it."""
        return FunnelClaim(
            Contracting(fmpq(0)), self.shape, self.beta_lower, self.beta_inner, self.margin, self.margin_per_metre
        )

    @property
    def inverse(self) -> fmpq_mat:
        """C⁻¹: its diagonal holds the squares of the half-widths."""
        return self.claim.inverse

    def distance_to(self, level: fmpq, fastest: fmpq) -> fmpq | None:
        """Metres of reference with u0 ≤ `fastest` after which V ≤ level is proven, from anywhere in the tube.

        None where it never is.
        """
        if level < self.beta_inner:
            return None
        return metres(self.margin_per_metre, fastest) * contraction_way(self.beta_lower, level)


class TubeLeg(NamedTuple):
    """Pieces begin, …, end − 1 of a path in one tube."""

    begin: int
    end: int
    tube: CertifiedTube

    def leg(self, reference: Reference, index: int = 0) -> Leg:
        """It as the checker has it, the leg of its path with that number."""
        return Leg(reference, self.begin, self.end, self.tube.claim, index)


def timing_of(tubes: "list[CertifiedTube] | tuple[CertifiedTube, ...]") -> Range:
    """Of all tubes together: inputs are held from one into the next."""
    return min(tube.timing[0] for tube in tubes), max(tube.timing[1] for tube in tubes)


def tube_of(document: object, name: str) -> CertifiedTube:
    """The tube that a certificate claims, unproven.

    Raises:
        Unreadable: no certificate, or one of something else.
    """
    claims = read_claims(document)
    problem, funnel, model = claims.problem, claims.driven[0], claims.models[0]
    bounds = problem.course
    if not isinstance(bounds, Bounds) or funnel.margin_per_metre is None:
        raise Unreadable("expected the certificate of a tube, got one of something else")
    factors = model.input_factors(problem.vehicle)
    return CertifiedTube(
        name=name,
        vehicle=problem.vehicle.name,
        parameters=problem.vehicle.parameters,
        method=problem.method,
        bounds=bounds,
        shape=funnel.shape,
        beta_lower=funnel.beta_lower,
        beta_inner=funnel.beta_inner,
        margin=funnel.margin,
        margin_per_metre=funnel.margin_per_metre,
        inputs={label: (low * factors[label], high * factors[label]) for label, (low, high) in model.inputs.items()},
        states=problem.vehicle.states,
    )
