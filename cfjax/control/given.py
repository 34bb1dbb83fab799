"""The law that is part of a problem, as a car runs it: its own inputs, limited; and beside it the timing.

u0 is what the min-norm law takes where the vehicle's inputs are those of the law: the least deviation from 1 that
decreases V as asked. Where condition (d) is proven for the law there is one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp

from cfjax.control.law import Descent, Law, LawNumbers, descent_at
from cfjax.control.min_norm import MinNorm
from cfjax.errors import InputError
from cfjax.funnel import Template
from cfjax.problem import ReferencePoint, Vehicle
from cfjax.problem.vehicle import Scalar


@dataclass(frozen=True)
class Given(Law):
    """For a vehicle that has a law (`Problem.driven`)."""

    name: ClassVar[str] = "given"
    inherits: ClassVar[bool] = True

    def choose(self, descent: Descent) -> tuple[Scalar, ...]:
        return MinNorm().choose(descent)

    def __call__(
        self,
        vehicle: Vehicle,
        template: Template,
        numbers: LawNumbers,
        reference: ReferencePoint,
        theta: Scalar,
        x: Sequence[Scalar],
    ) -> tuple[Scalar, ...]:
        """As of every law.

        Raises:
            InputError: for a vehicle without a law.
        """
        own = vehicle.feedback(x, reference)
        if own is None:
            raise InputError(f"law: expected a problem with a law, got the vehicle {vehicle.name} alone")
        descent = descent_at(vehicle, template, numbers, reference, theta, x)
        inputs = [jnp.clip(k, numbers.lower[i], numbers.upper[i]) for i, k in enumerate(own, 1)]
        moved = zip(descent.slopes[1:], inputs, descent.centre[1:], strict=True)
        shift = sum(slope * (u - rest) for slope, u, rest in moved)
        return self.choose(
            descent._replace(
                rate=descent.rate + shift,
                excess=descent.excess + shift,
                centre=(descent.centre[0], *inputs),
                lower=(descent.lower[0], *inputs),
                upper=(descent.upper[0], *inputs),
            )
        )
