"""What is written is what is read; what the checker does not accept is not called certified."""

import csv
import json
import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flint import fmpq

from cfcheck import Outcome, Report, check_file
from cfcheck.path.bounds import Bounds
from cfcheck.replay import WITHOUT_PERIOD as LESS
from cfcheck.robustness.amounts import AbsorbedClaim as ProvenAmounts
from cfcheck.robustness.amounts import LawNumbers, ProvenRobustness
from cfcheck.robustness.ranges import SampledClaim
from cfjax.certificate.robustness import Hints
from cfjax.conf import preset, preset_names, problem_of, yaml_of
from cfjax.errors import InputError, NotWritten
from cfjax.problem import Frame, Interval, Tube
from cfjax.report.result_json import result_json, result_of
from cfjax.report.run_folder import (
    Check,
    RequiredPeriod,
    _write_without_period,
    confirmed,
    read_frame,
    read_run,
    write_run,
)
from cfjax.result import Absorbed, Result, Sampled, SegmentResult, StretchMargin
from cfjax.result import Robustness as Robust
from cfjax.verdict import Verdict
from tests import by_hand
from tests.shapes import eight, slalom


Make = Callable[..., Result]  # hand_made


@pytest.mark.parametrize("template", ["contracting", "paper"])
@pytest.mark.parametrize("name", [name for name in preset_names() if name not in ("waypoints", "plan")])
def test_round_trip(hand_made: Make, name: str, template: str, tmp_path: Path) -> None:
    written = write_run(hand_made(problem_of(preset(name)), template), tmp_path / "run", yaml_of(preset(name)))
    read = read_run(tmp_path / "run")
    assert read.problem == written.problem
    assert (read.verdict, read.message, read.iterations) == (written.verdict, written.message, written.iterations)
    assert read.closed_loop == written.closed_loop
    assert read.margin_falsified == 1 / 3
    assert read.margin_certified is None
    for mine, theirs in zip(read.segments, written.segments, strict=True):
        np.testing.assert_array_equal(mine.funnel.shape, theirs.funnel.shape)
        assert (mine.funnel.rate, mine.funnel.duration) == (theirs.funnel.rate, theirs.funnel.duration)
        assert mine.funnel.template is theirs.funnel.template


def test_points_are_read_from_the_folders_own_copy(hand_made: Make, write: Callable[..., Path], tmp_path: Path) -> None:
    file = write(slalom())
    config = preset("waypoints", [f"path.file={file}", "path.speed=1.5"])
    written = write_run(hand_made(problem_of(config)), tmp_path / "run", yaml_of(config), points=file.read_bytes())
    write(eight())
    assert read_run(tmp_path / "run").problem == written.problem
    file.unlink()
    folder = (tmp_path / "run").rename(tmp_path / "moved")
    assert read_run(folder).problem == written.problem
    (folder / "waypoints.csv").unlink()
    with pytest.raises(InputError, match=rf"path\.file: {folder}/waypoints\.csv: .* there is no such file"):
        read_run(folder)


def test_fields_of_result_json(hand_made: Make, tmp_path: Path) -> None:
    write_run(hand_made(problem_of(preset("circle"))), tmp_path / "run", yaml_of(preset("circle")))
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert set(data) >= {
        *("verdict", "message", "method", "path", "template", "margin", "margin_per_metre", "segments", "inputs"),
        *("vehicle", "sets", "seconds", "iterations", "closed_loop", "versions", "closed", "failed_at", "history"),
    }
    assert data["margin"] == {"certified": None, "falsified": 1 / 3}
    assert data["inputs"] == {"u0": [0.5, 2.0], "w": [-1.0, 1.0], "thrust": [-4.0, 4.0]}
    assert data["vehicle"]["name"] == "kinematic_bicycle"
    assert data["vehicle"]["wheelbase"] == 0.34 and data["source"] is None
    assert data["sets"] == {"inlet": [0.5] * 4, "goal": [0.5] * 4, "safe": [1.0, 1.0, 1.0, 3.0], "obstacles": []}
    assert data["closed"] is True and data["failed_at"] is None
    (segment,) = data["segments"]
    assert set(segment) == {
        *("duration", "C", "template", "rate", "beta", "beta_lower", "beta_inner", "margin_certified"),
        *("margin_falsified", "margin_sos", "stretches", "half_widths"),
    }
    assert segment["beta"] == 1.0


