"""Deviation dynamics in the body frame of the reference: derived once, for every vehicle and every path.

With the pose deviation p = R(α_r) p_R + p_r, α = α_R + α_r and the internal states ξ = ξ_R + ξ_r(θ), θ̇ = u0:

    α̇_R = ω(ξ, u) − ω_r u0
    ṗ_R = R(α_R) ν(ξ, u) − ν_r u0 − ω_r u0 J p_R
    ξ̇_R = f(ξ, u) − ξ_r'(θ) u0

(ω, ν) is the vehicle's body twist, (ω_r, ν_r) the reference's, J the quarter turn. For the bicycle this is the paper's
"body fixed frame". On a straight line or a circle at constant speed nothing here depends on θ.
"""

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax import coerce
from cfjax.problem.vehicle import Scalar, Vehicle


if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


jax.config.update("jax_enable_x64", True)  # the one place: margins are compared to parts in 1e-9

BATCH = 1024  # references that one compiled program looks at, however many there are
FEW = 8  # references that are looked at one by one: nothing is compiled for them
DEPENDENT = 1e-12  # relative: a column with less left of its square, beside those before it, is no input of its own


class ReferencePoint(NamedTuple):
    """What the dynamics see of a reference at one θ: nothing of its pose, only its profile."""

    turn_rate: Scalar  # ω_r = dα_r/dθ, rad/s
    speed: Scalar  # v_r, m/s
    turn_rate_slope: Scalar = 0.0  # dω_r/dθ, rad/s²
    speed_slope: Scalar = 0.0  # dv_r/dθ, m/s²


FIELDS = ReferencePoint._fields


def scalars(name: str, value: Any, names: "Sequence[str]") -> tuple[Scalar, ...]:
    """Scalars of these names, numbers or (traced) arrays of one shape, in a list, a tuple or an array.

    Raises:
        InputError: for anything else.
    """
    entries = tuple(value) if isinstance(value, list | tuple) or getattr(value, "ndim", 0) else None
    if entries is None or len(entries) != len(names) or not all(map(_is_scalar, entries)):
        coerce.refuse(name, f"{len(names)} numbers ({', '.join(names)}), or arrays of equal length", value)
    return tuple(entry if hasattr(entry, "dtype") else coerce.real(entry) for entry in entries)


def _is_scalar(value: object) -> bool:
    kind = getattr(getattr(value, "dtype", None), "kind", None)
    return coerce.real(value) is not None if kind is None else kind in ("i", "u", "f")


def _point(reference: object) -> ReferencePoint:
    return ReferencePoint(*scalars("reference", coerce.instance("reference", reference, ReferencePoint), FIELDS))


def deviation_rate(vehicle: Vehicle, x: "Sequence", inputs: "Sequence", reference: ReferencePoint) -> tuple:
    """Time derivative of the deviation (α_R, x_R, y_R, ξ_R…): rad/s, m/s, m/s, unit of ξ per second.

    `x` has one scalar per `vehicle.state_names`, `inputs` is (u0, *vehicle inputs). Scalars in, scalars out; arrays of
    equal length pass as scalars too, for a whole batch at once.
    """
    coerce.objects(vehicle=(vehicle, Vehicle))
    alpha, px, py, *internal = scalars("x", x, vehicle.state_names)
    u0, *u = scalars("inputs", inputs, ("u0", *vehicle.input_names))
    reference = _point(reference)

    def internal_reference(turn_rate: Scalar, speed: Scalar) -> list:
        return [jnp.asarray(value, float) for value in vehicle.reference(turn_rate, speed)[1]]

    point = (jnp.asarray(reference.turn_rate, float), jnp.asarray(reference.speed, float))
    slope = (jnp.asarray(reference.turn_rate_slope, float), jnp.asarray(reference.speed_slope, float))
    internal_r, internal_r_slope = jax.jvp(internal_reference, point, slope)
    twist_r = vehicle.reference(*point)[0]

    full = tuple(dev + ref for dev, ref in zip(internal, internal_r, strict=True))
    twist = vehicle.twist(full, tuple(u))
    rate = vehicle.internal_rate(full, tuple(u))
    c, s = jnp.cos(alpha), jnp.sin(alpha)
    return (
        twist.turn - twist_r.turn * u0,
        c * twist.lateral - s * twist.forward - twist_r.lateral * u0 + twist_r.turn * u0 * py,
        s * twist.lateral + c * twist.forward - twist_r.forward * u0 - twist_r.turn * u0 * px,
        *(own - ref * u0 for own, ref in zip(rate, internal_r_slope, strict=True)),
    )


