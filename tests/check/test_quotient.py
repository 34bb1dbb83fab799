"""Rates with divisions: quotients against exact values, and denominators that may be zero."""

import json
import random
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flint import arb, fmpq, fmpq_mpoly_ctx

from cfcheck import Outcome, check_document
from cfcheck.exact.enclosure import Domain, Enclosure, TooLarge, UnaryEnclosure, proven_bound
from cfcheck.exact.quotient import Quotient, applied
from cfcheck.kernel.decrease import Cell, SteadyDecrease
from cfcheck.kernel.program import RADIUS_SLACK, CellProof, FunnelProgram
from cfjax.certificate import certify, dump
from cfjax.certificate.fit import enclose, fit
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Problem, ball, straight
from tests.check.vehicles import Hauler


Document = dict[str, Any]
SHAPE = ((9.14, -8.67, 0, 0), (-8.67, 19.5, 0, 0), (0, 0, 22.1, 7.24), (0, 0, 7.24, 6.9))  # as a learner found it


@pytest.fixture
def domain() -> Domain:
    return Domain(fmpq_mpoly_ctx.get(["y0", "y1"], "degrevlex"), fmpq(1))


def fitted(_: int, function: str, argument: Enclosure) -> UnaryEnclosure:
    return enclose(function, argument)


def one_over(node: int, argument: Quotient) -> Quotient:
    return applied(node, "inv", argument, fitted)


def points(count: int) -> list[tuple[fmpq, fmpq]]:
    rng = random.Random(7)
    return [(fmpq(rng.randint(-700, 700), 1000), fmpq(rng.randint(-700, 700), 1000)) for _ in range(count)]


def test_divisions_by_polynomials_are_exact(domain: Domain) -> None:
    """a/(2 + b) + b/(a − 3) − (a/(2 + b)) (b/(2 + b)), the second denominator below zero: nothing is lost."""
    a, b = (Quotient(domain.exact(y)) for y in domain.ring.gens())
    two, three = (Quotient(domain.constant(fmpq(k))) for k in (2, 3))
    first, second = one_over(0, two + b), one_over(1, a - three)
    found = a * first + b * second - (a * first) * (b * first)
    below = found.denominator
    assert not any((*found.numerator.remainder, *below.remainder))
    assert found.least_denominator == 2  # (2 − 1)² (3 − 1)
    for x, y in points(50):
        truth = x / (2 + y) + y / (x - 3) - x * y / (2 + y) ** 2
        assert found.numerator.polynomial(x, y) / below.polynomial(x, y) == truth
        assert below.polynomial(x, y) >= found.least_denominator


def test_what_divides_the_numerator_is_divided_out(domain: Domain) -> None:
    a, b = (Quotient(domain.exact(y)) for y in domain.ring.gens())
    below = Quotient(domain.constant(fmpq(2))) + b
    by = one_over(0, below)
    once = (a * below * by * by).reduced()
    assert [power.exponent for power in once.powers.values()] == [1]
    assert once.numerator.polynomial == a.numerator.polynomial
    whole = (a * by - b * by + (b - a) * by + a).reduced()
    assert (whole.powers, whole.numerator.polynomial) == ({}, a.numerator.polynomial)
    left = (a * by).reduced()
    assert (left.powers, left.numerator.polynomial) == ((a * by).powers, a.numerator.polynomial)


def test_quotients_within_functions_and_with_remainders_are_enclosed(domain: Domain) -> None:
    """sin(a/(2 + b)) / (1 + cos(a)) + 1/(1 + b/(3 + a)) − 1/√3."""
    a, b = (Quotient(domain.exact(y)) for y in domain.ring.gens())
    one, two, three = (Quotient(domain.constant(fmpq(k))) for k in (1, 2, 3))
    sine = applied(1, "sin", a * one_over(0, two + b), fitted)
    third = one_over(3, one + applied(2, "cos", a, fitted))
    root = applied(6, "sqrt", three, fitted)
    found = sine * third + one_over(5, one + b * one_over(4, three + a)) - one_over(7, root)
    assert set(found.powers) == {3, 5}  # what is a number is divided by at once
    above, below, least = found.numerator, found.denominator, found.least_denominator
    assert 0 < below.largest_remainder < fmpq(1, 10) and fmpq(1, 3) < least
    whole = found.enclosed()
    for x, y in points(100):
        s, t = arb(x), arb(y)
        divisor = (1 + s.cos()) * (1 + t / (3 + s))
        truth = (s / (2 + t)).sin() / (1 + s.cos()) + 1 / (1 + t / (3 + s)) - 1 / arb(3).sqrt()
        assert abs(divisor - arb(below.polynomial(x, y))) <= arb(below.largest_remainder)
        assert divisor >= arb(least)
        assert abs(truth * divisor - arb(above.polynomial(x, y))) <= arb(above.largest_remainder)
        assert abs(truth - arb(whole.polynomial(x, y))) <= arb(whole.largest_remainder)


