"""Paths from files of points: the curve, its speed within every limit, its joints, and one line for each bad file."""

import itertools
import re
from collections.abc import Callable
from pathlib import Path as File

import numpy as np
import pytest

from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle, Path, Problem
from cfjax.problem.point_path import waypoints
from cfjax.tubes import follow
from tests.shapes import eight, racing_line, slalom


CAR = KinematicBicycle(wheelbase=0.33)
SAMPLES = 2000


def sampled(path: Path, count: int = SAMPLES) -> tuple[np.ndarray, ...]:
    """Complex places, turn rates, speeds, accelerations and arc lengths along the whole path."""
    columns, before = [], 0.0
    for segment in path.curve:
        theta = np.linspace(0, segment.duration, 1 + count // len(path.curve))
        _, x, y = segment.poses(theta).T
        v = segment.speed.polynomial
        arc = before + v.antiderivative()(theta)
        before = float(arc[-1])
        columns.append((x + 1j * y, segment.turn_rate.polynomial(theta), v(theta), v(theta, 1), arc))
    return tuple(np.concatenate(column) for column in zip(*columns, strict=True))


def check_limits(path: Path, *, reserve: float, lateral: float, acceleration: float, speed: float | None) -> None:
    _, omega, v, slope, _ = sampled(path)
    assert len(v) >= SAMPLES
    assert CAR.wheelbase * np.abs(omega / v).max() <= (1 - reserve) * CAR.max_tan_steering
    assert np.abs(omega * v).max() <= lateral
    assert np.abs(slope).max() <= min((1 - reserve) * CAR.max_thrust, acceleration)
    assert v.min() > 0
    if speed is not None:
        assert v.max() <= speed
    Problem(path, vehicle=CAR)


def check_joints(path: Path, closed: bool, apart: float = 1e-9) -> None:
    segments = list(path.curve)
    for segment in segments:
        for profile, orders in ((segment.turn_rate, 1), (segment.speed, 2)):
            pieces = zip(np.diff(profile.breaks), profile.coefficients, profile.coefficients[1:], strict=False)
            for h, piece, following in pieces:
                for order in range(orders):
                    polynomial = (
                        np.polynomial.Polynomial(piece).deriv(order) if order else np.polynomial.Polynomial(piece)
                    )
                    assert polynomial(h) == pytest.approx(following[order] if len(following) > order else 0, abs=1e-9)
    pairs = list(itertools.pairwise(segments)) + ([(segments[-1], segments[0])] if closed else [])
    for before, after in pairs:
        end = before.poses(np.array([before.duration]))[0]
        turn = end[0] - after.start.alpha
        assert abs(turn - 2 * np.pi * np.round(turn / (2 * np.pi))) < 1e-9
        assert np.hypot(end[1] - after.start.x, end[2] - after.start.y) < apart
        np.testing.assert_allclose(before.point(before.duration)[:2], after.point(0.0)[:2], rtol=0, atol=1e-9)
        assert before.point(before.duration).speed_slope == pytest.approx(after.point(0.0).speed_slope, abs=1e-9)


def farthest(points: np.ndarray, path: Path) -> float:
    """The largest distance (m) of a point from the integrated path."""
    places = sampled(path, 20_000)[0]
    begin, step = places[:-1], np.diff(places)
    begin, step = begin[step != 0], step[step != 0]
    found = []
    for point in points:
        part = np.clip(((point - begin) * np.conj(step)).real / np.abs(step) ** 2, 0, 1)
        found.append(np.abs(point - begin - part * step).min())
    return max(found)


SHAPES = {"eight": (eight, True), "slalom": (slalom, False), "racing line": (racing_line, True)}
LIMITS = [
    {"speed": 1.0, "lateral_acceleration": 4.0, "acceleration": 1.0, "reserve": 0.2},
    {"speed": 8.0, "lateral_acceleration": 4.0, "acceleration": 1.0, "reserve": 0.2},
    {"speed": 12.0, "lateral_acceleration": 6.0, "acceleration": 9.0, "reserve": 0.4},
]


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("limits", LIMITS, ids=["slow", "fast", "hard"])
def test_the_path_goes_through_the_points_within_every_limit(
    name: str, limits: dict[str, float], write: Callable[..., File]
) -> None:
    make, closed = SHAPES[name]
    points = make()
    path = waypoints(write(points), vehicle=CAR, **limits)
    assert farthest(points, path) < 1e-4
    lateral, acceleration = limits["lateral_acceleration"], limits["acceleration"]
    check_limits(path, reserve=limits["reserve"], lateral=lateral, acceleration=acceleration, speed=limits["speed"])
    check_joints(path, closed)
    for segment in path.curve:
        assert max(map(len, (*segment.turn_rate.coefficients, *segment.speed.coefficients))) <= 4


def test_the_racing_line_is_long_and_driven_near_its_limits(write: Callable[..., File]) -> None:
    path = waypoints(write(racing_line()), vehicle=CAR, speed=12.0, acceleration=None)
    _, omega, v, slope, arc = sampled(path)
    assert arc[-1] > 200
    assert len(path.curve) == round(arc[-1] / 10)
    assert sum(len(s.speed.coefficients) for s in path.curve) < arc[-1]
    kappa = np.abs(omega / v)
    bends = kappa[1:-1][(kappa[1:-1] > kappa[:-2]) & (kappa[1:-1] > kappa[2:])]
    assert bends.max() > 5 * bends.min()
    # fast enough: somewhere each limit is nearly reached, and everywhere one of them is not far
    assert np.abs(omega * v).max() > 0.95 * 4
    assert np.abs(slope).max() > 0.8 * 0.8 * 4
    assert v.max() > 1.3 * v.min()


def test_curvature_is_that_of_the_shape(write: Callable[..., File]) -> None:
    path = waypoints(write(eight(120)), vehicle=CAR)
    places, omega, v, *_ = sampled(path)
    assert np.abs(np.abs(omega / v) - 3 * np.abs(places) / 2.5**2).max() < 8e-3


@pytest.mark.parametrize("name", SHAPES)
def test_the_library_holds_along_it(name: str, write: Callable[..., File]) -> None:
    make, closed = SHAPES[name]
    path = waypoints(write(make()), vehicle=CAR, speed=6.0)
    following = follow(path, vehicle=CAR, closed=closed)
    assert following.closed == closed


# --- speeds


def test_speeds_of_the_file_are_the_most_that_is_driven(write: Callable[..., File]) -> None:
    x = np.linspace(0, 40, 41)
    wanted = np.where(x < 20, 3.0, 1.5)
    path = waypoints(write(x + 0j, wanted))
    *_, v, slope, arc = sampled(path)
    assert np.all(v <= np.interp(arc, x, wanted) + 1e-6)
    assert v[0] == pytest.approx(3.0, abs=1e-3) and v[-1] == pytest.approx(1.5, abs=1e-3)
    assert np.abs(slope).max() <= 1.0
    assert v[arc < 15].max() == pytest.approx(3.0, abs=2e-3)
    slower = waypoints(write(x + 0j, wanted), speed=2.0)
    assert sampled(slower)[2].max() <= 2.0


def test_without_speeds_it_is_driven_at_two_metres_a_second(write: Callable[..., File]) -> None:
    path = waypoints(write(slalom()))
    assert all(s.speed.is_constant and s.speed.coefficients[0] == (2.0,) for s in path.curve)


def test_a_lap_is_as_fast_at_its_joint_wherever_it_begins(write: Callable[..., File]) -> None:
    line = racing_line()[:-1]
    times = []
    for shift in (0, 37):
        path = waypoints(write(np.roll(line, shift)), closed=True, speed=12.0, vehicle=CAR)
        times.append(sum(s.duration for s in path.curve))
    assert times[0] == pytest.approx(times[1], rel=5e-3)


def test_a_lap_ends_with_the_very_speed_with_which_it_begins(write: Callable[..., File]) -> None:
    path = waypoints(write(eight()), vehicle=CAR, speed=6.0)
    first, last = path.curve[0], path.curve[-1]
    begin, end = first.point(0.0), last.point(last.duration)
    assert abs(end.speed - begin.speed) <= 1e-14 and abs(end.speed_slope - begin.speed_slope) <= 1e-14


# --- files


def test_segments_have_the_length_asked_for(write: Callable[..., File]) -> None:
    path = waypoints(write(racing_line()), segment_length=25.0, vehicle=CAR)
    lengths = [float(s.speed.polynomial.integrate(0, s.duration)) for s in path.curve]
    assert np.ptp(lengths) < 1e-6 and lengths[0] == pytest.approx(25.0, rel=0.1)


@pytest.mark.parametrize("count", [2, 3, 9])
def test_points_on_a_line_make_a_line(count: int, write: Callable[..., File]) -> None:
    path = waypoints(write((1 + 2j) + np.linspace(0, 5, count) * np.exp(0.3j)))
    (segment,) = path.curve
    assert segment.is_steady
    assert segment.point(0.0)[:2] == (0.0, 2.0)
    np.testing.assert_allclose(segment.start, (0.3 - np.pi / 2, 1, 2), atol=1e-12)
    assert segment.duration == pytest.approx(2.5)


def test_few_points_make_a_curve(write: Callable[..., File]) -> None:
    for points in (np.array([0, 4, 4 + 4j]), np.array([0, 4, 4 + 4j, 4j, 0]), np.array([0, 5, 2.5 + 4j, 0])):
        path = waypoints(write(points))
        assert farthest(points, path) < 1e-4
        check_joints(path, closed=points[-1] == 0)


def test_headers_comments_blank_lines_and_order_of_columns(write: Callable[..., File], tmp_path: File) -> None:
    expected = waypoints(write(np.array([0, 4, 8 + 1j]), np.array([1.0, 2.0, 2.0])))
    texts = [
        "x,y,speed\n0,0,1\n4,0,2\n8,1,2\n",
        "\ufeffx,y,v\r\n0,0,1\r\n4,0,2\r\n8,1,2\r\n",
        "# from somewhere\nspeed, y, x\n\n1,0,0\n# a comment\n2,0,4\n2,1,8",
        "# x_m,y_m,width_m,v_mps\n0,0,3,1\n4,0,3,2\n8,1,3,2\n",
        'X [m],Y [m],"Speed (m/s)"\n0,0,1\n4,0,2\n4,0,2\n8,1,2\n',
    ]
    for text in texts:
        file = tmp_path / "other.csv"
        file.write_text(text, encoding="utf-8")
        assert waypoints(file) == expected


def test_a_lap_is_recognised_or_asked_for(write: Callable[..., File]) -> None:
    line = racing_line()
    recognised = waypoints(write(line), vehicle=CAR)
    assert waypoints(write(line[:-1]), closed=True, vehicle=CAR) == recognised
    assert waypoints(write(line[:-1]), vehicle=CAR) == recognised
    open_ = waypoints(write(line[:-1]), closed=False, vehicle=CAR)
    assert sampled(open_)[4][-1] < sampled(recognised)[4][-1] - 0.5
    ends = sampled(waypoints(write(line), closed=False, vehicle=CAR))[0][[0, -1]]
    assert abs(ends[1] - ends[0]) < 1e-9


def test_repeated_points_are_merged(write: Callable[..., File]) -> None:
    points = slalom()
    assert waypoints(write(np.repeat(points, 2))) == waypoints(write(points))


def test_a_path_far_from_the_origin_is_the_same_path(write: Callable[..., File]) -> None:
    line, far = racing_line(), 5e5 + 4.6e6j  # as maps have it; there doubles are 1e-9 m apart
    near = sampled(waypoints(write(line), vehicle=CAR, speed=8.0))
    path = waypoints(write(line + far), vehicle=CAR, speed=8.0)
    check_joints(path, closed=True, apart=1e-8)
    there = sampled(path)
    assert np.abs(there[0] - far - near[0]).max() < 1e-3
    np.testing.assert_allclose(there[1:], near[1:], rtol=0, atol=1e-3)


def test_long_gaps_between_points_are_no_reason_to_swing_out(write: Callable[..., File]) -> None:
    arc = 10 + 3 * np.exp(1j * np.linspace(-np.pi / 2, np.pi / 2, 19))  # two half circles, nothing on the straights
    path = waypoints(write(np.concatenate([arc, -arc, arc[:1]])), vehicle=CAR)
    places, omega, v, *_ = sampled(path)
    beyond = np.abs(places.real) - 10
    away = np.where(beyond > 0, np.abs(np.abs(beyond + 1j * places.imag) - 3), np.abs(np.abs(places.imag) - 3))
    assert away.max() < 0.15
    assert np.abs(omega / v).max() < 0.4
    check_joints(path, closed=True)


@pytest.mark.parametrize("closed", [False, True])
def test_smoothing_takes_the_noise_out_of_points(closed: bool, write: Callable[..., File]) -> None:
    points = racing_line(count=400) if closed else np.linspace(0, 30, 100) + 0j
    draw = np.random.default_rng(0)
    noise = 0.02 * (draw.normal(size=len(points)) + 1j * draw.normal(size=len(points)))
    noise[-1] = noise[0]
    path = waypoints(write(points + noise), smoothing=0.03, vehicle=CAR)
    check_joints(path, closed)
    _, omega, v, *_ = sampled(path)
    _, smooth, speed, *_ = sampled(waypoints(write(points), vehicle=CAR))
    assert np.abs(omega / v).max() < np.abs(smooth / speed).max() + 0.1
    assert farthest(points, path) < 0.08


BAD = {
    "": r"expected at least two points, one x,y a row; the file is empty",
    "x,y\n": r"the file is empty",
    "x,y\n1,2\n": r", row 2: expected at least two points, got one",
    "1,2\n1,2\n1,2\n": r"expected points that differ, all 3 are x = 1 m, y = 2 m",
    "0,0\n1,nan\n2,0\n": r", row 2: expected a finite number for y, got nan",
    "x,y\n0,0\n\n-inf,1\n": r", row 4: expected a finite number for x, got -inf",
    "0,0\n1,1e999\n": r", row 2: expected a finite number for y, got 1e999",
    "0,0\n1,0\ntwo,0\n": r", row 3: expected a number for x, got 'two'",
    "0,0\n1\n": r", row 2: expected a number for y, got ''",
    "0,0,1\n1,0,0\n": r", row 2: expected a positive speed, got 0",
    "x,y,speed\n0,0,-2\n1,0,1\n": r", row 2: expected a positive speed, got -2",
    "0,0,1\n1,0,\n": r", row 2: expected a number for speed, got ''",
    "lon,lat\n0,0\n1,0\n": r": row 1: expected x and y in m, got latitude and longitude: project them",
    "1,2,3,4\n5,6,7,8\n": r", row 1: expected the numbers x,y or x,y,speed",
    "1\n2\n": r", row 1: expected the numbers x,y",
    "0 0,0\n1;0\n": r", row 1: expected the numbers x,y",
    "0,0\n1e300,0\n1e300,1e300\n": r"expected points in m, between 0\.001 and 100000 m along them, got 2e\+300 m",
    "0,0\n1e-300,0\n": r"expected points in m, between 0\.001 and 100000 m along them, got 1e-300 m",
    "0,0\n0.0001,0\n0.0002,0\n1000,0\n1000,1\n1000,1.0001\n1000,1.0002\n": r"expected points at more even distances, "
    r"or at most 100000: at the median distance, 0\.0001 m, the whole way would need 5\d+",
    "0,0\n1,0\n0,0\n": r"expected at least three different points of a closed path, got 2",
    "0,0\n1,0\n2,0\n1,0\n0.5,0\n": r", row 3: the path turns back on itself at x = 2 m, y = 0 m \(a cusp\); "
    r"expected a way that is driven forwards",
    "0,0\n1,0\n2,0\n2.2,0.2\n2,0.4\n1,0.4\n0,0.4\n": r", row 4: after \d\S* m, at x = \S+ m, y = \S+ m, the path "
    r"through the points turns with a radius of 0\.101 m, which takes a steering angle of 73\.4°; expected a radius of "
    r"at least 0\.425 m, 38\.7°, which is what path\.reserve=0\.2 leaves of the car's 45°$",
}


@pytest.mark.parametrize("text", BAD)
def test_a_bad_file_gets_one_line(text: str, tmp_path: File) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=BAD[text]) as raised:
        waypoints(file)
    assert str(raised.value).startswith(str(file)) and "\n" not in str(raised.value)