def to_deviation(vehicle: Vehicle, state: "Sequence", pose: "Sequence", point: ReferencePoint) -> tuple:
    """The deviation (α_R, x_R, y_R, ξ_R…) of an inertial state from the reference: scalars in, scalars out.

    `state` is (α, x, y, ξ…): heading in rad, position in m, internal states; `pose` (α_r, x_r, y_r) is the
    reference's. Headings wrap: α_R lies in [−π, π).
    """
    coerce.objects(vehicle=(vehicle, Vehicle))
    alpha, x, y, *internal = scalars("state", state, vehicle.state_names)
    alpha_r, x_r, y_r = scalars("pose", pose, ("alpha", "x", "y"))
    point = _point(point)
    c, s = jnp.cos(alpha_r), jnp.sin(alpha_r)
    reference = vehicle.reference(point.turn_rate, point.speed)[1]
    return (
        jnp.mod(alpha - alpha_r + jnp.pi, 2 * jnp.pi) - jnp.pi,
        c * (x - x_r) + s * (y - y_r),
        c * (y - y_r) - s * (x - x_r),
        *(own - ref for own, ref in zip(internal, reference, strict=True)),
    )


def to_state(vehicle: Vehicle, x: "Sequence", pose: "Sequence", point: ReferencePoint) -> tuple:
    """The inertial state (α, x, y, ξ…) at a deviation from the reference: the inverse of `to_deviation`."""
    coerce.objects(vehicle=(vehicle, Vehicle))
    alpha, px, py, *internal = scalars("x", x, vehicle.state_names)
    alpha_r, x_r, y_r = scalars("pose", pose, ("alpha", "x", "y"))
    point = _point(point)
    c, s = jnp.cos(alpha_r), jnp.sin(alpha_r)
    reference = vehicle.reference(point.turn_rate, point.speed)[1]
    return (
        alpha + alpha_r,
        c * px - s * py + x_r,
        s * px + c * py + y_r,
        *(own + ref for own, ref in zip(internal, reference, strict=True)),
    )


def affine_deviation(
    vehicle: Vehicle, x: Float[Array | np.ndarray, " n"], reference: ReferencePoint
) -> tuple[Float[Array, " n"], Float[Array, "n m"]]:
    """Drift f and input columns g with ẋ = f + g (u0, u): the dynamics are affine in the inputs.

    Returns:
        f of shape (n,) and g of shape (n, 1 + number of vehicle inputs); column 0 belongs to the timing law.
    """
    coerce.objects(vehicle=(vehicle, Vehicle))
    scalars("x", x, vehicle.state_names)
    return _affine(vehicle, jnp.asarray(x, float), _point(reference))


@partial(jax.jit, static_argnames="vehicle")
def _affine(
    vehicle: Vehicle, x: Float[Array, " n"], reference: ReferencePoint
) -> tuple[Float[Array, " n"], Float[Array, "n m"]]:
    count = 1 + len(vehicle.input_names)

    def rate(*inputs: float) -> Array:
        return jnp.stack([jnp.asarray(r, float) for r in deviation_rate(vehicle, tuple(x), inputs, reference)])

    drift = rate(*(0.0,) * count)
    columns = [rate(*(float(i == j) for j in range(count))) - drift for i in range(count)]
    return drift, jnp.stack(columns, axis=-1)


def in_batches(
    program: "Callable[[np.ndarray], Sequence[Array]]", points: Float[np.ndarray, "n 4"]
) -> list[np.ndarray]:
    """What a compiled program has for many references, rows of a `ReferencePoint`, whatever their number.

    It gets BATCH of them at a time, so that it is compiled once, and returns arrays of so many rows.
    """
    found = []
    for begin in range(0, len(points), BATCH):
        own = points[begin : begin + BATCH]
        padded = np.concatenate([own, np.repeat(own[-1:], BATCH - len(own), axis=0)])
        found.append([np.asarray(each)[: len(own)] for each in program(padded)])
    return [np.concatenate(each) for each in zip(*found, strict=True)]


