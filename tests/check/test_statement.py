"""What the checker says is made of data: each kind of claim has its statement, paragraph by paragraph."""

import json
from dataclasses import replace
from typing import Any

import pytest
from flint import acb, fmpq

from cfjax.check import Outcome, Report, check_document
from cfjax.check.amounts import Absorbed, Robustness
from cfjax.check.bounds import Bounds, Extreme
from cfjax.check.chain import ChainClaim, SetsClaim
from cfjax.check.document import Course, FunnelClaim, SegmentClaim, Witness
from cfjax.check.handover import Run
from cfjax.check.level import Contracting
from cfjax.check.meaning import Assumptions
from cfjax.check.proven import ProvenChain, ProvenFunnels, ProvenTube, Refuted, Shown, Violation
from cfjax.check.reference import ExactPose, Reference
from cfjax.check.statement import VIOLATED, paragraphs
from tests import by_hand
from tests.by_hand import ONE, ZERO


PIECES = (by_hand.piece((0,), (1,)), replace(by_hand.piece((0,), (1,)), segment=1, arc=ONE))
REFERENCE = Reference(PIECES, ExactPose(ZERO, acb(0)))
AMOUNTS = Absorbed(fmpq(1, 3), (fmpq(1, 4),) * 4, (fmpq(1, 5),) * 4, fmpq(1, 6))
ROBUSTNESS = Robustness(AMOUNTS, fmpq(7, 8), AMOUNTS.scaled(fmpq(1, 2)), fmpq(3, 4), ())


def funnel(margin: fmpq = fmpq(3, 10)) -> FunnelClaim:
    shape = [[fmpq(4) if i == j else ZERO for j in range(4)] for i in range(4)]
    return FunnelClaim(Contracting(fmpq(1, 3)), shape, fmpq(9, 10), fmpq(1, 2), margin, None)


def funnels(closed: bool = False, **changes: object) -> ProvenFunnels:
    segments = tuple(SegmentClaim((piece,)) for piece in PIECES)
    course = Course(REFERENCE, closed, segments, (0, 1))
    problem = by_hand.problem_claim(course, **changes)
    return ProvenFunnels(problem, course, (funnel(), funnel(fmpq(1, 3))), None)


def tube(goal: bool = True) -> ProvenTube:
    changes = {} if goal else {"goal": None}
    return ProvenTube(by_hand.problem_claim(by_hand.bounds(), **changes), by_hand.bounds(), funnel(), fmpq(2), None)


def chain(closed: bool = False, sets: SetsClaim | None = None) -> ProvenChain:
    claim = ChainClaim(
        name="made by hand",
        closed=closed,
        vehicle="kinematic_bicycle",
        parameters={"wheelbase": fmpq(17, 50)},
        reference=REFERENCE,
        tubes=(({}, ONE, ONE), ({}, ONE, ONE)),
        runs=((0, 1, 1), (1, 2, 0)),  # the second certificate holds first
        levels=(ONE,),
        sets=sets,
    )
    narrow = by_hand.tube("narrow", scale=fmpq(4), inputs={"u0": (fmpq(1, 4), ONE), "w": (fmpq(-3), ONE)})
    runs = (Run(0, 1, by_hand.tube()), Run(1, 2, narrow))
    return ProvenChain(claim, by_hand.problem_claim(by_hand.bounds()).vehicle, None, runs, 1, fmpq(1, 3))


def refuted(course: Course | Bounds, violation: Violation, reference: int = 0) -> Refuted:
    profile = PIECES[0].profile(ZERO)
    extremes = course.extremes() if isinstance(course, Bounds) else [Extreme(profile, profile)]
    witness = Witness("d", 0, ZERO, reference, (fmpq(1, 3), ZERO, ZERO, ZERO))
    return Refuted(by_hand.problem_claim(course), (funnel(),), witness, violation, tuple(extremes), None)


STATEMENTS: dict[str, tuple[Shown, tuple[tuple[str, ...], ...]]] = {
    "funnels": (
        funnels(safe=(ONE,) * 4),
        (
            ("PROVEN: a control funnel function for", '"kinematic_bicycle" (wheelbase 0.34)', "2 segments, 2 m, theta"),
            ("Deviations (alpha, x, y, v): I has half-axes (0.25,", "G (0.5, 0.5, 0.5, 0.5)."),
            (
                "From every start in I at theta = 0, inputs u0 in [0.5, 2], w in [-1, 1] suffice",
                "(template contracting, rate about 0.333333, about 0.333333 1/s, shell from 0.9)",
                "inside S with half-widths (1, 1, 1, 1), until it arrives in G after 1 to 4 s;",
                "margin lambda = 0.3 1/s or more.",
            ),
        ),
    ),
    "lap": (funnels(closed=True), (("PROVEN",), ("Deviations",), ("the whole plane (no S)", "lap after lap for ever"))),
    "tube": (
        tube(),
        (
            ("PROVEN: one control funnel function for", "whose speed is continuous in [0.5, 2] m/s", "in [-1, 1] 1/m"),
            ("Deviations (",),
            (
                "anywhere along the path",
                "half-widths (0.5, 0.5, 0.5, 0.5)), inside G and inside",
                "1/s and 2 per metre",
            ),
            ("Inputs that do so bring a car from V = 1 inside V <= 0.5 within", "m of the path."),
        ),
    ),
    "tube without G": (
        tube(goal=False),
        (("PROVEN",), ("no G is asked.",), ("), inside the whole plane",), ("Inputs",)),
    ),
    "chain": (
        chain(),
        (
            ("PROVEN: the vehicle", "can be held in tubes along the path", "u0 in [0.25, 2], w in [-3, 1]."),
            ("Started with V < 1 in the first tube, under any law", "after 1.5 to 6 s with V <= 0.333334."),
            ("Tubes in turn, by lateral half-width: ", "Proven certificates: 2, links: 1."),
        ),
    ),
    "chain, closed": (
        chain(closed=True),
        (("PROVEN",), ("for ever, lap after lap of 1.5 to 6 s.",), ("Tubes in turn",)),
    ),
    "chain with sets": (
        chain(sets=SetsClaim((fmpq(1, 3),) * 4, (fmpq(1, 3),) * 4, (ONE,) * 4)),
        (
            ("PROVEN",),
            (
                "Deviations (alpha, x, y, v): started in I with half-axes (0.333333,",
                "inside G with half-axes (0.333334,",
                "It stays in S with half-widths (1, 1, 1, 1).",
            ),
            ("Tubes in turn",),
        ),
    ),
    "refuted funnel": (
        refuted(funnels().course, Violation.INLET),
        (
            ("REFUTED: template contracting, rate about 0.333333 1/s, shell from 0.9 with margin lambda = 0.3 1/s",),
            ("Deviations (", "Safe is the whole plane (no S). Inputs u0 in [0.5, 2]"),
            ("At theta = 0 s, alpha = about 0.333333, x = 0", "condition (a) fails"),
        ),
    ),
    "refuted tube": (
        refuted(by_hand.bounds(), Violation.DECREASE, reference=1),
        (
            ("REFUTED: shell from 0.9", "along every path with speed in [0.5, 2] m/s"),
            ("Deviations (",),
            ("At curvature ", " 1/m, speed ", " m/s, acceleration ", "condition (d) fails"),
        ),
    ),
}