def test_a_function_of_a_number_is_one_whatever_the_hint_is(domain: Domain) -> None:
    poor = UnaryEnclosure("sqrt", (fmpq(1),), fmpq(1), fmpq(4), fmpq(2))
    found = domain.constant(fmpq(2)).apply(poor)
    assert found.polynomial.is_constant() and 0 < found.largest_remainder < fmpq(1, 2**100)
    middle, spread = fmpq(found.polynomial.coeffs()[0]), found.largest_remainder
    assert (middle - spread) ** 2 <= 2 <= (middle + spread) ** 2
    nearly = Enclosure(domain, domain.ring.constant(2), (fmpq(1, 1000), fmpq(0), fmpq(1, 1000)))
    wider = nearly.apply(poor)
    middle, spread = fmpq(wider.polynomial.coeffs()[0]), wider.largest_remainder
    assert spread < fmpq(1, 1000) and middle - spread > 1
    assert (middle - spread) ** 2 <= fmpq(1998, 1000) < fmpq(2002, 1000) <= (middle + spread) ** 2
    for number, remainder in ((0, 0), (1, 2), (-1, 0)):
        odd = Enclosure(domain, domain.ring.constant(number), (fmpq(remainder), fmpq(0), fmpq(0)))
        with pytest.raises(ValueError, match="not smooth"):
            odd.apply(poor)
    with pytest.raises(ValueError, match="pole"):
        domain.constant(fmpq(0)).apply(UnaryEnclosure("inv", (fmpq(1),), fmpq(1), fmpq(4), fmpq(2)))


@pytest.mark.parametrize("constant", [fmpq(0), fmpq(1, 2), fmpq(999, 1000), fmpq(1), fmpq(-1)])
def test_a_denominator_that_may_be_zero_is_refused(domain: Domain, constant: fmpq) -> None:
    """constant + a has a zero inside the ball, or on its edge: no hint hides it."""
    below = Quotient(domain.exact(domain.ring.gens()[0] + constant))
    with pytest.raises(ValueError, match="pole"):
        one_over(0, below)
    for low, high in ((fmpq(1, 10), fmpq(3)), (fmpq(-3), fmpq(-1, 10))):
        coefficients = fit("inv", low, high)
        hint = UnaryEnclosure("inv", coefficients, low, high, proven_bound("inv", coefficients, low, high))
        with pytest.raises(ValueError, match="the argument of inv reaches from"):
            applied(0, "inv", below, lambda *_, hint=hint: hint)
        # were the hint not asked about its range, the sign is
        forged = object.__new__(UnaryEnclosure)
        values = {
            "function": "inv",
            "coefficients": coefficients,
            "lower": fmpq(-9),
            "upper": fmpq(9),
            "bound": fmpq(9),
        }
        for name, value in values.items():
            object.__setattr__(forged, name, value)
        with pytest.raises(ValueError, match="divided by what may be zero"):
            applied(0, "inv", below, lambda *_, forged=forged: forged)


def test_a_denominator_grows_no_further_than_a_polynomial(domain: Domain) -> None:
    """Squared as often as a graph has nodes, below nothing at all."""
    power = Quotient(domain.constant(fmpq(0))) * one_over(0, Quotient(domain.exact(domain.ring.gens()[0] + 2)))

    def grow(power: Quotient) -> None:
        for _ in range(400):
            power = power * power

    with pytest.raises(TooLarge, match="grows beyond"):
        grow(power)


def test_a_remainder_that_reaches_zero_is_refused(domain: Domain) -> None:
    """The polynomial stays above 1/10, what it stands for may not."""
    close = Enclosure(domain, domain.ring.gens()[0] + fmpq(11, 10), (fmpq(0), fmpq(1, 10), fmpq(0)))
    with pytest.raises(ValueError, match="pole"):
        one_over(0, Quotient(close))
    assert one_over(0, Quotient(Enclosure(domain, close.polynomial, (fmpq(1, 20), fmpq(0), fmpq(0))))).powers


