"""Text that says what a value is, the same in every process: by it a compiled program is found again.

A value of the package's own is its class and its fields. A function that JAX has traced is its jaxpr, whatever code it
was traced from: every operation with its parameters, every variable with its type and every constant to the last bit.
What the text would not say whole has none: a function of the user's own, a call back to Python, a derivative of the
user's own.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from types import FunctionType
from typing import Any

import numpy as np
from jax.extend import core


CALLS = ("jit", "pjit")  # beside the jaxpr they say where it runs, not what
PRIMITIVES = frozenset(id(each) for each in vars(core.primitives).values())  # JAX's own: another one may change


def identity(value: object) -> str | None:
    """Text that is the same for equal values, in every process; None where it depends on code from elsewhere."""
    if value is None or isinstance(value, bool | int | float | str | np.dtype):
        return repr(value)
    if isinstance(value, tuple):
        return _joined(map(identity, value))
    if isinstance(value, core.ClosedJaxpr):
        return _closed(value)
    kind = value if isinstance(value, type | FunctionType) else type(value)
    if kind.__module__.partition(".")[0] != __name__.partition(".")[0] or "<locals>" in kind.__qualname__:
        return None
    if kind is value:
        return f"{kind.__module__}.{kind.__qualname__}"
    fields = [field.name for field in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else vars(value)
    own = identity(tuple((name, getattr(value, name)) for name in fields))
    return None if own is None else f"{kind.__module__}.{kind.__qualname__}{own}"


def _joined(parts: Iterable[str | None]) -> str | None:
    found = list(parts)
    return None if None in found else f"({', '.join(map(str, found))})"


def _closed(closed: core.ClosedJaxpr) -> str | None:
    return _joined([_jaxpr(closed.jaxpr), *map(_constant, closed.consts)])


def _jaxpr(jaxpr: core.Jaxpr) -> str | None:
    numbers: dict[core.Var, int] = {}  # in the order in which they appear: their own names depend on what came before

    def variable(atom: core.Var | core.Literal) -> str | None:
        if isinstance(atom, core.Literal):
            return _joined([_constant(atom.val), _type(atom)])
        return f"{numbers.setdefault(atom, len(numbers))}: {_type(atom)}"

    def variables(atoms: Sequence[core.Var | core.Literal]) -> str | None:
        return _joined(map(variable, atoms))

    def equation(each: core.JaxprEqn) -> str | None:
        if id(each.primitive) not in PRIMITIVES:
            return None
        given = {"jaxpr": each.params["jaxpr"]} if each.primitive.name in CALLS else each.params
        parameters = identity(tuple(sorted(given.items())))
        return _joined([each.primitive.name, parameters, variables(each.invars), variables(each.outvars)])

    heads = [variables(jaxpr.constvars), variables(jaxpr.invars)]
    return _joined([*heads, _joined(map(equation, jaxpr.eqns)), variables(jaxpr.outvars)])


def _type(atom: core.Var | core.Literal) -> str:
    return f"{atom.aval}, weak: {getattr(atom.aval, 'weak_type', False)}"


def _constant(value: Any) -> str | None:
    """By its bits: of what has no such type, a key of random numbers, say, there is none."""
    if not isinstance(getattr(value, "dtype", np.dtype(float)), np.dtype):
        return None
    array = np.asarray(value)
    return f"{array.dtype}{array.shape} {array.tobytes().hex()}"
