"""From candidates to verdicts."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq

from cfcheck import Outcome, check_document, check_file
from cfcheck.kernel.program import CellProof
from cfjax.certificate import certify, dump, refute, statement_of
from cfjax.certificate import program as certificate_program
from cfjax.errors import InputError
from cfjax.falsifier import falsify
from cfjax.funnel import Contracting, Funnel, Paper
from cfjax.problem import Box, Path, Pose, Problem, ball, circle, ellipse
from cfjax.solver import Program, Solution, Status
from cfjax.solver.program import Shape
from cfjax.verdict import Verdict
from experiments.vehicles.omnidirectional import Omnidirectional


Candidate = Callable[..., tuple[Problem, Funnel]]
ROWS = [("circle", "tt", "paper"), ("circle", "tt", "contracting"), ("straight", "pf", "paper")]


@pytest.mark.parametrize("row", ROWS, ids=" ".join)
def test_certified_margins_are_sharp_and_true(candidate: Candidate, row: tuple, tmp_path: object) -> None:
    problem, funnel = candidate(*row)
    heard = []
    found = certify(problem, [funnel], progress=lambda *news: heard.append(news), workers=2)
    assert found.verdict is Verdict.CERTIFIED
    assert found.margins is not None
    assert found.document is not None
    assert found.margins[0] >= 0.98 * found.numerical_margins[0]
    (rounded,) = found.funnels
    np.testing.assert_allclose(rounded.shape, funnel.shape, rtol=0, atol=1e-8)
    falsified = next(p for p in falsify(problem, problem.path.segments[0], rounded) if p.condition == "d")
    assert 0.97 * falsified.slack <= found.margins[0] <= falsified.slack
    assert [done for _, done, _ in heard] == list(range(1, heard[-1][2] + 1))
    path = tmp_path / "certificate.json"
    path.write_text(dump(found.document))
    report = check_file(path)
    assert report.outcome is Outcome.PROVEN
    # the float that is told is not above the rational that is proven, and the float funnel is the rational one
    assert found.margins[0] <= float(report.margins[0])
    lower = [rounded.shape[i, j] for i in range(4) for j in range(i + 1)]
    told = [entry.split("/") for entry in found.document["funnels"][0]["shape"]]
    assert lower == [int(entry[0]) / int(entry[1] if len(entry) > 1 else 1) for entry in told]


@pytest.mark.parametrize(
    ("parts", "condition"),
    [
        ({"inlet": ball(0.55)}, "(a)"),
        ({"goal": ball(0.45)}, "(b)"),
        ({"safe": Box((1.0, 0.52, 1.0, 3.0))}, "(c)"),
    ],
)
def test_violated_containments_are_not_certified(candidate: Candidate, parts: dict, condition: str) -> None:
    problem, funnel = candidate("circle", "tt", "paper")
    found = certify(replace(problem, **parts), [funnel])
    assert (found.verdict, found.document, found.margins) == (Verdict.INCONCLUSIVE, None, None)
    assert f"condition {condition}" in found.message


def test_a_vehicle_that_moves_in_any_direction_is_certified() -> None:
    """What u0 does its own inputs do too: some of their signs exclude each other, and that is the proof there."""
    problem = Problem(circle(laps=0.5), vehicle=Omnidirectional(), inlet=ball(0.4, 3), goal=ball(1.2, 3))
    shape = np.array([[3.0, 0.0, 0.0], [0.0, 3.0, 0.5], [0.0, 0.5, 3.0]])
    found = certify(problem, [Funnel(Contracting(), shape, 0.0, problem.path.segments[0].duration)])
    assert found.verdict is Verdict.CERTIFIED
    assert found.document is not None
    (stretch,) = found.document["hints"]["decrease"][0]["stretches"]
    shown = {tuple(cell["signs"]): float(Fraction(cell["margin"])) for cell in stretch["cells"]}
    assert len(shown) == 16
    assert {signs for signs, margin in shown.items() if margin > 100} == {(1, 1, 1, 1), (1, 1, -1, 1)}
    assert found.margins is not None
    assert found.margins[0] == pytest.approx(min(shown.values()), rel=1e-3)


def failing(candidate: Candidate, below: float) -> tuple[Problem, Funnel]:
    """A funnel whose true margin is at most −below: the rate is raised until the falsifier's worst point says so."""
    problem, funnel = candidate("circle", "tt", "paper")
    low, high = funnel.rate, 0.9 / funnel.duration - 1e-3
    for _ in range(24):
        middle = 0.5 * (low + high)
        points = falsify(problem, problem.path.segments[0], replace(funnel, rate=middle))
        worst = next(p.slack for p in points if p.condition == "d")
        low, high = (low, middle) if worst < -below else (middle, high)
    return problem, replace(funnel, rate=high)


