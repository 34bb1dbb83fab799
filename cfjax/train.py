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
import sys
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from hydra.experimental.callback import Callback

from cfjax.job import question_of, run_job
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
                    Checks.question = question_of(config, Path(config.hydra.runtime.cwd))
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

    from cfjax.conf import help_text, hydra_overrides, one_line, preset_folder
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
            if given.help:
                print(help_text(overrides, given.config_dir and Path(given.config_dir)))
                return 0
        except (InputError, HydraException, OmegaConfBaseException) as error:
            return _refuse(one_line(error))
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
                built, Checks.question = Checks.question, None
                if (result := run_job(node, built)) is not None:
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
