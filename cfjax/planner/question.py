"""Which way leads from one pose to another in a map, with the room that the body in its tube needs."""

import contextlib
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cfjax.errors import InputError
from cfjax.planner.bends import Bends
from cfjax.planner.dubins import Arcs
from cfjax.planner.field import Field, field_of
from cfjax.planner.map import Map
from cfjax.planner.room import PlanLimits
from cfjax.planner.search import COARSE_GRAIN, FINE_GRAIN, Grain, Node, NoWay, Search
from cfjax.planner.smooth import smoothed
from cfjax.planner.widest import widest_gap


# lengths in radii of the tightest bend
GRID = 0.2  # between the nodes of the distance field
SOFT = 0.6  # beside obstacles, wherever there is room
SPARE = 0.06  # beside obstacles, more than the tube needs, where the path is smoothed
AROUND = 8.0  # around start, goal and obstacles of a map without bounds
LONGEST_PIECE = 0.6
MOST_CELLS = 4_000_000  # of the distance field: a larger map has a coarser one
SEARCHED = 0.9  # of the curvature that a path may have is what the search uses
CHECKED = 4  # places of a piece at which clearance is looked at, before it is proven


class Unproven(InputError):
    """A way was found, for the body in its tube, and none was proven."""


class Stopwatch:
    """Times (s) by stage, of all attempts together."""

    clock = staticmethod(time.perf_counter)

    def __init__(self) -> None:
        self.seconds = {"search": 0.0, "smooth": 0.0, "proof": 0.0}

    @contextlib.contextmanager
    def during(self, stage: str) -> Iterator[None]:
        """What is done within counts as the stage."""
        began = Stopwatch.clock()
        try:
            yield
        finally:
            self.seconds[stage] += Stopwatch.clock() - began


@dataclass(frozen=True, eq=False)
class Question:
    """Which way leads from start to goal with so much room.

    Places are x + iy (m), directions of motion in rad from +x.
    """

    map: Map
    start: Node
    goal: Node
    limits: PlanLimits

    def check_ends(self) -> None:
        """Raises InputError where the body in its tube cannot stand at the start or at the goal."""
        for name, (place, direction) in (("start", self.start), ("goal", self.goal)):
            if self.map.bounds is not None and (outside := _outside(self.map.bounds, place)) > 0:
                left, bottom, right, top = self.map.bounds
                raise InputError(
                    f"{name}: expected a place in {self.map.source}, [{left:g}, {right:g}] x [{bottom:g}, {top:g}] m, "
                    f"got {at_place(place)}, {outside:.3g} m outside"
                )
            spare, _, nearest = self._least(np.array([place]), np.array([direction]))
            if spare < 0:
                raise InputError(
                    f"{name}: expected a place where the body in its tube touches nothing, got {at_place(place)} with "
                    f"{-spare:.3g} m too little beside {self.map.labels[nearest]} of {self.map.source}"
                )

    def way(self, grown: np.ndarray, refused: str, watch: Stopwatch) -> Bends:
        """A way that is clear as far as samples tell, its curvature continuous if such a one is found.

        Raises:
            InputError: where there is none; `refused` says why an earlier one would not do.
        """
        limits, radius = self.limits, 1 / (SEARCHED * self.limits.curvature)
        with watch.during("search"):
            field = self._field(grown, radius)
            try:
                arcs = self._arcs(field, radius)
            except NoWay as error:
                if refused:
                    raise Unproven(f"{self.map.source}: no path was proven, and there is no other; {refused}") from None
                raise InputError(f"{self.map.source}: {self._why(field, error)}") from None
        with watch.during("smooth"):
            found = smoothed(arcs, self.start, self.goal, field, limits.body, radius, SPARE * radius)
            if found is None or found.sharpest > limits.curvature or self.least(found)[0] < 0:
                found = Bends.along(arcs, self.start, LONGEST_PIECE * radius)
        return found

    def _arcs(self, field: Field, radius: float) -> Arcs:
        """By a fine search where a coarse one finds none."""

        def by(grain: Grain) -> Arcs:
            return Search(field, self.limits.body, self.goal, 1 / radius, SOFT * radius, grain).way(self.start)

        try:
            return by(COARSE_GRAIN)
        except NoWay:
            return by(FINE_GRAIN)

    def spare(self, bends: Bends) -> np.ndarray:
        """Room to spare (m) at places along a way: at its start, then at `CHECKED` of each piece."""
        return self._room(*bends.poses(CHECKED))[0].min(axis=1)

    def least(self, bends: Bends) -> tuple[float, complex, int]:
        """The least room to spare (m) along a way, where, and beside which obstacle; infinite and -1 without any."""
        return self._least(*bends.poses(CHECKED))

    def _least(self, places: np.ndarray, directions: np.ndarray) -> tuple[float, complex, int]:
        spare, centres, nearest = (each.ravel() for each in self._room(places, directions))
        worst = int(spare.argmin())
        return float(spare[worst]), complex(centres[worst]), int(nearest[worst])

    def _room(self, places: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of each disc at each pose the room to spare (m), its centre, and the nearest obstacle."""
        body = self.limits.body
        centres = places[:, None] + np.exp(1j * directions)[:, None] * body.offset
        distance, nearest = self.map.nearest(centres.ravel())
        return distance.reshape(centres.shape) - body.need, centres, nearest.reshape(centres.shape)

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
        way = f"no way from {at_place(self.start[0])} to {at_place(self.goal[0])}"
        if half >= needed:
            return f"{way} was found: {error} {1 / (SEARCHED * self.limits.curvature):.3g} m"
        _, nearest = self.map.nearest(np.array([place]))
        beside = f" beside {self.map.labels[nearest[0]]}" if nearest[0] >= 0 else ""
        room = f"has {2 * half:.3g} m" if half > 0 else "is closed"
        return (
            f"{way}: the body in its tube needs a gap of {2 * needed:.3g} m, the narrowest one on the widest way, at "
            f"{at_place(place)}{beside}, {room}"
        )


def _outside(bounds: tuple[float, float, float, float], place: complex) -> float:
    left, bottom, right, top = bounds
    return math.hypot(max(left - place.real, place.real - right, 0.0), max(bottom - place.imag, place.imag - top, 0.0))


def at_place(place: complex) -> str:
    """For messages."""
    return f"({place.real:.4g}, {place.imag:.4g}) m"
