"""From a map to a certified path: search, smooth, prove; and where the proof fails, plan around what was in the way."""

import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File
from time import perf_counter as clock
from typing import TYPE_CHECKING

import numpy as np

from cfjax.coerce import Number, Numbers, instances, number, numbers, optional, text, whole
from cfjax.errors import InputError
from cfjax.lazy import public
from cfjax.planner.bends import Bends
from cfjax.planner.dubins import Arcs
from cfjax.planner.field import Field, field_of
from cfjax.planner.map import Map
from cfjax.planner.map_file import read_map
from cfjax.planner.room import Limits, limits_of
from cfjax.planner.search import COARSE_GRAIN, FINE_GRAIN, Grain, Node, NoWay, Search
from cfjax.planner.smooth import smoothed
from cfjax.planner.widest import widest_gap
from cfjax.problem import FootprintDisc, KinematicBicycle, Path, Pose, Vehicle
from cfjax.problem.frames import QUARTER, RosPose, pose_from_ros
from cfjax.problem.obstacles import footprint_of
from cfjax.problem.path import speed_of
from cfjax.tubes import CertifiedTube, Following, follow, library, write_chain


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# lengths in radii of the tightest bend
GRID = 0.2  # between the nodes of the distance field
SOFT = 0.6  # beside obstacles, wherever there is room
SPARE = 0.06  # beside obstacles, more than the tube needs, where the path is smoothed
AROUND = 8.0  # around start, goal and obstacles of a map without bounds
GROWTH = 0.1  # of an obstacle that was in the way
LONGEST_PIECE = 0.6
MOST_CELLS = 4_000_000  # of the distance field: a larger map has a coarser one
SEARCHED = 0.9  # of the curvature that a path may have is what the search uses
CHECKED = 4  # places of a piece at which clearance is looked at, before it is proven


class Unproven(InputError):
    """A way was found, for the body in its tube, and none was proven."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A path between two poses that is proven to be clear of a map's obstacles, wherever in its tubes the car is.

    `following` is the proof; `spare` by how much (m) the body in its tube is farther from all obstacles than it has to
    be, where it is least, at `place` (x, y), beside `beside`. `seconds` has the times of search, smoothing and proof,
    of all attempts together.
    """

    following: Following
    map: Map
    start: Pose
    goal: Pose
    footprint: tuple[FootprintDisc, ...]
    spare: float
    place: tuple[float, float]
    beside: str
    attempts: int
    seconds: dict[str, float]

    @property
    def path(self) -> Path:
        """The path that is certified."""
        return self.following.path

    def write(self, path: str | File) -> None:
        """Write the certificate, which `python -m cfjax.check FILE` replays.

        Raises:
            InputError: for what is no file's name; OSError where it cannot be written.
        """
        write_chain(self.following, path)

    def plot(self, axes: "Axes | None" = None, width: str | float | None = None) -> "Figure":
        """A Matplotlib figure of map, path, tubes and body: `cfjax.plot`."""
        return public("plot")(self, None, axes, width)

    def describe(self) -> str:
        """At most ten lines for people."""
        length = float(self.following.reference.length)
        took = ", ".join(f"{label} {1000 * value:.0f} ms" for label, value in self.seconds.items())
        again = f", {self.attempts} attempts" if self.attempts > 1 else ""
        beside = "no obstacles"
        if self.beside:
            beside = f"{1000 * self.spare:.0f} mm to spare beside {self.beside} at {_at(complex(*self.place))}"
        first = f"plan in {self.map.source}: {length:.4g} m, {beside} ({took}{again})"
        return "\n".join([first, *self.following.describe().splitlines()[1:]])

    def __str__(self) -> str:
        return self.describe()

    def __repr__(self) -> str:
        return f"<{self.describe().splitlines()[0]}>"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.describe())}</pre>"


