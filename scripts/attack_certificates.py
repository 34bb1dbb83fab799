"""The adversary of the checker: thousands of spoiled certificates, none of which may be accepted for something false.

    python scripts/attack_certificates.py RUN_OR_CERTIFICATE... [--count 10000] [--candidates 50]

Every attack is made with the hash renewed, so that only the content speaks. A spoiled file that the checker accepts is
held against the truth by other means than the checker's (`certificate_truth`). The log makes the campaign resumable:
what stands in it is not tried again. Exit code 0: nothing false was accepted and nothing crashed or hung; 1 otherwise.
"""

import argparse
import json
import random
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from certificate_truth import (
    METRE,
    SECOND,
    TUBE,
    claim_of,
    duration_of,
    is_bounds,
    is_true,
    legs_of,
    number,
    segment_of,
    shape_of,
    worst_margin,
)

from cfcheck import Outcome, Report, check_document
from cfcheck.claims.document import document_hash
from cfcheck.reader import Unreadable, parse_json
from cfcheck.replay import CERTIFICATE_NAME


Document = dict[str, Any]
Attack = Callable[[random.Random, Document], "Document | bytes"]
ODD_RATIONALS = ("1e9", "1/0", "2/4", "-0", "1/-2", "--1", "0x10", "1_0", " 1", "1\n", "\u0661", "NaN", "")
LONGEST = 60.0  # seconds that any file may take, on a busy machine; the hostile ones take far less


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
    """λ or μ above the truth by 1e-9 … 1: in the claim, in the cells too, paid for out of Q₀ where it looks cheap."""
    kind = rng.randrange(len(document["funnels"]))
    funnel, stretches = document["funnels"][kind], _stretches(document, kind)
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


def margin_names(funnel: Document) -> list[str]:
    return [name for name in (SECOND, METRE) if funnel[name] is not None]


