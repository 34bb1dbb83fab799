"""Whether what a certificate claims is true, in floating point and by a search: what the checker is held against.

Nothing of the checker is used. The dynamics are evaluated from the graph in the document, on many points of the shell
(at many θ of a leg, at many references within bounds), the worst of them driven downhill; joints, the end of a lap and
obstacles are sampled. Of a funnel that is proven for another car nothing is asked but that the car that drives has it.
"""

import itertools
import json
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np


Document = dict[str, Any]
TOLERANCE = 1e-9
TUBE = ("curvature", "speed", "acceleration")
SECOND, METRE = "margin", "margin_per_metre"  # what a margin is counted in, by the name of its claim
GAPS = (1e-6, 1e-9)  # rad or m, m/s: within which a lap is closed
POSES = 129  # of each piece, at which obstacles are looked at


def number(text: str) -> float:
    return float(Fraction(text))


def is_true(document: Document, seed: int = 0) -> str:
    """Empty where nothing against the claim was found; else what is false."""
    problem, sets = document["problem"], document["problem"]["sets"]
    if problem["vehicle"]["name"] == "kinematic_bicycle" and not _is_bicycle(problem):
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


def is_bounds(segment: Any) -> bool:
    """Whether it is that of every path within bounds."""
    return isinstance(segment, dict) and ("curvature" in segment or "bounds" in segment)


def duration_of(segment: Any) -> Fraction:
    return Fraction(0) if is_bounds(segment) else sum((Fraction(piece["duration"]) for piece in segment), Fraction(0))


def shape_of(funnel: Document) -> np.ndarray:
    return symmetric([number(entry) for entry in funnel["shape"]])


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
        widest = max(1.0, float(_level(funnel, float(duration_of(segment)))))
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
            root = np.sqrt(np.maximum(_level(funnel, at), 0.0))
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


@lru_cache(maxsize=4096)
def worst_margin(claim: str, unit: str = SECOND, seed: int = 0) -> float:
    """The smallest margin (1/s, or 1/m at u0 = 1) found: samples of shell and references, the worst moved downhill."""
    problem, funnel, segment = json.loads(claim)
    rng = np.random.default_rng(seed)
    factor = np.linalg.cholesky(np.linalg.inv(shape_of(funnel)))
    margins = _margin_function(problem, funnel, segment, unit)
    size = len(factor)
    free = 1 + len(TUBE)  # coordinates in [0, 1] beside the direction: level and reference

    def at(points: np.ndarray) -> np.ndarray:
        directions = points[:, :size] / np.linalg.norm(points[:, :size], axis=1, keepdims=True)
        return margins(directions @ factor.T, np.clip(points[:, size:], 0, 1))

    corners = rng.choice([0.0, 1.0, 0.5], size=(4096, free), p=[0.4, 0.4, 0.2])
    if not is_bounds(segment):
        corners[::2, 1] = rng.uniform(size=2048)  # θ has no ends that are worst
    points = np.column_stack([rng.normal(size=(4096, size)), corners])
    points[:, :size] /= np.linalg.norm(points[:, :size], axis=1, keepdims=True)
    best = points[np.argsort(at(points))[:48]]
    for step in np.geomspace(0.3, 1e-5, 60):
        trials = np.repeat(best, 16, axis=0) + step * rng.normal(size=(len(best) * 16, size + free))
        trials = np.concatenate([best, trials])
        trials[:, size:] = np.clip(trials[:, size:], 0, 1)
        values = at(trials)
        groups = np.concatenate([np.arange(len(best)), np.repeat(np.arange(len(best)), 16)])
        order = np.lexsort((values, groups))
        best = trials[order[np.searchsorted(groups[order], np.arange(len(best)))]]
        best[:, :size] /= np.linalg.norm(best[:, :size], axis=1, keepdims=True)
    return float(at(best).min())