def plan(
    map: Map | Sequence | str | File,
    start: Numbers | None = None,
    goal: Numbers | None = None,
    *,
    vehicle: Vehicle | None = None,
    footprint: Sequence[FootprintDisc] | Numbers = (FootprintDisc(),),
    tubes: Sequence[CertifiedTube] | None = None,
    speed: Number = 2.0,
    lateral_acceleration: Number = 4.0,
    attempts: int = 5,
    name: str = "plan",
) -> Plan:
    """A certified path through a map, from one pose to another, driven forwards.

    It is planned with the body grown by the shadow of the narrowest tubes, and proven by `cfjax.follow`. Where the
    proof fails, the obstacle that is in the way is grown and the path planned again. The same question has the same
    answer every time.

    Args:
        map: obstacles and bounds, m; or the name of a file (`read_map`), or a list of obstacles.
        start: a `Pose`, a `RosPose`, or [x, y, heading] (m and rad, 0 along +y) in the frame of the map; None: its own.
        goal: the pose at the end, likewise.
        vehicle: what drives; None: the Parkour car.
        footprint: discs [radius, offset along the forward axis] that stand for its body, m.
        tubes: those that may be used; None: those of the package for the vehicle.
        speed: the most that is driven, m/s; in bends less.
        lateral_acceleration: the most in bends, m/s².
        attempts: how often it is planned.
        name: of the path.

    Raises:
        InputError: for a start or goal outside the map or too near to an obstacle, where there is no way, and where
            none is proven: which obstacle is in the way, where, and by how much.
    """
    map = map if isinstance(map, Map) else read_map(map) if isinstance(map, str | File) else Map(map)
    optional("vehicle", vehicle, Vehicle)
    discs, speed, name = footprint_of(footprint), speed_of(speed), text("name", name)
    lateral = number("lateral_acceleration", lateral_acceleration, "m/s²", above=0)
    attempts = whole("attempts", attempts, 1)
    car = KinematicBicycle() if vehicle is None else vehicle
    offered = library(car) if tubes is None else instances("tubes", tubes, CertifiedTube)
    if not offered:
        raise InputError("tubes: expected at least one for the vehicle, got none")
    poses = _pose("start", start, map.start), _pose("goal", goal, map.goal)
    limits = limits_of(offered, speed, lateral, discs)
    question = _Question(map, _node(poses[0]), _node(poses[1]), limits)
    question.check_ends()
    seconds = {"search": 0.0, "smooth": 0.0, "proof": 0.0}
    grown, refused = np.zeros(len(map.obstacles)), ""
    for attempt in range(1, attempts + 1):
        bends = question.way(grown, refused, seconds)
        began = clock()
        try:
            following = follow(
                bends.path(name, speed, lateral, limits.acceleration),
                tubes,
                vehicle=vehicle,
                obstacles=map.obstacles,
                footprint=discs,
            )
        except InputError as error:
            spare, place, nearest = question.least(bends)
            if not spare < SOFT / limits.curvature:
                raise
            said = re.sub(r"obstacle (\d+)", lambda found: map.labels[int(found[1])], str(error))
            refused = f"{map.labels[nearest]} is in the way at {_at(place)}: {said}"
            grown[nearest] += GROWTH / limits.curvature
            continue
        finally:
            seconds["proof"] += clock() - began
        spare, place, nearest = question.least(bends)
        beside = map.labels[nearest] if nearest >= 0 else ""
        return Plan(following, map, *poses, discs, spare, (place.real, place.imag), beside, attempt, seconds)
    raise Unproven(f"{map.source}: no path was proven in {attempts} attempts; {refused}")


def _pose(name: str, value: object, known: Pose | None) -> Pose:
    if value is None and known is None:
        raise InputError(f"{name}: expected a pose [x, y, heading], which the map does not have, got none")
    value = known if value is None else value
    if isinstance(value, RosPose):
        value = pose_from_ros(value)
    if isinstance(value, Pose):
        return Pose(*numbers(name, value, "a pose (heading in rad, x and y in m)", count=3))
    x, y, heading = numbers(name, value, "a pose [x, y, heading] (m and rad)", count=3)
    return Pose(heading, x, y)


def _node(pose: Pose) -> Node:
    return complex(pose.x, pose.y), pose.alpha + QUARTER


