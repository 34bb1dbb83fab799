"""The run folder: what a run leaves behind, and how it is read back.

    certificate.json   the proof, where there is one
    robustness.json    what its funnels absorb, with hints for the proof
    reference.csv      samples of the path
    funnel.png         the picture
    report.html        the page that shows all of it
    config.yaml        the question as it was configured
    waypoints.csv      the points that it speaks of, where the path goes through points of a file
    result.json        verdict and figures; written last: a folder that has it is complete
    without-period/    a run of its own: the proven funnel, where the period that is asked of it is not proven

Every file appears whole or not at all. `certified` is written only after the exact checker has accepted the
certificate as it lies on disk. The proof lies there before anything that it does not need is begun: cars, picture.
"""

import csv
import dataclasses
import io
import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cfcheck import Outcome, Report, check_file
from cfcheck.exact.rational import float_below
from cfcheck.replay import WITHOUT_PERIOD
from cfjax.certificate.absorbed import held_to, with_amounts
from cfjax.certificate.robustness import Hints
from cfjax.certificate.writing import dump
from cfjax.clock import Clock
from cfjax.errors import InputError, NotWritten
from cfjax.options import Progress
from cfjax.problem import Frame, Problem
from cfjax.report.files import (
    CERTIFICATE,
    CONFIG,
    PICTURE,
    REFERENCE,
    REPORT,
    RESULT,
    ROBUSTNESS,
    WAYPOINTS,
    draft_of,
    drawing_of,
    read_json,
    read_text,
    refuse_finished,
    write_beside,
    write_whole,
)
from cfjax.report.result_json import result_json, result_of
from cfjax.result import Result
from cfjax.verdict import Verdict


if TYPE_CHECKING:
    from cfjax.conf import Config

REFERENCE_ROWS = 201  # per segment

Check = Callable[[Path], Report]


@dataclasses.dataclass(frozen=True)
class RequiredPeriod:
    """What a run has to prove beside a funnel: period and delay (s); and the configuration that does not ask for it."""

    period: float
    delay: float | None
    config_yaml: str


PROVES = {Verdict.CERTIFIED: Outcome.PROVEN, Verdict.REFUTED: Outcome.REFUTED}


def write_run(
    result: Result,
    folder: Path,
    config_yaml: str,
    picture: Callable[[Result, Path], None] | None = None,
    *,
    check: Check = check_file,
    harden: Callable[[Result], Hints] | None = None,
    drive: Callable[[Result], Result] | None = None,
    points: bytes | None = None,
    frame: Frame = Frame.PAPER,
    page: Callable[[Result, Path], None] | None = None,
    progress: Progress | None = None,
    required: RequiredPeriod | None = None,
) -> Result:
    """Write all files of a run into `folder` and return the result as it was written.

    `points` is the content of the waypoint file, where the path is made of one. `frame` is that of reference.csv.

    A result whose certificate the checker does not accept comes back `inconclusive`, and so does one that does not
    prove what is `asked`: what it proves goes to a folder of its own in this one. `harden` finds hints for what the
    funnels absorb, of which nothing is claimed but what the checker shows. `drive` adds the closed loop to the result
    as it then stands, `picture` draws funnel.png of it and `page` writes report.html; if one of these fails, it is said
    on stderr and the run stands. Whatever else stops one of them, Ctrl-C included, result.json is written before it
    goes on. `progress` hears of the stages.

    Raises:
        NotWritten: where the disk is full, or the folder is gone or may not be written; with the result as it stands.
    """
    refuse_finished(folder)
    begin, before = time.perf_counter(), result.seconds.get("total", 0.0)
    clock = Clock.of(progress, {stage: value for stage, value in result.seconds.items() if stage != "total"})

    def timed(result: Result) -> Result:
        """Total, as it is so far, stays behind all stages."""
        others = {name: value for name, value in result.seconds.items() if name not in {*clock.seconds, "total"}}
        total = before + time.perf_counter() - begin
        return result.replace(seconds={**clock.seconds, **others, "total": total})

    again = partial(write_run, check=check, points=points, frame=frame)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _clear(folder)
        with clock.stage("check") if result.document is not None else nullcontext():
            result = _write_certificate(result, folder / CERTIFICATE, check)
        if result.problem.path.curve:  # a tube has none
            write_whole(folder / REFERENCE, reference_csv(result.problem, frame).encode())
        write_whole(folder / CONFIG, config_yaml.encode())
        if points is not None:
            write_whole(folder / WAYPOINTS, points)
        try:
            why = "the search was interrupted"
            try:
                if harden is not None and result.verdict is Verdict.CERTIFIED:
                    with clock.stage("robustness"):
                        result, why = _write_robustness(result, folder, harden, check)
            finally:
                if required is not None:
                    # nothing is claimed from here on: whatever stops the writing, the run is not certified
                    proven, result = result, held_to(result, required.period, required.delay, why)
                    if result is not proven:
                        _write_without_period(required, proven, folder, again)
                        message = f"{result.message}; what is proven stands in the folder {WITHOUT_PERIOD}"
                        result = result.replace(message=message)
            if drive is not None:
                result = drive(result)
            if picture is not None:
                with clock.stage("plot"):
                    _draw(picture, result, folder / PICTURE)
            if page is not None:
                with clock.stage("report"):
                    _draw(page, timed(result), folder / REPORT)  # with the seconds that it can know
        finally:
            result = timed(result)
            write_whole(folder / RESULT, (json.dumps(result_json(result), indent=2, allow_nan=False) + "\n").encode())
    except OSError as error:
        raise NotWritten(f"{folder}: cannot be written ({error.strerror or error})", result) from error
    return result


