"""Weights & Biases: logger=wandb. Offline by default, without login; whatever goes wrong there, the run stands."""

import dataclasses
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cfjax.conf import Config, CustomConfig, one_line
from cfjax.report.files import CERTIFICATE, PICTURE, write_whole
from cfjax.report.result_json import result_json
from cfjax.report.run_folder import confirmed, read_run
from cfjax.result import Result


LOGGED = ".logged"  # in a run folder: its log is whole


def track(result: Result, config: Config, folder: Path, group: str | None = None) -> None:
    """Log a finished run: configuration, margins per round, figures, picture, and the certificate as artifact.

    `group` holds the jobs of a sweep together where wandb.group is not set.
    """
    _track(lambda: result, config, folder, group)


def track_again(config: Config, folder: Path, group: str | None = None) -> None:
    """Log a finished run from its folder, where that was not done: it was stopped meanwhile, or the logger failed.

    Not for a configuration that was read from a run's folder: a vehicle of the user's own is imported by its name.
    """
    target = config.vehicle.target if isinstance(config.vehicle, CustomConfig) else None
    if not (folder / LOGGED).exists():
        _track(lambda: confirmed(read_run(folder, target), folder), config, folder, group)


def _track(finished: Callable[[], Result], config: Config, folder: Path, group: str | None) -> None:
    try:
        for cut_off in folder.glob("wandb/*run-*"):
            shutil.rmtree(cut_off)
        with _staging_in(folder):
            _log(finished(), config, folder, group)
        write_whole(folder / LOGGED, b"")
    except Exception as error:
        print(f"warning: logger=wandb: {one_line(error)}; the run itself is complete", file=sys.stderr)


def _log(result: Result, config: Config, folder: Path, group: str | None) -> None:
    import wandb

    options = config.wandb
    if options.mode == "online" and not wandb.login(prompt=False):
        raise RuntimeError("wandb.mode=online needs an API key (wandb login); wandb.mode=offline does not")
    run = wandb.init(
        project=options.project,
        entity=options.entity,
        name=options.name,
        group=options.group or group,
        tags=options.tags,
        mode=options.mode,  # pyright: ignore[reportArgumentType]
        dir=str(folder),
        config=dataclasses.asdict(config),
        settings=wandb.Settings(console="off", silent=True),
    )
    finished = False
    try:
        for step, figures in enumerate(result.history):
            run.log(figures, step=step)
        summary = result_json(result)
        logged = ("verdict", "message", "margin", "seconds", "iterations", "search")  # search: counts, by learner
        run.summary.update({key: summary[key] for key in logged})
        if summary["closed_loop"]:
            run.summary.update({"closed_loop": summary["closed_loop"]})
        if (folder / PICTURE).exists():
            run.log({"funnel": wandb.Image(str(folder / PICTURE))}, step=len(result.history))
        if (folder / CERTIFICATE).exists():
            artifact = wandb.Artifact(f"certificate-{result.problem.path.name}", type="certificate")
            artifact.add_file(str(folder / CERTIFICATE))
            run.log_artifact(artifact)
        finished = True
    finally:
        run.finish(exit_code=0 if finished else 1)
        with suppress(Exception):
            wandb.teardown()


@contextmanager
def _staging_in(folder: Path) -> Iterator[None]:
    """Keep artifacts in the run folder while they are staged, not in the user's home; a user's own choice stands."""
    places = {"WANDB_DATA_DIR": folder / "wandb" / "data", "WANDB_CACHE_DIR": folder / "wandb" / "cache"}
    ours = {name: str(place) for name, place in places.items() if name not in os.environ}
    os.environ.update(ours)
    try:
        yield
    finally:
        for name in ours:
            os.environ.pop(name, None)
