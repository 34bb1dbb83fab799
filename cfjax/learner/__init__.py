"""Learners: from a problem to a candidate funnel."""

from cfjax.learner.gradient import Learned, learn
from cfjax.learner.objective import learn_for
from cfjax.learner.polytope import learn_polytope


__all__ = ["Learned", "learn", "learn_for", "learn_polytope"]
