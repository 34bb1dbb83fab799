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

from cfjax.funnel.template import Template
from cfjax.problem import Problem, ReferencePoint, Segment, Vehicle, affine_deviation
from cfjax.problem.vehicle import Scalar


class Instance(NamedTuple):
    """The numbers of one problem on one steady segment, as a pytree: one compiled program serves all of them."""

    reference: ReferencePoint
    duration: Scalar  # T, s
    beta_lower: Scalar
    input_middle: Array  # (1 + m,), u0 first
    input_half: Array
    inlet: Array  # half-axes of I, one per state
    goal: Array  # half-axes of G
    safe: Array  # half-widths of S, at most π in the heading (V is continuous only short of the wrap)


def instance_of(problem: Problem, segment: Segment, beta_lower: float) -> Instance:
    """The numbers that the conditions need."""
    safe = np.array(problem.safe.half_widths if problem.safe else (np.inf,) * problem.dimension)
    safe[0] = min(safe[0], np.pi)
    return Instance(
        reference=ReferencePoint(*(jnp.asarray(value, float) for value in segment.point(0.0))),
        duration=jnp.asarray(segment.duration, float),
        beta_lower=jnp.asarray(beta_lower, float),
        input_middle=jnp.array([interval.middle for interval in problem.inputs]),
        input_half=jnp.array([interval.half for interval in problem.inputs]),
        inlet=jnp.array(problem.inlet.half_axes),
        goal=jnp.array(problem.goal.half_axes),
        safe=jnp.asarray(safe),
    )


class ShellPoint(NamedTuple):
    """A deviation in the shell, its form q and the covector ∇q."""

    x: Float[Array, " n"]
    q: Float[Array, ""]
    gradient: Float[Array, " n"]


def shell_point(
    template: Template, instance: Instance, factor: Float[Array, "n n"], rate: Scalar, w: Float[Array, " n"], s: Scalar
) -> ShellPoint:
    """From dual coordinates to the deviation: w in units of 1/half-axis of I, s ∈ [0, 1]."""
    covector = w / instance.inlet
    pulled = factor.T @ covector
    length = jnp.sqrt(pulled @ pulled)
    low, high = template.shell(rate, instance.duration, instance.beta_lower)
    q = low + (high - low) * s
    root = jnp.sqrt(q)
    return ShellPoint(x=root * (factor @ pulled) / length, q=q, gradient=2 * root * covector / length)


def decrease_margin(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    rate: Scalar,
    point: ShellPoint,
    smoothing: Scalar = 0.0,
) -> Float[Array, ""]:
    """Condition (d) at one deviation: the λ (1/s) that the best input in the box reaches there.

    min over the box of q̇ + timing u0 = a + Σ (b_i middle_i − |b_i| half_i); a `smoothing` > 0 (same unit) rounds |b_i|
    off from above and so makes the margin look a little better than it is, never worse.
    """
    drift, columns = affine_deviation(vehicle, point.x, instance.reference)
    b = point.gradient @ columns
    b = b.at[0].add(template.timing(rate, point.q))
    authority = jnp.sqrt((instance.input_half * b) ** 2 + smoothing**2)
    best = point.gradient @ drift + b @ instance.input_middle - authority.sum()
    return -best / template.drop(rate, instance.duration, instance.beta_lower, point.q)


def containment_slacks(
    template: Template, instance: Instance, factor: Float[Array, "n n"], rate: Scalar
) -> Float[Array, " k"]:
    """Conditions (a), (b), (c): numbers that are all positive exactly when the three hold; dimensionless.

    (a) I inside the funnel's start, (b) the funnel's end inside G, (c) the widest level inside the box S.
    """
    inverse = factor @ factor.T  # C⁻¹
    end = template.level(rate, instance.duration)
    in_inlet = jnp.linalg.eigvalsh(inverse / jnp.outer(instance.inlet, instance.inlet))
    in_goal = jnp.linalg.eigvalsh(end * inverse / jnp.outer(instance.goal, instance.goal))
    widest = jnp.maximum(end, 1.0)
    return jnp.concatenate([in_inlet - 1, 1 - in_goal, 1 - widest * jnp.diag(inverse) / instance.safe**2])