def test_obstacles_and_body_stand_there_as_they_are_configured(hand_made: Make, tmp_path: Path) -> None:
    config = preset("obstacle", ["vehicle.footprint=[[0.2,0.1],[0.2,-0.1]]", "sets.obstacles=[{disc:[0,0,0.1]}]"])
    square = {"polygon": [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]}
    for name, required, obstacles in (
        ("disc", config, [{"disc": [0, 0, 0.1]}]),
        ("square", preset("obstacle"), [square]),
    ):
        write_run(hand_made(problem_of(required)), tmp_path / name, yaml_of(required))
        data = json.loads((tmp_path / name / "result.json").read_text())
        assert data["sets"]["obstacles"] == obstacles == required.sets.obstacles
        assert data["vehicle"]["footprint"] == required.vehicle.footprint


def test_a_chain_with_stretches_is_read_as_it_was_written(hand_made: Make, tmp_path: Path) -> None:
    stretches = (StretchMargin(0.0, 1.25, 0.5), StretchMargin(1.25, 4.5, RATIONAL))
    claimed = hand_made(problem_of(preset("oval")), **CLAIMS)
    segments = tuple(replace(found, stretches=stretches, margin_sos=0.4) for found in claimed.segments)
    written = write_run(
        claimed.replace(segments=segments),
        tmp_path,
        yaml_of(preset("oval")),
        check=lambda path: by_hand.proven(*[fmpq(3, 10)] * 2),
    )
    read = read_run(tmp_path)
    assert [found.stretches for found in read.segments] == [stretches] * 2
    for mine, theirs in zip(read.segments, written.segments, strict=True):
        np.testing.assert_array_equal(mine.funnel.shape, theirs.funnel.shape)
        assert replace(mine, funnel=theirs.funnel) == theirs
    assert read.replace(segments=()) == written.replace(segments=(), seconds=read.seconds)


def test_where_a_proof_failed_is_kept_and_no_stretch_of_it(hand_made: Make, tmp_path: Path) -> None:
    failed = hand_made(problem_of(preset("oval")), failed_at=(4.75, 5.0))
    segments = tuple(replace(found, stretches=(StretchMargin(0.0, 4.0, 0.5),)) for found in failed.segments)
    write_run(failed.replace(segments=segments), tmp_path, yaml_of(preset("oval")))
    read = read_run(tmp_path)
    assert read.failed_at == (4.75, 5.0)
    assert [found.stretches for found in read.segments] == [(), ()]


def test_margin_per_metre_is_of_the_largest_speed(hand_made: Make, write: Callable[..., Path], tmp_path: Path) -> None:
    config = preset("waypoints", [f"path.file={write(eight())}", "path.closed=true", "path.speed=3"])
    problem = problem_of(config)
    speeds = [s.speed.polynomial(np.linspace(0.0, s.duration, 20_001)) for s in problem.path.curve]
    assert max(map(np.ptp, speeds)) > 0.1
    tops = [float(speed.max()) for speed in speeds]
    claimed = hand_made(problem, **CLAIMS)
    margins = tuple(fmpq(k + 20, 100) for k in range(len(tops)))
    write_run(
        claimed,
        tmp_path / "run",
        yaml_of(config),
        check=lambda path: by_hand.proven(*margins),
        points=(tmp_path / "points.csv").read_bytes(),
    )
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    sampled = min((k + 20) / 100 / top for k, top in enumerate(tops))
    assert data["margin_per_metre"] <= sampled * (1 + 1e-15)
    assert data["margin_per_metre"] == pytest.approx(sampled, rel=1e-7)


