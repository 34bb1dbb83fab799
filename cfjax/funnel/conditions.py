"""The conditions (a)–(d) of a control funnel function, as functions that JAX can differentiate and batch.

The unknowns are a factor L with C⁻¹ = L Lᵀ and the template's rate. Deviations in the shell are not searched in x but
in **dual coordinates**: a direction of the gradient w (a covector) and a fraction s of the range of q,

    x = √q L Lᵀw / |Lᵀw|,     ∇q = 2 √q w / |Lᵀw|,      q = q_lo + s (q_hi − q_lo).

An input whose direction of attack is fixed loses its authority exactly on a coordinate plane of w (for the bicycle
V_α ~ w_α and V_v ~ w_v), whatever the funnel: the ridges on which the margin is decided stay where they are while the
funnel changes, and a search can walk along them by leaving coordinates at zero.
"""

import enum
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.funnel.funnel import Funnel
from cfjax.funnel.template import Template
from cfjax.problem import Problem, ReferencePoint, Segment, Tube, Vehicle, deviation_rate, mirror_signs
from cfjax.problem.vehicle import Scalar


class Unit(enum.Enum):
    """What a margin is counted in: 1/s, 1/m of the reference's way, or in between.

    At a high speed a margin in 1/s is worth little: what counts there is the way. Balanced margins, which a learner
    maximises, are in 1/s at the slowest speed and grow with speed nearly as fast as margins per metre.
    """

    SECOND = 0.0
    METRE = 1.0
    BALANCED = 0.95  # exponent of the speed, relative to the slowest


class Instance(NamedTuple):
    """The numbers of one problem on one steady segment or tube, as a pytree: one compiled program serves all.

    `references` are the extreme references, arrays (groups, members), `nominal` the one of each group, arrays
    (groups,), at which signs are read; margins are divided by `unit` (groups, members).

    Where a tube is its own mirror image, so is V: `coupling` is then zero between states of unlike parity, and the
    upper end of the curvature speaks for both.
    """

    references: ReferencePoint
    nominal: ReferencePoint
    unit: Array | np.ndarray
    duration: Scalar  # T, s; 1 for a tube, which has no end, and whose rate is zero
    beta_lower: Scalar
    beta_inner: Scalar
    input_middle: Array | np.ndarray  # (1 + m,), u0 first
    input_half: Array | np.ndarray
    inlet: Array | np.ndarray  # half-axes of I, one per state
    goal: Array | np.ndarray  # half-axes of G
    safe: Array | np.ndarray  # half-widths of S, at most π in the heading (V is continuous only short of the wrap)
    change_bounds: tuple[Scalar, Scalar]  # of rate · duration
    coupling: Array | np.ndarray  # (n, n): 1 where C may have an entry, else 0


def instance_of(
    problem: Problem,
    segment: Segment | Tube,
    template: Template,
    beta_lower: float,
    beta_inner: float | None = None,
    unit: Unit = Unit.SECOND,
) -> Instance:
    """The numbers that the conditions need; `beta_inner` is beta_lower unless given."""
    tube = segment if isinstance(segment, Tube) else None
    references, nominal = np.array(segment.references(), float), np.array(segment.nominal(), float)
    mirror = mirror_signs(problem.vehicle) if tube and tube.curvature.middle == 0 else None
    if tube and mirror:
        half = len(references) // 2 if tube.curvature.half else 0  # of the groups: the upper end of the curvature
        references, nominal = references[half:], nominal[half:]
    parity = np.array(mirror or (1,) * problem.dimension)
    speed = references[..., 1]
    may_grow = all(start < end for start, end in zip(problem.inlet.half_axes, problem.goal.half_axes, strict=True))
    safe = np.array(problem.safe.half_widths if problem.safe else (np.inf,) * problem.dimension)
    safe[0] = min(safe[0], np.pi)
    bounds = (0.0, 0.0) if tube else template.change_bounds(beta_lower, may_grow)
    return Instance(
        references=ReferencePoint(*np.moveaxis(references, -1, 0)),
        nominal=ReferencePoint(*nominal.T),
        unit=(speed if unit is Unit.METRE else speed / speed.min()) ** unit.value,
        duration=np.float64(1.0 if tube else segment.duration),
        beta_lower=np.float64(beta_lower),
        beta_inner=np.float64(beta_lower if beta_inner is None else beta_inner),
        input_middle=np.array([interval.middle for interval in problem.inputs]),
        input_half=np.array([interval.half for interval in problem.inputs]),
        inlet=np.array(problem.inlet.half_axes),
        goal=np.array(problem.goal.half_axes),
        safe=safe,
        change_bounds=tuple(map(np.float64, bounds)),
        coupling=(np.outer(parity, parity) > 0).astype(float),
    )


