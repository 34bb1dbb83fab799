"""Feedback laws that people use, each written once: what is proven of a law, learned for it and driven is this.

A law gives the vehicle's inputs as functions of the deviation and the reference; outside its limits an input is at the
nearer limit, u_i = clip(k_i(x, reference), lower_i, upper_i). u0 = dθ/dt is no part of it: with trajectory tracking it
is 1, with path following some u0 of its interval is chosen beside the law.

Functions take and return scalars, as a vehicle's do (`cfjax.problem.vehicle`), and are traced into the graph that a
certificate carries: sums, products, quotients, sin, cos, tan and square roots.
"""

import abc
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from cfjax import coerce
from cfjax.coerce import Numbers
from cfjax.errors import InputError
from cfjax.problem.deviation import ReferencePoint, affine_deviation, feedforward
from cfjax.problem.vehicle import Interval, Scalar, Twist, Vehicle


DIGITS = 4  # of a gain that is computed: people read it, and a short number is proven faster


class LawContext(NamedTuple):
    """What a law is for, as far as it may fit itself to it."""

    vehicle: Vehicle
    reference: ReferencePoint | None  # of a path that is one straight line or one circle; None of another one
    inputs: tuple[Interval, ...]  # u0 first
    widths: tuple[float, ...]  # half-axes of I, by state


class FeedbackLaw(abc.ABC):
    """The vehicle's inputs as functions of the deviation."""

    name: ClassVar[str]
    keeps_time: ClassVar[bool] = True  # whether it knows θ; another one needs a timing that is free

    @abc.abstractmethod
    def inputs(self, vehicle: Vehicle, x: Sequence[Scalar], reference: ReferencePoint) -> tuple[Scalar, ...]:
        """The inputs in the order of `vehicle.input_names`, before they are limited.

        `x` is the deviation in the units of the states. Of the reference a proof allows turning rate, speed and
        `speed_slope`.
        """

    def fitted(self, context: LawContext) -> "FeedbackLaw":
        """The law with what it takes from the question, a gain say.

        Raises:
            InputError: it is no law for this problem.
        """
        return self


@dataclass(frozen=True)
class LinearLaw(FeedbackLaw):
    """u = u_r + K x, u_r being the inputs that hold the reference: of paths that are one straight line or one circle.

    Args:
        gain: K, a row for each of the vehicle's inputs, a column for each state, in the units of both. None: the
            linear-quadratic regulator about the reference, where each state costs as much at its half-axis of I as
            each input at half the width of its interval; the timing u0 is an input of it where it is free.
        centre: u_r; None: computed for the problem.

    Raises:
        InputError: for what is no such matrix.
    """

    gain: Sequence[Sequence[float]] | None = None
    centre: Sequence[float] | None = None

    name: ClassVar[str] = "linear"

    def __init__(self, gain: Numbers | None = None, centre: Numbers | None = None) -> None:
        rows = None if gain is None else coerce.array("law.gain", gain, (None, None)).tolist()
        rest = None if centre is None else coerce.array("law.centre", centre, (None,)).tolist()
        coerce.keep(self, gain=rows and tuple(map(tuple, rows)), centre=rest and tuple(rest))

    def inputs(self, vehicle: Vehicle, x: Sequence[Scalar], reference: ReferencePoint) -> tuple[Scalar, ...]:
        assert self.gain is not None and self.centre is not None  # `fitted` has set them
        return tuple(
            rest + sum(k * xi for k, xi in zip(row, x, strict=True))
            for rest, row in zip(self.centre, self.gain, strict=True)
        )

    def fitted(self, context: LawContext) -> "LinearLaw":
        if context.reference is None:
            raise InputError("law=linear: expected a path that is one straight line or one circle")
        gain = _regulator(context, context.reference) if self.gain is None else self.gain
        centre = _holding(context.vehicle, context.reference)[1:] if self.centre is None else self.centre
        count = len(context.vehicle.input_names)
        coerce.array("law.gain", gain, (count, len(context.widths)))
        coerce.array("law.centre", centre, (count,))
        return replace(self, gain=gain, centre=centre)


def _holding(vehicle: Vehicle, point: ReferencePoint) -> tuple[float, ...]:
    """Inputs (1, u_r) that hold the vehicle on the reference."""
    return tuple(float(entry) + 0.0 for entry in feedforward(vehicle, point))  # no −0


def _regulator(context: LawContext, point: ReferencePoint) -> tuple[tuple[float, ...], ...]:
    """K of the linear-quadratic regulator about the reference; u0 is one of its inputs where it is free.

    Raises:
        InputError: there is none: the linearised vehicle is not stabilisable.
    """
    import scipy.linalg  # brought only where it is needed, as curves bring it

    vehicle, size, width = context.vehicle, len(context.widths), np.array(context.widths)
    centre = np.array(_holding(vehicle, point))
    _, columns = affine_deviation(vehicle, np.zeros(size), point)
    step = 1e-6 * width

    def rate(x: np.ndarray) -> np.ndarray:
        drift, columns = affine_deviation(vehicle, x, point)
        return np.asarray(drift) + np.asarray(columns) @ centre

    a = np.stack([(rate(e) - rate(-e)) / (2 * h) for e, h in zip(np.diag(step), step, strict=True)], axis=1)
    half = np.array([limits.half for limits in context.inputs])
    free = half > 0
    b = np.asarray(columns)[:, free]
    try:
        cost = scipy.linalg.solve_continuous_are(a, b, np.diag(width**-2.0), np.diag(half[free] ** -2.0))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise InputError(
            f"law.gain: expected a gain, for the vehicle about its reference has no linear-quadratic regulator: {error}"
        ) from None
    gain = np.zeros((len(half), size))
    gain[free] = -(half[free, None] ** 2) * (b.T @ cost)
    gain[np.abs(gain) * width < 1e-6 * half[:, None]] = 0.0  # what only rounding leaves
    return tuple(tuple(float(f"{entry:.{DIGITS}g}") for entry in row) for row in gain[1:])


@dataclass(frozen=True)
class Steered(Vehicle):
    """A vehicle whose inputs a law gives: beside its own definition it has the law's function, `feedback`."""

    vehicle: Vehicle
    law: FeedbackLaw

    def __post_init__(self) -> None:
        own = self.vehicle
        coerce.keep(self, name=own.name, internal_names=own.internal_names, input_names=own.input_names)

    @property
    def input_box(self) -> tuple[Interval, ...]:
        return self.vehicle.input_box

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        return self.vehicle.twist(internal, inputs)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        return self.vehicle.internal_rate(internal, inputs)

    def reference(self, turn_rate: Scalar, speed: Scalar) -> tuple[Twist, tuple]:
        return self.vehicle.reference(turn_rate, speed)

    def feedback(self, x: Sequence[Scalar], reference: ReferencePoint) -> tuple[Scalar, ...]:
        """What the law says, before it is limited."""
        return self.law.inputs(self.vehicle, x, reference)
