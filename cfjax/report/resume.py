"""A sweep that was stopped goes on with the same command: its name, its locks, and which of its jobs are done.

A sweep's folder is named by what was asked: the overrides, the content of files that they name, and the versions of
the packages. A job is done where its folder holds a complete run of the same resolved configuration.
"""

import errno
import fcntl
import functools
import hashlib
import json
import os
import re
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import current_process
from pathlib import Path

from cfjax.conf import values_of
from cfjax.errors import InputError
from cfjax.report.files import CONFIG, RESULT, WAYPOINTS, holds_sweep, read_json, versions, write_whole


SWEEP = "sweep.json"  # in a sweep's folder: what it asks
LOCK = ".lock"
AT_WORK = threading.Lock()  # held while this process is busy with a job


def sweep_identity(overrides: Sequence[str]) -> dict[str, object]:
    """What decides the results of a sweep; how jobs are launched (hydra's own keys) does not."""
    given = [override for override in overrides if not re.match(r"[+~]*hydra[./]", override)]
    files = {
        value: hashlib.sha256(Path(value).read_bytes()).hexdigest()
        for override in given
        for value in values_of(override)
        if value and Path(value).is_file()
    }
    return {"overrides": given, "files": files, "versions": versions()}


def sweep_name(identity: dict[str, object]) -> str:
    """The folder's name: twelve digits of the identity's hash."""
    return _digest(identity)[:12]


def open_sweep(folder: Path, identity: dict[str, object]) -> None:
    """Write down what the sweep asks, or see that it is what stands there.

    Raises:
        InputError: where the folder holds a sweep that asks something else.
    """
    path = folder / SWEEP
    if path.exists():
        if read_json(path) != json.loads(json.dumps(identity)):
            raise InputError(f"hydra.sweep.dir: expected an empty folder, but {folder} already holds a sweep")
    elif holds_sweep(folder):
        raise InputError(f"hydra.sweep.dir: expected an empty folder, but {folder} already holds a sweep")
    else:
        write_whole(path, (json.dumps(identity, indent=2) + "\n").encode())


@contextmanager
def locked(folder: Path, *, wait: bool, label: str = "hydra.sweep.dir") -> Iterator[None]:
    """Nobody else works in the folder. The system takes the lock back from a process that is killed.

    Where the file system knows no locks, nobody is kept out.

    Raises:
        InputError: where somebody does, and `wait` is false; it is about the key `label`.
    """
    with (folder / LOCK).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            message = f"{label}: expected a folder of its own, but another process is at work in {folder}"
            raise InputError(message) from None
        except OSError as error:
            if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS):
                raise
        yield


@contextmanager
def at_work(command: int) -> Iterator[None]:
    """A job of the command with this process id, maybe in a worker's process.

    A worker of joblib whose command was killed ends after its job: by itself it would wait for another one for ever.
    """
    if current_process().name.startswith("LokyProcess"):  # joblib's
        _end_after(command)
    with AT_WORK:
        yield


@functools.cache
def _end_after(command: int) -> None:
    def watch() -> None:
        while os.getppid() == command or not AT_WORK.acquire(blocking=False):
            time.sleep(1.0)
        os._exit(0)  # nobody is left to hear of it

    threading.Thread(target=watch, daemon=True).start()


def is_done(folder: Path, config_yaml: str, points: bytes | None) -> bool:
    """Whether a complete run of this configuration, by these versions, stands in the folder.

    Raises:
        InputError: where the run that stands there answers another question.
    """
    if not (folder / RESULT).exists():
        return False
    there = (folder / WAYPOINTS).read_bytes() if (folder / WAYPOINTS).exists() else None
    versions_there = read_json(folder / RESULT).get("versions")
    same = job_hash(config_yaml, points, versions()) == job_hash(
        (folder / CONFIG).read_text(encoding="utf-8"), there, versions_there
    )
    if not same:
        raise InputError(f"job folder: expected a run of the same configuration, but {folder} holds another one")
    return True


def job_hash(config_yaml: str, points: bytes | None, by: object) -> str:
    """Of a resolved configuration, the points that it speaks of, and the versions that answer it."""
    return _digest([config_yaml, None if points is None else hashlib.sha256(points).hexdigest(), by])


def _digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
