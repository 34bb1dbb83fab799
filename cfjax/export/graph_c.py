"""From the traced expression graph to straight C.

The dynamics are those that a certificate carries (`cfjax.certificate.trace`): the very graph that the checker replays.
It is affine in the inputs, so drift and input columns come out of one evaluation with first derivatives: exact, nothing
is a difference of two values. What is zero or one is left out, and what is written once is computed once.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from flint import fmpq
from jax.extend import core

from cfjax.certificate.trace import CAST, PROFILE_INPUTS, TRANSPARENT, interpreted, trace_deviation
from cfjax.errors import InputError
from cfjax.problem import Vehicle


FORMS = {"add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "neg": "-{}", "inv": "1.0 / {}"}
LIBRARY = ("sin", "cos", "tan", "atan", "sqrt", "exp", "log", "atan2")  # of <math.h>, by their own names
REFERENCE_NAMES = PROFILE_INPUTS  # parameters of the C functions, with these names


@dataclass(frozen=True, eq=False)
class Expr:
    """An expression: `op` on others, a constant (`op` "constant") or what C calls `text` (`op` "symbol")."""

    op: str
    args: tuple["Expr", ...] = ()
    value: float = math.nan
    text: str = ""

    def is_constant(self, value: float) -> bool:
        return self.op == "constant" and self.value == value


class Expressions:
    """Where expressions are made: what is the same is one object, so that C computes it once."""

    def __init__(self) -> None:
        self._known: dict[Any, Expr] = {}

    def _one(self, expression: Expr) -> Expr:
        key = (expression.op, tuple(map(id, expression.args)), repr(expression.value), expression.text)
        return self._known.setdefault(key, expression)

    def constant(self, value: float) -> Expr:
        return self._one(Expr("constant", value=float(value) + 0.0))  # no minus zero

    def symbol(self, text: str) -> Expr:
        return self._one(Expr("symbol", text=text))

    def make(self, op: str, *args: Expr) -> Expr:
        """The operation on these, or what it comes to where constants decide."""
        if op in ("add", "sub") and args[1].is_constant(0.0):
            return args[0]
        if op == "add" and args[0].is_constant(0.0):
            return args[1]
        if op == "sub" and args[0].is_constant(0.0):
            return self.make("neg", args[1])
        if op == "mul" and any(arg.is_constant(0.0) for arg in args):
            return self.constant(0.0)
        if op == "mul" and any(arg.is_constant(1.0) for arg in args):
            return args[1] if args[0].is_constant(1.0) else args[0]
        if op == "neg" and args[0].op == "neg":
            return args[0].args[0]
        if all(arg.op == "constant" for arg in args):
            value = _computed(op, *(arg.value for arg in args))
            if math.isfinite(value):
                return self.constant(value)
        return self._one(Expr(op, args))


def _computed(op: str, *values: float) -> float:
    if op in LIBRARY:
        return getattr(math, op)(*values)
    operations: dict[str, Callable[..., float]] = {
        "add": lambda a, b: a + b,
        "sub": lambda a, b: a - b,
        "mul": lambda a, b: a * b,
        "div": lambda a, b: a / b if b else math.nan,
        "neg": lambda a: -a,
        "inv": lambda a: 1 / a if a else math.nan,
    }
    return operations[op](*values)


@dataclass(frozen=True)
class Affine:
    """An expression and its derivatives by the inputs, both at inputs zero: all there is of an affine function."""

    pool: Expressions
    value: Expr
    slopes: tuple[Expr, ...]

    def _each(self, value: Expr, slope: Callable[..., Expr], *others: "Affine") -> "Affine":
        return Affine(self.pool, value, tuple(slope(*all_) for all_ in zip(*(o.slopes for o in others), strict=True)))

    def __add__(self, other: "Affine") -> "Affine":
        make = self.pool.make
        return self._each(make("add", self.value, other.value), lambda a, b: make("add", a, b), self, other)

    def __sub__(self, other: "Affine") -> "Affine":
        make = self.pool.make
        return self._each(make("sub", self.value, other.value), lambda a, b: make("sub", a, b), self, other)

    def __mul__(self, other: "Affine") -> "Affine":
        make, f, g = self.pool.make, self.value, other.value
        return self._each(
            make("mul", f, g), lambda a, b: make("add", make("mul", a, g), make("mul", f, b)), self, other
        )

    def __neg__(self) -> "Affine":
        make = self.pool.make
        return self._each(make("neg", self.value), lambda a: make("neg", a), self)

    def applied(self, name: str) -> "Affine":
        """sin, cos, tan, sqrt or inv of it."""
        make = self.pool.make
        value = make(name, self.value)
        if name == "sin":
            factor = make("cos", self.value)
        elif name == "cos":
            factor = make("neg", make("sin", self.value))
        elif name == "tan":
            factor = make("add", self.pool.constant(1.0), make("mul", value, value))
        elif name == "sqrt":
            factor = make("inv", make("add", value, value))
        else:
            factor = make("neg", make("mul", value, value))
        return self._each(value, lambda a: make("mul", factor, a), self)


def number(value: float) -> str:
    """As C reads it back: the fewest digits that name this double and no other."""
    if not math.isfinite(value):
        raise InputError(f"export: expected finite numbers, got {value}")
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def statements(targets: Sequence[str], values: Sequence[Expr]) -> list[str]:
    """C that computes the values and assigns them, line by line."""
    lines: list[str] = []
    names: dict[int, str] = {}

    def name(expression: Expr) -> str:
        if expression.op == "constant":
            text = number(expression.value)
            return f"({text})" if text.startswith("-") else text
        if expression.op == "symbol":
            return expression.text
        if id(expression) not in names:
            args = [name(arg) for arg in expression.args]
            form = FORMS.get(expression.op) or f"{expression.op}({', '.join('{}' for _ in args)})"
            names[id(expression)] = f"t{len(names)}"
            lines.append(f"const double {names[id(expression)]} = {form.format(*args)};")
        return names[id(expression)]

    assigned = [f"{target} = {name(value)};" for target, value in zip(targets, values, strict=True)]
    return lines + assigned


def dynamics(vehicle: Vehicle, at_rest: bool = False) -> list[str]:
    """C that fills `drift[i]` and `columns[j][i]` with ẋ = drift + Σ columns[j] v_j over the inputs v = (u0, …).

    It reads `x[i]` and the reference's profile by the names of `REFERENCE_NAMES`; at rest, on the reference, x is zero.
    """
    pool, inputs = Expressions(), ("u0", *vehicle.input_names)
    nothing = tuple(pool.constant(0.0) for _ in inputs)
    units = [tuple(pool.constant(float(i == j)) for j in range(len(inputs))) for i in range(len(inputs))]

    def fixed(expression: Expr) -> Affine:
        return Affine(pool, expression, nothing)

    def rational(value: fmpq) -> Affine:
        return fixed(pool.constant(int(value.p) / int(value.q)))

    given: dict[str, Affine] = {
        name: fixed(pool.constant(0.0) if at_rest else pool.symbol(f"x[{i}]"))
        for i, name in enumerate(vehicle.state_names)
    }
    given |= {f"input:{name}": Affine(pool, pool.constant(0.0), unit) for name, unit in zip(inputs, units, strict=True)}
    given |= {f"reference:{name}": fixed(pool.symbol(name)) for name in REFERENCE_NAMES}
    rates = trace_deviation(vehicle).evaluate(given, rational, lambda _, name, argument: argument.applied(name))
    targets = [f"drift[{i}]" for i in range(len(rates))]
    values = [rate.value for rate in rates]
    for j in range(len(inputs)):
        targets += [f"columns[{j}][{i}]" for i in range(len(rates))]
        values += [rate.slopes[j] for rate in rates]
    return statements(targets, values)


def straight(function: Callable[..., Sequence], arguments: Sequence[str], targets: Sequence[str], owner: str) -> list:
    """C of any function of scalars, traced by JAX: of `arguments` as C names them into `targets`.

    Raises:
        InputError: names the operation that C's library has not.
    """
    pool = Expressions()

    def constant(value: Any) -> Expr:
        return pool.constant(float(value))

    def operation(equation: core.JaxprEqn, args: list[Expr]) -> Expr:
        return _operation(pool, equation, args, owner)

    values = interpreted(function, [pool.symbol(text) for text in arguments], constant, operation)
    return statements(targets, values)


def _operation(pool: Expressions, equation: core.JaxprEqn, args: list[Expr], owner: str) -> Expr:
    name, parameters = equation.primitive.name, equation.params
    if name in TRANSPARENT or (name == CAST and str(parameters["new_dtype"]) == "float64"):
        return args[0]
    if name in FORMS or name in LIBRARY:
        return pool.make(name, *args)
    if name == "square" or (name == "integer_pow" and parameters["y"]):
        exponent = 2 if name == "square" else parameters["y"]
        power = args[0]
        for _ in range(abs(exponent) - 1):
            power = pool.make("mul", power, args[0])
        return power if exponent > 0 else pool.make("inv", power)
    raise InputError(f"{owner}: no C for the operation {name!r}; known are {', '.join(sorted({*FORMS, *LIBRARY}))}")
