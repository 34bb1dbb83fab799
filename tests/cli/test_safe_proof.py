"""A finished proof is never lost: whatever breaks after it, it lies in the run folder and the checker accepts it."""

import errno
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import cfjax.report.page
import cfjax.report.plot
import cfjax.report.run_folder
import cfjax.synthesis
from cfcheck import Outcome, check_file
from cfjax.conf import options_of, preset, problem_of
from cfjax.learner import Found, Learned
from cfjax.report.run_folder import read_run
from cfjax.result import Result
from cfjax.synthesis import drive, search, synthesize
from cfjax.verdict import Verdict


QUESTION = ["template=paper", "restarts=1", "rounds=1", "robustness=false"]
PROOF = {"certificate.json", "config.yaml", "reference.csv"}
ERRORS = {
    "memory": (MemoryError("10 TB"), "warning: the cars were not driven (MemoryError: 10 TB); the proof stands\n"),
    "xla": (RuntimeError("out of memory\nallocations:\n…"), "(RuntimeError: out of memory); the proof stands\n"),
}


@pytest.fixture(scope="module")
def proven() -> Result:
    config = preset("circle", QUESTION)
    result = search(problem_of(config), options_of(config))
    assert (result.verdict, result.closed_loop) == (Verdict.CERTIFIED, None)
    return result


def warnings_of(error: str) -> list[str]:
    """The lines of stderr that speak of no stage's seconds."""
    return [line for line in error.splitlines() if not re.fullmatch(r"\w+: [\d.]+ s", line)]


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch, proven: Result) -> None:
    monkeypatch.setattr(cfjax.synthesis, "search", lambda *_: proven)


class Breaks:
    """Stands where cars are driven or the picture is drawn; looks at the run folder and fails."""

    def __init__(self, error: BaseException) -> None:
        self.error, self.seen = error, set[str]()

    def __call__(self, *_: object, **__: object) -> None:
        here = Path("here")
        self.seen = {entry.name for entry in here.iterdir()} if here.exists() else set()
        raise self.error


def assert_complete(folder: Path, proven: Result, *, driven: bool = False) -> None:
    assert check_file(folder / "certificate.json").outcome is Outcome.PROVEN
    data = json.loads((folder / "result.json").read_text())
    assert (data["verdict"], data["closed_loop"] is not None) == ("certified", driven)
    read = read_run(folder)
    assert (read.verdict, read.document) == (Verdict.CERTIFIED, proven.document)
    assert read.margin_certified == pytest.approx(proven.margin_certified)


@pytest.mark.parametrize(("error", "line"), ERRORS.values(), ids=list(ERRORS))
def test_cars_that_cannot_be_driven(
    train: Callable[..., int],
    searched: None,
    proven: Result,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    error: Exception,
    line: str,
) -> None:
    broken = Breaks(error)
    monkeypatch.setattr(cfjax.synthesis, "drive_cars", broken)
    assert train("+path=circle", *QUESTION, "hydra.run.dir=here") == 0
    assert broken.seen == {*PROOF, ".hydra", ".lock"}  # before any car was driven
    assert_complete(Path("here"), proven)
    assert (Path("here") / "funnel.png").stat().st_size > 20_000
    captured = capfd.readouterr()
    (said,) = warnings_of(captured.err)
    assert said.endswith(line.rstrip())
    assert captured.out.splitlines()[0] == "certified: circle, path following (PF)"
    assert captured.out.splitlines()[-1].startswith("run: ")


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (
            ValueError("no bound\nat all"),
            0,
            "warning: nothing is proven of what the funnel absorbs: ValueError: no bound at all",
        ),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
    ids=["fails", "Ctrl-C"],
)
def test_hints_that_are_not_found(
    train: Callable[..., int],
    searched: None,
    proven: Result,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    error: BaseException,
    code: int,
    line: str,
) -> None:
    """The certificate stands; what is absorbed is not told, and no half of its file is left."""
    broken = Breaks(error)
    monkeypatch.setattr(cfjax.synthesis, "robustness_of", broken)
    assert train("+path=circle", *QUESTION, "robustness=true", "cars=10", "hydra.run.dir=here") == code
    assert broken.seen >= {"certificate.json"} and "result.json" not in broken.seen
    assert line in capfd.readouterr().err
    assert_complete(Path("here"), proven, driven=code == 0)
    if code == 0:
        assert json.loads((Path("here") / "result.json").read_text())["robustness"] is None
    assert not (Path("here") / "robustness.json").exists()


