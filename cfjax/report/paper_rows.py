"""The paper's found / not-found column, row by row: data of its section "Experiments", not results of this project.

"Not found" there was a learner that gave up, never a proof that no funnel exists.
"""

import math
from dataclasses import dataclass

from cfjax.problem import Method, Problem
from cfjax.verdict import Verdict


@dataclass(frozen=True)
class PaperRow:
    """One experiment of the paper: a preset at a speed (m/s); None where the paper says nothing."""

    preset: str
    speed: float
    found_pf: bool | None
    found_tt: bool | None


PAPER_ROWS = (
    PaperRow("straight", 2.0, found_pf=True, found_tt=False),
    PaperRow("straight_long", 2.0, found_pf=True, found_tt=True),
    PaperRow("straight_restricted", 2.0, found_pf=True, found_tt=False),
    PaperRow("circle", math.pi / 2, found_pf=True, found_tt=True),
    PaperRow("circle", math.pi, found_pf=True, found_tt=False),
    PaperRow("circle", 10 * math.pi, found_pf=True, found_tt=None),
)
SAME = 1e-3  # relative: 3.1416 on the command line is the paper's π


def paper_found(problem: Problem, preset: Problem) -> bool | None:
    """What the paper found where the problem is one of its rows, None elsewhere.

    `preset` is the untouched preset of the same name: apart from speed, method and timing (of which the paper gives
    no numbers) a row of the paper is that.
    """
    same = ("inlet", "goal", "safe", "obstacles", "footprint", "vehicle")
    if any(getattr(problem, part) != getattr(preset, part) for part in same):
        return None
    if len(problem.path.curve) != 1 or not problem.path.curve[0].is_steady:
        return None
    (segment,), (original,) = problem.path.curve, preset.path.curve
    speed, usual = segment.point(0.0).speed, original.point(0.0).speed
    same_curvature = math.isclose(
        segment.point(0.0).turn_rate / speed, original.point(0.0).turn_rate / usual, rel_tol=SAME
    )
    if not same_curvature or not math.isclose(segment.duration * speed, original.duration * usual, rel_tol=SAME):
        return None
    for row in PAPER_ROWS:
        if row.preset == problem.path.name and math.isclose(row.speed, speed, rel_tol=SAME):
            return row.found_pf if problem.method is Method.PF else row.found_tt
    return None


def agreement(verdict: Verdict, found: bool | None) -> str:
    """`agrees` or `differs`, for a run of the paper's template; empty where the paper or the run says nothing.

    The shell's thickness is not compared: the paper gives no number.
    """
    if found is None or verdict not in (Verdict.CERTIFIED, Verdict.INCONCLUSIVE):
        return ""
    return "agrees" if found == (verdict is Verdict.CERTIFIED) else "differs"
