"""Which tubes hold along a path in turn: the cheapest chain, chosen in floating point.

A tube can only be left for one that holds all that is left of it after the distance it has had. Cost is the lateral
half-width √((C⁻¹)_xx) weighted by length. What is chosen keeps off the edge of what exact arithmetic confirms.
"""

import math
from functools import lru_cache

import numpy as np
from flint import fmpq
from jaxtyping import Bool, Float, Int

from cfcheck.path.reference import Gap, Reference
from cfjax.certificate.joints import widest_ratio
from cfjax.tubes.certified import CertifiedTube, timing_of


DISTANCE_SLACK = 1e-9  # a choice in floating point keeps off the exact condition
CHANGE_COST = 1e-9  # relative to the whole path: of two chains equally wide the one with fewer links


def choose(
    reference: Reference, tubes: tuple[CertifiedTube, ...], holds: Bool[np.ndarray, "tubes pieces"], gap: Gap | None
) -> list[tuple[int, int, int]]:
    """The cheapest chain, as (first piece, end piece, tube): dynamic programming over where runs begin.

    best[f, i, b] is the least cost up to piece b of a chain that begins in tube f and enters tube i at b; a run of tube
    i from a to b costs width_i (arc_b − arc_a), so that for given (f, i) the best a is a running minimum.
    """
    count, size = holds.shape
    arc = np.array([float(piece.arc) for piece in reference.pieces] + [float(reference.length)])
    widths = np.array([_half_width(tube) for tube in tubes])
    every = np.arange(count)
    latest = np.searchsorted(arc, arc[:, None, None] - _distances(tubes, None), side="right") - 1
    latest = np.minimum(latest, np.arange(size + 1)[:, None, None] - 1)  # [b, i, j]: a run that ends at b is not empty
    since = np.zeros((count, size + 1), int)  # [i, b]: tube i holds from this piece up to b
    for b in range(1, size + 1):
        since[:, b] = np.where(holds[:, b - 1], since[:, b - 1], b)

    starts = np.flatnonzero(holds[:, 0]) if gap else np.array([0])  # an open chain may begin in any tube
    chains = len(starts)
    best = np.full((chains, count, size), np.inf)
    if gap:
        best[np.arange(chains), starts, 0] = 0.0
    else:
        best[0, holds[:, 0], 0] = 0.0
    origin = np.zeros((2, chains, count, size), int)  # tube before, and the piece at which it was entered
    least = np.full((chains, count, size), np.inf)  # running minimum of best − width · arc since the tube holds
    entered = np.zeros((chains, count, size), int)
    change = CHANGE_COST * widths.max() * arc[-1]
    f, i = np.arange(chains)[:, None, None], every[:, None]
    for b in range(size):
        if b:
            at = np.maximum(latest[b], 0)
            possible = latest[b] >= since[:, b, None]
            cost = np.where(possible, least[f, i, at] + (widths * arc[b])[:, None] + change, np.inf)
            before = cost.argmin(1)
            best[:, :, b] = np.where(holds[:, b], np.take_along_axis(cost, before[:, None], 1)[:, 0], np.inf)
            origin[0, :, :, b] = before
            origin[1, :, :, b] = entered[f[..., 0], before, at[before, every]]
        fresh = best[:, :, b] - widths * arc[b]
        carried = np.where(since[:, b] < b, least[:, :, b - 1], np.inf) if b else np.full_like(fresh, np.inf)
        least[:, :, b] = np.minimum(fresh, carried)
        entered[:, :, b] = np.where(fresh <= carried, b, entered[:, :, b - 1] if b else 0)

    last = np.full((chains, count), size - 1)  # the last piece at which the last run may begin
    if gap:
        last = np.searchsorted(arc, arc[-1] - _distances(tubes, gap)[:, starts].T, side="right") - 1
        last = np.minimum(last, size - 1)
    at = np.maximum(last, 0)
    total = np.where(last >= since[:, size], least[f[..., 0], every, at] + widths * arc[-1], np.inf)
    chain, tube = np.unravel_index(int(total.argmin()), total.shape)
    if not math.isfinite(total[chain, tube]):
        raise ValueError(_no_chain(reference, tubes, holds, best, since, starts if gap else None, gap))
    runs = []
    begin, end = int(entered[chain, tube, at[chain, tube]]), size
    while True:
        runs.append((begin, end, int(tube)))
        if begin == 0:
            return runs[::-1]
        tube, begin, end = origin[0, chain, tube, begin], int(origin[1, chain, tube, begin]), begin


