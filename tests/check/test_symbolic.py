"""Dynamics in symbols: derivatives go through functions of functions."""

import math

import pytest
from flint import fmpq, fmpq_mpoly

from cfcheck.exact.graph import UNARY_FUNCTIONS, Graph, Node
from cfcheck.exact.symbolic import Symbolic, symbolic
from cfcheck.robustness.term_bounds import TermBounds, slopes_of


def nested() -> Symbolic:
    """ẋ = x sin(sin x + x²), with the cosines that its derivative needs."""
    nodes = [
        Node("input", name="x"),
        Node("sin", (0,)),
        Node("cos", (0,)),
        Node("mul", (0, 0)),
        Node("add", (1, 3)),
        Node("sin", (4,)),
        Node("cos", (4,)),
        Node("mul", (0, 5)),
        Node("sub", (6, 6)),
        Node("sub", (2, 2)),
        Node("add", (7, 8)),
        Node("add", (10, 9)),
    ]
    return symbolic(Graph(tuple(nodes), (11,)), ("x",), ())


FUNCTIONS = {"sin": math.sin, "cos": math.cos, "tan": math.tan, "sqrt": math.sqrt, "inv": lambda t: 1 / t}


def value_of(dynamics: Symbolic, polynomial: fmpq_mpoly, named: dict[str, float]) -> float:
    """In floating point, functions being what they are called."""
    values = [named.get(name, 0.0) for name in dynamics.names]

    def evaluate(each: fmpq_mpoly) -> float:
        terms = each.to_dict().items()
        return sum(
            float(c) * math.prod(v ** int(e) for v, e in zip(values, exponents, strict=False)) for exponents, c in terms
        )

    for function, argument in dynamics.functions.values():
        values.append(FUNCTIONS[function](evaluate(argument)))
    return evaluate(polynomial)


def test_derivative_through_a_function_of_a_function() -> None:
    dynamics = nested()
    found = slopes_of(dynamics).derivative(dynamics.rates[0], "x")
    for x in (-1.3, 0.2, 0.9):
        inner = math.sin(x) + x * x
        slope = value_of(dynamics, found, {"x": x})
        assert slope == pytest.approx(math.sin(inner) + x * math.cos(inner) * (math.cos(x) + 2 * x))


@pytest.mark.parametrize("function", UNARY_FUNCTIONS)
def test_every_function_of_a_graph_has_a_derivative(function: str) -> None:
    """x f(2 + x²), where its derivative may take a function that the graph does not apply; and once more of that."""
    nodes = (
        Node("input", name="x"),
        Node("mul", (0, 0)),
        Node("constant", value=fmpq(2)),
        Node("add", (1, 2)),
        Node(function, (3,)),
        Node("mul", (0, 4)),
    )
    dynamics = symbolic(Graph(nodes, (5,)), ("x",), ())
    each = [dynamics.rates[0]]
    for order in (1, 2):
        each.append(slopes_of(dynamics).derivative(each[-1], "x"))
        for x in (-0.7, 0.3, 1.1):
            step = 1e-6
            low, high = (value_of(dynamics, each[order - 1], {"x": x + side * step}) for side in (-1, 1))
            assert value_of(dynamics, each[order], {"x": x}) == pytest.approx((high - low) / (2 * step), rel=1e-7)


def test_size_is_at_least_the_value() -> None:
    dynamics = nested()
    assert TermBounds(dynamics, {"x": (fmpq(-2), fmpq(2))}).size(dynamics.rates[0]) == 2
    slope = slopes_of(dynamics).derivative(dynamics.rates[0], "x")
    assert float(TermBounds(dynamics, {"x": (fmpq(-2), fmpq(2))}).size(slope)) >= 1 + 2 * (1 + 4)


def test_functions_nested_deeply_cost_no_more_with_every_level_than_with_the_last() -> None:
    """sin(… sin(x) …) + cos of the same: by the chain rule anew each time, forty levels would never end."""
    depth = 40
    nodes = [Node("input", name="x")]
    for _ in range(depth):
        last = len(nodes) - 1
        nodes += [Node("sin", (last,)), Node("cos", (last,)), Node("add", (last + 1, last + 2))]
    dynamics = symbolic(Graph(tuple(nodes), (len(nodes) - 1,)), ("x",), ())
    with pytest.raises(ValueError, match="grows beyond what the checker takes"):  # 2^40 products: refused, and at once
        slopes_of(dynamics).derivative(dynamics.rates[0], "x")
    assert len(slopes_of(dynamics).derivative(dynamics.of("sin", "x"), "x")) == 1


def test_one_over_a_product_is_bounded_where_its_factors_are_from_below() -> None:
    nodes = (
        Node("input", name="x"),
        Node("input", name="reference:speed"),
        Node("mul", (1, 1)),
        Node("constant", value=fmpq(-3)),
        Node("mul", (2, 3)),
        Node("inv", (4,)),
        Node("mul", (0, 5)),
    )
    dynamics = symbolic(Graph(nodes, (6,)), ("x",), ("u0",))
    ranges = {"x": (fmpq(-5), fmpq(5)), "reference:speed": (fmpq(2), fmpq(4))}
    assert TermBounds(dynamics, ranges).size(dynamics.rates[0]) == fmpq(5, 12)  # |x / (-3 v^2)| for 2 <= v <= 4
    for lower in (fmpq(0), fmpq(-1)):
        with pytest.raises(ValueError, match="no bound is known of inv"):
            TermBounds(dynamics, ranges | {"reference:speed": (lower, fmpq(4))}).size(dynamics.rates[0])


