"""Curves as references: close to what was asked for, smooth, joined and closed."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree

from cfjax.errors import InputError
from cfjax.problem import Path, Problem
from cfjax.problem.curves import TOLERANCE, Curve, path_along
from cfjax.problem.named_curves import ellipse, figure_eight, obstacle_path, oval, slalom
from cfjax.tubes import follow


# path, the curve as x + iy by formula, range of u, closed, most pieces a segment
Case = tuple[Callable[[], Path], Callable[[np.ndarray], np.ndarray], tuple[float, float], bool, int]

CASES: dict[str, Case] = {
    "oval": (oval, lambda u: 2 * np.cos(u) + 1j * np.sin(u), (0, 2 * np.pi), True, 12),
    "oval, fast": (lambda: oval(np.pi / 2), lambda u: 2 * np.cos(u) + 1j * np.sin(u), (0, 2 * np.pi), True, 12),
    "ellipse": (
        lambda: ellipse(3.0, 1.5, 2.0, 3, 2),
        lambda u: 3 * np.cos(u) + 1.5j * np.sin(u),
        (0, 2 * np.pi),
        True,
        12,
    ),
    "figure eight": (
        figure_eight,
        lambda u: 2 * np.cos(u) * (1 + 1j * np.sin(u)) / (1 + np.sin(u) ** 2),
        (-np.pi / 2, 3 * np.pi / 2),
        True,
        10,
    ),
    "slalom": (slalom, lambda u: u + 0.5j * np.sin(np.pi / 2 * u), (0, 12), False, 6),
    "obstacle": (obstacle_path, lambda u: u + 0.4j * (1 + np.cos(np.pi * u / 1.5)), (-1.5, 1.5), False, 14),
}
SAMPLES = 2000


def by_formula(case: Case) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dense points of the true curve, unit tangents and curvatures there, by differences."""
    _, curve, (begin, end), *_ = case
    h = (end - begin) / 40_000
    u = begin + h * np.arange(40_001)
    z = curve(u)
    first = (curve(u + h) - curve(u - h)) / (2 * h)
    second = (curve(u + h) - 2 * z + curve(u - h)) / h**2
    return z, first / np.abs(first), (np.conj(first) * second).imag / np.abs(first) ** 3


