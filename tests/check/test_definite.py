"""Definiteness, against eigenvalues and by the two ways in which it is decided."""

import numpy as np
import pytest
from flint import fmpq

from cfcheck.exact import definite
from cfcheck.exact.definite import is_positive_definite, symmetric


def test_definiteness_agrees_with_eigenvalues() -> None:
    rng = np.random.default_rng(0)
    seen = {True: 0, False: 0}
    for _ in range(300):
        size = int(rng.integers(1, 8))
        root = rng.integers(-4, 5, size=(size, size + 1))
        matrix = root @ root.T + int(rng.integers(-6, 3)) * np.eye(size, dtype=int)
        least = np.linalg.eigvalsh(matrix.astype(float)).min()
        if abs(least) < 1e-9:
            continue
        answer = is_positive_definite([[fmpq(int(entry), 7) for entry in row] for row in matrix])
        assert answer == (least > 0)
        seen[answer] += 1
    assert min(seen.values()) > 30


def test_definiteness_is_decided_exactly() -> None:
    tiny = fmpq(1, 10**40)
    assert is_positive_definite([[fmpq(1), fmpq(1)], [fmpq(1), 1 + tiny]])
    assert not is_positive_definite([[fmpq(1), fmpq(1)], [fmpq(1), fmpq(1)]])
    assert not is_positive_definite([[fmpq(1), fmpq(1)], [fmpq(1), 1 - tiny]])
    assert not is_positive_definite([[fmpq(2), fmpq(1)], [fmpq(0), fmpq(2)]])  # not symmetric
    with pytest.raises(ValueError, match="square"):
        is_positive_definite([[fmpq(1), fmpq(0)]])


def test_a_rounded_factor_never_says_what_the_characteristic_polynomial_denies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gram matrices as they are written: of low rank, padded a little, or moved just out of the cone; also spoiled."""
    rng = np.random.default_rng(0)
    decided = {True: 0, False: 0}
    for size in (1, 3, 15, 35):
        for _ in range(25):
            half = rng.normal(size=(size, rng.integers(1, size + 1)))
            matrix = half @ half.T
            padding = rng.choice([1e-5, 1e-7, 1e-9, -1e-9, -1e-7]) * np.abs(matrix).max()
            bits = int(rng.integers(20, 60))
            padded = matrix + padding * np.eye(size)
            whole = [[round(float(padded[max(i, j), min(i, j)]) * 2**bits) for j in range(size)] for i in range(size)]
            answer = definite._is_dominated(whole)
            decided[answer] += 1
            if answer:
                assert definite._has_positive_roots(whole)
    assert min(decided.values()) > 20
    # without a factor a matrix has to be dominant itself, and strictly
    monkeypatch.setattr(definite, "_cholesky", lambda rows: [[0.0] * len(row) for row in rows])
    assert definite._is_dominated([[2**60 + 1, 2**60], [2**60, 2**60 + 1]])
    assert not definite._is_dominated([[2**60, 2**60], [2**60, 2**60]])
    # a factor of somebody else's is no proof: of a matrix with the eigenvalues 1.6, 1.6 and -0.2, in units of 5 · 2^60
    not_definite = [[5 * 2**60 if i == j else -3 * 2**60 for j in range(3)] for i in range(3)]
    assert not definite._has_positive_roots(not_definite)
    for size in (0.0, 1.0, 2.0**40, 2.0**47, 2.0**52):
        lower = [[*[0.0] * i, size] for i in range(3)]
        monkeypatch.setattr(definite, "_cholesky", lambda _, own=lower: own)
        assert not definite._is_dominated(not_definite)


def test_numbers_of_any_length_are_decided() -> None:
    for scale in (fmpq(1, 2**2000), fmpq(1), fmpq(2**2000), fmpq(3**900, 7**900)):
        assert is_positive_definite([[2 * scale, scale], [scale, 2 * scale]])
        assert not is_positive_definite([[scale, 2 * scale], [2 * scale, scale]])
        assert not is_positive_definite([[scale, fmpq(0)], [fmpq(0), fmpq(0)]])
    assert is_positive_definite([[fmpq(2**3000), fmpq(0)], [fmpq(0), fmpq(1)]])  # of very unequal sizes
    assert not is_positive_definite([[fmpq(1), fmpq(10**400)], [fmpq(10**400), fmpq(1)]])


def test_a_triangle_is_read_row_by_row() -> None:
    assert symmetric([1, 2, 3, 4, 5, 6]) == [[1, 2, 4], [2, 3, 5], [4, 5, 6]]
    assert symmetric([]) == []
