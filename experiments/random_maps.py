"""Plan and certify random maps and six scenes by hand: how many are solved, how long it takes, and what cars touch.

    python experiments/random_maps.py [--maps 100] [--obstacles 100] [--cars 10000]

A map is a square with discs and polygons, which may overlap, a start and a goal at places that are free for the body in
its tube. Seeds are 0, 1, …: everybody has the same maps. Cars are drawn at random on the edge of each tube along the
path, and shapely measures how far their bodies are from what stands in the map. The times are of one warm process.
"""

import argparse
import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely

import cfjax
from cfjax.planner import Map, Plan
from cfjax.planner.planning import Unproven
from cfjax.problem import Pose


RADIUS = 0.25  # m, of the body
NEED = 0.35  # m: at start and goal
AREA = 9.0  # m² for each obstacle
APART = 0.6  # of the side of the square: at least so far is the goal from the start
TRIES = 1000  # of places for start and goal


class Scene(NamedTuple):
    """A question: entries of a map, its bounds, start and goal."""

    entries: list[dict]
    bounds: tuple[float, float, float, float]
    start: Pose
    goal: Pose

    @property
    def shapes(self) -> list[shapely.Geometry]:
        """What must not be touched, without the code of the package."""
        inner = shapely.box(*self.bounds)
        walls = inner.buffer(5.0, join_style="mitre").difference(inner)
        discs = [entry["disc"] for entry in self.entries if "disc" in entry]
        return [
            walls,
            *(shapely.Point(x, y).buffer(radius, 128) for x, y, radius in discs),
            *(shapely.Polygon(entry["polygon"]) for entry in self.entries if "polygon" in entry),
        ]


def random_scene(seed: int, count: int) -> Scene:
    """A square with so many obstacles: 40 % discs, else stars of three to seven corners, which need not be convex."""
    rng = np.random.default_rng(seed)
    side = math.sqrt(AREA * count)
    entries = []
    while len(entries) < count:
        centre, size = rng.uniform(0, side, 2), rng.uniform(0.2, 0.8)
        if rng.random() < 0.4:
            entries.append({"disc": [*centre.tolist(), 0.8 * size]})
            continue
        corners = int(rng.integers(3, 8))
        angle = 2 * np.pi * (np.arange(corners) + rng.uniform(0.1, 0.9, corners)) / corners
        radius = size * rng.uniform(0.5, 1, corners)
        entries.append({"polygon": (centre + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)).tolist()})
    scene = Scene(entries, (0.0, 0.0, side, side), Pose(0, 0, 0), Pose(0, 0, 0))
    tree, shapes = shapely.STRtree(scene.shapes), np.array(scene.shapes)
    poses: list[Pose] = []
    for _ in range(TRIES):
        x, y, heading = rng.uniform((0, 0, -np.pi), (side, side, np.pi)).tolist()
        place = shapely.Point(x, y)
        far = not poses or math.hypot(x - poses[0].x, y - poses[0].y) > APART * side
        if far and shapes[tree.nearest(place)].distance(place) > NEED:
            poses.append(Pose(heading, x, y))
            if len(poses) == 2:
                return scene._replace(start=poses[0], goal=poses[1])
    raise RuntimeError(f"seed {seed}: no places for start and goal")


def box(x: float, y: float, width: float, height: float) -> dict:
    return {"polygon": [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]}


def scenes() -> Iterator[tuple[str, Scene]]:
    """Six with boxes and triangles, of the size of those by which planners with certificates are compared."""
    east, north = -math.pi / 2, 0.0
    yield "two boxes", Scene([box(2, 0, 1, 3), box(5, 2, 1, 3)], (0, 0, 8, 5), Pose(north, 1, 1), Pose(north, 7, 4))
    teeth = [box(2 + 2.5 * k, 0 if k % 2 else 2, 0.5, 4) for k in range(4)]
    yield "zigzag", Scene(teeth, (0, 0, 12, 6), Pose(east, 0.8, 3), Pose(east, 11.2, 3))
    triangles = [
        {"polygon": [(x, y), (x + 1.4, y), (x + 0.7, y + 1.2)]} for x, y in ((2, 1), (4.5, 3), (2, 4.6), (6.4, 1))
    ]
    yield "triangles", Scene(triangles, (0, 0, 9, 7), Pose(east, 0.8, 0.8), Pose(north, 8, 6))
    room = [box(3, 0, 0.3, 2.6), box(3, 3.6, 0.3, 2.4), box(6, 0, 0.3, 1.2), box(6, 2.2, 0.3, 3.8)]
    yield "two doors", Scene(room, (0, 0, 9, 6), Pose(east, 1, 5), Pose(east, 8, 5))
    maze = [box(0, 2, 6, 0.3), box(2, 4.3, 6, 0.3), box(0, 6.6, 6, 0.3)]
    yield "maze", Scene(maze, (0, 0, 8, 9), Pose(east, 1, 1), Pose(math.pi / 2, 1, 8))
    posts = [box(1.6 + 1.7 * k, 1.2 + 1.7 * n + 0.85 * (k % 2), 0.5, 0.5) for k in range(5) for n in range(4)]
    yield "posts", Scene(posts, (0, 0, 10.5, 9), Pose(east, 0.7, 4), Pose(east, 9.8, 5))


