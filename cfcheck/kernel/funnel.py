"""A funnel as a file claims it, and how far V falls along a path.

A funnel is V of a template (`cfcheck.kernel.level`) with margins. λ (1/s) says V̇ ≤ −λ min(1, V/β̲) on β_in ≤ V ≤ 1. One
that does not change with θ holds wherever its bounds do, along any path, and has a margin μ for each metre too:
V̇ ≤ −μ v_r min(1, V/β̲). The reference moves by ds = u0 v_r dt with u0 ≤ u0_hi. The run-time law has to enforce 0.95 of
the certified decrease, so dV/ds ≤ −(0.95 μ/u0_hi) min(1, V/β̲). This is integrated here.
"""

from dataclasses import dataclass
from functools import cached_property

from flint import fmpq, fmpq_mat

from cfcheck.exact.definite import exact_matrix
from cfcheck.exact.rational import Matrix, exp_bounds
from cfcheck.kernel.level import Level


LAW_SHARE = fmpq(19, 20)  # of the certified decrease, which the run-time law (`cfjax.control`) enforces
STEEPEST_EXPONENT = fmpq(64)  # all levels below e^−64 count as e^−64


@dataclass(frozen=True)
class FunnelClaim:
    """V of a template, β = 1, with the claimed margins λ (1/s) and, if it holds along any path, μ (1/m)."""

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

        It is 1 if no margin per metre is claimed.
        """
        if self.margin_per_metre is None:
            return fmpq(1)
        return fallen_level(distance / metres(self.margin_per_metre, fastest), self.beta_lower, self.beta_inner)


def metres(margin_per_metre: fmpq, fastest: fmpq) -> fmpq:
    """u0_hi/(0.95 μ): metres of reference in which the law lowers V by one, as long as it is above β̲."""
    return fastest / (LAW_SHARE * margin_per_metre)


def fallen_level(fallen: fmpq, beta_lower: fmpq, beta_inner: fmpq) -> fmpq:
    """The level to which V comes down from 1 where it falls by min(1, V/β̲) in each unit of `fallen`; β_in at least."""
    if 1 - fallen >= beta_lower:
        return max(1 - fallen, beta_inner)
    exponent = min((fallen - (1 - beta_lower)) / beta_lower, STEEPEST_EXPONENT)
    return max(beta_lower * exp_bounds(-exponent)[1], beta_inner)
