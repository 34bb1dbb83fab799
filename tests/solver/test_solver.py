"""Both solvers on manufactured programs, and against each other."""

import jax
import numpy as np
import pytest

from cfcheck.kernel.program import monomials
from cfjax.solver import SOLVERS, Program, Solution, Solver, Status, batched, solver_named
from cfjax.solver.clarabel import product_matrix
from cfjax.solver.interior_point import State
from cfjax.solver.points import space, vandermonde
from cfjax.solver.program import CAP, dense


@pytest.fixture(params=SOLVERS)
def solver(request: pytest.FixtureRequest) -> Solver:
    return solver_named(request.param)


def program(target: dict, constraints: list[dict], degrees: tuple[int, ...], **options: float) -> Program:
    """In as many variables as the exponents have; λ is counted in 1."""
    variables, order = len(next(iter(target))), 2 * max(degrees)
    rows = [dense(polynomial, variables, order) for polynomial in ({(0,) * variables: 1.0}, target, *constraints)]
    return Program(variables, degrees, rows[1], rows[0], np.array(rows[2:]).reshape(-1, len(rows[0])), **options)


def identity_error(asked: Program, found: Solution) -> float:
    """The largest coefficient of target − λ drop − Σ g zᵀ Q z, term by term."""
    assert found.grams is not None
    names = monomials(asked.variables, 2 * max(asked.degrees))
    places = {name: k for k, name in enumerate(names)}
    left = asked.target - found.margin * asked.drop
    for factor, gram, degree in zip(
        [np.eye(len(names))[0], *asked.constraints], found.grams, asked.degrees, strict=True
    ):
        terms = {names[k]: factor[k] for k in np.flatnonzero(factor)}
        left = left - product_matrix(terms, monomials(asked.variables, degree), places) @ gram.flatten(order="F")
    return float(np.abs(left).max())


def random_programs(variables: int, degrees: tuple[int, ...], count: int) -> list[Program]:
    """The unit ball, cut by random half-spaces and quadrics: a random polynomial, in units of a positive drop."""
    rng = np.random.default_rng(variables)
    order = 2 * degrees[0]
    ball = {(0,) * variables: 1.0} | {tuple(2 * row): -1.0 for row in np.eye(variables, dtype=int)}
    found = []
    for _ in range(count):
        names = monomials(variables, order)
        cuts = [
            {e: rng.normal() for e in monomials(variables, min(2, order - 2 * degree))} | {(0,) * variables: 0.7}
            for degree in degrees[2:]
        ]
        target = dense({e: rng.normal() for e in names}, variables, order)
        drop = dense(
            {(0,) * variables: 1.0} | {tuple(2 * row): 0.5 for row in np.eye(variables, dtype=int)}, variables, order
        )
        rows = np.array([dense(g, variables, order) for g in (ball, *cuts)])
        found.append(Program(variables, degrees, target, drop, rows))
    return found


def test_the_least_value_of_a_polynomial_is_found(solver: Solver) -> None:
    """min of (y0 − 1)² + (y0 y1 + 2)² − 3 is −3; that of y0 on the disc |y|² ≤ 1 is −1."""
    polynomial = {(0, 0): 2.0, (1, 0): -2.0, (2, 0): 1.0, (2, 2): 1.0, (1, 1): 4.0}
    free = program(polynomial, [], (2,))
    disc = program({(1, 0): 1.0}, [{(0, 0): 1.0, (2, 0): -1.0, (0, 2): -1.0}], (2, 1))
    for asked, least, found in zip((free, disc), (-3, -1), solver.solve([free, disc]), strict=True):
        assert found.status is Status.OPTIMAL
        assert found.margin == pytest.approx(least, abs=1e-5)
        assert identity_error(asked, found) < 1e-6
        assert all(np.linalg.eigvalsh(gram)[0] > -1e-6 for gram in found.grams or ())


def test_the_identity_is_restored_once_where_blocks_are_of_one_degree() -> None:
    """From an iterate that is far from it: the first block alone takes what is missing."""
    disc = {(0, 0): 1.0, (2, 0): -1.0, (0, 2): -1.0}
    asked = program({(0, 0): 1.0, (1, 1): 1.0}, [disc, {(0, 0): 2.0}], (2, 1, 2))
    layout = batched._layout(*asked.shape)
    posed, scales = batched._posed(layout, asked)
    rng = np.random.default_rng(0)
    shapes = [(size, basis.shape[1], basis.shape[1]) for size, basis in zip(layout.sizes, layout.bases, strict=True)]
    halves = [rng.normal(size=shape) for shape in shapes]
    grams = tuple(half @ half.mT for half in halves)
    numbers = dict.fromkeys(State._fields, np.zeros(())) | {"moments": np.ones(len(posed.target))}
    state = State(**numbers | {"margin": np.asarray(0.3), "grams": grams})
    found = batched._answered(layout, asked, posed, scales, state, 0.0)
    assert identity_error(asked, found) < 1e-9


