"""Bounds of references as a file writes them, and one reference as a message names it."""

from collections.abc import Sequence

from cfcheck.exact.rational import Range, about
from cfcheck.path.bounds import Bounds, Extreme
from cfcheck.reader import Item


BOUNDS, CURVATURE_RATE = ("curvature", "speed", "acceleration"), "curvature_rate"


def place_of(extremes: Sequence[Extreme], index: int) -> str:
    """Which reference is spoken of, in words; nothing where there is but one."""
    if len(extremes) == 1:
        return ""
    profile = extremes[index].profile
    curvature = profile["turn_rate"] / profile["speed"]
    changing = (profile["turn_rate_slope"] - curvature * profile["speed_slope"]) / profile["speed"]
    return (
        f"curvature {about(curvature)} 1/m, speed {about(profile['speed'])} m/s, "
        f"acceleration {about(profile['speed_slope'])} m/s^2, "
        + (
            f"curvature rate {about(changing)} 1/(m s), "
            if any(each.profile["turn_rate_slope"] for each in extremes)
            else ""
        )
    )


def read_bounds(item: Item) -> Bounds:
    """Intervals of curvature (1/m), speed (m/s) and acceleration (m/s²).

    Raises:
        Unreadable: says what was expected where.
    """
    return _bounds(item.record(*BOUNDS))


def read_stretch_bounds(item: Item) -> Bounds:
    """The same of a stretch of path, and the rate of its curvature, 1/(m s), where that is bounded."""
    if isinstance(item.value, dict) and CURVATURE_RATE in item.value:
        return _bounds(item.record(*BOUNDS, CURVATURE_RATE))
    return read_bounds(item)


def _bounds(entries: Sequence[Item]) -> Bounds:
    found: list[Range] = []
    for entry in entries:
        lower, upper = (end.rational() for end in entry.items(2, 2))
        if lower > upper:
            entry.refuse("an interval, lower end first")
        found.append((lower, upper))
    if not found[BOUNDS.index("speed")][0] > 0:
        entries[BOUNDS.index("speed")].refuse("speeds above zero")
    return Bounds(**dict(zip((*BOUNDS, CURVATURE_RATE), found, strict=False)))