def affine_along(
    vehicle: Vehicle, points: Float[np.ndarray, "k 4"]
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, "k n m"]]:
    """`affine_deviation` without deviation on many references, rows of a `ReferencePoint`."""
    coerce.objects(vehicle=(vehicle, Vehicle))
    points = coerce.array("points", points, (None, len(FIELDS)))
    if len(points) > FEW:
        drift, columns = in_batches(partial(_affine_batch, vehicle), points)
        return drift, columns
    origin = jnp.zeros(len(vehicle.state_names))
    each = [affine_deviation(vehicle, origin, ReferencePoint(*map(float, row))) for row in points]
    drift, columns = (np.stack([np.asarray(part) for part in parts]) for parts in zip(*each, strict=True))
    return drift, columns


@partial(jax.jit, static_argnums=0)
def _affine_batch(vehicle: Vehicle, points: Float[Array, "k 4"]) -> tuple[Array, Array]:
    origin = jnp.zeros(len(vehicle.state_names))
    return jax.vmap(lambda row: affine_deviation(vehicle, origin, ReferencePoint(*row)))(points)


def feedforward(vehicle: Vehicle, reference: ReferencePoint) -> tuple[Scalar, ...]:
    """Inputs (1, u_r) that hold the vehicle on the reference, by least squares: scalars in, scalars out.

    The same as `Problem.feedforward`, which also says whether they do; here for a whole batch of references and without
    a linear algebra library: normal equations, eliminated as they stand. An input whose column depends on those before
    it stays at zero.
    """
    coerce.objects(vehicle=(vehicle, Vehicle))
    reference = _point(reference)
    count = len(vehicle.input_names)
    origin = (0.0,) * len(vehicle.state_names)

    def rates(*inputs: float) -> tuple[Scalar, ...]:
        return deviation_rate(vehicle, origin, (1.0, *inputs), reference)

    def dot(one: "Sequence[Scalar]", other: "Sequence[Scalar]") -> Scalar:
        return sum(a * b for a, b in zip(one, other, strict=True))

    rest = rates(*(0.0,) * count)
    columns = [
        [moved - still for moved, still in zip(rates(*(float(i == j) for j in range(count))), rest, strict=True)]
        for i in range(count)
    ]
    table = [[*(dot(columns[i], columns[j]) for j in range(count)), -dot(columns[i], rest)] for i in range(count)]
    for i in range(count):
        pivot, whole = table[i][i], dot(columns[i], columns[i])
        own = pivot > DEPENDENT * whole
        table[i] = [jnp.where(own, entry / jnp.where(own, pivot, 1.0), 0.0) for entry in table[i]]
        for k in range(count):
            if k != i:
                factor = table[k][i]
                table[k] = [a - factor * b for a, b in zip(table[k], table[i], strict=True)]
    return (jnp.ones_like(rest[0]), *(row[-1] for row in table))


@np.errstate(invalid="ignore")
def held(vehicle: Vehicle, points: Float[np.ndarray, "n 4"]) -> tuple[np.ndarray, ...]:
    """Of many references: inputs (n, m) that hold the vehicle on each, the largest rate that they leave (n,), the
    largest without them (n,), and the reference's twist (n, 3)."""
    return tuple(in_batches(partial(_held_batch, vehicle), points))


@partial(jax.jit, static_argnums=0)
def _held_batch(vehicle: Vehicle, points: Float[Array, "n 4"]) -> tuple[Array, ...]:
    def one(row: Float[Array, " 4"]) -> tuple[Array, ...]:
        point = ReferencePoint(*row)
        origin = (0.0,) * len(vehicle.state_names)
        inputs = feedforward(vehicle, point)

        def rate(*given: Scalar) -> Array:
            return jnp.stack([jnp.asarray(each, float) for each in deviation_rate(vehicle, origin, given, point)])

        def largest(values: Array) -> Array:
            return jnp.abs(values).max()

        still = rate(1.0, *(0.0 for _ in vehicle.input_names))
        twist = vehicle.reference(point.turn_rate, point.speed)[0]
        held = jnp.stack([jnp.asarray(each, float) for each in inputs[1:]])
        return held, largest(rate(*inputs)), largest(still), jnp.stack([jnp.asarray(each, float) for each in twist])

    return jax.vmap(one)(points)
