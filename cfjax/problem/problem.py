"""The path segment following problem (paper, Definition "Path Segment Following Problem"), checked when it is made."""

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cfjax import coerce
from cfjax.coerce import Number, Numbers
from cfjax.errors import InputError, renamed
from cfjax.problem.corridor import walls_of
from cfjax.problem.deviation import (
    FEW,
    ReferencePoint,
    affine_deviation,
    held,
)
from cfjax.problem.feedback import FeedbackLaw, LawContext, Steered
from cfjax.problem.obstacles import FootprintDisc, Obstacle, footprint_of, obstacles_of
from cfjax.problem.path import Path
from cfjax.problem.room import nearest, require_clear
from cfjax.problem.sets import Box, Ellipsoid, box, ellipsoid
from cfjax.problem.tube import Tube
from cfjax.problem.vehicle import Interval, KinematicBicycle, Twist, Vehicle, interval


TIMING = Interval(0.5, 2.0)  # of u0, unless somebody says another
FOLLOWS = 1e-9  # relative: inputs that leave less than this of the reference's rate hold the vehicle on it
PLACES = 201  # per segment, at which what the reference needs is looked at


class Method(enum.Enum):
    """Path following leaves the timing input u0 free in its interval, trajectory tracking fixes it at 1."""

    PF = "pf"
    TT = "tt"

    @classmethod
    def _missing_(cls, value: object) -> "Method":
        return coerce.choice("method", value, cls)

    @property
    def words(self) -> str:
        """The method in words, with its letters."""
        return {"pf": "path following (PF)", "tt": "trajectory tracking (TT)"}[self.value]


