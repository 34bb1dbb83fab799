"""From a map to a certified path: search, smooth, prove; and where the proof fails, plan around what was in the way."""

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cfjax.coerce import Number, Numbers, instance, instances, number, numbers, optional, text, whole
from cfjax.errors import InputError
from cfjax.lazy import public
from cfjax.planner.bends import Bends
from cfjax.planner.map import Map
from cfjax.planner.map_file import read_map
from cfjax.planner.question import CHECKED, SOFT, Question, Stopwatch, Unproven, at_place
from cfjax.planner.room import PlanLimits, limits_of
from cfjax.planner.search import Node
from cfjax.problem import FootprintDisc, KinematicBicycle, Path, Pose, Vehicle
from cfjax.problem.frames import QUARTER, RosPose, pose_from_ros
from cfjax.problem.obstacles import footprint_of
from cfjax.problem.path import speed_of
from cfjax.tubes import CertifiedTube, Following, follow, library, write_chain


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


GROWTH = 0.1  # of an obstacle that was in the way, in radii of the tightest bend
RETREATS = (6.0, 12.0, 24.0)  # the same: so far before what is in the way a new way leaves the old one, nearest first


class Wanted(NamedTuple):
    """What is asked of a plan besides its map and its poses: as `plan` has it."""

    vehicle: Vehicle | None
    tubes: Sequence[CertifiedTube] | None
    footprint: tuple[FootprintDisc, ...]
    limits: PlanLimits
    attempts: int
    name: str


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
    bends: Bends
    wanted: Wanted
    spare: float
    place: tuple[float, float]
    beside: str
    attempts: int
    seconds: dict[str, float]

    @property
    def footprint(self) -> tuple[FootprintDisc, ...]:
        """Discs that stand for the body, m."""
        return self.wanted.footprint

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
            beside = f"{1000 * self.spare:.0f} mm to spare beside {self.beside} at {at_place(complex(*self.place))}"
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
    map = _map_of(map)
    optional("vehicle", vehicle, Vehicle)
    discs, speed, name = footprint_of(footprint), speed_of(speed), text("name", name)
    lateral = number("lateral_acceleration", lateral_acceleration, "m/s²", above=0)
    attempts = whole("attempts", attempts, 1)
    car = KinematicBicycle() if vehicle is None else vehicle
    offered = library(car) if tubes is None else instances("tubes", tubes, CertifiedTube)
    if not offered:
        raise InputError("tubes: expected at least one for the vehicle, got none")
    poses = _pose("start", start, map.start), _pose("goal", goal, map.goal)
    wanted = Wanted(vehicle, tubes, discs, limits_of(offered, speed, lateral, discs), attempts, name)
    question = Question(map, _node(poses[0]), _node(poses[1]), wanted.limits)
    question.check_ends()
    return _solved(question, poses, wanted, Stopwatch())


