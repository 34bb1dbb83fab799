"""Learners: from a problem to a candidate funnel."""

from cfjax.learner.gradient import Learned, learn


__all__ = ["Learned", "learn"]
