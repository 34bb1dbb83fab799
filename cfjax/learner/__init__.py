"""Learners: from a problem to a candidate funnel."""

from cfjax.learner.gradient import Learned, learn
from cfjax.learner.objective import learn_for


__all__ = ["Learned", "learn", "learn_for"]