@pytest.mark.parametrize("cap", [None, 3.0])
def test_on_an_empty_cell_the_margin_is_the_cap(solver: Solver, cap: float | None) -> None:
    """y0 ≥ 1/2 and −y0 ≥ 1/2: whatever is claimed there is true."""
    cuts = [{(0, 0): -0.5, (1, 0): 1.0}, {(0, 0): -0.5, (1, 0): -1.0}]
    asked = program(
        {(0, 0): -1.0, (2, 0): -2.0, (0, 2): 0.5},
        [{(0, 0): 1.0, (2, 0): -1.0, (0, 2): -1.0}, *cuts],
        (2, 1, 1, 1),
        cap=cap,
    )
    (found,) = solver.solve([asked])
    assert found.status is Status.OPTIMAL
    assert found.margin == pytest.approx(cap, rel=1e-5) if cap else found.margin > 0.5 * CAP
    assert found.second_moments is None
    assert identity_error(asked, found) < 1e-6


def test_what_has_no_bound_has_no_optimum(solver: Solver) -> None:
    (found,) = solver.solve([program({(1, 0): 1.0}, [], (2,))])
    assert found.status is not Status.OPTIMAL


@pytest.mark.parametrize(("variables", "degrees"), [(2, (2, 1)), (4, (3, 2, 2, 2, 2, 2)), (5, (2, 1, 0))], ids=str)
def test_solvers_agree(variables: int, degrees: tuple[int, ...]) -> None:
    programs = random_programs(variables, degrees, 3)
    ours, reference = (solver_named(name).solve(programs) for name in ("batched", "clarabel"))
    for asked, first, second in zip(programs, ours, reference, strict=True):
        unit = np.abs(asked.target).max()
        assert (first.status, second.status) == (Status.OPTIMAL, Status.OPTIMAL)
        # Gram matrices are kept short at a price of some 1e-6 of the target
        assert first.margin == pytest.approx(second.margin, abs=2e-5 * unit)
        assert identity_error(asked, first) < 1e-9 * unit
        assert first.second_moments is not None
        assert second.second_moments is not None
        np.testing.assert_allclose(first.second_moments, second.second_moments, atol=5e-3)


def test_mixed_shapes_come_back_in_order() -> None:
    programs = [*random_programs(2, (2, 1), 2), *random_programs(4, (3, 2, 2, 2, 2, 2), 2)]
    mixed = [programs[k] for k in (2, 0, 3, 1)]
    by_one = [solver_named("batched").solve([asked])[0].margin for asked in mixed]
    assert [found.margin for found in solver_named("batched", workers=2).solve(mixed)] == pytest.approx(
        by_one, abs=1e-9
    )
    assert solver_named("batched").solve([]) == []


def test_numbers_that_are_none_are_no_answer(solver: Solver) -> None:
    (asked,) = random_programs(2, (2, 1), 1)
    for value in (np.nan, np.inf):
        spoiled = program({(0, 0): 1.0, (1, 0): value}, [{(0, 0): 1.0, (2, 0): -1.0, (0, 2): -1.0}], (2, 1))
        good, bad = solver.solve([asked, spoiled])
        assert good.status is Status.OPTIMAL
        assert bad.status is Status.FAILED


def test_lockstep_is_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on an accelerator: lanes side by side, the last chunk filled up."""
    programs = random_programs(2, (2, 1), 3)
    one_by_one = solver_named("batched").solve(programs)
    monkeypatch.setattr(batched, "LANES", {jax.default_backend(): 2})
    for first, second in zip(one_by_one, solver_named("batched").solve(programs), strict=True):
        assert first.margin == pytest.approx(second.margin, abs=1e-9)


def test_single_precision_is_refused_loudly() -> None:
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(RuntimeError, match="double precision"):
            solver_named("batched")
    finally:
        jax.config.update("jax_enable_x64", True)


def test_monomials_are_evaluated() -> None:
    values = vandermonde(np.array([[2.0, 3.0], [0.0, -1.0]]), 2)
    expected = [[np.prod(np.power(point, exponents)) for exponents in monomials(2, 2)] for point in ([2, 3], [0, -1])]
    np.testing.assert_array_equal(values, expected)


def test_points_determine_polynomials() -> None:
    for variables, degree in ((2, 6), (4, 6), (5, 4)):
        own = space(variables, degree)
        assert np.linalg.norm(own.points, axis=1).max() <= 1
        assert np.linalg.cond(own.values) < 1e6
        basis, change = own.basis(degree // 2)
        np.testing.assert_allclose(basis, vandermonde(own.points, degree // 2) @ change, atol=1e-8)
        np.testing.assert_allclose(basis.T @ basis, len(basis) * np.eye(basis.shape[1]), atol=1e-8)


def test_product_matrix_multiplies() -> None:
    rng = np.random.default_rng(0)
    basis, rows = monomials(2, 1), {e: k for k, e in enumerate(monomials(2, 4))}
    factor = {(0, 0): 2.0, (1, 0): -1.5, (1, 1): 0.25}
    gram = rng.normal(size=(3, 3))
    gram = gram + gram.T
    vector = product_matrix(factor, basis, rows) @ gram.flatten(order="F")
    for y in rng.normal(size=(5, 2)):
        z = np.array([1, *y])
        value = sum(c * np.prod(y ** np.array(e)) for e, c in factor.items()) * (z @ gram @ z)
        assert vector @ [np.prod(y ** np.array(e)) for e in rows] == pytest.approx(value)
