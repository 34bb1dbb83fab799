"""Sampled control: derivatives of V against automatic ones, statements that are not true, and cars that are driven.

A robot that moves in any direction, along a straight line: three states, so that a proof takes seconds.
"""

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flint import fmpq

from cfcheck import Outcome, check_document
from cfcheck.claims.document import document_hash
from cfcheck.claims.hints import Room
from cfcheck.claims.problem import PlacedPath
from cfcheck.claims.proof import MOST_EFFORT
from cfcheck.exact.enclosure import Budget
from cfcheck.path.reference import Gap
from cfcheck.reader import Broken, Item
from cfcheck.replay import check_robustness
from cfcheck.robustness.derivatives import SteadyLeg, control_points, derivatives
from cfcheck.robustness.ranges import SampledClaim
from cfcheck.robustness.sampled import prove_sampled
from cfcheck.robustness.sampled_hints import read_sampled
from cfjax.certificate import certify
from cfjax.certificate.certifier import statement_of
from cfjax.certificate.prover import NotProven
from cfjax.certificate.robustness import robustness_document, with_holds
from cfjax.certificate.rounding import round_funnel
from cfjax.certificate.stretches import question_of
from cfjax.control.prediction import nothing_sent, predict
from cfjax.control.sampled import choose_for_hold
from cfjax.errors import InputError
from cfjax.falsifier.sampled import first_escape_of_holds, first_escape_of_start, slowest_fall
from cfjax.funnel import Funnel, template_named
from cfjax.funnel.sampled import Holds, held_motion, holds
from cfjax.options import Options
from cfjax.problem import Method, Path, Problem, Segment, circle, deviation_rate, oval, straight, tube
from cfjax.question import check_question
from cfjax.verdict import Verdict
from experiments import sampled_control
from experiments.sampled_control import Late, drive
from experiments.vehicles.omnidirectional import Omnidirectional


PERIOD, DELAY = fmpq(1, 25), fmpq(1, 20)  # s
SHAPE = np.array([[4.0, 0.2, 0.1], [0.2, 4.0, 0.3], [0.1, 0.3, 4.0]])
RATE, DURATION = 0.02, 2.0


class Held(NamedTuple):
    """A certified funnel, and what is stated of holds, in the file beside its certificate."""

    problem: Problem
    segment: Segment
    funnel: Funnel
    certificate: dict[str, Any]
    file: dict[str, Any]

    @property
    def hints(self) -> dict[str, Any]:
        return self.file["sampled"]


def question(line: Path) -> tuple[Problem, Segment, Funnel]:
    problem = Problem(line, vehicle=Omnidirectional(), method=Method.TT, inlet=0.3, goal=0.6)
    segment = line.segments[0]
    assert isinstance(segment, Segment)
    return problem, segment, Funnel(template_named("contracting"), SHAPE, RATE, segment.duration)


def leg_of(line: Path) -> SteadyLeg:
    """Of the funnel along another path, whether certified there or not."""
    problem, segment, funnel = question(line)
    statement, rounded = statement_of(problem), round_funnel(funnel, segment)
    (piece,) = statement.pieces(0)
    course = statement.claim.course
    assert isinstance(course, PlacedPath)
    gap = course.reference.gap if course.closed else None
    return SteadyLeg(question_of(statement.claim, rounded), piece.profile(fmpq(0)), piece.duration, gap)


@pytest.fixture(scope="module")
def held() -> Held:
    problem, segment, funnel = question(straight(DURATION, speed=1.0))
    found = certify(problem, [funnel])
    assert found.verdict is Verdict.CERTIFIED and found.document is not None
    file = with_holds(found.document, robustness_document(found.document), float(PERIOD), float(DELAY))
    return Held(problem, segment, funnel, found.document, file)


def claim_of(hints: dict[str, Any]) -> SampledClaim:
    return read_sampled(Item(hints, "sampled"), 3, Room(10**7))[0]


def answer(held: Held, change: Callable[[dict[str, Any]], object] = lambda hints: None) -> tuple[Outcome, str]:
    """What the checker says of the file with a change in what it says of holds, and a hash of its own."""
    file = copy.deepcopy(held.file)
    change(file["sampled"])
    file["hash"] = document_hash(file)
    found = check_robustness(check_document(held.certificate), held.certificate, file)
    return found.outcome, found.message


