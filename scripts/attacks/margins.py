"""The true margin of a funnel, in floating point and by a search: condition (d) from the graph in the document.

Many points of the shell, at many θ of a leg or at many references within bounds, the worst of them driven downhill.
"""

import json
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np


Document = dict[str, Any]
TUBE = ("curvature", "speed", "acceleration")
SECOND, METRE = "margin", "margin_per_metre"  # what a margin is counted in, by the name of its claim


def number(text: str) -> float:
    return float(Fraction(text))


def is_bounds(segment: Any) -> bool:
    """Whether it is that of every path within bounds."""
    return isinstance(segment, dict) and ("curvature" in segment or "bounds" in segment)


def duration_of(segment: Any) -> Fraction:
    return Fraction(0) if is_bounds(segment) else sum((Fraction(piece["duration"]) for piece in segment), Fraction(0))


def shape_of(funnel: Document) -> np.ndarray:
    return symmetric([number(entry) for entry in funnel["shape"]])


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


def level(funnel: Document, theta: Any) -> Any:
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


def is_bicycle(problem: Document) -> bool:
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