class FullDisk:
    """Stands where files are written, and refuses those of some names: in a folder, or wherever they are."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *names: str, folder: str | None, error: int) -> None:
        self.names, self.folder, self.error = names, folder, error
        self.write = cfjax.report.run_folder.write_whole
        monkeypatch.setattr(cfjax.report.run_folder, "write_whole", self)

    def __call__(self, path: Path, content: bytes) -> None:
        if path.name in self.names and self.folder in (None, path.parent.name):
            raise OSError(self.error, os.strerror(self.error), str(path))
        self.write(path, content)


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The system's folder for temporary files; and nothing is drawn."""
    monkeypatch.setattr(cfjax.report.plot, "save_picture", lambda *_: None)
    monkeypatch.setattr(cfjax.report.page, "save_page", lambda *_: None)
    place = tmp_path / "elsewhere"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    return place


QUICK = ("+path=circle", *QUESTION, "cars=0")


@pytest.mark.parametrize(
    ("name", "error"), [("certificate.json", errno.ENOSPC), ("config.yaml", errno.ENOENT), ("result.json", errno.EROFS)]
)
def test_what_the_folder_does_not_take_is_kept_elsewhere(
    train: Callable[..., int],
    searched: None,
    proven: Result,
    elsewhere: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    name: str,
    error: int,
) -> None:
    FullDisk(monkeypatch, name, folder="here", error=error)
    assert train(*QUICK, "hydra.run.dir=here") == 3
    (kept,) = elsewhere.iterdir()
    assert_complete(kept, proven)
    captured = capfd.readouterr()
    assert captured.out.splitlines()[0] == "certified: circle, path following (PF)"
    assert captured.out.splitlines()[-1] == f"run: {kept}"
    (said,) = [line for line in warnings_of(captured.err) if line.startswith("error")]
    here = Path("here").absolute()
    assert said == f"error: {here}: cannot be written ({os.strerror(error)}); what came out is kept in {kept}"
    assert not (Path("here") / "result.json").exists()


