"""Whether what a certificate claims is true, in floating point and by a search: what the checker is held against.

Nothing of the checker is used. The dynamics are evaluated from the graph in the document, on many points of the shell
(and, for a tube, at many references within its bounds), the worst of them driven downhill.
"""

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


def number(text: str) -> float:
    return float(Fraction(text))


def is_true(document: Document, seed: int = 0) -> str:
    """Empty where nothing against the claim was found; else what is false."""
    problem, funnel = document["problem"], document["funnels"][0]
    segment, sets = segment_of(document), problem["sets"]
    shape = symmetric([number(entry) for entry in funnel["shape"]])
    end, widest = _levels(funnel, segment)
    inlet, goal = (np.array([number(a) for a in sets[name]["half_axes"]]) for name in ("inlet", "goal"))
    if np.linalg.eigvalsh(shape * np.outer(inlet, inlet))[-1] > 1 + TOLERANCE:
        return "(a)"
    if np.linalg.eigvalsh(shape * np.outer(goal, goal))[0] < end * (1 - TOLERANCE):
        return "(b)"
    reach = np.sqrt(widest * np.diag(np.linalg.inv(shape)))
    limits = [number(width) for width in sets["safe"]["half_widths"]] if sets["safe"] else [np.inf] * len(reach)
    limits[0] = min(limits[0], np.pi)
    if np.any(reach > np.array(limits) * (1 + TOLERANCE)):
        return "(c)"
    if problem["vehicle"]["name"] == "kinematic_bicycle" and not _is_bicycle(problem):
        return "vehicle"
    claims = [name for name in (SECOND, METRE) if funnel[name] is not None]
    if is_tube(segment) != (METRE in claims) or (is_tube(segment) and number(funnel["rate"])):
        return "kind"
    if any(not number(funnel[name]) > 0 for name in claims) or not number(problem["inputs"][0]["lower"]) > 0:
        return "sign"
    short = any(worst_margin(claim_of(document), name, seed) < number(funnel[name]) - TOLERANCE for name in claims)
    return "(d)" if short else ""


def segment_of(document: Document) -> Document:
    return document["problem"]["path"]["segments"][0]


def is_tube(segment: Document) -> bool:
    return "curvature" in segment


def claim_of(document: Document) -> str:
    """What the true margins depend on."""
    funnel = {**document["funnels"][0], SECOND: "", METRE: ""}
    return json.dumps([document["problem"], funnel], sort_keys=True)


@lru_cache(maxsize=4096)
def worst_margin(claim: str, unit: str = SECOND, seed: int = 0) -> float:
    """The smallest margin (1/s, or 1/m at u0 = 1) found: samples of shell and references, the worst moved downhill."""
    problem, funnel = json.loads(claim)
    rng = np.random.default_rng(seed)
    shape = symmetric([number(entry) for entry in funnel["shape"]])
    factor = np.linalg.cholesky(np.linalg.inv(shape))
    low, high, margins = _margin_function(problem, funnel, shape, unit)
    size = len(shape)
    free = 1 + len(TUBE)  # coordinates in [0, 1] beside the direction: level and reference

    def at(points: np.ndarray) -> np.ndarray:
        directions = points[:, :size] / np.linalg.norm(points[:, :size], axis=1, keepdims=True)
        fractions = np.clip(points[:, size:], 0, 1)
        q = low + (high - low) * fractions[:, 0]
        return margins(np.sqrt(q)[:, None] * directions @ factor.T, q, fractions[:, 1:])

    corners = rng.choice([0.0, 1.0, 0.5], size=(4096, free), p=[0.4, 0.4, 0.2])
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
    problem: Document, funnel: Document, shape: np.ndarray, unit: str
) -> tuple[float, float, Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]]:
    """Range of q in the shell; the margin of the best vertex at deviations x (k, n) of form q (k,) and references."""
    segment = problem["path"]["segments"][0]
    rate, lower, inner = (number(funnel[name]) for name in ("rate", "beta_lower", "beta_inner"))
    end, widest = _levels(funnel, segment)
    paper = funnel["template"] == "paper"
    change = max(1 - end, 0.0)  # of a `paper` V along the segment
    names = [entry["name"] for entry in problem["inputs"]]
    corners = np.array(
        np.meshgrid(*[[number(entry["lower"]), number(entry["upper"])] for entry in problem["inputs"]])
    ).reshape(len(names), -1)

    def margins(x: np.ndarray, q: np.ndarray, fractions: np.ndarray) -> np.ndarray:
        gradient = 2 * x @ shape
        drop = np.minimum(1, (q + change) / lower) if paper else np.minimum(q / lower, widest)
        timing = rate if paper else rate * q
        reference = _reference(segment, fractions)
        rates = [
            (gradient * evaluate(problem, x, dict(zip(names, corner, strict=True)), reference)).sum(1)
            + timing * corner[0]
            for corner in corners.T
        ]
        return np.max(-np.stack(rates), axis=0) / drop / (reference["speed"] if unit == METRE else 1.0)

    return (inner - change if paper else inner * min(end, 1.0)), widest, margins


def _reference(segment: Document, fractions: np.ndarray) -> dict[str, Any]:
    """Profile of the references that lie at these fractions (k, 3) of a tube's bounds; a segment has but one."""
    if not is_tube(segment):
        omega, speed = (number(segment[name]["coefficients"][0][0]) for name in ("turn_rate", "speed"))
        return {"turn_rate": omega, "speed": speed, "turn_rate_slope": 0.0, "speed_slope": 0.0}
    ends = np.array([[number(end) for end in segment[name]] for name in TUBE])
    kappa, speed, acceleration = (ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * fractions.T)[:]
    return {"turn_rate": kappa * speed, "speed": speed, "turn_rate_slope": 0.0, "speed_slope": acceleration}


def _levels(funnel: Document, segment: Document) -> tuple[float, float]:
    """ρ(T) and the largest ρ."""
    exponent = -number(funnel["rate"]) * (0.0 if is_tube(segment) else number(segment["duration"]))
    end = 1 + exponent if funnel["template"] == "paper" else float(np.exp(exponent))
    return end, max(1.0, end)


def evaluate(problem: Document, x: np.ndarray, inputs: dict[str, float], reference: dict[str, Any]) -> np.ndarray:
    """Rates (k, n) of deviations x (k, n) by the graph in the document."""
    vehicle = problem["vehicle"]
    values: dict[str, Any] = dict(zip(vehicle["states"], x.T, strict=True))
    values |= {f"input:{name}": value for name, value in inputs.items()}
    values |= {f"reference:{name}": value for name, value in reference.items()}
    binary = {"add": np.add, "sub": np.subtract, "mul": np.multiply}
    unary = {"neg": np.negative, "sin": np.sin, "cos": np.cos, "tan": np.tan, "inv": np.reciprocal}
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
