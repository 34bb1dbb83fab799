"""Folders that cannot be had: no room, somebody else at work, no leave to write; and streams that nobody reads."""

import errno
import os
import shutil
import sys
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path

import pytest

import cfjax.report.run_folder
import cfjax.synthesis
import cfjax.train
from cfjax.report.resume import locked
from cfjax.streams import lasting_streams


Usage = namedtuple("Usage", "total used free")


def never(*_: object) -> None:
    raise AssertionError("searched")


@pytest.mark.parametrize("arguments", [("hydra.run.dir=a/b",), ("-m", "path.speed=1,2", "hydra.sweep.dir=a/b")])
def test_a_full_disk_is_seen_before_anything_is_done(
    train: Callable[..., int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
) -> None:
    monkeypatch.setattr(cfjax.synthesis, "search", never)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: Usage(200_000, 0, 120_000 if place == tmp_path else 10**9))
    assert train(*arguments) == 3
    key = arguments[-1].partition("=")[0]
    assert capfd.readouterr().err == f"error: {key}: a/b: expected at least 20 MB free, got 0.12 MB\n"
    assert list(tmp_path.iterdir()) == []


def test_a_second_run_into_a_folder_is_refused(
    train: Callable[..., int], quick: None, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "here").mkdir()
    with locked(tmp_path / "here", wait=False):
        assert train("hydra.run.dir=here") == 2
    message = "hydra.run.dir: expected a folder of its own, but another process is at work in here"
    assert capfd.readouterr().err == f"error: {message}\n"
    assert [entry.name for entry in (tmp_path / "here").iterdir()] == [".lock"]
    assert train("hydra.run.dir=here") == 1  # inconclusive, made by hand


def test_where_a_file_system_knows_no_locks_nobody_is_kept_out(
    train: Callable[..., int], quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", no_locks)
    assert train("hydra.run.dir=here") == 1


def test_a_sweep_goes_on_when_there_is_room_again(
    train: Callable[..., int], quick: None, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    write = cfjax.report.run_folder.write_whole

    def full(path: Path, content: bytes) -> None:
        if path.name == "result.json" and (path.parent.name == "1" or "cfjax-" in str(path)):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(path, content)

    sweep = ("-m", "+path=circle", "path.speed=1,2", "hydra.sweep.dir=sw")
    with monkeypatch.context() as context:
        context.setattr(cfjax.report.run_folder, "write_whole", full)
        assert train(*sweep) == 3
    error = capfd.readouterr().err
    assert "job 1: " in error and "sw/1: cannot be written (No space left on device)" in error
    assert "Traceback" not in error
    assert train(*sweep) == 0


def test_hydras_own_files_on_a_full_disk(
    train: Callable[..., int], quick: None, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "here/.hydra/config.yaml")

    monkeypatch.setattr("hydra.core.utils._save_config", full)
    assert train("hydra.run.dir=here") == 3
    message = "here/.hydra/config.yaml: cannot be written (No space left on device); the same command goes on"
    assert capfd.readouterr().err == f"error: {message}\n"


def test_nobody_needs_to_listen(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """A reader that left, as in `| head`, is not mentioned; a full disk is, once."""
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as broken, open("/dev/full", "w") as full:
        for stream in (broken, full):
            with monkeypatch.context() as context:
                context.setattr(sys, "stdout", stream)
                with lasting_streams():
                    print("one", flush=True)
                    print("two")
                stream.flush()  # as Python does at its end
    assert capfd.readouterr().err == "warning: stdout cannot be written (No space left on device)\n"


def test_a_run_whose_reader_left_ends_as_it_would(
    train: Callable[..., int], quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        monkeypatch.setattr(sys, "stderr", full)
        assert train("hydra.run.dir=here") == 1
    assert (Path("here") / "result.json").exists()


def test_a_cache_that_cannot_be_written_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    cfjax.train.prepare_environment()
    assert "JAX_COMPILATION_CACHE_DIR" not in os.environ
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "new"))
    cfjax.train.prepare_environment()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(tmp_path / "new" / "cfjax" / "jax")


def test_a_folder_of_hydras_that_cannot_be_made(
    train: Callable[..., int], quick: None, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train("hydra.run.dir=here", "hydra.output_subdir=/dev/null/x") == 2
    assert capfd.readouterr().err == "error: /dev/null/x: cannot be written (Not a directory)\n"


def test_who_logs_to_a_stream_does_not_close_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As absl's logging does, with streams that are not `sys.stderr` any more."""
    with (tmp_path / "log").open("w") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        with lasting_streams():
            sys.stderr.close()
            print("still there", file=sys.stderr)
    assert (tmp_path / "log").read_text() == "still there\n"
