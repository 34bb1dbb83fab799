"""What the checker says is made of data: each kind of claim has its statement, heading by heading."""

import json
from dataclasses import replace
from typing import Any

import pytest
from flint import acb, fmpq

from cfjax.check import Outcome, Report, check_document
from cfjax.check.amounts import Absorbed, Robustness
from cfjax.check.bounds import Bounds, Extreme
from cfjax.check.chain import ChainClaim, SetsClaim
from cfjax.check.clearance import FootprintClaim, ObstacleClaim
from cfjax.check.document import Course, FunnelClaim, SegmentClaim, Witness
from cfjax.check.handover import Run
from cfjax.check.level import Contracting
from cfjax.check.meaning import Assumptions
from cfjax.check.proven import ProvenChain, ProvenFunnels, ProvenTube, Refuted, Shown, Violation
from cfjax.check.reference import ExactPose, Reference
from cfjax.check.statement import VIOLATED, sections
from cfjax.check.surroundings import Surroundings
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


STATEMENTS: dict[str, tuple[Shown, dict[str, tuple[str, ...]]]] = {
    "funnels": (
        funnels(safe=(ONE,) * 4),
        {
            "PROVEN": ("a control funnel function along a path.",),
            "vehicle": ('"kinematic_bicycle" (wheelbase 0.34); a car by its rear axle,', "w is the tangent of its"),
            "path": ("2 segments, 2 m, theta",),
            "sets": (
                "of deviations alpha (rad), x (m), y (m), v (m/s); I with half-axes (0.25,",
                "G with half-axes (0.5, 0.5, 0.5, 0.5); S with half-widths (1, 1, 1, 1).",
            ),
            "guarantee": (
                "from every start in I at theta = 0, inputs u0 in [0.5, 2], w in [-1, 1] suffice",
                "V <= 1, inside S, until it arrives in G after 1 to 4 s;",
                "template contracting, rate about 0.333333, about 0.333333 1/s, shell from 0.9;",
                "margin lambda = 0.3 1/s or more.",
            ),
        },
    ),
    "lap": (
        funnels(closed=True),
        {
            "PROVEN": (),
            "vehicle": (),
            "path": (),
            "sets": ("no S: the whole plane is safe.",),
            "guarantee": ("V <= 1, until it arrives", "lap after lap for ever;"),
        },
    ),
    "tube": (
        tube(),
        {
            "PROVEN": ("one control funnel function for every path within bounds.",),
            "vehicle": (),
            "path": ("position, heading and speed are continuous; speed in [0.5, 2] m/s; curvature in [-1, 1] 1/m,",),
            "sets": ("G with half-axes",),
            "guarantee": (
                "anywhere along the path",
                "V <= 1, inside G, for ever;",
                "half-widths (0.5, 0.5, 0.5, 0.5);",
                "1/s and 2 per metre",
                "inputs that do so bring a car from V = 1 inside V <= 0.5 within",
            ),
        },
    ),
    "tube without G": (
        tube(goal=False),
        {"PROVEN": (), "vehicle": (), "path": (), "sets": ("no G is asked",), "guarantee": ("V <= 1, for ever;",)},
    ),
    "chain": (
        chain(),
        {
            "PROVEN": ("held by tubes in turn",),
            "vehicle": (),
            "path": ('"made by hand", whose 2 pieces of 2 m',),
            "guarantee": (
                "started with V < 1 in the first tube, under any law",
                "after 1.5 to 6 s with V <= 0.333334;",
                "inputs: u0 in [0.25, 2], w in [-3, 1];",
                "tubes in turn: 2, of lateral half-width 0.45",
                "proven certificates: 2, links: 1.",
            ),
        },
    ),
    "chain, closed": (
        chain(closed=True),
        {"PROVEN": (), "vehicle": (), "path": (), "guarantee": ("for ever, lap after lap of 1.5 to 6 s;",)},
    ),
    "chain with sets": (
        chain(sets=SetsClaim((fmpq(1, 3),) * 4, (fmpq(1, 3),) * 4, (ONE,) * 4)),
        {
            "PROVEN": (),
            "vehicle": (),
            "path": (),
            "sets": (
                "of deviations alpha (rad),",
                "I with half-axes (0.333333,",
                "G with half-axes (0.333334,",
                "S with half-widths (1, 1, 1, 1).",
            ),
            "guarantee": (
                "started in I, under any law",
                "stays in the tubes, inside S, until it arrives",
                "at the end inside G;",
            ),
        },
    ),
    "refuted funnel": (
        refuted(funnels().course, Violation.INLET),
        {
            "REFUTED": (
                "template contracting, rate about 0.333333 1/s, shell from 0.9 with margin lambda = 0.3 1/s is no",
            ),
            "vehicle": (),
            "path": (),
            "sets": ("no S: the whole plane",),
            "inputs": ("u0 in [0.5, 2]",),
            "witness": ("at theta = 0 s, alpha = about 0.333333, x = 0", "; condition (a) fails"),
        },
    ),
    "refuted tube": (
        refuted(by_hand.bounds(), Violation.DECREASE, reference=1),
        {
            "REFUTED": ("shell from 0.9",),
            "vehicle": (),
            "path": ("every one with speed in [0.5, 2] m/s",),
            "sets": (),
            "inputs": (),
            "witness": ("at curvature ", " 1/m, speed ", " m/s, acceleration ", "condition (d) fails"),
        },
    ),
}


