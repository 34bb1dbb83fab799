"""Closed loop: cars driven through a funnel, batched."""

from cfjax.simulation.rollout import Rollouts, drive_cars, record_cars


__all__ = ["Rollouts", "drive_cars", "record_cars"]
