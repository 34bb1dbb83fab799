"""What was compiled once serves again: other numbers are no other program."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax
import pytest

from cfjax import Options, Problem, circle, synthesize
from cfjax.ahead import compile_ahead
from cfjax.certificate import proof_size, statement_of
from cfjax.funnel import Contracting
from cfjax.problem import KinematicBicycle
from cfjax.synthesis import drive, harden, search


COMPILED = "/jax/core/compile/backend_compile_duration"
OPTIONS = Options(cars=100, restarts=2, rounds=1)


@contextmanager
def compilations() -> Iterator[list[str]]:
    """Of what, while this is open."""
    found: list[str] = []
    is_open = [True]

    def listen(event: str, duration_secs: float, **kwargs: str | int) -> None:
        if is_open[0] and event == COMPILED:
            found.append(str(kwargs.get("fun_name", event)))

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield found
    finally:
        is_open[0] = False  # JAX has no public way to take a listener back


@pytest.fixture(scope="module")
def first() -> None:
    """A first run; and something that nobody has compiled yet is seen to be compiled."""
    harden(synthesize(Problem(circle(), inlet=0.3, goal=0.5, safe=(1, 1, 1, 3)), OPTIONS), OPTIONS)
    with compilations() as compiled:
        jax.jit(lambda value: value + 1)(0.0)
    assert len(compiled) == 1


@pytest.mark.slow
@pytest.mark.usefixtures("first")
@pytest.mark.parametrize(
    "problem",
    [
        Problem(circle(), inlet=0.3, goal=0.5, safe=(1, 1, 1, 3)),
        Problem(circle(radius=2.0, speed=1.8), inlet=0.25, goal=0.45, safe=(0.9, 1, 1.1, 3), timing=(0.6, 1.8)),
    ],
    ids=["the same", "other numbers"],
)
def test_a_second_run_compiles_nothing(problem: Problem) -> None:
    """Learner, falsifier, solver, robustness and cars."""
    with compilations() as compiled:
        result = synthesize(problem, OPTIONS)
        harden(result, OPTIONS)
    assert result.margin_certified
    assert not compiled


@pytest.mark.slow
def test_what_follows_on_learning_can_be_compiled_ahead() -> None:
    """Proof, robustness and cars of a vehicle of its own: afterwards only learner and falsifier are compiled."""
    problem = Problem(circle(), inlet=0.3, goal=0.5, safe=(1, 1, 1, 3), vehicle=KinematicBicycle(wheelbase=0.41))
    size = proof_size(problem, statement_of(problem), Contracting(), OPTIONS.beta_lower)
    assert size is not None
    with compilations() as ahead:
        compile_ahead(problem, size.shapes, OPTIONS).join()
    assert ahead
    result = search(problem, OPTIONS)
    with compilations() as compiled:
        harden(result, OPTIONS)
        drive(result, OPTIONS)
    assert result.margin_certified
    assert not compiled
