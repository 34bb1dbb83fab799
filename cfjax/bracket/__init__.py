"""How good a funnel can be at all: proven upper bounds of the margin, beside the certified one."""

from cfjax.bracket.search import Bound, upper_bound


__all__ = ["Bound", "upper_bound"]
