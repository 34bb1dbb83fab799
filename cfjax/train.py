"""The main command: look for a certified funnel and write a run folder.

    python -m cfjax.train [+path=NAME] [group=choice] [key=value …]

Without a path it is the oval at 1 m/s.

Exit code: 0 certified; 1 not certified, the verdict says which; 2 bad configuration or input, one line on stderr;
3 the run could not be written (a full disk, say), and one line says where the proof is kept; 130 interrupted. A sweep
(-m) ends with 0 when every job ran to a verdict, 1 when one crashed, 2 when the input of one was bad, 3 when one could
not be written. The last line printed is `run: FOLDER`.

Nothing heavy is imported before `main` has set up the environment: JAX reads its flags once.
"""

import argparse
import atexit
import errno
import gc
import os
import shlex
import sys
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, ClassVar

from hydra.experimental.callback import Callback

from cfjax.streams import lasting_streams


if TYPE_CHECKING:
    from omegaconf import DictConfig

    from cfjax.conf import Config
    from cfjax.options import Options
    from cfjax.problem import Problem
    from cfjax.result import Result

CERTIFIED, NOT_CERTIFIED, BAD_INPUT, NOT_WRITTEN, INTERRUPTED = 0, 1, 2, 3, 130
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO)  # what a disk answers, whatever is written


class Refusal(BaseException):
    """Bad input or a full disk, seen before anything is made. Not an Exception: Hydra swallows those of callbacks."""

    def __init__(self, message: str, code: int = BAD_INPUT) -> None:
        super().__init__(message)
        self.code = code


class Checks(Callback):
    """Builds the problem before Hydra makes a folder, and remembers where a run or a sweep writes."""

    composed: ClassVar[bool] = False  # whatever goes wrong before that is the configuration's fault
    run: ClassVar[Path | None] = None
    sweep: ClassVar[Path | None] = None
    identity: ClassVar[dict[str, object]] = {}
    held: ClassVar[ExitStack] = ExitStack()  # the folder's lock
    question: "ClassVar[tuple[Config, Problem, Options] | None]" = None  # of a single run: built once

    def on_run_start(self, config: "DictConfig", **_: Any) -> None:
        from omegaconf.errors import OmegaConfBaseException

        from cfjax.conf import one_line
        from cfjax.errors import InputError
        from cfjax.progress import progress_on
        from cfjax.report.files import refuse_finished, require_room
        from cfjax.report.resume import locked

        Checks.composed = True
        with _refusals("hydra.run.dir"):
            try:
                folder = Path(config.hydra.run.dir)
                with progress_on() as clock, clock.stage("path"):
                    Checks.question = _question(config, Path(config.hydra.runtime.cwd))
            except OmegaConfBaseException as error:
                raise InputError(one_line(error)) from error
            refuse_finished(folder)
            require_room(folder)
            folder.mkdir(parents=True, exist_ok=True)
            Checks.held.enter_context(locked(folder, wait=False, label="hydra.run.dir"))
            refuse_finished(folder)  # by who held the lock until now
            Checks.run = folder.absolute()

    def on_multirun_start(self, config: "DictConfig", **_: Any) -> None:
        from cfjax.report.files import require_room
        from cfjax.report.resume import locked, open_sweep

        Checks.composed = True
        with _refusals("hydra.sweep.dir"):
            folder = Path(config.hydra.sweep.dir)
            require_room(folder)
            folder.mkdir(parents=True, exist_ok=True)
            Checks.held.enter_context(locked(folder, wait=False))
            open_sweep(folder, Checks.identity)
            Checks.sweep = folder


@contextmanager
def _refusals(label: str) -> Iterator[None]:
    """What stands against the folder at the key `label`, or against the question, as a Refusal."""
    from cfjax.errors import InputError, NotWritten

    try:
        yield
    except InputError as error:
        raise Refusal(str(error)) from error
    except NotWritten as error:
        raise Refusal(f"{label}: {error}", NOT_WRITTEN) from error
    except OSError as error:
        message = f"{label}: cannot write to {error.filename} ({error.strerror})"
        raise Refusal(message, NOT_WRITTEN if error.errno in FULL else BAD_INPUT) from error


