"""What the checker says is made of data: each kind of claim has its statement, heading by heading."""

import json
from dataclasses import replace
from typing import Any

import pytest
from flint import fmpq

from cfcheck import Outcome, Report, check_document
from cfcheck.claims.assumptions import Assumptions
from cfcheck.claims.document import Claims, Witness
from cfcheck.claims.proven import Proven, Refuted, Shown, Violation
from cfcheck.clearance.half_plane import FootprintClaim, ObstacleClaim
from cfcheck.clearance.surroundings import SurroundingsClaim
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.level import Contracting, Paper
from cfcheck.path.bounds import Bounds, Extreme
from cfcheck.robustness.amounts import AbsorbedClaim, LawNumbers, ProvenRobustness
from cfcheck.statement import VIOLATED, sections
from tests import by_hand
from tests.by_hand import ONE, ZERO


AMOUNTS = AbsorbedClaim(fmpq(1, 3), (fmpq(1, 4),) * 4, (fmpq(1, 5),) * 4, fmpq(1, 6))


def told(*bounds: Bounds | None) -> tuple[LawNumbers, ...]:
    return tuple(LawNumbers(ONE, None if own is None else fmpq(2), fmpq(9, 10), fmpq(1, 2), own) for own in bounds)


ROBUSTNESS = ProvenRobustness(AMOUNTS, fmpq(7, 8), AMOUNTS.scaled(fmpq(1, 2)), fmpq(3, 4), (), told(None))


def funnel(margin: fmpq = fmpq(3, 10)) -> FunnelClaim:
    """One that changes with θ."""
    return by_hand.funnel(margin, level=Contracting(fmpq(1, 3)))


def funnels(closed: bool = False, **changes: object) -> Proven:
    return Proven(by_hand.claims((funnel(), funnel(fmpq(1, 3))), closed, **changes), None)


def tube(goal: bool = True) -> Proven:
    changes = {} if goal else {"goal": None}
    return Proven(by_hand.everywhere(by_hand.funnel(fmpq(3, 10), fmpq(2)), **changes), None)


def in_tubes(closed: bool = False, **changes: object) -> Proven:
    """Two invariant funnels in turn, without I and G unless they are given."""
    wide = by_hand.funnel(ONE, fmpq(2))
    narrow = by_hand.funnel(ONE, fmpq(3), shape=[[4 * entry for entry in row] for row in wide.shape])
    open_ends = {"inlet": None, "goal": None}
    return Proven(by_hand.claims((wide, narrow), closed, **(open_ends | changes)), None, fmpq(1, 3))


def refuted(claims: Claims, violation: Violation, reference: int = 0) -> Refuted:
    course = claims.problem.course
    profile = by_hand.piece((0,), (1,)).profile(ZERO)
    extremes = course.extremes() if isinstance(course, Bounds) else [Extreme(profile, profile)]
    witness = Witness("d", 0, ZERO, reference, (fmpq(1, 3), ZERO, ZERO, ZERO))
    return Refuted(claims, witness, violation, tuple(extremes), None)


