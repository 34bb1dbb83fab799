"""Closed loop: cars driven through a funnel or along a tube, batched."""

from cfjax.simulation.rollout import drive_cars
from cfjax.simulation.tube import drive_tube_cars


__all__ = ["drive_cars", "drive_tube_cars"]
