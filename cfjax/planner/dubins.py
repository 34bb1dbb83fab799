"""The shortest ways of a car that drives forwards from one pose to another: two arcs and what joins them.

L. E. Dubins, American Journal of Mathematics 79 (1957); formulas as A. M. Shkel and V. Lumelsky give them, Robotics and
Autonomous Systems 34 (2001).
"""

import cmath
import math


TURN = 2 * math.pi

Arcs = list[tuple[float, float]]  # curvature (1/m, positive to the left) and length (m), one after another


def dubins_ways(start: tuple[complex, float], end: tuple[complex, float], radius: float) -> list[Arcs]:
    """Ways between two poses (place x + iy in m, direction of motion in rad from +x), the shortest first."""
    way = (end[0] - start[0]) / radius
    d, line = abs(way), cmath.phase(way)
    a, b = start[1] - line, end[1] - line
    sa, ca, sb, cb, cab = math.sin(a), math.cos(a), math.sin(b), math.cos(b), math.cos(a - b)
    found = []
    for turn in (1, -1):  # L S L and R S R
        x, y = d + turn * (sa - sb), turn * (cb - ca)
        found.append(([turn, 0, turn], *_same(turn, a, b, math.atan2(y, x), math.hypot(x, y))))
    square = d * d - 2 + 2 * cab
    for turn in (1, -1):  # L S R and R S L
        if (p := square + 2 * d * turn * (sa + sb)) >= 0:
            p = math.sqrt(p)
            at = math.atan2(-turn * (ca + cb), d + turn * (sa + sb)) - math.atan2(-2 * turn, p)
            found.append(([turn, 0, -turn], (turn * (at - a)) % TURN, p, (turn * (at - b)) % TURN))
    for turn in (1, -1):  # L R L and R L R
        cosine = (6 - d * d + 2 * cab - 2 * d * turn * (sa - sb)) / 8
        if abs(cosine) <= 1:
            p = TURN - math.acos(cosine)
            at = math.atan2(-turn * (ca - cb), d + turn * (sa - sb))
            first = (turn * (at - a) + p / 2) % TURN
            found.append(([turn, -turn, turn], first, p, (turn * (b - a) - first + p) % TURN))
    ways = [
        (
            sum(lengths),
            [(kind / radius, length * radius) for kind, length in zip(kinds, lengths, strict=True) if length > 0],
        )
        for kinds, *lengths in found
    ]
    return [arcs for _, arcs in sorted(ways, key=lambda way: way[0])]


def _same(turn: int, a: float, b: float, at: float, p: float) -> tuple[float, float, float]:
    """Lengths of two arcs to the same side and the line between them."""
    return (turn * (at - a)) % TURN, p, (turn * (b - at)) % TURN
