"""A way for a car between obstacles: A* over arcs, in the plane and the headings.

Hybrid A* (D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel, International Journal of Robotics Research 29, 2010), forwards
only: places and headings are continuous, and of those that fall into one cell the cheapest is kept. Every expansion
also tries the shortest ways to the goal, so that the goal's pose is met exactly. What remains to a place, without
headings, is Dijkstra's distance on a coarse grid. Everything is deterministic.

Places are complex numbers x + iy in m, directions of motion in rad from +x.
"""

import heapq
import itertools
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cfjax.planner.dubins import Arcs, dubins_ways
from cfjax.planner.field import Field


STEP = 0.8  # rad: the length of a way from node to node is so many radii of the tightest bend
HEADINGS = 24  # cells of a turn
SAMPLES = 5  # poses of a step, and of each so long part of a shot at the goal
AT_ONCE = 16  # nodes that are expanded together
MOST_NODES = 40_000
COARSE = 2  # steps of the field in one of the grid for Dijkstra's distances
SHOT, SELDOM = 12.0, 10  # so many radii from the goal every batch shoots at it, else one in so many
AWAY = 6.0  # radii from start or goal at which they are left
NEAR = 2.0  # a metre beside an obstacle counts as so many; less with distance
BEND = 0.1  # a metre in the tightest bend counts as so much more
EAGER = 1.6  # what remains counts so much more: nearly as short, found much sooner

Node = tuple[complex, float]


class Grain(NamedTuple):
    """How fine a search is: curvatures of its arcs, of the largest one, and a cell's size, of an arc's length."""

    bends: tuple[float, ...]
    cell: float


COARSE_GRAIN = Grain((-1.0, -0.5, 0.0, 0.5, 1.0), 0.75)
FINE_GRAIN = Grain((-1.0, -0.5, -0.15, 0.0, 0.15, 0.5, 1.0), 0.35)  # for roads that are hardly wider than the body


class BodyDiscs(NamedTuple):
    """Discs along the forward axis: offsets, and how far from obstacles each centre has to be (m)."""

    offset: Float[np.ndarray, " discs"]
    need: Float[np.ndarray, " discs"]

    @property
    def middle(self) -> float:
        """What the reference point needs whatever the heading is (m)."""
        return float((self.need - np.abs(self.offset)).max())

    def room(self, field: Field, places: np.ndarray, forward: np.ndarray) -> Float[np.ndarray, "*n"]:
        """By how much (m) the discs at places, with unit vectors ahead, are farther from obstacles than needed."""
        centres = places[..., None] + forward[..., None] * self.offset
        return (field.at(centres)[0] - self.need).min(axis=-1)


class NoWay(ValueError):
    """There is none, by what the search tries."""


