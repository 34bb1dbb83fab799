"""One job of a command: from a configuration to a run folder, and what is said of it.

Nothing heavy is imported with it: the command has to set up the environment first.
"""

import shlex
import sys
import traceback
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from omegaconf import DictConfig

    from cfjax.conf import Config
    from cfjax.options import Options
    from cfjax.problem import Problem
    from cfjax.result import Result


def run_job(node: "DictConfig", built: "tuple[Config, Problem, Options] | None" = None) -> "Result | None":
    """One job in the folder that Hydra made for it; `built` is its question where there is one already.

    In a sweep an error is written there and stops no other job.
    """
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    import cfjax.conf
    from cfjax.errors import InputError, NotWritten
    from cfjax.report.files import COMMAND, ERROR, UNWRITTEN, require_room, write_error
    from cfjax.report.own_vehicle import is_proven_of
    from cfjax.report.resume import is_done, locked
    from cfjax.report.tracking import track_again

    context = HydraConfig.get()
    folder = Path(context.runtime.output_dir)
    group = folder.parent.name  # where a sweep is logged
    try:
        question = built or question_of(node, Path(context.runtime.cwd))
        given = context.overrides.task if context.mode == RunMode.MULTIRUN else sys.argv[1:]
        command = shlex.join([*COMMAND, *given])
        if context.mode != RunMode.MULTIRUN:
            return run(*question, folder, command)
        with locked(folder, wait=True):  # a worker may outlive the command that was killed
            config = question[0]
            points = file.read_bytes() if (file := cfjax.conf.waypoint_file(config)) else None
            done = is_done(folder, cfjax.conf.yaml_of(config), points) and is_proven_of(folder, config, question[1])
            (folder / ERROR).unlink(missing_ok=True)
            if done:
                print(f"job {folder.name}: done already", flush=True)
                if config.logger == "wandb":
                    track_again(config, folder, group)
                return None
            require_room(folder)
            return run(*question, folder, command, group)
    except Exception as error:
        if context.mode != RunMode.MULTIRUN:
            raise
        known: dict[type, str] = {InputError: "bad input", NotWritten: UNWRITTEN}
        if type(error) not in known:
            traceback.print_exc()
        message = cfjax.conf.one_line(error)
        print(f"job {folder.name}: {message}", file=sys.stderr)
        with suppress(OSError):  # then the job has no verdict either
            write_error(folder, known.get(type(error), "crashed"), message)
        return None


def run(
    config: "Config",
    problem: "Problem",
    options: "Options",
    folder: Path,
    command: str | None = None,
    group: str | None = None,
) -> "Result":
    """Search, write the run folder, log, and say what came out. Cars are driven when the proof is safe on disk.

    The verdict is told before pictures are drawn, where the folder takes the proof.

    `command` made the run, and is kept with it. `group` gathers the jobs of a sweep where they are logged, unless
    wandb.group says another one.

    Raises:
        NotWritten: where the folder does not take it; what came out is said, and kept elsewhere where that is possible.
        Interrupted: when what an earlier round has proven is written.
    """
    from cfjax.conf import waypoint_file, yaml_of
    from cfjax.errors import Interrupted, NotWritten
    from cfjax.problem import Frame
    from cfjax.progress import progress_on
    from cfjax.report.files import refuse_finished
    from cfjax.report.run_folder import RequiredPeriod, keep_elsewhere, write_run
    from cfjax.report.tracking import track
    from cfjax.synthesis import drive, harden, search

    refuse_finished(folder)
    points = file.read_bytes() if (file := waypoint_file(config)) else None  # now: a search takes its time
    required = None
    if config.period is not None:
        required = RequiredPeriod(config.period, config.delay, yaml_of(replace(config, period=None, delay=None)))
    printed: list[str] = []
    frame = Frame(config.frame)
    stopped: Interrupted | None = None

    def tell(result: "Result") -> None:
        if (text := result.describe(options.objective)) not in printed:
            print(text, flush=True)
            printed.append(text)

    def driven(proven: "Result") -> "Result":
        Thread(target=_import_pictures).start()  # while cars are driven Python is idle
        result = proven if stopped else drive(proven, options, clock)
        tell(result)  # what is left, pictures, takes its time
        return result

    def picture(result: "Result", path: Path) -> None:
        from cfjax.report.plot import save_picture

        save_picture(result, path)

    def page(result: "Result", path: Path) -> None:
        from cfjax.report.page import save_page

        save_page(result, path)

    if problem.path.source:
        print(problem.path.source, flush=True)
    try:
        with progress_on() as clock:
            try:
                result = search(problem, options, clock).replace(command=command)
            except Interrupted as stop:  # who waits no longer gets the proof, and nothing that takes time
                stopped, result = stop, stop.result.replace(command=command)
            result = write_run(
                result,
                folder,
                yaml_of(config),
                picture,
                harden=(lambda proven: harden(proven, options, clock)) if options.robustness and not stopped else None,
                drive=driven,
                points=points,
                frame=frame,
                page=page,
                progress=clock,
                required=required,
            )
    except NotWritten as lost:
        try:
            result, elsewhere = keep_elsewhere(lost, folder, yaml_of(config), points, frame, required)
        except NotWritten as nowhere:
            tell(nowhere.result)
            raise
        tell(result)
        print(f"run: {elsewhere}", flush=True)
        raise NotWritten(f"{lost}; what came out is kept in {elsewhere}") from lost
    if config.logger == "wandb":
        track(result, config, folder, group)
    print("seconds: " + ", ".join(f"{stage} {value:.1f}" for stage, value in result.seconds.items()))
    print(f"run: {folder}", flush=True)
    if stopped:
        raise stopped
    return result


def _import_pictures() -> None:
    with suppress(Exception):  # who draws says what is missing
        import_module("cfjax.report.plot")


def question_of(node: "DictConfig", started_in: Path) -> "tuple[Config, Problem, Options]":
    """Typed configuration, problem and options; raises InputError where one of them cannot be."""
    from omegaconf import open_dict

    from cfjax.conf import (
        command_vehicle,
        options_of,
        problem_of,
        typed,
        waypoint_file,
        with_own_map,
        with_waypoint_file,
    )
    from cfjax.question import check_question

    node = node.copy()
    with open_dict(node):
        node.pop("hydra", None)
    config = typed(node)
    if file := waypoint_file(config):
        config = with_waypoint_file(config, started_in / file)
    config = with_own_map(config, started_in)
    problem, options = problem_of(config, command_vehicle(config, started_in)), options_of(config)
    check_question(problem, options)
    return config, problem, options
