"""Condition (d): what the exact objects say, against V itself evaluated in floating point."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from flint import fmpq

from cfcheck.kernel.decrease import SteadyDecrease
from cfcheck.kernel.level import LEVELS, Contracting, Paper
from cfcheck.kernel.program import Gram, monomials, quadratic_form
from cfjax.certificate.certifier import statement_of
from cfjax.certificate.rounding import round_funnel
from cfjax.certificate.stretches import bounded, decreases_on, question_of
from cfjax.exact import exact_course
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Box, Method, Problem, affine_deviation, circle


SHAPE = np.array([[2.5, -0.9, -0.1, -0.2], [-0.9, 3.3, -0.2, 0.1], [-0.1, -0.2, 3.3, 0.9], [-0.2, 0.1, 0.9, 2.5]])


def question(template: str, method: str, rate: float = 0.09) -> tuple[SteadyDecrease, Problem, Funnel]:
    problem = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)), method=Method(method))
    segment = problem.path.segments[0]
    rounded = round_funnel(Funnel(template_named(template), SHAPE, rate, segment.duration), segment)
    course = exact_course(problem.path)
    stretch = bounded(course.pieces, fmpq(0), course.duration)
    return decreases_on(question_of(statement_of(problem).claim, rounded), rounded, stretch)[0], problem, rounded.funnel


@pytest.mark.parametrize("template", ["paper", "contracting"])
@pytest.mark.parametrize(
    ("rate", "inner"), [(0.12, 0.9), (0.02, 0.9), (0.0, 0.9), (-0.05, 0.9), (0.02, 0.3), (0.0, 0.1)]
)
@pytest.mark.parametrize("span", [(0, 6), (0, 2), (3, 6), (2, 3)])
def test_pieces_cover_the_shell_with_the_largest_demand(
    template: str, rate: float, inner: float, span: tuple[int, int]
) -> None:
    """At every θ of a stretch and q some piece holds q, its weight ≥ min(1, V/β̲)/σ(θ), its timing is ∂V/∂θ / σ."""
    duration, lower = 6.0, 0.9
    funnel = Funnel(template_named(template), SHAPE, rate, duration, lower, inner)
    levels = fmpq(9, 10), fmpq(round(inner * 100), 100)
    pieces = LEVELS[template](fmpq(round(rate * 100), 100)).shell((fmpq(span[0]), fmpq(span[1])), *levels)
    for theta in np.linspace(*span, 61):
        level, sigma = float(funnel.level(theta)), float(funnel.template.scale(rate, theta))
        lowest = inner + level - 1 if template == "paper" else inner * level
        for q in np.linspace(lowest, level, 21):
            value = float(funnel.template.value(rate, theta, q))
            assert inner - 1e-9 <= value <= 1 + 1e-9
            within = [p for p in pieces if float(p.lower) - 1e-9 <= q <= float(p.upper) + 1e-9]
            assert within
            for piece in within:
                assert (
                    float(piece.weight[0] + piece.weight[1] * fmpq(round(q * 10**9), 10**9))
                    >= min(1, value / lower) / sigma - 1e-8
                )
                timing = float(piece.timing[0]) + float(piece.timing[1]) * q
                assert timing == pytest.approx(float(funnel.template.timing(rate, q)), abs=1e-9)
                assert 0 < float(piece.least_weight) <= float(piece.weight[0]) + float(piece.weight[1]) * q + 1e-9


def test_a_shell_that_reaches_the_reference_is_refused() -> None:
    for rate in (fmpq(15, 100), fmpq(1)):
        with pytest.raises(ValueError, match="reaches the reference"):
            Paper(rate).shell((fmpq(0), fmpq(6)), fmpq(9, 10), fmpq(9, 10))
    low, high = Contracting(fmpq(1, 2)).bounds(fmpq(6))
    assert float(low) == pytest.approx(math.exp(-3))
    assert low < high


@pytest.mark.parametrize(("template", "method"), list(product(["paper", "contracting"], ["pf", "tt"])))
def test_cells_cover_every_sign_and_name_the_best_vertex(template: str, method: str) -> None:
    decrease, problem, _ = question(template, method)
    cells = list(decrease.cells())
    assert len(cells) == len(decrease.pieces) * 2 ** len(decrease.free_inputs)
    assert len({(cell.piece, cell.signs) for cell in cells}) == len(cells)
    for cell in cells:
        assert all(
            fmpq(round(limits.lower * 2), 2) <= u <= fmpq(round(limits.upper * 2), 2)
            for u, limits in zip(cell.vertex, problem.inputs, strict=True)
        )
    if method == "tt":
        assert {cell.vertex[0] for cell in cells} == {fmpq(1)}
    rng = np.random.default_rng(0)
    for _ in range(50):  # every deviation lies in a cell of its piece
        y = [fmpq(int(k), 1000) for k in rng.integers(-600, 600, size=4)]
        for piece in range(len(decrease.pieces)):
            hold = [
                cell
                for cell in cells
                if cell.piece == piece and all(g(*y) >= 0 for g in decrease.constraints(cell)[: len(cell.signs)])
            ]
            assert hold


@pytest.mark.parametrize(("template", "method"), list(product(["paper", "contracting"], ["pf", "tt"])))
def test_target_is_nowhere_above_the_true_decrease(template: str, method: str) -> None:
    """p_u − ε ≤ F_u = −(q̇ + timing u0) with the dynamics of `cfjax.problem`, at random points of the shell."""
    decrease, problem, funnel = question(template, method)
    point = problem.path.segments[0].point(0.0)
    whitening = np.array([[float(w) for w in row] for row in decrease.whitening])
    rng = np.random.default_rng(1)
    level = max(float(piece.upper) for piece in decrease.pieces)
    gaps = []
    for _ in range(60):
        direction = rng.normal(size=4)
        y = [
            fmpq(round(v * 10**6), 10**6)
            for v in np.sqrt(level * rng.uniform(0, 1)) * direction / np.linalg.norm(direction)
        ]
        x = whitening @ np.array([float(v) for v in y])
        drift, columns = (np.asarray(part) for part in affine_deviation(problem.vehicle, x, point))
        q = float(funnel.form(x))
        for cell in decrease.cells():
            u = np.array([float(v) for v in cell.vertex])
            rate = 2 * x @ funnel.shape @ (drift + columns @ u) + float(funnel.template.timing(funnel.rate, q)) * u[0]
            gap = -rate - float(decrease.target(cell)(*y))
            assert gap >= -1e-12
            gaps.append(gap)
    assert max(gaps) < 0.05  # and it is close


def test_the_ball_holds_the_funnel() -> None:
    decrease, _, funnel = question("contracting", "pf")
    whitening = np.array([[float(w) for w in row] for row in decrease.whitening])
    level = max(float(piece.upper) for piece in decrease.pieces)
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(4, 1000))
    x = directions * np.sqrt(level / funnel.form(directions.T))
    y = np.linalg.solve(whitening, x)
    assert (y**2).sum(axis=0).max() <= float(decrease.domain.radius_squared)
    wrong = replace(decrease, whitening=[[entry * fmpq(99, 100) for entry in row] for row in decrease.whitening])
    with pytest.raises(ValueError, match="whitening"):
        _ = wrong.domain


def test_quadratic_forms_and_monomials() -> None:
    decrease, _, _ = question("paper", "tt")
    assert len(monomials(4, 3)) == math.comb(7, 3)
    assert monomials(2, 2) == ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    rng = np.random.default_rng(3)
    basis = monomials(4, 2)
    half = rng.integers(-9, 9, size=(len(basis), len(basis)))
    gram = half + half.T
    lower = tuple(int(gram[i, j]) for i in range(len(basis)) for j in range(i + 1))
    polynomial = quadratic_form(decrease.ring, Gram(3, lower), basis)
    for _ in range(10):
        y = rng.integers(-3, 4, size=4)
        z = np.array([int(np.prod([int(v) ** k for v, k in zip(y, e, strict=True)])) for e in basis])
        assert polynomial(*(fmpq(int(v)) for v in y)) == fmpq(int(z @ gram @ z), 2**3)


def test_signs_are_read_off_what_the_identity_has_room_for() -> None:
    """An authority of degree d with a Gram matrix of degree k is cut at 2 (order − k); both its signs at the same."""
    decrease, _, _ = question("contracting", "pf")
    assert decrease.degrees == (3, 2, 2, 2, 2, 2)
    whole = {name: decrease.authority(decrease.pieces[0], name) for name in decrease.free_inputs}
    assert max(int(polynomial.total_degree()) for polynomial in whole.values()) == 2  # nothing to cut
    short = replace(decrease, degrees=(2, 2, 1, 2, 2, 2))
    for cell in short.cells():
        for degree, own, sign, found in zip(
            short.degrees[1:], whole.values(), cell.signs, short.constraints(cell)[:3], strict=False
        ):
            kept = {e: sign * c for e, c in own.to_dict().items() if sum(map(int, e)) <= 2 * (2 - degree)}
            assert found.to_dict() == kept
        assert short.constraints(cell)[3:] == decrease.constraints(cell)[3:]  # levels are what they are