# --- a certificate of a vehicle that divides by its speed


def test_what_is_left_over_and_the_denominators_remainder_are_paid_for(
    domain: Domain, monkeypatch: pytest.MonkeyPatch
) -> None:
    """D = 1/4 + y/8, known to 1/100: what is divided by it grows, the more so the smaller it may be."""
    y = domain.ring.gens()[0]
    below = Enclosure(domain, y / 8 + fmpq(1, 4), (fmpq(1, 100), fmpq(0), fmpq(0)))
    rate, cell = one_over(0, Quotient(below)), Cell(0, (), ())
    question = SteadyDecrease.__new__(SteadyDecrease)
    piece = SimpleNamespace(least_weight=fmpq(3, 10), weight=SimpleNamespace(at=lambda form: form))
    vars(question).update(pieces=(piece,), form_rates={(): rate}, domain=domain, form=3 + y)
    assert question.weight(cell) == (y / 8 + fmpq(1, 4)) * (3 + y)  # V̇ D ≤ −λ D weight
    least = fmpq(1, 4) - fmpq(1, 8) - fmpq(1, 100)
    assert least * fmpq(999, 1000) < rate.least_denominator <= least
    assert question.least_weight(cell) == rate.least_denominator * fmpq(3, 10)
    monkeypatch.setattr(FunnelProgram, "proven_margin", lambda *_: fmpq(1))
    for margin in (fmpq(2), fmpq(-2)):
        shown = question.proven_margin(CellProof(cell, margin, ()))
        assert shown <= 1 - 2 * fmpq(1, 100) / least
        assert shown > 1 - fmpq(21, 1000) / least


@pytest.fixture(scope="module")
def hauled() -> str:
    """Along a straight line at 2 m/s, trajectory tracking."""
    problem = Problem(straight(), vehicle=Hauler(), inlet=ball(0.2), goal=ball(0.5), method="tt")
    funnel = Funnel(template_named("paper"), np.array(SHAPE, float), 0.0, problem.path.segments[0].duration)
    document = certify(problem, [funnel]).document
    assert document is not None
    return dump(document)


@pytest.fixture
def document(hauled: str) -> Document:
    return json.loads(hauled)


def tell(document: Document, node: int, low: fmpq, high: fmpq) -> None:
    """A hint that is true of one over what lies between these, both of one sign."""
    low, high = fmpq((low * 2**12).floor(), 2**12), fmpq((high * 2**12).ceil(), 2**12)
    coefficients = fit("inv", low, high)
    bound = proven_bound("inv", coefficients, low, high)
    told = {"coefficients": [str(c) for c in coefficients], "lower": str(low), "upper": str(high), "bound": str(bound)}
    entries = document["hints"]["decrease"][0]["stretches"][0]["enclosures"]
    entries[:] = [entry for entry in entries if entry["node"] != node]
    entries.append({"node": node, "function": "inv", **told})
    entries.sort(key=lambda entry: entry["node"])


def speeds(document: Document) -> tuple[int, fmpq, fmpq]:
    """The node that divides, and the least and largest of what it divides by in the ball that a checker looks at."""
    (stretch,) = document["hints"]["decrease"][0]["stretches"]
    (entry,) = (entry for entry in stretch["enclosures"] if entry["function"] == "inv")
    ball = Domain(fmpq_mpoly_ctx.get([f"y{k}" for k in range(4)], "degrevlex"), 1 + RADIUS_SLACK)
    row = map(fmpq, stretch["whitening"][3])
    speed = sum((w * y for w, y in zip(row, ball.ring.gens(), strict=True)), ball.ring.constant(2))
    return entry["node"], *ball.exact(speed).range()


def divide_anew(document: Document, *below: list, sign: int = 1) -> int:
    """The power is divided by the last of some more nodes, the first of which are numbered from the graph's end."""
    dynamics = document["problem"]["vehicle"]["dynamics"]
    nodes, outputs = dynamics["nodes"], dynamics["outputs"]
    (old,) = (k for k, node in enumerate(nodes) if node[0] == "inv")
    (quotient,) = (k for k, node in enumerate(nodes) if node[0] == "mul" and old in node[1:])
    rate = nodes[outputs[3]]
    assert rate[:2] == ["sub", quotient]
    power = nodes.index(["input", "input:power"])
    nodes += below
    end = len(nodes)
    nodes += [["inv", end - 1], ["mul", power, end], ["neg", end + 1]]
    nodes.append(["sub", end + 1 if sign > 0 else end + 2, rate[2]])
    outputs[3] = len(nodes) - 1
    return end