def test_a_path_held_by_tubes_is_read_as_it_was_written(hand_made: Make, tmp_path: Path) -> None:
    claimed = hand_made(problem_of(preset("oval")), **CLAIMS)
    first = claimed.segments[0]
    funnel = replace(first.funnel, rate=0.0, duration=math.inf)
    bounds = Tube(curvature=Interval(-2.5, 2.5), speed=Interval(0.5, 4.0), acceleration=Interval(-1.0, 1.0))
    spans = ((0.0, 3.0), (3.0, 7.5), (7.5, 9.6875))
    segments = tuple(
        SegmentResult(funnel, 0.5, margin_per_metre=1 / (k + 2), reference=bounds, span=span)
        for k, span in enumerate(spans)
    )
    written = write_run(
        claimed.replace(segments=segments),
        tmp_path,
        yaml_of(preset("oval")),
        check=lambda path: by_hand.proven(*[fmpq(3, 10)] * 3),
    )
    data = json.loads((tmp_path / "result.json").read_text())
    assert [segment["theta"] for segment in data["segments"]] == [list(span) for span in spans]
    assert data["segments"][0]["reference"]["speed"] == [0.5, 4.0]
    assert data["margin_per_metre"] == 0.25
    for mine, theirs in zip(read_run(tmp_path).segments, written.segments, strict=True):
        assert replace(mine, funnel=theirs.funnel) == replace(theirs, margin_certified=RATIONAL)


def test_along_tubes_the_law_asks_for_what_the_checker_proved(hand_made: Make, tmp_path: Path) -> None:
    """Whatever result.json says of it: a law that asks for less is not that of which a period is proven."""
    claimed = hand_made(problem_of(preset("oval")), **CLAIMS)
    funnel = replace(claimed.segments[0].funnel, rate=0.0, duration=math.inf)
    narrow = Tube(curvature=Interval(0.0, 0.1), speed=Interval(1.0, 1.0), acceleration=Interval(0.0, 0.0))
    one = SegmentResult(funnel, 0.5, reference=narrow, along=narrow, span=(0.0, 9.6875))
    still = fmpq(0), fmpq(0)
    bounds = Bounds((fmpq(1, 4), fmpq(2)), (fmpq(1), fmpq(1)), still)
    none = ProvenAmounts(fmpq(1, 1000), (fmpq(0),) * 4, (fmpq(0),) * 4, fmpq(0))
    told = LawNumbers(fmpq(3, 10), fmpq(1), fmpq(9, 10), fmpq(1, 2), bounds)
    proven = ProvenRobustness(none, fmpq(1), none, fmpq(1), (), (told,))

    def check(path: Path) -> Report:
        return by_hand.proven(fmpq(3, 10), robustness=proven)

    write_run(claimed.replace(segments=(one,)), tmp_path, yaml_of(preset("oval")), check=check)
    read = read_run(tmp_path)
    assert read.segments[0].along == narrow
    sure = confirmed(read, tmp_path, check)
    assert sure.segments[0].along == Tube(Interval(0.25, 2.0), Interval(1.0, 1.0), Interval(0.0, 0.0))
    assert sure.robustness is not None and sure.robustness.alone.period <= 0.001
    unsaid = confirmed(read, tmp_path, lambda path: replace(check(path), robustness=None))
    assert unsaid.robustness is None