def _clear(folder: Path) -> None:
    """Removes what a run that was killed has left."""
    for place in (folder, folder / WITHOUT_PERIOD):
        for leftover in (RESULT, CERTIFICATE, ROBUSTNESS, REFERENCE, PICTURE, REPORT, CONFIG, WAYPOINTS):
            for path in (place / leftover, draft_of(place / leftover), drawing_of(place / leftover)):
                path.unlink(missing_ok=True)


def _write_without_period(required: RequiredPeriod, proven: Result, folder: Path, again: Callable[..., Result]) -> None:
    """A run of its own from what is proven, but not as asked; nothing in the folder itself claims it any more.

    `again` writes a run as this one is written.
    """
    try:
        hints = Hints(read_json(folder / ROBUSTNESS)) if proven.robustness else None
        less = proven.replace(robustness=None, command=None)
        again(less, folder / WITHOUT_PERIOD, required.config_yaml, harden=hints and (lambda _: hints))
    finally:
        for name in (CERTIFICATE, ROBUSTNESS):
            (folder / name).unlink(missing_ok=True)


def keep_elsewhere(
    lost: NotWritten,
    folder: Path,
    config_yaml: str,
    points: bytes | None = None,
    frame: Frame = Frame.PAPER,
    required: RequiredPeriod | None = None,
) -> tuple[Result, Path]:
    """The run that `folder` did not take, in a new folder where the system has room: without picture, page and cars.

    Raises:
        NotWritten: where there is none either. Its result claims nothing, unless the proof lies in `folder`.
    """
    result: Result = lost.result
    hints = None
    with suppress(InputError):
        hints = read_json(folder / ROBUSTNESS)
    try:
        elsewhere = Path(tempfile.mkdtemp(prefix="cfjax-"))
        again = (lambda _: Hints(hints)) if hints else None
        return write_run(
            result.replace(robustness=None),
            elsewhere,
            config_yaml,
            harden=again,
            points=points,
            frame=frame,
            required=required,
        ), elsewhere
    except (OSError, NotWritten):
        pass
    with suppress(OSError, InputError):
        if result.document is not None and (folder / CERTIFICATE).read_bytes() == dump(result.document).encode():
            proven = as_proven(result, lambda: check_file(folder), str(folder / RESULT))
            if required is not None:
                proven = held_to(proven, required.period, required.delay)
            raise NotWritten(f"{lost}; {CERTIFICATE} is there, {RESULT} is not", proven)
    if result.verdict in PROVES:
        message = "a proof that was found could be written nowhere, so that nothing is certified"
        result = result.without_claim(Verdict.INCONCLUSIVE, message).replace(closed_loop=None, robustness=None)
    raise NotWritten(str(lost), result)