@dataclass(frozen=True, eq=False)
class _Question:
    """Which way leads from start to goal with so much room."""

    map: Map
    start: Node
    goal: Node
    limits: Limits

    def check_ends(self) -> None:
        """Raises InputError where the body in its tube cannot stand at the start or at the goal."""
        for name, (place, direction) in (("start", self.start), ("goal", self.goal)):
            if self.map.bounds is not None and (outside := _outside(self.map.bounds, place)) > 0:
                left, bottom, right, top = self.map.bounds
                raise InputError(
                    f"{name}: expected a place in {self.map.source}, [{left:g}, {right:g}] x [{bottom:g}, {top:g}] m, "
                    f"got {_at(place)}, {outside:.3g} m outside"
                )
            spare, _, nearest = self._least(np.array([place]), np.array([direction]))
            if spare < 0:
                raise InputError(
                    f"{name}: expected a place where the body in its tube touches nothing, got {_at(place)} with "
                    f"{-spare:.3g} m too little beside {self.map.labels[nearest]} of {self.map.source}"
                )

    def way(self, grown: np.ndarray, refused: str, seconds: dict[str, float]) -> Bends:
        """A way that is clear as far as samples tell, its curvature continuous if such a one is found.

        Raises:
            InputError: where there is none; `refused` says why an earlier one would not do.
        """
        began = clock()
        limits, radius = self.limits, 1 / (SEARCHED * self.limits.curvature)
        field = self._field(grown, radius)

        def arcs_by(grain: Grain) -> Arcs:
            return Search(field, limits.body, self.goal, 1 / radius, SOFT * radius, grain).way(self.start)

        try:
            try:
                arcs = arcs_by(COARSE_GRAIN)
            except NoWay:
                arcs = arcs_by(FINE_GRAIN)
        except NoWay as error:
            if refused:
                raise Unproven(f"{self.map.source}: no path was proven, and there is no other; {refused}") from None
            raise InputError(f"{self.map.source}: {self._why(field, error)}") from None
        seconds["search"] += clock() - began
        began = clock()
        found = smoothed(arcs, self.start, self.goal, field, limits.body, radius, SPARE * radius)
        if found is None or found.sharpest > limits.curvature or self.least(found)[0] < 0:
            found = Bends.along(arcs, self.start, LONGEST_PIECE * radius)
        seconds["smooth"] += clock() - began
        return found

    def least(self, bends: Bends) -> tuple[float, complex, int]:
        """The least room to spare (m) along a way, where, and beside which obstacle; infinite and -1 without any."""
        return self._least(*bends.poses(CHECKED))

    def _least(self, places: np.ndarray, directions: np.ndarray) -> tuple[float, complex, int]:
        body = self.limits.body
        centres = places[:, None] + np.exp(1j * directions)[:, None] * body.offset
        distance, nearest = self.map.nearest(centres.ravel())
        spare = (distance.reshape(centres.shape) - body.need).ravel()
        worst = int(spare.argmin())
        return float(spare[worst]), complex(centres.ravel()[worst]), int(nearest[worst])

    def _field(self, grown: np.ndarray, radius: float) -> Field:
        body = self.limits.body
        rectangle = self.map.bounds or self._around(AROUND * radius + float(body.need.max()))
        left, bottom, right, top = rectangle
        step = max(GRID * radius, math.sqrt((right - left) * (top - bottom) / MOST_CELLS))
        reach = float(body.need.max()) + SOFT * radius + 2 * step
        return field_of(self.map.obstacles, grown, rectangle, step, reach)

    def _around(self, margin: float) -> tuple[float, float, float, float]:
        """A rectangle around all obstacles, start and goal."""
        ends = np.array([[place.real, place.imag] for place, _ in (self.start, self.goal)])
        boxes = np.array([shape.bounds for shape in self.map.shapes]).reshape(-1, 4)
        low = np.vstack([ends, boxes[:, :2]]).min(axis=0) - margin
        high = np.vstack([ends, boxes[:, 2:]]).max(axis=0) + margin
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def _why(self, field: Field, error: NoWay) -> str:
        """Where it is too narrow, or that bends are too tight."""
        needed = self.limits.body.middle
        half, place = widest_gap(field, self.start[0], self.goal[0])
        way = f"no way from {_at(self.start[0])} to {_at(self.goal[0])}"
        if half >= needed:
            return f"{way} was found: {error} {1 / (SEARCHED * self.limits.curvature):.3g} m"
        _, nearest = self.map.nearest(np.array([place]))
        beside = f" beside {self.map.labels[nearest[0]]}" if nearest[0] >= 0 else ""
        room = f"has {2 * half:.3g} m" if half > 0 else "is closed"
        return (
            f"{way}: the body in its tube needs a gap of {2 * needed:.3g} m, the narrowest one on the widest way, at "
            f"{_at(place)}{beside}, {room}"
        )


def _outside(bounds: tuple[float, float, float, float], place: complex) -> float:
    left, bottom, right, top = bounds
    return math.hypot(max(left - place.real, place.real - right, 0.0), max(bottom - place.imag, place.imag - top, 0.0))


def _at(place: complex) -> str:
    return f"({place.real:.4g}, {place.imag:.4g}) m"