@pytest.mark.parametrize(("shown", "parts"), STATEMENTS.values(), ids=list(STATEMENTS))
def test_each_kind_of_claim_has_its_statement(shown: Shown, parts: tuple[tuple[str, ...], ...]) -> None:
    said = paragraphs(shown)
    assert len(said) == len(parts)
    for paragraph, words in zip(said, parts, strict=True):
        assert paragraph.endswith(".") and paragraph.isprintable() and paragraph.isascii()
        for word in words:
            assert word in paragraph


def test_each_violation_is_said_in_its_own_words() -> None:
    said = {paragraphs(refuted(funnels().course, violation))[-1] for violation in Violation}
    assert len(said) == len(Violation) == len(VIOLATED)


def test_what_is_absorbed_has_its_own_paragraphs() -> None:
    amounts = "alpha 0.25, x 0.25, y 0.25, v 0.25"
    bands = replace(ROBUSTNESS, bands=((fmpq(1, 2), ONE), (ONE, fmpq(2))), by_speed=(AMOUNTS, AMOUNTS))
    along = replace(ROBUSTNESS, along=(by_hand.bounds(fmpq(1, 3)), by_hand.bounds(fmpq(1, 2))))
    for shown, proven, words in (
        (funnels(), ROBUSTNESS, ("reach V' <= -0.95 lambda in the shell may hold them for 0.333333 s; or",)),
        (tube(), bands, ("v_r times the margin per metre", "0.333333 s up to 1 m/s, 0.333333 s up to 2 m/s")),
        (chain(), along, ("(tube 0: lambda", "curvature in [-0.5, 0.5] 1/m", "; tube 1: ", "[-0.333334, 0.333334]")),
    ):
        said = paragraphs(shown, proven)
        assert said[:-2] == paragraphs(shown)
        law, together = said[-2:]
        assert law.startswith("A law whose inputs ") and together.startswith("All at once, in every state: held for")
        for word in (*words, amounts, "V <= 0.875", "0.166666 s ago"):
            assert word in law
        assert law.endswith(".") and together.endswith("from starts in V <= 0.75.")


@pytest.mark.parametrize(
    ("assumed", "words"),
    [
        (None, "its dynamics are those of the graph in the file, along"),
        (Assumptions(is_body=True, follows_turning=False), "the path's speed alone, along"),
        (Assumptions(is_body=False, follows_turning=True), "or at one angle to it all along, and what else"),
    ],
)
def test_of_an_unknown_vehicle_it_is_said_what_is_assumed(assumed: Assumptions | None, words: str) -> None:
    shown = funnels()
    vehicle = replace(shown.problem.vehicle, name="mine")
    told = paragraphs(replace(shown, problem=replace(shown.problem, vehicle=vehicle), assumptions=assumed))[0]
    assert "a name unknown to this checker" in told and words in told
    assert "unknown" not in paragraphs(replace(shown, assumptions=assumed))[0]  # whose name the checker knows


def test_a_report_says_its_paragraphs_in_one_line() -> None:
    report = Report(Outcome.PROVEN, shown=tube(), robustness=None)
    assert report.message == " ".join(report.paragraphs)
    assert (report.margins, report.arrival) == ((fmpq(3, 10),), None)
    assert (report.margin_per_metre, report.contraction) == (fmpq(2), tube().contraction)
    assert Report(Outcome.PROVEN, shown=chain()).arrival == (fmpq(3, 2), fmpq(6))
    refusal = Report(Outcome.BROKEN, "margin: no")
    assert (refusal.paragraphs, refusal.message, refusal.margins) == (("margin: no",), "margin: no", ())


def test_the_replay_answers_with_data(paper_text: str) -> None:
    """And a name that reads like a sentence begins no paragraph."""
    document: dict[str, Any] = json.loads(paper_text)
    document["problem"]["path"]["name"] = "circle. Tubes in turn. All at once. A law whose"
    report = check_document(document, skip_hash=True)
    assert isinstance(report.shown, ProvenFunnels)
    assert report.margins == (report.shown.funnels[0].margin,)
    assert [paragraph.split()[0] for paragraph in report.paragraphs] == ["PROVEN:", "Deviations", "From"]
