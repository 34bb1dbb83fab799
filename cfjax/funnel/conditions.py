"""The conditions (a)–(d) of a control funnel function, as functions that JAX can differentiate and batch.

The unknowns are a factor L with C⁻¹ = L Lᵀ and the template's rate. Deviations in the shell are not searched in x but
in **dual coordinates**: a direction of the gradient w (a covector) and a fraction s of the range of q,

    x = √q L Lᵀw / |Lᵀw|,     ∇q = 2 √q w / |Lᵀw|,      q = q_lo + s (q_hi − q_lo).

An input whose direction of attack is fixed loses its authority exactly on a coordinate plane of w (for the bicycle
V_α ~ w_α and V_v ~ w_v), whatever the funnel: the ridges on which the margin is decided stay where they are while the
funnel changes, and a search can walk along them by leaving coordinates at zero.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.funnel.funnel import Funnel
from cfjax.funnel.template import Template
from cfjax.problem import Problem, ReferencePoint, Segment, Vehicle, deviation_rate
from cfjax.problem.vehicle import Scalar


class Instance(NamedTuple):
    """The numbers of one problem on one steady segment, as a pytree: one compiled program serves all of them."""

    reference: ReferencePoint
    duration: Scalar  # T, s
    beta_lower: Scalar
    input_middle: Array | np.ndarray  # (1 + m,), u0 first
    input_half: Array | np.ndarray
    inlet: Array | np.ndarray  # half-axes of I, one per state
    goal: Array | np.ndarray  # half-axes of G
    safe: Array | np.ndarray  # half-widths of S, at most π in the heading (V is continuous only short of the wrap)
    change_bounds: tuple[Scalar, Scalar]  # of rate · duration


def instance_of(problem: Problem, segment: Segment, template: Template, beta_lower: float) -> Instance:
    """The numbers that the conditions need."""
    may_grow = all(start < end for start, end in zip(problem.inlet.half_axes, problem.goal.half_axes, strict=True))
    safe = np.array(problem.safe.half_widths if problem.safe else (np.inf,) * problem.dimension)
    safe[0] = min(safe[0], np.pi)
    return Instance(
        reference=ReferencePoint(*map(np.float64, segment.point(0.0))),
        duration=np.float64(segment.duration),
        beta_lower=np.float64(beta_lower),
        input_middle=np.array([interval.middle for interval in problem.inputs]),
        input_half=np.array([interval.half for interval in problem.inputs]),
        inlet=np.array(problem.inlet.half_axes),
        goal=np.array(problem.goal.half_axes),
        safe=safe,
        change_bounds=tuple(map(np.float64, template.change_bounds(beta_lower, may_grow))),
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
    low, high = template.shell(rate, instance.duration, instance.beta_lower)
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
    """Condition (d): the λ (1/s) that the best input in the box reaches at each point of the shell.

    min over the box of q̇ + timing u0 = a + Σ (b_i middle_i − |b_i| half_i); a `smoothing` > 0 (same unit) rounds |b_i|
    off from above and so makes the margin look a little better than it is, never worse.
    """
    x, q, gradient = shell_points(template, instance, factor, rate, w, s)
    states, slopes = tuple(x.T), tuple(gradient.T)
    count = 1 + len(vehicle.input_names)

    def form_rate(inputs: tuple[float, ...]) -> Array:
        rates = deviation_rate(vehicle, states, inputs, instance.reference)
        return sum((g * r for g, r in zip(slopes, rates, strict=True)), jnp.zeros_like(q))

    drift = form_rate((0.0,) * count)
    best = drift
    for i in range(count):
        b = form_rate(tuple(float(i == j) for j in range(count))) - drift
        if i == 0:
            b = b + template.timing(rate, q)
        reach = instance.input_half[i] * b
        # the guarded root: at smoothing 0 and b = 0 its derivative would be NaN
        square = reach**2 + smoothing**2
        authority = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
        best = best + b * instance.input_middle[i] - authority
    return -best / template.drop(rate, instance.duration, instance.beta_lower, q)


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
