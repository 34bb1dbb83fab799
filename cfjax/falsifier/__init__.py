"""The adversary: batched searches for the point at which a candidate is worst."""

from cfjax.falsifier.falsifier import Suspect, WorstPoint, falsify, stretch_margins


__all__ = ["Suspect", "WorstPoint", "falsify", "stretch_margins"]
