"""Bounds of first order on what a body sweeps, and obstacles in whole numbers: against sampling and brute force."""

import numpy as np
import pytest
from flint import acb, arb, fmpq

from cfcheck.clearance.half_plane import FootprintClaim, ObstacleClaim, Shadow
from cfcheck.clearance.surroundings import Body
from cfcheck.clearance.sweep import UNIT, Hull, Nearby, Sweep, length_of
from cfcheck.exact.enclosure import Budget
from cfcheck.kernel.level import Contracting
from cfcheck.path.piece import Piece
from cfcheck.path.reference import ExactPose
from cfjax.certificate.hulls import Along, FunnelDisc, reaches


def some_sweep(rng: np.random.Generator) -> Sweep:
    """A piece of some metres with a bend that may change its sign, a correlated funnel, a disc off the axle."""

    def q(value: float) -> fmpq:
        return fmpq(round(1024 * float(value)), 1024)

    turn = tuple(q(value) for value in rng.normal(size=3) * (0.6, 0.5, 0.2))
    speed = (q(rng.uniform(0.5, 3.0)), q(rng.normal() * 0.2))
    piece = Piece(0, q(rng.uniform(0, 2)), q(rng.uniform(0.2, 1.5)), turn, speed, fmpq(0))
    start = ExactPose(q(rng.normal()), acb(arb(q(rng.normal())), arb(q(rng.normal()))))
    half = rng.normal(size=(4, 4))
    shape = np.linalg.inv(0.03 * half @ half.T + 0.01 * np.eye(4))
    rows = [[q(shape[max(i, j), min(i, j)]) for j in range(4)] for i in range(4)]
    disc = FootprintClaim(q(rng.uniform(0, 0.4)), q(rng.choice([0.0, rng.normal() * 0.5])))
    return Sweep(piece, start, start.after(piece), Shadow(rows, Contracting(q(rng.normal() * 0.3)), disc))


def swept(sweep: Sweep, rng: np.random.Generator, cars: int) -> np.ndarray:
    """Places of the disc's centre for cars anywhere on the funnel's boundary, anywhere along the piece."""
    piece, disc = sweep.piece, sweep.shadow.disc
    t = np.linspace(0, float(piece.duration), 401)
    turn, speed = (np.polynomial.Polynomial([float(c) for c in each]) for each in (piece.turn_rate, piece.speed))
    heading = float(sweep.start.heading) + turn.integ()(t)
    step = np.diff(t) / 6

    def moved(direction):
        def values(at: np.ndarray) -> np.ndarray:
            return speed(at) * direction(float(sweep.start.heading) + turn.integ()(at))

        middle = (t[1:] + t[:-1]) / 2
        return np.concatenate([[0.0], np.cumsum(step * (values(t[:-1]) + 4 * values(middle) + values(t[1:])))])

    x = float(sweep.start.position.real.mid()) + moved(lambda a: -np.sin(a))
    y = float(sweep.start.position.imag.mid()) + moved(np.cos)
    index = rng.integers(0, len(t), cars)
    shape = np.array([[float(entry) for entry in row] for row in sweep.shadow.shape])
    level = np.exp(-float(sweep.shadow.level.rate) * (float(piece.theta) + t[index]))
    w = rng.normal(size=(cars, 4))
    d = w * np.sqrt(level / np.einsum("ki,ij,kj->k", w, shape, w))[:, None]
    c, s, own = np.cos(heading[index]), np.sin(heading[index]), heading[index] + d[:, 0]
    px = x[index] + c * d[:, 1] - s * d[:, 2] - float(disc.offset) * np.sin(own)
    py = y[index] + s * d[:, 1] + c * d[:, 2] + float(disc.offset) * np.cos(own)
    return np.stack([px, py], axis=1)