def test_a_margin_of_minus_1e_7_is_never_certified(candidate: Candidate) -> None:
    problem, funnel = failing(candidate, 1e-7)
    found = certify(problem, [funnel], workers=2)
    assert found.verdict in (Verdict.INCONCLUSIVE, Verdict.SOLVER_FAILED)
    assert found.document is None
    assert "condition" in found.message
    told = refute(problem, funnel)
    assert told.verdict is Verdict.REFUTED
    assert check_document(told.document).outcome is Outcome.REFUTED


@pytest.mark.parametrize("spoil", ["stretched", "sheared", "slower", "faster"])
def test_spoiled_candidates_are_certified_only_where_true(candidate: Candidate, spoil: str) -> None:
    problem, funnel = candidate("circle", "tt", "paper")
    shape = funnel.shape.copy()
    if spoil == "stretched":
        shape[1, 1] *= 1.15
    elif spoil == "sheared":
        shape[0, 1] = shape[1, 0] = -shape[0, 1]
    rate = funnel.rate * {"slower": 0.5, "faster": 1.3}.get(spoil, 1.0)
    spoiled = replace(funnel, shape=shape, rate=rate)
    found = certify(problem, [spoiled], workers=2)
    points = falsify(problem, problem.path.segments[0], spoiled)
    if min(point.slack for point in points) < 0:
        assert found.verdict is not Verdict.CERTIFIED
        assert found.document is None
    else:
        assert found.margins is not None
        assert found.margins[0] <= points[-1].slack


@pytest.mark.parametrize("margin", [0.0, 1e-3, 0.1])
def test_only_violations_are_refuted(candidate: Candidate, margin: float) -> None:
    problem, funnel = candidate("circle", "tt", "paper")
    points = falsify(problem, problem.path.segments[0], funnel)
    truth = next(p.slack for p in points if p.condition == "d")
    assert refute(problem, funnel, truth * 0.999, points).verdict is Verdict.INCONCLUSIVE
    told = refute(problem, funnel, truth * 1.001 + margin, points)
    assert told.verdict is Verdict.REFUTED
    assert "condition (d)" in told.message
    # the candidate in the document is the one that was given, bit by bit
    written = told.document["funnels"][0]
    assert Fraction(written["rate"]) == Fraction(funnel.rate)
    lower = [Fraction(float(funnel.shape[i, j])) for i in range(4) for j in range(i + 1)]
    assert [Fraction(entry) for entry in written["shape"]] == lower
    spoiled = json.loads(dump(told.document))
    spoiled["witness"]["x"] = ["0"] * 4
    assert check_document(spoiled, skip_hash=True).outcome is Outcome.BROKEN
    spoiled = json.loads(dump(told.document))
    spoiled["funnels"][0]["margin"] = "1/10"
    assert check_document(spoiled, skip_hash=True).outcome is Outcome.BROKEN


@pytest.mark.parametrize(
    ("parts", "condition"),
    [({"inlet": ball(0.6)}, "(a)"), ({"goal": ball(0.3)}, "(b)"), ({"safe": Box((1.0, 0.505, 1.0, 3.0))}, "(c)")],
)
def test_containments_are_refuted_with_a_witness(candidate: Candidate, parts: dict, condition: str) -> None:
    problem, funnel = candidate("circle", "tt", "contracting")
    told = refute(replace(problem, **parts), funnel)
    assert told.verdict is Verdict.REFUTED
    assert f"condition {condition} fails" in told.message


