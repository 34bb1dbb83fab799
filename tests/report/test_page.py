"""The page of a run, in a browser: it says what the result says, shows it, and asks nobody for anything."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flint import fmpq
from playwright.sync_api import Browser, Page

import cfjax.report.page.page
from cfcheck import Report
from cfjax.conf import preset, problem_of, yaml_of
from cfjax.errors import InputError
from cfjax.problem import Problem
from cfjax.report.__main__ import main
from cfjax.report.files import write_error
from cfjax.report.page import save_page, tables, write_index
from cfjax.report.run_folder import read_run, write_run
from cfjax.result import Absorbed, Result, Robustness, Rollouts, StretchMargin, WorstPlace
from cfjax.verdict import Verdict
from tests import by_hand
from tests.shapes import eight


Make = Callable[..., Result]  # hand_made

MOST_BYTES = 5_900_000
SVG = ("--picture", "svg")
WORST = (WorstPlace(0, "d", 0.25, 0.5, (0.1, 0.2, 0.3, 0.1)), WorstPlace(0, "a", 0.125, 0.0, (0.5, 0.0, 0.0, 0.0)))


def _proves(path: Path) -> Report:
    return by_hand.proven(fmpq(3, 10))


def _cars(problem: Problem) -> Rollouts:
    """By hand: they stay a little off the reference, and arrive one after another."""
    end = sum(segment.duration for segment in problem.path.curve)
    clock = np.linspace(0.0, 1.5 * end, 60)[:, None] * np.ones((1, 3))
    theta = np.minimum(clock * np.array([[0.7, 1.0, 1.4]]), end)
    x = np.zeros((60, 3, 4)) + 0.05 * np.arange(3)[None, :, None]
    return Rollouts(clock, theta, x, 0.5 * np.exp(-theta), np.ones((60, 3, 3)))


def _certified(result: Result) -> Result:
    end = result.segments[0].funnel.duration
    stretches = (StretchMargin(0.0, end / 3, 0.4), StretchMargin(end / 3, end, 0.3))
    segments = tuple(replace(found, margin_certified=0.3, stretches=stretches) for found in result.segments)
    cars, document = (_cars(result.problem),), {"format": "made by hand"}
    return result.replace(
        verdict=Verdict.CERTIFIED, segments=segments, rollouts=cars, document=document, worst_points=WORST
    )


def _tube(result: Result) -> Result:
    """With one car on a straight path."""
    way = np.linspace(0.0, 5.0, 40)[:, None]
    x = np.full((40, 1, 4), 0.02)
    poses = np.stack([0 * way, 0.1 * way**2, way], axis=-1)
    inputs = np.ones((40, 1, 3)) * np.array([1.0, 0.2, 0.0])
    cars = Rollouts(way, way, x, np.full((40, 1), 0.3), inputs, poses)
    return result.replace(verdict=Verdict.CERTIFIED, rollouts=(cars,))


def _opened(browser: Browser, file: Path, width: int = 1280, touch: bool = False) -> Page:
    """The page when all is drawn; nothing was said on the console, nothing asked of anybody."""
    page = browser.new_page(viewport={"width": width, "height": 844}, has_touch=touch, is_mobile=touch)
    said: list[str] = []
    asked: list[str] = []
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(file.resolve().as_uri())
    if file.name == "report.html":
        page.wait_for_selector("html[data-drawn]", timeout=120_000)
    outside = [url for url in asked if not url.startswith(("data:", "blob:", file.resolve().as_uri()))]
    assert (said, outside) == ([], [])
    return page


def _figures(page: Page) -> dict[str, int]:
    """Those that are drawn, and how many curves and surfaces each has."""
    return page.evaluate(
        "Object.fromEntries([...document.querySelectorAll('.figure')]"
        ".filter((f) => f.querySelector('svg.main-svg')).map((f) => [f.id.slice(7), f.data.length]))"
    )


def test_a_certified_run_on_a_desk_and_on_a_phone(browser: Browser, hand_made: Make, tmp_path: Path) -> None:
    config = preset("obstacle")
    made = _certified(hand_made(problem_of(config))).replace(command="python -m cfjax.train +path=obstacle")
    written = write_run(made, tmp_path / "run", yaml_of(config), page=save_page, check=_proves)
    assert (written.verdict, "report" in written.seconds) == (Verdict.CERTIFIED, True)
    file = tmp_path / "run" / "report.html"
    page = _opened(browser, file)
    assert page.title() == "certified: obstacle, pf · cfjax"
    assert set(_figures(page)) == {"space", "plane", "sections", "margins", "values", "inputs"}
    text = page.inner_text("body")
    for words in ("made by hand", "python -m cfjax.train +path=obstacle", "some input makes V fall", "0.25 1/s"):
        assert words in text
    axis = "document.getElementById('figure-space')._fullLayout.scene.zaxis.title.text"
    heights = "document.getElementById('figure-space').data.at(-2).z.at(-1)"
    assert page.evaluate(axis) == "reference time θ (s)"
    theta = page.evaluate(heights)
    page.click("button[data-view=time]")
    page.wait_for_function(f"{axis} === 'time t of car 1 (s)'")
    clock = page.evaluate(heights)
    assert theta != clock
    page.close()
    phone = _opened(browser, file, width=390, touch=True)
    assert set(_figures(phone)) == {"space", "plane", "sections", "margins", "values", "inputs"}
    assert phone.evaluate("document.documentElement.scrollWidth") == 390
    wide = "[...document.querySelectorAll('.figure')].map((f) => f.getBoundingClientRect().right)"
    assert max(phone.evaluate(wide)) <= 390
    phone.close()


def test_a_result_without_a_folder_has_its_page(
    hand_made: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It says what the checker says of the certificate's text, and leaves out what only a folder's files prove."""
    asked: list[dict[str, object]] = []

    def proves(document: dict[str, object]) -> Report:
        asked.append(document)
        return by_hand.proven(fmpq(5, 16))

    monkeypatch.setattr(cfjax.report.page.page, "check_document", proves)
    alone = Absorbed(0.0015, (0.3,) * 4, (0.1,) * 4, 0.0005)
    claimed = _certified(hand_made(problem_of(preset("obstacle")))).replace(
        message="what it claims", robustness=Robustness(alone, 0.5, alone, 0.5)
    )
    file = tmp_path / "own.html"
    (tmp_path / "config.yaml").write_text("of another run")
    assert claimed.report(str(file)) == file
    text = file.read_text()
    assert asked == [claimed.document]
    assert "Proven. The exact checker accepted the certificate." in text
    assert "cfjax.check.check_document(result.document)" in text
    assert re.search(r"<dd>0\.3125 <small>1/s", text)
    for absent in ("what it claims", "of another run", "robustness.json", "python -m cfjax.check"):
        assert absent not in text
    assert [entry.name for entry in tmp_path.iterdir() if entry != file] == ["config.yaml"]