def test_reference_samples_the_path_at_full_precision(hand_made: Make, tmp_path: Path) -> None:
    write_run(hand_made(problem_of(preset("circle"))), tmp_path / "run", yaml_of(preset("circle")))
    with (tmp_path / "run" / "reference.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["segment", "theta", "alpha", "x", "y", "v", "omega"]
    assert len(rows) == 201
    theta, alpha, x, y, v, omega = (np.array([float(r[k]) for r in rows]) for k in list(rows[0])[1:])
    assert theta[0] == 0.0
    np.testing.assert_allclose(theta[-1], 6.0, rtol=1e-15)
    np.testing.assert_allclose(np.stack([x, y]), 1.5 * np.stack([np.cos(alpha), np.sin(alpha)]), atol=1e-12)
    np.testing.assert_allclose(v, math.pi / 2, rtol=0)
    np.testing.assert_allclose(omega, math.pi / 3, rtol=1e-15)


def test_reference_in_the_frame_of_ros_leads_along_its_yaw(hand_made: Make, tmp_path: Path) -> None:
    config = replace(preset("oval"), frame="ros")
    write_run(hand_made(problem_of(config)), tmp_path, yaml_of(config), frame=Frame(config.frame))
    with (tmp_path / "reference.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["segment", "theta", "yaw", "x", "y", "v", "omega"]
    assert read_frame(tmp_path) is Frame.ROS
    place = np.array([complex(float(row["x"]), float(row["y"])) for row in rows[:201]])
    yaw = np.array([float(row["yaw"]) for row in rows[:201]])
    np.testing.assert_allclose(np.angle(np.diff(place) * np.exp(-0.5j * (yaw[1:] + yaw[:-1]))), 0, atol=1e-3)


CLAIMS = {"verdict": Verdict.CERTIFIED, "document": {"format": "made by hand"}, "margin": 0.4}
RATIONAL = 0.3 if Fraction(0.3) <= Fraction(3, 10) else math.nextafter(0.3, 0)  # of 3/10, rounded down


def test_certified_only_when_the_checker_accepts_the_file(hand_made: Make, tmp_path: Path) -> None:
    def accepts(path: Path) -> Report:
        assert json.loads(path.read_text()) == CLAIMS["document"]  # as it lies on disk
        return by_hand.proven(fmpq(3, 10))

    written = write_run(
        hand_made(problem_of(preset("circle")), **CLAIMS), tmp_path / "run", yaml_of(preset("circle")), check=accepts
    )
    assert written.verdict is Verdict.CERTIFIED
    read = read_run(tmp_path / "run")
    assert (read.verdict, read.margin_certified, read.document) == (Verdict.CERTIFIED, RATIONAL, CLAIMS["document"])
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert data["margin_per_metre"] == pytest.approx(0.3 / (math.pi / 2))


def _breaks(path: Path) -> Report:
    raise RuntimeError("checker ran away")


REFUSALS = {
    "broken": (Verdict.CERTIFIED, lambda path: Report(Outcome.BROKEN, "no")),
    "proves the opposite": (Verdict.CERTIFIED, lambda path: Report(Outcome.REFUTED, "no")),
    "proves a part": (Verdict.CERTIFIED, lambda path: Report(Outcome.PROVEN, "yes")),
    "checker crashed": (Verdict.CERTIFIED, _breaks),
    "broken witness": (Verdict.REFUTED, lambda path: Report(Outcome.UNREADABLE, "no")),
    "no refutation": (Verdict.REFUTED, lambda path: Report(Outcome.PROVEN, "no")),
    "the real checker": (Verdict.CERTIFIED, check_file),
}


@pytest.mark.parametrize(("verdict", "check"), REFUSALS.values(), ids=list(REFUSALS))
def test_what_the_checker_does_not_accept_claims_nothing(
    hand_made: Make, verdict: Verdict, check: Check, tmp_path: Path
) -> None:
    claimed = hand_made(problem_of(preset("circle")), **{**CLAIMS, "verdict": verdict})
    drawn: list[Verdict] = []
    driven: list[Verdict] = []
    written = write_run(
        claimed,
        tmp_path / "run",
        yaml_of(preset("circle")),
        lambda result, path: drawn.append(result.verdict),
        check=check,
        drive=lambda result: driven.append(result.verdict) or result,
    )
    assert drawn == driven == [Verdict.INCONCLUSIVE]  # cars and picture, too, know only what the checker accepted
    assert written.verdict is Verdict.INCONCLUSIVE
    assert "did not accept" in written.message
    assert not (tmp_path / "run" / "certificate.json").exists()
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert (data["verdict"], data["margin"]["certified"]) == ("inconclusive", None)
    assert data["segments"][0]["margin_certified"] is None


def test_time_of_the_cars_is_counted_once(hand_made: Make, tmp_path: Path) -> None:
    def drive(result: Result) -> Result:
        return result.replace(seconds={**result.seconds, "simulate": 100.0, "total": 103.0})

    written = write_run(
        hand_made(problem_of(preset("circle"))), tmp_path / "run", yaml_of(preset("circle")), drive=drive
    )
    assert list(written.seconds) == ["learn", "certify", "simulate", "total"]
    assert written.seconds["simulate"] == 100.0
    assert 3.0 < written.seconds["total"] < 100.0  # 3 s before, and what the clock says since


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_whatever_stops_the_cars_comes_after_the_run_is_written(
    hand_made: Make, error: type[BaseException], tmp_path: Path
) -> None:
    def drive(result: Result) -> Result:
        assert {entry.name for entry in tmp_path.iterdir()} == {"certificate.json", "config.yaml", "reference.csv"}
        raise error

    claimed = hand_made(problem_of(preset("circle")), **CLAIMS, closed_loop=None)
    with pytest.raises(error):
        write_run(
            claimed,
            tmp_path,
            yaml_of(preset("circle")),
            check=lambda path: by_hand.proven(fmpq(3, 10)),
            drive=drive,
        )
    read = read_run(tmp_path)
    assert (read.verdict, read.margin_certified, read.closed_loop) == (Verdict.CERTIFIED, RATIONAL, None)


def test_claim_without_certificate_claims_nothing(hand_made: Make, tmp_path: Path) -> None:
    claimed = hand_made(problem_of(preset("circle")), verdict=Verdict.CERTIFIED, margin=0.3)
    written = write_run(claimed, tmp_path / "run", yaml_of(preset("circle")))
    assert (written.verdict, written.margin_certified) == (Verdict.INCONCLUSIVE, None)


def test_leftovers_of_a_killed_run_are_cleared(hand_made: Make, tmp_path: Path) -> None:
    (tmp_path / "certificate.json").write_text("{}")
    write_run(hand_made(problem_of(preset("circle"))), tmp_path, yaml_of(preset("circle")))
    assert not (tmp_path / "certificate.json").exists()
    with pytest.raises(InputError, match="already holds a run"):
        write_run(hand_made(problem_of(preset("circle"))), tmp_path, yaml_of(preset("circle")))


def test_no_funnel_at_all_is_written_too(hand_made: Make, tmp_path: Path) -> None:
    nothing = hand_made(problem_of(preset("circle")), segments=(), closed_loop=None, verdict=Verdict.SOLVER_FAILED)
    write_run(nothing, tmp_path / "run", yaml_of(preset("circle")))
    read = read_run(tmp_path / "run")
    assert (read.verdict, read.segments, read.closed_loop) == (Verdict.SOLVER_FAILED, (), None)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("result.json", None, "cannot be read"),
        ("result.json", "{", "expected JSON"),
        ("result.json", "[]", "expected a JSON object, got list"),
        ("result.json", "{}", "expected the result of a run"),
        ("config.yaml", None, "cannot be read"),
        (
            "config.yaml",
            "path: {kind: spiral}",
            "expected path.kind to be one of straight, circle, .*, tube, got spiral",
        ),
        ("config.yaml", "- a", "expected keys and values"),
        ("config.yaml", "a: [", "config.yaml"),
    ],
)
def test_unreadable_folders_are_refused_in_one_line(
    hand_made: Make, file: str, content: str | None, message: str, tmp_path: Path
) -> None:
    write_run(hand_made(problem_of(preset("circle"))), tmp_path / "run", yaml_of(preset("circle")))
    if content is None:
        (tmp_path / "run" / file).unlink()
    else:
        (tmp_path / "run" / file).write_text(content)
    with pytest.raises(InputError, match=message) as refused:
        read_run(tmp_path / "run")
    assert "\n" not in str(refused.value)


