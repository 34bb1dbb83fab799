"""Small files that ask for endless arithmetic are refused, and soon."""

import json
import random
import time
from collections.abc import Callable
from typing import Any

import pytest
from flint import fmpq, fmpq_mpoly_ctx

from cfcheck import Outcome, check_document
from cfcheck.claims import proof
from cfcheck.claims.hints import MOST_CELLS
from cfcheck.claims.problem import MOST_PIECES
from cfcheck.exact.enclosure import Budget, Domain, UnaryEnclosure, proven_bound


Document = dict[str, Any]
PATIENCE = 60.0  # seconds on a busy machine; the slowest takes five to ten


def stretch(document: Document) -> Document:
    return document["hints"]["decrease"][0]["stretches"][0]


def nodes(document: Document) -> list:
    return document["problem"]["vehicle"]["dynamics"]["nodes"]


def add(document: Document, *node: Any) -> int:
    nodes(document).append(list(node))
    return len(nodes(document)) - 1


def unknown(document: Document, last: int) -> None:
    """The dynamics of a vehicle that the checker does not know, with this node among the outputs."""
    document["problem"]["vehicle"]["name"] = "other"
    document["problem"]["vehicle"]["dynamics"]["outputs"][0] = last


def enclose(document: Document, node: int, function: str, reach: str, bound: str, coefficients: tuple = ("0",)) -> None:
    stretch(document)["enclosures"].append(
        {
            "node": node,
            "function": function,
            "coefficients": list(coefficients),
            "lower": f"-{reach}",
            "upper": reach,
            "bound": bound,
        }
    )


def squared(document: Document, node: int, times: int) -> int:
    for _ in range(times):
        node = add(document, "mul", node, node)
    return node


def huge_remainder(document: Document) -> None:
    sine = add(document, "sin", 0)
    enclose(document, sine, "sin", "3", str(2**255))
    unknown(document, squared(document, sine, 60))


def tiny_remainder(document: Document) -> None:
    small = add(document, "mul", 0, add(document, "constant", f"1/{2**62}"))
    sine = add(document, "sin", small)
    enclose(document, sine, "sin", f"1/{2**61}", f"1/{2**252}")
    unknown(document, squared(document, sine, 300))


def long_enclosures(document: Document) -> None:
    rng = random.Random(0)
    last = 0
    for k in range(28):
        last = add(document, ("sin", "cos")[k % 2], 0)
        end = str(fmpq(3 * 2**252 + 1, 2**253 + 1))
        numbers = [str(fmpq(rng.getrandbits(250) | 1, rng.getrandbits(250) | 1)) for _ in range(12)]
        enclose(document, last, nodes(document)[last][0], end, str(2**200), tuple(numbers))
    unknown(document, last)


def too_long_enclosure(document: Document) -> None:
    sine = add(document, "sin", 0)
    enclose(document, sine, "sin", "3", "9" * 399)
    unknown(document, sine)


def filled(document: Document, last: int, op: str, other: int) -> int:
    """The graph as long as it may be: the same operation with the other node, again and again."""
    while len(nodes(document)) < 399:
        last = add(document, op, last, other)
    return last


def powered(document: Document, terms: list[int], factor: int, power: int) -> int:
    """The sum of the terms, times it (or another factor) `power` times."""
    total = terms[0]
    for term in terms[1:]:
        total = add(document, "add", total, term)
    product = total
    for _ in range(power):
        product = add(document, "mul", product, total if factor < 0 else factor)
    return product


def additions(document: Document, power: int) -> None:
    """Under the name of the bicycle: the comparison of the graphs comes before any proof."""
    inputs = [k for k, node in enumerate(nodes(document)) if node[0] == "input"]
    product = powered(document, inputs, -1, power - 1)
    filled(document, product, "add", product)


def long_polynomial(document: Document, power: int, constant: fmpq, times: int) -> int:
    """(1 + Σ states)^(power + 1), multiplied by a long constant so many times."""
    power_of = powered(document, [add(document, "constant", "1"), 0, 1, 2, 3], -1, power)
    return powered(document, [power_of], add(document, "constant", str(constant)), times)


def long_additions(document: Document) -> None:
    polynomial = long_polynomial(document, 20, fmpq(3**500, 7**400), 7)
    unknown(document, filled(document, polynomial, "add", polynomial))


def long_sizes(document: Document) -> None:
    """Coefficients as long as they may be, and remainders that ask for their sizes again and again."""
    sine = add(document, "sin", 0)
    enclose(document, sine, "sin", "2", "2")
    unknown(document, filled(document, long_polynomial(document, 12, fmpq(3**800, 7**470), 13), "mul", sine))


def definite(document: Document) -> None:
    """Gram matrices that take the longest elimination."""
    size, rng = 126, random.Random(0)
    lower = [2**63 if i == j else rng.getrandbits(53) for i in range(size) for j in range(i + 1)]
    gram = {"exponent": 200, "lower": lower}
    proof = document["hints"]["decrease"][0]
    proof["degrees"] = [5] * len(proof["degrees"])
    for cell in stretch(document)["cells"]:
        cell["grams"] = [gram] * len(cell["grams"])


def spinning(document: Document) -> None:
    """A lap that winds up again and again: its poses are hard to enclose, each piece by itself as far as is allowed."""
    piece = {"duration": "1", "turn_rate": ["0", "4000"], "speed": ["1"]}
    document["problem"]["path"].update(pieces=[piece] * MOST_PIECES, closed=True)
    document["legs"][0]["end"] = MOST_PIECES
    document["funnels"][0].update(template="contracting", rate="0")
    document["problem"]["sets"]["goal"]["half_axes"] = ["9"] * 4  # nothing is wrong before the lap's end is looked for
    bounds = {"curvature": ["-9999", "9999"], "speed": ["1", "1"], "acceleration": ["0", "0"]}
    stretch(document).update(end=str(MOST_PIECES), bounds=bounds)


