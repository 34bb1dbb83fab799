"""The question: which vehicle, along which path, between which sets, within which inputs.

Everything downstream (learner, falsifier, certificate, control, simulation, report) reads the one definition that
stands here; no other place writes the dynamics, the path or the sets a second time.
"""

from typing import TYPE_CHECKING

from cfjax.lazy import on_first_use
from cfjax.problem.deviation import affine_along, affine_deviation, deviation_rate, feedforward, to_deviation, to_state
from cfjax.problem.feedback import FeedbackLaw, LinearLaw
from cfjax.problem.frames import Frame, RosPose, deviation_from_ros, deviation_to_ros, pose_from_ros, pose_to_ros
from cfjax.problem.geometric_laws import PurePursuitLaw, StanleyLaw
from cfjax.problem.obstacles import Disc, FootprintDisc, Obstacle, Polygon, Wall, disc_centres, distances
from cfjax.problem.path import Path, Pose, Profile, ReferencePoint, Segment, circle, straight, tube
from cfjax.problem.problem import Method, Problem
from cfjax.problem.sets import Box, Ellipsoid, ball
from cfjax.problem.symmetry import mirror_signs
from cfjax.problem.tube import Tube
from cfjax.problem.vehicle import Interval, KinematicBicycle, Twist, Vehicle


if TYPE_CHECKING:  # of curves: they bring SciPy, which a straight line and a circle do without
    from cfjax.problem.named_curves import ellipse, figure_eight, obstacle_path, oval, slalom
    from cfjax.problem.point_path import waypoints


__all__ = [
    "Box",
    "Disc",
    "Ellipsoid",
    "FeedbackLaw",
    "FootprintDisc",
    "Frame",
    "Interval",
    "KinematicBicycle",
    "LinearLaw",
    "Method",
    "Obstacle",
    "Path",
    "Polygon",
    "Pose",
    "Problem",
    "Profile",
    "PurePursuitLaw",
    "ReferencePoint",
    "RosPose",
    "Segment",
    "StanleyLaw",
    "Tube",
    "Twist",
    "Vehicle",
    "Wall",
    "affine_along",
    "affine_deviation",
    "ball",
    "circle",
    "deviation_from_ros",
    "deviation_rate",
    "deviation_to_ros",
    "disc_centres",
    "distances",
    "ellipse",
    "feedforward",
    "figure_eight",
    "mirror_signs",
    "obstacle_path",
    "oval",
    "pose_from_ros",
    "pose_to_ros",
    "slalom",
    "straight",
    "to_deviation",
    "to_state",
    "tube",
    "waypoints",
]

__getattr__ = on_first_use(__name__)
