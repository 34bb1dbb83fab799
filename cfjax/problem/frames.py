"""Poses and deviations in the frames of ROS (REP 103), and back.

Both inertial frames are right-handed, and a point has the same x and y in both. Here heading 0 looks along +y, in ROS
yaw 0 looks along +x: yaw = heading + π/2, both counter-clockwise. Seen from a body, here x is to the right and y is
ahead; in ROS x is ahead and y is to the left. Internal states, such as the speed, are the same.

As in `to_deviation`, entries are scalars, or arrays of equal length.

`Frame` says which of the two headings a file holds. Files are converted where they are read and written, and nowhere
else.
"""

import enum
import math
from typing import NamedTuple

from cfjax.coerce import Numbers, choice
from cfjax.problem.deviation import scalars
from cfjax.problem.path import Pose
from cfjax.problem.vehicle import Scalar


QUARTER = math.pi / 2  # rad, from +x to +y


class Frame(enum.Enum):
    """The frame of headings in files: `paper`, from +y, in a column `alpha`; or `ros`, from +x, in a column `yaw`."""

    PAPER = "paper"
    ROS = "ros"

    @classmethod
    def _missing_(cls, value: object) -> "Frame":
        return choice("frame", value, cls)

    @property
    def heading(self) -> str:
        """The name of the heading in files."""
        return {Frame.PAPER: "alpha", Frame.ROS: "yaw"}[self]

    @property
    def shift(self) -> float:
        """What the heading in files exceeds the one here by, rad."""
        return {Frame.PAPER: 0.0, Frame.ROS: QUARTER}[self]


class RosPose(NamedTuple):
    """Position in m, and yaw in rad, counter-clockwise from +x; of a body: x ahead, y to the left."""

    x: Scalar
    y: Scalar
    yaw: Scalar


def pose_from_ros(pose: Numbers) -> Pose:
    """The pose here of one in an inertial frame of ROS, (x, y, yaw) in m and rad.

    Raises:
        InputError: for anything but three numbers.
    """
    x, y, yaw = scalars("pose", pose, RosPose._fields)
    return Pose(yaw - QUARTER, x, y)


def pose_to_ros(pose: Numbers) -> RosPose:
    """The pose in an inertial frame of ROS of one here, (alpha, x, y); the inverse of `pose_from_ros`.

    Raises:
        InputError: for anything but three numbers.
    """
    alpha, x, y = scalars("pose", pose, Pose._fields)
    return RosPose(x, y, alpha + QUARTER)


def deviation_from_ros(offset: Numbers) -> Pose:
    """The deviation here (alpha, x to the right, y ahead) of an offset from the reference in ROS, (x, y, yaw).

    Raises:
        InputError: for anything but three numbers.
    """
    ahead, left, yaw = scalars("offset", offset, RosPose._fields)
    return Pose(yaw, -left, ahead)


def deviation_to_ros(deviation: Numbers) -> RosPose:
    """The offset in ROS (x ahead, y to the left, yaw) of the pose's part of a deviation; inverse of the above.

    Raises:
        InputError: for anything but three numbers.
    """
    alpha, right, ahead = scalars("deviation", deviation, Pose._fields)
    return RosPose(ahead, -right, alpha)
