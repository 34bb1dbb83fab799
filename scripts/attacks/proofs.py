"""Attacks on the proof: Gram matrices, sign patterns, stretches, mirror images, enclosures."""

import random
from fractions import Fraction

from attacks.document import Document, cells_of, stretches_of
from attacks.margins import TUBE, is_bounds
from attacks.problems import inputs_changed
from attacks.truth import segment_of


def gram_entry(rng: random.Random, document: Document) -> Document:
    """One entry of a Gram matrix flipped in sign, in a bit, or replaced."""
    gram = rng.choice(rng.choice(cells_of(document))["grams"])
    k = rng.randrange(len(gram["lower"]))
    entry = gram["lower"][k]
    gram["lower"][k] = rng.choice([-entry, entry ^ (1 << rng.randint(0, 40)), entry + rng.choice([-1, 1]), 0, 10**12])
    return document


def gram_exponent(rng: random.Random, document: Document) -> Document:
    gram = rng.choice(rng.choice(cells_of(document))["grams"])
    gram["exponent"] += rng.choice([-2, -1, 1, 2])
    return document


def gram_size(rng: random.Random, document: Document) -> Document:
    gram = rng.choice(rng.choice(cells_of(document))["grams"])
    gram["lower"] = gram["lower"][: rng.choice([0, 1, -1, len(gram["lower"]) // 2])] + [0] * rng.choice([0, 0, 2, 500])
    return document


def pattern_left_out(rng: random.Random, document: Document) -> Document:
    """A cell left out, in place of another, or named as another."""
    stretch = rng.choice(stretches_of(document))
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
        remainder = rng.choice(cells_of(document))["remainder"]
        k, more = rng.randrange(2), Fraction(rng.choice([-1, -1, 1]), 10 ** rng.randint(0, 15))
        remainder[k] = str(Fraction(remainder[k]) * (1 + more))
        return document
    entry = rng.choice(rng.choice(stretches_of(document))["enclosures"])
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


def stretch_changed(rng: random.Random, document: Document) -> Document:
    """A stretch left out, in place of another, longer or shorter, with other bounds or the cells of its neighbour."""
    kind = rng.randrange(len(document["funnels"]))
    stretches = stretches_of(document, kind)
    chosen, other = rng.choice(stretches), rng.choice(stretches_of(document))
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


def function_dropped(rng: random.Random, document: Document) -> Document:
    """The graph without one of its functions: a constant or its argument in the place of sine or cosine."""
    nodes = document["problem"]["vehicle"]["dynamics"]["nodes"]
    index = rng.choice([k for k, node in enumerate(nodes) if node[0] in ("sin", "cos", "tan", "inv")])
    nodes[index] = rng.choice([["constant", rng.choice(["0", "1"])], ["mul", nodes[index][1], nodes[index][1]]])
    for stretch in stretches_of(document):
        stretch["enclosures"] = [entry for entry in stretch["enclosures"] if entry["node"] != index]
    if rng.random() < 0.2:  # true of some other car
        document["problem"]["vehicle"]["name"] = "other"
    return document