STATEMENTS: dict[str, tuple[Shown, dict[str, tuple[str, ...]]]] = {
    "funnels": (
        funnels(safe=(ONE,) * 4),
        {
            "PROVEN": ("a control funnel function along a path.",),
            "vehicle": ('"kinematic_bicycle" (wheelbase 0.34); a car by its rear axle,', "w is the tangent of its"),
            "path": ("whose 2 pieces stand in the file (2 m, theta from 0 to 2 s)",),
            "sets": (
                "of deviations alpha (rad), x (m), y (m), v (m/s); I with half-axes (0.25,",
                "G with half-axes (0.5, 0.5, 0.5, 0.5); S with half-widths (1, 1, 1, 1).",
            ),
            "guarantee": (
                "from every start in I at theta = 0, inputs u0 in [0.5, 2], w in [-1, 1] suffice",
                "V <= 1, inside S, until it arrives in G after 1 to 4 s;",
                "legs: 2, joints: 1, funnels: 2; the funnels: template contracting, rate about 0.333333, about",
                "shell from 0.9, lateral half-width 0.5 m;",
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
    "in tubes": (
        in_tubes(),
        {
            "PROVEN": ("a control funnel function along a path.",),
            "vehicle": (),
            "path": ('"made by hand", whose 2 pieces stand in the file (2 m',),
            "sets": ("no I is asked; no G is asked",),
            "guarantee": (
                "from every start with V < 1 at theta = 0, inputs",
                "until it arrives with V <= 0.333334 after 1 to 4 s; this needs a law that enforces 0.95 of",
                "legs: 2, joints: 1, funnels: 2; the funnels: V does not change with theta, shell from 0.9, lateral",
                "lambda = 1 1/s and 2 per metre of the reference at u0 = 1 or more.",
            ),
        },
    ),
    "in tubes, closed": (
        in_tubes(closed=True),
        {"PROVEN": (), "vehicle": (), "path": (), "sets": (), "guarantee": ("lap after lap for ever;", "joints: 2")},
    ),
    "in tubes with sets": (
        in_tubes(inlet=(fmpq(1, 3),) * 4, goal=(fmpq(1, 3),) * 4, safe=(ONE,) * 4),
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
            "guarantee": ("from every start in I", "inside S, until it arrives in G after"),
        },
    ),
    "refuted funnel": (
        refuted(by_hand.claims((funnel(),)), Violation.INLET),
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
        refuted(by_hand.everywhere(by_hand.funnel(fmpq(3, 10))), Violation.DECREASE, reference=1),
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
    """Without I and G too; where there are none, nobody hears of a footprint."""
    around = SurroundingsClaim((ObstacleClaim(((ONE, ONE),), fmpq(1, 3)),), (FootprintClaim(fmpq(1, 3), ONE),))
    told = "clear of one obstacle that stands in the file, by a footprint of radius 0.333333 m at offset 1 m."
    for shown, words in (
        (funnels(safe=(ONE,) * 4, surroundings=around), "V <= 1, inside S, clear of the obstacles, until it arrives"),
        (funnels(surroundings=around), "V <= 1, clear of the obstacles, until it arrives"),
        (in_tubes(surroundings=around), "V <= 1, clear of the obstacles, until it arrives with"),
    ):
        said = {section.heading: section.paragraph for section in sections(shown)}
        assert said["sets"].endswith(told) and words in said["guarantee"]
    assert not any("footprint" in section.paragraph for section in sections(funnels()))


def test_what_some_funnels_have_is_not_said_of_all() -> None:
    """One that changes with θ and one that does not, in turn, and one of the paper's template."""
    changing, still = funnel(ONE), by_hand.funnel(fmpq(2), fmpq(3))
    paper = by_hand.funnel(fmpq(3), level=Paper(fmpq(1, 5)))
    said = {s.heading: s.paragraph for s in sections(Proven(by_hand.claims((changing, still, paper)), None))}
    assert "lambda = 1 1/s and in funnels that do not change with theta 3 per metre" in said["guarantee"]
    assert (
        "template contracting, rate about 0.333333 1/s; V does not change with theta; template paper, c0 0.2 1/s"
        in (said["guarantee"])
    )
    low = by_hand.funnel(ONE, beta_lower=fmpq(1, 10), beta_inner=fmpq(1, 10))
    told = refuted(by_hand.claims((low, funnel())), Violation.DECREASE)
    assert "shell from 0.1 along leg 0 with margin lambda = 1 1/s" in sections(told)[0].paragraph


def test_each_violation_is_said_in_its_own_words() -> None:
    said = {sections(refuted(by_hand.claims((funnel(),)), violation))[-1].paragraph for violation in Violation}
    assert len(said) == len(Violation) == len(VIOLATED)


BANDS = replace(ROBUSTNESS, bands=((fmpq(1, 2), ONE), (ONE, fmpq(2))), by_speed=(AMOUNTS, AMOUNTS))
ALONG = replace(ROBUSTNESS, law_numbers=told(by_hand.bounds(fmpq(1, 3)), by_hand.bounds(fmpq(1, 2))))
HELD = "held for 0.333333 s (control at 3 Hz or faster)"


@pytest.mark.parametrize(
    ("shown", "proven", "words"),
    [
        (
            Proven(by_hand.claims((funnel(),)), None),
            ROBUSTNESS,
            ("reach V' <= -0.95 lambda in the shell, one of", f"{HELD}; delay"),
        ),
        (
            funnels(),
            replace(ROBUSTNESS, law_numbers=told(None, None)),
            ("funnel 0: lambda = 1 1/s, shell from 0.9; funnel 1: lambda = 1 1/s, shell from 0.9; control period",),
        ),
        (
            tube(),
            BANDS,
            (
                "v_r times the margin per metre, for every curvature and acceleration of the bounds at once, one of",
                f"{HELD}, whatever curvature and acceleration do meanwhile;",
                "speed of the path up to 1 m/s: 0.333333 s; control period, of inputs chosen at a speed of the path up "
                "to 2 m/s: 0.333333 s;",
            ),
        ),
        (
            in_tubes(),
            ALONG,
            ("; funnel 0: lambda", "[-0.333334, 0.333334] 1/m", "; funnel 1: ", "[-0.5, 0.5]", "another than"),
        ),
        (
            in_tubes(goal=(ONE,) * 4),
            ALONG,
            ("and the car stays in the funnels and ends in G;",),
        ),
    ],
    ids=["funnel", "funnels", "tube", "in tubes", "in tubes with sets"],
)
def test_what_is_absorbed_has_its_own_section(shown: Proven, proven: ProvenRobustness, words: tuple[str, ...]) -> None:
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


def unknown(assumed: Assumptions | None = None) -> Proven:
    """What is shown of a vehicle whose name the checker does not know."""
    known = by_hand.problem_claim(by_hand.bounds()).vehicle
    return replace(funnels(vehicle=replace(known, name="mine")), assumptions=assumed)


def test_states_without_a_known_unit_have_none() -> None:
    said = sections(unknown(), ROBUSTNESS)
    by_heading = {section.heading: section.paragraph for section in said}
    assert "of deviations alpha (rad), x (m), y (m), v; I" in by_heading["sets"]
    assert "y 0.25 m/s, v 0.25 a second;" in by_heading["robustness"]
    assert "y 0.2 m, v 0.2, from" in by_heading["robustness"]


@pytest.mark.parametrize(("shown", "proven"), [(funnels(), ROBUSTNESS), (tube(), BANDS), (in_tubes(), ALONG)])
def test_a_terminal_shows_a_list_on_one_screen(shown: Proven, proven: ProvenRobustness) -> None:
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
    said = sections(unknown(assumed))[1].paragraph
    assert "a name unknown to this checker" in said and words in said
    assert "unknown" not in sections(replace(funnels(), assumptions=assumed))[1].paragraph  # a name that it knows


def test_a_report_says_its_paragraphs_in_one_line() -> None:
    report = Report(Outcome.PROVEN, shown=tube(), robustness=None)
    assert report.message == " ".join(report.paragraphs)
    assert (report.margins, report.arrival) == ((fmpq(3, 10),), None)
    assert (report.margin_per_metre, report.contraction) == (fmpq(2), tube().contraction)
    assert Report(Outcome.PROVEN, shown=in_tubes()).arrival == (ONE, fmpq(4))
    refusal = Report(Outcome.BROKEN, "margin: no")
    assert (refusal.paragraphs, refusal.message, refusal.margins) == (("margin: no",), "margin: no", ())
    assert refusal.text == "BROKEN: margin: no"


def test_the_replay_answers_with_data(paper_text: str) -> None:
    """And a name that reads like a heading begins no section."""
    document: dict[str, Any] = json.loads(paper_text)
    document["problem"]["path"]["name"] = "circle. PROVEN. guarantee: all"
    report = check_document(document, skip_hash=True)
    assert isinstance(report.shown, Proven)
    assert report.margins == (report.shown.claims.funnels[0].margin,)
    assert [section.heading for section in report.sections] == ["PROVEN", "vehicle", "path", "sets", "guarantee"]
