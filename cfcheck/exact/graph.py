"""Expression graphs: the dynamics as data.

A graph is a list of nodes, each an operation on earlier nodes, over named inputs. A vehicle's JAX function is traced
into one (`cfjax.certificate.trace`). Any arithmetic can evaluate it: the checker needs neither JAX nor that code.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from flint import fmpq


ARITHMETIC: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "neg": lambda a: -a,
}
UNARY_FUNCTIONS = ("sin", "cos", "tan", "sqrt", "inv")  # inv(t) = 1/t
ARITY = {"input": 0, "constant": 0, "add": 2, "sub": 2, "mul": 2, "neg": 1} | dict.fromkeys(UNARY_FUNCTIONS, 1)
# of the dynamics that a file holds
MOST_STATES = 6
MOST_INPUTS = 4  # u0 among them
MOST_NODES = 400
MOST_FUNCTIONS = 32  # nodes that apply sin, cos, …


@dataclass(frozen=True)
class Node:
    """One operation: `op` on the values of earlier nodes `args`; `value` of a constant, `name` of an input."""

    op: str
    args: tuple[int, ...] = ()
    value: fmpq | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        if self.op not in ARITY:
            raise ValueError(f"unknown operation {self.op!r}; known are {', '.join(ARITY)}")
        if len(self.args) != ARITY[self.op]:
            raise ValueError(f"operation {self.op!r} takes {ARITY[self.op]} arguments, got {len(self.args)}")
        if (self.value is not None) != (self.op == "constant") or (self.name is not None) != (self.op == "input"):
            raise ValueError(f"operation {self.op!r}: a constant has a value, an input a name, others neither")


@dataclass(frozen=True)
class Graph:
    """Nodes in order of evaluation and the outputs among them."""

    nodes: tuple[Node, ...]
    outputs: tuple[int, ...]

    def __post_init__(self) -> None:
        for index, node in enumerate(self.nodes):
            if any(not 0 <= arg < index for arg in node.args):
                raise ValueError(f"node {index} refers to a node that does not come before it")
        if any(not 0 <= output < len(self.nodes) for output in self.outputs):
            raise ValueError("an output refers to a node that does not exist")

    def evaluate(
        self,
        inputs: Mapping[str, Any],
        constant: Callable[[fmpq], Any],
        function: Callable[[int, str, Any], Any],
    ) -> list[Any]:
        """Values of the outputs, in any arithmetic.

        Args:
            inputs: A value for each named input, in that arithmetic.
            constant: Lifts a rational into it.
            function: `function(node, name, argument)` applies one of `UNARY_FUNCTIONS`.

        Raises:
            ValueError: the graph reads an input that is not among `inputs`.
        """
        values: list[Any] = []
        for index, node in enumerate(self.nodes):
            arguments = [values[arg] for arg in node.args]
            if node.name is not None:
                if node.name not in inputs:
                    raise ValueError(f"the graph reads {node.name!r}, which is neither state, input nor reference")
                values.append(inputs[node.name])
            elif node.value is not None:
                values.append(constant(node.value))
            elif node.op in ARITHMETIC:
                values.append(ARITHMETIC[node.op](*arguments))
            else:
                values.append(function(index, node.op, *arguments))
        return [values[output] for output in self.outputs]

    def functions(self) -> dict[int, str]:
        """The nodes that apply one of `UNARY_FUNCTIONS`, with its name."""
        return {index: node.op for index, node in enumerate(self.nodes) if node.op in UNARY_FUNCTIONS}

    def functions_of(self, names: Sequence[str]) -> dict[int, str]:
        """Those of `functions` whose argument depends on one of the named inputs."""
        depends: list[bool] = []
        for node in self.nodes:
            depends.append(node.name in names or any(depends[arg] for arg in node.args))
        return {index: name for index, name in self.functions().items() if depends[index]}

    def inputs(self) -> Sequence[str]:
        """Names of the inputs, in order of appearance."""
        return [node.name for node in self.nodes if node.name is not None]