def least_distance(plan: Plan, shapes: list[shapely.Geometry], cars: int, seed: int) -> float:
    """From random cars on the edge of the tubes to the shapes (m), less the radius of the body."""
    rng, least = np.random.default_rng(seed), math.inf
    tree, table = shapely.STRtree(shapes), np.array(shapes)
    for stretch in plan.following.tubes:
        theta = np.sort(rng.uniform(stretch.start, stretch.end, cars // len(plan.following.tubes) + 1))
        heading, x, y = plan.path.curve[stretch.segment].poses(theta).T
        shape = np.array([[float(entry) for entry in row] for row in stretch.tube.shape])
        w = rng.normal(size=(len(theta), len(shape)))
        off = w / np.sqrt(np.einsum("ki,ij,kj->k", w, shape, w))[:, None]
        cos, sin = np.cos(heading), np.sin(heading)
        places = shapely.points(x + cos * off[:, 1] - sin * off[:, 2], y + sin * off[:, 1] + cos * off[:, 2])
        least = min(least, float(shapely.distance(places, table[tree.nearest(places)]).min()))
    return least - RADIUS


class Outcome(NamedTuple):
    """What came out: the plan, or why there is none, and the time it took (s)."""

    plan: Plan | None
    reason: str
    unproven: bool
    seconds: float


def planned(scene: Scene) -> Outcome:
    began = time.perf_counter()
    try:
        found = cfjax.plan(Map(scene.entries, scene.bounds), scene.start, scene.goal, footprint=[[RADIUS, 0.0]])
    except cfjax.InputError as error:
        return Outcome(None, str(error), isinstance(error, Unproven), time.perf_counter() - began)
    return Outcome(found, "", False, time.perf_counter() - began)


def main() -> None:
    parser = argparse.ArgumentParser(description="Plan and certify random maps, and six scenes by hand.")
    parser.add_argument("--maps", type=int, default=100)
    parser.add_argument("--obstacles", type=int, default=100)
    parser.add_argument("--cars", type=int, default=10_000, help="of each map")
    given = parser.parse_args()
    planned(random_scene(0, 5))  # what is loaded and compiled once
    heads = ("obstacles", "length", "total", "search", "smooth", "proof")
    print(f"{'scene':<12} {' '.join(f'{head:>9}' for head in heads)}  nearest car")
    for name, scene in scenes():
        outcome = planned(scene)
        if outcome.plan is None:
            print(f"{name:<12} {len(scene.entries):>9} {outcome.reason}")
            continue
        length, least = (
            float(outcome.plan.following.reference.length),
            least_distance(outcome.plan, scene.shapes, given.cars, 0),
        )
        parts = [f"{1000 * value:5.0f} ms" for value in (outcome.seconds, *outcome.plan.seconds.values())]
        print(f"{name:<12} {len(scene.entries):>9} {length:6.2f} m {' '.join(parts)}  {1000 * least:.0f} mm")
    found: list[Outcome] = []
    touched, least = 0, math.inf
    for seed in range(given.maps):
        scene = random_scene(seed, given.obstacles)
        outcome = planned(scene)
        found.append(outcome)
        if outcome.plan is None:
            print(f"map {seed}: {outcome.reason}", flush=True)
            continue
        nearest = least_distance(outcome.plan, scene.shapes, given.cars, seed)
        least, touched = min(least, nearest), touched + (nearest <= 0)
    solved, unproven = [each.plan for each in found if each.plan], sum(each.unproven for each in found)
    print(
        f"{given.maps} maps of {given.obstacles} obstacles: {len(solved)} certified, {unproven} found and not proven, "
        f"{len(found) - len(solved) - unproven} without a way by the planner alone"
    )
    if solved:
        share = 100 * len(solved) / (len(solved) + unproven)
        print(f"certified of those with a way: {share:.1f} %; at once: {sum(each.attempts == 1 for each in solved)}")
        columns = {"total": [each.seconds for each in found if each.plan]}
        columns |= {key: [each.seconds[key] for each in solved] for key in solved[0].seconds}
        for key, values in columns.items():
            median, most, all_ = (1000 * np.quantile(values, share) for share in (0.5, 0.9, 1))
            print(f"{key:<7} median {median:.0f} ms, 90 % {most:.0f} ms, most {all_:.0f} ms")
        print(f"{given.cars * len(solved)} cars: {touched} maps with a contact; nearest {1000 * least:.1f} mm")


if __name__ == "__main__":
    main()
