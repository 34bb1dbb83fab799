"""Stanley and pure pursuit as laws of a question: of cars that are steered by w, the tangent of the steering angle.

Both steer by geometry and keep no time: they look at the place of the path beside the car, wherever θ is. So the timing
has to be free (path following). On a path of curvature κ through the reference a point (px, py) of the reference's
frame lies beside the place that is turned by φ from it, and e to the right of it:

    a = 1 + κ px,  b = κ py,  ρ = √(a² + b²):     cos φ = a/ρ,  sin φ = b/ρ,  e = (ρ − 1)/κ

(on a straight line φ = 0 and e = px). `cfjax.baselines` has the same laws on any path, found by Newton's method.
"""

import abc
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import jax.numpy as jnp

from cfjax import coerce
from cfjax.coerce import Number
from cfjax.errors import InputError
from cfjax.problem.deviation import ReferencePoint
from cfjax.problem.feedback import FeedbackLaw, LawContext
from cfjax.problem.vehicle import Scalar, Vehicle


STEERED = ("w",), ("w", "thrust")  # inputs of the cars that these laws steer


@dataclass(frozen=True)
class GeometricLaw(FeedbackLaw):
    """What both share: thrust is proportional to the speed's deviation.

    Args:
        speed_gain: thrust for each m/s that the car is too fast, 1/s; of a car with a thrust.
        curvature: κ of the path, 1/m; None: taken from the problem.
    """

    speed_gain: float = 2.0
    curvature: float | None = None

    keeps_time: ClassVar[bool] = False

    def __init__(self, speed_gain: Number = 2.0, curvature: Number | None = None) -> None:
        bend = None if curvature is None else coerce.number("law.curvature", curvature, "1/m")
        coerce.keep(self, speed_gain=coerce.number("law.speed_gain", speed_gain, "1/s", least=0), curvature=bend)

    def fitted(self, context: LawContext) -> "GeometricLaw":
        if context.vehicle.input_names not in STEERED or not hasattr(context.vehicle, "wheelbase"):
            raise InputError(f"law={self.name}: expected a car with a wheelbase that is steered by w, got others")
        if context.reference is None:
            raise InputError(f"law={self.name}: expected a path that is one straight line or one circle")
        return replace(self, curvature=float(context.reference.turn_rate / context.reference.speed))

    def inputs(self, vehicle: Vehicle, x: Sequence[Scalar], reference: ReferencePoint) -> tuple[Scalar, ...]:
        alpha, px, py, *internal = x
        speed = reference.speed + internal[0] if internal else reference.speed
        wheelbase: Any = getattr(vehicle, "wheelbase", None)
        w = self.steering((jnp.cos(alpha), jnp.sin(alpha)), (px, py), speed, wheelbase)
        return (w, *(-self.speed_gain * v for v in internal))

    @abc.abstractmethod
    def steering(
        self, heading: tuple[Scalar, Scalar], place: tuple[Scalar, Scalar], speed: Scalar, wheelbase: float
    ) -> Scalar:
        """w, left positive; `heading` is the cosine and the sine of the heading's deviation, lengths are in m."""

    def _beside(self, px: Scalar, py: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """a, b and ρ; of a straight line 1, 0, 1."""
        if not self.curvature:
            return 1.0, 0.0, 1.0
        a, b = 1 + self.curvature * px, self.curvature * py
        return a, b, jnp.sqrt(a * a + b * b)


@dataclass(frozen=True)
class StanleyLaw(GeometricLaw):
    """tan of −(heading error) + atan(k e/(k_s + v)), both at the front axle (Hoffmann et al., ACC 2007, kinematic).

    With Δ the heading error it is (k e cos Δ − (k_s + v) sin Δ)/((k_s + v) cos Δ + k e sin Δ), as long as the steering
    angle is less than 90 degrees: where the denominator is positive.

    Args:
        gain: k, 1/s.
        softening: k_s, m/s.
    """

    gain: float = 2.0
    softening: float = 0.3

    name: ClassVar[str] = "stanley"

    def __init__(
        self,
        speed_gain: Number = 2.0,
        curvature: Number | None = None,
        gain: Number = 2.0,
        softening: Number = 0.3,
    ) -> None:
        super().__init__(speed_gain, curvature)
        gain = coerce.number("law.gain", gain, "1/s")
        coerce.keep(self, gain=gain, softening=coerce.number("law.softening", softening, "m/s"))

    def steering(
        self, heading: tuple[Scalar, Scalar], place: tuple[Scalar, Scalar], speed: Scalar, wheelbase: float
    ) -> Scalar:
        (c, s), (px, py) = heading, place
        px, py = px - wheelbase * s, py + wheelbase * c  # of the front axle
        a, b, rho = self._beside(px, py)
        e = (rho - 1) / self.curvature if self.curvature else px
        along, across = c * a + s * b, s * a - c * b  # cos Δ and sin Δ, times ρ
        soft = self.softening + speed
        return (self.gain * e * along - soft * across) / (soft * along + self.gain * e * across)


@dataclass(frozen=True)
class PurePursuitLaw(GeometricLaw):
    """The arc to a point of the path ahead, 2 l sin η/d (Coulter 1992): `look_ahead` seconds of the car's speed away.

    Args:
        look_ahead: s.
    """

    look_ahead: float = 0.45

    name: ClassVar[str] = "pure_pursuit"

    def __init__(self, speed_gain: Number = 2.0, curvature: Number | None = None, look_ahead: Number = 0.45) -> None:
        super().__init__(speed_gain, curvature)
        coerce.keep(self, look_ahead=coerce.number("law.look_ahead", look_ahead, "s", above=0))

    def steering(
        self, heading: tuple[Scalar, Scalar], place: tuple[Scalar, Scalar], speed: Scalar, wheelbase: float
    ) -> Scalar:
        (c, s), (px, py) = heading, place
        length = self.look_ahead * speed
        if self.curvature:
            a, b, rho = self._beside(px, py)
            turned = self.curvature * length
            cosine, sine = jnp.cos(turned), jnp.sin(turned)
            tx = ((a * cosine - b * sine) / rho - 1) / self.curvature - px
            ty = (b * cosine + a * sine) / rho / self.curvature - py
        else:
            tx, ty = -px, length
        return 2 * wheelbase * (-c * tx - s * ty) / (tx * tx + ty * ty)
