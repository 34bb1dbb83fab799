"""The adversary: batched searches for the point at which a candidate is worst."""

from cfjax.falsifier.falsifier import Counterexample, WorstPoint, falsify, stretch_margins
from cfjax.falsifier.held import first_escape


__all__ = ["Counterexample", "WorstPoint", "falsify", "first_escape", "stretch_margins"]