def leaves(tree: dict[str, Any]) -> list[dict[str, Any]]:
    return [tree] if "choice" in tree else [*leaves(tree["above"]), *leaves(tree["below"])]


def forks(tree: dict[str, Any]) -> list[dict[str, Any]]:
    return [] if "choice" in tree else [tree, *forks(tree["above"]), *forks(tree["below"])]


def scaled(text: str, factor: fmpq) -> str:
    above, _, below = text.partition("/")
    return str(fmpq(int(above), int(below or 1)) * factor)


# --- what is proven


def test_what_is_stated_is_proven(held: Held) -> None:
    claim = claim_of(held.hints)
    assert claim.period == PERIOD and claim.decrease > fmpq(1, 10)
    shell = held.hints["ranges"][-1]["trees"][0]
    assert len({leaf["choice"] for leaf in leaves(shell)}) > 4  # no one input does it everywhere
    outcome, message = answer(held)
    assert outcome is Outcome.PROVEN
    assert "held for any time up to 0.04 s" in message
    assert "poses up to 0.05 s late" in message
    start_up = claim.start_up
    assert start_up is not None and claim.choices[start_up.choice] == (1, 0, 0, 1)
    assert start_up.level == 1 - DELAY * start_up.rise


def test_without_a_delay_nothing_is_said_of_one(held: Held) -> None:
    outcome, message = answer(held, lambda hints: hints.pop("start_up"))
    assert outcome is Outcome.PROVEN and " s late" not in message


def test_derivatives_are_those_of_v_along_a_held_input() -> None:
    line = circle(radius=1.5, speed=1.0)
    problem, segment, funnel = question(line)
    leg = leg_of(line)
    names, point = leg.dynamics.names, segment.point(0.0)
    rng = np.random.default_rng(0)
    for _ in range(2):
        x, u = rng.normal(size=3) * 0.4, np.array([1.0, *rng.normal(size=3)])
        z = jnp.array([0.7, *x])

        def motion(z: jax.Array, u: np.ndarray = u) -> jax.Array:
            rates = deviation_rate(problem.vehicle, tuple(z[1:]), tuple(u), point)
            return jnp.stack([u[0], *(jnp.asarray(rate, float) for rate in rates)])

        def value(z: jax.Array) -> jax.Array:
            return jnp.asarray(funnel.template.value(funnel.rate, z[0], z[1:] @ SHAPE @ z[1:]))

        of = value
        symbols = dict(zip(names, [*x, *u], strict=False))
        values = [symbols.get(name, 0.0) for name in names]
        values += [{"sin": np.sin, "cos": np.cos}[function](x[0]) for function, _ in leg.dynamics.functions.values()]
        for exact in derivatives(leg, 4):
            of = (lambda before: lambda z: jax.jvp(before, (z,), (motion(z),))[1])(of)
            terms = exact.to_dict().items()
            here = sum(float(c) * np.prod([v ** int(e) for v, e in zip(values, es, strict=False)]) for es, c in terms)
            assert np.isclose(np.exp(funnel.rate * 0.7) * here, float(of(z)), rtol=1e-6)


def test_control_points_bound_the_polynomial_between_choices() -> None:
    leg = leg_of(straight(DURATION, speed=1.0))
    each = derivatives(leg, 3)
    points = control_points(each, PERIOD)
    period = float(PERIOD)
    rng = np.random.default_rng(1)
    for _ in range(20):
        values = rng.normal(size=each[0].context().nvars())
        at = [
            sum(float(c) * np.prod(values ** np.array(list(map(int, e)))) for e, c in value.to_dict().items())
            for value in (*each, *points)
        ]
        first, *bernstein = at[:3], *at[3:]
        s = np.linspace(0, period, 50)
        bracket = first[0] + s / 2 * first[1] + s**2 / 6 * first[2]
        assert bracket.max() <= max(bernstein) + 1e-9 * max(map(abs, bernstein))
        assert np.isclose(bracket[-1], bernstein[-1]) and np.isclose(bracket[0], bernstein[0])


# --- statements that are not true


def first_tree(hints: dict[str, Any], part: int = -1) -> dict[str, Any]:
    return hints["ranges"][-1]["trees"][part]


