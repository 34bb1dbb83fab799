"""What problem and options are good for by themselves but not together, and what does nothing there."""

import math
from dataclasses import fields, is_dataclass
from typing import Any

from cfjax.coerce import objects
from cfjax.errors import InputError
from cfjax.learner import keys_of_others
from cfjax.options import Options
from cfjax.problem import FeedbackLaw, Interval, KinematicBicycle, Method, Path, Problem
from cfjax.problem.problem import TIMING


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
    learner = options.chosen_learner.name
    for name in keys_of_others(options.learner):
        lines += [f"{changed} does nothing with learner={learner}" for changed in _changed(name, options)]
    return lines


def _changed(name: str, options: Any) -> list[str]:
    """The option, or those in it where it is a group of them, as far as they are not as they are unless given."""
    value, usual = getattr(options, name), getattr(type(options)(), name)
    if is_dataclass(value):
        return [f"{name}.{inner}" for field in fields(value) for inner in _changed(field.name, value)]
    return [] if value == usual else [f"{name}={value}"]


def check_question(problem: Problem, options: Options) -> None:
    """What problem and options are good for by themselves but not together.

    Raises:
        InputError: names the option that does not go with the path, or what is no problem and no options.
    """
    objects(problem=(problem, Problem), options=(options, Options))
    path = problem.path
    if options.certificate == "tube" and not path.tube and problem.input_share != 1:
        raise InputError(f"input_share: expected 1 for a path that tubes hold, got {problem.input_share:g}")
    if options.certificate == "tube" and options.template != "contracting":
        raise InputError(f"template: expected contracting with certificate=tube, got {options.template}")
    learner = options.chosen_learner
    if problem.law is not None:
        _require_provable_law(problem, problem.law, options)
    if options.certificate == "tube" and not learner.tubes:
        raise InputError(f"certificate: expected auto or segment with learner={learner.name}, got tube")
    if path.tube and not learner.tubes:
        raise InputError(f"learner={learner.name}: expected a path, got a tube")
    if options.period is not None:
        _require_steady(path, options)
    if len(path.distinct) > 1 and not learner.chains:
        raise InputError(
            f"learner={learner.name}: expected one distinct segment, got {len(path.distinct)}: it learns one funnel"
        )


def _require_provable_law(problem: Problem, law: FeedbackLaw, options: Options) -> None:
    """What a law is proven of, and who learns for one."""
    path = problem.path
    if path.tube or not all(segment.is_steady for segment in path.curve):
        raise InputError(f"law: expected straight lines and circles at constant speed, got {path.name}")
    if not law.keeps_time and problem.method is Method.TT:
        raise InputError(f"method: expected pf with law={law.name}, which keeps no time, got tt")
    if options.certificate == "tube":
        raise InputError("certificate: expected auto or segment with a law, got tube: the library's tubes have none")
    if not options.chosen_learner.tubes:
        name = options.chosen_learner.name
        raise InputError(f"law: expected none with learner={name}, which learns from the inputs of a controller")
    if options.period is not None:
        raise InputError("period: expected none with a law: it is proven of a law that looks one hold ahead")


def _require_steady(path: Path, options: Options) -> None:
    """What sampled control is proven of."""
    if len(path.curve) != 1 or not path.curve[0].is_steady:
        raise InputError(f"period: expected a path that is one straight line or one circle, got {path.name}")
    if options.template != "contracting" or options.certificate == "tube":
        raise InputError("period: expected template=contracting, and a certificate that is none of a tube")
