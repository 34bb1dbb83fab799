"""What a law is: inputs as a pure function of (θ, x) beside a reference point.

All laws look at the same thing, V̇ as an affine function of the inputs and the decrease that is asked (`Descent`), and
differ in the input that they take. A law **inherits** the certificate if V̇ ≤ −λ' holds under it wherever some input of
the box reaches V̇ ≤ −λ: then every V ≤ 1 stays, and what is proven of the funnel holds for the car.

The reference enters as a point, given at run time: on a steady segment it is always the same one; in a tube it is what
the path ahead does, and a law needs nothing else of the path. A tube's certificate says more than that some input is
good at each point of its references, and so there are two kinds of demand:

- **curvature known**: the decrease is asked at the curvature given. Some input of the certificate is good enough for
  every curvature at once, so there is one for this.
- **any curvature**: the decrease is asked at the end of the tube's curvatures that is worst for V at this deviation.
  V̇ is affine in κ at fixed inputs, so it then holds for every curvature of the interval: also for one that is not
  known, and for one that jumps while inputs are held. The curvature given only serves the feed-forward. The same can
  be asked of the acceleration, which enters alike: then the law needs no more than the speed (`any_path_numbers`).
"""

import abc
from collections.abc import Sequence
from functools import reduce
from itertools import product
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.coerce import number, objects, optional
from cfjax.funnel import Funnel, Leg, Template
from cfjax.funnel.funnel import require_fit
from cfjax.problem import Interval, Problem, ReferencePoint, Vehicle, deviation_rate, feedforward
from cfjax.problem.deviation import scalars
from cfjax.problem.input_box import InputBox
from cfjax.problem.vehicle import Scalar


LAW_SHARE = 0.95  # λ'/λ: strictly below 1, for at λ itself the min-norm law may jump


class LawNumbers(NamedTuple):
    """The numbers of a law in one funnel, as a pytree; `vehicle` and `template` are given beside it.

    `curvature` is None where the decrease is asked at the reference's own, else the two ends (1/m) of an interval for
    all of which it is asked; they may be arrays, one entry per sample. So is `acceleration` (dv_r/dθ, m/s²).
    """

    lower: Float[Array | np.ndarray, " m"]  # of the input box (u0, *vehicle inputs)
    upper: Float[Array | np.ndarray, " m"]
    shape: Float[Array | np.ndarray, "n n"]  # C
    rate: Scalar
    beta_lower: Scalar
    beta_inner: Scalar  # the demand yields to the box only below this level
    decrease: Scalar  # λ', 1/s
    decrease_per_metre: Scalar  # 1/m of the reference's way; the larger of the two demands counts
    curvature: tuple[Scalar, Scalar] | None
    acceleration: tuple[Scalar, Scalar] | None = None


def any_path_numbers(problem: Problem, funnel: Funnel, margin: float, margin_per_metre: float) -> LawNumbers:
    """What is asked of a law that knows only the speed of a path in the problem's tube, margins as in `law_numbers`.

    The decrease holds for every curvature and acceleration of the tube, however they change while inputs are held: it
    is what a tube's proven control period speaks of.
    """
    objects(problem=(problem, Problem))
    bounds = problem.path.require_tube()
    return law_numbers(problem, funnel, margin, margin_per_metre, bounds.curvature, bounds.acceleration)


def leg_numbers(problem: Problem, leg: Leg) -> LawNumbers:
    """What is asked of a law along one leg of a path, as `law_numbers` has it.

    In a tube for every curvature and acceleration of the path there, at once: they may jump while inputs are held.
    """
    objects(leg=(leg, Leg))
    bounds = (leg.along.curvature, leg.along.acceleration) if leg.along else ()
    return law_numbers(problem, leg.funnel, leg.margin, leg.margin_per_metre, *bounds)