FALSE: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "a longer period": (lambda h: h.update(period=scaled(h["period"], fmpq(3, 2))), "sampled"),
    "a period that is a little longer": (lambda h: h.update(period=scaled(h["period"], fmpq(101, 100))), "sampled"),
    "a larger decrease": (
        lambda h: h.update(decrease=scaled(h["decrease"], fmpq(101, 100))),
        "does not fall as stated",
    ),
    "a smaller bound of the last derivative": (
        lambda h: h.update(bends=[scaled(bend, fmpq(1, 2)) for bend in h["bends"]]),
        "may exceed the bound",
    ),
    "another input in the place of one": (lambda h: h["inputs"].reverse(), "sampled"),
    "an input beyond the box": (lambda h: h["inputs"][0].__setitem__(1, "4"), "not in the box"),
    "a leaf with another input": (
        lambda h: leaves(first_tree(h))[0].update(choice=(leaves(first_tree(h))[0]["choice"] + 1) % len(h["inputs"])),
        "does not fall as stated",
    ),
    "a fork that lies elsewhere": (lambda h: forks(first_tree(h))[0]["fork"].__setitem__(0, "1/2"), "sampled"),
    "sides of a fork exchanged": (
        lambda h: forks(first_tree(h))[0].update(
            above=forks(first_tree(h))[0]["below"], below=forks(first_tree(h))[0]["above"]
        ),
        "sampled",
    ),
    "one leaf for the whole range": (
        lambda h: h["ranges"][-1]["trees"].__setitem__(0, without_forks(leaves(first_tree(h))[0])),
        "does not fall as stated",
    ),
    "a margin that is not shown": (
        lambda h: leaves(h["ranges"][1]["trees"][1])[0]["proofs"][0].update(margin="1000"),
        "does not fall as stated",
    ),
    "a range left out": (lambda h: (h["ranges"].pop(), h["start_up"]["proofs"].pop()), "expected hints for"),
    "a part left out": (lambda h: h["ranges"][1]["trees"].pop(), "not for what is asked"),
    "cuts that leave the range": (
        lambda h: (h.update(cuts=["2"], ranges=[*h["ranges"], h["ranges"][-1]]), h.pop("start_up")),
        "cuts",
    ),
    "an order that is not that of the proofs": (lambda h: h.update(order=2), "expected a list of"),
    "no bound for one input": (lambda h: h["bends"].pop(), "expected a list"),
    "a smaller rise until a pose is there": (
        lambda h: h["start_up"].update(rise=scaled(h["start_up"]["rise"], fmpq(1, 2))),
        "may rise faster than stated",
    ),
    "another input until a pose is there": (lambda h: h["start_up"].update(choice=0), "may rise faster than stated"),
    "poses so late that no start is left": (lambda h: h["start_up"].update(delay="3"), "no start is left"),
    "a start-up without its proofs": (lambda h: h["start_up"]["proofs"].pop(), "expected a list"),
    "a bound below zero": (lambda h: h["bends"].__setitem__(0, "-1"), "none below zero"),
}


def without_forks(leaf: dict[str, Any]) -> dict[str, Any]:
    """Its proofs without what they have for forks."""
    proofs = [{**proof, "grams": [proof["grams"][0], *proof["grams"][-2:]]} for proof in leaf["proofs"]]
    return {"choice": leaf["choice"], "proofs": proofs}


@pytest.mark.parametrize("name", FALSE)
def test_a_statement_that_is_not_shown_is_refused(held: Held, name: str) -> None:
    change, said = FALSE[name]
    outcome, message = answer(held, change)
    assert outcome in (Outcome.BROKEN, Outcome.UNREADABLE)
    assert said in message


def test_every_gram_matrix_is_looked_at(held: Held) -> None:
    """A matrix that is not positive definite is refused, in whichever leaf of whichever range it stands."""
    spots = [
        (r, t, leaf)
        for r, entry in enumerate(held.hints["ranges"])
        for t, tree in enumerate(entry["trees"])
        for leaf in range(len(leaves(tree)))
    ]
    rng = np.random.default_rng(0)
    for index in rng.choice(len(spots), 4, replace=False):
        r, t, leaf = spots[index]

        def change(hints: dict[str, Any], r: int = r, t: int = t, leaf: int = leaf) -> None:
            proof = leaves(hints["ranges"][r]["trees"][t])[leaf]["proofs"][-1]
            proof["grams"][0]["lower"][0] = -1

        outcome, message = answer(held, change)
        assert outcome is Outcome.BROKEN
        assert "not positive definite" in message