def replan(plan: Plan, map: Map | Sequence | str | File, *, driven: Number = 0.0) -> Plan:
    """The same plan in a map that has changed: what is still true of its proof is not proven again.

    Where nothing new is in the way the path stays, and clearance is proven anew near new obstacles alone. Else the path
    stays up to some radii before the first place that is blocked, or longer where a way leads on from there alone.

    Args:
        plan: as `cfjax.plan` or this function returned it.
        map: the map as it is now, in the forms of `cfjax.plan`.
        driven: metres of the path that may not change, for the car was or is there.

    Raises:
        InputError: as `cfjax.plan`, and where what is new touches the part that may not change.
    """
    instance("plan", plan, Plan)
    map, driven = _map_of(map), number("driven", driven, "m", least=0)
    old, wanted, watch = plan.bends, plan.wanted, Stopwatch()
    poses, ahead = (plan.start, plan.goal), Question(map, old.ends[0], _node(plan.goal), plan.wanted.limits)
    spare, beyond = ahead.spare(old), 1 + CHECKED * int(np.searchsorted(old.arc, driven))
    if spare.min() >= 0:
        try:
            return _solved(ahead, poses, wanted._replace(attempts=1), watch, plan, len(old.length))
        except Unproven:
            blocked = int(spare.argmin())
    else:
        blocked = int((spare < 0).argmax())
    if blocked < beyond:
        place = at_place(complex(old.poses(CHECKED)[0][blocked]))
        raise InputError(f"{map.source}: what may not change of the path, {driven:g} m, is blocked at {place}")
    first = int(np.searchsorted(old.arc, driven))
    reason: InputError | None = None
    for retreat in (*RETREATS, np.inf):
        leave = old.arc[(blocked - 1) // CHECKED] - retreat / wanted.limits.curvature
        kept = max(first, int(np.searchsorted(old.arc, leave, side="right")) - 1)
        question = Question(map, old.ends[kept], _node(plan.goal), wanted.limits)
        try:
            return _solved(question, poses, wanted, watch, plan, kept, first)
        except InputError as error:
            reason = error
        if kept == first:
            break
    assert reason is not None  # nothing was returned
    raise reason


def _map_of(map: Map | Sequence | str | File) -> Map:
    return map if isinstance(map, Map) else read_map(map) if isinstance(map, str | File) else Map(map)


def _solved(
    question: Question,
    poses: tuple[Pose, Pose],
    wanted: Wanted,
    watch: Stopwatch,
    earlier: Plan | None = None,
    kept: int = 0,
    fixed: int = 0,
) -> Plan:
    """The plan by a way that is proven; behind `kept` pieces of an earlier one, `fixed` of them with its speed.

    Raises:
        InputError: where there is no way, or none is proven.
    """
    map, limits = question.map, wanted.limits
    before = None if earlier is None else earlier.bends.some(kept)
    grown, refused = np.zeros(len(map.obstacles)), ""
    for attempt in range(1, wanted.attempts + 1):
        bends = before if earlier and kept == len(earlier.bends.length) else question.way(grown, refused, watch)
        assert bends is not None  # of an earlier plan
        bends = bends if before is None or bends is before else before.then(bends)
        path = bends.path(wanted.name, limits.speed, limits.lateral, limits.acceleration)
        if earlier is not None and not _begin_alike(path, earlier, fixed):
            raise InputError(f"{map.source}: no way leads on from what may not change of the path at its speed there")
        try:
            with watch.during("proof"):
                following = follow(
                    path,
                    wanted.tubes,
                    vehicle=wanted.vehicle,
                    obstacles=map.obstacles,
                    footprint=wanted.footprint,
                    earlier=None if earlier is None else earlier.following,
                )
        except InputError as error:
            spare, place, nearest = question.least(bends)
            if not spare < SOFT / limits.curvature:
                raise
            said = re.sub(r"obstacle (\d+)", lambda found: map.labels[int(found[1])], str(error))
            refused = f"{map.labels[nearest]} is in the way at {at_place(place)}: {said}"
            grown[nearest] += GROWTH / limits.curvature
            continue
        spare, place, nearest = question.least(bends)
        beside, at = map.labels[nearest] if nearest >= 0 else "", (place.real, place.imag)
        return Plan(following, map, *poses, bends, wanted, spare, at, beside, attempt, watch.seconds)
    raise Unproven(f"{map.source}: no path was proven in {wanted.attempts} attempts; {refused}")


def _begin_alike(path: Path, earlier: Plan, pieces: int) -> bool:
    """Whether so many pieces of a path are those of the earlier one, with their speeds."""
    limits = earlier.wanted.limits
    old = earlier.bends.path(path.name, limits.speed, limits.lateral, limits.acceleration).curve[0].speed
    new = path.curve[0].speed
    return (
        new.breaks[: pieces + 1] == old.breaks[: pieces + 1] and new.coefficients[:pieces] == old.coefficients[:pieces]
    )


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