def _margin_function(
    problem: Document, funnel: Document, segment: Any, unit: str
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The margin of the best vertex at directions (k, n) with q = 1, and fractions of the shell and of references.

    V̇ = σ (q̇ + timing u0), and the margin is −V̇ over min(1, V/β̲), at the true θ of a segment.
    """
    shape = shape_of(funnel)
    rate, lower, inner = (number(funnel[name]) for name in ("rate", "beta_lower", "beta_inner"))
    duration = float(duration_of(segment))
    paper = funnel["template"] == "paper"
    names = [entry["name"] for entry in problem["inputs"]]
    corners = np.array(
        np.meshgrid(*[[number(entry["lower"]), number(entry["upper"])] for entry in problem["inputs"]])
    ).reshape(len(names), -1)

    def margins(directions: np.ndarray, fractions: np.ndarray) -> np.ndarray:
        theta = duration * fractions[:, 1]
        value = inner + (1 - inner) * fractions[:, 0]
        sigma = np.ones_like(theta) if paper else np.exp(rate * theta)
        q = value - rate * theta if paper else value / sigma
        x = np.sqrt(np.maximum(q, 1e-12))[:, None] * directions
        reference = _reference(segment, theta, fractions[:, 1:])
        timing = rate if paper else rate * q
        rates = [
            ((2 * x @ shape) * evaluate(problem, x, dict(zip(names, corner, strict=True)), reference)).sum(1)
            + timing * corner[0]
            for corner in corners.T
        ]
        drop = np.minimum(1, value / lower)
        return np.max(-np.stack(rates), axis=0) * sigma / drop / (reference["speed"] if unit == METRE else 1.0)

    return margins


def _reference(segment: Any, theta: np.ndarray, fractions: np.ndarray) -> dict[str, Any]:
    """Profiles at θ (k,) of a segment; of a tube those that lie at these fractions (k, 3) of its bounds."""
    if is_bounds(segment):
        ends = np.array([[number(end) for end in segment[name]] for name in TUBE])
        kappa, speed, acceleration = (ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * fractions.T)[:]
        return {"turn_rate": kappa * speed, "speed": speed, "turn_rate_slope": 0.0, "speed_slope": acceleration}
    begins = np.concatenate([[0.0], np.cumsum([number(piece["duration"]) for piece in segment])])
    owner = np.clip(np.searchsorted(begins, theta, side="right") - 1, 0, len(segment) - 1)
    t = theta - begins[owner]

    def along(name: str, order: int) -> np.ndarray:
        curves = [np.polynomial.Polynomial([number(c) for c in piece[name]]) for piece in segment]
        every = np.stack([(curve.deriv(order) if order else curve)(t) + 0 * t for curve in curves])
        return every[owner, np.arange(len(t))]

    return {
        "turn_rate": along("turn_rate", 0),
        "speed": along("speed", 0),
        "turn_rate_slope": along("turn_rate", 1),
        "speed_slope": along("speed", 1),
    }


def _level(funnel: Document, theta: Any) -> Any:
    """ρ(θ)."""
    rate = number(funnel["rate"])
    return 1 - rate * theta if funnel["template"] == "paper" else np.exp(-rate * theta)


def evaluate(problem: Document, x: np.ndarray, inputs: dict[str, float], reference: dict[str, Any]) -> np.ndarray:
    """Rates (k, n) of deviations x (k, n) by the graph in the document."""
    vehicle = problem["vehicle"]
    values: dict[str, Any] = dict(zip(vehicle["states"], x.T, strict=True))
    values |= {f"input:{name}": value for name, value in inputs.items()}
    values |= {f"reference:{name}": value for name, value in reference.items()}
    binary = {"add": np.add, "sub": np.subtract, "mul": np.multiply}
    unary = {"neg": np.negative, "sin": np.sin, "cos": np.cos, "tan": np.tan, "sqrt": np.sqrt, "inv": np.reciprocal}
    done: list[Any] = []
    for op, *args in vehicle["dynamics"]["nodes"]:
        if op == "input":
            done.append(values[args[0]])
        elif op == "constant":
            done.append(number(args[0]))
        else:
            done.append((binary | unary)[op](*(done[arg] for arg in args)))
    return np.stack([np.broadcast_to(done[k], len(x)) for k in vehicle["dynamics"]["outputs"]], axis=1)


def _is_bicycle(problem: Document) -> bool:
    """Whether graph and limits are those of the paper's car with the parameters in the document."""
    rng, parameters = np.random.default_rng(1), problem["vehicle"]["parameters"]
    length, w_limit, t_limit = (number(parameters[k]) for k in ("wheelbase", "max_tan_steering", "max_thrust"))
    x = rng.normal(size=(64, 4))
    alpha, px, py, v = x.T
    for u0, w, thrust, omega, speed, omega_slope, speed_slope in rng.normal(size=(8, 7)):
        rates = [
            (v + speed) / length * w - omega * u0,
            -(v + speed) * np.sin(alpha) + omega * u0 * py,
            (v + speed) * np.cos(alpha) - speed * u0 - omega * u0 * px,
            np.full(64, thrust - speed_slope * u0),
        ]
        reference = {"turn_rate": omega, "speed": speed, "turn_rate_slope": omega_slope, "speed_slope": speed_slope}
        given = evaluate(problem, x, {"u0": u0, "w": w, "thrust": thrust}, reference)
        if not np.allclose(given, np.stack(rates, axis=1), rtol=1e-12, atol=1e-12):
            return False
    limits = {entry["name"]: (number(entry["lower"]), number(entry["upper"])) for entry in problem["inputs"]}
    return all(-most <= limits[k][0] <= limits[k][1] <= most for k, most in (("w", w_limit), ("thrust", t_limit)))


def symmetric(lower: list[float]) -> np.ndarray:
    size = round((np.sqrt(8 * len(lower) + 1) - 1) / 2)
    result = np.zeros((size, size))
    result[np.tril_indices(size)] = lower
    return result + np.tril(result, -1).T