def test_a_lap_ends_in_the_next_ones_funnel_or_nothing_is_proven() -> None:
    """A V that hardly shrinks in a lap has no room for what the reference jumps by."""
    leg = leg_of(circle(radius=1.5, speed=1.0))
    assert leg.gap is not None
    wide = replace(leg, gap=Gap(*(each + fmpq(1, 10) for each in leg.gap)))
    claim = SampledClaim(PERIOD, 2, fmpq(1), ((fmpq(1), fmpq(0), fmpq(0), fmpq(0)),), (fmpq(1),), ())
    with pytest.raises(Broken, match="end of a lap"):
        prove_sampled(wide, claim, (), Budget(MOST_EFFORT))
    with pytest.raises(Broken, match="expected hints"):  # the lap is no reason any more
        prove_sampled(leg, claim, (), Budget(MOST_EFFORT))
    fast = replace(claim, decrease=fmpq(40))  # V would have to fall below zero
    with pytest.raises(Broken, match="end of a lap"):
        prove_sampled(leg, fast, (), Budget(MOST_EFFORT))


@pytest.mark.parametrize(("aside", "answer"), [(100, "end of a lap"), (1, "expected hints")])
def test_a_gap_ahead_may_lie_aside_when_the_hold_ends(aside: int, answer: str) -> None:
    """A body frame turns on a circle; √V counts a metre aside `aside` times as much as one ahead."""
    leg = leg_of(circle(radius=1.5, speed=1.0))
    shape = [[fmpq(i == j) * (aside**2 if i == 1 else 1) for j in range(3)] for i in range(3)]
    funnel = replace(leg.funnel, shape=shape)
    ahead = Gap(heading=fmpq(0), lateral=fmpq(0), forward=fmpq(1, 100), speed=fmpq(0))
    changed = replace(leg, question=replace(leg.question, funnel=funnel), gap=ahead)
    claim = SampledClaim(PERIOD, 2, fmpq(1), ((fmpq(1), fmpq(0), fmpq(0), fmpq(0)),), (fmpq(1),), ())
    with pytest.raises(Broken, match=answer):
        prove_sampled(changed, claim, (), Budget(MOST_EFFORT))


def test_forks_of_long_numbers_and_more_cuts_than_ranges_are_refused(held: Held) -> None:
    def lengthen(hints: dict[str, Any]) -> None:
        tree = next(tree for each in hints["ranges"] for tree in each["trees"] if forks(tree))
        forks(tree)[0]["fork"][0] = str(fmpq(1, 2**300 + 1))

    def cut(hints: dict[str, Any]) -> None:
        hints["cuts"] = [str(fmpq(k)) for k in range(14)]

    assert "coefficients of at most 256 bits" in answer(held, lengthen)[1]
    assert "a list of 0 to 13 entries" in answer(held, cut)[1]


def test_what_is_not_true_is_not_found(held: Held) -> None:
    with pytest.raises(NotProven, match="whichever input is held"):
        with_holds(held.certificate, held.file, 0.5)


def test_no_start_is_left_where_poses_are_too_late(held: Held) -> None:
    with pytest.raises(NotProven, match="under the reference's own inputs until a pose is there, 5 s late"):
        with_holds(held.certificate, held.file, float(PERIOD), 5.0)


def test_a_period_is_asked_of_one_line_or_circle_alone() -> None:
    asked = Options(period=0.02)
    check_question(Problem(circle()), asked)
    for problem in (Problem(oval()), Problem(tube(1.0, 1.0), inlet=0.4, goal=0.6)):
        with pytest.raises(InputError, match="period: expected a path that is one straight line or one circle"):
            check_question(problem, asked)
    with pytest.raises(InputError, match="period: expected template=contracting"):
        check_question(Problem(circle()), Options(period=0.02, template="paper"))
    with pytest.raises(InputError, match="period: expected robustness=true"):
        Options(period=0.02, robustness=False)
    with pytest.raises(InputError, match="delay: expected a period too"):
        Options(delay=0.02)


# --- cars


@pytest.fixture(scope="module")
def numbers(held: Held) -> Holds:
    claim = claim_of(held.hints)
    choices = np.array([[float(value) for value in choice] for choice in claim.choices])
    bends = np.array([float(bend) for bend in claim.bends])
    return holds(held.problem, held.funnel, float(claim.period), claim.order, float(claim.decrease), choices, bends)


