"""The numbers of one problem, as pytrees: one compiled program serves every problem of the same shapes.

A segment is looked at by **stations**: stretches of θ on each of which its references are a set. A steady segment and a
tube have one, all along; a segment whose turning rate or speed varies has many, each a single place.
"""

import enum
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from cfjax.funnel.template import Template
from cfjax.problem import Path, Problem, ReferencePoint, Segment, Tube, disc_centres, distances, mirror_signs
from cfjax.problem.input_box import InputBox
from cfjax.problem.obstacles import Obstacle, Wall, convex_parts
from cfjax.problem.vehicle import Interval, Scalar


PLACES = 129  # along a segment that varies
FREE_REACH = 4.0  # in half-axes of I: how wide candidates start where there is no G
DIRECTIONS = np.linspace(-1.3, 1.3, 27)  # rad: half-planes that are tried, about the shortest way to the obstacle


class Unit(enum.Enum):
    """What a margin is counted in: 1/s, 1/m of the reference's way, or in between.

    At a high speed a margin in 1/s is worth little: what counts there is the way. Balanced margins, which a learner
    maximises, are in 1/s at the slowest speed and grow with speed nearly as fast as margins per metre.
    """

    SECOND = 0.0
    METRE = 1.0
    BALANCED = 0.95  # exponent of the speed, relative to the slowest


class Span(NamedTuple):
    """Part of a segment, θ from begin to end (s), as the set of references within bounds that hold there.

    With bounds of the curvature's rate (dκ/dθ, 1/(m s)) one input has to do for all of them
    (`cfcheck.vehicle.structure`).
    """

    begin: float
    end: float
    bounds: Tube
    curvature_rate: Interval | None = None


class Clearance(NamedTuple):
    """Half-planes between the footprint and obstacles: places along the segment (p), directions n (d) at each.

    At a place the footprint's disc is clear of the obstacle if, for some n, gap > √(ρ mᵀC⁻¹m) + swing ρ (C⁻¹)_αα.
    """

    theta: Array | np.ndarray  # (p,), s
    gap: Array | np.ndarray  # (p, d), m along n between the footprint's disc, there without deviation, and the obstacle
    reach: Array | np.ndarray  # (p, d, n), m: how the disc moves along n with the deviation
    swing: Array | np.ndarray  # (p,), m: what turning adds to second order


class Instance(NamedTuple):
    """The numbers of one funnel's problem, on one segment or tube.

    `references` are the extreme references of each station, arrays (stations, groups, members), `nominal` the one of
    each group, arrays (stations, groups), at which signs are read; margins are divided by `unit`.

    Where a tube is its own mirror image, so is V: `coupling` is then zero between states of unlike parity, and the
    upper end of the curvature speaks for both.
    """

    references: ReferencePoint
    nominal: ReferencePoint
    unit: Array | np.ndarray  # (stations, groups, members)
    begin: Array | np.ndarray  # (stations,), s
    end: Array | np.ndarray
    duration: Scalar  # T, s; 1 for a tube, which has no end, and whose rate is zero
    beta_lower: Scalar
    beta_inner: Scalar
    inputs: InputBox
    inlet: Array | np.ndarray  # half-axes of I, one per state
    goal: Array | np.ndarray  # half-axes of G; where none is asked, how far a search begins to look
    starts: Scalar  # 1 where the funnel has to hold I at its start, else 0
    ends: Scalar  # 1 where its end has to lie in G, else 0
    safe: Array | np.ndarray  # half-widths of S, at most π in the heading (V is continuous only short of the wrap)
    clearance: Clearance
    change_bounds: tuple[Scalar, Scalar]  # of rate · duration
    coupling: Array | np.ndarray  # (n, n): 1 where C may have an entry, else 0


class Chain(NamedTuple):
    """The funnels of a path, one for each of its `distinct` segments (leading axis), and how they follow each other."""

    funnels: Instance
    links: np.ndarray  # (l, 2): the end of the first lies in the start of the second; never of one with itself


