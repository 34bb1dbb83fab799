"""Attacks on any field of a certificate, whatever it says."""

import random
from fractions import Fraction
from typing import Any

from attacks.document import Document, is_number, leaves, parent, value_at


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
    names = [
        p for p in leaves(document) if p and isinstance(value_at(document, p), str) and is_number(value_at(document, p))
    ]
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
    second = rng.choice([p for p in every if type(value_at(document, p)) is type(value_at(document, first))])
    if first == second[: len(first)] or second == first[: len(second)]:
        return any_field(rng, document)
    (a, i), (b, j) = parent(document, first), parent(document, second)
    a[i], b[j] = b[j], a[i]
    return document
