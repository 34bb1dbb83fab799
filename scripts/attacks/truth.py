"""Whether what a certificate claims is true, in floating point and by a search: the checker is compared with it.

It shares no code with the checker. Condition (d) is searched for its worst point (`attacks.margins`). Joints, the end
of a lap and obstacles are sampled. Of a funnel that is proven for another car, it only checks that the car that drives
has it.
"""

import itertools
import json
from fractions import Fraction
from typing import Any

import numpy as np

from attacks.margins import (
    METRE,
    SECOND,
    Document,
    duration_of,
    is_bicycle,
    is_bounds,
    level,
    number,
    shape_of,
    worst_margin,
)


TOLERANCE = 1e-9
GAPS = (1e-6, 1e-9)  # rad or m, m/s: within which a lap is closed
POSES = 129  # of each piece, at which obstacles are looked at


def is_true(document: Document, seed: int = 0) -> str:
    """Empty where nothing against the claim was found; else what is false."""
    problem, sets = document["problem"], document["problem"]["sets"]
    if problem["vehicle"]["name"] == "kinematic_bicycle" and not is_bicycle(problem):
        return "vehicle"
    if not number(problem["inputs"][0]["lower"]) > 0:
        return "sign"
    funnels = [driven(document, index) for index in range(len(document["funnels"]))]
    legs = legs_of(document)
    everywhere = is_bounds(problem["path"])
    for funnel in funnels:
        claims = [name for name in (SECOND, METRE) if funnel[name] is not None]
        if (everywhere and METRE not in claims) or (METRE in claims and number(funnel["rate"])):
            return "kind"
        if any(not number(funnel[name]) > 0 for name in claims):
            return "sign"
    own = legs or [(0, problem["path"]["bounds"])]
    ends = [_end_form(funnels[index], segment, problem) for index, segment in own]
    if false := _false_sets(sets, [funnels[index] for index, _ in own], [segment for _, segment in own], ends[-1]):
        return false
    if not everywhere and (false := _false_course(document, funnels, ends)):
        return false
    if sets["obstacles"] and (everywhere or _touches(document, funnels)):
        return "obstacle"
    for index, segment in own:
        claims = [name for name in (SECOND, METRE) if funnels[index][name] is not None]
        claim = _claim(problem, funnels[index], segment)
        if any(worst_margin(claim, name, seed) < number(funnels[index][name]) - TOLERANCE for name in claims):
            return "(d)"
    return ""


def driven(document: Document, index: int) -> Document:
    """A funnel as the car that drives has it: by similarity, where it is proven for another one."""
    funnel = document["funnels"][index]
    if funnel["model"] is None:
        return funnel
    length, speed = (Fraction(funnel["model"][name]) for name in ("length", "speed"))
    axes = [Fraction(1), length, length, speed]
    places = [(i, j) for i in range(4) for j in range(i + 1)]
    shape = [str(Fraction(c) / axes[i] / axes[j]) for c, (i, j) in zip(funnel["shape"], places, strict=True)]
    per_metre = None if funnel[METRE] is None else str(Fraction(funnel[METRE]) / length)
    margin = str(Fraction(funnel[SECOND]) * speed / length)
    return {**funnel, "model": None, "shape": shape, SECOND: margin, METRE: per_metre}


def legs_of(document: Document) -> list[tuple[int, list[Document]]]:
    """The funnel of each leg and its pieces; none where every path within bounds is meant."""
    found, begin = [], 0
    for leg in document["legs"]:
        found.append((leg["funnel"], document["problem"]["path"]["pieces"][begin : leg["end"]]))
        begin = leg["end"]
    return found


def segment_of(document: Document, index: int = 0) -> Any:
    """The bounds of every path that is meant, or the pieces of a funnel's first leg: the same as in the document."""
    path = document["problem"]["path"]
    if is_bounds(path):
        return path["bounds"]
    return next(pieces for funnel, pieces in legs_of(document) if funnel == index)


def claim_of(document: Document, index: int = 0) -> str:
    """What the true margins of one funnel depend on, along its first leg."""
    return _claim(document["problem"], driven(document, index), segment_of(document, index))


def _claim(problem: Document, funnel: Document, segment: Any) -> str:
    question = {name: problem[name] for name in ("vehicle", "method", "inputs")}
    return json.dumps([question, {**funnel, SECOND: "", METRE: ""}, segment], sort_keys=True)


