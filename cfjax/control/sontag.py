"""Universal formulas: smooth laws that know a bound on the inputs only roughly, or not at all.

In inputs counted from the feed-forward in units of the room that they have, w = (v − v^r)/room, V̇ = a + b · w.

- **Sontag's** (E. D. Sontag, Systems & Control Letters 13, 1989), the paper's: w = −b (a + √(a² + |b|⁴))/|b|², so that
  V̇ = −√(a² + |b|⁴) if w could be applied. It knows no bound: what leaves the box is clipped, and where something is
  clipped nothing is promised.
- **Lin and Sontag's** (Systems & Control Letters 16, 1991), for |w| < 1: the same divided by 1 + √(1 + |b|²).
  V decreases wherever some w of the unit ball does it: an ellipsoid about the feed-forward whose half-axes are the room
  left in the box, which is less than the box of condition (d).

Neither inherits the certificate: that speaks of the vertices of the box. They ask for no margin either.
"""

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp

from cfjax.control.law import Descent, Law
from cfjax.problem.vehicle import Scalar


@dataclass(frozen=True)
class Sontag(Law):
    """Sontag's formula, clipped to the box: the law of the paper, for path following and trajectory tracking."""

    name: ClassVar[str] = "sontag"
    inherits: ClassVar[bool] = False

    def choose(self, descent: Descent) -> tuple[Scalar, ...]:
        half = descent.half
        b = [slope * room for slope, room in zip(descent.slopes, half, strict=True)]
        size = sum(entry**2 for entry in b)
        return _moved(descent, b, half, _gain(descent.rate, size))


@dataclass(frozen=True)
class LinSontag(Law):
    """The formula of Lin and Sontag for inputs in a ball: the ellipsoid about the feed-forward that the box holds."""

    name: ClassVar[str] = "lin_sontag"
    inherits: ClassVar[bool] = False

    def choose(self, descent: Descent) -> tuple[Scalar, ...]:
        room = [
            jnp.minimum(descent.upper[i] - centre, centre - descent.lower[i]) for i, centre in enumerate(descent.centre)
        ]
        b = [slope * own for slope, own in zip(descent.slopes, room, strict=True)]
        size = sum(entry**2 for entry in b)
        return _moved(descent, b, room, _gain(descent.rate, size) / (1 + jnp.sqrt(1 + size)))


def _gain(a: Scalar, size: Scalar) -> Scalar:
    """(a + √(a² + |b|⁴))/|b|² with |b|² = `size`; 0 where b vanishes. Without cancellation where a < 0."""
    root = jnp.sqrt(a**2 + size**2)
    positive = (a + root) / jnp.where(size > 0, size, 1.0)
    negative = size / jnp.where(root - a > 0, root - a, 1.0)
    return jnp.where(size > 0, jnp.where(a > 0, positive, negative), 0.0)


def _moved(descent: Descent, b: list[Scalar], room: list[Scalar], gain: Scalar) -> tuple[Scalar, ...]:
    return tuple(
        jnp.clip(centre - gain * b[i] * room[i], descent.lower[i], descent.upper[i])
        for i, centre in enumerate(descent.centre)
    )
