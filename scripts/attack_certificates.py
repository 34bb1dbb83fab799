"""The adversary of the checker: thousands of spoiled certificates, none of which may be accepted for something false.

    python scripts/attack_certificates.py RUN_OR_CERTIFICATE... [--count 10000] [--candidates 50] [--log attacks.jsonl]

Every attack is made with the hash renewed, so that only the content speaks. A spoiled file that the checker accepts is
held against the truth by other means than the checker's: the dynamics evaluated in floating point on many points of the
shell, driven downhill. The log makes the campaign resumable: what stands in it is not tried again. Exit code 0: nothing
false was accepted and nothing crashed or hung; 1 otherwise.
"""

import argparse
import json
import random
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cfjax.check import Outcome, Report, check_document
from cfjax.check.document import document_hash
from cfjax.check.reader import Unreadable, parse_json
from cfjax.check.replay import CERTIFICATE_NAME


Document = dict[str, Any]
Attack = Callable[[random.Random, Document], "Document | bytes"]
ODD_RATIONALS = ("1e9", "1/0", "2/4", "-0", "1/-2", "--1", "0x10", "1_0", " 1", "1\n", "\u0661", "NaN", "")
LONGEST = 60.0  # seconds that any file may take, on a busy machine; the hostile ones take far less
TOLERANCE = 1e-9  # of the floating-point truth


# --- the truth, in floating point ------------------------------------------------------------------------------------


def number(text: str) -> float:
    return float(Fraction(text))


def is_true(document: Document, seed: int = 0) -> str:
    """Empty where nothing against the claim was found; else what is false."""
    problem, funnel = document["problem"], document["funnels"][0]
    segment, sets = problem["path"]["segments"][0], problem["sets"]
    claim = json.dumps([problem, {**funnel, "margin": ""}], sort_keys=True)
    shape = _symmetric([number(entry) for entry in funnel["shape"]])
    end, widest = _levels(funnel, number(segment["duration"]))
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
    if not number(funnel["margin"]) > 0 or not number(problem["inputs"][0]["lower"]) > 0:
        return "sign"
    return "(d)" if worst_margin(claim, seed) < number(funnel["margin"]) - TOLERANCE else ""


@lru_cache(maxsize=4096)
def worst_margin(claim: str, seed: int = 0) -> float:
    """The smallest margin (1/s) found on the shell: samples of it, the worst of them moved downhill."""
    problem, funnel = json.loads(claim)
    rng = np.random.default_rng(seed)
    shape = _symmetric([number(entry) for entry in funnel["shape"]])
    factor = np.linalg.cholesky(np.linalg.inv(shape))
    low, high, margins = _margin_function(problem, funnel, shape)
    size = len(shape)

    def at(points: np.ndarray) -> np.ndarray:
        directions = points[:, :size] / np.linalg.norm(points[:, :size], axis=1, keepdims=True)
        q = low + (high - low) * np.clip(points[:, size], 0, 1)
        return margins(np.sqrt(q)[:, None] * directions @ factor.T, q)

    points = np.column_stack([rng.normal(size=(4096, size)), rng.choice([0.0, 1.0, 0.5], size=4096)])
    points[:, :size] /= np.linalg.norm(points[:, :size], axis=1, keepdims=True)
    best = points[np.argsort(at(points))[:48]]
    for step in np.geomspace(0.3, 1e-5, 60):
        trials = np.repeat(best, 16, axis=0) + step * rng.normal(size=(len(best) * 16, size + 1))
        trials = np.concatenate([best, trials])
        values = at(trials)
        groups = np.concatenate([np.arange(len(best)), np.repeat(np.arange(len(best)), 16)])
        order = np.lexsort((values, groups))
        best = trials[order[np.searchsorted(groups[order], np.arange(len(best)))]]
        best[:, :size] /= np.linalg.norm(best[:, :size], axis=1, keepdims=True)
    return float(at(best).min())


