"""Closed loop: cars driven along a path from funnel to funnel, or along a tube, batched."""

from cfjax.simulation.rollout import drive_cars
from cfjax.simulation.tube import drive_tube_cars


__all__ = ["drive_cars", "drive_tube_cars"]
