"""Curves with names: ellipse, oval, figure of eight, slalom, and the way around the paper's obstacle.

How a curve becomes a path: `cfjax.problem.curves`.
"""

import math
from dataclasses import replace

import numpy as np

from cfjax.coerce import Number, whole
from cfjax.problem.curves import Curve, path_along
from cfjax.problem.path import Path, Pose, Profile, Segment, length_of, speed_of


MOST_COUNT = 1000  # segments, laps, periods


def _mirrored(segment: Segment, start: Pose) -> Segment:
    """The same stretch, left and right exchanged: bit by bit the same numbers."""
    turning = segment.turn_rate
    return replace(
        segment,
        turn_rate=Profile(turning.breaks, tuple(tuple(-c for c in piece) for piece in turning.coefficients)),
        start=start,
    )


def _turned(path: Path) -> Path:
    """The path and then the path again, turned by half a turn about the origin: the same profiles."""
    again = tuple(replace(s, start=Pose(s.start.alpha + math.pi, 0.0 - s.start.x, 0.0 - s.start.y)) for s in path.curve)
    return Path(path.name, path.segments + again)


def ellipse(a: Number = 2.0, b: Number = 1.0, speed: Number = 1.0, segments: int = 2, laps: int = 1) -> Path:
    """x²/a² + y²/b² = 1 (half axes in m), counter-clockwise from (a, 0), at constant speed (m/s).

    Each lap has so many segments of equal length. With an even number the second half of a lap has the very profiles of
    the first, and every lap those of the first one.

    >>> path = ellipse(2.0, 1.0, speed=1.0)
    >>> len(path.segments), len(path.distinct), round(path.duration, 3)
    (2, 1, 9.688)

    Raises:
        InputError: for numbers that are not positive.
    """
    a, b, speed = length_of("a", a), length_of("b", b), speed_of(speed)
    segments, laps = whole("path.segments", segments, 1, MOST_COUNT), whole("path.laps", laps, 1, MOST_COUNT)
    even = segments % 2 == 0
    curve = Curve(
        lambda u: a * np.cos(u) + 1j * b * np.sin(u),
        lambda u: -a * np.sin(u) + 1j * b * np.cos(u),
        lambda u: -a * np.cos(u) - 1j * b * np.sin(u),
        tuple(float(u) for u in np.linspace(0.0, np.pi if even else 2 * np.pi, 3 if even else 5)),
    )
    path = path_along("ellipse", curve, speed, segments=segments // 2 if even else segments)
    lap = _turned(path) if even else path
    chain = [
        replace(s, start=s.start._replace(alpha=s.start.alpha + 2 * math.pi * k))
        for k in range(laps)
        for s in lap.curve
    ]
    return Path("ellipse", tuple(chain))


def oval(speed: Number = 1.0) -> Path:
    """The paper's oval x²/4 + y² = 1 (m), counter-clockwise from (2, 0), in two halves with one profile, at constant
    speed (m/s).

    Raises:
        InputError: for a speed that is not positive.
    """
    return replace(ellipse(2.0, 1.0, speed), name="oval")


def figure_eight(size: Number = 2.0, speed: Number = 1.0) -> Path:
    """Bernoulli's lemniscate, from −size to size (m) in x, at constant speed (m/s): one lap from the crossing.

    Curvature is 3r/size² at distance r from the crossing, so at most 3/size. The right lobe comes first,
    counter-clockwise; the left one is its mirror image, bit by bit.

    Raises:
        InputError: for numbers that are not positive.
    """
    size, speed = length_of("size", size), speed_of(speed)
    curve = Curve(
        lambda u: size * np.cos(u) / (1 - 1j * np.sin(u)),
        lambda u: size * 1j * (1 + 1j * np.sin(u)) / (1 - 1j * np.sin(u)) ** 2,
        lambda u: -size * np.cos(u) * (3 + 1j * np.sin(u)) / (1 - 1j * np.sin(u)) ** 3,
        (-math.pi / 2, 0.0, math.pi / 2),
    )
    (right,) = path_along("figure_eight", curve, speed).curve
    # it crosses at right angles: in at −3π/4, out at 3π/4
    right = replace(right, start=Pose(-3 * math.pi / 4, 0.0, 0.0))
    return Path("figure_eight", (right, _mirrored(right, Pose(3 * math.pi / 4, 0.0, 0.0))))


def slalom(length: Number = 12.0, amplitude: Number = 0.5, periods: int = 3, speed: Number = 1.0) -> Path:
    """y = amplitude · sin(2π periods x/length) for x from 0 to length (m), at constant speed (m/s).

    One segment for each half wave, in turns bit by bit mirror images. Curvature is at most amplitude (2π
    periods/length)².

    Raises:
        InputError: for numbers that are not positive.
    """
    length, amplitude, speed = length_of("length", length), length_of("amplitude", amplitude), speed_of(speed)
    periods = whole("path.periods", periods, 1, MOST_COUNT)
    k = 2 * math.pi * periods / length
    half = length / (2 * periods)
    curve = Curve(
        lambda u: u + 1j * amplitude * np.sin(k * u),
        lambda u: 1 + 1j * amplitude * k * np.cos(k * u),
        lambda u: -1j * amplitude * k**2 * np.sin(k * u),
        (0.0, half / 2, half),
    )
    (wave,) = path_along("slalom", curve, speed).curve
    slope = math.atan(amplitude * k)
    chain = []
    for index in range(2 * periods):
        start = Pose((-slope if index % 2 else slope) - math.pi / 2, index * half, 0.0)
        chain.append(_mirrored(wave, start) if index % 2 else replace(wave, start=start))
    return Path("slalom", tuple(chain))


def obstacle_path(speed: Number = 2.0) -> Path:
    """Around the paper's obstacle at the origin: y = 0.4 (1 + cos(π x/1.5)) for x from −1.5 to 1.5 m, at constant speed
    (m/s).

    Raises:
        InputError: for a speed that is not positive.
    """
    k = math.pi / 1.5
    curve = Curve(
        lambda u: u + 0.4j * (1 + np.cos(k * u)),
        lambda u: 1 - 0.4j * k * np.sin(k * u),
        lambda u: -0.4j * k**2 * np.cos(k * u),
        (-1.5, 0.0, 1.5),
    )
    return path_along("obstacle", curve, speed_of(speed))