# --- sets, joints, laps, obstacles


def _end_form(funnel: Document, segment: Any, problem: Document) -> float:
    """The largest q at the end of a leg: V is 1 there, or what the law leaves of it."""
    level, end = 1.0, float(duration_of(segment))
    if funnel[METRE] is not None and not is_bounds(segment):
        way = sum(_integral(piece["speed"], number(piece["duration"])) for piece in segment)
        level = _level_after(funnel, way, number(problem["inputs"][0]["upper"]))
    rate = number(funnel["rate"])
    return level - rate * end if funnel["template"] == "paper" else level * float(np.exp(-rate * end))


def _integral(coefficients: list[str], end: float) -> float:
    return float(np.polynomial.Polynomial([number(c) for c in coefficients]).integ()(end))


def _false_sets(sets: Document, funnels: list[Document], segments: list[Any], end: float) -> str:
    """`end` is the largest q at the end of the last leg."""
    shapes = [shape_of(funnel) for funnel in funnels]
    limits = [number(width) for width in sets["safe"]["half_widths"]] if sets["safe"] else [np.inf] * len(shapes[0])
    limits[0] = min(limits[0], np.pi)
    inlet, goal = (sets[name] and np.array([number(a) for a in sets[name]["half_axes"]]) for name in ("inlet", "goal"))
    if inlet is not None and np.linalg.eigvalsh(shapes[0] * np.outer(inlet, inlet))[-1] > 1 + TOLERANCE:
        return "(a)"
    if goal is not None and np.linalg.eigvalsh(shapes[-1] * np.outer(goal, goal))[0] < end * (1 - TOLERANCE):
        return "(b)"
    for funnel, shape, segment in zip(funnels, shapes, segments, strict=True):
        widest = max(1.0, float(level(funnel, float(duration_of(segment)))))
        reach = np.sqrt(widest * np.diag(np.linalg.inv(shape)))
        if np.any(reach > np.array(limits) * (1 + TOLERANCE)):
            return "(c)"
    return ""


def _false_course(document: Document, funnels: list[Document], ends: list[float]) -> str:
    path, legs = document["problem"]["path"], legs_of(document)
    if sum(len(pieces) for _, pieces in legs) != len(path["pieces"]):
        return "legs"
    for _, pieces in legs:
        for before, after in itertools.pairwise(pieces):
            if abs(_speed_after(before) - number(after["speed"][0])) > TOLERANCE:
                return "speed"
    for piece in path["pieces"]:
        t = np.linspace(0, number(piece["duration"]), POSES)
        if not np.polynomial.Polynomial([number(c) for c in piece["speed"]])(t).min() > 0:
            return "speed"
    poses = poses_of(document)
    first, last = poses[0][0], poses[-1][-1]
    turn = last[0] - first[0]
    apart = [abs(turn - 2 * np.pi * round(turn / (2 * np.pi))), *np.abs(last[1:] - first[1:])]
    jump = abs(_speed_after(path["pieces"][-1]) - number(path["pieces"][0]["speed"][0]))
    if path["closed"] and (max(apart) > 2 * GAPS[0] or jump > GAPS[1] + TOLERANCE):
        return "closed"
    for index in range(len(legs) if path["closed"] else len(legs) - 1):
        (one, before), (two, after) = legs[index], legs[(index + 1) % len(legs)]
        step = _speed_after(before[-1]) - number(after[0]["speed"][0])
        if not _joins(funnels[one], ends[index], funnels[two], step):
            return "joint"
    return ""


def _speed_after(piece: Document) -> float:
    return float(_value(piece["speed"], Fraction(piece["duration"])))


def _value(coefficients: list[str], at: Fraction) -> Fraction:
    return sum((Fraction(c) * at**k for k, c in enumerate(coefficients)), Fraction(0))


def _joins(one: Document, end: float, two: Document, step: float) -> bool:
    """Whether {q = end} of one funnel, its reference's speed falling by `step` (m/s), lies in the start of the next."""
    inverse = np.linalg.inv(np.linalg.cholesky(shape_of(one)))
    directions = np.random.default_rng(3).normal(size=(20_000, 4))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(inverse @ shape_of(two) @ inverse.T)  # the last is the worst where nothing jumps
    directions = np.concatenate([directions, [vectors[:, -1], -vectors[:, -1]]])
    points = np.sqrt(max(end, 0.0)) * directions @ inverse + np.array([0.0, 0.0, 0.0, step])
    return bool(np.einsum("ni,ij,nj->n", points, shape_of(two), points).max() <= 1 + TOLERANCE)


