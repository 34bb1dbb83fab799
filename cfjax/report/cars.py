"""The recorded cars as pictures show them: few enough points, and no more rows than each car drove."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cfjax.report.plane import PathPoses, Poses, positions
from cfjax.result import Result, Rollouts


FEWEST_ROWS, MOST_ROWS = 160, 1200
ROW_LENGTH = 0.2  # m of the path, where that many rows are enough
SHOWN_WAY, UNDRIVEN_WAY = 60.0, 18.0  # of one path in a tube, in its lateral half-widths: enough to see it turn


class CarTrace(NamedTuple):
    """One car's way: arrays of t."""

    number: int
    clock: Float[np.ndarray, " t"]  # s
    along: Float[np.ndarray, " t"]  # θ (s), or in a tube the reference's way (m)
    value: Float[np.ndarray, " t"]  # V
    place: Float[np.ndarray, "t 2"]  # m, inertial frame
    inputs: Float[np.ndarray, "t m"]  # (u0, *vehicle inputs)


def cars_of(result: Result, course: PathPoses | None, points: int) -> list[CarTrace]:
    """The recorded cars, thinned to so many points of all together; none where none were driven.

    `course` is the path's, or None for a tube.
    """
    return [car for cars in result.rollouts for car in _cars(course, cars, points)]


def _cars(course: PathPoses | None, cars: Rollouts, points: int) -> list[CarTrace]:
    along = cars.theta if cars.reference is None else ways_of(cars)
    way = float(along[-1].max())
    if course is not None:
        way = float(np.linalg.norm(np.diff(course(np.linspace(0.0, way, 500))[:, 1:], axis=0), axis=1).sum())
    rows = int(np.clip(way / ROW_LENGTH, FEWEST_ROWS, MOST_ROWS))
    found = []
    for car in range(min(along.shape[1], max(1, points // rows))):
        kept = np.unique(np.linspace(0, np.argmax(along[:, car]), rows).round().astype(int))
        clock, theta, x, value, inputs = (
            column[kept, car] for column in (cars.clock, cars.theta, cars.x, cars.value, cars.inputs)
        )
        if cars.reference is not None:
            poses = cars.reference[kept, car]
        else:
            assert course is not None
            poses = course(theta)
        found.append(CarTrace(car + 1, clock, along[kept, car], value, positions(poses, x), inputs))
    return found


def ways_of(cars: Rollouts) -> Float[np.ndarray, "t k"]:
    """Length of each reference's way in a tube, m."""
    assert cars.reference is not None
    steps = np.linalg.norm(np.diff(cars.reference[..., 1:], axis=0), axis=-1)
    return np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])


class Ride(NamedTuple):
    """The beginning of one path in a tube, and of the car on it, if any was driven: arrays of t."""

    along: Float[np.ndarray, " t"]  # way of the reference, m
    poses: Poses
    clock: Float[np.ndarray, " t"] | None = None  # s
    place: Float[np.ndarray, "t 2"] | None = None  # m, inertial frame


def ride_of(result: Result, rows: int) -> Ride:
    """On the path of the recorded cars that turns most; on a straight one where none were driven."""
    reach = float(result.segments[0].funnel.half_widths()[1])
    if not result.rollouts:
        along = np.linspace(0.0, UNDRIVEN_WAY * reach, rows)
        return Ride(along, np.stack([0 * along, 0 * along, along], axis=-1))
    cars = result.rollouts[0]
    assert cars.reference is not None
    car = _most_winding(cars.reference)
    along = ways_of(cars)[:, car]
    last = min(int(np.searchsorted(along, SHOWN_WAY * reach)), len(along) - 1)
    kept = np.unique(np.linspace(0, last, rows).astype(int))
    poses = cars.reference[kept, car]
    return Ride(along[kept], poses, cars.clock[kept, car], positions(poses, cars.x[kept, car]))


def _most_winding(reference: Float[np.ndarray, "t k 3"]) -> int:
    """The path that turns most to and fro: what its heading varies by, less what is left of it in the end."""
    heading = reference[:: max(1, len(reference) // 40), :, 0]
    return int(np.argmax(np.abs(np.diff(heading, axis=0)).sum(axis=0) - np.abs(heading[-1] - heading[0])))
