"""Closed loop: cars driven through a funnel, batched."""

from cfjax.simulation.rollout import drive_cars


__all__ = ["drive_cars"]