def poses_of(document: Document) -> list[np.ndarray]:
    """Heading and position of the reference along each piece, (POSES, 3), by Gauss–Legendre quadrature."""
    path = document["problem"]["path"]
    pose = np.array([number(value) for value in path["start"]])
    nodes, weights = np.polynomial.legendre.leggauss(8)
    found = []
    for piece in path["pieces"]:
        omega, speed = (np.polynomial.Polynomial([number(c) for c in piece[name]]) for name in ("turn_rate", "speed"))
        turned = omega.integ()
        t = np.linspace(0, number(piece["duration"]), POSES)
        half = np.diff(t)[:, None] / 2
        at = t[:-1, None] + half * (1 + nodes)
        heading = pose[0] + turned(at)
        step = half * weights * speed(at)
        moved = np.stack([-(step * np.sin(heading)).sum(1), (step * np.cos(heading)).sum(1)], axis=1)
        places = pose[1:] + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
        found.append(np.column_stack([pose[0] + turned(t), places]))
        pose = found[-1][-1]
    return found


def _touches(document: Document, funnels: list[Document]) -> bool:
    """Whether a deviation on the funnel's boundary, at some sampled place, brings a disc of the body to an obstacle."""
    poses = iter(poses_of(document))
    for index, pieces in legs_of(document):
        begin, funnel = 0.0, funnels[index]
        for piece in pieces:
            at = np.linspace(begin, begin + number(piece["duration"]), POSES)
            begin = at[-1]
            root = np.sqrt(np.maximum(level(funnel, at), 0.0))
            if _reaches(next(poses), root, shape_of(funnel), document["problem"]["sets"]):
                return True
    return False


def _reaches(poses: np.ndarray, root: np.ndarray, shape: np.ndarray, surroundings: Document) -> bool:
    """Whether a deviation with xᵀ C x = root² brings a disc of the body to an obstacle, at some of the poses."""
    directions = np.random.default_rng(5).normal(size=(512, len(shape)))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    x = directions @ np.linalg.inv(np.linalg.cholesky(shape))
    for disc in surroundings["footprint"]:
        centres = body_centres(poses, root, x, number(disc["offset"])).reshape(-1, 2)
        for obstacle in surroundings["obstacles"]:
            points = np.array([[number(x), number(y)] for x, y in obstacle.get("corners") or obstacle["wall"]])
            apart = distances(centres, points, "wall" in obstacle).min()
            if apart < number(obstacle.get("round", "0")) + number(disc["radius"]) - TOLERANCE:
                return True
    return False


def body_centres(poses: np.ndarray, root: np.ndarray, x: np.ndarray, offset: float) -> np.ndarray:
    """Centres (poses, deviations, 2) of a disc for deviations √ρ x (n, 4) at reference poses (m, 3)."""
    alpha = poses[:, :1]
    lateral = np.stack([np.cos(alpha), np.sin(alpha)], axis=-1)
    forward = np.stack([-np.sin(alpha), np.cos(alpha)], axis=-1)
    scaled = root[:, None, None] * x
    heading = alpha + scaled[..., 0]
    own = offset * np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    return poses[:, None, 1:] + scaled[..., 1:2] * lateral + scaled[..., 2:3] * forward + own


def distances(points: np.ndarray, corners: np.ndarray, is_wall: bool = False) -> np.ndarray:
    """Distances of points from the hull of corners, zero inside, or from the polyline through them."""
    import shapely

    shape = shapely.LineString(corners) if is_wall else shapely.MultiPoint(corners).convex_hull
    shapely.prepare(shape)
    return np.asarray(shapely.distance(shape, shapely.points(points)))


def _level_after(funnel: Document, distance: float, fastest: float) -> float:
    """V after so many metres under the law, from 1: dV/ds = −0.95 μ/ū0 min(1, V/β̲), down to β_in."""
    lower, inner = number(funnel["beta_lower"]), number(funnel["beta_inner"])
    fallen = distance * 0.95 * number(funnel[METRE]) / fastest
    value = 1 - fallen if 1 - fallen >= lower else lower * np.exp(-(fallen - (1 - lower)) / lower)
    return max(float(value), inner)


# --- condition (d)
