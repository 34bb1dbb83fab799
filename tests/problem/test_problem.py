"""Questions that cannot be asked are refused with the expected and the actual."""

import re

import numpy as np
import pytest

from cfjax.errors import InputError
from cfjax.problem import (
    Box,
    Ellipsoid,
    Interval,
    KinematicBicycle,
    Method,
    Pose,
    Problem,
    Profile,
    Segment,
    Twist,
    ball,
    circle,
    oval,
    slalom,
    straight,
    tube,
    waypoints,
)
from cfjax.problem.deviation import BATCH
from cfjax.problem.problem import PLACES


S = Box((1.0, 1.0, 1.0, 3.0))


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: circle(radius=-1.0), "path.radius: expected a positive finite number (m), got -1.0"),
        (lambda: straight(speed=float("nan")), "path.speed: expected a positive finite number (m/s), got nan"),
        (lambda: Problem(circle(radius=0.3)), "needs steering angle 48.58°, limit 45° (w = tan = 1.133)"),
        (lambda: Problem(circle(), inlet=ball(0.5, 3)), "sets.inlet: expected a number or 4 numbers, one per state"),
        (lambda: Problem(circle(), safe=Box((0.4, 1.0, 1.0, 3.0))), "sets.inlet: reaches 0.5 in alpha"),
        (lambda: Problem(circle(), timing=Interval(0.0, 2.0)), "timing: expected 0 < lower <= 1 <= upper"),
        (lambda: Problem(circle(), timing=Interval(1.2, 2.0)), "timing: expected 0 < lower <= 1 <= upper"),
        (lambda: Interval(2.0, 1.0), "lower first"),
        (lambda: Ellipsoid((0.5, 0.0)), "expected positive finite numbers"),
        (lambda: Box(()), "expected positive finite numbers"),
        (lambda: KinematicBicycle(wheelbase=0.0), "vehicle.wheelbase: expected a positive finite number"),
        (lambda: Problem(circle(), inlet=ball(4.0)), "sets.inlet: expected a heading below pi rad, got 4.0"),
        (lambda: Profile((0.0, 1.0), ((),)), "a coefficient in each"),
        (
            lambda: Segment(Profile((0.5, 2.0), ((0.0,),)), Profile.constant(1.0, 2.0), Pose(0.0, 0.0, 0.0)),
            "the same range of theta, from 0",
        ),
        (lambda: Profile((0.0, 1.0, 0.5), ((1.0,), (1.0,))), "increasing breaks"),
        (lambda: Profile((0.0, 1.0), ((float("inf"),),)), "finite breaks and coefficients"),
    ],
)
def test_bad_questions_are_refused(build, words: str) -> None:
    with pytest.raises(InputError) as caught:
        build()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


class Crab(KinematicBicycle):
    """Its reference slides sideways, which the bicycle cannot."""

    def reference(self, turn_rate, speed):
        return Twist(turn=turn_rate, lateral=0.6 * speed, forward=0.8 * speed), (0.8 * speed,)


def test_reference_that_is_no_motion_of_the_vehicle_is_refused() -> None:
    with pytest.raises(InputError, match="is no motion of the vehicle kinematic_bicycle: its best inputs leave a rate"):
        Problem(circle(), vehicle=Crab())


def test_the_first_place_that_needs_too_much_is_named_wherever_it_is() -> None:
    """Many places are looked at together; the reference implementation here looks at them one by one."""
    path, car = slalom(amplitude=1.5), KinematicBicycle()
    first = path.curve[0]
    theta = np.linspace(0.0, first.duration, PLACES)
    needed = car.wheelbase * first.turn_rate.polynomial(theta) / first.speed.polynomial(theta)
    (at, *_) = np.flatnonzero(np.abs(needed) > car.max_tan_steering)
    angle = np.degrees(np.arctan(needed[at]))
    said = (
        f"segment 0 at theta = {theta[at]:.4g} s needs steering angle {angle:.4g}°, limit {np.copysign(45, angle):g}°"
    )
    with pytest.raises(InputError, match=re.escape(said)):
        Problem(path)


def test_what_a_long_path_needs_is_what_its_places_need_one_by_one() -> None:
    problem = Problem(slalom(amplitude=0.3, periods=5), input_share=0.5)
    points = [segment.point(t) for segment in problem.path.distinct for t in np.linspace(0, segment.duration, PLACES)]
    assert len(points) % BATCH
    needed = np.array([problem.feedforward(point) for point in points[::7]])
    low, high = np.array([(limits.lower, limits.upper) for limits in problem.inputs]).T
    np.testing.assert_allclose(high[1], 0.5 + 0.5 * np.abs(needed[:, 1]).max(), rtol=1e-3)
    np.testing.assert_allclose(low[1], -high[1], rtol=1e-9)


def test_a_path_is_printed_as_one_line() -> None:
    assert str(circle()) == "circle: 1 segment, 9.42 m, closed, 1.57 m/s"
    assert str(oval()) == "oval: 2 segments, 9.69 m, closed, 1 m/s"
    assert str(tube(1.8, (1, 4), 0.5)) == (
        "tube: every path within curvature -1.8 to 1.8 1/m, speed 1 to 4 m/s, dv/dt -0.5 to 0.5 m/s²"
    )
    path = waypoints([[0, 0], [1, 0], [2, 0], [3, 0.1]], speed=1)
    assert str(path) == path.source and "4 points, 3" in str(path)


def test_segments_with_one_profile_are_one_kind() -> None:
    path = slalom(periods=3)
    assert path.kinds == (0, 1, 0, 1, 0, 1)
    assert path.distinct == path.segments[:2]


def test_tracking_fixes_the_timing_input() -> None:
    assert Problem(circle(), method=Method.TT).inputs[0] == Interval(1.0, 1.0)
    assert Problem(circle()).inputs[0] == Interval(0.5, 2.0)


def test_feedforward_holds_the_reference() -> None:
    problem = Problem(circle(radius=2.0, speed=3.0), safe=S)
    inputs = problem.feedforward(problem.path.segments[0].point(0.0))
    np.testing.assert_allclose(inputs, [1.0, 0.34 / 2.0, 0.0], atol=1e-12)


def test_the_former_name_of_the_input_share_works_with_a_line_of_warning(capsys: pytest.CaptureFixture[str]) -> None:
    assert Problem(circle(), authority=0.5) == Problem(circle(), input_share=0.5)
    assert capsys.readouterr().err == (
        "warning: authority is called input_share now; the old name works until version 0.2\n"
    )
