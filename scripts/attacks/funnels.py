"""Attacks on what is claimed of funnels: their shape, margins, models, legs; a refutation in their place."""

import json
import random
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from typing import Any

from attacks.document import Document, margin_names, stretches_of
from attacks.margins import METRE, duration_of, is_bounds, worst_margin
from attacks.problems import vehicle_changed
from attacks.truth import claim_of, segment_of


def margin_raised(rng: random.Random, document: Document) -> Document:
    """λ or μ above the truth by 1e-9 … 1: in the claim, in the cells too, paid for out of Q₀ where it looks cheap."""
    kind = rng.randrange(len(document["funnels"]))
    funnel, stretches = document["funnels"][kind], stretches_of(document, kind)
    name = rng.choice(margin_names(funnel))
    margin = Fraction(worst_margin(claim_of(document, kind), name)) + Fraction(1, 10 ** rng.randint(0, 9))
    funnel[name] = str(margin)
    needed = margin * (Fraction(stretches[0]["bounds"]["speed"][1]) if name == METRE else 1)
    depth = rng.choice(["claim", "cells", "constant"])
    for cell in [cell for own in stretches for cell in own["cells"]] if depth != "claim" else []:
        more = max(needed, Fraction(cell["margin"])) * (1 + Fraction(rng.choice([0, 1, 100]), 10**6))
        if depth == "constant":
            gram = cell["grams"][0]
            gram["lower"][0] -= int((more - Fraction(cell["margin"])) * 2 ** gram["exponent"])
        cell["margin"] = str(more)
    return document


def margin_lowered(rng: random.Random, document: Document) -> Document:
    """True: what was proven proves less, too."""
    funnel = rng.choice(document["funnels"])
    name = rng.choice(margin_names(funnel))
    funnel[name] = str(Fraction(funnel[name]) * Fraction(rng.randint(1, 999), 1000))
    return document


def leg_changed(rng: random.Random, document: Document) -> Document:
    """Another funnel along a leg, a leg that ends elsewhere, or a joint that says more or less than is so."""
    legs, joints = document["legs"], document["joints"]
    near = Fraction(rng.choice([-1, 1]), 10 ** rng.randint(0, 9))
    how = rng.choice(["funnel", "end", "ratio", "ratio", "cut", "drop"])
    if not legs:
        return funnel_changed(rng, document)
    leg = rng.choice(legs)
    if how == "funnel":
        leg["funnel"] = rng.randrange(len(document["funnels"]))
    elif how == "end":
        leg["end"] += rng.choice([-1, 1])
    elif how == "ratio" and joints:
        joint = rng.choice(joints)
        joint["ratio"] = str(Fraction(joint["ratio"]) * (1 + near))
    elif how == "cut":
        legs.insert(legs.index(leg), {**leg, "end": leg["end"] - 1})
        joints.append({"ratio": str(rng.choice([Fraction(1, 2), 1 - Fraction(1, 10**9), Fraction(1)]))})
    else:
        legs.remove(leg)
        del joints[:1]
    return document


def model_changed(rng: random.Random, document: Document) -> Document:
    """A funnel for another car, with other inputs or by another scale; a car that drives with other limits."""
    problem, funnel = document["problem"], rng.choice(document["funnels"])
    near = Fraction(rng.choice([-1, 1]), 10 ** rng.randint(0, 9))
    model = funnel["model"]
    if model is None:
        same = {name: json.loads(json.dumps(problem[name])) for name in ("vehicle", "inputs")}
        model = funnel["model"] = {**same, "length": "1", "speed": "1"}
    how = rng.choice(["scale", "inputs", "driver", "parameters", "vehicle"])
    if how == "scale":
        name = rng.choice(["length", "speed"])
        model[name] = str(Fraction(model[name]) * (1 + near) + Fraction(1, 10**9))
    elif how == "vehicle":
        vehicle_changed(rng, {"problem": {"vehicle": model["vehicle"]}})
    elif how == "parameters":
        parameters = rng.choice([model, problem])["vehicle"]["parameters"]
        name = rng.choice(list(parameters))
        parameters[name] = str(Fraction(parameters[name]) * (1 + near) + Fraction(1, 10**9))
    else:
        entry = rng.choice((model if how == "inputs" else problem)["inputs"])
        side = rng.choice(["lower", "upper"])
        entry[side] = str(Fraction(entry[side]) * (1 + near))
    return document


