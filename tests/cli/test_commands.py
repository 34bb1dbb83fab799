"""One command for all of them, and `follow` for points of one's own."""

import json
import sys
from pathlib import Path

import pytest

import cfjax.tubes.__main__
from cfcheck.replay import check_file
from cfjax.__main__ import COMMANDS, main


TRACK = Path(__file__).parents[2] / "experiments" / "track.csv"


def cfjax_(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["cfjax", *arguments])
    return main()


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - {"train"}))  # whose own help tests/cli/test_start.py reads
def test_each_command_has_its_help(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as stop:
        cfjax_(monkeypatch, name, "--help")
    assert stop.value.code == 0
    assert "usage:" in capsys.readouterr().out


def test_all_commands_are_listed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    assert cfjax_(monkeypatch, "--help") == 0
    assert cfjax_(monkeypatch) == 2
    lines = capsys.readouterr().out.splitlines()
    for name, (_, what) in COMMANDS.items():
        assert sum(line.split() == [name, *what.split()] for line in lines) == 2


def test_a_mistyped_command_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    assert cfjax_(monkeypatch, "chek") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "got chek; did you mean check?" in line
    assert cfjax_(monkeypatch, "xyz") == 2
    assert "did you mean" not in capsys.readouterr().err


def test_the_exit_code_is_the_commands_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert cfjax_(monkeypatch, "check", str(tmp_path)) == 2
    assert cfjax_(monkeypatch, "follow", str(TRACK), "--certificate", str(tmp_path / "chain.json")) == 0
    assert cfjax_(monkeypatch, "check", str(tmp_path / "chain.json")) == 0


def test_points_are_followed(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    file = tmp_path / "proof.json"
    assert cfjax.tubes.__main__.main([str(TRACK), "--speed", "1.5", "--certificate", str(file)]) == 0
    source, path, *_, last, where = capsys.readouterr().out.splitlines()
    assert "48 points" in source
    assert "82.2473 m, closed" in path
    assert last == "  holds for ever"
    assert where == f"certificate: {file}"
    assert check_file(file).outcome.value == 0
    assert json.loads(file.read_text())["problem"]["sets"]["inlet"] is None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.csv"], "there is no such file"),
        ([str(TRACK), "--speed", "-1"], "path.speed"),
        ([str(TRACK), "--certificate", "no/folder/proof.json"], "no/folder/proof.json"),
    ],
    ids=["no file", "no speed", "no folder"],
)
def test_bad_input_is_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture) -> None:
    assert cfjax.tubes.__main__.main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert said in line