def test_what_is_proven_of_holds_comes_back_from_result_json(hand_made: Make) -> None:
    amounts = Absorbed(0.001, (0.1,) * 4, (0.2,) * 4, 0.002)
    absorbed = Robust(amounts, 0.9, amounts, 0.8)
    held = replace(absorbed, sampled=Sampled(0.02, 3, 0.5, ((0.5, -1.0, 0.0), (2.0, 1.0, 4.0)), (1.0, 2.0)))
    made = hand_made(problem_of(preset("circle")))
    for robustness in (absorbed, held):
        result = made.replace(robustness=robustness)
        data = json.loads(json.dumps(result_json(result)))
        assert result_of(data, result.problem, None).robustness == robustness
        assert ("sampled control  20 ms" in str(result)) == (robustness is held)


def test_period_and_delay_are_those_of_the_law_that_was_asked_for(hand_made: Make) -> None:
    amounts = Absorbed(0.001, (0.1,) * 4, (0.2,) * 4, 0.002)
    held = Robust(amounts, 0.9, amounts, 0.8, (), replace(HELD, delay=0.05, level=0.75))
    result = hand_made(problem_of(preset("circle"))).replace(robustness=held)
    data = json.loads(json.dumps(result_json(result)))
    told = data["robustness"]
    assert (told["period"], told["delay"], told["level"]) == (0.02, 0.05, 0.75)
    assert (told["any_law"]["period"], told["any_law"]["delay"]) == (0.001, 0.002)
    assert result_of(data, result.problem, None).robustness == held
    assert "its delay       50 ms, of the pose, by prediction; from starts in V <= 0.75" in str(result)