def pattern_left_out(rng: random.Random, document: Document) -> Document:
    """A cell left out, in place of another, or named as another."""
    stretch = rng.choice(_stretches(document))
    cells = stretch["cells"]
    k = rng.randrange(len(cells))
    kind = rng.choice(["out", "twice", "renamed", "signs", "piece", "half", "reference", "reference"])
    if kind == "out":
        del cells[k]
    elif kind == "twice":
        cells[k] = cells[k - 1]
    elif kind == "renamed":
        other = rng.randrange(len(cells))
        for name in ("reference", "piece", "signs"):
            cells[k][name], cells[other][name] = cells[other][name], cells[k][name]
    elif kind == "signs":
        cells[k]["signs"] = [rng.choice([-1, 0, 1]) for _ in cells[k]["signs"]]
    elif kind == "piece":
        cells[k]["piece"] += rng.choice([-1, 1, 7])
    elif kind == "reference":
        _references_mixed(rng, stretch)
    else:
        del cells[len(cells) // 2 :]
    return document


def _references_mixed(rng: random.Random, stretch: Document) -> None:
    """A reference without its proof, with another's, or with the signs of another vertex."""
    cells = stretch["cells"]
    one, other = rng.choice(cells)["reference"], rng.choice(cells)["reference"]
    kind = rng.choice(["out", "swapped", "copied", "signs", "number"])
    if kind == "copied":
        copies = [{**cell, "reference": one} for cell in cells if cell["reference"] == other]
        stretch["cells"] = [cell for cell in cells if cell["reference"] != one] + copies
    elif kind == "out":
        stretch["cells"] = [cell for cell in cells if cell["reference"] != one] or cells[:1]
    for cell in cells:
        if kind == "swapped":
            cell["reference"] = {one: other, other: one}.get(cell["reference"], cell["reference"])
        elif kind == "signs" and cell["reference"] == one:
            flipped = rng.randrange(len(cell["signs"])) if cell is cells[0] else 0
            cell["signs"][flipped] *= -1
        elif kind == "number":
            cell["reference"] = rng.choice([cell["reference"], cell["reference"] + 1, 7])


def mirror_broken(rng: random.Random, document: Document) -> Document:
    """What makes one end of the curvature speak for both is spoiled, by very little."""
    segment = segment_of(document)
    if not is_bounds(segment):
        return inputs_changed(rng, document)
    tiny = Fraction(rng.choice([-1, 1]), 10 ** rng.randint(1, 40))
    kind = rng.choice(["shape", "curvature", "one-sided", "steering", "signs", "signs"])
    if kind == "signs":
        hints = rng.choice(document["hints"]["decrease"])
        signs = hints["mirror"] or [rng.choice([-1, 1]) for _ in range(7)]
        k = rng.randrange(len(signs))
        hints["mirror"] = rng.choice(
            [None, [-sign if index == k else sign for index, sign in enumerate(signs)], signs[1:]]
        )
    elif kind == "shape":  # between alpha, x (odd) and y, v (even)
        place = rng.choice([3, 4, 6, 7])
        document["funnels"][0]["shape"][place] = str(Fraction(document["funnels"][0]["shape"][place]) + tiny)
    elif kind == "steering":
        limits = document["problem"]["inputs"][1]
        limits["lower"] = str(Fraction(limits["lower"]) * (1 - abs(tiny)))
    else:
        side = rng.randrange(2)
        by = tiny if kind == "curvature" else -Fraction(segment["curvature"][side]) * Fraction(rng.randint(1, 10), 10)
        segment["curvature"][side] = str(Fraction(segment["curvature"][side]) + by)
    return document


def remainder_lowered(rng: random.Random, document: Document) -> Document:
    """The bound of an enclosure lowered, its range narrowed, its polynomial moved; what a cell says is left over."""
    if rng.random() < 0.3:
        remainder = rng.choice(_cells(document))["remainder"]
        k, more = rng.randrange(2), Fraction(rng.choice([-1, -1, 1]), 10 ** rng.randint(0, 15))
        remainder[k] = str(Fraction(remainder[k]) * (1 + more))
        return document
    entry = rng.choice(rng.choice(_stretches(document))["enclosures"])
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
    if not sets[name]:
        axes = {"half_widths" if name == "safe" else "half_axes": [str(Fraction(rng.randint(1, 100), 100))] * 4}
        sets[name] = axes
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
    """Another speed, turning rate or duration than the proof's, in one piece or all of them; one less; no lap."""
    path = document["problem"]["path"]
    if is_bounds(path):
        return bounds_changed(rng, document)
    name = rng.choice(["turn_rate", "speed", "duration", "start", "closed", "drop"])
    factor = 1 + Fraction(rng.choice([-1, 1]), rng.choice([2, 10, 100, 10**4, 10**8]))
    chosen = rng.choice([path["pieces"], [rng.choice(path["pieces"])]])
    if name == "closed":
        path["closed"] = not path["closed"]
        document["joints"] = rng.choice(
            [document["joints"], document["joints"][:-1], [*document["joints"], {"ratio": "1/2"}]]
        )
    elif name == "start":
        k = rng.randrange(3)
        path["start"][k] = str(Fraction(path["start"][k]) + factor - 1)
    elif name == "drop":
        path["pieces"].pop(rng.randrange(len(path["pieces"])))
        document["legs"][-1]["end"] -= rng.choice([0, 1])
    elif name == "duration":
        for piece in chosen:
            piece["duration"] = str(Fraction(piece["duration"]) * factor)
        if rng.random() < 0.5:  # the proof says that it is about the same
            _end_as(document, len(document["funnels"]) - 1)
    else:
        k = rng.randrange(len(chosen[0][name]))
        for piece in chosen:
            values = piece[name]
            k = min(k, len(values) - 1)
            values[k] = str(Fraction(values[k]) * factor + (Fraction(1, 10) if values[k] == "0" else 0))
    return document


def _end_as(document: Document, kind: int) -> None:
    """The proof of a funnel ends where its first leg does, if it has an end."""
    last = _stretches(document, kind)[-1]
    if last["end"] is not None:
        last["end"] = str(duration_of(segment_of(document, kind)))


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


def stretch_changed(rng: random.Random, document: Document) -> Document:
    """A stretch left out, in place of another, longer or shorter, with other bounds or the cells of its neighbour."""
    kind = rng.randrange(len(document["funnels"]))
    stretches = _stretches(document, kind)
    chosen, other = rng.choice(stretches), rng.choice(_stretches(document))
    how = rng.choice(
        ["out", "twice", "swapped", "end", "bounds", "bounds", "cells", "whitening", "enclosures", "first"]
    )
    if how == "out":
        stretches.remove(chosen)
    elif how == "twice":
        stretches.insert(rng.randrange(len(stretches) + 1), dict(chosen))
    elif how == "swapped":
        stretches.reverse()
    elif how == "first":
        stretches[:] = [{**stretches[0], "end": stretches[-1]["end"]}]
    elif how == "end":
        by = Fraction(rng.choice([-1, 1]), 10 ** rng.randint(0, 15))
        chosen["end"] = rng.choice([None, str(Fraction(chosen["end"] or 1) + by)])
    elif how == "bounds":
        name, side = rng.choice(TUBE), rng.randrange(2)
        ends = chosen["bounds"][name]
        ends[side] = str(Fraction(ends[side]) + Fraction(rng.choice([-1, 1]), 10 ** rng.randint(1, 15)))
    else:
        chosen[how] = other[how]
    return document


def place_changed(rng: random.Random, document: Document) -> Document:
    """An obstacle or wall moved or grown, a body enlarged, a stretch's normals or end changed; or one obstacle more."""
    sets, proofs = document["problem"]["sets"], document["hints"]
    how = rng.choice(["place", "place", "radius", "offset", "normal", "normal", "end", "out", "none", "more", "wall"])
    if not sets["obstacles"] or how in ("more", "wall"):
        points = [[str(Fraction(round(rng.gauss(0, 2) * 64), 64)) for _ in range(2)] for _ in range(rng.randint(2, 3))]
        sets["obstacles"].append({"wall": points} if how == "wall" else {"corners": points, "round": "1/4"})
        sets["footprint"] = sets["footprint"] or [{"radius": "1/4", "offset": "0"}]
        ends = [str(duration_of(pieces)) for _, pieces in legs_of(document)]
        normals = [[rng.randint(-9, 9), 1], [rng.randint(-9, 9), -1]]
        proofs["clearance"] = proofs["clearance"] or [[{"end": end, "normals": normals}] for end in ends]
    elif how == "none":
        proofs["clearance"] = []
    else:
        clearance_changed(rng, how, sets, rng.choice(proofs["clearance"]))
    return document


def clearance_changed(rng: random.Random, how: str, surroundings: Document, stretches: list) -> None:
    """An obstacle, a disc of the body or a stretch as `place_changed` has it."""
    near = Fraction(rng.choice([-1, 1]), 10 ** rng.randint(0, 9))
    obstacle, disc, stretch = map(rng.choice, (surroundings["obstacles"], surroundings["footprint"], stretches))
    if how == "place":
        if "round" in obstacle and rng.random() < 0.5:
            obstacle["round"] = str(Fraction(obstacle["round"]) + abs(near))
        else:
            point, k = rng.choice(obstacle.get("corners") or obstacle["wall"]), rng.randrange(2)
            point[k] = str(Fraction(point[k]) + near)
    elif how in ("radius", "offset"):
        disc[how] = str(Fraction(disc[how]) + near)
    elif how == "normal" and stretch["normals"]:
        normal = rng.choice(stretch["normals"])
        normal[rng.randrange(2)] += rng.choice([-1, 1]) * 10 ** rng.randint(0, 3)
    elif how == "end":
        stretch["end"] = str(Fraction(stretch["end"]) + near)
    else:
        stretches.remove(stretch)


def function_dropped(rng: random.Random, document: Document) -> Document:
    """The graph without one of its functions: a constant or its argument in the place of sine or cosine."""
    nodes = document["problem"]["vehicle"]["dynamics"]["nodes"]
    index = rng.choice([k for k, node in enumerate(nodes) if node[0] in ("sin", "cos", "tan", "inv")])
    nodes[index] = rng.choice([["constant", rng.choice(["0", "1"])], ["mul", nodes[index][1], nodes[index][1]]])
    for stretch in _stretches(document):
        stretch["enclosures"] = [entry for entry in stretch["enclosures"] if entry["node"] != index]
    if rng.random() < 0.2:  # true of some other car
        document["problem"]["vehicle"]["name"] = "other"
    return document


def bounds_changed(rng: random.Random, document: Document) -> Document:
    """A tube's bounds wider (false, where the margin is tight), narrower, turned round or moved."""
    segment = segment_of(document)
    name = rng.choice(TUBE)
    lower, upper = map(Fraction, segment[name])
    more = Fraction(rng.choice([-1, 1, 1]), rng.choice([1, 2, 10, 100, 10**4, 10**8, 10**20]))
    kind = rng.choice(["both", "lower", "upper", "moved", "turned", "point"])
    if kind in ("both", "lower", "moved"):
        lower += more if kind == "moved" else -more
    if kind in ("both", "upper", "moved"):
        upper += more
    if kind == "turned":
        lower, upper = -upper, -lower
    if kind == "point":
        lower = upper = rng.choice([lower, upper, (lower + upper) / 2])
    segment[name] = [str(lower), str(upper)]
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
        for cell in [cell for own in _stretches(document, kind) for cell in own["cells"]]:
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

    # functions of long even polynomials, and a drift that no mirror keeps: every pattern of signs looks at all of them
    mirrors = [["input", "alpha"], ["input", "v"], ["mul", 0, 0], ["mul", 1, 1], ["constant", "1"], ["add", 2, 3]]
    mirrors += [["add", 4, 5]] + [["mul", k, k] for k in range(6, 10)]
    for _ in range(28):
        mirrors += [["cos", len(mirrors) - 1], ["add", len(mirrors) - 1, 4]]

    def with_nodes(nodes: list, enclosures: tuple = ()) -> bytes:
        changed = json.loads(text)
        dynamics = changed["problem"]["vehicle"]["dynamics"]
        dynamics["nodes"], changed["problem"]["vehicle"]["name"] = nodes, "monster"
        dynamics["outputs"] = [len(nodes) - 1] * len(dynamics["outputs"])
        _stretches(changed)[0]["enclosures"] = list(enclosures)
        return renewed(changed)

    def bounds(changed: Document) -> Document:
        """A tube's own, or those of a stretch."""
        path = changed["problem"]["path"]
        return path["bounds"] if is_bounds(path) else _stretches(changed)[0]["bounds"]

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
        lambda: b" " * (33 * 2**20),
        lambda: text.replace(
            '"version": 4', '"version": ' + rng.choice(["NaN", "1.0", "true", "1e999", "-Infinity"])
        ).encode(),
        lambda: text.replace('"beta": "1"', '"beta": "1", "beta": "1"').encode(),
        lambda: with_nodes(exploding),
        lambda: with_nodes(tower),
        lambda: with_nodes(wide),
        lambda: with_nodes(growing, (huge,)),
        lambda: with_nodes(sums),
        lambda: with_nodes(mirrors),
        lambda: with_change(lambda d: _cells(d)[0].update(reference=rng.choice([8, -1, 10**9, True, "0"]))),
        lambda: with_change(lambda d: bounds(d).update(curvature=rng.choice([["1", "-1"], [], ["0"] * 3, "1"]))),
        lambda: with_change(lambda d: bounds(d).update(speed=rng.choice([["0", "1"], ["-2", "-1"], ["1"]]))),
        lambda: with_change(lambda d: bounds(d).update(speed=["1", "1" + "0" * 399])),
        lambda: with_change(lambda d: bounds(d).update(duration="1", turn_rate="1")),
        lambda: with_change(lambda d: d["funnels"][0].update(beta_inner=rng.choice(["0", "1", "-1", *ODD_RATIONALS]))),
        lambda: with_change(lambda d: d["funnels"][0].update(beta_inner="1/1" + "0" * 398)),
        lambda: with_change(lambda d: d["funnels"][0].update(margin_per_metre=rng.choice([0, "0", "-1", {}, "x"]))),
        lambda: with_change(lambda d: _stretches(d)[0].update(cells=_cells(d)[:1] * 1024)),
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
            lambda d: d["hints"]["decrease"][0].update(degrees=rng.choice([[8] * 6, [10**9] * 6, [], [3], [True] * 6]))
        ),
        lambda: with_change(lambda d: d["problem"].update(inputs=d["problem"]["inputs"] * rng.choice([0, 2, 400]))),
        lambda: with_change(lambda d: d["problem"]["vehicle"].update(states=["alpha", "x", "x", "v"])),
        lambda: with_change(lambda d: d["problem"]["path"].update(pieces=[], closed=True)),
        lambda: with_change(lambda d: d["problem"]["path"].update(name="circle\x1b[2J")),
        lambda: with_change(lambda d: d["hints"].update(decrease=d["hints"]["decrease"] * 2)),
        lambda: with_change(lambda d: d["funnels"][0].update(shape=["1" + "0" * 399 + "/3"] * 10)),
        lambda: with_change(lambda d: _stretches(d)[0].update(whitening=[["0"] * 4] * 4)),
    ]
    return rng.choice(makers)()