@pytest.mark.parametrize(("shown", "parts"), STATEMENTS.values(), ids=list(STATEMENTS))
def test_each_kind_of_claim_has_its_statement(shown: Shown, parts: dict[str, tuple[str, ...]]) -> None:
    said = sections(shown)
    assert [section.heading for section in said] == list(parts)
    for section in said:
        paragraph = section.paragraph
        assert paragraph.startswith(f"{section.heading}: ") and paragraph.endswith(".")
        assert paragraph.isprintable() and paragraph.isascii()
        for word in parts[section.heading]:
            assert word in paragraph


def test_obstacles_are_among_the_sets_and_kept_clear_of() -> None:
    """Of a chain without I, G and S too; where there are none, nobody hears of a footprint."""
    around = Surroundings((ObstacleClaim(((ONE, ONE),), fmpq(1, 3)),), (FootprintClaim(fmpq(1, 3), ONE),))
    told = "clear of one obstacle that stands in the file, by a footprint of radius 0.333333 m at offset 1 m."
    held = chain()
    for shown, words in (
        (funnels(safe=(ONE,) * 4, surroundings=around), "V <= 1, inside S, clear of the obstacles, until it arrives"),
        (funnels(surroundings=around), "V <= 1, clear of the obstacles, until it arrives"),
        (replace(held, claim=replace(held.claim, surroundings=around)), "in the tubes, clear of the obstacles, until"),
    ):
        said = {section.heading: section.paragraph for section in sections(shown)}
        assert said["sets"].endswith(told) and words in said["guarantee"]
    assert not any("footprint" in section.paragraph for section in sections(funnels()))


def test_each_violation_is_said_in_its_own_words() -> None:
    said = {sections(refuted(funnels().course, violation))[-1].paragraph for violation in Violation}
    assert len(said) == len(Violation) == len(VIOLATED)


BANDS = replace(ROBUSTNESS, bands=((fmpq(1, 2), ONE), (ONE, fmpq(2))), by_speed=(AMOUNTS, AMOUNTS))
ALONG = replace(ROBUSTNESS, along=(by_hand.bounds(fmpq(1, 3)), by_hand.bounds(fmpq(1, 2))))
HELD = "held for 0.333333 s (control at 3 Hz or faster)"


@pytest.mark.parametrize(
    ("shown", "proven", "words"),
    [
        (funnels(), ROBUSTNESS, ("reach V' <= -0.95 lambda in the shell, one of", f"{HELD}; delay")),
        (
            tube(),
            BANDS,
            (
                "v_r times the margin per metre, for every curvature and acceleration of the tube at once, one of",
                f"{HELD}, whatever curvature and acceleration do meanwhile;",
                "speed of the path up to 1 m/s: 0.333333 s; control period, of inputs chosen at a speed of the path up "
                "to 2 m/s: 0.333333 s;",
            ),
        ),
        (
            chain(),
            ALONG,
            ("; tube 0: lambda", "[-0.5, 0.5] 1/m", "; tube 1: ", "[-0.333334, 0.333334]", "another than"),
        ),
        (
            chain(sets=SetsClaim((ONE,) * 4, (ONE,) * 4, None)),
            ALONG,
            ("and the car stays in the tubes and ends in G;",),
        ),
    ],
    ids=["funnels", "tube", "chain", "chain with sets"],
)
def test_what_is_absorbed_has_its_own_section(shown: Shown, proven: Robustness, words: tuple[str, ...]) -> None:
    *others, absorbed = sections(shown, proven)
    assert tuple(others) == sections(shown)
    assert absorbed.heading == "robustness"
    rates, errors = (
        "alpha 0.25 rad/s, x 0.25 m/s, y 0.25 m/s, v 0.25 m/s^2",
        "alpha 0.2 rad, x 0.2 m, y 0.2 m, v 0.2 m/s",
    )
    for word in (
        *words,
        "measured 0.166666 s ago",
        f"disturbance: in one state a rate is off by {rates};",
        f"measurement: in one state it is off by {errors}, from starts in V <= 0.875;",
        "or all at once, in every state, from starts in V <= 0.75: held for 0.166666 s, rates off by alpha 0.125 rad/s",
        "a measurement of 0.0833333 s ago off by alpha 0.1 rad, x 0.1 m, y 0.1 m, v 0.1 m/s.",
    ):
        assert word in absorbed.paragraph