def chain_of(
    problem: Problem,
    template: Template,
    beta_lower: float,
    beta_inner: float | None = None,
    unit: Unit = Unit.SECOND,
) -> Chain:
    """The numbers of a whole path."""
    path = problem.path
    found = [instance_of(problem, segment, template, beta_lower, beta_inner, unit) for segment in path.distinct]
    stations = max(len(instance.begin) for instance in found)
    places = max(len(instance.clearance.theta) for instance in found)
    alike = [_with_sizes(instance, stations, places) for instance in found]
    stacked = jax.tree.map(lambda *each: np.stack(each), *alike)
    return Chain(stacked, np.array(links_of(path), int).reshape(-1, 2))


def links_of(path: Path) -> list[tuple[int, int]]:
    """Pairs of distinct segments of which the second follows the first, a lap's start its end; none with itself."""
    order = path.kinds + (path.kinds[:1] if path.closed else ())
    return sorted({(first, second) for first, second in itertools.pairwise(order) if first != second})


def _with_sizes(instance: Instance, stations: int, places: int) -> Instance:
    """The last station and the last place repeated, so that instances can be stacked."""

    def repeated(values: Any, count: int) -> Any:
        return values[np.minimum(np.arange(count), len(values) - 1)] if len(values) else values

    names = ("references", "nominal", "unit", "begin", "end")
    along = {name: jax.tree.map(lambda v: repeated(v, stations), getattr(instance, name)) for name in names}
    return instance._replace(**along, clearance=Clearance(*(repeated(v, places) for v in instance.clearance)))


def instance_of(
    problem: Problem,
    segment: Segment | Tube,
    template: Template,
    beta_lower: float,
    beta_inner: float | None = None,
    unit: Unit = Unit.SECOND,
    stretches: Sequence[Span] = (),
) -> Instance:
    """The numbers that the conditions on one funnel need; `beta_inner` is beta_lower unless given.

    A segment is looked at by `stretches`, of one and the same shape, where some are given.
    """
    duration = segment.last_theta or 1.0  # of a tube any will do
    places, references, nominal = _stations(segment, duration, stretches)
    mirror = mirror_signs(problem.vehicle) if segment.has_mirror_images else None
    if mirror:
        upper = nominal[0, :, 0] >= 0  # of the curvature
        references, nominal = references[:, upper], nominal[:, upper]
    parity = np.array(mirror or (1,) * problem.dimension)
    speed = references[..., 1]
    kinds, kind = problem.path.kinds, problem.path.distinct.index(segment)
    may_grow = all(start < end for start, end in zip(problem.inlet.half_axes, problem.goal_axes, strict=True))
    # a link of a funnel with itself, or of several, asks that they shrink
    may_grow = may_grow and len(kinds) == 1 and not problem.path.closed
    safe = np.array(problem.safe.half_widths if problem.safe else (np.inf,) * problem.dimension)
    safe[0] = min(safe[0], np.pi)
    bounds = template.change_bounds(beta_lower, may_grow) if segment.last_theta else (0.0, 0.0)
    return Instance(
        references=ReferencePoint(*np.moveaxis(references, -1, 0)),
        nominal=ReferencePoint(*np.moveaxis(nominal, -1, 0)),
        unit=(speed if unit is Unit.METRE else speed / speed.min()) ** unit.value,
        begin=places[:, 0],
        end=places[:, 1],
        duration=np.float64(duration),
        beta_lower=np.float64(beta_lower),
        beta_inner=np.float64(beta_lower if beta_inner is None else beta_inner),
        inputs=InputBox.of(problem.inputs),
        inlet=np.array(problem.inlet.half_axes),
        goal=np.array(problem.goal.half_axes if problem.goal else FREE_REACH * np.array(problem.inlet.half_axes)),
        starts=np.float64(kind == kinds[0]),
        ends=np.float64(kind == kinds[-1] and problem.goal is not None),
        safe=safe,
        clearance=_clearance(problem, kind),
        change_bounds=tuple(map(np.float64, bounds)),
        coupling=(np.outer(parity, parity) > 0).astype(float),
    )


