"""The quick parts of what `scripts/newcomer` does from Python, and that they notice what is wrong."""

from pathlib import Path

import jaxtyping
import pytest

from scripts import newcomer_python as newcomer


@pytest.fixture(autouse=True)
def as_users_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the checks of annotations that tests run with: they would speak first."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


def test_mistakes_and_points_are_as_a_newcomer_has_to_find_them(tmp_path: Path) -> None:
    assert len(newcomer.MISTAKES) >= 10
    assert newcomer.mistakes() == []
    assert newcomer.point_files(tmp_path) == []


def test_what_is_not_refused_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    mistakes = {"none": (lambda: None, "expected"), "other words": (*newcomer.MISTAKES["half a car"][:1], "wheels")}
    monkeypatch.setattr(newcomer, "MISTAKES", mistakes)
    first, second = newcomer.mistakes()
    assert first == "none: not refused"
    assert second.startswith("other words: expected 'wheels' in one line, got cars: expected")
