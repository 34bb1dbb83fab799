"""The paper's column."""

import pytest

from cfjax.conf import preset, problem_of
from cfjax.report.paper_rows import agreement, paper_found
from cfjax.verdict import Verdict


@pytest.mark.parametrize(
    ("name", "overrides", "found"),
    [
        ("straight", [], True),
        ("straight", ["method=tt"], False),
        ("straight_long", ["method=tt"], True),
        ("straight_restricted", ["method=tt"], False),
        ("circle", ["method=tt"], True),
        ("circle", ["path.speed=3.1416", "method=tt"], False),
        ("circle", ["path.speed=31.416"], True),
        ("circle", ["path.speed=31.416", "method=tt"], None),
        ("circle", ["path.speed=2"], None),
        ("circle", ["path.radius=2"], None),
        ("circle", ["path.laps=2"], None),
        ("circle", ["sets.inlet=0.3"], None),
        ("circle", ["sets.safe=null"], None),
        ("circle", ["vehicle.wheelbase=0.33"], None),
        ("circle", ["timing=[0.8,1.5]"], True),
        ("straight", ["path.length=5"], None),
        ("oval", [], True),
        ("oval", ["method=tt"], False),
        ("oval", ["path.speed=1.5"], None),
        ("oval", ["sets.goal=0.4"], None),
        ("obstacle", [], True),
        ("obstacle", ["method=tt"], False),
        ("obstacle", ["sets.obstacles=[]"], None),
        ("obstacle", ["sets.goal=0.25"], None),
        ("obstacle_tight", [], False),
        ("obstacle_tight", ["method=tt"], None),
        ("slalom", [], None),
        ("tube", [], None),
        ("straight", ["sets.obstacles=[{disc:[0,2,1]}]"], None),
        ("straight", ["vehicle.footprint=[[0.3,0]]"], None),
    ],
)
def test_only_the_papers_own_rows_have_an_answer(name: str, overrides: list[str], found: bool | None) -> None:
    assert paper_found(problem_of(preset(name, overrides)), problem_of(preset(name))) is found


def test_agreement() -> None:
    assert agreement(Verdict.CERTIFIED, True) == "agrees"
    assert agreement(Verdict.CERTIFIED, False) == "differs"
    assert agreement(Verdict.INCONCLUSIVE, False) == "agrees"
    assert agreement(Verdict.SOLVER_FAILED, True) == agreement(Verdict.REFUTED, False) == ""
    assert agreement(Verdict.CERTIFIED, None) == ""