def _cells(document: Document) -> list[Document]:
    """Of all stretches: no list that the document holds."""
    return [cell for stretch in _stretches(document) for cell in stretch["cells"]]


def _stretches(document: Document, kind: int | None = None) -> list[Document]:
    """The list of one funnel's, or all of them in a list that the document does not hold."""
    proofs = document["hints"]["decrease"]
    return [own for proof in proofs for own in proof["stretches"]] if kind is None else proofs[kind]["stretches"]


def _is_steady(document: Document) -> bool:
    """Whether it is about a tube or one piece of constant turning rate and speed: a problem that is soon made again."""
    path = document["problem"]["path"]
    return is_bounds(path) or (len(path["pieces"]) == 1 and not document["problem"]["sets"]["obstacles"])


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
    "path changed": (path_changed, 8),
    "leg changed": (leg_changed, 6),
    "model changed": (model_changed, 6),
    "stretch changed": (stretch_changed, 8),
    "place changed": (place_changed, 8),
    "function dropped": (function_dropped, 2),
    "mirror broken": (mirror_broken, 6),
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
    from cfjax.problem import (
        Box,
        Ellipsoid,
        Interval,
        KinematicBicycle,
        Method,
        Path,
        Pose,
        Problem,
        Profile,
        Segment,
        Tube,
    )

    rng = random.Random(f"{seed}:candidate:{index}")
    document = json.loads(rng.choice([base for base in bases if _is_steady(json.loads(base))]))
    spoil = rng.choice([failing_funnel, funnel_changed, sets_changed, path_changed])
    spoiled = spoil(rng, document)
    question, entry, segment = spoiled["problem"], spoiled["funnels"][0], segment_of(spoiled)
    sets = question["sets"]
    outcome: dict[str, Any] = {"index": f"candidate {index}", "attack": "candidate"}
    started = time.perf_counter()
    try:
        if is_bounds(segment):
            steady = Tube(*(Interval(*map(number, segment[name])) for name in TUBE))
        else:
            constants = (segment[0][name][0] for name in ("turn_rate", "speed"))
            omega, speed = (Profile.constant(number(value), number(segment[0]["duration"])) for value in constants)
            steady = Segment(omega, speed, Pose(0.0, 0.0, 0.0))
        problem = Problem(
            path=Path(question["path"]["name"], (steady,)),
            inlet=Ellipsoid(tuple(number(a) for a in sets["inlet"]["half_axes"])),
            goal=Ellipsoid(tuple(number(a) for a in sets["goal"]["half_axes"])),
            safe=Box(tuple(number(a) for a in sets["safe"]["half_widths"])) if sets["safe"] else None,
            vehicle=KinematicBicycle(**{k: number(v) for k, v in question["vehicle"]["parameters"].items()}),
            method=Method(question["method"]),
        )
        shape = shape_of(entry)
        rate, *levels = (number(entry[name]) for name in ("rate", "beta_lower", "beta_inner"))
        funnel = Funnel(template_named(entry["template"]), shape, rate, steady.duration, *levels)
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


