"""The adversary: batched searches for the point at which a candidate is worst."""

from cfjax.falsifier.falsifier import Suspect, WorstPoint, falsify


__all__ = ["Suspect", "WorstPoint", "falsify"]
