import numpy as np
import pytest
from flint import fmpq

from cfcheck.kernel.containment import Sets, broken_containments
from cfcheck.kernel.level import LEVELS


STATES = ("alpha", "x", "y", "v")


def exact(value: float) -> fmpq:
    return fmpq(round(value * 10**6), 10**6)


def judge(shape: np.ndarray, template: str, rate: float, inlet: list, goal: list, safe: list | None) -> set[str]:
    rows = [[exact(entry) for entry in row] for row in shape]
    axes = ([exact(v) for v in s] if s else None for s in (inlet, goal, safe))
    broken = broken_containments(STATES, rows, LEVELS[template](exact(rate)).bounds(fmpq(2)), Sets(*axes))
    return {line[len("condition (")] for line in broken}


def test_agrees_with_eigenvalues_on_random_funnels() -> None:
    rng = np.random.default_rng(0)
    seen: dict[str, int] = {"a": 0, "b": 0, "c": 0, "": 0}
    for k in range(300):
        half = rng.normal(size=(4, 4)) * 0.4
        shape = np.round(half @ half.T + 3 * np.eye(4), 6)
        shape = (shape + shape.T) / 2
        template, rate = ("paper", "contracting")[k % 2], round(float(rng.uniform(-0.2, 0.45)), 6)
        inlet, goal, safe = (
            np.round(rng.uniform(low, high, 4), 6).tolist() for low, high in ((0.4, 0.6), (0.4, 0.7), (0.55, 1))
        )
        end = 1 - 2 * rate if template == "paper" else np.exp(-2 * rate)
        slacks = {
            "a": 1 - np.linalg.eigvalsh(shape * np.outer(inlet, inlet))[-1],
            "b": np.linalg.eigvalsh(shape * np.outer(goal, goal))[0] - end,
            "c": 1 - (max(1, end) * np.diag(np.linalg.inv(shape)) / np.square(safe)).max(),
        }
        if min(map(abs, slacks.values())) < 1e-6:
            continue
        expected = {name for name, slack in slacks.items() if slack < 0}
        assert judge(shape, template, rate, inlet, goal, safe) == expected
        for name in expected or {""}:
            seen[name] += 1
    assert min(seen.values()) > 10


def test_edges_are_decided_exactly() -> None:
    shape = np.diag([4.0, 4.0, 4.0, 4.0])
    assert judge(shape, "paper", 0.1, [0.5] * 4, [0.5] * 4, None) == {"a"}  # I touches the funnel: not inside
    assert judge(shape, "paper", 0.1, [0.499999] * 4, [0.5] * 4, None) == set()
    assert judge(shape, "paper", 0.0, [0.49] * 4, [0.5] * 4, None) == {"b"}
    assert judge(shape, "paper", 0.1, [0.49] * 4, [0.5] * 4, [0.5] * 4) == {"c"}
    assert judge(shape, "paper", 0.6, [0.49] * 4, [0.5] * 4, None) == {"b"}  # empty before its end


def test_the_heading_must_not_wrap() -> None:
    wide = np.diag([1 / 9.8695, 4.0, 4.0, 4.0])  # π² = 9.8696
    assert judge(wide, "paper", 0.4, [3.1, 0.4, 0.4, 0.4], [3.2, 1, 1, 1], None) == set()
    wide[0, 0] = 1 / 9.8697
    assert judge(np.round(wide, 6) - 1e-5 * np.eye(4), "paper", 0.4, [3.1, 0.4, 0.4, 0.4], [3.2, 1, 1, 1], None) == {
        "c"
    }


@pytest.mark.parametrize("shape", [-np.eye(4) * 4, np.ones((4, 4)), np.zeros((4, 4))])
def test_what_is_no_ellipsoid_is_refused(shape: np.ndarray) -> None:
    assert "c" in judge(shape, "contracting", 0.1, [0.5] * 4, [0.6] * 4, None)