def attack(index: int, seed: int, bases: list[str], only: str | None = None) -> dict[str, Any]:
    """The attack of that number: always the same one. Says what was tried and what came of it."""
    rng = random.Random(f"{seed}:{index}")
    base = rng.choice(bases)
    name = only or rng.choices(list(ATTACKS), [weight for _, weight in ATTACKS.values()])[0]
    spoiled = ATTACKS[name][0](rng, json.loads(base))
    content = spoiled if isinstance(spoiled, bytes) else renewed(spoiled)
    entry: dict[str, Any] = {"index": index, "attack": name}
    started = time.perf_counter()
    try:
        report, document = judge(content)
    except Exception as error:  # nothing may escape the checker
        return {**entry, "outcome": "CRASHED", "message": repr(error)[:300]}
    seconds = time.perf_counter() - started
    entry |= {"outcome": report.outcome.name, "seconds": round(seconds, 3), "message": report.message[:400]}
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
    """Whether the file claims what the base did, with margins that are not larger."""

    def statement(file: Document) -> Any:
        funnels = [{**funnel, SECOND: "", METRE: ""} for funnel in file["funnels"]]
        return [file["problem"], funnels, file["legs"]]

    return statement(document) == statement(base) and all(
        given[name] is not None and 0 < Fraction(given[name]) <= Fraction(before[name])
        for given, before in zip(document["funnels"], base["funnels"], strict=True)
        for name in margin_names(before)
    )


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
    parser.add_argument("--only", choices=ATTACKS, help="this kind of attack")
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
        jobs = [(partial(attack, only=options.only), k, k) for k in range(options.count)]
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