def sampled(path: Path, count: int = SAMPLES) -> tuple[np.ndarray, ...]:
    """Complex places, headings, turn rates, speeds and accelerations along the whole path."""
    columns = []
    for segment in path.curve:
        theta = np.linspace(0, segment.duration, 1 + count // len(path.curve))
        alpha, x, y = segment.poses(theta).T
        v, omega = segment.speed.polynomial, segment.turn_rate.polynomial
        columns.append((x + 1j * y, alpha, omega(theta), v(theta), v(theta, 1)))
    return tuple(np.concatenate(column) for column in zip(*columns, strict=True))


def length(path: Path) -> float:
    return sum(float(s.speed.polynomial.integrate(0, s.duration)) for s in path.curve)


def check_joints(path: Path, closed: bool, apart: float = 1e-10) -> None:
    """Pose, turn rate and speed go on from piece to piece, from segment to segment, from lap to lap."""
    segments = list(path.curve)
    for before, after in zip(segments, segments[1:] + segments[:1], strict=True):
        for profile, slopes in ((before.turn_rate, False), (before.speed, True)):
            breaks = np.diff(profile.breaks)
            for h, piece, following in zip(breaks, profile.coefficients, profile.coefficients[1:], strict=False):
                power = h ** np.arange(len(piece))
                assert np.dot(piece, power) == pytest.approx(following[0], abs=1e-9)
                if slopes:
                    rate = np.dot(np.arange(1, len(piece)) * piece[1:], power[:-1])
                    assert rate == pytest.approx(following[1], abs=1e-9)
        if after is segments[0] and not closed:
            continue
        end = before.poses(np.array([before.duration]))[0]
        alpha = end[0] - after.start.alpha
        assert abs(alpha - 2 * np.pi * np.round(alpha / (2 * np.pi))) < apart
        assert np.hypot(end[1] - after.start.x, end[2] - after.start.y) < apart
        last, first = before.point(before.duration), after.point(0.0)
        assert last.turn_rate == pytest.approx(first.turn_rate, abs=1e-9)
        assert last.speed == pytest.approx(first.speed, abs=1e-12)
        assert last.speed_slope == pytest.approx(first.speed_slope, abs=1e-9)


def distances(
    points: np.ndarray, forward: np.ndarray, curve: np.ndarray, tangents: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far points are from a dense curve, across its tangent at the nearest place, and which place that is.

    Directions count for a little, so that at a crossing the branch is the right one.
    """
    own, other = (
        np.stack([z.real, z.imag, 0.1 * t.real, 0.1 * t.imag], axis=1)
        for z, t in ((points, forward), (curve, tangents))
    )
    _, nearest = KDTree(other).query(own)
    return np.abs((np.conj(tangents[nearest]) * (points - curve[nearest])).imag), nearest


@pytest.mark.parametrize("name", CASES)
def test_the_integrated_reference_is_the_curve(name: str) -> None:
    case = CASES[name]
    path = case[0]()
    z, tangents, kappas = by_formula(case)
    places, alpha, omega, v, _ = sampled(path, 20_000)
    forward = 1j * np.exp(1j * alpha)
    there, nearest = distances(places, forward, z, tangents)
    back, _ = distances(z, tangents, places, forward)
    assert there.max() < TOLERANCE / 10 and back.max() < TOLERANCE / 10
    assert np.abs(np.angle(forward * np.conj(tangents[nearest]))).max() < 1e-3
    assert np.abs(omega / v - kappas[nearest]).max() < 8e-3
    assert np.ptp(v) == 0


@pytest.mark.parametrize("name", CASES)
def test_pieces_are_few_cubics_that_join(name: str) -> None:
    make, _, _, closed, most = CASES[name]
    path = make()
    check_joints(path, closed)
    for segment in path.curve:
        assert len(segment.turn_rate.coefficients) <= most
        assert max(map(len, segment.turn_rate.coefficients)) <= 4
        assert segment.speed.is_constant and len(segment.speed.coefficients) == 1
    Problem(path)  # the default car can drive it


def test_both_halves_of_the_oval_are_one_profile() -> None:
    first, second = oval().curve
    assert (first.turn_rate, first.speed) == (second.turn_rate, second.speed)
    assert first.start == (0, 2, 0)
    assert second.start == (np.pi, -2, 0)
    assert first.duration == pytest.approx(4.84422, abs=1e-5)
    # short where curvature changes fast
    pieces = np.diff(first.turn_rate.breaks)
    assert pieces[0] < 0.6 * pieces[len(pieces) // 2]


def test_laps_and_quarters_of_an_ellipse() -> None:
    path = ellipse(2.0, 1.0, 1.5, segments=4, laps=3)
    assert len(path.curve) == 12
    profiles = [(s.turn_rate, s.speed) for s in path.curve]
    assert profiles[:2] * 6 == profiles
    check_joints(path, closed=True)
    assert length(path) == pytest.approx(3 * 2 * 4.84422411, abs=1e-7)


def test_the_lobes_of_an_eight_and_the_waves_of_a_slalom_mirror_each_other() -> None:
    for path in (figure_eight(), slalom()):
        first = path.curve[0]
        for index, segment in enumerate(path.curve):
            sign = -1 if index % 2 else 1
            assert segment.turn_rate.breaks == first.turn_rate.breaks and segment.speed == first.speed
            assert segment.turn_rate.coefficients == tuple(
                tuple(sign * c for c in piece) for piece in first.turn_rate.coefficients
            )


def test_bends_of_the_default_paths() -> None:
    for path, most in ((figure_eight(), 1.5), (slalom(), 0.5 * (np.pi / 2) ** 2), (oval(), 2.0)):
        _, _, omega, v, _ = sampled(path)
        assert np.abs(omega / v).max() == pytest.approx(most, abs=1e-3)
    _, _, omega, v, _ = sampled(obstacle_path())
    assert 0.34 * np.abs(omega / v).max() == pytest.approx(0.5965, abs=1e-3)


def test_a_circle_is_an_arc_of_one_piece() -> None:
    path = ellipse(1.5, 1.5, 2.0, segments=1)
    (segment,) = path.curve
    assert segment.is_steady
    assert segment.references()[0][0].turn_rate == pytest.approx(2 / 1.5)
    check_joints(path, closed=True)


@pytest.mark.parametrize("segments", [1, 3])
def test_speed_along_the_curve(segments: int) -> None:
    curve = Curve(
        lambda u: 3 * np.cos(u) + 1.5j * np.sin(u),
        lambda u: -3 * np.sin(u) + 1.5j * np.cos(u),
        lambda u: -3 * np.cos(u) - 1.5j * np.sin(u),
        (0.0, 3.0),
    )
    s = np.linspace(0, curve.length, 40)
    speed = CubicSpline(s, 1.5 + 0.4 * np.sin(s))
    path = path_along("varying", curve, speed, segments=segments)
    check_joints(path, closed=False)
    places, _, omega, v, slope = sampled(path, 20_000)
    assert length(path) == pytest.approx(curve.length, abs=1e-9)
    arc, before, kappa = [], 0.0, []
    for segment in path.curve:
        theta = np.linspace(0, segment.duration, 1 + 20_000 // segments)
        arc.append(before + segment.speed.polynomial.antiderivative()(theta))
        before = float(arc[-1][-1])
        assert max(map(len, segment.speed.coefficients)) <= 4 and len(segment.speed.coefficients) < 40
    arc = np.concatenate(arc)
    u = curve.at(np.clip(arc, 0, curve.length))
    kappa = 4.5 / (9 * np.sin(u) ** 2 + 2.25 * np.cos(u) ** 2) ** 1.5
    assert np.abs(places - (3 * np.cos(u) + 1.5j * np.sin(u))).max() < TOLERANCE
    assert np.abs(v - speed(arc)).max() < 0.004
    assert np.abs(slope - speed(arc) * speed(arc, 1)).max() < 0.03
    assert np.abs(omega / v - kappa).max() < 6e-3


def test_arc_length_is_as_exact_as_rounding() -> None:
    curve = Curve(lambda u: u + 0.5j * u**2, lambda u: 1 + 1j * u, lambda u: 1j + 0 * u, (-1.0, 2.0))
    u = np.linspace(-1, 2, 50)
    exact = 0.5 * (u * np.hypot(1, u) + np.arcsinh(u))
    np.testing.assert_allclose(curve.arc_length(u), exact - exact[0], atol=1e-13)
    np.testing.assert_allclose(curve.at(exact - exact[0]), u, atol=1e-12)


def test_a_closer_tolerance_is_kept_with_more_pieces() -> None:
    curve = Curve(
        lambda u: 2 * np.cos(u) + 1j * np.sin(u),
        lambda u: -2 * np.sin(u) + 1j * np.cos(u),
        lambda u: -2 * np.cos(u) - 1j * np.sin(u),
        (0.0, 3.0),
    )
    counts = []
    for scale in (1.0, 1e-4):
        (segment,) = path_along("ellipse", curve, 1.0, scale=scale).curve
        theta = np.linspace(0, segment.duration, 999)
        _, x, y = segment.poses(theta).T
        assert np.abs(x + 1j * y - curve.position(curve.at(np.minimum(theta, curve.length)))).max() < scale * TOLERANCE
        counts.append(len(segment.turn_rate.coefficients))
    assert counts[0] < counts[1] < 200


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ellipse(a=-1.0), r"path\.a: expected a positive finite number \(m\), got -1"),
        (lambda: ellipse(speed=0.0), r"path\.speed"),
        (lambda: ellipse(segments=0), r"path\.segments: expected a whole number from 1 to 1000, got 0"),
        (lambda: ellipse(laps=-2), r"path\.laps"),
        (lambda: oval(float("nan")), r"path\.speed"),
        (lambda: figure_eight(size=0.0), r"path\.size"),
        (lambda: slalom(length=float("inf")), r"path\.length"),
        (lambda: slalom(amplitude=0.0), r"path\.amplitude"),
        (lambda: slalom(periods=0), r"path\.periods"),
        (lambda: obstacle_path(-1.0), r"path\.speed"),
    ],
)
def test_bad_numbers_get_one_line(make: Callable[[], Path], message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        make()
    assert "\n" not in str(raised.value)


def test_a_curve_that_is_nearly_straight_ends_where_it_should() -> None:
    """There no small change of the turning rate moves the end forwards: only more pieces do."""
    a, k = 1e-3, np.pi / 2
    curve = Curve(
        lambda u: u + 1j * a * np.sin(k * u),
        lambda u: 1 + 1j * a * k * np.cos(k * u),
        lambda u: -1j * a * k**2 * np.sin(k * u),
        (0.0, 25.0, 50.0),
    )
    (segment,) = path_along("ripple", curve, 1.0).curve
    alpha, x, y = segment.poses(np.array([segment.duration]))[0]
    assert abs(alpha - curve.heading(np.array([50.0]))[0]) <= 1e-11
    assert abs(x + 1j * y - curve.position(np.array([50.0]))[0]) <= 1e-11


def test_ripples_of_speed_too_small_to_see_are_still_accelerations() -> None:
    line = Curve(lambda u: u + 0j, lambda u: 1 + 0j * u, lambda u: 0j * u, (0.0, 12.0))
    s = np.linspace(0, 12, 2000)
    speed = CubicSpline(s, 2 + 0.002 * np.sin(6 * s))
    (segment,) = path_along("ripples", line, speed).curve
    theta = np.linspace(0, segment.duration, 20_000)
    v = segment.speed.polynomial
    arc = np.clip(v.antiderivative()(theta), 0, 12)
    assert np.abs(v(theta, 1) - speed(arc) * speed(arc, 1)).max() < 0.03 * 0.024  # of the largest, m/s²


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: ellipse(1e200, 1e200), r"path\.a: expected m, at most 1e\+08"),
        (lambda: oval(1e-320), r"path\.speed: expected m/s, at least 1e-06"),
        (lambda: figure_eight(1e-200), r"path\.size: expected m, at least 1e-06"),
        (lambda: slalom(length=1e-237), r"path\.length: expected m, at least 1e-06"),  # was an OverflowError
    ],
)
def test_numbers_of_no_path_are_refused(make: Callable[[], Path], said: str) -> None:
    with pytest.raises(InputError, match=said):
        make()


def test_numbers_that_overflow_are_refused_soon() -> None:
    curve = Curve(
        lambda u: 1e200 * np.exp(1j * u),
        lambda u: 1e200j * np.exp(1j * u),
        lambda u: -1e200 * np.exp(1j * u),
        (0.0, 1.0),
    )
    with pytest.raises(InputError, match="not smooth enough"):
        path_along("huge", curve, 1.0)


def test_a_corner_is_no_reference() -> None:
    corner = Curve(lambda u: np.abs(u) + 1j * u, lambda u: np.sign(u) + 1j, lambda u: 0j * u, (-1.0, 0.3, 1.0))
    with pytest.raises(InputError, match=r"path corner: .* not smooth enough at 1\.4"):
        path_along("corner", corner, 1.0)


@pytest.mark.parametrize("name", ["oval", "figure eight", "slalom", "ellipse"])
def test_the_library_holds_along_it(name: str) -> None:
    make, _, _, closed, _ = CASES[name]
    path = make()
    following = follow(path, closed=closed)
    assert following.closed == closed
    assert float(following.reference.length) == pytest.approx(length(path), abs=1e-9)