def test_one_over_a_sum_is_bounded_where_its_range_is_clear_of_zero() -> None:
    """1/(√(v² + 4) + x) and its inverse for −3/2 ≤ v ≤ 1, |x| ≤ ½: from 2 − ½ to 5/2 + ½ is below the line."""
    nodes = (
        Node("input", name="x"),
        Node("input", name="reference:speed"),
        Node("mul", (1, 1)),
        Node("constant", value=fmpq(4)),
        Node("add", (2, 3)),
        Node("sqrt", (4,)),
        Node("add", (5, 0)),
        Node("inv", (6,)),
        Node("inv", (7,)),
        Node("add", (7, 0)),
        Node("inv", (9,)),
    )
    dynamics = symbolic(Graph(nodes, (7, 8, 10)), ("x",), ("u0",))
    over, under, last = dynamics.rates
    ranges = {"x": (fmpq(-1, 2), fmpq(1, 2)), "reference:speed": (fmpq(-3, 2), fmpq(1))}
    assert TermBounds(dynamics, ranges).size(over) == fmpq(2, 3)
    assert TermBounds(dynamics, ranges).size(under) == 3
    assert TermBounds(dynamics, ranges | {"x": (fmpq(-7), fmpq(-5))}).size(over) == fmpq(2, 5)
    assert TermBounds(dynamics, ranges | {"x": (fmpq(1, 2), fmpq(1))}).size(last) == 1 / (fmpq(2, 7) + fmpq(1, 2))
    with pytest.raises(ValueError, match="no bound is known of inv"):
        TermBounds(dynamics, ranges).size(last)  # from 1/3 − ½ to 2/3 + ½
    with pytest.raises(ValueError, match="no bound is known of inv"):
        TermBounds(dynamics, ranges | {"x": (fmpq(-2), fmpq(1, 2))}).size(over)


def test_a_tangent_is_bounded_short_of_a_right_angle() -> None:
    dynamics = symbolic(Graph((Node("input", name="x"), Node("tan", (0,))), (1,)), ("x",), ())
    bound = TermBounds(dynamics, {"x": (fmpq(-3, 2), fmpq(1))}).size(dynamics.rates[0])
    assert math.tan(1.5) <= float(bound) <= math.tan(1.5) + 1e-9
    with pytest.raises(ValueError, match="no bound is known of tan"):
        TermBounds(dynamics, {"x": (fmpq(-8, 5), fmpq(0))}).size(dynamics.rates[0])


def test_a_square_root_is_at_most_that_of_its_arguments_size() -> None:
    """√(x² − 3x) (1 − x) for |x| ≤ 2: term by term the argument is at most 10, the factor at most 3."""
    nodes = [
        Node("input", name="x"),
        Node("mul", (0, 0)),
        Node("constant", value=fmpq(3)),
        Node("mul", (2, 0)),
        Node("sub", (1, 3)),
        Node("sqrt", (4,)),
        Node("mul", (5, 0)),
        Node("sub", (5, 6)),
        Node("inv", (0,)),
        Node("mul", (8, 5)),
    ]
    dynamics = symbolic(Graph(tuple(nodes), (7, 9)), ("x",), ())
    bound = TermBounds(dynamics, {"x": (fmpq(-2), fmpq(2))}).size(dynamics.rates[0])
    assert 3 * math.sqrt(10) <= float(bound) <= 3 * math.sqrt(10) + 1e-9
    with pytest.raises(ValueError, match="no bound is known of inv"):
        TermBounds(dynamics, {"x": (fmpq(-2), fmpq(2))}).size(dynamics.rates[1])
    assert (
        TermBounds(dynamics, {"x": (fmpq(0), fmpq(0))}).size(dynamics.rates[1] * dynamics.symbols["x"]) == 0
    )  # nothing times anything


def test_functions_of_some_of_the_inputs() -> None:
    nodes = [
        Node("input", name="x"),
        Node("input", name="r"),
        Node("sqrt", (1,)),
        Node("sin", (0,)),
        Node("mul", (2, 3)),
        Node("cos", (4,)),
        Node("tan", (2,)),
    ]
    graph = Graph(tuple(nodes), (5, 6))
    assert graph.functions_of(("x",)) == {3: "sin", 5: "cos"}
    assert graph.functions_of(("r",)) == {2: "sqrt", 5: "cos", 6: "tan"}


def test_nested_quotients_stay_short() -> None:
    """x ← 1/(3 + x)^40, many times over: exact ranges would have millions of digits."""
    nodes = [Node("input", name="x"), Node("constant", value=fmpq(3))]
    last = 0
    for _ in range(6):
        nodes += [Node("add", (1, last)), Node("inv", (len(nodes),))]
        last = len(nodes) - 1
        for _ in range(5):  # its power 32
            nodes.append(Node("mul", (last, last)))
            last = len(nodes) - 1
    dynamics = symbolic(Graph(tuple(nodes), (last,)), ("x",), ())
    size = TermBounds(dynamics, {"x": (fmpq(0), fmpq(1))}).size(dynamics.rates[0])
    assert float(3**32 * size) == pytest.approx(1, rel=1e-6) and size.height_bits() < 4000