def _write_certificate(result: Result, path: Path, check: Check) -> Result:
    """The certificate on disk, accepted by the checker, with the margins that it proves; or a result without claims."""
    if result.verdict not in PROVES:
        return result.without_claim(result.verdict, result.message)
    if result.document is None:
        return result.without_claim(Verdict.INCONCLUSIVE, "there is no certificate to check, so nothing is proven")
    write_whole(path, dump(result.document).encode())
    try:
        report = check(path)
        if report.outcome is PROVES[result.verdict]:
            result = result.replace(account=report.paragraphs)
            return _with_margins(result, report) if result.verdict is Verdict.CERTIFIED else result
        reason = report.message
    except Exception as error:  # the checker is the judge: whatever stops it, nothing is proven
        reason = f"{type(error).__name__}: {error}"
    path.unlink()
    claim = f"the exact checker did not accept the certificate of a {result.verdict.value} run"
    result = result.replace(closed_loop=None)  # driven under a margin that nothing proves
    return result.without_claim(Verdict.INCONCLUSIVE, f"{claim}: {' '.join(reason.split())}")


def confirmed(result: Result, folder: Path, check: Check = check_file) -> Result:
    """A result that was read from a run folder, with claims that its certificate proves: the checker's own, not read.

    Raises:
        InputError: where the checker does not accept what the result claims, or what config.yaml asks is not proven.
    """
    proven, config = as_proven(result, lambda: check(folder), str(folder / RESULT)), read_config(folder)
    if held_to(proven, config.period, config.delay) is not proven:
        required = f"period={config.period:g}" + (f" and delay={config.delay:g}" if config.delay else "")
        raise InputError(f"{folder / ROBUSTNESS}: expected a proof of {required}, which {CONFIG} asks for")
    return proven


def as_proven(result: Result, ask: Callable[[], Report], name: str) -> Result:
    """The result called `name`, with claims that the checker's answer bears: its own, not those that were given.

    `ask` has the certificate checked, where the result claims something.

    Raises:
        InputError: where the checker does not accept what the result claims.
    """
    if result.verdict not in PROVES:
        return result.without_claim(result.verdict, result.message).replace(robustness=None)
    report = ask()
    wanted = PROVES[result.verdict]
    if report.outcome is not wanted or (wanted is Outcome.PROVEN and len(report.margins) != len(result.segments)):
        raise InputError(
            f"{name}: expected what the certificate proves, got {result.verdict.value}, "
            f"which the exact checker does not accept: {report.message}"
        )
    result = result.replace(message=report.message, account=report.paragraphs, robustness=None)
    if wanted is Outcome.REFUTED:
        return result
    return with_amounts(_with_margins(result, report), report)


def _write_robustness(
    result: Result, folder: Path, harden: Callable[[Result], Hints], check: Check
) -> tuple[Result, str]:
    """The result with what its funnels absorb, as the checker shows it from the folder; and what it lacks, why."""
    lack = ""
    try:
        hints = harden(result)
        lack = hints.lack
        for content in filter(None, (hints.whole, hints.file)):
            write_whole(folder / ROBUSTNESS, dump(content).encode())
            report = check(folder)
            if report.outcome is Outcome.PROVEN and report.robustness is not None:
                return with_amounts(result, report).replace(account=report.paragraphs), lack
            lack = lack or report.message
        if hints.file is None:
            return result, lack
    except Exception as error:  # the certificate stands without it
        lack = f"{type(error).__name__}: {error}"
    (folder / ROBUSTNESS).unlink(missing_ok=True)
    lack = " ".join(lack.split())
    print(f"warning: nothing is proven of what the funnel absorbs: {lack}", file=sys.stderr)
    return result, lack


