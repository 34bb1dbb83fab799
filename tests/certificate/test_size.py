"""How large a proof is, before it is made: counted as it will be, and refused where it cannot be held."""

from dataclasses import replace
from math import comb

import numpy as np
import pytest
from flint import fmpq

import cfjax.synthesis
from cfcheck.exact import enclosure
from cfcheck.path.bounds import Bounds
from cfjax.certificate import certify, program, proof_size, require_room, statement_of
from cfjax.certificate.certifier import Statement
from cfjax.certificate.program import program_of
from cfjax.certificate.rounding import round_funnel
from cfjax.certificate.size import GB, ProofSize
from cfjax.certificate.stretches import ThetaInterval, bounded, decreases_on, question_of
from cfjax.errors import InputError
from cfjax.funnel import TEMPLATES, Funnel
from cfjax.options import Options, ProofLimits
from cfjax.problem import KinematicBicycle, Method, Path, Problem, Vehicle, ball, circle, ellipse, oval, tube
from cfjax.verdict import Verdict
from experiments.vehicles.omnidirectional import Omnidirectional
from experiments.vehicles.steered_car import SteeredCar
from tests.check.vehicles import Dragged, Rooted


CONTRACTING = TEMPLATES["contracting"]


def asked(vehicle: Vehicle, path: Path, method: Method = Method.PF) -> Problem:
    size = len(vehicle.state_names)
    return Problem(path, vehicle=vehicle, inlet=ball(0.2, size), goal=ball(0.6, size), method=method)


def sized(problem: Problem) -> ProofSize:
    found = proof_size(problem, statement_of(problem), CONTRACTING, 0.9)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("problem", "counts"),
    [
        (asked(Omnidirectional(), circle()), (3, 3, 1, 32, comb(9, 3), comb(6, 3))),
        (Problem(circle()), (4, 3, 1, 16, comb(10, 4), comb(7, 4))),
        (Problem(oval(), goal=ball(0.6)), (4, 3, 2, 32, comb(10, 4), comb(7, 4))),
        (Problem(tube(1.0, 1.5), goal=ball(0.6)), (4, 3, 1, 8, comb(10, 4), comb(7, 4))),
        (asked(SteeredCar(), ellipse(), Method.TT), (5, 3, 4, 32, comb(11, 5), comb(8, 5))),
    ],
    ids=["three states", "circle", "oval", "tube", "steered car"],
)
def test_counts_are_those_of_the_proof(problem: Problem, counts: tuple[int, ...]) -> None:
    """Against the programs that are made for another funnel."""
    size = sized(problem)
    assert (size.states, size.order, size.references, size.cells, size.rows, size.monomials) == counts
    statement, segment = statement_of(problem), problem.path.distinct[0]
    rate = 0.0 if problem.path.tube else 0.1 / segment.duration
    shape = np.diag(1 / np.linspace(0.5, 0.6, problem.dimension) ** 2) * (1.2 if problem.dimension == 5 else 1.0)
    course = statement.claim.course
    if isinstance(course, Bounds):
        stretch = ThetaInterval(fmpq(0), fmpq(0), course)
    else:
        stretch = whole_of(statement, isinstance(problem.vehicle, SteeredCar))
    funnel = round_funnel(Funnel(CONTRACTING, shape, rate, segment.duration), segment)
    questions = decreases_on(question_of(statement.claim, funnel), funnel, stretch)
    cells = [(question, cell) for question in questions for cell in question.cells()]
    assert size.cells == len(problem.path.distinct) * len(cells)
    made = program_of(*cells[0])
    assert len(made.target) == size.rows
    assert max(made.degrees) == size.order


def whole_of(statement: Statement, is_smooth: bool) -> ThetaInterval:
    """All of the first segment in one."""
    pieces = statement.pieces(0)
    return bounded(pieces, fmpq(0), pieces[-1].theta + pieces[-1].duration, is_smooth)


def test_more_states_take_more() -> None:
    three, four, five = (
        sized(asked(vehicle, circle())) for vehicle in (Omnidirectional(), KinematicBicycle(), SteeredCar())
    )
    assert three.memory < four.memory < five.memory < 1 * GB
    assert three.seconds < four.seconds < five.seconds < 600