def _margin_function(problem: Document, funnel: Document, shape: np.ndarray) -> tuple[float, float, Callable]:
    """Range of q in the shell, and the margin of the best vertex at deviations x (k, n) of form q (k,)."""
    segment = problem["path"]["segments"][0]
    rate, duration, inner = number(funnel["rate"]), number(segment["duration"]), number(funnel["beta_lower"])
    end, widest = _levels(funnel, duration)
    paper = funnel["template"] == "paper"
    names = [entry["name"] for entry in problem["inputs"]]
    corners = np.array(
        np.meshgrid(*[[number(entry["lower"]), number(entry["upper"])] for entry in problem["inputs"]])
    ).reshape(len(names), -1)

    def margins(x: np.ndarray, q: np.ndarray) -> np.ndarray:
        gradient = 2 * x @ shape
        drop = np.ones_like(q) if paper else np.minimum(q / inner, widest)
        timing = rate if paper else rate * q
        rates = [
            (gradient * evaluate(problem, x, dict(zip(names, corner, strict=True)))).sum(1) + timing * corner[0]
            for corner in corners.T
        ]
        return np.max(-np.stack(rates), axis=0) / drop

    low = inner - max(rate * duration, 0.0) if paper else inner * min(end, 1.0)
    return low, widest, margins


def _levels(funnel: Document, duration: float) -> tuple[float, float]:
    """ρ(T) and the largest ρ."""
    exponent = -number(funnel["rate"]) * duration
    end = 1 + exponent if funnel["template"] == "paper" else float(np.exp(exponent))
    return end, max(1.0, end)


def evaluate(problem: Document, x: np.ndarray, inputs: dict[str, float]) -> np.ndarray:
    """Rates (k, n) of deviations x (k, n) by the graph in the document."""
    vehicle, segment = problem["vehicle"], problem["path"]["segments"][0]
    values = dict(zip(vehicle["states"], x.T, strict=True)) | {f"input:{name}": value for name, value in inputs.items()}
    for name in ("turn_rate", "speed"):
        values |= {f"reference:{name}": number(segment[name]["coefficients"][0][0]), f"reference:{name}_slope": 0.0}
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
    segment = problem["path"]["segments"][0]
    omega, speed = (number(segment[name]["coefficients"][0][0]) for name in ("turn_rate", "speed"))
    x = rng.normal(size=(64, 4))
    alpha, px, py, v = x.T
    for u0, w, thrust in rng.normal(size=(8, 3)):
        rates = [
            (v + speed) / length * w - omega * u0,
            -(v + speed) * np.sin(alpha) + omega * u0 * py,
            (v + speed) * np.cos(alpha) - speed * u0 - omega * u0 * px,
            np.full(64, thrust),
        ]
        given = evaluate(problem, x, {"u0": u0, "w": w, "thrust": thrust})
        if not np.allclose(given, np.stack(rates, axis=1), rtol=1e-12, atol=1e-12):
            return False
    limits = {entry["name"]: (number(entry["lower"]), number(entry["upper"])) for entry in problem["inputs"]}
    return all(-most <= limits[k][0] <= limits[k][1] <= most for k, most in (("w", w_limit), ("thrust", t_limit)))


def _symmetric(lower: list[float]) -> np.ndarray:
    size = round((np.sqrt(8 * len(lower) + 1) - 1) / 2)
    result = np.zeros((size, size))
    result[np.tril_indices(size)] = lower
    return result + np.tril(result, -1).T


# --- the attacks -----------------------------------------------------------------------------------------------------