@dataclass(frozen=True)
class Problem:
    """Find a timing law and a feedback law that lead the vehicle along the path: from I to G, inside S, within inputs.

    Deviations (alpha, x, y, v): heading in rad, lateral and longitudinal position in m, speed in m/s, in the body frame
    of the reference; of a vehicle of one's own its `state_names`.

    >>> from cfjax import circle
    >>> problem = Problem(circle(radius=1.5, speed=1.0), inlet=0.5, goal=0.5, safe=[1.0, 1.0, 1.0, 3.0], method="tt")
    >>> problem.inputs[0]
    Interval(lower=1.0, upper=1.0)
    >>> Problem(circle(radius=0.3), inlet=0.5)  # tighter than the car can steer
    Traceback (most recent call last):
    cfjax.errors.InputError: path: segment 0 at theta = 0 s needs steering angle 48.58°, limit 45° ...

    Args:
        path: what to follow: of `cfjax.circle`, `cfjax.waypoints` and the like.
        inlet: I, where the car may start, at the path's start; of a tube, anywhere. An `Ellipsoid`, or its half-axes,
            one per state in the state's unit, or a number, the radius of a ball.
        goal: G, where the car has to end, at the path's end; of a tube, everywhere. As `inlet`.
        safe: S, where the car has to stay at every θ: a `Box`, or its half-widths, one per state in the state's unit;
            None for no limit.
        obstacles: S too: the footprint, wherever the vehicle is, touches none of them. A list of `Disc` and `Polygon`,
            m, in the frame of the path.
        footprint: the discs that stand for the vehicle's body, each [radius, offset along the forward axis], m; only
            obstacles ask for it.
        vehicle: what drives, with the limits of its inputs.
        method: "pf", path following, with the timing u0 free; "tt", trajectory tracking, with u0 = 1.
        timing: the interval of u0 for "pf", [lower, upper] around 1, seconds of reference time per second of the clock;
            "tt" has none to choose.
        corridor: S too: walls left and right of the path, which become obstacles (`cfjax.problem.corridor.walls_of`): a
            half-width (m), {"left": …, "right": …} with half-widths, points or files of points, or "file" for the
            widths in the path's own file.
        input_share: the share of the input range that a law may use, above 0 and at most 1: how far it may go from what
            the reference needs towards each limit.
        law: the feedback law that gives the vehicle's inputs, limited to their intervals; u0 stays as `method` has it.
            None: V is to fall with the best inputs.

    Raises:
        InputError: where the question cannot be asked: values of another kind, wrong dimensions, a reference that the
            vehicle cannot follow even without deviation, sets that exclude each other.
    """

    path: Path
    inlet: Ellipsoid
    goal: Ellipsoid | None
    safe: Box | None
    obstacles: tuple[Obstacle, ...]
    footprint: tuple[FootprintDisc, ...]
    vehicle: Vehicle
    method: Method
    timing: Interval
    input_share: float
    law: FeedbackLaw | None

    def __init__(
        self,
        path: Path,
        inlet: Ellipsoid | Number | Numbers = 0.5,
        goal: Ellipsoid | Number | Numbers | None = 0.5,
        safe: Box | Number | Numbers | None = None,
        obstacles: Sequence[Obstacle | Mapping] | Numbers = (),
        footprint: Sequence[FootprintDisc] | Numbers = (FootprintDisc(),),
        vehicle: Vehicle = KinematicBicycle(),
        method: Method | str = Method.PF,
        timing: Interval | Numbers = TIMING,
        input_share: Number = 1.0,
        corridor: object = None,
        law: FeedbackLaw | None = None,
        *,
        authority: Number | None = None,  # the former name of `input_share`
    ) -> None:
        if authority is not None:
            renamed("authority", "input_share")
            input_share = authority
        states = coerce.instance("vehicle", vehicle, Vehicle).state_names
        coerce.keep(
            self,
            path=coerce.instance("path", path, Path),
            inlet=ellipsoid("sets.inlet", inlet, states),
            goal=None if goal is None else ellipsoid("sets.goal", goal, states),
            safe=None if safe is None else box("sets.safe", safe, states),
            obstacles=(*obstacles_of(obstacles), *walls_of(corridor, path)),
            footprint=footprint_of(footprint),
            vehicle=vehicle,
            method=coerce.choice("method", method, Method),
            timing=interval("timing", timing),
            input_share=coerce.number("input_share", input_share, above=0, most=1),
            law=coerce.optional("law", law, FeedbackLaw),
        )
        self._check_sets()
        if self.path.tube:
            self._check_tube(self.path.tube)
        elif self.goal is None:
            coerce.refuse("sets.goal", "a number or half-axes for a path, which ends", None)
        self._check_references()
        self._check_obstacles()
        if self.law is not None:
            context = LawContext(self.vehicle, self.path.steady_reference, self.inputs, self.inlet.half_axes)
            coerce.keep(self, law=self.law.fitted(context))

    def _check_sets(self) -> None:
        states, heading = self.vehicle.state_names, self.inlet.half_axes[0]
        if heading >= np.pi:
            degrees = f"; {heading:g} degrees are {np.radians(heading):.4g} rad" if heading < 180 else ""
            raise InputError(f"sets.inlet: expected a heading below pi rad, got {heading}{degrees}")
        if self.timing.lower <= 0 or 1.0 not in self.timing:
            coerce.refuse("timing", "0 < lower <= 1 <= upper", [self.timing.lower, self.timing.upper])
        if self.safe:
            for state, start, limit in zip(states, self.inlet.half_axes, self.safe.half_widths, strict=True):
                if start >= limit:
                    raise InputError(
                        f"sets.inlet: reaches {start} in {state}, but sets.safe, around it, ends at {limit}"
                    )

    @property
    def driven(self) -> Vehicle:
        """The vehicle with its law, where there is one."""
        return self.vehicle if self.law is None else Steered(self.vehicle, self.law)

    @property
    def inputs(self) -> tuple[Interval, ...]:
        """The input box (u0, *vehicle inputs) that a law may use; u0 = 1 for trajectory tracking.

        With an `input_share` below 1 the box is that much smaller, around what the reference needs along the path.
        Inputs that stay closer to it change the rate of V less, and may be held longer.
        """
        timing = {Method.PF: self.timing, Method.TT: Interval(1.0, 1.0)}[self.method]
        limits = (timing, *self.vehicle.input_box)
        if self.input_share == 1:
            return limits
        return tuple(
            Interval(low - self.input_share * (low - box.lower), high + self.input_share * (box.upper - high))
            for box, (low, high) in zip(limits, self._needed, strict=True)
        )

    @cached_property
    def _needed(self) -> tuple[tuple[float, float], ...]:
        """The least and the largest of each input that the reference needs by itself, along the path."""
        points = [point for segment in self.path.distinct for point in segment.samples(PLACES)]
        if len(points) > FEW:
            inputs, *_ = held(self.vehicle, np.array(points, float))
            needed = np.concatenate([np.ones((len(points), 1)), inputs], axis=1)
        else:
            needed = np.array([self.feedforward(point) for point in points])
        return tuple(
            (float(low), float(high)) for low, high in zip(needed.min(axis=0), needed.max(axis=0), strict=True)
        )

    @property
    def goal_axes(self) -> tuple[float, ...]:
        """Half-axes of G in the states' units; infinite where none is asked."""
        return self.goal.half_axes if self.goal else (math.inf,) * self.dimension

    @property
    def dimension(self) -> int:
        return len(self.vehicle.state_names)

    def feedforward(self, point: ReferencePoint) -> np.ndarray:
        """Inputs (1, u_r) that hold the vehicle on a reference with this profile, by least squares.

        Raises:
            InputError: where no inputs do: the reference is no motion of this vehicle.
        """
        point = ReferencePoint(*coerce.numbers("point", coerce.instance("point", point, ReferencePoint)))
        drift, columns = map(np.asarray, affine_deviation(self.vehicle, np.zeros(self.dimension), point))
        rest = drift + columns[:, 0]
        if not (np.isfinite(rest).all() and np.isfinite(columns).all()):
            raise InputError(
                f"path: expected speeds and turning rates whose motion can be computed, got {point.speed:.4g} m/s and "
                f"{point.turn_rate:.4g} rad/s"
            )
        u, *_ = np.linalg.lstsq(columns[:, 1:], -rest, rcond=None)
        left = np.abs(rest + columns[:, 1:] @ u).max()
        if left > FOLLOWS * max(1.0, np.abs(rest).max()):
            raise InputError(
                f"path: a reference of turning rate {point.turn_rate:.4g} rad/s and speed {point.speed:.4g} m/s is no "
                f"motion of the vehicle {self.vehicle.name}: its best inputs leave a rate of {left:.3g}"
            )
        return np.concatenate([[1.0], u])

    @cached_property
    def side_slip(self) -> float:
        """By how much the vehicle that moves along the path looks to the left of the path's tangent, rad."""
        moving = (point for segment in self.path.segments for point in segment.samples(PLACES) if point.speed)
        return next(map(self._side_slip, moving), 0.0)

    def _side_slip(self, point: ReferencePoint) -> float:
        """Of the vehicle's reference; it has to move at the path's speed and turn at its rate.

        Raises:
            InputError: where it does not.
        """
        twist = Twist(*(float(each) for each in self.vehicle.reference(point.turn_rate, point.speed)[0]))
        speed = math.copysign(math.hypot(twist.lateral, twist.forward), point.speed)
        apart = max(abs(speed - point.speed), abs(twist.turn - point.turn_rate))
        if not apart <= FOLLOWS * max(1.0, abs(point.speed), abs(point.turn_rate)):
            raise InputError(
                f"vehicle {self.vehicle.name}: expected a reference that moves along the path, at {point.speed:.4g} "
                f"m/s and {point.turn_rate:.4g} rad/s; got one at {speed:.4g} m/s and {twist.turn:.4g} rad/s"
            )
        way = math.copysign(1.0, point.speed)
        return math.atan2(way * twist.lateral, way * twist.forward)

    def _check_side_slip(self, place: str, point: ReferencePoint) -> None:
        """The reference's heading is the tangent's but for one angle: with another one it would not be its motion."""
        slip = self._side_slip(point)
        if point.speed and abs(slip - self.side_slip) > FOLLOWS:  # what stands still moves at no angle
            raise InputError(
                f"path: {place} has the vehicle {self.vehicle.name} look {slip:.4g} rad away from the path's tangent, "
                f"and {self.side_slip:.4g} rad where it begins; expected one angle all along, as on a straight line or "
                "a circle"
            )

    def _check_references(self) -> None:
        """Along all segments: what is not as it has to be is named at the first place where it is not."""
        first = dict(zip(reversed(self.path.kinds), reversed(tuple(enumerate(self.path.curve))), strict=False))
        places = [
            (index, theta, point)
            for index, segment in sorted(first.values(), key=lambda each: each[0])
            for theta, point in zip(segment.places(PLACES), segment.samples(PLACES), strict=True)
        ]
        for at in self._doubtful([point for *_, point in places]):
            index, theta, point = places[at]
            self._check_side_slip(f"segment {index} at theta = {theta:.4g} s", point)
            if excess := self._excess(point):
                turning = f" (radius there: {abs(point.speed / point.turn_rate):.4g} m)" if point.turn_rate else ""
                raise InputError(f"path: segment {index} at theta = {theta:.4g} s needs {excess}{turning}")

    def _doubtful(self, points: Sequence[ReferencePoint]) -> Sequence[int]:
        """Those of the references that the vehicle may not follow within its inputs; all of them if they are few."""
        if len(points) <= FEW:
            return range(len(points))
        table = np.array(points, float)
        inputs, left, size, twist = held(self.vehicle, table)
        box = np.array([(limits.lower, limits.upper) for limits in self.vehicle.input_box]).reshape(-1, 2)
        turning, speed = table[:, 0], table[:, 1]
        turn, lateral, forward = twist.T
        apart = np.maximum(np.abs(np.copysign(np.hypot(lateral, forward), speed) - speed), np.abs(turn - turning))
        way = np.copysign(1.0, speed)
        slip = np.where(speed != 0, np.abs(np.arctan2(way * lateral, way * forward) - self.side_slip), 0.0)
        good = (
            (left <= FOLLOWS * np.maximum(1.0, size))
            & (apart <= FOLLOWS * np.maximum(1.0, np.maximum(np.abs(speed), np.abs(turning))))
            & (slip <= FOLLOWS)
            & ((box[:, 0] <= inputs) & (inputs <= box[:, 1])).all(axis=1)
        )  # not so where a number is none
        return np.flatnonzero(~good).tolist()

    def _check_tube(self, tube: Tube) -> None:
        """Every path of a tube can be followed if the extreme ones can: feed-forward is monotone in each bound."""
        for state, start, end in zip(self.vehicle.state_names, self.inlet.half_axes, self.goal_axes, strict=True):
            if start >= end:
                raise InputError(
                    f"sets.goal: expected more than sets.inlet, {start}, in {state}, for a tube that holds I "
                    f"and lies in G does not shrink; got {end}"
                )
        if self.obstacles:
            raise InputError("sets.obstacles: expected none for a tube, which has no place")
        for group in tube.references():
            for point in group:
                straight = point._replace(turn_rate=0.0)
                self._check_side_slip(f"curvature {point.turn_rate / point.speed:.4g} 1/m of the tube", point)
                if excess := self._excess(straight):
                    raise InputError(f"path.acceleration: {point.speed_slope:g} m/s² needs {excess}")
                if excess := self._excess(point):
                    largest = self._largest_curvature(point)
                    raise InputError(
                        f"path.curvature: expected at most {largest:.4g} 1/m either way, which is what this vehicle's "
                        f"inputs allow; {point.turn_rate / point.speed:g} 1/m needs {excess}"
                    )

    def _check_obstacles(self) -> None:
        """The reference itself has to clear every obstacle, or nothing that surrounds it does."""
        if self.obstacles and self.side_slip:
            raise InputError(
                f"sets.obstacles: expected none for the vehicle {self.vehicle.name}, which looks "
                f"{self.side_slip:.4g} rad away from the path's tangent"
            )
        require_clear(self.path, self.obstacles, self.footprint)

    @cached_property
    def room(self) -> float:
        """The least distance (m) from the body to an obstacle while the vehicle is on its reference; inf without one.

        Looked at in places of each segment (`cfjax.problem.room`).
        """
        return min((near.room for near in nearest(self.path, self.obstacles, self.footprint)), default=np.inf)

    def _excess(self, point: ReferencePoint) -> str:
        """The input that leaves its limits where the vehicle follows this reference without deviation; or nothing."""
        inputs = self.feedforward(point)[1:]
        for name, value, limits in zip(self.vehicle.input_names, inputs, self.vehicle.input_box, strict=True):
            if value not in limits:
                return self.vehicle.beyond(name, value, limits)
        return ""

    def _largest_curvature(self, point: ReferencePoint) -> float:
        """Between zero and the point's, by bisection, in absolute value: rounded down to four digits."""
        low, high = 0.0, point.turn_rate
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self._excess(point._replace(turn_rate=middle)) else (middle, high)
        largest = abs(low / point.speed)
        digits = 3 - math.floor(math.log10(largest)) if largest else 0
        return math.floor(largest * 10**digits) / 10**digits
