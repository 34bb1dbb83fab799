"""W&B: an offline run read back; a logger that fails costs nothing."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from cfjax.conf import preset, problem_of, yaml_of
from cfjax.report.files import CERTIFICATE, PICTURE
from cfjax.report.run_folder import write_run
from cfjax.report.tracking import track
from cfjax.result import Result


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty home of somebody who never logged in."""
    folder = tmp_path / "home"
    folder.mkdir()
    for name in [name for name in os.environ if name.startswith(("WANDB_", "XDG_"))]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(folder))
    return folder


def _run(folder: Path, hand_made: Callable[..., Result], *overrides: str) -> None:
    config = preset("circle", ["logger=wandb", *overrides])
    result = write_run(hand_made(problem_of(config)), folder, yaml_of(config))
    (folder / CERTIFICATE).write_text("{}")
    Image.new("RGB", (8, 4), "green").save(folder / PICTURE)
    track(result.replace(search={"counterexamples": 7}), config, folder, "a sweep")


def result_seconds(folder: Path) -> float:
    return json.loads((folder / "result.json").read_text())["seconds"]["total"]


def _inspect(log: Path, *options: str) -> str:
    command = [sys.executable, "-m", "wandb", "leet", "inspect", "--json", *options, str(log)]
    return subprocess.run(command, capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL).stdout


def test_offline_run_reads_back(hand_made: Callable[..., Result], home: Path, tmp_path: Path) -> None:
    _run(tmp_path / "run", hand_made)
    (log,) = (tmp_path / "run").glob("wandb/offline-run-*/*.wandb")
    data = json.loads(_inspect(log, "--summary"))
    assert (data["state"], data["exit_code"], data["project"]) == ("finished", 0, "cfjax")
    assert data["config"]["path"] == {
        "kind": "circle",
        "name": "circle",
        "laps": 1,
        "radius": 1.5,
        "speed": 1.5707963267948966,
    }
    assert data["summary"]["verdict"] == "inconclusive"
    assert data["summary"]["margin"] == {"certified": None, "falsified": 1 / 3}
    assert data["summary"]["closed_loop"]["missed_goal"] == 0
    assert data["summary"]["search"] == {"counterexamples": 7}
    assert data["summary"]["seconds"]["total"] == result_seconds(tmp_path / "run")
    records = [json.loads(line) for line in _inspect(log).splitlines()]
    history = [record["history"]["item"] for record in records if record["type"] == "history"]
    *rounds, last = history
    assert [item["falsified"] for item in rounds] == [0.25, 1 / 3]
    assert [item["certified"] for item in rounds] == [0, 0]
    assert [item["counterexamples"] for item in rounds] == [3, 0]
    assert last["funnel._type"] == "image-file"
    assert (log.parent / "files" / last["funnel.path"]).read_bytes() == (tmp_path / "run" / PICTURE).read_bytes()
    (artifact,) = (record["artifact"] for record in records if record["type"] == "artifact")
    assert (artifact["type"], artifact["manifest"]["contents"][0]["path"]) == ("certificate", CERTIFICATE)
    (run,) = (record["run"] for record in records if record["type"] == "run")
    assert run["run_group"] == "a sweep"
    assert list(home.iterdir()) == []  # staged in the run folder


def test_online_without_a_key_is_one_line(
    hand_made: Callable[..., Result], home: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    _run(tmp_path / "run", hand_made, "wandb.mode=online")
    error = capfd.readouterr().err
    assert error.startswith("warning: logger=wandb: wandb.mode=online needs an API key")
    assert error.count("\n") == 1
    assert (tmp_path / "run" / "result.json").exists()


def test_logger_that_breaks_costs_nothing(
    hand_made: Callable[..., Result],
    home: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)  # cannot be imported
    _run(tmp_path / "run", hand_made)
    assert "warning: logger=wandb: " in capfd.readouterr().err
    assert (tmp_path / "run" / "result.json").exists()