# --- a period that is asked for and not proven

NONE = ProvenAmounts(fmpq(1, 1000), (fmpq(0),) * 4, (fmpq(0),) * 4, fmpq(0))
HELD = Sampled(0.02, 3, 0.5, ((0.5, -1.0, 0.0), (2.0, 1.0, 4.0)), (1.0, 2.0))
ONE_LAW = ProvenRobustness(
    NONE, fmpq(1), NONE, fmpq(1), (), (LawNumbers(fmpq(3, 10), None, fmpq(9, 10), fmpq(9, 10), None),)
)
SHORT = SampledClaim(fmpq(1, 50), 3, fmpq(1, 2), ((fmpq(1), fmpq(0), fmpq(0)),), (fmpq(1),), ())


def required_of(period: float, delay: float | None = None) -> RequiredPeriod:
    return RequiredPeriod(period, delay, yaml_of(preset("circle")))


def checked(path: Path) -> Report:
    """Of a folder that has hints, amounts too: with a law that looks ahead, where they say so."""
    if not path.is_dir():
        return by_hand.proven(fmpq(3, 10))
    if not (path / "robustness.json").exists():
        return by_hand.proven(fmpq(3, 10)) if (path / "certificate.json").exists() else check_file(path)
    looks_ahead = "sampled" in json.loads((path / "robustness.json").read_text())
    return by_hand.proven(fmpq(3, 10), robustness=replace(ONE_LAW, sampled=SHORT) if looks_ahead else ONE_LAW)


@pytest.mark.parametrize(
    ("required", "hints", "why"),
    [
        (required_of(0.03), Hints({"hints": []}, lack="V changes by 1 1/s somewhere"), "V changes by 1 1/s somewhere"),
        (required_of(0.03), Hints({"hints": []}, {"hints": [], "sampled": []}), "no proof was found"),
        (required_of(0.02, 0.05), Hints({"hints": []}, {"hints": [], "sampled": []}), "no proof was found"),
    ],
    ids=["nothing found", "a shorter one", "no delay"],
)
def test_a_run_whose_period_is_not_proven_is_not_certified(
    hand_made: Make, required: RequiredPeriod, hints: Hints, why: str, tmp_path: Path
) -> None:
    folder, config = tmp_path / "run", yaml_of(preset("circle", [f"period={required.period}"]))
    claimed = hand_made(problem_of(preset("circle")), **CLAIMS)
    written = write_run(claimed, folder, config, check=checked, harden=lambda _: hints, required=required)
    data = json.loads((folder / "result.json").read_text())
    assert written.verdict is Verdict.INCONCLUSIVE and data["verdict"] == "inconclusive"
    assert data["margin"]["certified"] is None and data["robustness"] is None
    assert data["message"].startswith(
        f"the funnel is proven, with margin 0.2999 1/s, but not period={required.period:g}"
    )
    assert why in data["message"] and "proven of every law: 0.999 ms" in data["message"]
    assert ("delay=0.05" in data["message"]) == (required.delay is not None)
    assert not (folder / "certificate.json").exists() and not (folder / "robustness.json").exists()
    report = check_file(folder)
    assert report.outcome is Outcome.UNREADABLE
    assert (
        report.refusal == f"the period that this run asks for is not proven; what is proven without it: {folder}/{LESS}"
    )
    less = confirmed(read_run(folder / LESS), folder / LESS, checked)  # a run of its own, of another question
    assert less.verdict is Verdict.CERTIFIED and less.margin_certified == RATIONAL
    assert less.robustness is not None and less.robustness.alone.period == pytest.approx(0.001)
    assert (folder / LESS / "reference.csv").exists()