def shell_points(
    template: Template,
    instance: Instance,
    factor: Float[Array, "n n"],
    rate: Scalar,
    w: Float[Array, "k n"],
    s: Float[Array, " k"],
) -> tuple[Float[Array, "k n"], Float[Array, " k"], Float[Array, "k n"]]:
    """From dual coordinates to deviations x, forms q and gradients ∇q; w in units of 1/half-axis of I, s ∈ [0, 1]."""
    covector = w / jnp.asarray(instance.inlet)[None, :]
    pulled = covector @ factor
    low, high = template.shell(rate, instance.duration, instance.beta_inner)
    q = low + (high - low) * s
    size = jnp.sqrt(q) / jnp.sqrt(jnp.sum(pulled * pulled, axis=1))
    return size[:, None] * (pulled @ factor.T), q, 2 * size[:, None] * covector


def dual_coordinates(
    instance: Instance, funnel: Funnel, x: Float[np.ndarray, "k n"]
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, " k"]]:
    """The inverse of `shell_points`: unit directions w and fractions s of deviations x (clipped to the shell)."""
    w = x @ funnel.shape * np.asarray(instance.inlet)
    low, high = (float(q) for q in funnel.template.shell(funnel.rate, instance.duration, instance.beta_lower))
    s = np.clip((funnel.form(x) - low) / (high - low), 0.0, 1.0)
    return w / np.linalg.norm(w, axis=1, keepdims=True), s


def decrease_margins(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    factor: Float[Array, "n n"],
    rate: Scalar,
    w: Float[Array, "k n"],
    s: Float[Array, " k"],
    smoothing: Scalar = 0.0,
) -> Float[Array, " k"]:
    """Condition (d): the λ (1/s, over the instance's unit) that the best input in the box reaches at each point.

    min over the box of q̇ + timing u0 = a + Σ (b_i middle_i − |b_i| half_i); a `smoothing` > 0 (same unit) rounds |b_i|
    off from above and so makes the margin look a little better than it is, never worse. Of several extreme references
    the worst counts; those of one group have to do with the one vertex that is best for their nominal reference.
    """
    x, q, gradient = shell_points(template, instance, factor, rate, w, s)
    states, slopes = tuple(x.T), tuple(gradient.T)
    count = 1 + len(vehicle.input_names)

    def affine(reference: ReferencePoint) -> tuple[Array, Array]:
        """q̇ + timing u0 at one reference: its drift, shape (k,), and its columns b, shape (1 + m, k)."""

        def form_rate(inputs: tuple[float, ...]) -> Array:
            rates = deviation_rate(vehicle, states, inputs, reference)
            return sum((g * r for g, r in zip(slopes, rates, strict=True)), jnp.zeros_like(q))

        drift = form_rate((0.0,) * count)
        columns = [form_rate(tuple(float(i == j) for j in range(count))) - drift for i in range(count)]
        columns[0] = columns[0] + template.timing(rate, q)
        return drift, jnp.stack(columns)

    half, middle = jnp.asarray(instance.input_half)[:, None], jnp.asarray(instance.input_middle)[:, None]

    def group(references: ReferencePoint, nominal: ReferencePoint, unit: Array) -> Array:
        drift, columns = jax.vmap(affine)(references)
        if unit.shape[0] == 1:  # its own nominal reference
            authority = _rounded_abs(half * columns[0], smoothing)[None]
        else:
            reach = half * affine(nominal)[1]
            authority = half[None] * columns * (reach / _rounded_abs(reach, smoothing, at_zero=1.0))[None]
        best = drift + (columns * middle[None] - authority).sum(axis=1)
        return (-best / unit[:, None]).min(axis=0)

    margins = jax.vmap(group)(instance.references, instance.nominal, jnp.asarray(instance.unit)).min(axis=0)
    return margins / template.drop(rate, instance.duration, instance.beta_lower, q)


def _rounded_abs(value: Array, smoothing: Scalar, at_zero: float = 0.0) -> Array:
    """√(value² + smoothing²), differentiable without smoothing too: the derivative of a bare root at 0 is NaN."""
    square = value**2 + smoothing**2
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), at_zero)


def containment_excess(
    template: Template, instance: Instance, factor: Float[Array, "n n"], rate: Scalar
) -> Float[Array, " j"]:
    """Conditions (a), (b), (c): relative excesses, all below zero exactly when the three hold strictly.

    (a) I inside the funnel's start, (b) the funnel's end inside G, (c) the widest level inside the box S.
    """
    inverse = factor @ factor.T  # C⁻¹
    end = template.level(rate, instance.duration)
    axes = jnp.stack([jnp.asarray(instance.inlet), jnp.asarray(instance.goal)])
    in_inlet, in_goal = jnp.linalg.eigvalsh(inverse[None] / (axes[:, :, None] * axes[:, None, :]))
    widest = jnp.maximum(end, 1.0)
    return jnp.concatenate([1 - in_inlet, end * in_goal - 1, widest * jnp.diag(inverse) / instance.safe**2 - 1])