def _with_margins(result: Result, report: Report) -> Result:
    """The margins that the checker proved, rounded down."""
    segments = zip(result.segments, report.margins, strict=True)
    per_metre = None if report.margin_per_metre is None else float_below(report.margin_per_metre)
    way = None if report.contraction is None else -float_below(-report.contraction)
    return result.replace(
        segments=tuple(
            dataclasses.replace(
                segment,
                margin_certified=float_below(margin),
                # the tubes that hold a path have one each: of their own certificates, which were replayed too
                margin_per_metre=segment.margin_per_metre if segment.span else per_metre,
                contraction=way,
            )
            for segment, margin in segments
        )
    )


def _draw(picture: Callable[[Result, Path], None], result: Result, path: Path) -> None:
    try:
        write_beside(picture, result, path)
    except Exception as error:
        why = error.strerror if isinstance(error, OSError) else None
        print(f"warning: {path.name} could not be drawn ({why or f'{type(error).__name__}: {error}'})", file=sys.stderr)


def reference_csv(problem: Problem, frame: Frame = Frame.PAPER) -> str:
    """Samples of the path: segment, theta (s), alpha (rad), x, y (m), v (m/s), omega (rad/s); full precision.

    alpha is the heading of the vehicle that moves along it; `yaw`, from +x, in the frame of ROS.
    """
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["segment", "theta", frame.heading, "x", "y", "v", "omega"])
    for index, segment in enumerate(problem.path.curve):
        theta = np.linspace(0.0, segment.duration, REFERENCE_ROWS)
        profile = [segment.speed.values(theta), segment.turn_rate.values(theta)]
        poses = segment.poses(theta) + np.array([problem.side_slip + frame.shift, 0.0, 0.0])
        for row in np.column_stack([theta, poses, *profile]):
            writer.writerow([index, *(repr(float(value)) for value in row)])
    return file.getvalue()


def read_run(folder: Path, vehicle: str | None = None) -> Result:
    """The result that stands in a run folder; its problem is built from config.yaml as it was for the run.

    A vehicle of the user's own is not loaded by what the folder says: `vehicle` names its class, module.Class, whose
    dynamics have to be those in the certificate.

    It is the one that was written, but for the cars' recorded ways, which are not kept, and times, which are rounded;
    the certificate is read, not checked: that is `cfjax.check`'s work.

    Raises:
        InputError: where the folder holds no complete run, or something that is not one.
    """
    from cfjax.conf import problem_of
    from cfjax.report.own_vehicle import named_vehicle, speaks_of

    folder = Path(folder)
    data = read_json(folder / RESULT)
    config = read_config(folder)
    own = named_vehicle(folder, config, vehicle)
    problem = problem_of(config, own)
    document = read_json(folder / CERTIFICATE) if (folder / CERTIFICATE).exists() else None
    if own is not None and document is not None and not speaks_of(document, own):
        raise InputError(f"--vehicle: expected the class whose dynamics are in {folder / CERTIFICATE}, got {vehicle}")
    try:
        return result_of(data, problem, document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{folder / RESULT}: expected the result of a run ({type(error).__name__}: {error})"
        ) from error


def read_frame(folder: Path) -> Frame:
    """The frame of headings in the files of a run folder; raises InputError as `read_config`."""
    return Frame(read_config(folder).frame)


def read_config(folder: Path) -> "Config":
    """The configuration of a run folder; a waypoint file is the folder's own copy, which does not change.

    Raises:
        InputError: where the folder holds no configuration.
    """
    from cfjax.conf import config_of, waypoint_file, with_waypoint_file

    config = config_of(read_text(folder / CONFIG))
    return with_waypoint_file(config, folder / WAYPOINTS) if waypoint_file(config) else config
