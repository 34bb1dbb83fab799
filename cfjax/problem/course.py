"""The reference along a path, for many cars at once, each at its own θ: piecewise polynomials as arrays.

θ counts along the whole path, in s. Turning rate and speed are the path's own polynomials (`Profile`), not samples of
them; a pose is their integral and has no closed form, so it is read from cubics that are close enough.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from cfjax.errors import InputError
from cfjax.problem.deviation import ReferencePoint
from cfjax.problem.path import Path, Profile, Segment


POSE_ERROR = 1e-8  # m and rad: of the cubics, in the middle of a cell where it is largest
MOST_HALVINGS = 16  # of a piece, into cells


class Pieces(NamedTuple):
    """Functions of θ, one per column: on piece i the polynomial with these coefficients of θ − origin, ascending."""

    begin: Float[Array | np.ndarray, " m"]  # θ at which each piece begins
    origin: Float[Array | np.ndarray, "m c"]
    coefficients: Float[Array | np.ndarray, "m c d"]

    def find(self, theta: Float[Array, " k"]) -> Int[Array, " k"]:
        """The piece at θ; the later one where two meet, the first and the last beyond the ends."""
        if self.begin.shape[0] == 1:
            return jnp.zeros(theta.shape, int)
        return jnp.clip(jnp.searchsorted(self.begin, theta, side="right") - 1, 0, self.begin.shape[0] - 1)

    def at(self, piece: Int[Array | np.ndarray, " k"], theta: Float[Array | np.ndarray, " k"]) -> list[tuple]:
        """Value and slope of each column at θ by the polynomials of the given pieces, also outside them.

        NumPy's arrays give NumPy's.
        """
        # one piece for all is no look-up, and what is constant stays a scalar until it is used
        row = 0 if self.begin.shape[0] == 1 else piece
        return [
            _value_and_slope([self.coefficients[row, c, i] for i in range(self.coefficients.shape[2])], theta - origin)
            for c, origin in enumerate(self.origin[row, c] for c in range(self.origin.shape[1]))
        ]


def _value_and_slope(coefficients: Sequence, t: Array | np.ndarray) -> tuple:
    """Horner's scheme, for the polynomial and its derivative."""
    zero = np.broadcast_to(0.0, np.shape(t))  # a zero that compilers see: what is constant costs nothing per car
    value, slope = zero + coefficients[-1], zero
    for c in coefficients[-2::-1]:
        value, slope = value * t + c, slope * t + value
    return value, slope


def _breaks(segment: Segment) -> np.ndarray:
    """Where either profile has one, in s of the segment."""
    return np.union1d(segment.turn_rate.breaks, segment.speed.breaks)


def _rows(profile: Profile, at: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """For each piece of the path that begins at such θ (s) the origin and the coefficients of the profile's own."""
    own = np.searchsorted(profile.breaks, at, side="right") - 1
    table = np.zeros((len(profile.coefficients), order))
    for piece, ascending in enumerate(profile.coefficients):
        table[piece, : len(ascending)] = ascending
    return np.array(profile.breaks)[own], table[own]


def _profiles(segment: Segment, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Begin (m,), origin (m, 2) and coefficients (m, 2, order) of the segment's turning rate and speed."""
    begin = _breaks(segment)[:-1]
    origins, tables = zip(*(_rows(p, begin, order) for p in (segment.turn_rate, segment.speed)), strict=True)
    return begin, np.stack(origins, axis=1), np.stack(tables, axis=1)


def _pose_cubics(segment: Segment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Begin (m,), origin (m, 3) and coefficients (m, 3, 4) of cubics for heading (rad), x and y (m).

    Values and slopes of the pose at the ends of cells, into which the pieces are halved until `POSE_ERROR` is kept:
    no cell has a break inside, so the error falls with the fourth power of its length.

    Raises:
        InputError: where no cells are fine enough.
    """
    order = max(len(c) for profile in (segment.turn_rate, segment.speed) for c in profile.coefficients)
    _, origin, table = _profiles(segment, order)
    for halving in range(MOST_HALVINGS):
        cells = 2**halving
        edges = [np.linspace(a, b, cells, endpoint=False) for a, b in itertools.pairwise(_breaks(segment))]
        nodes = np.concatenate([*edges, [segment.duration]])
        begin, h = nodes[:-1], np.diff(nodes)[:, None]
        poses = segment.poses(nodes)

        def slopes(at: np.ndarray, alpha: np.ndarray, cells: int = cells) -> np.ndarray:
            """Of the pose, by the polynomials inside the cell: those of the two sides of a break may differ."""
            own = np.repeat(np.arange(len(table)), cells)
            turn_rate, speed = (
                _value_and_slope(list(table[own, c].T), at - origin[own, c])[0] for c in range(table.shape[1])
            )
            return np.stack([turn_rate, -speed * np.sin(alpha), speed * np.cos(alpha)], axis=1)

        first, last = slopes(begin, poses[:-1, 0]), slopes(nodes[1:], poses[1:, 0])
        chord = np.diff(poses, axis=0) / h
        cubics = np.stack(
            [poses[:-1], first, (3 * chord - 2 * first - last) / h, (first + last - 2 * chord) / h**2], axis=2
        )
        middle, _ = _value_and_slope(list(np.moveaxis(cubics, 2, 0)), 0.5 * h)
        if np.abs(middle - segment.poses(begin + 0.5 * h[:, 0])).max() <= POSE_ERROR:
            return begin, np.repeat(begin[:, None], 3, axis=1), cubics
    raise InputError(f"path: no poses within {POSE_ERROR:g} m and rad of its integral; its profiles wind too much")


def _joined(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], since: np.ndarray) -> Pieces:
    """The segments' pieces one after another; θ counts along the whole path."""
    return Pieces(
        np.concatenate([begin + s for (begin, _, _), s in zip(parts, since, strict=True)]),
        np.concatenate([origin + s for (_, origin, _), s in zip(parts, since, strict=True)]),
        np.concatenate([table for _, _, table in parts]),
    )


def _since(path: Path) -> np.ndarray:
    """θ at which each segment begins, s."""
    return np.cumsum([0.0, *(segment.duration for segment in path.curve)])[:-1]


def profiles_of(path: Path) -> Pieces:
    """Turning rate (rad/s) and speed (m/s) along a path of segments: its very polynomials, two columns."""
    every = [c for s in path.curve for profile in (s.turn_rate, s.speed) for c in profile.coefficients]
    order = max(map(len, every))
    return _joined([_profiles(segment, order) for segment in path.curve], _since(path))


def poses_of(path: Path, side_slip: float) -> Pieces:
    """Heading (rad) and position (m, inertial frame) along a path of segments, three columns, to 1e-8 m and rad.

    The heading is that of the vehicle which moves along the path: the tangent's, and its side slip
    (`Problem.side_slip`, rad). Headings go on as the segments state them, without wrapping.
    """
    pieces = _joined([_pose_cubics(segment) for segment in path.curve], _since(path))
    pieces.coefficients[:, 0, 0] += side_slip  # its own array, nobody else's
    return pieces


def point_at(
    profiles: Pieces, piece: Int[Array | np.ndarray, " k"], theta: Float[Array | np.ndarray, " k"]
) -> ReferencePoint:
    """The reference points at θ (s), by the profiles of the given pieces."""
    (omega, omega_slope), (v, v_slope) = profiles.at(piece, theta)
    return ReferencePoint(omega, v, omega_slope, v_slope)
