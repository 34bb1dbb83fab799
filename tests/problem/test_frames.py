"""Frames of ROS: there and back, and what the axes of REP 103 say of a car and of points."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from cfjax.errors import InputError
from cfjax.problem import (
    Frame,
    KinematicBicycle,
    Pose,
    ReferencePoint,
    RosPose,
    deviation_from_ros,
    deviation_rate,
    deviation_to_ros,
    pose_from_ros,
    pose_to_ros,
    to_deviation,
    waypoints,
)


RNG = np.random.default_rng(0)
TRIPLES = RNG.uniform(-3, 3, (20, 3))
CAR = KinematicBicycle()


@pytest.mark.parametrize(
    ("there", "back"), [(pose_to_ros, pose_from_ros), (deviation_to_ros, deviation_from_ros)], ids=["pose", "deviation"]
)
def test_there_and_back(there: Callable[..., tuple], back: Callable[..., tuple]) -> None:
    for triple in TRIPLES:
        assert back(there(triple)) == pytest.approx(tuple(triple), abs=1e-12)
        assert there(back(triple)) == pytest.approx(tuple(triple), abs=1e-12)
    columns = tuple(TRIPLES.T)
    np.testing.assert_allclose(back(there(columns)), columns, atol=1e-12)


def test_a_car_moves_along_its_yaw() -> None:
    """Forward is (cos yaw, sin yaw) in ROS, and a left turn has a positive rate of yaw."""
    for alpha, x, y in TRIPLES:
        _, _, yaw = pose_to_ros((alpha, x, y))
        still = ReferencePoint(0.0, 0.0)  # at rest in the origin, heading 0: a deviation from it is a state
        turn, *velocity, _ = map(float, deviation_rate(CAR, (alpha, x, y, 2.0), (1.0, 0.5, 0.0), still))
        assert velocity == pytest.approx([2.0 * math.cos(yaw), 2.0 * math.sin(yaw)])
        assert turn > 0


def test_an_offset_is_what_ros_makes_of_two_poses() -> None:
    """The pose of the car in the reference's frame, x ahead and y to the left, by the transform that tf2 does."""
    for reference, own in zip(TRIPLES[::2], TRIPLES[1::2], strict=True):
        x_r, y_r, yaw_r = pose_to_ros(reference)
        x, y, yaw = pose_to_ros(own)
        turned = complex(x - x_r, y - y_r) * np.exp(-1j * yaw_r)
        deviation = to_deviation(CAR, (*own, 1.0), tuple(reference), ReferencePoint(0.0, 1.0))
        ahead, left, turn = map(float, deviation_to_ros(deviation[:3]))
        assert complex(ahead, left) == pytest.approx(turned)
        assert math.cos(turn - (yaw - yaw_r)) == pytest.approx(1.0)


def test_a_heading_in_a_file_is_the_pose_s_of_its_frame() -> None:
    for pose in TRIPLES:
        assert pose[0] + Frame.ROS.shift == pose_to_ros(tuple(pose)).yaw
        assert pose[0] + Frame.PAPER.shift == pose[0]
    assert Frame("ros").heading == "yaw" in RosPose._fields and Frame("paper").heading == "alpha" in Pose._fields
    with pytest.raises(InputError, match="frame: expected one of paper, ros, got ROS2"):
        Frame("ROS2")


def test_points_of_a_map_are_taken_as_they_are() -> None:
    path = waypoints([[1.0, 2.0], [3.0, 2.0], [5.0, 2.0]])
    assert pose_to_ros(path.curve[0].start) == pytest.approx(RosPose(1.0, 2.0, 0.0), abs=1e-6)


def test_anything_but_three_numbers_is_refused() -> None:
    assert pose_from_ros((0, 0, 0)) == Pose(-math.pi / 2, 0.0, 0.0)
    with pytest.raises(InputError, match=r"pose: expected 3 numbers \(x, y, yaw\)"):
        pose_from_ros((1.0, 2.0))
    with pytest.raises(InputError, match=r"deviation: expected 3 numbers \(alpha, x, y\)"):
        deviation_to_ros((0.0, 0.0, 0.0, 0.0))