def leaves(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """Paths of everything in a document but single Gram entries."""
    yield path
    if isinstance(value, dict):
        for key, child in value.items():
            yield from leaves(child, (*path, key))
    elif isinstance(value, list) and not (path and path[-1] == "lower" and len(value) > 1):
        for key, child in enumerate(value):
            yield from leaves(child, (*path, key))


def parent(document: Document, path: tuple) -> tuple[Any, Any]:
    for key in path[:-1]:
        document = document[key]
    return document, path[-1]


def perturbed(rng: random.Random, value: Any) -> Any:
    """Something near, or far from, or of another kind than the value."""
    if isinstance(value, bool) or value is None:
        return rng.choice([{}, [], "0", 1])
    if isinstance(value, int):
        return rng.choice([value + 1, value - 1, -value, 2 * value, 0, value + 2**40, float(value), True, str(value)])
    if isinstance(value, str):
        try:
            exact = Fraction(value)
        except (ValueError, ZeroDivisionError):
            return rng.choice([value + "x", value.upper(), "", value[:-1], 0, "sin", "cos", "alpha", "x", "v"])
        tiny = Fraction(rng.choice([-1, 1]), 10 ** rng.randint(1, 15))
        changed = [exact * (1 + tiny), exact + tiny, -exact, 2 * exact, exact / 2, exact * 10**30, Fraction(0)]
        return rng.choice([*map(str, changed), str(changed[0]), str(changed[1]), value + "/0", "NaN", float(exact)])
    if isinstance(value, list):
        return rng.choice([value[:-1], [*value, value[-1]] if value else [0], value[::-1], [], {}, None, [[value]]])
    return rng.choice([[], None, "x", 0, {**value, "more": 1}])


def any_field(rng: random.Random, document: Document) -> Document:
    """One field, anywhere, changed."""
    path = rng.choice([p for p in leaves(document) if p])
    holder, key = parent(document, path)
    holder[key] = perturbed(rng, holder[key])
    return document


def number_field(rng: random.Random, document: Document) -> Document:
    """One exact number, anywhere, moved by a part in 10 to 1e15."""
    names = [p for p in leaves(document) if p and isinstance(_at(document, p), str) and _is_number(_at(document, p))]
    holder, key = parent(document, rng.choice(names))
    exact, tiny = Fraction(holder[key]), Fraction(rng.choice([-1, 1]), 10 ** rng.randint(1, 15))
    holder[key] = str(rng.choice([exact * (1 + tiny), exact + tiny]))
    return document


def field_dropped(rng: random.Random, document: Document) -> Document:
    path = rng.choice([p for p in leaves(document) if p])
    holder, key = parent(document, path)
    del holder[key]
    return document


def fields_swapped(rng: random.Random, document: Document) -> Document:
    """Two values of a kind change places."""
    every = [p for p in leaves(document) if p and p[-1] != "hash"]
    first = rng.choice(every)
    second = rng.choice([p for p in every if type(_at(document, p)) is type(_at(document, first))])
    if first == second[: len(first)] or second == first[: len(second)]:
        return any_field(rng, document)
    (a, i), (b, j) = parent(document, first), parent(document, second)
    a[i], b[j] = b[j], a[i]
    return document


def gram_entry(rng: random.Random, document: Document) -> Document:
    """One entry of a Gram matrix flipped in sign, in a bit, or replaced."""
    gram = rng.choice(rng.choice(_cells(document))["grams"])
    k = rng.randrange(len(gram["lower"]))
    entry = gram["lower"][k]
    gram["lower"][k] = rng.choice([-entry, entry ^ (1 << rng.randint(0, 40)), entry + rng.choice([-1, 1]), 0, 10**12])
    return document


def gram_exponent(rng: random.Random, document: Document) -> Document:
    gram = rng.choice(rng.choice(_cells(document))["grams"])
    gram["exponent"] += rng.choice([-2, -1, 1, 2])
    return document


def gram_size(rng: random.Random, document: Document) -> Document:
    gram = rng.choice(rng.choice(_cells(document))["grams"])
    gram["lower"] = gram["lower"][: rng.choice([0, 1, -1, len(gram["lower"]) // 2])] + [0] * rng.choice([0, 0, 2, 500])
    return document


def margin_raised(rng: random.Random, document: Document) -> Document:
    """λ above the truth by 1e-9 … 1: in the claim, in the cells too, and paid for out of Q₀ where it looks cheap."""
    funnel, problem = document["funnels"][0], document["problem"]
    truth = worst_margin(json.dumps([problem, {**funnel, "margin": ""}], sort_keys=True))
    margin = Fraction(truth) + Fraction(1, 10 ** rng.randint(0, 9))
    funnel["margin"] = str(margin)
    depth = rng.choice(["claim", "cells", "constant"])
    for cell in _cells(document) if depth != "claim" else []:
        more = max(margin, Fraction(cell["margin"])) * (1 + Fraction(rng.choice([0, 1, 100]), 10**6))
        if depth == "constant":
            gram = cell["grams"][0]
            gram["lower"][0] -= int((more - Fraction(cell["margin"])) * 2 ** gram["exponent"])
        cell["margin"] = str(more)
    return document


def margin_lowered(rng: random.Random, document: Document) -> Document:
    """True: what was proven proves less, too."""
    funnel = document["funnels"][0]
    funnel["margin"] = str(Fraction(funnel["margin"]) * Fraction(rng.randint(1, 999), 1000))
    return document


def pattern_left_out(rng: random.Random, document: Document) -> Document:
    """A cell left out, in place of another, or named as another."""
    cells = _cells(document)
    k = rng.randrange(len(cells))
    kind = rng.choice(["out", "twice", "renamed", "signs", "piece", "half"])
    if kind == "out":
        del cells[k]
    elif kind == "twice":
        cells[k] = cells[k - 1]
    elif kind == "renamed":
        other = rng.randrange(len(cells))
        for name in ("piece", "signs"):
            cells[k][name], cells[other][name] = cells[other][name], cells[k][name]
    elif kind == "signs":
        cells[k]["signs"] = [rng.choice([-1, 0, 1]) for _ in cells[k]["signs"]]
    elif kind == "piece":
        cells[k]["piece"] += rng.choice([-1, 1, 7])
    else:
        del cells[len(cells) // 2 :]
    return document


def remainder_lowered(rng: random.Random, document: Document) -> Document:
    """The bound of an enclosure lowered, its range narrowed, its polynomial moved."""
    entry = rng.choice(document["proofs"][0]["enclosures"])
    kind = rng.choice(["bound", "bound", "range", "coefficient", "function"])
    if kind == "bound":
        entry["bound"] = str(Fraction(entry["bound"]) * (1 - Fraction(1, 10 ** rng.randint(0, 12))))
    elif kind == "range":
        factor = Fraction(rng.randint(1, 999), 1000)
        entry["lower"], entry["upper"] = str(Fraction(entry["lower"]) * factor), str(Fraction(entry["upper"]) * factor)
    elif kind == "coefficient":
        k = rng.randrange(len(entry["coefficients"]))
        more = Fraction(rng.choice([-1, 1]), 10 ** rng.randint(1, 9))
        entry["coefficients"][k] = str(Fraction(entry["coefficients"][k]) + more)
    else:
        entry["function"] = rng.choice(["sin", "cos", "tan", "inv"])
    return document


def sets_changed(rng: random.Random, document: Document) -> Document:
    """I larger, G or S smaller (false when by much), or the other way round (true)."""
    sets = document["problem"]["sets"]
    name = rng.choice(["inlet", "goal", "safe"])
    values = sets[name]["half_widths" if name == "safe" else "half_axes"]
    k = rng.randrange(len(values))
    factor = 1 + Fraction(rng.choice([-1, 1]), rng.choice([2, 10, 100, 1000, 10**6, 10**9]))
    values[k] = str(Fraction(values[k]) * factor)
    return document


def inputs_changed(rng: random.Random, document: Document) -> Document:
    """Limits wider than the vehicle's, narrower than the proof's, turned round, or a timing that does not advance."""
    entry = rng.choice(document["problem"]["inputs"])
    side = rng.choice(["lower", "upper"])
    factor = rng.choice(
        [Fraction(-1), Fraction(0), Fraction(1, 2), Fraction(999, 1000), Fraction(1001, 1000), Fraction(2)]
    )
    entry[side] = str(Fraction(entry[side]) * factor)
    return document


def vehicle_changed(rng: random.Random, document: Document) -> Document:
    """Another car under the same name, or the same car under another."""
    vehicle = document["problem"]["vehicle"]
    nodes, outputs = vehicle["dynamics"]["nodes"], vehicle["dynamics"]["outputs"]
    kind = rng.choice(["op", "argument", "constant", "output", "parameter", "name", "state"])
    node = rng.choice([n for n in nodes if len(n) == 3 or n[0] in ("sin", "cos", "neg")])
    if kind == "op":
        node[0] = rng.choice(["add", "sub", "mul"] if len(node) == 3 else ["sin", "cos", "neg", "tan", "inv"])
    elif kind == "argument":
        node[-1] = rng.randrange(nodes.index(node))
    elif kind == "constant":
        constant = rng.choice([n for n in nodes if n[0] == "constant"] or [["constant", "1"]])
        constant[1] = str(Fraction(constant[1]) * Fraction(rng.choice([9, 99, 101, 11]), rng.choice([10, 100])))
    elif kind == "output":
        outputs[rng.randrange(len(outputs))] = rng.randrange(len(nodes))
    elif kind == "parameter":
        label = rng.choice(list(vehicle["parameters"]))
        vehicle["parameters"][label] = str(
            Fraction(vehicle["parameters"][label]) * Fraction(rng.choice([1, 9, 11]), 10)
        )
    elif kind == "name":
        vehicle["name"] = rng.choice(["bicycle", "kinematic_bicycle ", "Kinematic_bicycle", "kinematic_bicycle\n", ""])
    else:
        rng.shuffle(vehicle["states"])
    return document


def path_changed(rng: random.Random, document: Document) -> Document:
    """Another speed, turning rate or duration than the proof's."""
    segment = document["problem"]["path"]["segments"][0]
    name = rng.choice(["turn_rate", "speed", "duration"])
    factor = 1 + Fraction(rng.choice([-1, 1]), rng.choice([2, 10, 100, 10**4, 10**8]))
    if name == "duration":
        segment["duration"] = str(Fraction(segment["duration"]) * factor)
        for profile in ("turn_rate", "speed"):
            segment[profile]["breaks"][1] = segment["duration"]
    else:
        values = segment[name]["coefficients"][0]
        values[0] = str(Fraction(values[0]) * factor + (Fraction(1, 10) if values[0] == "0" else 0))
    return document


def funnel_changed(rng: random.Random, document: Document) -> Document:
    """Another V than the proof's."""
    funnel = document["funnels"][0]
    kind = rng.choice(["shape", "shape", "scale", "rate", "beta_lower", "template"])
    factor = 1 + Fraction(rng.choice([-1, 1]), rng.choice([2, 10, 100, 1000, 10**6, 10**10]))
    if kind == "template":
        funnel["template"] = {"paper": "contracting", "contracting": "paper"}[funnel["template"]]
    elif kind in ("shape", "scale"):
        chosen = [rng.randrange(len(funnel["shape"]))] if kind == "shape" else range(len(funnel["shape"]))
        for k in chosen:
            funnel["shape"][k] = str(Fraction(funnel["shape"][k]) * factor)
    else:
        funnel[kind] = str(Fraction(funnel[kind]) * factor)
    return document


def failing_funnel(rng: random.Random, document: Document) -> Document:
    """A funnel whose true margin is at most −1e-7 (… −1e-2), with a margin claimed that is tiny and positive.

    The rate at which it has to shrink is raised until the best margin that the search finds is below zero by that much.
    """
    funnel, problem = document["funnels"][0], document["problem"]
    below = Fraction(1, 10 ** rng.choice([7, 7, 5, 3, 2]))
    funnel["rate"] = str(_failing_rate(json.dumps([problem, {**funnel, "margin": ""}], sort_keys=True), below))
    margin = Fraction(1, 10 ** rng.randint(8, 12))
    funnel["margin"] = str(margin)
    if rng.random() < 0.5:
        for cell in _cells(document):
            cell["margin"] = str(margin * 2)
    return document


@lru_cache(maxsize=64)
def _failing_rate(claim: str, below: Fraction) -> Fraction:
    problem, funnel = json.loads(claim)
    low, high = Fraction(funnel["rate"]), Fraction(funnel["rate"]) + 20
    if funnel["template"] == "paper":
        high = min(high, Fraction(funnel["beta_lower"]) / Fraction(problem["path"]["segments"][0]["duration"]))
    for _ in range(30):
        middle = ((low + high) / 2).limit_denominator(2**40)
        found = worst_margin(json.dumps([problem, {**funnel, "rate": str(middle)}], sort_keys=True))
        low, high = (low, middle) if found < -float(below) else (middle, high)
    return high


def claim_turned(rng: random.Random, document: Document) -> Document:
    """A refutation made out of a proven funnel: every witness is wrong."""
    del document["proofs"]
    segment = document["problem"]["path"]["segments"][0]
    duration, states = Fraction(segment["duration"]), len(document["problem"]["vehicle"]["states"])
    scale = rng.choice([0.1, 0.3, 0.5, 1, 3])
    document |= {
        "claim": "refutation",
        "witness": {
            "condition": rng.choice("abcd"),
            "theta": str(rng.choice([Fraction(0), duration, duration * rng.randint(1, 9) / 10, -duration])),
            "x": [str(Fraction(round(rng.gauss(0, scale) * 2**20), 2**20)) for _ in range(states)],
        },
    }
    return document


def hostile_file(rng: random.Random, document: Document) -> bytes:
    """Files that are made to crash, to hang or to exhaust, or that are no files of this kind at all."""
    text = json.dumps(document)
    spliced = rng.randrange(len(text))
    gram = '"lower": [' + "7" * 5000 + ","
    nested = "[" * 100_000 + "]" * 100_000
    exploding = [["input", "alpha"]] + [["mul", k, k] for k in range(300)]
    tower = [["constant", "7/3"]] + [["mul", k, k] for k in range(300)]
    wide = [["input", name] for name in document["problem"]["vehicle"]["states"]]
    wide += [["add", k, k + 1] for k in range(3)] + [["mul", k, k] for k in range(6, 60)]

    growing = [["input", "alpha"], ["sin", 0]] + [["mul", k, k] for k in range(1, 60)]
    huge = {"node": 1, "function": "sin", "coefficients": ["0"], "lower": "-4", "upper": "4", "bound": str(2**255)}
    sums = [["input", "alpha"], ["input", "v"], ["add", 0, 1]] + [["mul", 2, k] for k in range(2, 21)]
    sums += [["add", k, k] for k in range(21, 399)]

    def with_nodes(nodes: list, enclosures: tuple = ()) -> bytes:
        changed = json.loads(text)
        dynamics = changed["problem"]["vehicle"]["dynamics"]
        dynamics["nodes"], changed["problem"]["vehicle"]["name"] = nodes, "monster"
        dynamics["outputs"] = [len(nodes) - 1] * len(dynamics["outputs"])
        changed["proofs"][0]["enclosures"] = list(enclosures)
        return renewed(changed)

    def with_change(change: Callable[[Document], Any]) -> bytes:
        changed = json.loads(text)
        change(changed)
        return renewed(changed)

    makers: list[Callable[[], bytes]] = [
        lambda: b"",
        lambda: b"\xff\xfe" + text.encode(),
        lambda: text[:spliced].encode(),
        lambda: (text[:spliced] + rng.choice("{}[],:\"'\\\0x1e") + text[spliced:]).encode(),
        lambda: nested.encode(),
        lambda: ('{"a":' * 50_000 + "1" + "}" * 50_000).encode(),
        lambda: (text[:-1] + ', "problem": ' + nested + "}").encode(),
        lambda: text.replace('"lower": [', gram, 1).encode(),
        lambda: ("9" * 3_000_000).encode(),
        lambda: ("[" + "0," * 4_000_000 + "0]").encode(),
        lambda: ("[" + "[]," * 3_000_000 + "0]").encode(),
        lambda: b" " * (9 * 2**20),
        lambda: text.replace(
            '"version": 2', '"version": ' + rng.choice(["NaN", "1.0", "true", "1e999", "-Infinity"])
        ).encode(),
        lambda: text.replace('"beta": "1"', '"beta": "1", "beta": "1"').encode(),
        lambda: with_nodes(exploding),
        lambda: with_nodes(tower),
        lambda: with_nodes(wide),
        lambda: with_nodes(growing, (huge,)),
        lambda: with_nodes(sums),
        lambda: with_change(lambda d: d["proofs"][0].update(cells=_cells(d)[:1] * 1024)),
        lambda: with_change(lambda d: _cells(d)[0]["grams"][0]["lower"].__setitem__(0, 2**65)),
        lambda: with_change(lambda d: d["funnels"][0].update(margin="1" + "0" * 399)),
        lambda: with_nodes([["input", "alpha"]] * 10_000),
        lambda: with_nodes([["sin", 0], ["input", "alpha"]]),
        lambda: with_nodes([["input", "input:u1"], ["exp", 0]]),
        lambda: with_nodes([["input", "alpha"], ["inv", 0]]),
        lambda: with_change(lambda d: _cells(d)[0]["grams"][0].update(exponent=10**9)),
        lambda: with_change(lambda d: _cells(d)[0]["grams"][0].update(exponent=-1)),
        lambda: with_change(lambda d: d["funnels"][0].update(rate=rng.choice(["1" + "0" * 300, "-100000", "65"]))),
        lambda: with_change(lambda d: d["funnels"][0].update(margin=rng.choice(ODD_RATIONALS))),
        lambda: with_change(
            lambda d: d["proofs"][0].update(degrees=rng.choice([[8] * 6, [10**9] * 6, [], [3], [True] * 6]))
        ),
        lambda: with_change(lambda d: d["problem"].update(inputs=d["problem"]["inputs"] * rng.choice([0, 2, 400]))),
        lambda: with_change(lambda d: d["problem"]["vehicle"].update(states=["alpha", "x", "x", "v"])),
        lambda: with_change(lambda d: d["problem"]["path"].update(segments=d["problem"]["path"]["segments"] * 2)),
        lambda: with_change(lambda d: d["problem"]["path"].update(name="circle\x1b[2J")),
        lambda: with_change(lambda d: d.update(proofs=d["proofs"] * 2)),
        lambda: with_change(lambda d: d["funnels"][0].update(shape=["1" + "0" * 399 + "/3"] * 10)),
        lambda: with_change(lambda d: d["proofs"][0].update(whitening=[["0"] * 4] * 4)),
    ]
    return rng.choice(makers)()


def _cells(document: Document) -> list[Document]:
    return document["proofs"][0]["cells"]


def _at(document: Any, path: tuple) -> Any:
    for key in path:
        document = document[key]
    return document


def _is_number(text: str) -> bool:
    return text.lstrip("-")[:1].isdigit() and not text.startswith("sha256")


ATTACKS: dict[str, tuple[Attack, int]] = {  # with weights
    "any field": (any_field, 16),
    "number moved": (number_field, 12),
    "field dropped": (field_dropped, 4),
    "fields swapped": (fields_swapped, 6),
    "Gram entry": (gram_entry, 10),
    "Gram exponent": (gram_exponent, 2),
    "Gram size": (gram_size, 2),
    "margin raised": (margin_raised, 10),
    "margin lowered": (margin_lowered, 1),
    "pattern left out": (pattern_left_out, 5),
    "remainder lowered": (remainder_lowered, 5),
    "sets changed": (sets_changed, 6),
    "inputs changed": (inputs_changed, 4),
    "vehicle changed": (vehicle_changed, 6),
    "path changed": (path_changed, 4),
    "funnel changed": (funnel_changed, 6),
    "failing funnel": (failing_funnel, 4),
    "claim turned": (claim_turned, 3),
    "hostile file": (hostile_file, 6),
}


# --- spoiled candidates ----------------------------------------------------------------------------------------------


def attack_candidate(index: int, seed: int, bases: list[str]) -> dict[str, Any]:
    """A funnel spoiled before it is proven: what the certifier then certifies has to be true."""
    from cfjax.certificate import certify  # with JAX and a solver, which nothing else here needs
    from cfjax.funnel import Funnel, template_named
    from cfjax.problem import Box, Ellipsoid, KinematicBicycle, Method, Path, Pose, Problem, Profile, Segment

    rng = random.Random(f"{seed}:candidate:{index}")
    document = json.loads(rng.choice(bases))
    spoil = rng.choice([failing_funnel, funnel_changed, sets_changed])
    spoiled = spoil(rng, document)
    question, entry, segment = spoiled["problem"], spoiled["funnels"][0], spoiled["problem"]["path"]["segments"][0]
    duration = number(segment["duration"])
    omega, speed = (
        Profile.constant(number(segment[name]["coefficients"][0][0]), duration) for name in ("turn_rate", "speed")
    )
    sets = question["sets"]
    outcome: dict[str, Any] = {"index": f"candidate {index}", "attack": "candidate"}
    started = time.perf_counter()
    try:
        problem = Problem(
            path=Path(question["path"]["name"], (Segment(omega, speed, Pose(0.0, 0.0, 0.0)),)),
            inlet=Ellipsoid(tuple(number(a) for a in sets["inlet"]["half_axes"])),
            goal=Ellipsoid(tuple(number(a) for a in sets["goal"]["half_axes"])),
            safe=Box(tuple(number(a) for a in sets["safe"]["half_widths"])) if sets["safe"] else None,
            vehicle=KinematicBicycle(**{k: number(v) for k, v in question["vehicle"]["parameters"].items()}),
            method=Method(question["method"]),
        )
        shape = _symmetric([number(value) for value in entry["shape"]])
        funnel = Funnel(
            template_named(entry["template"]), shape, number(entry["rate"]), duration, number(entry["beta_lower"])
        )
        found = certify(problem, [funnel], workers=2)
    except ValueError as error:  # the question itself is refused: sets that exclude each other, C not definite
        return {**outcome, "outcome": "BROKEN", "message": str(error)[:300]}
    outcome |= {"message": f"{spoil.__name__}: {found.verdict.value}: {found.message[:200]}"}
    outcome["solved in"] = round(time.perf_counter() - started, 2)
    if found.document is None:
        return {**outcome, "outcome": "BROKEN"}
    false = is_true(found.document, seed=index)
    return {**outcome, "outcome": f"FALSE {false} CERTIFIED" if false else "true, accepted"}


# --- the campaign ----------------------------------------------------------------------------------------------------


def renewed(document: Document) -> bytes:
    """The file with the hash of its content."""
    return json.dumps({**document, "hash": document_hash(document)}).encode()


def judge(content: bytes) -> tuple[Report, Any]:
    try:
        document = parse_json(content)
    except Unreadable as error:
        return Report(Outcome.UNREADABLE, str(error)), None
    return check_document(document), document


def attack(index: int, seed: int, bases: list[str]) -> dict[str, Any]:
    """The attack of that number: always the same one. Says what was tried and what came of it."""
    rng = random.Random(f"{seed}:{index}")
    name = rng.choices(list(ATTACKS), [weight for _, weight in ATTACKS.values()])[0]
    base = rng.choice(bases)
    spoiled = ATTACKS[name][0](rng, json.loads(base))
    content = spoiled if isinstance(spoiled, bytes) else renewed(spoiled)
    entry: dict[str, Any] = {"index": index, "attack": name}
    started = time.perf_counter()
    try:
        report, document = judge(content)
    except Exception as error:  # nothing may escape the checker
        return {**entry, "outcome": "CRASHED", "message": repr(error)[:300]}
    seconds = time.perf_counter() - started
    entry |= {"outcome": report.outcome.name, "seconds": round(seconds, 3), "message": report.message[:300]}
    if "\n" in report.message or not report.message.isprintable():
        entry["outcome"] = "CRASHED"
    if seconds > LONGEST:
        entry["outcome"] = "HUNG"
    if report.outcome is Outcome.PROVEN:
        false = "" if _same_or_weaker(document, json.loads(base)) else is_true(document, seed=index)
        entry["outcome"] = f"FALSE {false} ACCEPTED" if false else "true, accepted"
    if report.outcome is Outcome.REFUTED:
        entry["outcome"] = "FALSE REFUTATION"  # no attack makes a true one: the bases are proven funnels
    return entry


def _same_or_weaker(document: Document, base: Document) -> bool:
    """Whether the file claims what the base did, with a margin that is not larger."""
    given, before = document["funnels"][0], base["funnels"][0]
    same = document["problem"] == base["problem"] and {**given, "margin": ""} == {**before, "margin": ""}
    return same and 0 < Fraction(given["margin"]) <= Fraction(before["margin"])


def table(entries: list[dict[str, Any]]) -> str:
    """What was tried, what came of it, and the most frequent reasons."""
    outcomes = ["BROKEN", "UNREADABLE", "true, accepted"]
    lines = [f"{'attack':20}{'tried':>7}{'broken':>8}{'unread.':>8}{'true':>6}{'FAILED':>8}{'slowest':>9}  refused for"]
    grouped = defaultdict(list)
    for entry in entries:
        grouped[entry["attack"]].append(entry)
    for name in [*ATTACKS, "candidate", "total"]:
        rows = entries if name == "total" else grouped[name]
        counts = Counter(row["outcome"] for row in rows)
        reasons = Counter(
            _reason(row["message"]) for row in rows if row["outcome"] in ("BROKEN", "UNREADABLE") and name != "total"
        )
        common = "; ".join(f"{reason} ({count})" for reason, count in reasons.most_common(3))
        slowest = max((row.get("seconds", 0.0) for row in rows), default=0.0)
        numbers = [len(rows), *(counts[o] for o in outcomes), sum(c for o, c in counts.items() if o not in outcomes)]
        widths = (7, 8, 8, 6, 8)
        cells = "".join(f"{n:>{w}}" for n, w in zip(numbers, widths, strict=True))
        lines.append(f"{name:20}{cells}{slowest:>8.2f}s  {common}")
    return "\n".join(lines)


def _reason(message: str) -> str:
    """A message without its numbers and places."""
    words = message.split(": ")
    return " ".join("#" if any(c.isdigit() for c in word) else word for word in words[-1].split())[:60]


def failures(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [entry for entry in entries if entry["outcome"] not in ("BROKEN", "UNREADABLE", "true, accepted")]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("certificates", nargs="+", type=Path, metavar="RUN_OR_CERTIFICATE")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--candidates", type=int, default=0, help="funnels spoiled before their proof")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, default=Path("attacks.jsonl"))
    options = parser.parse_args()
    files = [path / CERTIFICATE_NAME if path.is_dir() else path for path in options.certificates]
    bases = [path.read_text() for path in files]
    for path, base in zip(files, bases, strict=True):
        report, _ = judge(base.encode())
        if report.outcome is not Outcome.PROVEN:
            parser.error(f"{path}: expected a certificate that proves a funnel; {report.message}")
    lines = options.log.read_text().splitlines() if options.log.exists() else []
    entries = [json.loads(line) for line in lines if line.endswith("}")]
    done = {entry["index"] for entry in entries}
    with options.log.open("a") as log:
        jobs = [(attack, k, k) for k in range(options.count)]
        jobs += [(attack_candidate, k, f"candidate {k}") for k in range(options.candidates)]
        for make, index, name in jobs:
            if name in done:
                continue
            entries.append(make(index, options.seed, bases))
            log.write(json.dumps(entries[-1]) + "\n")
            log.flush()
            if len(entries) % 500 == 0:
                print(f"{len(entries)} of {len(jobs)}, {len(failures(entries))} failures", flush=True)
    print(table(entries))
    for entry in failures(entries)[:20]:
        print(json.dumps(entry))
    return 1 if failures(entries) else 0


if __name__ == "__main__":
    sys.exit(main())