def test_inputs_that_may_not_be_held_have_no_frequency() -> None:
    never = replace(ROBUSTNESS, alone=replace(AMOUNTS, period=ZERO))
    assert "held for 0 s; delay" in sections(funnels(), never)[-1].paragraph


def test_states_without_a_known_unit_have_none() -> None:
    shown = funnels()
    vehicle = replace(shown.problem.vehicle, name="mine")
    said = sections(replace(shown, problem=replace(shown.problem, vehicle=vehicle)), ROBUSTNESS)
    by_heading = {section.heading: section.paragraph for section in said}
    assert "of deviations alpha (rad), x (m), y (m), v; I" in by_heading["sets"]
    assert "y 0.25 m/s, v 0.25 a second;" in by_heading["robustness"]
    assert "y 0.2 m, v 0.2, from" in by_heading["robustness"]


@pytest.mark.parametrize(("shown", "proven"), [(funnels(), ROBUSTNESS), (tube(), BANDS), (chain(), ALONG)])
def test_a_terminal_shows_a_list_on_one_screen(shown: Shown, proven: Robustness) -> None:
    report = Report(Outcome.PROVEN, shown=shown, robustness=proven)
    title, *lines = report.text.splitlines()
    assert title == report.paragraphs[0].removesuffix(".")
    assert len(lines) < 40 and max(map(len, lines)) <= 110
    assert [line.split()[0] for line in lines if not line.startswith(" ")] == [
        section.heading for section in report.sections[1:]
    ]
    assert sum("  - " in line for line in lines) == sum(len(section.clauses) for section in report.sections[1:])
    words = " ".join(word for section in report.sections for word in (section.heading, *section.clauses)).split()
    assert [word for word in report.text.replace("PROVEN:", "PROVEN").split() if word != "-"] == words


@pytest.mark.parametrize(
    ("assumed", "words"),
    [
        (None, "its dynamics are those of the graph in the file."),
        (Assumptions(is_body=True, follows_turning=False), "the path's speed alone."),
        (Assumptions(is_body=False, follows_turning=True), "or at one angle to it all along, and what else"),
    ],
)
def test_of_an_unknown_vehicle_it_is_said_what_is_assumed(assumed: Assumptions | None, words: str) -> None:
    shown = funnels()
    vehicle = replace(shown.problem.vehicle, name="mine")
    told = sections(replace(shown, problem=replace(shown.problem, vehicle=vehicle), assumptions=assumed))[1].paragraph
    assert "a name unknown to this checker" in told and words in told
    assert "unknown" not in sections(replace(shown, assumptions=assumed))[1].paragraph  # whose name the checker knows


def test_a_report_says_its_paragraphs_in_one_line() -> None:
    report = Report(Outcome.PROVEN, shown=tube(), robustness=None)
    assert report.message == " ".join(report.paragraphs)
    assert (report.margins, report.arrival) == ((fmpq(3, 10),), None)
    assert (report.margin_per_metre, report.contraction) == (fmpq(2), tube().contraction)
    assert Report(Outcome.PROVEN, shown=chain()).arrival == (fmpq(3, 2), fmpq(6))
    refusal = Report(Outcome.BROKEN, "margin: no")
    assert (refusal.paragraphs, refusal.message, refusal.margins) == (("margin: no",), "margin: no", ())
    assert refusal.text == "BROKEN: margin: no"


def test_the_replay_answers_with_data(paper_text: str) -> None:
    """And a name that reads like a heading begins no section."""
    document: dict[str, Any] = json.loads(paper_text)
    document["problem"]["path"]["name"] = "circle. PROVEN. guarantee: all"
    report = check_document(document, skip_hash=True)
    assert isinstance(report.shown, ProvenFunnels)
    assert report.margins == (report.shown.funnels[0].margin,)
    assert [section.heading for section in report.sections] == ["PROVEN", "vehicle", "path", "sets", "guarantee"]
