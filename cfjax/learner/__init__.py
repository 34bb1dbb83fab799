"""Learners: from a problem to a candidate funnel."""

import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from cfjax.coerce import one_of
from cfjax.lazy import on_first_use


if TYPE_CHECKING:
    from cfjax.learner.elimination import Elimination
    from cfjax.learner.gradient import Learned, learn
    from cfjax.learner.learner import Found, Learner, LearningTask
    from cfjax.learner.objective import learn_for
    from cfjax.learner.polytope import learn_polytope


class Entry(NamedTuple):
    """Where a learner is: module and class; and the options that it is made from, which are its alone."""

    module: str
    own: str
    keys: tuple[str, ...]


LEARNERS = {
    "gradient": Entry("by_gradient", "ByGradient", ("restarts", "rounds")),
    "polytope": Entry("by_elimination", "ByElimination", ("polytope",)),
}
"""By name. Imported on first use, for either brings JAX and more."""

DEFAULT = "gradient"
"""What is used unless somebody says another."""


def require_learner(name: "str | Learner") -> None:
    """Raises InputError for what is neither one of the names in LEARNERS nor a learner."""
    if isinstance(name, str) or not isinstance(name, importlib.import_module("cfjax.learner.learner").Learner):
        one_of("learner", name, LEARNERS)


def learner_named(name: "str | Learner", options: Mapping[str, Any]) -> "Learner":
    """The learner of one of the names in LEARNERS, made from the options that are its own; a learner is one already.

    Raises:
        InputError: for another name.
    """
    if not isinstance(name, str):
        return name
    module, own, keys = LEARNERS[one_of("learner", name, LEARNERS)]
    made = getattr(importlib.import_module(f"cfjax.learner.{module}"), own)
    return made(*(options[key] for key in keys))


def keys_of_others(name: "str | Learner") -> list[str]:
    """Options that only other learners are made from."""
    return [key for other, entry in LEARNERS.items() if other != name for key in entry.keys]


__all__ = [
    "LEARNERS",
    "Elimination",
    "Found",
    "Learned",
    "Learner",
    "LearningTask",
    "learn",
    "learn_for",
    "learn_polytope",
]

__getattr__ = on_first_use(__name__)