def refused(document: Document, message: str) -> bool:
    report = check_document(document, skip_hash=True)
    return report.outcome is Outcome.BROKEN and message in report.message


def test_a_vehicle_that_divides_by_its_speed_is_certified(document: Document) -> None:
    report = check_document(document, skip_hash=True)
    assert report.outcome is Outcome.PROVEN
    claimed = fmpq(document["funnels"][0]["margin"])
    assert claimed > fmpq(1, 4)
    document["funnels"][0]["margin"] = str(claimed * fmpq(1001, 1000))
    assert refused(document, "claimed")


@pytest.mark.parametrize("sign", [1, -1])
def test_the_sign_of_a_denominator_does_not_matter(document: Document, sign: int) -> None:
    """power/v written once more, and as −(power/(−v)): the same polynomials, whose proof is the same."""
    node, low, high = speeds(document)
    speed = document["problem"]["vehicle"]["dynamics"]["nodes"][node][1]
    more = [["neg", speed]] if sign < 0 else [["neg", speed], ["neg", len(nodes_of(document))]]
    new = divide_anew(document, *more, sign=sign)
    spare = fmpq(1, 1000)
    tell(document, new, *((low - spare, high + spare) if sign > 0 else (-high - spare, -low + spare)))
    report = check_document(document, skip_hash=True)
    assert report.outcome is Outcome.PROVEN, report.message


def nodes_of(document: Document) -> list:
    return document["problem"]["vehicle"]["dynamics"]["nodes"]


@pytest.mark.parametrize("share", [fmpq(0), fmpq(1, 2), fmpq(1), fmpq(3, 2)])
def test_a_vehicle_that_divides_by_zero_in_its_funnel_is_refused(document: Document, share: fmpq) -> None:
    """By v − a, zero at the slowest speed of the ball, in its middle or at the fastest; or of another sign there.

    Hints are true of ranges beside zero, but the denominator is in none of them, or the funnel is no longer one.
    """
    node, low, high = speeds(document)
    speed = nodes_of(document)[node][1]
    zero = low + share * (high - low)
    count = len(nodes_of(document))
    new = divide_anew(document, ["constant", str(zero)], ["sub", speed, count])
    for ends in ((fmpq(1, 10), fmpq(5)), (fmpq(-5), fmpq(-1, 10))):
        tell(document, new, *ends)
        assert refused(
            document, "margin" if share > 1 and ends[0] < 0 and zero - high > fmpq(1, 10) else "reaches from"
        )


def test_a_funnel_that_is_wider_in_speed_than_proven_is_refused(document: Document) -> None:
    text = json.dumps(document)
    node, low, high = speeds(document)
    (stretch,) = document["hints"]["decrease"][0]["stretches"]
    # hints about fewer speeds than the funnel holds
    tell(document, node, low + fmpq(1, 100), high + fmpq(1, 100))
    assert refused(document, "the argument of inv reaches from")
    # a slower path: the same funnel holds the speed zero
    document = json.loads(text)
    document["problem"]["path"]["pieces"][0]["speed"] = [str(2 - low)]
    document["hints"]["decrease"][0]["stretches"][0]["bounds"]["speed"] = [str(2 - low)] * 2
    assert refused(document, "the argument of inv reaches from")
    tell(document, node, fmpq(1, 10), fmpq(5))
    assert refused(document, "the argument of inv reaches from")
    # a wider funnel, in coordinates that fit it
    document = json.loads(text)
    (stretch,) = document["hints"]["decrease"][0]["stretches"]
    entries = document["funnels"][0]["shape"]
    entries[:] = [str(fmpq(entry) / 9) for entry in entries]
    stretch["whitening"] = [[str(3 * fmpq(entry)) for entry in row] for row in stretch["whitening"]]
    document["problem"]["sets"]["goal"]["half_axes"] = ["9"] * 4
    assert refused(document, "reaches from")
    tell(document, node, fmpq(1, 10), fmpq(5))
    assert refused(document, "reaches from")