@pytest.mark.parametrize("seed", range(12))
def test_no_car_gets_further_than_is_said(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sweep = some_sweep(rng)
    places, radius = swept(sweep, rng, 4000), float(sweep.shadow.disc.radius)
    left, low, right, high = (side / UNIT for side in sweep.box or ())
    assert (places.min(axis=0) >= (left + radius, low + radius)).all()
    assert (places.max(axis=0) <= (right - radius, high - radius)).all()
    along = Along.of([sweep.piece], [sweep.start, sweep.end])
    level = np.array(
        [float(sweep.shadow.level.extent((sweep.piece.theta, sweep.piece.theta + sweep.piece.duration))[1])]
    )
    for normal in rng.integers(-40, 41, size=(24, 2)).tolist():
        if normal == [0, 0]:
            continue
        size = float(np.hypot(*normal))
        bound = sweep.reach((normal[0], normal[1])) / UNIT
        assert (places @ normal).max() + radius * size <= bound
        told = reaches(along, level, FunnelDisc.of(sweep.shadow), np.array([normal]) / size)[0, 0] * size
        assert told == pytest.approx(bound, abs=1e-6 * size)  # the finder's bound is the checker's


def test_a_short_piece_is_bounded_closely() -> None:
    rng = np.random.default_rng(3)
    sweep = some_sweep(rng)
    first = next(iter(sweep.piece.split([fmpq(1, 64)])))
    short = Sweep(first, sweep.start, sweep.start.after(first), sweep.shadow)
    places, radius = swept(short, rng, 20000), float(short.shadow.disc.radius)
    for angle in np.linspace(-np.pi, np.pi, 16):
        normal = round(1000 * np.cos(angle)), round(1000 * np.sin(angle))
        size = float(np.hypot(*normal))
        assert short.reach(normal) / UNIT / size - ((places @ normal).max() / size + radius) < 0.3


def test_hulls_in_whole_numbers_are_larger_than_the_true_ones() -> None:
    rng = np.random.default_rng(1)
    claims = [
        ObstacleClaim(
            tuple(
                (fmpq(int(x), 997), fmpq(int(y), 1009))
                for x, y in rng.integers(-9000, 9000, size=(rng.integers(1, 5), 2))
            ),
            fmpq(int(rng.integers(0, 3)), 7),
        )
        for _ in range(60)
    ]
    for number, claim in enumerate(claims):
        hull = Hull.of(number, claim)
        for normal in ((3, 4), (-7, 1), (0, -5), (1, 0)):
            exact = min(normal[0] * x + normal[1] * y for x, y in claim.corners)
            limit = arb(exact) - claim.round * arb(normal[0] ** 2 + normal[1] ** 2).sqrt()
            told = fmpq(hull.nearest(normal, length_of(normal)), UNIT)
            assert arb(told) <= limit and limit - arb(told) < fmpq(32, UNIT)
        for x, y in claim.corners:
            assert hull.box[0] <= (x - claim.round) * UNIT and (x + claim.round) * UNIT <= hull.box[2]
            assert hull.box[1] <= (y - claim.round) * UNIT and (y + claim.round) * UNIT <= hull.box[3]
    nearby = Nearby(claims)
    for _ in range(100):
        x, y, width, height = (rng.uniform(-9, 9, 4) * UNIT).astype(int).tolist()
        box = x, y, x + abs(width), y + abs(height)
        own = {
            h.number
            for h in nearby.hulls
            if h.box[0] <= box[2] and h.box[2] >= box[0] and h.box[1] <= box[3] and h.box[3] >= box[1]
        }
        assert {hull.number for hull in nearby.meeting(box)} == own


def test_discs_and_long_numbers_are_paid_for_where_nothing_is_near() -> None:
    """A file may have many parts: each has to cost what looking at it takes."""
    sweep = some_sweep(np.random.default_rng(1))

    def spent(count: int, digits: int = 1) -> int:
        shape = [[entry * (1 + fmpq(1, 10**digits)) for entry in row] for row in sweep.shadow.shape]
        shadow = Shadow(shape, sweep.shadow.level, sweep.shadow.disc)
        budget = Budget(10**9)
        Body((shadow,) * count, Nearby([]), budget).left_open(sweep.piece, sweep.start, sweep.end, [])
        return 10**9 - budget.left

    assert spent(8) - spent(1) == 7 * (spent(2) - spent(1)) > 0
    assert spent(1, digits=2000) - spent(1) > 10 * (spent(2) - spent(1))
