"""The conditions (a)–(d) of a control funnel function, as functions that JAX can differentiate and batch.

The unknowns are a factor L with C⁻¹ = L Lᵀ and the template's rate. Deviations in the shell are not searched in x but
in **dual coordinates**: a direction of the gradient w (a covector) and a fraction s of the range of q,

    x = √q L Lᵀw / |Lᵀw|,     ∇q = 2 √q w / |Lᵀw|,      q = q_lo + s (q_hi − q_lo).

An input whose direction of attack is fixed loses its authority exactly on a coordinate plane of w (for the bicycle
V_α ~ w_α and V_v ~ w_v), whatever the funnel: the ridges on which the margin is decided stay where they are while the
funnel changes, and a search can walk along them by leaving coordinates at zero.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from cfjax.funnel.funnel import Funnel
from cfjax.funnel.instance import Chain, Clearance, Instance
from cfjax.funnel.template import Template
from cfjax.problem import ReferencePoint, Vehicle, deviation_rate
from cfjax.problem.vehicle import Scalar


CLEAR = 1e-3  # m that a funnel keeps off obstacles at the places looked at, for what lies between them


def shell_points(
    template: Template,
    instance: Instance,
    factor: Float[Array, "n n"],
    rate: Scalar,
    w: Float[Array, "k n"],
    s: Float[Array, " k"],
    station: Int[Array, " k"],
) -> tuple[Float[Array, "k n"], Float[Array, " k"], Float[Array, "k n"]]:
    """From dual coordinates to deviations x, forms q and gradients ∇q; w in units of 1/half-axis of I, s ∈ [0, 1].

    `station` says at which of the instance's stations each point lies.
    """
    covector = w / jnp.asarray(instance.inlet)[None, :]
    pulled = covector @ factor
    begin, end = jnp.asarray(instance.begin)[station], jnp.asarray(instance.end)[station]
    low, high = template.shell(rate, begin, end, instance.beta_inner)
    q = low + (high - low) * s
    size = jnp.sqrt(q) / jnp.sqrt(jnp.sum(pulled * pulled, axis=1))
    return size[:, None] * (pulled @ factor.T), q, 2 * size[:, None] * covector


def dual_coordinates(
    instance: Instance, funnel: Funnel, x: Float[np.ndarray, "k n"], station: Int[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, " k"]]:
    """The inverse of `shell_points`: unit directions w and fractions s of deviations x (clipped to the shell)."""
    w = x @ funnel.shape * np.asarray(instance.inlet)
    begin, end = np.asarray(instance.begin)[station], np.asarray(instance.end)[station]
    low, high = map(np.asarray, funnel.template.shell(funnel.rate, begin, end, float(instance.beta_inner)))
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
    station: Int[Array, " k"],
    smoothing: Scalar = 0.0,
) -> Float[Array, " k"]:
    """Condition (d): the λ (1/s, over the instance's unit) that the best input in the box reaches at each point.

    Of a vehicle with a law: that its inputs reach with the best u0.

    min over the box of q̇ + timing u0 = a + Σ (b_i middle_i − |b_i| half_i); a `smoothing` > 0 (same unit) rounds |b_i|
    off from above and so makes the margin look a little better than it is, never worse. Of several extreme references
    the worst counts; those of one group have to do with the one vertex that is best for their nominal reference.
    """
    x, q, gradient = shell_points(template, instance, factor, rate, w, s, station)
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
        own = vehicle.feedback(states, reference)
        if own is not None:  # what is left to choose is u0
            box = zip(own, instance.inputs.lower[1:], instance.inputs.upper[1:], strict=True)
            given = [jnp.clip(k, lower, upper) for k, lower, upper in box]
            drift = drift + sum((u * b for u, b in zip(given, columns[1:], strict=True)), jnp.zeros_like(q))
            columns = [columns[0], *(jnp.zeros_like(q) for _ in given)]
        return drift, jnp.stack(columns)

    half, middle = jnp.asarray(instance.inputs.half)[:, None], jnp.asarray(instance.inputs.middle)[:, None]

    def group(references: ReferencePoint, nominal: ReferencePoint, unit: Array) -> Array:
        drift, columns = jax.vmap(affine)(references)
        if unit.shape[0] == 1:  # its own nominal reference
            authority = _rounded_abs(half * columns[0], smoothing)[None]
        else:
            reach = half * affine(nominal)[1]
            authority = half[None] * columns * (reach / _rounded_abs(reach, smoothing, at_zero=1.0))[None]
        best = drift + (columns * middle[None] - authority).sum(axis=1)
        return (-best / unit).min(axis=0)

    def at_station(values: Array | np.ndarray) -> Array:
        """(stations, …) to (…, k): the numbers of each point's station."""
        return jnp.moveaxis(jnp.asarray(values)[station], 0, -1)

    references, nominal = (jax.tree.map(at_station, points) for points in (instance.references, instance.nominal))
    margins = jax.vmap(group)(references, nominal, at_station(instance.unit)).min(axis=0)
    begin, end = at_station(instance.begin), at_station(instance.end)
    return margins / template.drop(rate, begin, end, instance.beta_lower, q)


def _rounded_abs(value: Array, smoothing: Scalar, at_zero: float = 0.0) -> Array:
    """√(value² + smoothing²), differentiable without smoothing too: the derivative of a bare root at 0 is NaN."""
    square = value**2 + smoothing**2
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), at_zero)


