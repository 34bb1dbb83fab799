"""What programs cost, and that none is begun that cannot be held."""

import numpy as np
import pytest

from cfcheck.kernel.program import monomials
from cfjax.solver import SOLVERS, Program, Status, clarabel, solver_named
from cfjax.solver.cost import COSTS, available_memory, cost_of


def least_value() -> Program:
    """Of y0 on the unit disc."""
    names = monomials(2, 2)
    target, drop, disc = (np.zeros(len(names)) for _ in range(3))
    target[names.index((1, 0))] = drop[0] = disc[0] = 1
    disc[names.index((2, 0))] = disc[names.index((0, 2))] = -1
    return Program(2, (1, 0), target, drop, disc[None])


def test_every_solver_has_its_costs() -> None:
    assert COSTS.keys() == SOLVERS.keys()
    assert cost_of("another", 4, (3, 2)) == cost_of("clarabel", 4, (3, 2))


@pytest.mark.parametrize("solver", SOLVERS)
def test_more_states_and_higher_degrees_cost_more(solver: str) -> None:
    shapes = [(3, (3, 2, 2)), (4, (3, 2, 2)), (5, (3, 2, 2)), (5, (4, 3, 3)), (5, (6, 5, 5))]
    costs = [cost_of(solver, *shape) for shape in shapes]
    assert costs == sorted(costs)
    assert [cost.seconds for cost in costs] == sorted(cost.seconds for cost in costs)
    assert cost_of(solver, 4, (3, 2, 2, 2, 2, 2)).memory < 0.1e9  # a circle's


def test_a_square_root_in_five_states_is_too_much_for_the_reference_alone() -> None:
    degrees = (6, 5, 5, 5, 5, 5)
    assert cost_of("clarabel", 5, degrees).memory > 500e9
    assert cost_of("batched", 5, degrees).memory < 10e9


def test_the_reference_begins_nothing_that_it_cannot_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    (found,) = solver_named("clarabel").solve([least_value()])
    assert (found.status, found.margin) == (Status.OPTIMAL, pytest.approx(-1, abs=1e-5))
    monkeypatch.setattr(clarabel, "available_memory", lambda: 100.0)
    monkeypatch.setattr(clarabel, "product_matrix", lambda *_: pytest.fail("it was begun"))
    (found,) = solver_named("clarabel").solve([least_value()])
    assert (found.status, found.grams) == (Status.FAILED, None)
    assert found.message == "it takes about 3e-06 GB of memory, of which 1e-07 are free"


def test_the_memory_that_is_free() -> None:
    assert 1e8 < available_memory() < 1e15
