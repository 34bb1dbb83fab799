"""Control funnel functions: a timing law and a feedback law for path following, learned together and proven.

    problem → learner ⇄ falsifier → certificate → control → simulation → report

Names are loaded on first use, so that `cfjax.check` replays a proof without JAX.
"""

import importlib
from typing import TYPE_CHECKING, Any


__version__ = "0.1.0"

if TYPE_CHECKING:
    from cfjax.certificate import certify, refute
    from cfjax.errors import InputError
    from cfjax.funnel import Contracting, Funnel, Paper
    from cfjax.options import Options
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
        straight,
    )
    from cfjax.result import Result
    from cfjax.synthesis import synthesize
    from cfjax.verdict import Verdict

_WHERE = {
    "InputError": "errors",
    "Verdict": "verdict",
    "Result": "result",
    "Options": "options",
    "synthesize": "synthesis",
    **dict.fromkeys(("certify", "refute"), "certificate"),
    **dict.fromkeys(("Contracting", "Funnel", "Paper"), "funnel"),
    **dict.fromkeys(
        (
            "Box",
            "Ellipsoid",
            "Interval",
            "KinematicBicycle",
            "Method",
            "Path",
            "Problem",
            "Vehicle",
            "ball",
            "circle",
            "straight",
        ),
        "problem",
    ),
}

__all__ = [
    "Box",
    "Contracting",
    "Ellipsoid",
    "Funnel",
    "InputError",
    "Interval",
    "KinematicBicycle",
    "Method",
    "Options",
    "Paper",
    "Path",
    "Problem",
    "Result",
    "Vehicle",
    "Verdict",
    "ball",
    "certify",
    "circle",
    "refute",
    "straight",
    "synthesize",
]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'cfjax' has no attribute {name!r}")
    return getattr(importlib.import_module(f"cfjax.{_WHERE[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