def test_a_page_claims_nothing_that_the_checker_refuses(hand_made: Make, tmp_path: Path) -> None:
    for forged in (_certified(hand_made(problem_of(preset("circle")))), hand_made(problem_of(preset("circle")))):
        claimed = forged.replace(verdict=Verdict.CERTIFIED)
        with pytest.raises(InputError, match="result: expected what the certificate proves, got certified"):
            claimed.report(tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


def test_a_page_goes_into_a_new_folder_or_says_why_not(hand_made: Make, tmp_path: Path) -> None:
    result = hand_made(problem_of(preset("circle")), segments=(), closed_loop=None)
    file = result.report()
    try:
        assert "Nothing is proven" in file.read_text()
        assert file.name == "report.html"
    finally:
        shutil.rmtree(file.parent)
    for wrong, line in ((tmp_path, "path: expected the name of a file"), (tmp_path / "no" / "r.html", "cannot write")):
        with pytest.raises(InputError, match=line):
            result.report(wrong)


def test_nothing_proven_and_a_tube(browser: Browser, hand_made: Make, tmp_path: Path) -> None:
    failed = hand_made(problem_of(preset("oval")), failed_at=(0.5, 0.5), worst_points=WORST)
    nothing = hand_made(problem_of(preset("circle")), segments=(), closed_loop=None, verdict=Verdict.SOLVER_FAILED)
    tube = _tube(hand_made(problem_of(preset("tube"))))
    wanted = {
        "failed": (failed, {"space", "plane", "sections", "margins"}, "Nothing is proven"),
        "nothing": (nothing, {"space", "plane"}, "gave no usable answer"),
        "tube": (tube, {"space", "plane", "sections", "values", "inputs"}, "for every path within bounds"),
    }
    for name, (result, figures, words) in wanted.items():
        (tmp_path / name).mkdir()
        save_page(result, tmp_path / name / "report.html")
        page = _opened(browser, tmp_path / name / "report.html")
        assert set(_figures(page)) == figures
        assert words in page.inner_text("body")
        page.close()


def test_a_page_of_a_long_path_stays_small(hand_made: Make, write: Callable[..., Path], tmp_path: Path) -> None:
    config = preset("waypoints", [f"path.file={write(10 * eight())}", "path.closed=true", "path.speed=3"])
    made = _certified(hand_made(problem_of(config)))
    end = sum(segment.duration for segment in made.problem.path.curve)
    theta = np.linspace(0.0, end, 2000)[:, None] * np.ones((1, 24))
    x = np.random.default_rng(0).normal(scale=0.05, size=(2000, 24, 4))
    save_page(
        made.replace(rollouts=(Rollouts(theta, theta, x, 0 * theta + 0.123456, 0.123456 + 0 * x[..., :3]),)),
        tmp_path / "report.html",
    )
    assert (tmp_path / "report.html").stat().st_size < MOST_BYTES


def test_what_the_page_is_told_ends_no_script(hand_made: Make, tmp_path: Path) -> None:
    evil = "</script><script>alert(1)</script>"
    save_page(hand_made(problem_of(preset("circle")), message=evil, command=evil), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert evil not in text and "&lt;/script&gt;&lt;script&gt;alert(1)" in text
    data = re.search(r'<script type="application/json" id="figures">(.*?)</script>', text, re.DOTALL)
    assert data is not None and "space" in json.loads(data[1])


def test_amounts_are_rounded_down_and_say_of_which_law(hand_made: Make) -> None:
    alone = Absorbed(0.001577941, (0.38719,) * 4, (0.0055499,) * 4, 0.00059999)
    robustness = Robustness(alone, 0.95009, alone, 0.99009, ((1.0, 3.14159265, alone),))
    along = hand_made(problem_of(preset("circle")), margin=0.29999, robustness=robustness)
    held = {fact.name: f"{fact.value} {fact.unit}" for fact in tables.facts(along)}
    assert (held["margin λ, certified"], held["inputs held, proven"]) == ("0.2999 1/s", "1.57 ms")
    tube = hand_made(problem_of(preset("tube")), margin=0.29999, robustness=robustness)
    assert "inputs held, told the speed alone, proven" in {fact.name for fact in tables.facts(tube)}
    rows = {label: cells for label, *cells in tables.absorbed(tube)[1]}
    assert rows["data old by (ms)"] == ["0.599", "0.599"]
    assert rows["rate off by, a second: x (m)"] == ["0.387", "0.387"]
    assert rows["with the pose off, from starts with V up to"] == ["0.95", "0.99"]
    assert rows["inputs held for (ms), chosen at 1 to 3.141 m/s"] == ["1.57", "–"]


def test_worst_points_and_command_are_read_as_they_were_written(hand_made: Make, tmp_path: Path) -> None:
    made = hand_made(problem_of(preset("circle")), worst_points=WORST, command="python x.py 'a b'")
    write_run(made, tmp_path, yaml_of(preset("circle")))
    read = read_run(tmp_path)
    assert (read.worst_points, read.command) == (WORST, "python x.py 'a b'")


def test_a_page_that_cannot_be_written_costs_no_result(
    hand_made: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(result: Result, path: Path) -> None:
        path.write_text("half")
        raise RuntimeError("no ink")

    write_run(hand_made(problem_of(preset("circle"))), tmp_path, yaml_of(preset("circle")), page=fails)
    assert capsys.readouterr().err == "warning: report.html could not be drawn (RuntimeError: no ink)\n"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["config.yaml", "reference.csv", "result.json"]


def test_the_command_writes_pages_and_the_index_of_a_sweep(
    browser: Browser, hand_made: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for job, name in enumerate(("circle", "straight")):
        made = hand_made(problem_of(preset(name)), closed_loop=None)
        write_run(made, tmp_path / str(job), yaml_of(preset(name)))
    write_error(tmp_path / "2", "bad input", "path.radius: expected <more>")
    assert main([str(tmp_path)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed == [str(tmp_path / place) for place in ("0/report.html", "1/report.html", "index.html")]
    assert main([str(tmp_path / "0"), "--picture", "svg"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        str(tmp_path / "0" / name) for name in ("report.html", "funnel.svg")
    ]
    assert "<svg" in (tmp_path / "0" / "funnel.svg").read_text()[:1000]
    assert main([str(tmp_path / "0"), "--picture", "svg", "--width", "column"]) == 0
    assert f'width="{8.8 / 2.54 * 72:.2f}'[:-1] in (tmp_path / "0" / "funnel.svg").read_text()[:1000]
    capsys.readouterr()
    for flags, said in ((["--width", "8"], "--width: expected --picture"), (["--width", "2", *SVG], "width: expected")):
        assert main([str(tmp_path / "0"), *flags]) == 2
        assert said in capsys.readouterr().err
    page = _opened(browser, tmp_path / "index.html", width=390, touch=True)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    text = page.inner_text("body")
    assert "2 inconclusive" in text and "expected <more>" in text
    page.click("a[href='1/report.html']")
    page.wait_for_selector("html[data-drawn]")
    assert "straight" in page.title()
    page.close()


def test_the_index_of_a_sweep_that_has_only_begun(tmp_path: Path) -> None:
    (tmp_path / "0" / ".hydra").mkdir(parents=True)
    text = write_index(tmp_path).read_text()
    assert "1 crashed" in text and "the job did not end" in text


def test_what_is_claimed_again_is_proven_again(
    hand_made: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = _certified(hand_made(problem_of(preset("circle"))))
    assert write_run(made, tmp_path, yaml_of(preset("circle")), check=_proves).verdict is Verdict.CERTIFIED
    assert main([str(tmp_path)]) == 2  # the real checker reads what lies there
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "expected what the certificate proves, got certified, which the exact checker does not accept" in error
    assert not (tmp_path / "report.html").exists()


def test_bad_folders_are_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in (tmp_path, tmp_path / "nowhere"):
        assert main([str(folder)]) == 2
        assert capsys.readouterr().err == f"error: folder: expected a run's folder or a sweep's, got {folder}\n"