def test_a_proof_that_nothing_takes_is_not_called_certified(
    train: Callable[..., int],
    searched: None,
    proven: Result,
    elsewhere: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    FullDisk(monkeypatch, "certificate.json", folder=None, error=errno.ENOSPC)
    assert train(*QUICK, "hydra.run.dir=here") == 3
    captured = capfd.readouterr()
    assert captured.out.splitlines()[0] == "inconclusive: circle, path following (PF)"
    assert "a proof that was found could be written nowhere, so that nothing is certified" in captured.out
    assert "nothing proven; the falsifier found no less than" in captured.out
    assert captured.err.endswith(f"error: {Path('here').absolute()}: cannot be written (No space left on device)\n")


def test_a_proof_of_another_question_in_the_folder_proves_nothing(
    train: Callable[..., int],
    searched: None,
    proven: Result,
    elsewhere: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """What a killed run left cannot be removed from a folder that may not be written."""

    def refuse(folder: Path) -> None:
        (folder / "certificate.json").write_text(json.dumps({**(proven.document or {}), "version": "another"}))
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(folder))

    monkeypatch.setattr(cfjax.report.run_folder, "_clear", refuse)
    assert train(*QUICK, "hydra.run.dir=here") == 3
    captured = capfd.readouterr()
    assert captured.out.splitlines()[0] == "inconclusive: circle, path following (PF)"
    assert "certificate.json is there" not in captured.err


def test_where_the_proof_lies_is_said_if_its_verdict_goes_nowhere(
    train: Callable[..., int],
    searched: None,
    proven: Result,
    elsewhere: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    FullDisk(monkeypatch, "result.json", folder=None, error=errno.ENOSPC)
    assert train(*QUICK, "hydra.run.dir=here") == 3
    captured = capfd.readouterr()
    assert captured.out.splitlines()[0] == "certified: circle, path following (PF)"
    assert captured.err.endswith(
        "here: cannot be written (No space left on device); certificate.json is there, result.json is not\n"
    )
    assert check_file(Path("here") / "certificate.json").outcome is Outcome.PROVEN


def test_a_folder_that_is_removed_meanwhile_is_made_again(
    train: Callable[..., int], proven: Result, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def search(*_: object) -> Result:
        shutil.rmtree("here")
        return proven

    monkeypatch.setattr(cfjax.synthesis, "search", search)
    assert train(*QUICK, "hydra.run.dir=here") == 0
    assert_complete(Path("here"), proven)


def test_the_same_command_goes_on_where_it_was_killed(
    train: Callable[..., int], searched: None, proven: Result, elsewhere: Path, tmp_path: Path
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    left = ("certificate.json", ".certificate.json.part", ".part-funnel.png", ".part-report.html", ".result.json.part")
    for name in (*left, "robustness.json", ".lock"):
        (here / name).write_text("half of")
    assert train(*QUICK, "hydra.run.dir=here") == 0
    assert_complete(here, proven)
    assert {entry.name for entry in here.iterdir()} == {*PROOF, ".hydra", ".lock", "result.json"}


def test_more_cars_than_memory_holds(
    train: Callable[..., int], searched: None, proven: Result, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train("+path=circle", *QUESTION, "hydra.run.dir=here", f"cars={4 * 10**9}") == 0
    assert_complete(Path("here"), proven)
    (said,) = warnings_of(capfd.readouterr().err)
    assert said.startswith("warning: the cars were not driven (")


def test_interrupt_while_cars_are_driven(
    train: Callable[..., int],
    searched: None,
    proven: Result,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(cfjax.synthesis, "drive_cars", Breaks(KeyboardInterrupt()))
    assert train("+path=circle", *QUESTION, "hydra.run.dir=here") == 130
    assert warnings_of(capfd.readouterr().err) == [f"interrupted; the run is complete: {Path('here').absolute()}"]
    assert_complete(Path("here"), proven)


@pytest.mark.parametrize(("error", "code"), [(MemoryError(), 0), (KeyboardInterrupt(), 130)], ids=["memory", "Ctrl-C"])
def test_picture_that_breaks(
    train: Callable[..., int],
    searched: None,
    proven: Result,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
) -> None:
    broken = Breaks(error)
    monkeypatch.setattr(cfjax.report.plot, "save_picture", broken)
    assert train("+path=circle", *QUESTION, "hydra.run.dir=here", "cars=10") == code
    assert broken.seen == {*PROOF, ".hydra", ".lock"}
    assert_complete(Path("here"), proven, driven=True)
    page = set() if code else {"report.html"}  # drawn by itself, where nobody interrupts
    assert {entry.name for entry in Path("here").iterdir()} == {*PROOF, ".hydra", ".lock", "result.json", *page}


def test_python_users_keep_the_result(
    searched: None, proven: Result, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cfjax.synthesis, "drive_cars", Breaks(MemoryError()))
    result = synthesize(proven.problem)
    assert (result.verdict, result.document, result.closed_loop) == (Verdict.CERTIFIED, proven.document, None)
    assert capfd.readouterr().err == "warning: the cars were not driven (MemoryError); the proof stands\n"


def test_only_cars_with_a_proof_are_driven(proven: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cfjax.synthesis, "drive_cars", Breaks(AssertionError("driven")))
    unproven = proven.replace(verdict=Verdict.INCONCLUSIVE)
    assert drive(unproven) is unproven
    config = preset("circle", [*QUESTION, "cars=0"])
    assert drive(proven, options_of(config)) is proven


@pytest.mark.parametrize(
    ("certified", "rounds"),
    [
        ([0.2, 0.2001, 0.9, 0.9], 2),  # no gain
        ([0.2, None, 0.9, 0.9], 2),  # a step back
        ([0.2, 0.201, 0.203, 0.206], 4),
        ([None, None, 0.2, 0.2], 4),  # nothing to lose as long as nothing is proven
        ([0.98, 2.0, 2.0, 2.0], 1),  # close enough to the falsifier's
    ],
)
def test_rounds_end_with_the_gain(
    monkeypatch: pytest.MonkeyPatch, hand_made: Callable[..., Result], certified: list[float | None], rounds: int
) -> None:
    """Margins against a falsified one of 1; a round that proves nothing has None."""
    problem = problem_of(preset("circle"))
    margins = iter(certified)

    def next_round(*_: object) -> tuple[Result, tuple]:
        margin = next(margins)
        verdict = Verdict.INCONCLUSIVE if margin is None else Verdict.CERTIFIED
        (segment,) = hand_made(problem, margin=margin).segments
        return Result(verdict, "made by hand", problem, (replace(segment, margin_falsified=1.0),)), ()

    learned = Learned((hand_made(problem).segments[0].funnel,), 1.0, -1.0, (1.0,), 1)
    monkeypatch.setattr(cfjax.synthesis.LearnCertifyLoop, "_learn", lambda *_: Found(problem, learned, "", {}))
    monkeypatch.setattr(cfjax.synthesis.LearnCertifyLoop, "_certify", next_round)
    result = search(problem, options_of(preset("circle", ["rounds=4"])))
    assert result.iterations == rounds
    assert result.margin_certified == max((m for m in certified[:rounds] if m), default=None)


def test_a_round_that_breaks_does_not_lose_an_earlier_proof(
    monkeypatch: pytest.MonkeyPatch, hand_made: Callable[..., Result], capfd: pytest.CaptureFixture[str]
) -> None:
    problem = problem_of(preset("circle"))
    (segment,) = hand_made(problem, margin=0.5).segments
    proven = Result(Verdict.CERTIFIED, "made by hand", problem, (replace(segment, margin_falsified=1.0),))
    rounds = iter([proven, MemoryError("too much")])

    def next_round(*_: object) -> Result:
        given = next(rounds)
        if isinstance(given, Exception):
            raise given
        return given

    monkeypatch.setattr(cfjax.synthesis.LearnCertifyLoop, "_round", next_round)
    result = search(problem, options_of(preset("circle")))
    assert (result.verdict, result.margin_certified, result.iterations) == (Verdict.CERTIFIED, 0.5, 1)
    assert "warning: round 2 failed (MemoryError: too much); an earlier proof stands" in capfd.readouterr().err
    monkeypatch.setattr(cfjax.synthesis.LearnCertifyLoop, "_round", Breaks(MemoryError()))
    with pytest.raises(MemoryError):  # nothing to save
        search(problem, options_of(preset("circle")))


def test_interrupt_after_a_proof_keeps_it(
    train: Callable[..., int],
    proven: Result,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Ctrl-C in the second round: what the first one has proven is written, and nothing that takes time is begun."""
    rounds = iter([proven.replace(segments=(replace(proven.segments[0], margin_falsified=1e3),))])

    def next_round(*_: object) -> Result:
        if (given := next(rounds, None)) is None:
            raise KeyboardInterrupt
        return given

    monkeypatch.setattr(cfjax.synthesis.LearnCertifyLoop, "_round", next_round)
    for name in ("drive_cars", "robustness_of"):
        monkeypatch.setattr(cfjax.synthesis, name, Breaks(AssertionError(name)))
    assert train("+path=circle", *QUESTION, "rounds=3", "robustness=true", "hydra.run.dir=here") == 130
    said = capfd.readouterr()
    assert warnings_of(said.err)[-1] == f"interrupted; an earlier round's proof is kept: {Path('here').absolute()}"
    assert said.out.splitlines()[-1].startswith("run: ") and said.out.startswith(
        "certified: circle, path following (PF)"
    )
    kept = read_run(Path("here"))
    assert (kept.verdict, kept.document, kept.closed_loop) == (Verdict.CERTIFIED, proven.document, None)
    assert kept.iterations == 1 and check_file(Path("here") / "certificate.json").outcome is Outcome.PROVEN
    with pytest.raises(KeyboardInterrupt):  # nothing to keep
        search(proven.problem, options_of(preset("circle", QUESTION)))