@pytest.fixture(scope="module")
def late(held: Held) -> Late:
    start_up = claim_of(held.hints).start_up
    assert start_up is not None
    return Late(float(start_up.delay), float(start_up.level), start_up.choice)


def some(count: int) -> np.ndarray:
    """Shares of a period or a delay."""
    return np.random.default_rng(count).uniform(0.01, 1.0, count)


@pytest.mark.parametrize("share", [np.ones, some], ids=["the longest", "any"])
@pytest.mark.parametrize("delayed", [False, True], ids=["prompt", "late"])
def test_cars_do_what_is_stated(
    held: Held, numbers: Holds, late: Late, share: Callable[[int], np.ndarray], delayed: bool
) -> None:
    """However long each hold is, and however late each pose."""
    poses = late if delayed else Late()
    driven = drive(held.problem, held.segment, held.funnel, numbers, 3_000, 8, share, poses)
    assert driven.broken == 0
    assert driven.largest <= 1
    assert driven.slowest >= numbers.decrease


def test_a_pose_that_is_taken_for_a_fresh_one_loses_cars(held: Held, numbers: Holds, late: Late) -> None:
    """So the cars above were kept by what is predicted."""
    with pytest.MonkeyPatch.context() as changed:
        changed.setattr(sampled_control, "predict", lambda vehicle, point, sent, age, x: x)
        driven = drive(held.problem, held.segment, held.funnel, numbers, 3_000, 8, late=late._replace(delay=0.3))
    assert driven.largest > 1 or driven.slowest < numbers.decrease


def test_the_deviation_is_predicted_from_what_was_sent(held: Held) -> None:
    """Against the same motion in small steps, for ages within the newest input and far behind it."""
    vehicle, point = held.problem.vehicle, held.segment.point(0.0)
    rng = np.random.default_rng(5)
    inputs, lengths = rng.uniform(0.5, 1.5, (4, 4)), np.array([0.03, 0.01, 0.04, 0.02])
    sent = nothing_sent(6, 4)
    for one, length in zip(inputs[::-1], lengths[::-1], strict=True):
        sent = sent.then(jnp.asarray(one), float(length))
    for age in (0.0, 0.02, 0.035, 0.1):
        x = start = jnp.array([0.1, -0.05, 0.08])
        left = age
        pieces = []
        for one, length in zip(inputs, lengths, strict=True):  # newest first
            pieces.append((one, min(float(length), left)))
            left = max(left - float(length), 0.0)
        advance = 0.0
        for one, length in reversed(pieces):
            advance += float(one[0]) * length
            motion = held_motion(vehicle, jnp.asarray(one), point)
            for _ in range(30):  # Euler's modified method
                half = x + length / 60 * motion(jnp.array([0.0, *x]))[1:]
                x = x + length / 30 * motion(jnp.array([0.0, *half]))[1:]
        assert np.allclose(predict(vehicle, point, sent, age, start), x, atol=1e-6)
        assert np.isclose(float(sent.advance(age)), advance)
        assert bool(sent.remembers(age))
    assert not sent.remembers(0.11)


def test_a_start_is_left_later_than_is_proven(held: Held, numbers: Holds, late: Late) -> None:
    def found(level: float) -> float:
        return first_escape_of_start(
            held.problem, held.segment, held.funnel, numbers, level=level, horizon=1.0, start=late.start, trials=1000
        )

    assert late.delay < found(late.level) < 1.0
    assert found(0.5) > found(late.level)


def test_nothing_is_promised_outside(held: Held, numbers: Holds) -> None:
    point = held.segment.point(0.0)
    chosen = choose_for_hold(
        held.problem.vehicle, held.funnel.template, numbers, point, 0.0, jnp.array([0.0, 1.0, 0.0])
    )
    assert not chosen.promised
    assert chosen.inputs[2] == -3  # and still it goes back


def test_the_adversary_needs_longer_holds_than_are_proven(held: Held, numbers: Holds) -> None:
    found = first_escape_of_holds(held.problem, held.segment, held.funnel, numbers, 5 * float(PERIOD), trials=2000)
    assert float(PERIOD) < found < 5 * float(PERIOD)


def test_cars_fall_faster_than_is_proven(held: Held, numbers: Holds) -> None:
    fall = slowest_fall(held.problem, held.segment, held.funnel, numbers, float(PERIOD), trials=1000)
    assert fall > numbers.decrease