def test_a_file_that_cannot_be_read_gets_one_line(tmp_path: File) -> None:
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xd0\x00\xff")
    for file, message in (
        (tmp_path / "none.csv", "there is no such file"),
        (tmp_path, "got a folder"),
        (binary, "read"),
    ):
        with pytest.raises(InputError, match=f"expected a CSV file of waypoints, .*{message}") as raised:
            waypoints(file)
        assert str(raised.value).startswith(str(file))


def test_where_the_steering_ends_is_told(write: Callable[..., File]) -> None:
    u = np.linspace(0, 2 * np.pi, 41)
    points = 3 * np.cos(u) + 1.2j * np.sin(u)  # curvature 3/1.44 at x = ±3
    points[-1] = points[0]
    waypoints(write(points), vehicle=CAR, reserve=0.3)
    with pytest.raises(
        InputError,
        match=r", row 1: after 0 m, at x = 3 m, .*closes\), .* radius of 0\.478 m, .* 34\.6°; expected .* 0\.55 m, 31°",
    ):
        waypoints(write(points), vehicle=CAR, reserve=0.4)


def test_speeds_that_cannot_be_computed_with_get_one_line(write: Callable[..., File]) -> None:
    with pytest.raises(
        InputError, match=r"^path\.speed: expected speeds and limits that can be computed with, got 0 to 0"
    ):
        waypoints(write(slalom()), lateral_acceleration=1e-300)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("speed", 0.0),
        ("speed", float("nan")),
        ("lateral_acceleration", -1.0),
        ("acceleration", 0.0),
        ("segment_length", 0.0),
        ("reserve", 1.0),
        ("reserve", -0.1),
        ("smoothing", -1.0),
        ("smoothing", 1e6),
        ("segment_length", 1e-9),
    ],
)
def test_bad_numbers_get_one_line(key: str, value: float, write: Callable[..., File]) -> None:
    file = write(slalom())
    with pytest.raises(InputError, match=rf"^path\.{key}: expected .*, got {re.escape(str(value))}$"):
        waypoints(file, **{key: value})


