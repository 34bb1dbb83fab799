"""Attacks on the problem: sets, inputs, vehicle, path, bounds, obstacles."""

import random
from fractions import Fraction

from attacks.document import Document, stretches_of
from attacks.margins import TUBE, duration_of, is_bounds
from attacks.truth import legs_of, segment_of


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
    last = stretches_of(document, kind)[-1]
    if last["end"] is not None:
        last["end"] = str(duration_of(segment_of(document, kind)))


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