def main() -> int:
    """Entry point; the arguments are those of the command line."""
    # Importing and tracing make hundreds of thousands of objects that stay: Python would look through them again and
    # again for what can go, a twentieth of a run.
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)  # nor does it at the end, where all of them go with the process
    prepare_environment()
    from cfjax.errors import Interrupted
    from cfjax.report.files import RESULT

    with lasting_streams():
        try:
            return _main()
        except Interrupted:
            print(f"interrupted; an earlier round's proof is kept: {Checks.run or Checks.sweep}", file=sys.stderr)
            return INTERRUPTED
        except KeyboardInterrupt:
            complete = Checks.run is not None and (Checks.run / RESULT).exists()
            print(f"interrupted; the run is complete: {Checks.run}" if complete else "interrupted", file=sys.stderr)
            return INTERRUPTED
        finally:
            Checks.held.close()


def prepare_environment() -> None:
    """Flags that JAX and Hydra read from the environment, and workers inherit; what the user has set stands."""
    import platformdirs

    cache = platformdirs.user_cache_path("cfjax") / "jax"
    with suppress(OSError):
        cache.mkdir(parents=True, exist_ok=True)
    if os.access(cache, os.W_OK):  # else programs are compiled anew, and nobody needs to hear of it
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache))
    os.environ["HYDRA_FULL_ERROR"] = "1"  # hands errors on to `_main` instead of printing them over many lines
    os.environ.setdefault("JAX_PLATFORMS", "cpu")  # small double-precision problems; silences the search for others
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # a local Ray reports to nobody


def _main() -> int:
    import hydra
    from hydra._internal.utils import get_args_parser
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from cfjax.conf import hydra_overrides, one_line, preset_folder
    from cfjax.errors import InputError, NotWritten
    from cfjax.report.resume import at_work, sweep_identity, sweep_name

    parser = get_args_parser()
    parser.exit_on_error = False
    try:
        given, unknown = parser.parse_known_intermixed_args()  # flags behind key=value too
    except argparse.ArgumentError as error:
        return _refuse(f"{error.argument_name}: expected as --help says, got {' '.join(sys.argv[1:])}")
    if unknown:
        return _refuse(f"expected key=value or a flag of --help, got {' '.join(unknown)}")
    if given.config_dir is not None and not Path(given.config_dir).is_dir():
        return _refuse(f"--config-dir: expected a folder, got {given.config_dir}")
    if not (given.shell_completion or given.experimental_rerun):  # which have no question or bring their own
        flags = _without(sys.argv[1:], given.overrides)
        try:
            overrides = hydra_overrides(given.overrides, sweep=given.multirun)
        except InputError as error:
            return _refuse(str(error))
        if given.multirun:
            Checks.identity = sweep_identity(overrides)
            if not any(override.startswith("hydra.sweep.dir=") for override in overrides):
                overrides.append(f"hydra.sweep.dir=multirun/{sweep_name(Checks.identity)}")
        sys.argv[1:] = [*flags, *overrides]
    results: list[Result] = []
    refusals: list[InputError | NotWritten] = []
    begun: list[bool] = []
    command = os.getpid()  # a job may run in a worker, which has another one

    @hydra.main(config_path=str(preset_folder()), config_name="train", version_base="1.3")
    def job(node: "DictConfig") -> None:
        begun.append(True)
        try:
            with at_work(command), lasting_streams():  # a worker may outlive who hears it
                if (result := run_job(node)) is not None:
                    results.append(result)
        except (InputError, NotWritten) as error:  # kept from Hydra, which would add lines of its own
            refusals.append(error)

    Checks.composed, Checks.run, Checks.sweep, Checks.question = False, None, None, None
    try:
        job()
    except Refusal as error:
        return _refuse(str(error), error.code)
    except (HydraException, OmegaConfBaseException) as error:
        _forget_sweep(Checks.sweep)
        return _refuse(one_line(error))
    except Exception as error:
        if not Checks.composed:
            return _refuse(one_line(error))
        if isinstance(error, OSError) and (error.errno in FULL or not (begun or Checks.sweep)):  # Hydra's own
            place = error.filename or Checks.sweep or Checks.run
            if error.errno not in FULL:
                return _refuse(f"{place}: cannot be written ({error.strerror})")
            return _refuse(f"{place}: cannot be written ({error.strerror}); the same command goes on", NOT_WRITTEN)
        if Checks.sweep is None:
            raise
        traceback.print_exc()  # a launcher that broke down: what the jobs left is still told
        _finish_sweep(Checks.sweep)
        print("the launcher broke down before all jobs had ended; the same command goes on", file=sys.stderr)
        return NOT_CERTIFIED
    if Checks.sweep is not None:
        return _finish_sweep(Checks.sweep)
    if refusals:
        return _refuse(str(refusals[0]), NOT_WRITTEN if isinstance(refusals[0], NotWritten) else BAD_INPUT)
    if not results:  # --help, --cfg and the like
        return 0
    return CERTIFIED if results[0].verdict.value == "certified" else NOT_CERTIFIED


