"""How long `cfjax.follow` takes between walls and among obstacles, and the checker on what it proves: a table, no test.

    .venv/bin/python scripts/benchmark_corridor.py [--length 300] [--points 500] [--obstacles 100] [--repeats 5]

A closed track of that length with so many points on either edge, in the tubes that travel with the package. Medians
of the processor's time, so that a busy machine matters little; beside them what clearance adds to a replay.
"""

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table


os.environ.setdefault("JAX_PLATFORMS", "cpu")

from cfcheck.claims.document import read_certificate
from cfcheck.clearance.surroundings import prove_surroundings
from cfjax.problem import Disc, Wall
from cfjax.problem.point_path import waypoints
from cfjax.tubes import chain_document, follow


BODY = 0.25  # m, the footprint's disc


def track(length: float, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of a closed centre line, and unit vectors to its left."""
    rng = np.random.default_rng(0)
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    radius = 1 + sum(rng.normal() * 0.12 / k * np.cos(k * angle + rng.uniform(0, 2 * np.pi)) for k in range(2, 6))
    place = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    place *= length / np.linalg.norm(np.roll(place, -1, axis=0) - place, axis=1).sum()
    along = np.roll(place, -1, axis=0) - np.roll(place, 1, axis=0)
    return place, np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]


def poles(place: np.ndarray, count: int) -> list[Disc]:
    """Beside the track, none of them on it."""
    rng, found = np.random.default_rng(1), []
    while len(found) < count:
        at, radius = place[rng.integers(len(place))] + rng.uniform(-6, 6, 2), rng.uniform(0.1, 0.4)
        if np.linalg.norm(place - at, axis=1).min() > radius + BODY + 0.3:
            found.append(Disc(float(at[0]), float(at[1]), radius))
    return found


def median(repeats: int, call: Callable[[], Any]) -> tuple[float, Any]:
    """Milliseconds, and what came out."""
    times, found = [], None
    for _ in range(repeats):
        begin = time.process_time()
        found = call()
        times.append(1000 * (time.process_time() - begin))
    return statistics.median(times), found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--length", type=float, default=300.0)
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--obstacles", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    place, left = track(given.length, given.points)
    path = waypoints(place, closed=True, speed=2.0)

    def walls(width: float) -> list[Wall]:
        return [Wall(np.concatenate([edge, edge[:1]])) for edge in (place + width * left, place - width * left)]

    discs = poles(place, given.obstacles)
    rows: dict[str, dict[str, Any]] = {
        "alone": {},
        f"{given.obstacles} discs": {"obstacles": discs},
        **{f"{2 * given.points} points, half-width {w:g} m": {"obstacles": walls(w)} for w in (1.5, 0.6, 0.4)},
        f"{2 * given.points} points at 1.5 m, {given.obstacles} discs": {"obstacles": [*discs, *walls(1.5)]},
        "corridor=1.5": {"corridor": 1.5},
    }
    table = Table("beside it", "follow", "times alone", "stretches", "replay of clearance", box=None)
    follow(path, closed=True)
    alone = 0.0
    for name, around in rows.items():
        taken, found = median(given.repeats, lambda around=around: follow(path, closed=True, **around))
        alone = alone or taken
        certificate = read_certificate(chain_document(found))
        claims = certificate.claims
        replay = "-"
        if not found.surroundings.is_empty:
            _ = claims.legs[0].reference.piece_poses  # of the path alone
            own, _ = median(
                1, lambda c=certificate: prove_surroundings(c.claims.problem.surroundings, c.claims.legs, c.clearance)
            )
            replay = f"{own:.0f} ms"
        stretches = sum(map(len, found.clearance))
        table.add_row(name, f"{taken:.0f} ms", f"{taken / alone:.1f}", str(stretches), replay)
    Console().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
