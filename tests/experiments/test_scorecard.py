"""Benchmarks run, and a figure that grows is seen."""

import sys
from pathlib import Path

import pytest


SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SCRIPTS))


@pytest.mark.usefixtures("scripts")
def test_what_grows_by_more_than_a_tenth_needs_a_reason() -> None:
    from scorecard import COLUMNS, worse

    before = [dict.fromkeys(COLUMNS, "") | {"help": "10", "lines": "100"}, dict.fromkeys(COLUMNS, "") | {"help": "20"}]
    row = dict.fromkeys(COLUMNS, "") | {"help": "22.5", "lines": "110", "check": "9"}
    assert worse(row, before) == ["help 20 -> 22.5"]
    assert worse(row | {"help": "21"}, before) == []
    assert worse(row | {"lines": "111"}, before[:1]) == ["help 10 -> 22.5", "lines 100 -> 111"]


@pytest.mark.usefixtures("scripts")
def test_lines_are_counted_room_by_room() -> None:
    from scorecard import lines_by_room

    found = lines_by_room()
    files = (Path(__file__).parents[2] / "cfjax" / "solver").glob("*.py")
    assert found["solver"] == sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)
    assert {"cfcheck", "cfjax", "tests"} <= found.keys()


@pytest.mark.usefixtures("scripts")
def test_a_job_is_measured(tmp_path: Path) -> None:
    from benchmark import HERE, JOBS, Side

    figures = Side("here", HERE, tmp_path).measure(JOBS["typo"], 0)
    assert figures["processors"] > 0
    assert 0 < figures[""] < 600
    assert 10 < figures["peak memory"] < 1e5


def compare(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    import benchmark_solver

    monkeypatch.setattr(sys, "argv", ["", *arguments])
    assert benchmark_solver.main() == 0


@pytest.mark.usefixtures("scripts")
def test_solvers_are_compared(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path) -> None:
    """Row by row, into a file too, from which the picture is drawn."""
    picture, table = tmp_path / "throughput.png", tmp_path / "table.md"
    asked = ["--sizes", "70", "--stacks", "1", "2", "--table", str(table)]
    compare(monkeypatch, *asked, "--solvers", "clarabel", "batched")
    printed = capsys.readouterr().out
    assert table.read_text() == printed
    rows = [line.strip("| ").split(" | ") for line in printed.splitlines()[2:]]
    assert [(row[:2], row[-1]) for row in rows] == [(["70", "clarabel"], "0"), (["70", "batched"], "0")]
    assert all(float(rate) > 0 for row in rows for rate in row[2:-1])
    compare(monkeypatch, *asked, "--solvers", "batched", "--limit", "0.01", "--picture", str(picture))
    out, said = capsys.readouterr()
    assert out == "" and "U = 70, batched: no answer within 0.01 s" in said
    assert picture.stat().st_size > 1000
