"""What problem and options are good for by themselves but not together, and what does nothing there."""

import math
from collections.abc import Sequence
from typing import Any

from cfjax.coerce import objects
from cfjax.errors import InputError
from cfjax.options import Options
from cfjax.problem import Interval, KinematicBicycle, Method, Problem
from cfjax.problem.problem import TIMING


GRADIENTS = ("restarts", "rounds")  # of that learner alone


def doubts(problem: Problem, options: Options) -> list[str]:
    """What is given and changes nothing, or what another unit explains better, a line each."""
    lines = [problem.path.doubt] if problem.path.doubt else []
    if isinstance(problem.vehicle, KinematicBicycle):
        lines += problem.vehicle.doubts
    if problem.method is Method.TT and problem.timing not in (TIMING, Interval(1.0, 1.0)):
        lines.append(f"timing: {problem.timing} does nothing with method=tt, where u0 is 1")
    for label, heading in (
        ("sets.goal", problem.goal.half_axes[0] if problem.goal else 0.0),
        ("sets.safe", problem.safe.half_widths[0] if problem.safe else 0.0),
    ):
        if heading > math.pi:
            degrees = f"; {heading:g} degrees are {math.radians(heading):.4g} rad"
            lines.append(f"{label}: {heading:g} rad of heading are no limit, for headings end at pi rad{degrees}")
    of_others = {"gradient": _changed("polytope.", options.polytope), "polytope": _changed("", options, GRADIENTS)}
    lines += [f"{name} does nothing with learner={options.learner}" for name in of_others[options.learner]]
    return lines


def _changed(prefix: str, options: Any, names: Sequence[str] = ()) -> list[str]:
    """Which of the options are not as they are unless somebody says so."""
    usual = type(options)()
    return [
        f"{prefix}{name}={value}"
        for name, value in vars(options).items()
        if name in (names or vars(usual)) and value != getattr(usual, name)
    ]


def check_question(problem: Problem, options: Options) -> None:
    """What problem and options are good for by themselves but not together.

    Raises:
        InputError: names the option that does not go with the path, or what is no problem and no options.
    """
    objects(problem=(problem, Problem), options=(options, Options))
    path = problem.path
    if options.certificate == "tube" and not path.tube and problem.authority != 1:
        raise InputError(f"authority: expected 1 for a path that tubes hold, got {problem.authority:g}")
    if options.certificate == "tube" and options.template != "contracting":
        raise InputError(f"template: expected contracting with certificate=tube, got {options.template}")
    if options.learner == "polytope":
        if options.certificate == "tube":
            raise InputError("certificate: expected auto or segment with learner=polytope, got tube")
        if path.tube:
            raise InputError("learner=polytope: expected a path, got a tube")
        if len(path.distinct) > 1:
            raise InputError(
                f"learner=polytope: expected one distinct segment, got {len(path.distinct)}: its coefficients are "
                "those of one funnel"
            )
