"""learner=polytope from a problem to a proof and a run folder, with demonstrations by model-predictive control."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import cfjax
from cfcheck import Outcome, check_document
from cfjax.conf import options_of, preset, problem_of, yaml_of
from cfjax.learner.elimination import Elimination
from cfjax.learner.run import PolytopeLearned
from cfjax.report.run_folder import read_run, write_run
from cfjax.result import Result
from experiments.paper_table import Line, compared


OVERRIDES = ["learner=polytope", "template=paper", "polytope.climb=false", "cars=20"]


@pytest.fixture(scope="module")
def found() -> Result:
    config = preset("circle", OVERRIDES)
    return cfjax.synthesize(problem_of(config), options_of(config))


@pytest.mark.slow
def test_the_circle_is_certified_by_elimination(found: Result) -> None:
    assert found.verdict is cfjax.Verdict.CERTIFIED, found.message
    assert found.margin_certified is not None and found.margin_certified > 0
    assert found.document is not None and check_document(found.document).outcome is Outcome.PROVEN
    loop = found.closed_loop
    assert loop is not None and loop.cars == 20
    assert (loop.left_funnel, loop.left_safe, loop.missed_goal) == (0, 0, 0)


@pytest.mark.slow
def test_figures_of_the_search_are_in_the_run_folder(found: Result, tmp_path: Path) -> None:
    assert found.search["learner"] == "polytope" and "a funnel of margin" in found.search["shown"]
    (run,) = found.search["runs"]
    assert run["change"] is None and run["ending"] == "found"  # c0 is a coefficient
    assert 1 <= run["candidates"] <= run["bound"] == run["limit"]
    assert run["candidates"] == run["cuts"] + 1 and run["demonstrations"] > 0 == run["half_planes"]
    assert run["margin"] >= run["asked"] == Elimination().margin
    write_run(found, tmp_path / "run", yaml_of(preset("circle", OVERRIDES)))
    assert read_run(tmp_path / "run").search == found.search


def test_demonstrations_come_in_batches_of_one_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each number of witnesses would be compiled for itself."""
    counts = []

    def demonstrate(problem: cfjax.Problem, x: np.ndarray, theta: np.ndarray):
        counts.append((len(x), len(theta)))
        return cfjax.demonstrate(problem, x, theta)

    def learned(problem: cfjax.Problem, template: object, how: Elimination, *, demonstrate, **_: object):
        for count in (1, 5, 8):
            x = np.random.default_rng(count).normal(size=(count, 4))
            got = demonstrate(np.zeros(count), x)
            alone = cfjax.demonstrate(problem, x[np.arange(8) % count]).inputs[:count]
            np.testing.assert_allclose(got, alone, atol=1e-9)
        return PolytopeLearned(None, "not asked", ())

    monkeypatch.setattr("cfjax.learner.by_elimination.demonstrate", demonstrate)
    monkeypatch.setattr("cfjax.learner.by_elimination.learn_polytope", learned)
    config = preset("circle", OVERRIDES)
    found = cfjax.search(problem_of(config), options_of(config))
    assert found.message == "not asked" and found.search["runs"] == []
    assert counts == [(8, 8)] * 3


def test_the_table_puts_learners_side_by_side() -> None:
    def line(learner: str, certified: float | None, **figures: object) -> Line:
        known = {name.name: None for name in fields(Line)} | {"row": "circle", "template": "paper", "method": "tt"}
        return Line(**known | {"learner": learner, "certified": certified, "paper": "found"} | figures)

    lines = [
        line("gradient", 0.3, candidates=4, searches="", seconds=9.0),
        line("polytope", None, verdict="inconclusive", candidates=9, witnesses=40, searches="1 too small", seconds=2.0),
    ]
    (row,) = compared(lines)
    assert (row.gradient, row.polytope, row.revised, row.paper) == ("0.2999", "inconclusive", "", "found")
    assert (row.candidates, row.witnesses, row.searches, row.seconds) == ("4 / 9", "40", "1 too small", "9 / 2")
