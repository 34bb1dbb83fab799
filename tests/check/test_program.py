"""What a sum of squares shows of a claim, on a disc where everything is known by hand."""

from collections.abc import Iterator

import pytest
from flint import fmpq, fmpq_mpoly

from cfcheck.kernel.program import CellProof, FunnelProgram, Gram, is_definite


class Disc(FunnelProgram):
    """2 + y0 y1 ≥ λ on the unit disc, whose funnel is 4 |x|² ≤ 1."""

    states = ("a", "b")
    shape = ((fmpq(4), fmpq(0)), (fmpq(0), fmpq(4)))
    whitening = ((fmpq(1, 2), fmpq(0)), (fmpq(0), fmpq(1, 2)))
    degrees = (1, 0)

    @property
    def peak(self) -> fmpq:
        return fmpq(1)

    def cells(self) -> Iterator[None]:
        yield None

    def target(self, cell: None) -> fmpq_mpoly:
        y, z = self.ring.gens()
        return 2 + y * z

    def weight(self, cell: None) -> fmpq_mpoly:
        return self.ring.constant(1)

    def least_weight(self, cell: None) -> fmpq:
        return fmpq(1)

    def constraints(self, cell: None) -> list[fmpq_mpoly]:
        return [1 - self.form]


# 2 + y0 y1 - 1 = zᵀ Q z + 9/16 (1 - |y|²) for z = (1, y0, y1)
FREE = Gram(4, (7, 0, 9, 0, 8, 9))
LEVEL = Gram(4, (9,))


def margin(claim: Disc, free: Gram, level: Gram, claimed: fmpq = fmpq(1)) -> fmpq:
    return claim.proven_margin(CellProof(None, claimed, (free, level)))


def test_a_lower_triangle_is_read_row_by_row() -> None:
    assert Gram(0, (1, 2, 3, 4, 5, 6)).whole == [[1, 2, 4], [2, 3, 5], [4, 5, 6]]
    assert Gram(0, (1, 2, 3, 4, 5, 6)).size == 3
    assert Gram(0, (1, -9, 3)).longest == 4


def test_an_identity_shows_its_margin_and_a_leftover_costs_what_it_may_be() -> None:
    assert margin(Disc(), FREE, LEVEL) == 1
    for claimed in (fmpq(9, 8), fmpq(3, 2)):  # the constant is too small by that much
        assert 1 - fmpq(1, 10**30) < margin(Disc(), FREE, LEVEL, claimed) <= 1
    assert margin(Disc(), Gram(4, (7, 0, 9, 0, 7, 9)), LEVEL) < 1 - fmpq(1, 16)  # 1/8 y0 y1 is left, 1/16 on the circle
    assert margin(Disc(), FREE, Gram(4, (10,))) <= 1 - fmpq(1, 16)


def test_what_is_not_definite_or_of_another_size_shows_nothing() -> None:
    for lower in ((7, 0, 9, 0, 9, 9), (7, 0, 9, 0, 10, 9), (0, 0, 9, 0, 8, 9), (-7, 0, 9, 0, 8, 9)):
        with pytest.raises(ValueError, match="matrix 0 is not positive definite"):
            margin(Disc(), Gram(4, lower), LEVEL)
    for level in (0, -9):
        with pytest.raises(ValueError, match="matrix 1 is not positive definite"):
            margin(Disc(), FREE, Gram(4, (level,)))
    for lower in ((7, 0, 9), (7, 0, 9, 0, 8), (7, 0, 9, 0, 8, 9, 1), (7, 0, 9, 0, 8, 9, 0, 0, 0, 9)):
        with pytest.raises(ValueError, match="expected 3"):
            margin(Disc(), Gram(4, lower), LEVEL)
    with pytest.raises(ValueError, match="expected 2 Gram matrices"):
        Disc().proven_margin(CellProof(None, fmpq(1), (FREE,)))


def test_a_decision_that_is_remembered_is_of_that_matrix_and_is_paid_for() -> None:
    good, bad = (2, 1, 2), (2, 2, 2)
    for _ in range(2):
        assert is_definite(Gram(0, good))
        assert not is_definite(Gram(0, bad))
        assert not is_definite(Gram(200, bad))
        # Python's hashes of -1 and -2 are equal
        assert is_definite(Gram(0, (2, -1, 2)))
        assert not is_definite(Gram(0, (2, -2, 2)))
    spent = []
    longer = Gram(4 + 2048, tuple(entry * 2**2048 for entry in FREE.lower))  # the same matrix, dearer to decide
    for gram in (FREE, FREE, longer):
        claim = Disc()
        before = claim.domain.budget.left
        margin(claim, gram, LEVEL)
        spent.append(before - claim.domain.budget.left)
    assert spent[0] == spent[1] == spent[2] - 3 * 3**3