def _stations(
    segment: Segment | Tube, duration: float, stretches: Sequence[Span]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Begin and end (s, 2), extreme references (s, groups, members, 4) and nominal ones (s, groups, 4)."""
    if stretches:
        places = np.array([(stretch.begin, stretch.end) for stretch in stretches])
        bounds = [stretch.bounds for stretch in stretches]
        rates = [stretch.curvature_rate for stretch in stretches if stretch.curvature_rate]
        references = _vertices(bounds, rates) if rates else _extremes(bounds)
        return places, references, references[:, :, -1]  # the fastest of each group, or the middle of its box
    if segment.is_steady:
        places = np.array([[0.0, duration]])
        return places, np.array([segment.references()], float), np.array([segment.nominal()], float)
    places = np.repeat(np.linspace(0.0, duration, PLACES)[:, None], 2, axis=1)
    points = np.array(segment.samples(PLACES), float)
    return places, points[:, None, None, :], points[:, None, :]


def _extremes(bounds: Sequence[Tube]) -> np.ndarray:
    """The extreme references of tubes (`Tube.references`), (s, groups, members, 4): both ends wherever one has two."""

    def ends(name: str) -> np.ndarray:
        found = np.array([(getattr(tube, name).lower, getattr(tube, name).upper) for tube in bounds])
        return found if (found[:, 0] < found[:, 1]).any() else found[:, :1]

    curvature, acceleration = ends("curvature")[:, :, None, None], ends("acceleration")[:, None, :, None]
    speed = ends("speed")[:, None, None, :]
    columns = (curvature * speed, speed, np.zeros(1), acceleration)
    points = np.stack(np.broadcast_arrays(*(column + 0 * curvature * acceleration * speed for column in columns)), -1)
    return points.reshape(len(bounds), -1, speed.shape[-1], len(ReferencePoint._fields))


def _vertices(bounds: Sequence[Tube], rates: Sequence[Interval]) -> np.ndarray:
    """Of smooth stretches: the vertices of their boxes in one group (s, 1, members, 4), their middles last."""
    boxes = [(own.curvature, own.speed, own.acceleration, rate) for own, rate in zip(bounds, rates, strict=True)]
    corners = [[*itertools.product(*((side.lower, side.upper) for side in box))] for box in boxes]
    middles = [tuple(side.middle for side in box) for box in boxes]
    points = np.array([[*own, middle] for own, middle in zip(corners, middles, strict=True)])
    kappa, v, a, kappa_rate = np.moveaxis(points, -1, 0)
    return np.stack([kappa * v, v, kappa_rate * v + kappa * a, a], axis=-1)[:, None]


def _clearance(problem: Problem, kind: int) -> Clearance:
    """The half-planes of all segments of that kind: in the plane each lies at its own place."""
    size, fan = problem.dimension, len(DIRECTIONS)
    found = [(np.zeros(0), np.zeros((0, fan)), np.zeros((0, fan, size)), np.zeros(0))]
    for own, segment in zip(problem.path.kinds, problem.path.curve if problem.obstacles else (), strict=False):
        if own != kind:
            continue
        theta = np.linspace(0.0, segment.duration, PLACES)
        poses = segment.poses(theta)
        lateral = np.stack([np.cos(poses[:, 0]), np.sin(poses[:, 0])], axis=1)
        forward = np.stack([-lateral[:, 1], lateral[:, 0]], axis=1)
        for obstacle in convex_parts(problem.obstacles):
            for disc, (radius, centres) in zip(problem.footprint, disc_centres(problem.footprint, poses), strict=True):
                _, nearest = distances(obstacle, centres)
                way = nearest - centres
                angle = np.arctan2(way[:, 1], way[:, 0])[:, None] + DIRECTIONS[None, :]
                normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)  # (p, d, 2), towards the obstacle
                support = _support(obstacle, normal, nearest)
                gap = support - np.einsum("pdi,pi->pd", normal, centres) - radius
                sideways = np.einsum("pdi,pi->pd", normal, lateral)
                reach = np.zeros((PLACES, fan, size))
                reach[..., 0] = -disc.offset * sideways
                reach[..., 1] = sideways
                reach[..., 2] = np.einsum("pdi,pi->pd", normal, forward)
                found.append((theta, gap, reach, np.full(PLACES, 0.5 * abs(disc.offset))))
    return Clearance(*(np.concatenate(each) for each in zip(*found, strict=True)))


def _support(obstacle: Obstacle, normal: np.ndarray, nearest: np.ndarray) -> np.ndarray:
    """n·p of what the obstacle has nearest along normals (p, d, 2); of a wall its nearest point at each place alone."""
    if isinstance(obstacle, Wall):
        return np.einsum("pdi,pi->pd", normal, nearest)
    (hull,) = obstacle.hulls
    return np.einsum("pdi,ci->pdc", normal, np.array(hull.corners)).min(axis=2) - hull.round