def test_a_run_whose_period_is_proven_is_certified(hand_made: Make, tmp_path: Path) -> None:
    whole = Hints({"hints": []}, {"hints": [], "sampled": []})
    config = yaml_of(preset("circle", ["period=0.02"]))
    claimed = hand_made(problem_of(preset("circle")), **CLAIMS)
    written = write_run(claimed, tmp_path, config, check=checked, harden=lambda _: whole, required=required_of(0.02))
    assert written.verdict is Verdict.CERTIFIED and not (tmp_path / LESS).exists()
    assert written.robustness is not None and written.robustness.sampled is not None
    assert written.robustness.sampled.period == 0.02
    read = read_run(tmp_path)
    assert confirmed(read, tmp_path, checked).robustness == written.robustness
    (tmp_path / "robustness.json").unlink()  # what is claimed then is less than what was asked
    with pytest.raises(
        InputError, match=r"robustness\.json: expected a proof of period=0\.02, which config\.yaml asks for"
    ):
        confirmed(read, tmp_path, checked)


def test_hints_of_the_period_that_the_checker_refuses_take_nothing_else_along(hand_made: Make, tmp_path: Path) -> None:
    def refuses(path: Path) -> Report:
        said = checked(path)
        looks_ahead = said.robustness is not None and said.robustness.sampled is not None
        return Report(Outcome.BROKEN, "sampled: V does not fall as stated") if looks_ahead else said

    whole = Hints({"hints": []}, {"hints": [], "sampled": []})
    claimed = hand_made(problem_of(preset("circle")), **CLAIMS)
    config = yaml_of(preset("circle", ["period=0.02"]))
    written = write_run(claimed, tmp_path, config, check=refuses, harden=lambda _: whole, required=required_of(0.02))
    assert written.verdict is Verdict.INCONCLUSIVE and "V does not fall as stated" in written.message
    assert confirmed(read_run(tmp_path / LESS), tmp_path / LESS, refuses).robustness is not None


@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError])
def test_what_stops_the_run_without_the_period_leaves_nothing_certified(
    stop: type[BaseException], hand_made: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unproven(_: Result) -> Hints:
        return Hints({"hints": []}, lack="nothing was found")

    def fails(*_: object, **__: object) -> Result:
        raise stop

    claimed = hand_made(problem_of(preset("circle")), **CLAIMS)
    config = yaml_of(preset("circle", ["period=0.02"]))
    monkeypatch.setattr("cfjax.report.run_folder._write_without_period", fails)
    with pytest.raises((KeyboardInterrupt, NotWritten)):
        write_run(claimed, tmp_path, config, check=checked, harden=unproven, required=required_of(0.02))
    data = json.loads((tmp_path / "result.json").read_text())
    assert data["verdict"] == "inconclusive" and data["margin"]["certified"] is None


def test_a_run_without_the_period_that_is_not_written_leaves_no_certificate(hand_made: Make, tmp_path: Path) -> None:
    def again(*_: object, **__: object) -> Result:
        raise KeyboardInterrupt

    (tmp_path / "certificate.json").write_text("{}")
    proven = hand_made(problem_of(preset("circle")), **CLAIMS)
    with pytest.raises(KeyboardInterrupt):
        _write_without_period(required_of(0.02), proven, tmp_path, again)
    assert not (tmp_path / "certificate.json").exists()


def test_ctrl_c_before_the_period_is_proven_certifies_nothing(hand_made: Make, tmp_path: Path) -> None:
    def stops(_: Result) -> Hints:
        raise KeyboardInterrupt

    claimed = hand_made(problem_of(preset("circle")), **CLAIMS)
    config = yaml_of(preset("circle", ["period=0.02"]))
    with pytest.raises(KeyboardInterrupt):
        write_run(claimed, tmp_path, config, check=checked, harden=stops, required=required_of(0.02))
    assert json.loads((tmp_path / "result.json").read_text())["verdict"] == "inconclusive"
    assert json.loads((tmp_path / LESS / "result.json").read_text())["verdict"] == "certified"
