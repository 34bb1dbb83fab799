"""A scene of CommonRoad (XML) as a map: the road is where the body may be, and static obstacles stand on it.

The road is all lanelets together. What is left of a rectangle around them is an obstacle like any other: whoever
touches none stays on the road. Start and goal are those of the planning problem, if the file has one.

M. Althoff, M. Koschi, S. Manzinger: CommonRoad: Composable Benchmarks for Motion Planning on Roads, IEEE Intelligent
Vehicles Symposium 2017. Orientations there count from +x, headings here from +y. Places are complex numbers, m.
"""

import cmath
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

import shapely

from cfjax.coerce import real
from cfjax.errors import InputError
from cfjax.planner.map import Map
from cfjax.problem import Pose
from cfjax.problem.frames import QUARTER


ROAD_EDGE = "the edge of the road"
GAP = 0.01  # m: lanelets that are less than twice that apart meet
AROUND = 1.0  # m of what is no road around it
Lanelet = tuple[list[complex], list[complex]]  # left and right bound


class _Scene:
    """The elements of a file, and one line for whatever is wrong with them."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            self.refuse("XML without a document type", "one")
        try:
            self.root = ElementTree.fromstring(text)
        except ElementTree.ParseError as error:
            raise InputError(f"{path}: expected XML ({error})") from None
        if self.root.tag != "commonRoad":
            self.refuse("a scene of CommonRoad", f"an element {self.root.tag}")

    def refuse(self, expected: str, got: str, where: str = "") -> NoReturn:
        raise InputError(f"{self.path}: {where}{': ' if where else ''}expected {expected}, got {got}")

    def named(self, element: ElementTree.Element) -> str:
        return f"{element.tag} {element.get('id', '')}".strip()

    def number(self, element: ElementTree.Element, place: str, where: str, default: float | None = None) -> float:
        found = element.find(place)
        if found is None and default is not None:
            return default
        try:
            value = None if found is None else real(float(found.text or ""))
        except ValueError:
            value = None
        if value is None:
            self.refuse(f"a number as {place}", "none" if found is None else repr(found.text), where)
        return value

    def point(self, element: ElementTree.Element, where: str) -> complex:
        return complex(self.number(element, "x", where), self.number(element, "y", where))


def commonroad_map(path: Path, text: str) -> Map:
    """The map of a file with this text.

    Raises:
        InputError: one line that says what is wrong where; for obstacles that move, or whose place is not one point.
    """
    scene = _Scene(path, text)
    obstacles = [*scene.root.iterfind("staticObstacle"), *scene.root.iterfind("obstacle")]
    moving = [each for each in obstacles if each.findtext("role", "static") != "static"]
    if count := len(moving) + len(scene.root.findall("dynamicObstacle")):
        scene.refuse("static obstacles alone, for no proof speaks of others", f"{count} that move")
    lanelets = {each.get("id", ""): _lanelet(scene, each) for each in scene.root.iterfind("lanelet")}
    if not lanelets:
        scene.refuse("lanelets", "none")
    road = _road(scene, lanelets)
    left, bottom, right, top = map(float, shapely.bounds(road))
    around = left - AROUND, bottom - AROUND, right + AROUND, top + AROUND
    beside = shapely.get_parts(shapely.difference(shapely.box(*around), road)).tolist()
    start = goal = None
    if len(problems := scene.root.findall("planningProblem")) == 1:
        start, goal = _start(scene, problems[0]), _goal(scene, problems[0], lanelets)
    return Map(
        [*(list(_shapes(scene, each)) for each in obstacles), *beside],
        around,
        path.name,
        names=[*map(scene.named, obstacles), *[ROAD_EDGE] * len(beside)],
        start=start,
        goal=goal,
    )


def _lanelet(scene: _Scene, element: ElementTree.Element) -> Lanelet:
    where, bounds = scene.named(element), []
    for side in ("leftBound", "rightBound"):
        bounds.append([scene.point(point, where) for point in element.iterfind(f"{side}/point")])
        if len(bounds[-1]) < 2:
            scene.refuse(f"two points or more as {side}", str(len(bounds[-1])), where)
    return bounds[0], bounds[1]


def _road(scene: _Scene, lanelets: Mapping[str, Lanelet]) -> shapely.Geometry:
    """All lanelets together, narrow gaps between them closed."""
    polygons = []
    for name, (left, right) in lanelets.items():
        polygon = shapely.Polygon([(at.real, at.imag) for at in (*left, *right[::-1])])
        if not polygon.is_valid:
            scene.refuse("bounds that do not cross", shapely.is_valid_reason(polygon), f"lanelet {name}")
        polygons.append(polygon)
    return shapely.buffer(
        shapely.buffer(shapely.union_all(polygons), GAP, join_style="mitre"), -GAP, join_style="mitre"
    )


# --- obstacles


def _shapes(scene: _Scene, obstacle: ElementTree.Element) -> Iterator[dict[str, Any]]:
    """Discs and polygons where they stand, as entries of a map."""
    where = scene.named(obstacle)
    place, direction = _state(scene, obstacle, where)
    turn = cmath.exp(1j * direction)
    shapes = obstacle.findall("shape/*")
    if not shapes:
        scene.refuse("a shape", "none", where)
    for shape in shapes:
        local = _outline(scene, shape, where)
        moved = [place + turn * at for at in local]
        if shape.tag == "circle":
            yield {"disc": [moved[0].real, moved[0].imag, scene.number(shape, "radius", where)]}
        else:
            yield {"polygon": [[at.real, at.imag] for at in moved]}


def _outline(scene: _Scene, shape: ElementTree.Element, where: str) -> list[complex]:
    """Corners of a rectangle or polygon, or the centre of a circle: in the frame of whatever has the shape."""
    if shape.tag == "polygon":
        return [scene.point(point, where) for point in shape.iterfind("point")]
    centre = complex(scene.number(shape, "center/x", where, 0.0), scene.number(shape, "center/y", where, 0.0))
    if shape.tag == "circle":
        return [centre]
    if shape.tag != "rectangle":
        scene.refuse("a rectangle, circle or polygon", shape.tag, where)
    along, across = scene.number(shape, "length", where) / 2, scene.number(shape, "width", where) / 2
    turn = cmath.exp(1j * scene.number(shape, "orientation", where, 0.0))
    return [centre + turn * complex(x * along, y * across) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def _state(scene: _Scene, owner: ElementTree.Element, where: str) -> tuple[complex, float]:
    """Where something stands, and its orientation; both have to be known exactly."""
    state = owner.find("initialState")
    point = None if state is None else state.find("position/point")
    if state is None or point is None:
        scene.refuse("an initialState with a position that is one point", "none", where)
    return scene.point(point, where), scene.number(state, "orientation/exact", where)


# --- start and goal


def _start(scene: _Scene, problem: ElementTree.Element) -> Pose:
    return _pose(*_state(scene, problem, scene.named(problem)))


def _pose(place: complex, direction: float) -> Pose:
    return Pose(direction - QUARTER, place.real, place.imag)


def _goal(scene: _Scene, problem: ElementTree.Element, lanelets: Mapping[str, Lanelet]) -> Pose | None:
    """The middle of the goal's region and of its orientations; without these along the road. None without a region."""
    where, state = scene.named(problem), problem.find("goalState")
    region = None if state is None else next(iter(state.findall("position/*")), None)
    if state is None or region is None:
        return None
    if region.tag == "lanelet":
        if region.get("ref", "") not in lanelets:
            scene.refuse("the number of a lanelet as goal", repr(region.get("ref")), where)
        place, direction = _middle(lanelets[region.get("ref", "")])
    else:
        outline = _outline(scene, region, where)
        place, direction = sum(outline) / len(outline), _along(lanelets, sum(outline) / len(outline))
    ends = [f"orientation/{name}" for name in ("intervalStart", "intervalEnd")]
    if state.find(ends[0]) is not None:
        direction = sum(scene.number(state, end, where) for end in ends) / 2
    elif state.find("orientation/exact") is not None:
        direction = scene.number(state, "orientation/exact", where)
    return None if direction is None else _pose(place, direction)


def _middle(lanelet: Lanelet, share: float = 0.5) -> tuple[complex, float]:
    """A place in the middle of a lanelet, at a share of its length, and the direction there."""
    left, right = (shapely.LineString([(at.real, at.imag) for at in bound]) for bound in lanelet)

    def at(share: float) -> complex:
        ends = (shapely.line_interpolate_point(bound, share, normalized=True) for bound in (left, right))
        return sum(complex(end.x, end.y) for end in ends) / 2

    step = 0.01
    return at(share), cmath.phase(at(min(share + step, 1.0)) - at(max(share - step, 0.0)))


def _along(lanelets: Mapping[str, Lanelet], place: complex) -> float | None:
    """The direction of the lanelet at a place; None where there is none."""
    point = shapely.Point(place.real, place.imag)
    for left, right in lanelets.values():
        if shapely.Polygon([(at.real, at.imag) for at in (*left, *right[::-1])]).covers(point):
            share = shapely.LineString([(at.real, at.imag) for at in left]).project(point, normalized=True)
            return _middle((left, right), float(share))[1]
    return None
