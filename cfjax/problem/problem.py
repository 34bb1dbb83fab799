"""The path segment following problem (paper, Definition "Path Segment Following Problem"), checked when it is made."""

import enum
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np

from cfjax.errors import InputError
from cfjax.problem.deviation import affine_deviation
from cfjax.problem.path import Path, Segment
from cfjax.problem.sets import Box, Ellipsoid, ball
from cfjax.problem.vehicle import Interval, KinematicBicycle, Vehicle


FOLLOWS = 1e-9  # relative: inputs that leave less than this of the reference's rate hold the vehicle on it


class Method(enum.Enum):
    """Path following leaves the timing input u0 free in its interval, trajectory tracking fixes it at 1."""

    PF = "pf"
    TT = "tt"


@dataclass(frozen=True)
class Problem:
    """Find a timing law and a feedback law that lead the vehicle along the path: from I to G, inside S, within inputs.

    Raises:
        InputError: where the question cannot be asked: wrong dimensions, a reference that the vehicle cannot follow
            even without deviation, sets that exclude each other.
    """

    path: Path
    inlet: Ellipsoid = field(default_factory=lambda: ball(0.5))  # I, at θ = 0 of each segment
    goal: Ellipsoid = field(default_factory=lambda: ball(0.5))  # G, at θ = T
    safe: Box | None = None  # S, at every θ
    vehicle: Vehicle = field(default_factory=KinematicBicycle)
    method: Method = Method.PF
    timing: Interval = Interval(0.5, 2.0)  # u0 for PF; TT has u0 = 1 whatever stands here

    def __post_init__(self) -> None:
        states = self.vehicle.state_names
        for label, values in (
            ("sets.inlet", self.inlet.half_axes),
            ("sets.goal", self.goal.half_axes),
            ("sets.safe", self.safe.half_widths if self.safe else states),
        ):
            if len(values) != len(states):
                raise InputError(
                    f"{label}: expected {len(states)} numbers, one per state ({', '.join(states)}), got {len(values)}"
                )
        if self.inlet.half_axes[0] >= np.pi:
            raise InputError(f"sets.inlet: expected a heading below pi rad, got {self.inlet.half_axes[0]}")
        if self.timing.lower <= 0 or 1.0 not in self.timing:
            raise InputError(
                f"timing: expected 0 < lower <= 1 <= upper, got [{self.timing.lower}, {self.timing.upper}]"
            )
        if self.safe:
            for state, start, limit in zip(states, self.inlet.half_axes, self.safe.half_widths, strict=True):
                if start >= limit:
                    raise InputError(
                        f"sets.inlet: reaches {start} in {state}, but sets.safe, around it, ends at {limit}"
                    )
        for index, segment in enumerate(self.path.segments):
            self._check_reference(index, segment)

    @property
    def inputs(self) -> tuple[Interval, ...]:
        """The input box (u0, *vehicle inputs); u0 = 1 for trajectory tracking."""
        timing = Interval(1.0, 1.0) if self.method is Method.TT else self.timing
        return (timing, *self.vehicle.input_box)

    @property
    def dimension(self) -> int:
        return len(self.vehicle.state_names)

    def feedforward(self, segment: Segment, theta: float) -> np.ndarray:
        """Inputs (1, u_r) that hold the vehicle on the reference at θ, by least squares.

        Raises:
            InputError: where no inputs do: the reference is no motion of this vehicle.
        """
        drift, columns = affine_deviation(self.vehicle, jnp.zeros(self.dimension), segment.point(theta))
        rest = np.asarray(drift + columns[:, 0])
        u, *_ = np.linalg.lstsq(np.asarray(columns[:, 1:]), -rest, rcond=None)
        left = np.abs(rest + np.asarray(columns[:, 1:]) @ u).max()
        if left > FOLLOWS * max(1.0, np.abs(rest).max()):
            raise InputError(
                f"path: the reference at theta = {theta:.4g} s is no motion of the vehicle {self.vehicle.name}: "
                f"its best inputs leave a rate of {left:.3g}"
            )
        return np.concatenate([[1.0], u])

    def _check_reference(self, index: int, segment: Segment) -> None:
        grid = [0.0] if segment.is_steady else np.linspace(0.0, segment.duration, 201)
        for theta in grid:
            point, inputs = segment.point(float(theta)), self.feedforward(segment, float(theta))
            for name, value, limits in zip(self.vehicle.input_names, inputs[1:], self.vehicle.input_box, strict=True):
                if value not in limits:
                    turning = f" (radius there: {abs(point.speed / point.turn_rate):.4g} m)" if point.turn_rate else ""
                    raise InputError(
                        f"path: segment {index} at theta = {theta:.4g} s needs {name} = {value:.4g}, but the vehicle's "
                        f"{name} lies in [{limits.lower:g}, {limits.upper:g}]{turning}"
                    )