def test_questions_without_a_proof_of_this_kind_are_refused(candidate: Candidate) -> None:
    problem, funnel = candidate("circle", "tt", "paper")
    segment = problem.path.segments[0]
    chain = replace(problem, path=Path("chain", (segment, segment)))
    with pytest.raises(InputError, match="expected 1 funnels, one per distinct segment, got 2"):
        certify(chain, [funnel, funnel])
    with pytest.raises(InputError, match="expected one segment"):
        refute(chain, funnel)
    apart = replace(segment, start=Pose(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"segment 1 starts .* m away"):
        certify(replace(problem, path=Path("apart", (segment, apart))), [funnel])
    with pytest.raises(InputError, match="margin: expected a finite number of at least 0"):
        refute(problem, funnel, -1.0)
    reaching = Funnel(Paper(), funnel.shape, 0.2, funnel.duration)
    assert certify(problem, [reaching]).verdict is Verdict.INCONCLUSIVE


def test_a_path_of_more_than_a_checker_reads_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    assert len(statement_of(Problem(ellipse())).written["path"]["pieces"]) > 10
    monkeypatch.setattr("cfcheck.claims.problem.MOST_PIECES", 10)
    with pytest.raises(
        InputError, match=r"no checker would read this question: problem\.path\.pieces: expected .* 10 "
    ):
        statement_of(Problem(ellipse()))


class Oracle:
    """A solver that says the same of every program."""

    name = "oracle"

    def __init__(self, answer: Callable[[Program], Solution], wrong_number: bool = False) -> None:
        self.answer, self.wrong_number = answer, wrong_number

    def solve(self, programs: Sequence[Program]) -> list[Solution]:
        return [self.answer(program) for program in programs[self.wrong_number :]]

    def prepare(self, shape: Shape) -> None:
        """It knows all it needs."""


def says(status: Status, margin: float, grams: tuple | None) -> Oracle:
    return Oracle(lambda _: Solution(status, margin, grams, 0.0, "oracle"))


def breaks_down(_: Program) -> Solution:
    raise FloatingPointError("of its own")


ONES = tuple(np.eye(size) for size in (35, 15, 15, 15, 15))
BAD = {
    "failed": says(Status.FAILED, math.nan, None),
    "nan": says(Status.OPTIMAL, math.nan, ONES),
    "infinite": says(Status.OPTIMAL, math.inf, ONES),
    "nan in a matrix": says(Status.OPTIMAL, 0.3, (np.diag([math.nan] + 34 * [1.0]), *ONES[1:])),
    "infinite in a matrix": says(Status.OPTIMAL, 0.3, (np.diag([-math.inf] + 34 * [1.0]), *ONES[1:])),
    "other sizes": says(Status.OPTIMAL, 0.3, (np.eye(3), *ONES[1:])),
    "a matrix too few": says(Status.OPTIMAL, 0.3, ONES[1:]),
    "nonsense": says(Status.OPTIMAL, 0.3, ONES),  # found out by the exact replay
    "huge": says(Status.OPTIMAL, 1e300, tuple(1e300 * one for one in ONES)),
    "an answer too few": Oracle(lambda _: Solution(Status.OPTIMAL, 0.3, ONES, 0.0, "oracle"), wrong_number=True),
    "raises": Oracle(breaks_down),
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_a_bad_solver_proves_nothing(candidate: Candidate, bad: Oracle, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, funnel = candidate("circle", "tt", "paper")
    monkeypatch.setattr(certificate_program, "solver_named", lambda *_: says(Status.FAILED, math.nan, None))
    found = certify(problem, [funnel], solver=bad)
    assert found.document is None
    assert found.verdict in (Verdict.SOLVER_FAILED, Verdict.INCONCLUSIVE)


def test_the_reference_solver_mends_what_another_spoils(candidate: Candidate) -> None:
    problem, funnel = candidate("circle", "tt", "paper")
    found = certify(problem, [funnel], solver=BAD["nan in a matrix"])
    assert (found.verdict, found.solvers) == (Verdict.CERTIFIED, ("clarabel",))


@pytest.mark.parametrize(
    ("status", "margin", "proven", "good"),
    [
        (Status.OPTIMAL, 0.3, fmpq(29, 100), True),
        (Status.OPTIMAL, -3.0, fmpq(-301, 100), True),  # a bound
        (Status.OPTIMAL, 1e-9, fmpq(-1, 10**6), False),
        (Status.INACCURATE, 0.3, fmpq(29, 100), False),
        (Status.OPTIMAL, 0.3, None, False),
    ],
)
def test_another_solver_is_asked_only_for_what_it_may_mend(
    status: Status, margin: float, proven: fmpq | None, good: bool
) -> None:
    proof = None if proven is None else CellProof(None, proven, ())
    solution = Solution(status, margin, None, 0.0, "oracle")
    assert certificate_program.CellResult(solution, proof, proven or fmpq(0)).is_good == good


def test_an_unknown_solver_is_one_line(candidate: Candidate) -> None:
    problem, funnel = candidate("circle", "tt", "paper")
    with pytest.raises(InputError, match="solver: expected one of batched, clarabel, got clarabell"):
        certify(problem, [funnel], solver="clarabell")


def test_both_solvers_prove_the_same(candidate: Candidate) -> None:
    problem, funnel = candidate("circle", "tt", "contracting")
    ours, reference = (certify(problem, [funnel], solver=name) for name in ("batched", "clarabel"))
    assert (ours.solvers, reference.solvers) == (("batched",), ("clarabel",))
    assert ours.margins == pytest.approx(reference.margins, rel=1e-3)
