"""The adversary: batched searches for the point at which a candidate is worst."""

from cfjax.falsifier.falsifier import Suspect, WorstPoint, falsify, stretch_margins
from cfjax.falsifier.held import first_escape


__all__ = ["Suspect", "WorstPoint", "falsify", "first_escape", "stretch_margins"]
