"""Control funnel functions: a timing law and a feedback law for path following, learned together and proven.

    problem → learner ⇄ falsifier → certificate → control → simulation → report

Names and rooms are loaded on first use, so that `cfjax.check` replays a proof without JAX.
"""

from typing import TYPE_CHECKING, Any


__version__ = "0.1.0"

if TYPE_CHECKING:
    from cfjax.certificate import certify, refute
    from cfjax.demonstrator import demonstrate
    from cfjax.errors import InputError
    from cfjax.funnel import Contracting, Funnel, Objective, Paper
    from cfjax.options import Options
    from cfjax.planner import Map, Plan, plan, replan
    from cfjax.problem import (
        Box,
        Ellipsoid,
        Interval,
        KinematicBicycle,
        Method,
        Path,
        Problem,
        Vehicle,
        ball,
        circle,
        ellipse,
        figure_eight,
        obstacle_path,
        oval,
        slalom,
        straight,
        tube,
        waypoints,
    )
    from cfjax.report.page import write_report
    from cfjax.report.plot import plot
    from cfjax.result import Result
    from cfjax.synthesis import drive, search, synthesize
    from cfjax.tubes import Following, follow
    from cfjax.verdict import Verdict

_ROOMS = (
    *("baselines", "certificate", "check", "control", "demonstrator", "export", "falsifier", "funnel", "learner"),
    *("options", "planner", "plants", "problem", "result", "simulation", "tubes"),
)

__all__ = [
    "Box",
    "Contracting",
    "Ellipsoid",
    "Following",
    "Funnel",
    "InputError",
    "Interval",
    "KinematicBicycle",
    "Map",
    "Method",
    "Objective",
    "Options",
    "Paper",
    "Path",
    "Plan",
    "Problem",
    "Result",
    "Vehicle",
    "Verdict",
    "ball",
    "certify",
    "circle",
    "demonstrate",
    "drive",
    "ellipse",
    "figure_eight",
    "follow",
    "obstacle_path",
    "oval",
    "plan",
    "plot",
    "refute",
    "replan",
    "search",
    "slalom",
    "straight",
    "synthesize",
    "tube",
    "waypoints",
    "write_report",
]


def __getattr__(name: str) -> Any:
    from cfjax.lazy import on_first_use  # not above: who replays a proof runs the checker's code alone

    return on_first_use(__name__, _ROOMS)(name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