def containment_excess(
    template: Template, instance: Instance, factor: Float[Array, "n n"], rate: Scalar
) -> Float[Array, " j"]:
    """Conditions (a), (b), (c): relative excesses, all below zero exactly when the three hold strictly.

    (a) I inside the funnel's start, (b) the funnel's end inside G, (c) the widest level inside the box S and, at the
    places looked at, the footprint clear of the obstacles.
    """
    inverse = factor @ factor.T  # C⁻¹
    end = template.level(rate, instance.duration)
    axes = jnp.stack([jnp.asarray(instance.inlet), jnp.asarray(instance.goal)])
    in_inlet, in_goal = jnp.linalg.eigvalsh(inverse[None] / (axes[:, :, None] * axes[:, None, :]))
    starts = jnp.where(jnp.asarray(instance.starts) > 0, 1 - in_inlet, -1.0)
    ends = jnp.where(jnp.asarray(instance.ends) > 0, end * in_goal - 1, -1.0)
    box = jnp.maximum(end, 1.0) * jnp.diag(inverse) / instance.safe**2 - 1
    return jnp.concatenate([starts, ends, box, _overlap(template, instance, inverse, rate)])


def _overlap(template: Template, instance: Instance, inverse: Float[Array, "n n"], rate: Scalar) -> Float[Array, " p"]:
    """By how much, in lateral half-axes of I, the footprint comes closer to an obstacle than it may at each place."""
    theta, gap, reach, swing = map(jnp.asarray, instance.clearance)
    level = jnp.maximum(template.level(rate, theta), 1e-9)  # a candidate may be empty before its end
    wide = jnp.einsum("pdi,ij,pdj->pd", reach, inverse, reach)
    needed = jnp.sqrt(level)[:, None] * jnp.sqrt(wide) + (swing * level * inverse[0, 0])[:, None]
    return (CLEAR - jnp.max(gap - needed, axis=1)) / jnp.asarray(instance.inlet)[1]


def containment_points(
    instance: Instance, funnel: Funnel, last: float
) -> list[tuple[str, float, float, Float[np.ndarray, " n"]]]:
    """Where (a), (b), (c) are closest to failing: condition, slack, θ (s) and deviation; `last` is the θ of the end.

    A slack is relative, positive where the condition holds, and exact up to rounding.
    """
    inverse, end = np.linalg.inv(funnel.shape), funnel.end_level
    inlet, goal, safe = (np.asarray(values) for values in (instance.inlet, instance.goal, instance.safe))
    found = []
    if instance.starts:
        values, vectors = np.linalg.eigh(funnel.shape * np.outer(inlet, inlet))  # q on the boundary of I
        found.append(("a", 1 - values[-1], 0.0, inlet * vectors[:, -1]))
    if instance.ends:
        values, vectors = np.linalg.eigh(funnel.shape * np.outer(goal, goal))
        found.append(("b", values[0] / end - 1, last, goal * vectors[:, 0]))
    face = int(np.argmin(safe**2 / np.diag(inverse)))
    slack = safe[face] ** 2 / inverse[face, face] / max(1.0, end) - 1
    widest_at = 0.0 if end <= 1 else last
    found.append(("c", slack, widest_at, safe[face] * inverse[:, face] / inverse[face, face]))
    if len(instance.clearance.theta):
        found.append(("c", *_nearest(funnel, instance.clearance, inverse)))
    return found


def _nearest(
    funnel: Funnel, clearance: Clearance, inverse: Float[np.ndarray, "n n"]
) -> tuple[float, float, Float[np.ndarray, " n"]]:
    """Slack, θ and deviation at which the footprint comes closest to an obstacle."""
    theta, gap, reach, swing = map(np.asarray, clearance)
    level = funnel.level(theta)
    wide = np.sqrt(np.einsum("pdi,ij,pdj->pd", reach, inverse, reach))
    left = gap - np.sqrt(level)[:, None] * wide - (swing * level * inverse[0, 0])[:, None]
    place = int(np.argmin(left.max(axis=1)))
    normal = int(np.argmax(left[place]))
    half = np.sqrt(level[place]) * wide[place, normal]  # of the funnel along n
    x = gap[place, normal] / wide[place, normal] ** 2 * inverse @ reach[place, normal]
    return float((gap[place, normal] / half) ** 2 - 1), float(theta[place]), x


def link_excess(template: Template, chain: Chain, factors: Float[Array, "k n n"], rates: Float[Array, " k"]) -> Array:
    """By how much, relatively, a funnel's end reaches beyond the start of the next; below zero where it does not."""
    first, second = chain.links.T
    end = template.level(rates, jnp.asarray(chain.funnels.duration))[first]
    between = jnp.linalg.solve(factors[second], factors[first])
    spectrum = jnp.linalg.eigvalsh(between @ between.transpose(0, 2, 1))
    return (end[:, None] * spectrum - 1).ravel()


def chain_excess(
    template: Template, chain: Chain, factors: Float[Array, "k n n"], rates: Float[Array, " k"]
) -> Float[Array, " j"]:
    """(a), (b), (c) of every funnel and the links between them: all below zero exactly when they hold strictly."""
    own = jax.vmap(lambda instance, factor, rate: containment_excess(template, instance, factor, rate))(
        chain.funnels, factors, rates
    ).ravel()
    return jnp.concatenate([own, link_excess(template, chain, factors, rates)]) if len(chain.links) else own
