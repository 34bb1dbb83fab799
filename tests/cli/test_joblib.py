"""The joblib launcher, with real worker processes: jobs that are refused at once."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest


def test_joblib_sweep_ends_with_its_table(
    command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    done = command("-m", "+path=circle", "path.radius=-1,-2", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    assert done.returncode == 2, done.stderr
    assert "path.radius: expected a positive finite number, got -2.0" in done.stdout
    (table,) = tmp_path.glob("multirun/*/table.csv")
    assert table.read_text().count("bad input") == 2
