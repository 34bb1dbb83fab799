"""A result in Python is certified only where the period that is asked for is proven."""

from collections.abc import Callable

import pytest

from cfjax import synthesis
from cfjax.certificate.robustness import Hints
from cfjax.conf import preset, problem_of
from cfjax.options import Options
from cfjax.result import Result
from cfjax.verdict import Verdict


@pytest.mark.parametrize("period", [None, 0.02])
def test_what_is_asked_and_not_found_is_not_certified(
    hand_made: Callable[..., Result], monkeypatch: pytest.MonkeyPatch, period: float | None
) -> None:
    found = hand_made(problem_of(preset("circle")), margin=0.4, verdict=Verdict.CERTIFIED, document={"claim": "funnel"})
    monkeypatch.setattr(synthesis, "search", lambda *_: found)
    monkeypatch.setattr(synthesis, "harden", lambda *_: Hints({"hints": []}, lack="V rises somewhere"))
    result = synthesis.synthesize(found.problem, Options(period=period, cars=0), progress=lambda *_: None)
    if period is None:
        assert result.verdict is Verdict.CERTIFIED
        return
    assert result.verdict is Verdict.INCONCLUSIVE and result.document is None and result.margin_certified is None
    assert "but not period=0.02 (V rises somewhere)" in result.message
