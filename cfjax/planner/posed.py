"""A problem whose path is planned: between its I and G, in tubes that hold them, beside the obstacles of a map."""

from dataclasses import replace

from cfjax.coerce import Number, Numbers
from cfjax.errors import InputError
from cfjax.planner.map import Map
from cfjax.planner.planning import plan
from cfjax.problem import Problem
from cfjax.tubes.hold import tubes_for


def planned(problem: Problem, map: Map, start: Numbers, goal: Numbers, speed: Number, lateral: Number) -> Problem:
    """The problem along a path through a map instead of its own, whose name it keeps.

    Raises:
        InputError: as `plan`, or where no tube of the package holds I.
    """
    tubes = tubes_for(problem)
    if not tubes:
        raise InputError(
            "sets.inlet: expected an I that a tube of the package holds, within S and the inputs, got none"
        )
    found = plan(
        map,
        start,
        goal,
        vehicle=problem.vehicle,
        footprint=problem.footprint,
        tubes=tubes,
        speed=speed,
        lateral_acceleration=lateral,
        name=problem.path.name,
    )
    return replace(problem, path=found.path, obstacles=map.obstacles)
