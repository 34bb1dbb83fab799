"""Templates of funnel functions: the family in which V is sought.

Both are built on the quadratic form q = xᵀ C x of the deviation and one rate, normalised to β = 1:

    paper        V = q + c0 θ         level set at θ: q ≤ ρ(θ) = 1 − c0 θ
    contracting  V = e^{kθ} q         level set at θ: q ≤ ρ(θ) = e^{−kθ}

Condition (d) of the paper, V̇ ≤ −λ on the shell β̲ ≤ V ≤ 1, reads for both

    q̇ + timing(q) u0 ≤ −λ drop      with timing = c0, drop = 1       on q ∈ [β̲ − c0 θ, 1 − c0 θ]
                                     with timing = k q, drop = ρ(θ)   on q ∈ [β̲ ρ(θ), ρ(θ)]

Below β̲, down to an inner level β_in (β̲ itself unless somebody asks), the demand fades in proportion: V̇ ≤ −λ V/β̲, so
that the time in which a deviation comes down from V = 1 to β_in is known. For `paper` drop = min(1, (q + c0 θ)/β̲), for
`contracting` drop = min(ρ(θ), q/β̲).

Where the dynamics do not depend on θ on a stretch [θ₀, θ₁] (the whole of a steady segment) neither does anything else,
and θ is eliminated exactly: a deviation with form q has to decrease for every θ of the stretch at which it lies in the
shell, the worst of them has the largest drop. A single place of a curved path is a stretch too, with θ₀ = θ₁.

The functions work on floats, JAX arrays and exact numbers alike where no exponential is taken.
"""

import abc
import math
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from cfjax.coerce import one_of
from cfjax.problem.vehicle import Scalar


LEAST_CHANGE = 1e-3  # of rate · duration, where the funnel has to shrink


def _exp(value: Scalar) -> Scalar:
    """NumPy's of plain numbers: JAX compiles a program for each shape that it has not met."""
    return jnp.exp(value) if isinstance(value, jax.Array) else np.exp(value)


class Template(abc.ABC):
    """One family of funnel functions; stateless. `rate` is c0 or k in 1/s, `duration` is T in s."""

    name: ClassVar[str]
    rate_name: ClassVar[str]  # its name in result.json

    @abc.abstractmethod
    def level(self, rate: Scalar, theta: Scalar) -> Scalar:
        """ρ(θ): the funnel at θ is {q ≤ ρ(θ)}."""

    @abc.abstractmethod
    def value(self, rate: Scalar, theta: Scalar, q: Scalar) -> Scalar:
        """V(θ, x) for q = xᵀ C x."""

    @abc.abstractmethod
    def scale(self, rate: Scalar, theta: Scalar) -> Scalar:
        """σ(θ) with V̇ = σ (q̇ + timing(q) u0)."""

    @abc.abstractmethod
    def timing(self, rate: Scalar, q: Scalar) -> Scalar:
        """The coefficient of u0 that the template adds to q̇."""

    @abc.abstractmethod
    def shell(self, rate: Scalar, begin: Scalar, end: Scalar, beta_inner: Scalar) -> tuple[Scalar, Scalar]:
        """Smallest and largest q that lie in the shell β_in ≤ V ≤ 1 at some θ ∈ [begin, end]."""

    @abc.abstractmethod
    def drop(self, rate: Scalar, begin: Scalar, end: Scalar, beta_lower: Scalar, q: Scalar) -> Scalar:
        """The largest min(1, V/β̲)/σ(θ) over the θ ∈ [begin, end] at which q lies in the shell.

        What is asked is q̇ + timing u0 ≤ −λ drop.
        """

    @abc.abstractmethod
    def change_bounds(self, beta_lower: float, may_grow: bool) -> tuple[float, float]:
        """Range of rate · duration that a learner may use; below zero the funnel grows."""

    @abc.abstractmethod
    def first_change(self, share: Scalar) -> Scalar:
        """A rate · duration to start from, for a share in [0, 1] of what is usual."""

    @abc.abstractmethod
    def reaching(self, rate: Scalar, q: Scalar, level: Scalar) -> Scalar:
        """The θ at which V = level for a deviation with form q; V is monotone in θ."""


class Paper(Template):
    """V = xᵀ C x + c0 θ, the paper's own."""

    name = "paper"
    rate_name = "c0"

    def level(self, rate: Scalar, theta: Scalar) -> Scalar:
        return 1 - rate * theta

    def value(self, rate: Scalar, theta: Scalar, q: Scalar) -> Scalar:
        return q + rate * theta

    def scale(self, rate: Scalar, theta: Scalar) -> Scalar:
        return 1 + 0 * rate * theta

    def timing(self, rate: Scalar, q: Scalar) -> Scalar:
        return rate + 0 * q

    def shell(self, rate: Scalar, begin: Scalar, end: Scalar, beta_inner: Scalar) -> tuple[Scalar, Scalar]:
        return beta_inner - jnp.maximum(rate * begin, rate * end), 1 - jnp.minimum(rate * begin, rate * end)

    def drop(self, rate: Scalar, begin: Scalar, end: Scalar, beta_lower: Scalar, q: Scalar) -> Scalar:
        return jnp.minimum(1.0, (q + jnp.maximum(rate * begin, rate * end)) / beta_lower)

    def change_bounds(self, beta_lower: float, may_grow: bool) -> tuple[float, float]:
        # c0 T has to stay below β̲, or the shell would hold x = 0, where V̇ = c0 u0 > 0
        return (-2.0 if may_grow else LEAST_CHANGE), beta_lower - 0.02

    def first_change(self, share: Scalar) -> Scalar:
        return 0.2 + 0.6 * share

    def reaching(self, rate: Scalar, q: Scalar, level: Scalar) -> Scalar:
        return (level - q) / rate


class Contracting(Template):
    """V = e^{kθ} xᵀ C x: the level sets shrink at a relative rate, so the last and smallest need not outrun it."""

    name = "contracting"
    rate_name = "rate"

    def level(self, rate: Scalar, theta: Scalar) -> Scalar:
        return _exp(-rate * theta)

    def value(self, rate: Scalar, theta: Scalar, q: Scalar) -> Scalar:
        return _exp(rate * theta) * q

    def scale(self, rate: Scalar, theta: Scalar) -> Scalar:
        return _exp(rate * theta)

    def timing(self, rate: Scalar, q: Scalar) -> Scalar:
        return rate * q

    def shell(self, rate: Scalar, begin: Scalar, end: Scalar, beta_inner: Scalar) -> tuple[Scalar, Scalar]:
        first, last = _exp(-rate * begin), _exp(-rate * end)
        return beta_inner * jnp.minimum(first, last), jnp.maximum(first, last)

    def drop(self, rate: Scalar, begin: Scalar, end: Scalar, beta_lower: Scalar, q: Scalar) -> Scalar:
        return jnp.minimum(q / beta_lower, jnp.maximum(_exp(-rate * begin), _exp(-rate * end)))

    def change_bounds(self, beta_lower: float, may_grow: bool) -> tuple[float, float]:
        return (-2.0 if may_grow else LEAST_CHANGE), 20.0

    def first_change(self, share: Scalar) -> Scalar:
        return 0.3 * (4.0 / 0.3) ** share

    def reaching(self, rate: Scalar, q: Scalar, level: Scalar) -> Scalar:
        return math.log(level / q) / rate


TEMPLATES: dict[str, Template] = {template.name: template for template in (Contracting(), Paper())}
"""Templates by name."""


def template_named(name: str) -> Template:
    """The template of that name; raises InputError with the list of names."""
    return TEMPLATES[one_of("template", name, TEMPLATES)]
