"""What a result says of itself: a list of words and units for a terminal and a notebook, and one line."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from cfjax.conf import preset, problem_of
from cfjax.result import Absorbed, ClosedLoop, Result, Robustness
from cfjax.verdict import Verdict


Make = Callable[..., Result]  # hand_made

AMOUNTS = Absorbed(0.00157999, (0.3899, 0.28, 0.281, 0.499), (0.1,) * 4, 0.00059399)
ABSORBED = Robustness(AMOUNTS, 0.5, AMOUNTS, 0.25)


@pytest.fixture
def certified(hand_made: Make) -> Result:
    problem = problem_of(preset("circle", ["method=tt"]))
    return hand_made(problem, verdict=Verdict.CERTIFIED, margin=0.31239, robustness=ABSORBED)


def test_a_certified_result_is_a_list_with_units(certified: Result) -> None:
    assert str(certified).splitlines() == [
        "certified: circle, trajectory tracking (TT)",
        "  margin          0.3123 1/s proven; the falsifier found no less than 0.3333 1/s",
        "  absorbs         one of the following",
        "  control period  1.57 ms (control at 633 Hz or faster)",
        "  delay           0.593 ms, of all that is measured",
        "  disturbance     alpha 0.38 rad/s, x 0.28 m/s, y 0.28 m/s, v 0.49 m/s², of one state's rate",
        "  cars            10 driven: 0 left the funnel, 0 left S, 0 missed G; largest V 0.75",
        "  arrival         after 1.5 to 2.5 s, of these cars",
    ]


def test_times_that_are_one_and_sets_that_are_not_there_are_not_said_twice(certified: Result) -> None:
    together = certified.replace(closed_loop=ClosedLoop(10, 0, 0, 0, 0.5, (6.0, 6.0004)))
    assert "  arrival         after 6 s, of these cars" in str(together)
    lap = certified.replace(closed_loop=ClosedLoop(10, 0, 0, 0, 0.5, (1088.6, 1101.2)))
    assert "after 1090 to 1100 s, of" in str(lap)
    without = together.replace(problem=replace(certified.problem, safe=None))
    assert "10 driven: 0 left the funnel, 0 missed G; largest" in str(without)


def test_one_line_says_verdict_path_method_margins_and_cars(certified: Result) -> None:
    assert repr(certified) == (
        "<certified: circle, trajectory tracking (TT); margin 0.3123 1/s proven; the falsifier found no less than "
        "0.3333 1/s; 10 cars, none lost>"
    )
    lost = ClosedLoop(10, 1, 2, 0, 1.5, None)
    assert repr(certified.replace(closed_loop=lost)).endswith("; 10 cars, 3 failures>")
    bare = Result(Verdict.INCONCLUSIVE, "nothing", certified.problem)
    assert repr(bare) == "<inconclusive: circle, trajectory tracking (TT)>"


def test_who_has_no_proof_hears_why(hand_made: Make) -> None:
    lines = hand_made(problem_of(preset("circle"))).describe().splitlines()
    assert lines[:3] == [
        "inconclusive: circle, path following (PF)",
        "  reason          made by hand",
        "  what helps      docs/not-certified.md, the cheapest first",
    ]
    assert "nothing proven" in lines[3]


def test_inputs_that_may_not_be_held_have_no_rate(certified: Result) -> None:
    never = replace(ABSORBED, alone=replace(AMOUNTS, period=0.0))
    assert "  control period  0 ms\n" in str(certified.replace(robustness=never))


def test_in_a_tube_there_is_no_arrival_and_a_law_that_knows_the_speed(hand_made: Make) -> None:
    loop = ClosedLoop(10, 0, 0, 0, 0.75, None)
    certified = {"margin": 0.25, "verdict": Verdict.CERTIFIED, "robustness": ABSORBED, "closed_loop": loop}
    tube = hand_made(problem_of(preset("tube")), **certified)
    assert "one of the following, under the law that is told the speed alone\n" in str(tube)
    assert "arrival" not in str(tube)


def test_a_notebook_shows_the_same_as_a_table(certified: Result) -> None:
    shown = certified.replace(message="a < b")._repr_html_()
    assert shown.count("<tr>") == len(certified.facts()) == 7
    assert "<th>control period</th><td>1.57 ms" in shown and "<caption>certified: circle," in shown
    failed = certified.replace(verdict=Verdict.INCONCLUSIVE, message="a < b", segments=())
    assert "<td>a &lt; b</td>" in failed._repr_html_()