def funnel_changed(rng: random.Random, document: Document) -> Document:
    """Another V than the proof's."""
    funnel = rng.choice(document["funnels"])
    kind = rng.choice(["shape", "shape", "scale", "rate", "beta_lower", "beta_inner", "levels", "template"])
    factor = 1 + Fraction(rng.choice([-1, 1]), rng.choice([2, 10, 100, 1000, 10**6, 10**10]))
    if kind == "template":
        funnel["template"] = {"paper": "contracting", "contracting": "paper"}[funnel["template"]]
    elif kind == "levels":  # the demand moved: from β̲ to β_in, or a deeper shell
        funnel["beta_lower" if rng.random() < 0.5 else "beta_inner"] = str(Fraction(rng.randint(1, 99), 100))
    elif kind == "rate" and is_bounds(segment_of(document)):
        funnel["rate"] = str(Fraction(rng.choice([-1, 1]), 10 ** rng.randint(1, 300)))
    elif kind in ("shape", "scale"):
        chosen = [rng.randrange(len(funnel["shape"]))] if kind == "shape" else range(len(funnel["shape"]))
        for k in chosen:
            funnel["shape"][k] = str(Fraction(funnel["shape"][k]) * factor)
    else:
        funnel[kind] = str(Fraction(funnel[kind]) * factor)
    return document


def failing_funnel(rng: random.Random, document: Document) -> Document:
    """A funnel whose true margin is at most −1e-7 (… −1e-2), with a margin claimed that is tiny and positive.

    What is asked is raised until the best margin that the search finds is below zero by that much: the rate at which
    the funnel has to shrink, for a tube the curvature.
    """
    kind = rng.randrange(len(document["funnels"]))
    funnel, segment = document["funnels"][kind], segment_of(document, kind)
    below = Fraction(1, 10 ** rng.choice([7, 7, 5, 3, 2]))
    if METRE in margin_names(funnel) and not is_bounds(segment):
        return margin_raised(rng, document)
    if is_bounds(segment):
        segment["curvature"] = _with_curvature(segment, _failing_curvature(claim_of(document), below))["curvature"]
    else:
        funnel["rate"] = str(_failing_rate(claim_of(document, kind), below))
    margin = Fraction(1, 10 ** rng.randint(8, 12))
    for name in margin_names(funnel):
        funnel[name] = str(margin)
    if rng.random() < 0.5:
        for cell in [cell for own in stretches_of(document, kind) for cell in own["cells"]]:
            cell["margin"] = str(margin * 2)
    return document


@lru_cache(maxsize=64)
def _failing_rate(claim: str, below: Fraction) -> Fraction:
    problem, funnel, segment = json.loads(claim)
    low, high = Fraction(funnel["rate"]), Fraction(funnel["rate"]) + 20
    if funnel["template"] == "paper":
        high = min(high, Fraction(funnel["beta_inner"]) / duration_of(segment))
    return _bisected(low, high, lambda rate: [problem, {**funnel, "rate": str(rate)}, segment], below)


@lru_cache(maxsize=64)
def _failing_curvature(claim: str, below: Fraction) -> Fraction:
    problem, funnel, segment = json.loads(claim)

    def curved(upper: Fraction) -> Any:
        return [problem, funnel, _with_curvature(segment, upper)]

    upper = Fraction(segment["curvature"][1])
    return _bisected(upper, upper + 10, curved, below)


def _with_curvature(segment: Document, upper: Fraction) -> Document:
    """The tube with that upper end; the lower end is moved along where it mirrors the upper one."""
    lower, before = map(Fraction, segment["curvature"])
    return {**segment, "curvature": [str(-upper if lower == -before else lower), str(upper)]}


def _bisected(low: Fraction, high: Fraction, claim: Callable[[Fraction], Any], below: Fraction) -> Fraction:
    for _ in range(30):
        middle = ((low + high) / 2).limit_denominator(2**40)
        fails = worst_margin(json.dumps(claim(middle), sort_keys=True)) < -float(below)
        low, high = (low, middle) if fails else (middle, high)
    return high


def claim_turned(rng: random.Random, document: Document) -> Document:
    """A refutation made out of a proven funnel: every witness is wrong."""
    del document["hints"]
    duration = duration_of(segment_of(document))
    states = len(document["problem"]["vehicle"]["states"])
    scale = rng.choice([0.1, 0.3, 0.5, 1, 3])
    document |= {
        "claim": "refutation",
        "joints": [],
        "witness": {
            "condition": rng.choice("abcd"),
            "leg": rng.randrange(max(len(document["legs"]), 1)),
            "theta": str(rng.choice([Fraction(0), duration, duration * rng.randint(1, 9) / 10, -duration])),
            "reference": rng.choice([0, 0, rng.randrange(8), 8]),
            "x": [str(Fraction(round(rng.gauss(0, scale) * 2**20), 2**20)) for _ in range(states)],
        },
    }
    return document