def law_numbers(
    problem: Problem,
    funnel: Funnel,
    margin: float,
    margin_per_metre: float = 0.0,
    curvature: Interval | None = None,
    acceleration: Interval | None = None,
) -> LawNumbers:
    """What is asked of a law: V̇ ≤ −0.95 λ for the (certified) margin λ in 1/s.

    On a tube V̇ ≤ −0.95 max(λ, μ v_r) min(1, V/β̲) on β_in ≤ V ≤ 1, with `margin_per_metre` μ in 1/m as certified: for
    every reference point within the bounds, for between the ends of the speed V̇ is affine in it and so is each of the
    two demands. With the tube's interval of `curvature` one input does it for all of them at once, whatever curvature
    the reference point names: a certificate's input at the worse end is good for all, so that the half-space of that
    end meets the box. Where the path's curvature is not known, the middle does for the feed-forward. So it is with an
    interval of `acceleration`.
    """
    objects(problem=(problem, Problem), funnel=(funnel, Funnel))
    require_fit(problem, [funnel])
    optional("curvature", curvature, Interval)
    optional("acceleration", acceleration, Interval)
    margin, margin_per_metre = number("margin", margin, "1/s"), number("margin_per_metre", margin_per_metre, "1/m")
    # below β̲ the demand fades as a tube's certificate does; along a segment the two may differ, so there it only asks
    inner = funnel.beta_lower if funnel.rate else funnel.inner

    def ends(interval: Interval | None) -> tuple[np.float64, np.float64] | None:
        return None if interval is None else (np.float64(interval.lower), np.float64(interval.upper))

    return LawNumbers(
        **InputBox.of(problem.inputs)._asdict(),
        shape=np.asarray(funnel.shape, float),
        rate=np.float64(funnel.rate),
        beta_lower=np.float64(funnel.beta_lower),
        beta_inner=np.float64(inner),
        decrease=np.float64(LAW_SHARE * margin),
        decrease_per_metre=np.float64(LAW_SHARE * margin_per_metre),
        curvature=ends(curvature),
        acceleration=ends(acceleration),
    )


class Descent(NamedTuple):
    """V̇ = rate + slopes · (v − centre), and what is asked of it: slopes · (v − centre) ≤ −excess. Scalars.

    On the shell V ∈ [β̲, 1] the demand is V̇ ≤ −λ', the larger of the two demands at the reference's speed. Inside it
    fades with q, down to nothing on the reference itself, and V̇'s part of the timing with it. Below `beta_inner` it is
    soft as well, so that it may yield to the box. Above 1 nothing is guaranteed and `excess` is infinite: as much as
    the box can do.
    """

    slopes: tuple[Scalar, ...]  # ∂V̇/∂v, 1/s per unit of the input
    rate: Scalar  # V̇ at the centre, 1/s
    excess: Scalar  # 1/s
    softness: Scalar  # 1/s²; 0 where the demand is hard
    centre: tuple[Scalar, ...]  # the reference's feed-forward, inside the box
    lower: Sequence[Scalar] | Array | np.ndarray  # of the box
    upper: Sequence[Scalar] | Array | np.ndarray

    @property
    def half(self) -> list[Scalar]:
        """Half-widths of the box."""
        return [0.5 * (self.upper[i] - self.lower[i]) for i in range(len(self.slopes))]