def test_what_no_checker_reads_is_refused_before_learning(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = asked(Rooted(), circle())
    monkeypatch.setattr("cfjax.learner.by_gradient.learn_for", lambda *_, **__: pytest.fail("it was learned"))
    with pytest.raises(InputError, match=r"vehicle rooted: expected .* degree 12 in 5 states takes .* 462 rows"):
        cfjax.synthesis.search(problem)


def test_nothing_of_a_proof_is_made_that_no_checker_reads() -> None:
    """Whoever asks for it: Gram matrices of 462 rows would not fit into any memory."""
    problem = asked(Rooted(), circle())
    statement, segment = statement_of(problem), problem.path.distinct[0]
    stretch = whole_of(statement, True)
    funnel = round_funnel(Funnel(CONTRACTING, 30 * np.eye(5), 0.0, segment.duration), segment)
    with pytest.raises(enclosure.TooLarge, match="at most 128"):
        decreases_on(question_of(statement.claim, funnel), funnel, stretch)


SIZE = ProofSize(5, 4, 1, 16, 1287, 126, memory=6e9, seconds=3000.0, shapes=())


def test_programs_are_solved_side_by_side_as_far_as_memory_goes() -> None:
    assert require_room(SIZE, 100.0, 12.0, 4)[0] == 4
    assert require_room(SIZE, 13.0, 12.0, 4)[0] == 2
    assert require_room(SIZE, 6.0, 12.0, 4)[0] == 1


@pytest.mark.parametrize("memory", [0.0, -1.0, 1e299, float("nan")])
def test_memory_that_no_machine_has_is_refused(memory: float) -> None:
    with pytest.raises(InputError, match=r"proof\.memory"):
        require_room(SIZE, memory, 12.0, 4)
    with pytest.raises(InputError, match=r"proof\.memory"):
        ProofLimits(memory=memory)


def test_a_long_proof_is_announced_and_a_short_one_is_not() -> None:
    _, line = require_room(SIZE, 13.0, 12.0, 4)
    for part in ("16 semidefinite programs", "5 states", "degree 8", "1287 equations", "126 rows", "25 min", "12 GB"):
        assert part in line
    assert require_room(replace(SIZE, seconds=100.0), 13.0, 12.0, 4)[1] == ""


def test_a_proof_beyond_its_limits_is_refused() -> None:
    with pytest.raises(InputError, match=r"^proof.memory: expected at most 5 GB, as proof.memory says, got .* 6 GB"):
        require_room(SIZE, 5.0, 12.0, 4)
    with pytest.raises(InputError, match=r"^proof.memory: expected at most .* GB, which is free here"):
        require_room(replace(SIZE, memory=1e15), None, 12.0, 4)
    with pytest.raises(InputError, match=r"^proof.hours: expected at most 0.4 h, got .* 0.417 h"):
        require_room(SIZE, 13.0, 0.4, 4)
    assert require_room(SIZE, 13.0, 0.4168, 4)[0] == 2


def test_limits_reach_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cfjax.learner.by_gradient.learn_for", lambda *_, **__: pytest.fail("it was learned"))
    with pytest.raises(InputError, match=r"^proof.memory: expected at most 0.001 GB"):
        cfjax.synthesis.search(Problem(circle()), Options(proof=ProofLimits(memory=0.001)))


@pytest.mark.parametrize("limits", [{"memory": 0.0}, {"memory": float("inf")}, {"hours": 0.0}, {"hours": float("nan")}])
def test_limits_are_positive_numbers(limits: dict[str, float]) -> None:
    said = r"^proof\.(memory: expected a number above 0 and at most 1e\+09|hours: expected a positive finite number)"
    with pytest.raises(InputError, match=said):
        ProofLimits(**limits)


def test_a_proof_that_is_more_arithmetic_than_a_checker_does_is_refused() -> None:
    """Gram matrices of 126 rows are read, but not sixteen times six of them."""
    problem = asked(Dragged(), circle())
    with pytest.raises(InputError, match=r"vehicle dragged: .* degree 8 in 5 states takes 16 times 6 Gram matrices"):
        sized(problem)


def test_what_the_checker_does_not_do_is_no_matter_of_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    """It ends the certification of any funnel, and no other solver is tried."""
    problem, funnel = asked(Omnidirectional(), circle(laps=0.5)), np.diag([1 / 0.25**2] * 3)
    monkeypatch.setattr(enclosure.Budget, "__init__", lambda self, *_: setattr(self, "left", 20_000))
    monkeypatch.setattr(program, "solver_named", lambda *_: pytest.fail("another solver was tried"))
    found = certify(problem, [Funnel(CONTRACTING, funnel, 0.0, problem.path.segments[0].duration)])
    assert (found.verdict, found.final) == (Verdict.INCONCLUSIVE, True)
    assert "more arithmetic than the checker takes" in found.message