def test_a_similar_car_on_a_similar_path_has_the_similar_reference(tmp_path: File) -> None:
    """Lengths and speeds times eight: times keep, and so do the number of segments and the cuts of each."""
    found = []
    for scale in (1.0, 8.0):
        file = tmp_path / f"{scale}.csv"
        line = scale * racing_line()
        np.savetxt(file, np.stack([line.real, line.imag], axis=1), delimiter=",")
        car = KinematicBicycle(0.34 * scale, 1.0, 4.0 * scale)
        found.append(waypoints(file, speed=6 * scale, lateral_acceleration=4 * scale, acceleration=scale, vehicle=car))
    assert len(found[0].segments) == len(found[1].segments) > 10
    for own, other in zip(found[0].curve, found[1].curve, strict=True):
        np.testing.assert_allclose(own.turn_rate.breaks, other.turn_rate.breaks, rtol=1e-6)
        for ours, theirs in zip(own.speed.coefficients, other.speed.coefficients, strict=True):
            np.testing.assert_allclose(8 * np.array(ours), theirs, rtol=1e-4, atol=1e-4)


def test_a_long_path_of_a_large_car_has_no_more_segments_than_a_certificate_holds(tmp_path: File) -> None:
    file = tmp_path / "long.csv"
    u = np.linspace(0, 2 * np.pi, 400)
    np.savetxt(file, np.stack([4000 * np.cos(u), 3000 * np.sin(u)], axis=1), delimiter=",")
    path = waypoints(file, vehicle=KinematicBicycle(2.7, 0.5463))
    assert len(path.segments) <= 256
    assert sum(len(segment.turn_rate.coefficients) for segment in path.curve) <= 4096