def _no_chain(
    reference: Reference,
    tubes: tuple[CertifiedTube, ...],
    holds: Bool[np.ndarray, "tubes pieces"],
    best: Float[np.ndarray, "chains tubes pieces"],
    since: Int[np.ndarray, "tubes ends"],
    starts: Int[np.ndarray, " chains"] | None,
    gap: Gap | None,
) -> str:
    """Where every chain ends, and the link that comes closest to leading on. A lap is closed with `starts`."""
    size = holds.shape[1]
    pieces = reference.pieces
    reached = size
    runs: list[tuple[int, int, int]] = []  # chain, tube, and the first piece at which the chain enters it
    while not runs:  # ends: every chain begins with a piece that its tube holds
        for i, entry in enumerate(since[:, reached]):
            for chain, costs in enumerate(best[:, i, entry:reached]):
                entries = np.flatnonzero(np.isfinite(costs))
                runs += [(chain, i, int(entry + entries[0]))] if entries.size else []
        reached -= 1
    reached += 1
    at_end = reached == size
    distances = _distances(tubes, gap if at_end else None)
    end = reference.length if at_end else pieces[reached].arc
    links = [
        (float(distances[i, j]), float(end - pieces[entry].arc), i, int(j))
        for chain, i, entry in runs
        for j in (np.flatnonzero(holds[:, reached]) if starts is None or not at_end else starts[[chain]])
    ]
    needed, available, i, j = min(links, key=lambda link: link[0] - link[1])
    where = "at the end of the lap"
    if not at_end:
        where = f"at theta = {float(pieces[reached].theta):.6g} s of segment {pieces[reached].segment}"
    start = f"no chain of tubes: {where} tube {tubes[i].name} has to be left"
    if math.isinf(needed):
        return f"{start}, and never fits into tube {tubes[j].name}"
    return f"{start} for tube {tubes[j].name} after {available:.6g} m, and fits into it after {needed:.6g} m"


def _half_width(tube: CertifiedTube) -> float:
    """√((C⁻¹)_xx), m."""
    return math.sqrt(float(tube.inverse[1, 1]))


@lru_cache(maxsize=64)
def proven_ratios(tubes: tuple[CertifiedTube, ...]) -> tuple[tuple[fmpq, ...], ...]:
    """For each ordered pair nearly the largest ratio with C₁ ≻ ratio C₂, which is proven; 0 where none is."""
    return tuple(tuple(widest_ratio(first.shape, second.shape) or fmpq(0) for second in tubes) for first in tubes)


@lru_cache(maxsize=64)
def _distances(tubes: tuple[CertifiedTube, ...], gap: Gap | None) -> Float[np.ndarray, "tubes tubes"]:
    """Metres that each tube needs before it hands over to another: infinite where it never does."""
    result = np.full((len(tubes), len(tubes)), np.inf)
    fastest = timing_of(tubes)[1]
    jumps = [gap.jump(tube.shape, tube.inverse) if gap else fmpq(0) for tube in tubes]
    for i, first in enumerate(tubes):
        for j, second in enumerate(tubes):
            # without a gap there is nothing to hand over to itself
            if i == j and gap is None:
                continue
            needed = needed_distance(first, second, proven_ratios(tubes)[i][j], jumps[j], fastest)
            if needed is not None:
                result[i, j] = float(needed[1]) * (1 + DISTANCE_SLACK)
    return result


def needed_distance(
    first: CertifiedTube, second: CertifiedTube, ratio: fmpq, jump: fmpq, fastest: fmpq
) -> tuple[fmpq, fmpq] | None:
    """The level of the first tube at which every deviation is inside the second, and metres of reference to get there.

    `ratio` is one with C₁ ≻ ratio C₂, as large as can be, and `jump` how much √V₂ changes at most where the reference
    jumps. None where it is never reached.
    """
    if jump >= 1 or not ratio > 0:
        return None
    reached = min(ratio * (1 - jump) ** 2, fmpq(1))
    distance = first.distance_to(reached, fastest)
    return None if distance is None else (reached, distance)