def descent_at(
    vehicle: Vehicle,
    template: Template,
    numbers: LawNumbers,
    reference: ReferencePoint,
    theta: Scalar,
    x: Sequence[Scalar],
) -> Descent:
    """V̇ over the inputs at (θ in s, deviation x) beside a reference point: scalars in, scalars out.

    Arrays of equal length pass as scalars, in the reference too, whose fields share one shape. In a tube θ has no
    influence.
    """
    objects(
        vehicle=(vehicle, Vehicle),
        template=(template, Template),
        numbers=(numbers, LawNumbers),
        reference=(reference, ReferencePoint),
    )
    x, (theta,) = scalars("x", x, vehicle.state_names), scalars("theta", [theta], ["theta"])
    states, count = range(len(x)), len(vehicle.input_names) + 1
    half_gradient = [sum(numbers.shape[i, j] * x[j] for j in states) for i in states]
    q = sum(half_gradient[i] * x[i] for i in states)
    level, scale = template.level(numbers.rate, theta), template.scale(numbers.rate, theta)
    demand = jnp.minimum(q / (level - (1 - numbers.beta_lower) / scale), 1.0)  # 1 from V = β̲ on
    hardness = jnp.minimum(q / (level - (1 - numbers.beta_inner) / scale), 1.0)
    decrease = jnp.maximum(numbers.decrease, numbers.decrease_per_metre * reference.speed)

    def value_rate(inputs: tuple[float, ...], at: ReferencePoint = reference) -> Scalar:
        rates = deviation_rate(vehicle, x, inputs, at)
        return 2 * scale * sum(g * rate for g, rate in zip(half_gradient, rates, strict=True))

    drift = value_rate((0.0,) * count)
    units = [tuple(float(i == j) for j in range(count)) for i in range(count)]
    slopes = [value_rate(unit) - drift for unit in units]
    if numbers.curvature is not None or numbers.acceleration is not None:
        # κ and a multiply u0 > 0 alone: the worst ends are those with the largest coefficient of u0
        turns = [kappa * reference.speed for kappa in numbers.curvature or ()] or [reference.turn_rate]
        slopes_of_speed = numbers.acceleration or (reference.speed_slope,)
        ends = [
            ReferencePoint(*jnp.broadcast_arrays(turn, reference.speed, reference.turn_rate_slope, slope))
            for turn, slope in product(turns, slopes_of_speed)
        ]
        slopes[0] = reduce(jnp.maximum, (value_rate(units[0], end) for end in ends)) - drift
    slopes[0] = slopes[0] + demand * scale * template.timing(numbers.rate, q)
    rest = feedforward(vehicle, reference)
    centre = tuple(jnp.clip(value, numbers.lower[i], numbers.upper[i]) for i, value in enumerate(rest))
    rate = drift + sum(slopes[i] * centre[i] for i in range(count))
    return Descent(
        slopes=tuple(slopes),
        rate=rate,
        excess=jnp.where(q > level, jnp.inf, rate + demand * decrease),
        softness=(1 - hardness) * decrease**2,
        centre=centre,
        lower=numbers.lower,
        upper=numbers.upper,
    )


class Law(abc.ABC):
    """A run-time law; stateless. A car carries θ along, with the first of the inputs as its rate."""

    name: ClassVar[str]
    inherits: ClassVar[bool]  # the certificate

    @abc.abstractmethod
    def choose(self, descent: Descent) -> tuple[Scalar, ...]:
        """The inputs (u0, *vehicle inputs), inside the box."""

    def __call__(
        self,
        vehicle: Vehicle,
        template: Template,
        numbers: LawNumbers,
        reference: ReferencePoint,
        theta: Scalar,
        x: Sequence[Scalar],
    ) -> tuple[Scalar, ...]:
        """Inputs at (θ in s, deviation x) beside a reference point: scalars, or arrays of equal length."""
        return self.choose(descent_at(vehicle, template, numbers, reference, theta, x))


def path_point(curvature: Scalar, speed: Scalar, acceleration: Scalar = 0.0) -> ReferencePoint:
    """The reference point of a path with curvature κ (1/m), speed v_r (m/s) and acceleration dv_r/dθ (m/s²).

    Scalars, or arrays of equal length. κ counts as constant around the point: no tube depends on its slope.
    """
    given = scalars("path_point", (curvature, speed, acceleration), ("curvature", "speed", "acceleration"))
    kappa, v, a = jnp.broadcast_arrays(*(jnp.asarray(value, float) for value in given))
    return ReferencePoint(kappa * v, v, kappa * a, a)
