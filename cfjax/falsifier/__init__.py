"""The adversary: batched searches for the point at which a candidate is worst."""

from cfjax.falsifier.falsifier import WorstPoint, falsify


__all__ = ["WorstPoint", "falsify"]
