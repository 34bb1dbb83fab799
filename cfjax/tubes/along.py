"""A path for a tube's run: the tube says of every path within its bounds that it holds, so one is chosen or given."""

from dataclasses import replace
from pathlib import Path as File

import numpy as np

from cfjax.errors import InputError
from cfjax.problem import Path, Pose, Profile, Segment, Tube, Vehicle, waypoints
from cfjax.result import Result
from cfjax.tubes import follow
from cfjax.tubes.certified import tube_of


LOBES, TURN = 6, 0.8  # of the winding path; rad that each of them turns
STRAIGHT = 10.0  # s, where the tube turns nowhere
SHARE = 0.98  # of the tube's curvatures: the ends themselves are lost to rounding
STILL = 1.0  # m/s²: at one speed of a tube without acceleration any number will do
BENDS = 1.01  # of the largest v² κ within the tube: no reason to slow down


def along_path(result: Result, file: File | None = None) -> Result:
    """The result of a tube's run as that of a path in the tube, held by it from end to end, which is proven.

    Raises:
        InputError: where the result is not of a tube, or the path is none, or leaves the tube.
    """
    problem, tube = result.problem, result.problem.path.tube
    if tube is None:
        raise InputError(f"--path: expected the run of a tube, got one along {problem.path.name}")
    if result.document is None:
        raise InputError("FOLDER: expected the run of a tube with its certificate")
    path = winding(tube) if file is None else _through(tube, file, problem.vehicle)
    following = follow(path, [tube_of(result.document, "run")], vehicle=problem.vehicle, closed=path.closed)
    duration = following.path.duration
    (found,) = result.segments
    return result.replace(
        problem=replace(problem, path=following.path),
        # the law asks for all that the tube holds: so what the tube absorbs is absorbed along the path, but for the
        # gap that integration leaves where a lap begins again
        segments=(replace(found, span=(0.0, duration), reference=tube, along=tube),),
        robustness=None if path.closed else result.robustness,
        rollouts=(),
    )


def winding(tube: Tube) -> Path:
    """At the middle speed of the tube, from one end of its curvatures to the other and back.

    Raises:
        InputError: for a tube in which no speed is kept.
    """
    if 0.0 not in tube.acceleration:
        raise InputError("--path: expected a path for a tube whose acceleration is never zero")
    speed, middle, half = tube.speed.middle, tube.curvature.middle, SHARE * tube.curvature.half
    if half <= 0:
        return _steady(middle * speed, speed, STRAIGHT)
    lobe = 2 * TURN / half / speed
    corners = speed * (middle + half * np.array([0.0, *(1.0 if k % 2 == 0 else -1.0 for k in range(LOBES)), 0.0]))
    lengths = lobe * np.array([0.5, *(1.0,) * (LOBES - 1), 0.5])
    breaks = (0.0, *(float(end) for end in np.cumsum(lengths)))
    slopes = np.diff(corners) / np.diff(breaks)
    turning = Profile(breaks, tuple((float(a), float(b)) for a, b in zip(corners[:-1], slopes, strict=True)))
    return Path("winding", (Segment(turning, Profile.constant(speed, breaks[-1]), Pose(-np.pi / 2, 0.0, 0.0)),))


def _steady(turn_rate: float, speed: float, duration: float) -> Path:
    turning, moving = Profile.constant(turn_rate, duration), Profile.constant(speed, duration)
    return Path("winding", (Segment(turning, moving, Pose(-np.pi / 2, 0.0, 0.0)),))


def _through(tube: Tube, file: File, vehicle: Vehicle) -> Path:
    """The points of a file, as fast as the tube allows."""
    bend = max(map(abs, (tube.curvature.lower, tube.curvature.upper)))
    return waypoints(
        file,
        speed=tube.speed.upper,
        lateral_acceleration=max(BENDS * bend * tube.speed.upper**2, 1.0),
        acceleration=tube.acceleration.upper or STILL,
        reserve=0.0,
        vehicle=vehicle,
    )
