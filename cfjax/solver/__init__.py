"""The oracle: sums-of-squares programs in, numerical hints out. Nothing here decides what is proven."""

import importlib
from typing import TYPE_CHECKING

from cfjax.coerce import one_of
from cfjax.lazy import on_first_use


if TYPE_CHECKING:
    from cfjax.solver.program import Program, Solution, Solver, Status


SOLVERS = {"batched": ("batched", "Batched"), "clarabel": ("clarabel", "Clarabel")}
"""By name: module and class. Imported on first use, for either brings a library that takes a second to load."""

DEFAULT = "batched"
"""What is used unless somebody says another."""

REFERENCE = "clarabel"
"""What is tried again where the exact replay does not accept a hint."""


def solver_named(name: "str | Solver", workers: int = 1) -> "Solver":
    """The solver of one of the names in SOLVERS, with `workers` programs side by side; a solver is one already.

    Raises:
        InputError: for another name.
    """
    if not isinstance(name, str):
        return name
    module, own = SOLVERS[one_of("solver", name, SOLVERS)]
    return getattr(importlib.import_module(f"cfjax.solver.{module}"), own)(workers)


__all__ = ["DEFAULT", "REFERENCE", "SOLVERS", "Program", "Solution", "Solver", "Status", "solver_named"]

__getattr__ = on_first_use(__name__)