HOSTILE: dict[str, Callable[[Document], None]] = {
    "remainder that grows": huge_remainder,
    "remainder that shrinks": tiny_remainder,
    "long enclosures": long_enclosures,
    "too long an enclosure": too_long_enclosure,
    "many terms": lambda document: additions(document, 11),
    "many additions": lambda document: additions(document, 5),
    "long additions": long_additions,
    "long sizes": long_sizes,
    "definite matrices": definite,
    "spinning lap": spinning,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_endless_arithmetic_is_refused(certificate: Document, name: str) -> None:
    HOSTILE[name](certificate)
    started = time.perf_counter()
    report = check_document(json.loads(json.dumps(certificate)), skip_hash=True)
    assert time.perf_counter() - started < PATIENCE
    assert report.outcome is Outcome.BROKEN
    assert len(report.message) < 300


def test_sums_along_a_path_stay_short(certificate: Document) -> None:
    """Durations with unlike denominators: θ and arc length would grow from piece to piece."""
    pieces = [{"duration": f"1/{10**399 + k}", "turn_rate": ["0"], "speed": ["1"]} for k in range(MOST_PIECES)]
    certificate["problem"]["path"].update(pieces=pieces)
    report = check_document(json.loads(json.dumps(certificate)), skip_hash=True)
    assert report.outcome is Outcome.UNREADABLE
    assert "sums along the path of at most" in report.message


def test_functions_without_use_are_paid_for_on_every_stretch(
    certificate: Document, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sines that no output reads cost no polynomial arithmetic, but each is proven once more on each stretch."""
    document = certificate
    document["problem"]["path"]["closed"] = False
    document["joints"] = []
    assert check_document(document, skip_hash=True).outcome is Outcome.PROVEN
    numbers = tuple(str(fmpq(3 * 2**200 + k, 5 * 2**200 - 1)) for k in range(12))
    for k in range(4):
        alpha = nodes(document).index(["input", "alpha"])
        enclose(document, add(document, "sin", alpha), "sin", f"{17 + 2 * k}/10", str(2**200), numbers)
    assert check_document(document, skip_hash=True).outcome is Outcome.PROVEN
    monkeypatch.setattr(proof, "MOST_EFFORT", 4 * 12 * 200 * proof.ENCLOSURE_EFFORT)
    assert "more arithmetic" in check_document(document, skip_hash=True).message


def test_gram_matrices_are_counted_before_they_are_read(certificate: Document) -> None:
    hints, own = certificate["hints"]["decrease"][0], stretch(certificate)
    cell = own["cells"][0]
    own["cells"] = [cell] * (MOST_CELLS + 1)
    assert f"1 to {MOST_CELLS} entries" in check_document(certificate, skip_hash=True).message
    hints["degrees"] = [5] * len(hints["degrees"])
    own["cells"] = [{**cell, "grams": None}] * 64
    report = check_document(certificate, skip_hash=True)
    assert report.outcome is Outcome.UNREADABLE
    assert "entries together" in report.message
    own["cells"] = [{**cell, "grams": [{"exponent": 0, "lower": [2**65]}] * 5}]
    assert check_document(certificate, skip_hash=True).outcome is Outcome.UNREADABLE


@pytest.fixture
def domain() -> Domain:
    return Domain(fmpq_mpoly_ctx.get([f"y{k}" for k in range(6)], "degrevlex"), fmpq(5, 4))


def test_sums_cost_and_have_limits(domain: Domain) -> None:
    power = sum(domain.ring.gens(), domain.ring.constant(1)) ** 9
    poor = Domain(domain.ring, fmpq(1), Budget(100))
    for operation in (lambda e: e + e, lambda e: e - e, lambda e: -e):
        with pytest.raises(ValueError, match="more arithmetic"):
            operation(poor.exact(power))
    many = domain.exact(sum(domain.ring.gens(), domain.ring.constant(1)) ** 11)
    long = domain.constant(fmpq(2**10_001))
    for first, second in ((many, many), (long, long)):
        for operation in (lambda a, b: a + b, lambda a, b: a - b):
            with pytest.raises(ValueError, match="grows beyond"):
                operation(first, second)
    with pytest.raises(ValueError, match="grows beyond"):
        domain.product(many.polynomial, domain.ring.gens()[0] + domain.ring.gens()[1] ** 9)


def test_remainders_stay_short_and_above(domain: Domain) -> None:
    tiny = fmpq(1, 2**4000)
    (kept, *_) = domain.remainder_product((tiny,), (tiny,))
    assert tiny * tiny <= kept <= fmpq(1, 2**4095)
    assert domain.remainder_product((fmpq(0),), (tiny,)) == (0, 0, 0)
    with pytest.raises(ValueError, match="grows beyond"):
        domain.remainder_product((fmpq(2**15_000),), (fmpq(2**15_000),))


def test_long_numbers_of_an_enclosure_are_refused() -> None:
    bound = proven_bound("sin", (fmpq(0), fmpq(1)), fmpq(-1), fmpq(1))
    UnaryEnclosure("sin", (fmpq(0), fmpq(1)), fmpq(-1), fmpq(1), bound)
    for spoiled in (
        ((fmpq(0), fmpq(1)), fmpq(-1), fmpq(1), fmpq(2**256)),
        ((fmpq(0), fmpq(1)), fmpq(-1), 1 - fmpq(1, 2**257), fmpq(1)),
        ((fmpq(0), 1 + fmpq(1, 2**257)), fmpq(-1), fmpq(1), fmpq(1)),
    ):
        with pytest.raises(ValueError, match="256 bits"):
            UnaryEnclosure("sin", *spoiled)
