"""The files of a run folder: what they are called, and how one is written whole and read.

Apart from what stands in them (`run_folder.py`), so that a command can look at a folder before it loads anything.
"""

import json
import os
import shutil
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

from cfjax.errors import InputError, NotWritten


T = TypeVar("T")

RESULT, CERTIFICATE, ROBUSTNESS, REFERENCE = "result.json", "certificate.json", "robustness.json", "reference.csv"
PICTURE, REPORT, CONFIG, WAYPOINTS = "funnel.png", "report.html", "config.yaml", "waypoints.csv"
COMMAND = ("python", "-m", "cfjax.train")  # what a run's command begins with; its overrides follow
ERROR = "error.json"  # in the folder of a job that reached no verdict
TABLE = "table.csv"  # of a sweep
UNWRITTEN = "not written"  # what such a job is called whose folder did not take its run
LEAST_ROOM = 20e6  # bytes that a run's folder may take: most of them for the page
PACKAGES = ("cfjax", "jax", "jaxlib", "numpy", "scipy", "optax", "cvxpy", "clarabel", "python-flint", "diffrax")


def refuse_finished(folder: Path) -> None:
    """Raises InputError where the folder already holds a complete run: nothing is written over."""
    if (folder / RESULT).exists():
        raise InputError(f"run folder: expected an empty one, but {folder} already holds a run")


def require_room(folder: Path) -> None:
    """Raises NotWritten where the disk has no room for a run in the folder, which need not be there yet."""
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.is_dir())
    total, _, free = shutil.disk_usage(there)
    if free < LEAST_ROOM and total:  # without a size it is none that counts its room
        raise NotWritten(f"{folder}: expected at least {LEAST_ROOM / 1e6:.0f} MB free, got {free / 1e6:.2g} MB")


def write_beside(picture: Callable[[T, Path], None], result: T, path: Path) -> None:
    """Have a picture or page written beside its place and put it there when it is whole."""
    draft = drawing_of(path)
    try:
        picture(result, draft)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file that is never seen half-written: beside its place, to disk, then renamed."""
    draft = draft_of(path)
    try:
        with draft.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def draft_of(path: Path) -> Path:
    """Where the content of a file lies until it is whole."""
    return path.with_name(f".{path.name}.part")


def drawing_of(path: Path) -> Path:
    """The same for a picture or page."""
    return path.with_name(f".part-{path.name}")  # keeps the suffix, which says what to draw


def write_error(folder: Path, kind: str, message: str) -> None:
    """Say in the job's folder why it reached no verdict: kind `bad input`, `not written` or `crashed`."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / ERROR, json.dumps({"kind": kind, "message": message}, indent=2).encode())


def holds_sweep(folder: Path) -> bool:
    """Whether jobs or the table of an earlier sweep stand there: their proofs must not answer for other questions."""
    if not folder.is_dir():
        return False
    return (folder / TABLE).exists() or any(entry.is_dir() and is_job(entry) for entry in folder.iterdir())


def is_job(folder: Path) -> bool:
    """Whether a job of a sweep was begun there."""
    return any((folder / name).exists() for name in (".hydra", RESULT, ERROR))


def versions() -> dict[str, str]:
    """Of Python and of the packages that decide what comes out."""
    found = {"python": ".".join(map(str, sys.version_info[:3]))}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def read_json(path: Path) -> dict[str, Any]:
    """An object from a JSON file; raises InputError with the file's name."""
    try:
        data = json.loads(read_text(path))
    except ValueError as error:
        raise InputError(f"{path}: expected JSON ({error})") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected a JSON object, got {type(data).__name__}")
    return data


def read_text(path: Path) -> str:
    """The content of a file; raises InputError with its name."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
