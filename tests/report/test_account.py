"""The page shows the checker's account in the checker's own paragraphs: nobody looks for them in a text."""

import re
from collections.abc import Callable
from html import unescape
from pathlib import Path

from flint import fmpq

from cfcheck import Outcome, Report
from cfcheck.robustness.amounts import AbsorbedClaim, LawNumbers, ProvenRobustness
from cfjax.certificate.robustness import Hints
from cfjax.conf import preset, problem_of, yaml_of
from cfjax.report.files import versions
from cfjax.report.page.page import page_of
from cfjax.report.run_folder import confirmed, read_run, write_run
from cfjax.result import Result
from cfjax.verdict import Verdict
from tests import by_hand


Make = Callable[..., Result]  # hand_made

TOLD = (LawNumbers(fmpq(3, 10), None, fmpq(9, 10), fmpq(1, 2), None),)
NONE = AbsorbedClaim(fmpq(1, 1000), (fmpq(0),) * 4, (fmpq(0),) * 4, fmpq(0))
CLAIMS = {"verdict": Verdict.CERTIFIED, "document": {"format": "made by hand"}, "margin": 0.4}


def shown_in(page: str) -> list[str]:
    quoted = re.search(r"<blockquote>(.*?)</blockquote>", page, re.DOTALL)
    assert quoted
    return re.findall(r"<p>(.*?)</p>", quoted[1], re.DOTALL)


def proves(path: Path) -> Report:
    return by_hand.proven(fmpq(3, 10))


def absorbs(path: Path) -> Report:
    return by_hand.proven(fmpq(3, 10), robustness=ProvenRobustness(NONE, fmpq(1), NONE, fmpq(1), (), TOLD))


def test_paragraphs_are_those_of_the_data(hand_made: Make) -> None:
    result = hand_made(problem_of(preset("circle")), verdict=Verdict.CERTIFIED)
    told = ("One. All at once. From every start it is one.", "Two. A law whose. Deviations (x) too.")
    assert shown_in(page_of(result.replace(account=told), "", versions())) == list(told)
    said = "found. All at once. Tubes in turn. Nothing."
    assert shown_in(page_of(result.replace(verdict=Verdict.INCONCLUSIVE, message=said), "", versions())) == [said]


def test_a_run_has_the_account_of_the_file_on_disk(hand_made: Make, tmp_path: Path) -> None:
    config, pages = yaml_of(preset("circle")), []

    def page(result: Result, path: Path) -> None:
        pages.append(shown_in(page_of(result, "", versions())))
        path.touch()

    claimed = hand_made(problem_of(preset("circle")), **CLAIMS)
    for name, check in (("alone", proves), ("with hints", absorbs)):
        folder, told = tmp_path / name, check(tmp_path).paragraphs
        written = write_run(claimed, folder, config, check=check, harden=lambda _: Hints({"hints": []}), page=page)
        assert written.account == told
        assert list(map(unescape, pages[-1])) == list(told)
        again = confirmed(read_run(folder), folder, check)
        assert (again.account, again.message) == (told, " ".join(told))


def test_what_is_not_accepted_has_no_account(hand_made: Make, tmp_path: Path) -> None:
    claimed = hand_made(problem_of(preset("circle")), **CLAIMS, account=("PROVEN: everything.",))
    for name, report in (("broken", Report(Outcome.BROKEN, "no")), ("unread", Report(Outcome.UNREADABLE, "no"))):
        written = write_run(claimed, tmp_path / name, yaml_of(preset("circle")), check=lambda _, said=report: said)
        assert (written.verdict, written.account) == (Verdict.INCONCLUSIVE, ())
