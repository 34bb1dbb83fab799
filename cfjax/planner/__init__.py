"""From a map to a certified path: maps and their files, a search for a way, its smoothing, and the proof by tubes."""

from cfjax.planner.map import Map
from cfjax.planner.map_file import read_map
from cfjax.planner.planning import Plan, plan, replan


__all__ = ["Map", "Plan", "plan", "read_map", "replan"]
