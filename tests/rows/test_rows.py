"""Every straight and circle row of the paper, both methods, both templates: one table through which each passes."""

from dataclasses import replace
from functools import cache

import pytest

from cfcheck import Outcome, check_document
from cfjax.conf import options_of, preset, problem_of
from cfjax.falsifier import falsify
from cfjax.result import Result
from cfjax.rounds import GOOD_SHARE
from cfjax.synthesis import synthesize
from cfjax.verdict import Verdict
from experiments.paper_table import METHODS, ROWS, STEADY, TEMPLATES, best_before, cases


@cache
def result_of(row: str, template: str, method: str) -> Result:
    name, speed, *_ = ROWS[row]
    overrides = [f"method={method}", f"template={template}", "cars=500"]
    overrides += [f"path.speed={speed!r}"] if speed is not None else []
    config = preset(name, overrides)
    return synthesize(problem_of(config), options_of(config))


@pytest.mark.parametrize(("row", "template", "method"), cases(STEADY))
def test_row_is_certified_with_a_tight_margin(row: str, template: str, method: str) -> None:
    result = result_of(row, template, method)
    assert result.verdict is Verdict.CERTIFIED, result.message
    certified, falsified = result.margin_certified, result.margin_falsified
    assert certified is not None and falsified is not None
    assert certified <= falsified + 1e-9  # what is proven cannot exceed what was found
    assert certified >= GOOD_SHARE * falsified
    before = best_before(row, template, method)
    if before is not None:
        assert falsified >= before
    sos = result.segments[0].margin_sos
    assert sos is not None and certified >= 0.98 * sos  # rounding to an exact proof costs next to nothing


@pytest.mark.parametrize(("row", "template", "method"), cases(STEADY))
def test_certificate_of_a_row_replays(row: str, template: str, method: str) -> None:
    result = result_of(row, template, method)
    assert result.document is not None
    report = check_document(result.document)
    assert report.outcome is Outcome.PROVEN
    assert result.margin_certified is not None and result.margin_certified <= float(report.margins[0]) + 1e-15


@pytest.mark.parametrize(("row", "template", "method"), cases(STEADY))
def test_no_car_of_a_row_is_lost(row: str, template: str, method: str) -> None:
    loop = result_of(row, template, method).closed_loop
    assert loop is not None and loop.cars == 500
    assert (loop.left_funnel, loop.left_safe, loop.missed_goal) == (0, 0, 0)
    assert loop.largest_value <= 1


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.parametrize("row", STEADY)
def test_path_following_is_never_behind_tracking(row: str, template: str) -> None:
    following, tracking = (result_of(row, template, method) for method in METHODS)
    assert following.margin_falsified is not None and tracking.margin_falsified is not None
    assert following.margin_falsified >= tracking.margin_falsified
    # and the tracking funnel itself is a path following funnel with at least its margin
    (segment,) = following.problem.path.segments
    funnel = tracking.segments[0].funnel
    worst = {point.condition: point for point in falsify(following.problem, segment, funnel)}
    assert worst["d"].slack >= tracking.margin_falsified * (1 - 1e-6)


def test_a_spoiled_candidate_is_never_certified() -> None:
    """Scaled, sheared or sped up until the falsifier finds a violation: the certifier must not certify any of them."""
    from cfjax.certificate import certify

    result = result_of("circle, π/2 m/s", "paper", "pf")
    (segment,) = result.problem.path.segments
    good = result.segments[0].funnel
    spoiled = 0
    for change in (
        {"shape": 1.3 * good.shape},
        {"shape": 0.7 * good.shape},
        {"rate": 1.9 * good.rate},
        {"rate": 0.2 * good.rate},
        {"shape": good.shape[::-1, ::-1].copy()},
    ):
        funnel = replace(good, **change)
        if min(point.slack for point in falsify(result.problem, segment, funnel)) < 0:
            spoiled += 1
            assert certify(result.problem, [funnel]).verdict is not Verdict.CERTIFIED
    assert spoiled >= 4
