"""Plan and certify random maps and six scenes by hand: how many are solved, how long it takes, and what cars touch.

    python experiments/random_maps.py [--maps 100] [--obstacles 100] [--cars 10000] [--log FILE]

A map is a square with discs and polygons, which may overlap, a start and a goal at places that are free for the body in
its tube. Seeds are 0, 1, …: everybody has the same maps. Cars are drawn at random on the edge of each tube along the
path, and shapely measures how far their bodies are from what stands in the map; the checker replays each proof. The
times are the processor's, in one warm process.
"""

import argparse
import json
import math
import time
from collections.abc import Iterator, Mapping
from pathlib import Path as File
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import shapely

import cfjax
from cfcheck import Outcome as CheckOutcome
from cfcheck import check_document
from cfjax.planner import Map, Plan
from cfjax.planner.question import Stopwatch, Unproven
from cfjax.problem import Pose
from cfjax.tubes.certificate import chain_document


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
    """From random cars on the edge of the tubes to the shapes (m), less the radius of each disc of the body."""
    rng, least = np.random.default_rng(seed), math.inf
    tree, table = shapely.STRtree(shapes), np.array(shapes)
    for stretch in plan.following.tubes:
        theta = np.sort(rng.uniform(stretch.start, stretch.end, cars // len(plan.following.tubes) + 1))
        heading, x, y = plan.path.curve[stretch.segment].poses(theta).T
        shape = np.array([[float(entry) for entry in row] for row in stretch.tube.shape])
        w = rng.normal(size=(len(theta), len(shape)))
        off = w / np.sqrt(np.einsum("ki,ij,kj->k", w, shape, w))[:, None]
        cos, sin = np.cos(heading), np.sin(heading)
        x, y = x + cos * off[:, 1] - sin * off[:, 2], y + sin * off[:, 1] + cos * off[:, 2]
        ahead = heading + off[:, 0]
        for disc in plan.footprint:
            places = shapely.points(x - disc.offset * np.sin(ahead), y + disc.offset * np.cos(ahead))
            least = min(least, float(shapely.distance(places, table[tree.nearest(places)]).min()) - disc.radius)
    return least


class Outcome(NamedTuple):
    """What came out of a map: times (s), how near the nearest car came (m), or why there is no plan."""

    seed: int
    reason: str = ""
    unproven: bool = False
    seconds: Mapping[str, float] = MappingProxyType({})
    attempts: int = 0
    nearest: float = math.inf

    @property
    def certified(self) -> bool:
        return not self.reason


def planned(scene: Scene) -> Plan:
    return cfjax.plan(Map(scene.entries, scene.bounds), scene.start, scene.goal, footprint=[[RADIUS, 0.0]])


def outcome_of(seed: int, count: int, cars: int) -> Outcome:
    """Of one map, its proof replayed by the checker."""
    scene = random_scene(seed, count)
    began = time.process_time()
    try:
        found = planned(scene)
    except cfjax.InputError as error:
        return Outcome(seed, str(error), isinstance(error, Unproven), {"total": time.process_time() - began})
    seconds = {"total": time.process_time() - began, **found.seconds}
    began = time.process_time()
    report = check_document(chain_document(found.following))
    if report.outcome is not CheckOutcome.PROVEN:
        raise RuntimeError(f"map {seed}: the checker says {report.message}")
    seconds["replay"] = time.process_time() - began
    return Outcome(seed, "", False, seconds, found.attempts, least_distance(found, scene.shapes, cars, seed))


def outcomes(maps: int, obstacles: int, cars: int, log: File | None) -> list[Outcome]:
    """Of all maps; what stands in the log, of as many obstacles and cars, is not done again."""
    question = {"obstacles": obstacles, "cars": cars}
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log and log.exists() else []
    known = {row["seed"]: Outcome(**row["outcome"]) for row in rows if row["question"] == question}
    for seed in range(maps):
        if seed in known:
            continue
        known[seed] = found = outcome_of(seed, obstacles, cars)
        if found.reason:
            print(f"map {seed}: {found.reason}", flush=True)
        if log:
            with log.open("a") as file:
                file.write(json.dumps({"question": question, "seed": seed, "outcome": found._asdict()}) + "\n")
    return [known[seed] for seed in range(maps)]


def table(found: list[Outcome], obstacles: int, cars: int) -> str:
    """What docs/maps.md shows, as Markdown."""
    solved, unproven = [each for each in found if each.certified], sum(each.unproven for each in found)
    if not solved:
        return "no map was solved"
    share = 100 * len(solved) / (len(solved) + unproven)
    at_once, touched = sum(each.attempts == 1 for each in solved), sum(each.nearest <= 0 for each in solved)
    lines = [
        f"| {len(found)} maps of {obstacles} obstacles | |",
        "|---|---|",
        f"| certified | {len(solved)}, of them {at_once} at once |",
        f"| a way was found and not proven | {unproven}: {share:.1f} % of those with a way are certified |",
        f"| without a way for the body in its tube | {len(found) - len(solved) - unproven} |",
        f"| cars that touched something | in {touched} maps, of {cars * len(solved)} cars |",
        f"| the nearest car | {1000 * min(each.nearest for each in solved):.1f} mm |",
        "",
        "| processor time (ms) | median | 90 % | 99 % | most |",
        "|---|---|---|---|---|",
    ]
    for key in solved[0].seconds:
        values = np.quantile([1000 * each.seconds[key] for each in solved], (0.5, 0.9, 0.99, 1))
        lines.append(f"| {key} | {' | '.join(f'{value:.0f}' for value in values)} |")
    return "\n".join(lines)


def six_scenes(cars: int) -> None:
    heads = ("obstacles", "length", "total", "search", "smooth", "proof")
    print(f"{'scene':<12} {' '.join(f'{head:>9}' for head in heads)}  nearest car")
    for name, scene in scenes():
        began = time.process_time()
        found = planned(scene)
        seconds = time.process_time() - began
        parts = [f"{1000 * value:6.0f} ms" for value in (seconds, *found.seconds.values())]
        length, least = float(found.following.reference.length), least_distance(found, scene.shapes, cars, 0)
        print(f"{name:<12} {len(scene.entries):>9} {length:7.2f} m {' '.join(parts)}  {1000 * least:.0f} mm")


def main() -> None:
    parser = argparse.ArgumentParser(description="Plan and certify random maps, and six scenes by hand.")
    parser.add_argument("--maps", type=int, default=100)
    parser.add_argument("--obstacles", type=int, default=100)
    parser.add_argument("--cars", type=int, default=10_000, help="of each map")
    parser.add_argument("--log", type=File, help="a line for each map: a campaign goes on where it was stopped")
    given = parser.parse_args()
    Stopwatch.clock = staticmethod(time.process_time)  # a busy machine matters little
    planned(random_scene(0, 5))  # what is loaded and compiled once
    six_scenes(given.cars)
    found = outcomes(given.maps, given.obstacles, given.cars, given.log)
    print(table(found, given.obstacles, given.cars))


if __name__ == "__main__":
    main()