def _without(arguments: list[str], others: list[str]) -> list[str]:
    """The arguments without the others, which stand among them in this order."""
    rest, kept = list(others), []
    for argument in arguments:
        if rest and argument == rest[0]:
            rest.pop(0)
        else:
            kept.append(argument)
    return kept


def run_job(node: "DictConfig") -> "Result | None":
    """One job in the folder that Hydra made for it. In a sweep an error is written there and stops no other job."""
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
        question, Checks.question = Checks.question or _question(node, Path(context.runtime.cwd)), None
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
    from cfjax.progress import progress_on
    from cfjax.report.files import refuse_finished
    from cfjax.report.run_folder import keep_elsewhere, write_run
    from cfjax.report.tracking import track
    from cfjax.synthesis import drive, harden, search

    refuse_finished(folder)
    points = file.read_bytes() if (file := waypoint_file(config)) else None  # now: a search takes its time
    told: list[str] = []
    stopped: Interrupted | None = None

    def tell(result: "Result") -> None:
        if (text := result.describe(options.objective)) not in told:
            print(text, flush=True)
            told.append(text)

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
                page=page,
                progress=clock,
            )
    except NotWritten as lost:
        try:
            result, elsewhere = keep_elsewhere(lost, folder, yaml_of(config), points)
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


def _question(node: "DictConfig", started_in: Path) -> "tuple[Config, Problem, Options]":
    """Typed configuration, problem and options; raises InputError where one of them cannot be."""
    from omegaconf import open_dict

    from cfjax.conf import command_vehicle, options_of, problem_of, typed, waypoint_file, with_waypoint_file
    from cfjax.question import check_question

    node = node.copy()
    with open_dict(node):
        node.pop("hydra", None)
    config = typed(node)
    if file := waypoint_file(config):
        config = with_waypoint_file(config, started_in / file)
    problem, options = problem_of(config, command_vehicle(config, started_in)), options_of(config)
    check_question(problem, options)
    return config, problem, options


def _finish_sweep(sweep: Path) -> int:
    from cfjax.report.files import UNWRITTEN
    from cfjax.report.page import write_index
    from cfjax.report.table import gather, print_table, write_table

    if not sweep.is_dir():
        return NOT_CERTIFIED
    rows = gather(sweep)
    print_table(rows)
    try:
        path, index = write_table(rows, sweep), write_index(sweep)
    except OSError as error:
        return _refuse(f"{sweep}: cannot be written ({error.strerror}); the same command goes on", NOT_WRITTEN)
    print(f"table: {path.resolve()}")
    print(f"index: {index.resolve()}")
    print(f"sweep: {sweep.resolve()}", flush=True)
    if all(row.has_verdict for row in rows):
        return 0
    if any(row.verdict == UNWRITTEN for row in rows):
        return NOT_WRITTEN
    return BAD_INPUT if all(row.has_verdict or row.verdict == "bad input" for row in rows) else NOT_CERTIFIED


def _forget_sweep(sweep: Path | None) -> None:
    """Remove the folder of a sweep that was refused before its first job: Hydra makes it before it looks at them."""
    if (
        sweep is None
        or not sweep.is_dir()
        or {entry.name for entry in sweep.iterdir()} - {"multirun.yaml", "sweep.json", ".lock"}
    ):
        return
    for name in ("multirun.yaml", "sweep.json", ".lock"):
        (sweep / name).unlink(missing_ok=True)
    with suppress(OSError):  # the folders above stay where they hold something else
        for folder in (sweep, *sweep.parents[:1]):
            folder.rmdir()


def _refuse(message: str, code: int = BAD_INPUT) -> int:
    print(f"error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    # under its own name, so that the workers of a sweep can import it
    from cfjax.train import main as entry_point

    sys.exit(entry_point())