def along(arcs: Arcs, start: Node, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Places and directions along arcs, from the start to the end, no farther apart than a spacing (m)."""
    place, direction = start
    places, directions = [np.array([place])], [np.array([direction])]
    for curvature, length in arcs:
        s = np.linspace(0.0, length, max(1, math.ceil(length / spacing)) + 1)[1:]
        places.append(place + np.exp(1j * direction) * _moved(curvature, s))
        directions.append(direction + curvature * s)
        place, direction = complex(places[-1][-1]), float(directions[-1][-1])
    return np.concatenate(places), np.concatenate(directions)


def _moved(curvature: float | np.ndarray, s: np.ndarray) -> Complex[np.ndarray, "*n"]:
    """Where an arc leads that begins at 0 along the real axis."""
    return s * np.exp(0.5j * curvature * s) * np.sinc(curvature * s / (2 * np.pi))


class Search:
    """Ways for a body through a field, with at most a curvature (1/m); `soft` m to spare, wherever there is room."""

    def __init__(
        self, field: Field, body: BodyDiscs, goal: Node, curvature: float, soft: float, grain: Grain = COARSE_GRAIN
    ) -> None:
        self.field, self.body, self.goal, self.soft = field, body, goal, soft
        self.curvature = curvature
        self.step = STEP / curvature
        self.cell = self.step * grain.cell
        self.bends = np.array(grain.bends) * curvature
        s = self.step * np.arange(1, SAMPLES + 1) / SAMPLES
        self.ways = _moved(self.bends[:, None], s)  # bends × samples
        self.turns = np.exp(1j * self.bends[:, None] * s)
        self.remaining = self._distances()

    def weight(self, room: np.ndarray) -> np.ndarray:
        """What a metre counts with so much room to spare."""
        return 1 + (NEAR - 1) * np.clip(1 - room / self.soft, 0, 1) ** 2

    def _distances(self) -> Float[np.ndarray, "rows columns"]:
        """From the nodes of a coarse grid to the goal, infinite where none leads there."""
        room = self.field.distance[::COARSE, ::COARSE] - self.body.middle
        coarse = COARSE * self.field.step
        free = room > -coarse / 2  # no way is lost for how it lies between nodes
        weight = self.weight(room)
        number = np.arange(free.size).reshape(free.shape)
        rows, columns, lengths = [], [], []
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            height, width = free.shape[0] - dy, free.shape[1] - abs(dx)
            a = np.s_[:height, :width] if dx >= 0 else np.s_[:height, 1:]
            b = np.s_[dy:, dx:] if dx >= 0 else np.s_[dy:, :width]
            both = free[a] & free[b]
            rows.append(number[a][both])
            columns.append(number[b][both])
            lengths.append((coarse * math.hypot(dx, dy) * EAGER / 2) * (weight[a] + weight[b])[both])
        graph = coo_array(
            (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), shape=(free.size, free.size)
        ).tocsr()
        at = (self.goal[0] - self.field.origin) / coarse
        row, column = (int(np.clip(round(c), 0, n - 1)) for c, n in zip((at.imag, at.real), free.shape, strict=True))
        return dijkstra(graph, directed=False, indices=number[row, column]).reshape(free.shape)

    def left(self, places: np.ndarray) -> Float[np.ndarray, "*n"]:
        """The distance to the goal without headings, as far as the coarse grid tells."""
        at = (places - self.field.origin) / (COARSE * self.field.step)
        rows, columns = self.remaining.shape
        row = np.clip(np.rint(at.imag), 0, rows - 1).astype(int)
        column = np.clip(np.rint(at.real), 0, columns - 1).astype(int)
        return self.remaining[row, column]

    def way(self, start: Node) -> Arcs:
        """The cheapest way found from a pose to the goal.

        Raises:
            NoWay: where there is none, or none among so many nodes.
        """
        if abs(start[0] - self.goal[0]) > AWAY / self.curvature:
            if self.is_boxed_in(start):
                raise NoWay("none leaves the start with bends of a radius of at least")
            if self.is_boxed_in(self.goal, backwards=True):
                raise NoWay("none comes to the goal with bends of a radius of at least")
        tree, at_goal, cheapest = _Tree(start), set[int](), dict[int, float]()
        queue = [(float(self.left(np.array([start[0]]))[0]), 0)]
        for turn in itertools.count():
            batch: list[int] = []
            while queue and len(batch) < AT_ONCE:
                node = heapq.heappop(queue)[1]
                if node in at_goal:
                    return tree.way_to(node)
                key = self._key(tree.place[node], tree.direction[node])
                if tree.cost[node] < cheapest.get(key, math.inf):
                    cheapest[key] = tree.cost[node]
                    batch.append(node)
            if not batch:
                break
            if len(tree.place) > MOST_NODES:
                raise NoWay(f"none among {len(tree.place)} poses, with bends of a radius of at least")
            first = tree.place[batch[0]], tree.direction[batch[0]]
            near = self.left(np.array([first[0]]))[0] < SHOT / self.curvature
            if (near or turn % SELDOM == 0) and (shot := self._shot(first)):
                at_goal.add(tree.add(batch[0], self.goal, *shot))
                heapq.heappush(queue, (tree.cost[-1], len(tree.cost) - 1))
            self._expand(tree, batch, queue)
        raise NoWay("none is driven forwards with bends of a radius of at least")

    def _expand(self, tree: "_Tree", batch: list[int], queue: list[tuple[float, int]]) -> None:
        """Add to the tree where the bends lead to from the nodes of a batch."""
        place, direction = (np.array([values[node] for node in batch]) for values in (tree.place, tree.direction))
        ends, room = self._bent(place, direction, self.body)
        left = self.left(ends)
        prices = self.step * (self.weight(room).mean(axis=-1) + BEND * np.abs(self.bends) / self.curvature)
        for b, k in np.argwhere((room.min(axis=-1) >= 0) & np.isfinite(left)):
            node, bend = batch[b], float(self.bends[k])
            end = complex(ends[b, k]), tree.direction[node] + bend * self.step
            added = tree.add(node, end, [(bend, self.step)], float(prices[b, k]))
            heapq.heappush(queue, (tree.cost[added] + float(left[b, k]), added))

    def _bent(self, place: np.ndarray, direction: np.ndarray, body: BodyDiscs) -> tuple[np.ndarray, np.ndarray]:
        """Where the bends lead to from poses, and the room along them."""
        ahead = np.exp(1j * direction)[:, None, None]
        samples = place[:, None, None] + ahead * self.ways
        return samples[..., -1], body.room(self.field, samples, ahead * self.turns)

    def is_boxed_in(self, pose: Node, backwards: bool = False) -> bool:
        """Whether no way from a pose gets some radii away from it; backwards: no way to it comes from there.

        Backwards the body is driven the other way round.
        """
        turned, sign = (math.pi, -1) if backwards else (0.0, 1)
        body = self.body._replace(offset=sign * self.body.offset)
        place, direction, seen = np.array([pose[0]]), np.array([pose[1] + turned]), set[int]()
        while place.size:
            ends, room = self._bent(place, direction, body)
            free = room.min(axis=-1) >= 0
            if (np.abs(ends[free] - pose[0]) > AWAY / self.curvature).any():
                return False
            next_place, next_direction = ends[free], (direction[:, None] + self.bends * self.step)[free]
            fresh = []
            for index, key in enumerate(map(self._key, next_place.tolist(), next_direction.tolist())):
                if key not in seen:
                    seen.add(key)
                    fresh.append(index)
            place, direction = next_place[fresh], next_direction[fresh]
        return True

    def _key(self, place: complex, direction: float) -> int:
        column = int((place.real - self.field.origin.real) / self.cell)
        row = int((place.imag - self.field.origin.imag) / self.cell)
        return (row * 65536 + column) * HEADINGS + int(direction / (2 * math.pi) * HEADINGS + 0.5) % HEADINGS

    def _shot(self, start: Node) -> tuple[Arcs, float] | None:
        """The shortest way of two arcs and a line or arc to the goal that is free, and what it costs."""
        for arcs in dubins_ways(start, self.goal, 1 / self.curvature):
            places, directions = along(arcs, start, self.step / SAMPLES)
            room = self.body.room(self.field, places, np.exp(1j * directions))
            if room.min() >= 0:
                length = sum(length for _, length in arcs)
                bent = sum(length for curvature, length in arcs if curvature)
                return arcs, float(length * self.weight(room).mean() + BEND * bent)
        return None


class _Tree:
    """Nodes that were reached: pose, cost, the node before, and the arcs from there."""

    def __init__(self, start: Node) -> None:
        self.place, self.direction = [start[0]], [start[1]]
        self.cost, self.before, self.arcs = [0.0], [-1], [Arcs()]

    def add(self, before: int, pose: Node, arcs: Arcs, price: float) -> int:
        self.place.append(pose[0])
        self.direction.append(pose[1])
        self.cost.append(self.cost[before] + price)
        self.before.append(before)
        self.arcs.append(arcs)
        return len(self.place) - 1

    def way_to(self, node: int) -> Arcs:
        """All arcs to a node, neighbours with one curvature as one."""
        parts: list[Arcs] = []
        while node >= 0:
            parts.append(self.arcs[node])
            node = self.before[node]
        every = itertools.chain.from_iterable(reversed(parts))
        return [(bend, sum(length for _, length in run)) for bend, run in itertools.groupby(every, lambda arc: arc[0])]
