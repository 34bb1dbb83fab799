"""Learners: from a problem to a candidate funnel."""

from typing import TYPE_CHECKING

from cfjax.lazy import on_first_use


if TYPE_CHECKING:
    from cfjax.learner.gradient import Learned, learn
    from cfjax.learner.objective import learn_for
    from cfjax.learner.polytope import learn_polytope


__all__ = ["Learned", "learn", "learn_for", "learn_polytope"]

__getattr__ = on_first_use(__name__)
