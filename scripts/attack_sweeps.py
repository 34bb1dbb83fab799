"""The adversary of sweeps: kill -9 at random moments, the same command again, and nothing may be lost.

    python scripts/attack_sweeps.py [--kills 30] [--seed 0] [--folder FOLDER]

A small sweep of four jobs, two at a time by joblib, logged offline, runs once undisturbed. Then it runs in fresh
folders and is killed: the command with its workers, the command alone, whose workers live on, or one worker alone. The
same command follows, and is killed too, until one comes to its end.

Seen at every kill: each file that stands there is whole. Seen at every end: a job that was once finished has not run
again; results, certificates, paths and pictures are those of the undisturbed sweep; no draft is left; each job has one
log, which is whole. Exit code 0: all of it was so; 1 otherwise, and the folders are kept.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import polars as pl
import psutil
import yaml
from PIL import Image


JOBS = 4
COMMAND = [
    *(sys.executable, "-m", "cfjax.train", "-m", "+path=straight", "certificate=tube", "sets.inlet=0.1,0.2"),
    *("path.speed=1.5,2", "cars=0", "robustness=false", "logger=wandb"),
    *("hydra/launcher=joblib", "hydra.launcher.n_jobs=2"),
]
WHAT = ("command and workers", "command alone", "one worker")
HYDRAS = {".hydra", "multirun.yaml"}  # not written whole, but anew each time
SOONER = 0.7  # of the undisturbed sweep's time, which began with nothing compiled: when a kill comes at the latest
PATIENCE = 300.0  # s that a command may take, on a busy machine
GRACE = 30.0  # s in which a worker without command ends its job and itself
SAME = ("certificate.json", "reference.csv", "config.yaml", "funnel.png")  # byte for byte


class Lost(Exception):
    """What must not happen, happened."""


class Sweep:
    """A folder in which the command is given, killed and given again."""

    def __init__(self, place: Path) -> None:
        place.mkdir(parents=True)
        self.place = place
        self.finished: dict[str, bytes] = {}  # result.json of every job, as it was first seen
        self.begun_again = 0
        self.orphans: list[psutil.Process] = []  # workers whose command was killed

    @property
    def folder(self) -> Path | None:
        return next(iter(self.place.glob("multirun/*")), None)

    def start(self) -> "subprocess.Popen[bytes]":
        with (self.place / "output.txt").open("ab") as output:
            return subprocess.Popen(COMMAND, cwd=self.place, stdout=output, stderr=output, start_new_session=True)

    def look(self) -> None:
        """What stands there: finished jobs stay as they are, and all files are whole."""
        if self.folder is None:
            return
        for path in files(self.folder):
            if not HYDRAS & set(path.relative_to(self.folder).parts):
                see_whole(path)
        for job in (str(number) for number in range(JOBS)):
            result = self.folder / job / "result.json"
            if result.exists():
                if self.finished.setdefault(job, content := result.read_bytes()) != content:
                    raise Lost(f"{result}: a finished job ran again")
            elif job in self.finished:
                raise Lost(f"{result}: a finished job is gone")

    def open_jobs(self) -> int:
        """Jobs that were begun and have no result."""
        begun = self.folder.glob("[0-9]*/.lock") if self.folder else ()
        return sum(not (lock.parent / "result.json").exists() for lock in begun)

    def see_end(self, other: "Sweep | None") -> None:
        """A finished sweep, and the same as the other."""
        self.look()
        if self.folder is None or len(self.finished) != JOBS:
            raise Lost(f"{self.place}: {len(self.finished)} of {JOBS} jobs finished")
        for path in files(self.folder):
            see_whole(path)
        if drafts := [path for path in self.folder.rglob("*") if path.name.endswith(".part") or ".part-" in path.name]:
            raise Lost(f"{drafts[0]}: a draft is left")
        for job in self.finished:
            see_log(self.folder / job)
        if other is not None and other.folder is not None:
            for job in self.finished:
                if answer(self.folder / job) != answer(other.folder / job):
                    raise Lost(f"{self.folder / job}: another result than that of the undisturbed sweep")
                for name in SAME:
                    if (self.folder / job / name).read_bytes() != (other.folder / job / name).read_bytes():
                        raise Lost(f"{self.folder / job / name}: not as in the undisturbed sweep")
            if not table(self.folder).equals(table(other.folder)):
                raise Lost(f"{self.folder}: another table than that of the undisturbed sweep")


def files(folder: Path) -> Iterator[Path]:
    """All that a reader would open: no drafts, no locks, no logs."""
    for path in sorted(folder.rglob("*")):
        if path.suffix in CHECKS and not path.name.startswith(".") and "wandb" not in path.parts:
            yield path


def see_whole(path: Path) -> None:
    try:
        CHECKS[path.suffix](path)
    except FileNotFoundError:
        pass  # a worker that lives on begins its job anew
    except Exception as error:
        raise Lost(f"{path}: half-written ({type(error).__name__}: {error})") from error


def _see_html(path: Path) -> None:
    if not path.read_text("utf-8").rstrip().endswith("</html>"):
        raise ValueError("no end")


CHECKS = {
    ".json": lambda path: json.loads(path.read_text("utf-8")),
    ".yaml": lambda path: yaml.safe_load(path.read_text("utf-8")),
    ".csv": lambda path: pl.read_csv(path, infer_schema=False),
    ".png": lambda path: Image.open(path).load(),
    ".html": _see_html,
}


def see_log(job: Path) -> None:
    """One offline log, with its end."""
    logs = list(job.glob("wandb/offline-run-*/*.wandb"))
    if len(logs) != 1:
        raise Lost(f"{job}: expected one log, got {len(logs)}")
    line = [sys.executable, "-m", "wandb", "leet", "inspect", "--json", "--summary", str(logs[0])]
    status = json.loads(subprocess.run(line, capture_output=True, check=True, stdin=subprocess.DEVNULL).stdout)
    if (status["state"], status["exit_code"], status["summary"].get("verdict")) != ("finished", 0, "certified"):
        raise Lost(f"{logs[0]}: a log that is cut off")


def answer(job: Path) -> dict[str, Any]:
    """What the job found, without its times."""
    return {key: value for key, value in json.loads((job / "result.json").read_text()).items() if key != "seconds"}


def table(sweep: Path) -> pl.DataFrame:
    return pl.read_csv(sweep / "table.csv").drop("seconds")


def workers(command: psutil.Process) -> list[psutil.Process]:
    """The processes of joblib that run jobs."""
    found = []
    for process in command.children(recursive=True):
        with suppress(psutil.Error):
            if any("popen_loky" in word for word in process.cmdline()):
                found.append(process)
    return found


def kill(sweep: Sweep, process: "subprocess.Popen[bytes]", rng: random.Random) -> str:
    """Kill a running command in one of the three ways; says in which."""
    there = workers(psutil.Process(process.pid))
    what = rng.choice(WHAT if there else WHAT[:2])
    if what == WHAT[0]:
        os.killpg(process.pid, signal.SIGKILL)
    elif what == WHAT[1]:
        process.kill()
        sweep.orphans += there
    else:
        rng.choice(there).kill()
    return what


def left_alone(orphans: list[psutil.Process]) -> int:
    """Workers that are still there a while after their command was killed; they are ended."""
    _, alive = psutil.wait_procs(orphans, timeout=GRACE)
    for process in alive:
        with suppress(psutil.NoSuchProcess):
            process.kill()
    return len(alive)


def disturbed(sweep: Sweep, longest: float, rng: random.Random, kills: Counter[str]) -> None:
    """Give the command and kill it, until one ends before its moment has come."""
    while True:
        process = sweep.start()
        moment = time.monotonic() + rng.uniform(0.0, SOONER * longest)
        while time.monotonic() < moment and process.poll() is None:
            time.sleep(0.01)
        if process.poll() is None:
            what = kill(sweep, process, rng)
            ended = process.wait(PATIENCE)
            if what == WHAT[2] and ended == 0:
                what = "one worker, which was idle"
            kills[what] += 1
            sweep.look()
            sweep.begun_again += sweep.open_jobs()
            print(f"  killed: {what}; {len(sweep.finished)} jobs finished, {sweep.open_jobs()} open", flush=True)
            if ended != 0:
                continue
        if process.returncode != 0:
            raise Lost(f"{sweep.place}: the command ended with {process.returncode}; its output is in output.txt")
        return


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=30, help="at least so many (default 30)")
    parser.add_argument("--seed", type=int, default=0, help="of what is killed and when (default 0)")
    parser.add_argument("--folder", type=Path, help="an empty one to work in (default: a temporary one)")
    options = parser.parse_args()
    root = options.folder or Path(tempfile.mkdtemp(prefix="attack-sweeps-"))
    os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    rng, begin = random.Random(options.seed), time.monotonic()
    kills: Counter[str] = Counter()
    rounds = begun_again = alone = left = 0
    try:
        calm = Sweep(root / "undisturbed")
        if code := calm.start().wait(PATIENCE):
            raise Lost(f"{calm.place}: the undisturbed sweep ended with {code}; its output is in output.txt")
        longest = time.monotonic() - begin
        calm.see_end(None)
        print(f"undisturbed: {JOBS} jobs in {longest:.1f} s", flush=True)
        while kills.total() < options.kills:
            rounds += 1
            sweep = Sweep(root / f"round-{rounds}")
            disturbed(sweep, longest, rng, kills)
            sweep.see_end(calm)
            begun_again += sweep.begun_again
            alone += len(sweep.orphans)
            left += left_alone(sweep.orphans)
            print(f"sweep {rounds}: whole after {kills.total()} kills in all", flush=True)
    except Lost as error:
        print(f"LOST: {error}; seed {options.seed}, everything is kept in {root}", file=sys.stderr)
        return 1
    shutil.rmtree(root)
    ways = ", ".join(f"{count} {what}" for what, count in sorted(kills.items()))
    print(f"{kills.total()} kills ({ways}) of {rounds} sweeps, {time.monotonic() - begin:.0f} s")
    print(f"{rounds * JOBS} jobs, all finished; {begun_again} times one stood half-done and was taken on")
    print(f"{alone} workers lost their command; {left} of them did not end by themselves")
    print("nothing lost, no finished job ran again, no file half-written, all as in the undisturbed sweep")
    return 0


if __name__ == "__main__":
    sys.exit(main())
