"""What no funnel has a proof of is known before anything is learned, and not tried three times."""

from dataclasses import dataclass, replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from cfcheck.exact.enclosure import Budget, TooLarge
from cfcheck.reader import Broken
from cfjax import synthesis
from cfjax.certificate import Certification, posed, require_posable, statement_of
from cfjax.certificate.prover import NotProven, _not_possible
from cfjax.errors import InputError
from cfjax.funnel import Funnel, template_named
from cfjax.learner import Learned
from cfjax.options import Options
from cfjax.problem import Interval, Problem, Twist, Vehicle, ball, circle, ellipse, figure_eight, tube
from cfjax.result import WorstPlace
from cfjax.verdict import Verdict


@dataclass(frozen=True)
class Wobbling(Vehicle):
    """Six states, and a product of functions of them in every rate."""

    factors: int = 4
    name: ClassVar[str] = "wobbling"
    internal_names: ClassVar[tuple[str, ...]] = ("v", "a", "b")
    input_names: ClassVar[tuple[str, ...]] = ("turn", "thrust")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        return Interval(-4.0, 4.0), Interval(-4.0, 4.0)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        return Twist(inputs[0], 0.0, internal[0])

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        _, a, b = internal
        product = 1.0
        for k in range(self.factors):
            product = product * jnp.cos(a + k * b)
        return inputs[1] * product, -a, -b

    def reference(self, turn_rate, speed) -> tuple[Twist, tuple]:
        return Twist(turn_rate, 0.0, speed), (speed, 0.0 * speed, 0.0 * speed)


def wobbling(factors: int) -> Problem:
    return Problem(circle(), vehicle=Wobbling(factors), inlet=ball(0.1, 6), goal=ball(0.3, 6))


def refused(problem: Problem, beta_inner: float | None = None) -> str:
    """The line, or nothing."""
    try:
        require_posable(problem, statement_of(problem), template_named("contracting"), 0.9, beta_inner)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    "problem",
    [Problem(circle()), Problem(figure_eight()), Problem(tube(1.0, Interval(1.0, 30.0), 1.0), goal=ball(1.0))],
    ids=lambda problem: problem.path.name,
)
def test_what_has_proofs_is_not_refused(problem: Problem) -> None:
    assert refused(problem) == refused(problem, 0.1) == ""


def test_a_vehicle_of_too_many_terms_is_refused() -> None:
    assert "takes Gram matrices of 5005 rows, and a checker reads at most 128" in refused(wobbling(4))
    line = refused(wobbling(10))
    assert "already inside sets.inlet; got: a polynomial of the proof grows beyond what the checker takes" in line
    assert "\n" not in line


def test_a_pole_inside_the_inlet_is_refused() -> None:
    class Dividing(Wobbling):
        def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
            _, a, b = internal
            return inputs[1] / (0.05 + a), -a, -b

    assert "got: inv has a pole in the range of its argument" in refused(replace(wobbling(1), vehicle=Dividing()))


def test_more_funnels_than_a_certificate_holds_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    path = ellipse(segments=3)
    assert refused(Problem(path)) == ""
    monkeypatch.setattr(posed, "MOST_GRAM_ENTRIES", 20_000)
    count = len(path.distinct)
    assert "path ellipse: expected at most 1 distinct segments" in refused(Problem(path))
    assert f"got {count}; longer segments (path.segment_length)" in refused(Problem(path))


def test_nothing_is_learned_for_what_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cfjax.learner.by_gradient.learn_for", None)
    with pytest.raises(InputError, match="expected dynamics of which a proof can be put together"):
        synthesis.search(wobbling(4), Options())


@pytest.mark.parametrize(("final", "rounds"), [(True, 1), (False, 3)])
def test_a_reason_that_is_no_matter_of_the_funnel_ends_the_search(
    monkeypatch: pytest.MonkeyPatch, final: bool, rounds: int
) -> None:
    problem, learned = Problem(circle()), []
    funnel = Funnel(template_named("contracting"), np.eye(4), 0.0, problem.path.curve[0].duration)

    def learn_for(*_: object, **__: object) -> tuple[Problem, Learned]:
        learned.append(funnel)
        return problem, Learned((funnel,), 1.0, -1.0, (1.0,), 1)

    def certify(*_: object, **__: object) -> Certification:
        return Certification(Verdict.INCONCLUSIVE, "too large", funnels=(funnel,), final=final)

    monkeypatch.setattr("cfjax.learner.by_gradient.learn_for", learn_for)
    monkeypatch.setattr("cfjax.rounds.certify", certify)
    monkeypatch.setattr(synthesis.LearnCertifyLoop, "_worst", lambda *_: [WorstPlace(0, "d", 1.0, 0.0, (0.1,) * 4)])
    assert synthesis.search(problem, Options()).message == "too large"
    assert len(learned) == rounds


def test_what_is_too_large_is_final() -> None:
    with pytest.raises(TooLarge) as caught:
        Budget(1).spend(2)
    failure = _not_possible(caught.value, "here: ")
    assert isinstance(failure, NotProven) and failure.final
    pole = _not_possible(ValueError("a pole"), "here: ")  # a smaller funnel may have none
    assert isinstance(pole, NotProven) and not pole.final
    assert isinstance(_not_possible(Broken("not so"), ""), Broken)
