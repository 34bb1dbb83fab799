"""The recorded cars as the page shows them: few enough points, and no more rows than each car drove."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cfjax.report.plane import Course, positions
from cfjax.report.style import CAR_COLOURS, rotation
from cfjax.result import Result, Rollouts


POINTS = 5000  # of all cars together
FEWEST_ROWS, MOST_ROWS = 160, 1200
ROW_LENGTH = 0.2  # m of the path, where that many rows are enough


class Car(NamedTuple):
    """One car's way: arrays of t."""

    number: int
    colour: str
    clock: Float[np.ndarray, " t"]  # s
    along: Float[np.ndarray, " t"]  # θ (s), or in a tube the reference's way (m)
    value: Float[np.ndarray, " t"]  # V
    place: Float[np.ndarray, "t 2"]  # m, inertial frame
    inputs: Float[np.ndarray, "t m"]  # (u0, *vehicle inputs)


def cars_of(result: Result, course: Course | None) -> list[Car]:
    """The recorded cars, thinned; none where none were driven. `course` is the path's, or None for a tube."""
    return [car for cars in result.rollouts for car in _cars(course, cars)]


def _cars(course: Course | None, cars: Rollouts) -> Iterator[Car]:
    along = cars.theta if cars.reference is None else ways_of(cars)
    way = float(along[-1].max())
    if course is not None:
        way = float(np.linalg.norm(np.diff(course(np.linspace(0.0, way, 500))[:, 1:], axis=0), axis=1).sum())
    rows = int(np.clip(way / ROW_LENGTH, FEWEST_ROWS, MOST_ROWS))
    count = min(along.shape[1], max(1, POINTS // rows))
    kept = []
    for car in range(count):
        last = int(np.argmax(along[:, car]))
        kept.append(np.linspace(0, last, rows).round().astype(int))
    rows_of, each = np.stack(kept, axis=1), np.arange(count)[None, :]
    theta, x, inputs = (values[rows_of, each] for values in (cars.theta, cars.x, cars.inputs))
    if course is not None:
        place = positions(course, theta, x)
    else:
        assert cars.reference is not None
        pose = cars.reference[rows_of, each]
        turns = rotation(pose[..., 0].ravel()).reshape(*theta.shape, 2, 2)
        place = pose[..., 1:] + np.einsum("tkij,tkj->tki", turns, x[..., 1:3])
    clock, value, along = cars.clock[rows_of, each], cars.value[rows_of, each], along[rows_of, each]
    for car in range(count):
        until = 1 + math.floor(np.argmax(along[:, car]))
        yield Car(
            number=car + 1,
            colour=CAR_COLOURS[car % len(CAR_COLOURS)],
            **{
                name: values[:until, car]
                for name, values in (("clock", clock), ("along", along), ("value", value), ("place", place))
            },
            inputs=inputs[:until, car],
        )


def ways_of(cars: Rollouts) -> Float[np.ndarray, "t k"]:
    """Length of each reference's way in a tube, m."""
    assert cars.reference is not None
    steps = np.linalg.norm(np.diff(cars.reference[..., 1:], axis=0), axis=-1)
    return np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
