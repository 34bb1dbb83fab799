"""The paper's found / not-found column, row by row: data of its section "Experiments", not results of this project.

"Not found" there was a learner that gave up, never a proof that no funnel exists.
"""

import math
from dataclasses import dataclass

import numpy as np

from cfjax.problem import Method, Problem, Segment
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
    PaperRow("oval", 1.0, found_pf=True, found_tt=False),  # the paper gives no speed: this is the preset's
    PaperRow("obstacle", 2.0, found_pf=True, found_tt=False),
    PaperRow("obstacle_tight", 2.0, found_pf=False, found_tt=None),
)
SAME = 1e-3  # relative: 3.1416 on the command line is the paper's π
SAMPLES = 33  # of each segment, where its curvature is compared


def paper_found(problem: Problem, preset: Problem) -> bool | None:
    """What the paper found where the problem is one of its rows, None elsewhere.

    `preset` is the untouched preset of the same name: apart from speed, method and timing (of which the paper gives
    no numbers) a row of the paper is that.
    """
    same = ("inlet", "goal", "safe", "obstacles", "footprint", "vehicle")
    if any(getattr(problem, part) != getattr(preset, part) for part in same):
        return None
    own, original = problem.path.curve, preset.path.curve
    if not own or len(own) != len(original) or not all(map(_same_course, own, original)):
        return None
    speed = own[0].point(0.0).speed
    for row in PAPER_ROWS:
        if row.preset == problem.path.name and math.isclose(row.speed, speed, rel_tol=SAME):
            return {Method.PF: row.found_pf, Method.TT: row.found_tt}[problem.method]
    return None


def _same_course(segment: Segment, original: Segment) -> bool:
    """Whether they are the same curve, each at a constant speed of its own."""
    if not (segment.speed.is_constant and original.speed.is_constant):
        return False
    (curvature, length), (usual, usual_length) = _course(segment), _course(original)
    near = SAME * float(np.abs(usual).max())
    return math.isclose(length, usual_length, rel_tol=SAME) and np.allclose(curvature, usual, rtol=0, atol=near)


def _course(segment: Segment) -> tuple[np.ndarray, float]:
    """Curvature (1/m) at equal shares of the segment, and length (m)."""
    speed = segment.point(0.0).speed
    theta = np.linspace(0.0, segment.duration, SAMPLES)
    return segment.turn_rate.values(theta) / speed, segment.duration * speed


def agreement(verdict: Verdict, found: bool | None) -> str:
    """`agrees` or `differs`, for a run of the paper's template; empty where the paper or the run says nothing.

    The shell's thickness is not compared: the paper gives no number.
    """
    if found is None or verdict not in (Verdict.CERTIFIED, Verdict.INCONCLUSIVE):
        return ""
    return "agrees" if found == (verdict is Verdict.CERTIFIED) else "differs"
